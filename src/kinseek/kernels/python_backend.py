"""Kernels as plain Python, under NUMBA_DISABLE_JIT=1: slow, but an index out of range is an error and no stray read.

Plain arrays take a negative index from their end without a word, and cut a slice at it; so does machine code. What a kernel
is given by its caller, and what it views by address, refuses both here. Arrays that a kernel makes for itself do not.
"""

from __future__ import annotations

import ctypes
import functools
import math
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import DTypeLike

P = ParamSpec("P")
R = TypeVar("R")


class Bounded(np.ndarray[Any, np.dtype[Any]]):
    """An array that refuses indices below zero, and slices that reach beyond it."""

    def __getitem__(self, key: Any) -> Any:
        """See the class."""
        self._check(key)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        """See the class."""
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
    """The same arrays, in tuples too, as `Bounded`."""
    if type(value) is np.ndarray:
        return value.view(Bounded)
    return _each(bounded, value) if isinstance(value, tuple) else value


def unbounded(value: Any) -> Any:
    """The same arrays, in tuples too, as what they were."""
    if isinstance(value, Bounded):
        return value.view(np.ndarray)
    return _each(unbounded, value) if isinstance(value, tuple) else value


def _each(change: Callable[[Any], Any], values: tuple[Any, ...]) -> Any:
    changed = map(change, values)
    return type(values)(*changed) if hasattr(values, "_fields") else tuple(changed)


def plainly(kernel: Callable[P, R]) -> Callable[P, R]:
    """Run a kernel as it stands on `Bounded` arrays; machine code makes infinities and NaN without a word too."""

    @functools.wraps(kernel)
    def run(*given: P.args, **named: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return cast("R", unbounded(kernel(*bounded(given), **named)))

    return run


def pointer_at(element: str) -> Callable[[int], tuple[int, DTypeLike]]:
    """What makes an address of numbers, see `entry.Leaf`, into a place for `view_at`."""
    return lambda address: (address, {"f": np.float64, "i": np.int64, "b": np.bool_}[element])


def view_at(place: tuple[int, DTypeLike], shape: tuple[int, ...]) -> Bounded:
    """View the memory at an address; a kernel that reads past the shape it names fails."""
    address, element = place
    size = int(math.prod(shape)) * np.dtype(element).itemsize
    return Bounded(shape, element, memoryview((ctypes.c_byte * size).from_address(int(address))))


_routines: dict[int, Callable[..., int]] = {}


def address_of(function: Callable[..., int]) -> int:
    """A number to stand for the address of a routine."""
    _routines[id(function)] = function
    return id(function)


def call_at(address: int, arguments: tuple[Any, ...]) -> int:
    """Call the routine that such a number stands for."""
    return _routines[int(address)](*arguments)
