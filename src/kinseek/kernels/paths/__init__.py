"""Kernels for paths: following branches, choosing the best sequence of solutions, and tracking in real time."""
