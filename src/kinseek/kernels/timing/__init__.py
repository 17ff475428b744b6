"""Compiled code for `kinseek.timing`: splines through joint values, and the fastest motion along them."""
