"""Kernels of maps: many poses asked at once."""
