"""Bounds of boxes of joint values, and the searches that use them."""
