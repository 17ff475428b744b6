"""Compiled numerics: plain arrays in, plain arrays out. Imports only from its own folder within kinseek."""
