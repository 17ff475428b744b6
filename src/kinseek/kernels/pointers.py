"""Arrays by address: one integer array refers to all arrays of an arm, so that a call passes one argument.

Numba takes about 0.2 µs to unwrap each array argument, and counts references to each inside. An atlas has twenty arrays,
and a solution takes 5 µs. The Python layer therefore stores addresses and shapes once and keeps the arrays alive, and
kernels create plain views of them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .entry import Bundle, Leaf, parameters
from .jit import COMPILES, Routine, counted, inlined
from .python_backend import call_at, view_of

if TYPE_CHECKING:  # Rows of a chain are declared next to its arrays, and depend on this module.
    from .arrays import Array, Indices

ROW = 4
"""Numbers in a row of a handle: address and three dimensions."""

call: Any = call_at
"""Call the `jit.Routine` at an address with a tuple of numbers, arrays and named tuples; it returns an integer."""

_view_of: Any = view_of

if COMPILES:
    from . import compiler

    call, _view_of = compiler.call_routine, compiler.view_of

_floats, _integers, _bools = map(_view_of, "fib")


def handle_of(arrays: list[NDArray[Any]]) -> Indices:
    """Write the addresses and shapes of arrays, (k · ROW,); the caller keeps the arrays alive."""
    rows = [(a.ctypes.data, *a.shape, *(1,) * (3 - a.ndim)) for a in arrays]
    return np.array(rows, dtype=np.int64).ravel()


@counted
def floats1(handle: Indices, k: int) -> Array:
    """View array k, one-dimensional."""
    seen: Array = _floats(handle[ROW * k], (handle[ROW * k + 1],))
    return seen


@counted
def floats2(handle: Indices, k: int) -> Array:
    """View array k, two-dimensional."""
    seen: Array = _floats(handle[ROW * k], (handle[ROW * k + 1], handle[ROW * k + 2]))
    return seen


@counted
def floats3(handle: Indices, k: int) -> Array:
    """View array k, three-dimensional."""
    o = ROW * k
    seen: Array = _floats(handle[o], (handle[o + 1], handle[o + 2], handle[o + 3]))
    return seen


@counted
def integers(handle: Indices, k: int) -> Indices:
    """View array k, one-dimensional, of integers."""
    seen: Indices = _integers(handle[ROW * k], (handle[ROW * k + 1],))
    return seen


@counted
def integers2(handle: Indices, k: int) -> Indices:
    """View array k, two-dimensional, of integers."""
    seen: Indices = _integers(handle[ROW * k], (handle[ROW * k + 1], handle[ROW * k + 2]))
    return seen


@counted
def flags(handle: Indices, k: int) -> NDArray[np.bool_]:
    """View array k, one-dimensional, of truth values."""
    seen: NDArray[np.bool_] = _bools(handle[ROW * k], (handle[ROW * k + 1],))
    return seen


@counted
def part1(address: int, first: int, count: int) -> Array:
    """View `count` floats of a memory from number `first` on."""
    seen: Array = _floats(address + 8 * first, (count,))
    return seen


@counted
def part2(address: int, first: int, rows: int, columns: int) -> Array:
    """View a table of floats in a memory from number `first` on."""
    seen: Array = _floats(address + 8 * first, (rows, columns))
    return seen


@counted
def integer_part(address: int, first: int, count: int) -> Indices:
    """View `count` integers in a memory of 8-byte numbers from number `first` on."""
    seen: Indices = _integers(address + 8 * first, (count,))
    return seen


@counted
def integer_part2(address: int, first: int, rows: int, columns: int) -> Indices:
    """View a table of integers in a memory of 8-byte numbers from number `first` on."""
    seen: Indices = _integers(address + 8 * first, (rows, columns))
    return seen


@counted
def part3(address: int, first: int, tables: int, rows: int, columns: int) -> Array:
    """View tables of floats in a memory from number `first` on."""
    seen: Array = _floats(address + 8 * first, (tables, rows, columns))
    return seen


def routine(function: Callable[..., int]) -> Routine:
    """Make a `jit.Routine` of a kernel, whose annotations declare what it takes, see `entry.declared`.

    Machine code is called with numbers: the address and the shape of an array, and the fields of a named tuple. A function
    of these numbers is generated; it views the arrays and calls the kernel.
    """
    scope: dict[str, Any] = {name: _PARTS[name] for name in _PARTS}
    scope |= {"kernel": inlined(function), "__name__": function.__module__}
    kinds: list[str] = []

    def number(kind: str) -> str:
        kinds.append(kind)
        return f"n{len(kinds) - 1}"

    def argument(one: Leaf | Bundle) -> str:
        if isinstance(one, Bundle):
            bundle = one.made_of.__name__
            scope[bundle] = one.made_of
            return f"{bundle}({', '.join(map(argument, one.fields.values()))})"
        if one.shape:
            view = _VIEWS[one.element][len(one.shape) - 1]
            return f"{view}({number('int64')}, 0, {', '.join(number('int64') for _ in one.shape)})"
        return number("float64") if one.element == "f" else number("int64") + " != 0" * (one.element == "b")

    given = ", ".join(map(argument, parameters(function).values()))
    names = ", ".join(f"n{i}" for i in range(len(kinds)))
    source = f"def {function.__name__}({names}):\n    return kernel({given})"
    exec(compile(source, inspect.getfile(function), "exec"), scope)
    return Routine(f"int64({', '.join(kinds)})", scope[function.__name__], checked(function))


def checked(function: Callable[..., int]) -> Callable[..., int]:
    """A routine for plain Python, which raises a TypeError if its arguments do not fit: machine code would misread them."""

    def call(*given: Any) -> int:
        known: dict[str, int] = {}
        takes = parameters(function)
        for (name, one), value in zip(takes.items(), given, strict=True):
            if isinstance(one, Bundle) and not isinstance(value, one.made_of):
                raise TypeError(
                    f"{function.__name__}: {name} must be a {one.made_of.__name__}, got {value!r}"
                )
            if isinstance(one, Leaf) and one.shape and not one.fits(value, known):
                raise TypeError(f"{function.__name__}: {name} must be {one.words({})}, got {value!r}")
        return function(*given)

    return call


_PARTS = {each.__name__: each for each in (part1, part2, part3, integer_part, integer_part2)}
_VIEWS = {"f": ("part1", "part2", "part3"), "i": ("integer_part", "integer_part2")}
