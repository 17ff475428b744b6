"""Paths: which are followed and proved, how fast, and how other solvers fare on the same tasks."""
