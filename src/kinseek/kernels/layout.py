"""Arrays of a bundle in one memory block, or in the rows of a handle; one declaration gives both sizes and views.

Machine code needs the type of every view. The functions that make views are therefore generated as source code from the
declaration, as Python does for its own named tuples, and compiled like all others. Offsets are constants, or constants
times the numbers of joints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import pointers
from .entry import Bundle, Leaf, bundle_of
from .jit import inlined


@dataclass(frozen=True)
class Count:
    """A number of elements as a polynomial in named sizes, such as the number of variables of the arm."""

    terms: tuple[tuple[str, int], ...]
    """Products of names, ``""`` for a constant, with their coefficients, never 0."""

    def __add__(self, other: Count) -> Count:
        """The sum."""
        return _collected([*self.terms, *other.terms])

    def __mul__(self, other: int | Count) -> Count:
        """The product."""
        times = (("", other),) if isinstance(other, int) else other.terms
        both = [(f"{a} * {b}" if a and b else a + b, m * n) for a, m in self.terms for b, n in times]
        if any(set(name.split(" * ")) <= {"dof", "joints"} for name, _ in both if " * " in name):
            raise TypeError(f"a memory grows no faster than the arm, got {self} times {other}")
        return _collected(both)

    def of(self, **numbers: int) -> int:
        """The value for given sizes."""
        return sum(
            n * math.prod(numbers[each] for each in name.split(" * ") if each) for name, n in self.terms
        )

    def __str__(self) -> str:
        """The count as an expression."""
        named = [f"{n} * {name}" for name, n in self.terms if name]
        return f"({' + '.join([*named, str(dict(self.terms).get('', 0))])})"


def _collected(terms: list[tuple[str, int]]) -> Count:
    names = dict.fromkeys(name for name, _ in terms)
    sums = {each: sum(n for name, n in terms if name == each) for each in names}
    return Count(tuple((name, n) for name, n in sums.items() if n))


def plain(number: int) -> Count:
    """A constant count."""
    return Count((("", number),) if number else ())


def named(name: str) -> Count:
    """The count of a named size, see ``made_for`` of a `Layout`."""
    return Count(((name, 1),))


ARM = ("dof", "joints")
"""Sizes that most memories depend on: the numbers of variables and joints of an arm."""
DOF, JOINTS = (named(each) for each in ARM)


@dataclass(frozen=True)
class Part:
    """An array of a bundle: the function that views it, and its shape; its elements have 8 bytes each."""

    view: str
    shape: tuple[Count, ...]
    count: Count

    def at(self, first: Count, name: str) -> str:
        """An expression for the view, `first` numbers from the address on."""
        return f"{self.view}(address, {first}, {', '.join(map(str, self.shape))})"


def floats(*shape: int | Count) -> Part:
    """Declare an array of floats of up to three dimensions."""
    return _part(("part1", "part2", "part3"), shape)


def whole(*shape: int | Count) -> Part:
    """Declare an array of integers of up to two dimensions."""
    return _part(("integer_part", "integer_part2"), shape)


def _part(views: tuple[str, ...], shape: tuple[int | Count, ...]) -> Part:
    counts = tuple(plain(each) if isinstance(each, int) else each for each in shape)
    return Part(views[len(shape) - 1], counts, math.prod(counts, start=plain(1)))


def _part_of(leaf: Leaf, name: str) -> Part:
    """The part of a declared array."""
    if not leaf.shape:
        raise TypeError(f"{name} is a number, and a layout has arrays only")
    lengths = [named(each.name) + plain(each.plus) if each.name else plain(each.plus) for each in leaf.shape]
    return floats(*lengths) if leaf.element == "f" else whole(*lengths)


class Layout:
    """The arrays of a bundle in one memory of 8-byte numbers, consecutive in the order of their declaration."""

    def __init__(
        self, bundle: Any, made_for: tuple[str, ...] = ARM, name: str = "", **parts: Part | Layout
    ) -> None:
        """Lay out a bundle.

        Args:
            bundle: Named tuple of arrays and such bundles. The annotations of its fields give the shapes, and their order is
                that in memory.
            made_for: Names of the sizes.
            name: Distinguishes two layouts of one bundle: machine code is stored under it.
            parts: Declaration of fields that differ from their annotation.
        """
        fields = bundle_of(bundle).fields
        _check_names(bundle, fields | parts)
        for field, leaf in fields.items():
            if field in parts:
                continue
            if isinstance(leaf, Bundle):
                parts[field] = Layout(leaf.made_of, made_for)
            else:
                parts[field] = _part_of(leaf, f"{bundle.__name__}.{field}")
        self.count = plain(0)
        """Length of the memory in numbers."""
        views = {}
        self._places: dict[str, tuple[Count, Part | Layout]] = {}
        for field in bundle._fields:
            part = parts[field]
            self._places[field] = self.count, part
            views[field] = part.at(self.count, field)
            self.count = self.count + part.count
        name, self._given = name or bundle.__name__.lower(), ", ".join(made_for)
        below = {f"make_{each}": part.make for each, part in parts.items() if isinstance(part, Layout)}
        self.size: Any = inlined(_function(f"{name}_size({self._given})", str(self.count), {}))
        """A kernel from the sizes to the length of the memory in numbers."""
        self.make: Any = inlined(
            _function(f"make_{name}(address, {self._given})", _bundled(bundle, views), below, bundle)
        )
        """A kernel from an address and the sizes to the views."""

    def view(self, path: str, memory: NDArray[np.float64], **numbers: int) -> NDArray[Any]:
        """View an array in a memory from Python: ``"field"``, or ``"field.field"`` for a nested bundle.

        Args:
            path: Name of the array.
            memory: The whole memory.
            numbers: The sizes.
        """
        field, _, rest = path.partition(".")
        first, part = self._places[field]
        place = memory[first.of(**numbers) :]
        if isinstance(part, Layout):
            return part.view(rest, place, **numbers)
        seen = place[: part.count.of(**numbers)]
        integers = part.view.startswith("integer")
        return (seen.view(np.int64) if integers else seen).reshape(
            [each.of(**numbers) for each in part.shape]
        )

    def at(self, first: Count, name: str) -> str:
        """See `Part.at`."""
        return f"make_{name}(address + 8 * {first}, {self._given})"


class Rows:
    """The arrays of a bundle at arbitrary addresses: maps the rows of a handle to fields, see `pointers.handle_of`."""

    def __init__(self, bundle: Any) -> None:
        """Declare the rows of a named tuple of arrays and bundles, in the order of its fields."""
        rows: dict[str, str | Rows] = {
            name: Rows(leaf.made_of)
            if isinstance(leaf, Bundle)
            else _VIEWS[leaf.element][len(leaf.shape) - 1]
            for name, leaf in bundle_of(bundle).fields.items()
        }
        self.rows = rows
        self.first: dict[str, int] = {}
        """First row of each field."""
        self.count = 0
        """Total number of rows."""
        views = {}
        for name, row in rows.items():
            function, count = (row, 1) if isinstance(row, str) else (f"make_{name}", row.count)
            views[name] = f"{function}(handle, first + {self.count})"
            self.first[name] = self.count
            self.count += count
        below = {f"make_{name}": row.make for name, row in rows.items() if isinstance(row, Rows)}
        signature = f"{bundle.__name__.lower()}_of(handle, first)"
        self.make: Any = inlined(_function(signature, _bundled(bundle, views), below, bundle))
        """A kernel from a handle and its first row to the views."""

    def arrays(self, values: Any) -> list[NDArray[Any]]:
        """The arrays of a bundle in the order of the rows, as kernels take them.

        Raises:
            TypeError: An array has other elements or dimensions, which a kernel would misread.
        """
        arrays: list[NDArray[Any]] = []
        for name, row in self.rows.items():
            value = getattr(values, name)
            if isinstance(row, Rows):
                arrays += row.arrays(value)
                continue
            if (value.dtype, value.ndim) != _VIEWED[row]:
                raise TypeError(
                    f"{name} is read by {row}, got {value.ndim} dimensions of {value.dtype}, "
                    f"expected {_VIEWED[row][1]} of {_VIEWED[row][0]}"
                )
            arrays.append(np.ascontiguousarray(value))
        return arrays


_VIEWS = {"f": ("floats1", "floats2", "floats3"), "i": ("integers", "integers2"), "b": ("flags",)}
"""Functions of `pointers` that view arrays of one and more dimensions, for each `Leaf.element`."""

_VIEWED = {
    "floats1": (np.dtype(np.float64), 1),
    "floats2": (np.dtype(np.float64), 2),
    "floats3": (np.dtype(np.float64), 3),
    "integers": (np.dtype(np.int64), 1),
    "integers2": (np.dtype(np.int64), 2),
    "flags": (np.dtype(np.bool_), 1),
}
"""Elements and dimensions that the functions of `pointers` view."""


def _check_names(bundle: Any, declared: dict[str, Any]) -> None:
    if sorted(declared) != sorted(bundle._fields):
        raise TypeError(f"{bundle.__name__} has the fields {bundle._fields}, declared are {tuple(declared)}")


def _bundled(bundle: Any, views: dict[str, str]) -> str:
    return f"bundle({', '.join(views[name] for name in bundle._fields)})"


def _function(signature: str, result: str, below: dict[str, Any], bundle: Any = None) -> Any:
    """Generate a function; for Numba it is in this file, under which its machine code is stored."""
    scope: dict[str, Any] = vars(pointers) | below | {"bundle": bundle, "__name__": __name__}
    exec(compile(f"def {signature}:\n    return {result}", __file__, "exec"), scope)
    return scope[signature.partition("(")[0]]
