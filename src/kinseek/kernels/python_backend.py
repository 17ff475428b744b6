"""Kernels as plain Python with NUMBA_DISABLE_JIT=1: slow, but an index out of range raises an error.

Plain arrays silently accept negative indices and truncate slices, as machine code does. Arrays that a kernel receives
from its caller, or views by address, reject both here. Arrays that a kernel allocates itself do not.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")


class Bounded(np.ndarray[Any, np.dtype[Any]]):
    """An array that rejects negative indices, and slices that reach beyond its end."""

    def __getitem__(self, key: Any) -> Any:
        """Check the index and read."""
        self._check(key)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        """Check the index and write."""
        self._check(key)
        super().__setitem__(key, value)

    def _check(self, key: Any) -> None:
        for size, each in zip(self.shape, key if isinstance(key, tuple) else (key,), strict=False):
            if isinstance(each, slice):
                outside = any(not 0 <= end <= size for end in (each.start, each.stop) if end is not None)
            else:
                outside = isinstance(each, int | np.integer) and bool(each < 0)
            if outside:
                raise IndexError(f"index {key} reaches beyond an array of shape {self.shape}")


def bounded(value: Any) -> Any:
    """The same arrays as `Bounded`, also in tuples."""
    if type(value) is np.ndarray:
        return value.view(Bounded)
    return _each(bounded, value) if isinstance(value, tuple) else value


def unbounded(value: Any) -> Any:
    """The same arrays as plain arrays, also in tuples."""
    if isinstance(value, Bounded):
        return value.view(np.ndarray)
    return _each(unbounded, value) if isinstance(value, tuple) else value


def _each(change: Callable[[Any], Any], values: tuple[Any, ...]) -> Any:
    changed = map(change, values)
    return type(values)(*changed) if hasattr(values, "_fields") else tuple(changed)


def plainly(kernel: Callable[P, R]) -> Callable[P, R]:
    """Run a kernel as Python on `Bounded` arrays; infinities and NaN are silent, as in machine code."""

    @functools.wraps(kernel)
    def run(*given: P.args, **named: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return cast("R", unbounded(kernel(*bounded(given), **named)))

    return run


def view_of(element: str) -> Callable[[int, tuple[int, ...]], Bounded]:
    """Return a function from an address and a shape to a view of such numbers, see `entry.Leaf`.

    A kernel that reads past the shape raises an error.
    """
    kind = np.dtype({"f": np.float64, "i": np.int64, "b": np.bool_}[element])

    def view(address: int, shape: tuple[int, ...]) -> Bounded:
        size = int(math.prod(shape)) * kind.itemsize
        return Bounded(shape, kind, memoryview((ctypes.c_byte * size).from_address(int(address))))

    return view


_routines: dict[int, Callable[..., int]] = {}


def address_of(function: Callable[..., int]) -> int:
    """A number that represents the address of a routine."""
    # The table keeps the function alive, so no other object gets its id.
    _routines[id(function)] = function
    return id(function)


def call_at(address: int, arguments: tuple[Any, ...]) -> int:
    """Call the routine that such a number represents."""
    return _routines[int(address)](*arguments)
