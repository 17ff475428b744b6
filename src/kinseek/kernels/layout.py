"""Arrays of a bundle in one memory, or in the rows of a handle: declared once, and sizes and views both come from that.

Machine code needs to know of what type every view is, so the functions that make views are written out from the
declaration, as Python does for its own named tuples, and compiled like all others: offsets are constants, and constants
times what an arm has of joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import pointers
from .jit import hidden, view


@dataclass(frozen=True)
class Count:
    """How many numbers there are of something in an arm of n variables and m joints: ``fixed + dof · n + joints · m``."""

    fixed: int
    dof: int = 0
    joints: int = 0

    def __add__(self, other: Count) -> Count:
        """The sum."""
        return Count(self.fixed + other.fixed, self.dof + other.dof, self.joints + other.joints)

    def __mul__(self, other: int | Count) -> Count:
        """So many times as many."""
        if isinstance(other, int):
            return Count(self.fixed * other, self.dof * other, self.joints * other)
        if self.dof or self.joints:
            raise TypeError(f"a memory grows no faster than the arm, got {self} times {other}")
        return other * self.fixed

    def of(self, dof: int, joints: int) -> int:
        """The number for an arm."""
        return self.fixed + self.dof * dof + self.joints * joints

    def __str__(self) -> str:
        """The same as an expression."""
        terms = [f"{self.dof} * dof"] * bool(self.dof) + [f"{self.joints} * joints"] * bool(self.joints)
        return f"({' + '.join([*terms, str(self.fixed)])})"


DOF, JOINTS = Count(0, dof=1), Count(0, joints=1)


@dataclass(frozen=True)
class Part:
    """An array of a bundle: what makes a view of it, and its shape; its elements take 8 bytes each."""

    view: str
    shape: tuple[Count, ...]
    count: Count

    def at(self, first: Count, name: str) -> str:
        """An expression for the view, `first` numbers from the address on."""
        return f"{self.view}(address, {first}, {', '.join(map(str, self.shape))})"


def floats(rows: int | Count, columns: int | Count | None = None) -> Part:
    """Declare an array of floats of one dimension or, if it has columns, of two."""
    shape = [Count(each) if isinstance(each, int) else each for each in (rows, columns) if each is not None]
    if columns is None:
        return Part("part1", tuple(shape), shape[0])
    return Part("part2", tuple(shape), shape[0] * columns)


def whole(length: int) -> Part:
    """Declare an array of integers of one dimension."""
    return Part("integer_part", (Count(length),), Count(length))


class Layout:
    """The arrays of a bundle in one memory of 8-byte numbers, one after the other as they are declared."""

    def __init__(self, bundle: Any, **parts: Part | Layout) -> None:
        """Lay out a bundle.

        Args:
            bundle: Named tuple of arrays, and of bundles that are laid out themselves.
            parts: Of each field what it is, in the order in which they stand in memory.
        """
        _check_names(bundle, parts)
        self.count = Count(0)
        """Numbers that the memory holds."""
        views = {}
        for name, part in parts.items():
            views[name] = part.at(self.count, name)
            self.count = self.count + part.count
        name = bundle.__name__.lower()
        below = {f"make_{each}": part.make for each, part in parts.items() if isinstance(part, Layout)}
        self.size: Any = hidden(_function(f"{name}_size(dof, joints)", str(self.count), {}))
        """A kernel of dof and joints: the numbers that a memory takes."""
        self.make: Any = view(
            _function(f"make_{name}(address, dof, joints)", _bundled(bundle, views), below, bundle)
        )
        """A kernel of an address, dof and joints: the views."""

    def at(self, first: Count, name: str) -> str:
        """See `Part.at`."""
        return f"make_{name}(address + 8 * {first}, dof, joints)"


class Rows:
    """The arrays of a bundle that stand anywhere: which row of a handle holds which, see `pointers.handle_of`."""

    def __init__(self, bundle: Any, **rows: str | Rows) -> None:
        """Declare the rows of a bundle.

        Args:
            bundle: Named tuple of arrays, and of bundles that are declared themselves.
            rows: Of each field the function of `pointers` that views it, or its own rows, in the order of the rows.
        """
        _check_names(bundle, rows)
        self.rows = rows
        self.first: dict[str, int] = {}
        """Row where each field begins."""
        self.count = 0
        """Rows in all."""
        views = {}
        for name, row in rows.items():
            function, count = (row, 1) if isinstance(row, str) else (f"make_{name}", row.count)
            views[name] = f"{function}(handle, first + {self.count})"
            self.first[name] = self.count
            self.count += count
        below = {f"make_{name}": row.make for name, row in rows.items() if isinstance(row, Rows)}
        signature = f"{bundle.__name__.lower()}_of(handle, first)"
        self.make: Any = view(_function(signature, _bundled(bundle, views), below, bundle))
        """A kernel of a handle and the row to begin with: the views."""

    def arrays(self, values: Any) -> list[NDArray[Any]]:
        """The arrays of a bundle in the order of the rows, as kernels take them.

        Raises:
            TypeError: One whose elements or dimensions are others: a kernel would read something else.
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


_VIEWED = {
    "floats1": (np.dtype(np.float64), 1),
    "floats2": (np.dtype(np.float64), 2),
    "floats3": (np.dtype(np.float64), 3),
    "integers": (np.dtype(np.int64), 1),
    "flags": (np.dtype(np.bool_), 1),
}
"""Elements and dimensions of what the functions of `pointers` view."""


def _check_names(bundle: Any, declared: dict[str, Any]) -> None:
    if sorted(declared) != sorted(bundle._fields):
        raise TypeError(f"{bundle.__name__} has the fields {bundle._fields}, declared are {tuple(declared)}")


def _bundled(bundle: Any, views: dict[str, str]) -> str:
    return f"bundle({', '.join(views[name] for name in bundle._fields)})"


def _function(signature: str, result: str, below: dict[str, Any], bundle: Any = None) -> Any:
    """Write a function out; for Numba it stands in this file, by which its machine code is filed."""
    scope: dict[str, Any] = vars(pointers) | below | {"bundle": bundle, "__name__": __name__}
    exec(compile(f"def {signature}:\n    return {result}", __file__, "exec"), scope)
    return scope[signature.partition("(")[0]]
