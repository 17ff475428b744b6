"""Random input without end: each module runs by itself, and a short part of each in the tests."""
