"""Compiled numerics: plain arrays in, plain arrays out. Imports nothing of kinseek but itself."""
