"""Kernels that the library has as parts of others only, for tests of how memory is laid out."""

from __future__ import annotations

from typing import Any

from kinseek.kernels.jit import COMPILES, exposed


def inlined(function: Any) -> Any:
    """The kernel, compiled if Numba compiles here; else as Python, from the source that the library was compiled from."""
    return exposed(function) if COMPILES else function
