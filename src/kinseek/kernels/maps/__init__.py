"""Kernels of maps: tests of many poses at once."""
