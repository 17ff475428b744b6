"""Strict reading of arrays and numbers: NumPy drops imaginary parts and masks silently."""

from __future__ import annotations

import math
from numbers import Real
from operator import index
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, InvalidSolver, KinseekError

from .interrupts import chunks

_NUMBERS = 2**20
"""Numbers that are copied at a time."""

_KINDS = {"b": "bools", "U": "text", "S": "bytes", "M": "dates", "m": "durations", "V": "records"}
"""Names of types of arrays that are not numbers."""

NO_BOUND = 2**62
"""Default bound of integers, because kernels take 64-bit numbers. A message names it only if a value exceeds it."""


def as_float_array(values: Any) -> NDArray[np.float64]:
    """Make a new array of floats from values that can be converted without loss.

    Raises:
        ValueError: Some values are not real, or masked; or not numbers, which includes bools and numbers in quotes. NumPy
            itself may also raise a TypeError or an OverflowError.
    """
    if not isinstance(values, np.ndarray):
        values = np.array(values)  # Its type shows bools and text, which the conversion to floats accepts.
    kind = values.dtype.kind
    if kind not in "iufcO" and values.size:
        raise ValueError(f"got {_KINDS.get(kind, values.dtype)}, not numbers")
    if kind == "c" and (count := np.count_nonzero(values.imag)):
        raise ValueError(
            f"{count} of {values.size} numbers have an imaginary part; if they are real, use .real"
        )
    # Whether the type is plain is asked first: NumPy imports `ma`, which takes 7 ms, when its name is first read.
    masked = type(values) is not np.ndarray and isinstance(values, np.ma.MaskedArray)
    if masked and (count := np.count_nonzero(np.ma.getmaskarray(values))):
        raise ValueError(
            f"{count} of {values.size} numbers are masked; if they have values, use .filled(...)"
        )
    if kind == "c":
        values = values.real
    if values.size <= _NUMBERS or values.ndim == 0:
        return np.array(values, dtype=np.float64)
    # In C order, whatever the order of `values` is: their rows are then a view.
    copied = np.empty(values.shape, dtype=np.float64)
    for part in chunks(len(values), max(_NUMBERS * len(values) // values.size, 1)):
        copied[part] = values[part]
    return copied


def largest_of(numbers: ArrayLike) -> float:
    """Return the largest absolute value, 0 of no numbers; Ctrl-C is heard soon however many numbers there are."""
    values = np.asarray(numbers, dtype=np.float64)
    if values.size <= _NUMBERS:
        return float(np.abs(values).max(initial=0.0))
    rows = values.reshape(-1, values.shape[-1])
    return max(float(np.abs(rows[part]).max(initial=0.0)) for part in chunks(len(rows)))


def arrays_equal(one: Any, other: Any) -> bool:
    """Return whether two arrays have the same shape and the same elements.

    `numpy.array_equal` returns False if a signal handler raises an `Exception` inside of it.
    """
    a, b = np.asarray(one), np.asarray(other)
    return a.shape == b.shape and bool(np.all(a == b))


def as_number(name: str, value: Any, least: float, most: float, error: type[KinseekError]) -> float:
    """Read a real number in a range, of Python, NumPy or another library; bools and text are rejected.

    Args:
        name: Its name in the message.
        value: The value to read.
        least: Smallest valid value.
        most: Largest valid value.
        error: Type of the error to raise.

    Raises:
        KinseekError: Not a number, or out of its range; of the type `error`.
    """
    given: Any = value if isinstance(value, Real) and not isinstance(value, bool) else None
    if isinstance(given, np.floating):  # NumPy would round the bounds to its type.
        given = float(given)
    if isinstance(given, int) and not is_finite_number(given):  # No float can hold it.
        given = None
    if given is not None and least <= given <= most:
        return float(given)
    raise error(f"{name} must be a number from {least:g} to {most:g}, got {value!r:.200}")


def is_finite_number(value: Any) -> bool:
    """Is a value a real number that a float can hold? Bools are none."""
    try:
        return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
    except OverflowError:  # A whole number of any length.
        return False


def as_flag(name: str, value: Any, error: type[KinseekError] = InvalidProblem, hint: str = "") -> bool:
    """Read a bool, of Python or NumPy; numbers, strings and arrays are rejected.

    Raises:
        KinseekError: Another value; of the type `error`, and with the hint at the end of its message.
    """
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise error(f"{name} must be True or False, got {value!r:.200}{hint}")


def as_integer(
    name: str, value: Any, least: int, most: int = NO_BOUND, error: type[KinseekError] = InvalidSolver
) -> int:
    """Read an integer in a range, of Python, NumPy or another library; bools and floats are rejected.

    Args:
        name: Its name in the message.
        value: The value to read.
        least: Smallest valid value.
        most: Largest valid value.
        error: Type of the error to raise.

    Raises:
        KinseekError: Not a whole number, or out of its range; of the type `error`.
    """
    try:
        number = None if isinstance(value, bool) else index(value)
    except TypeError:
        number = None
    if number is not None and least <= number <= most:
        return number
    small = most >= NO_BOUND and (number is None or number < least)
    expected = f"of at least {least:,}" if small else f"from {least:,} to {most:,}"
    raise error(f"{name} must be a whole number {expected}, got {value!r:.200}")
