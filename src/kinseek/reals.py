"""Arrays that hold more than real numbers: NumPy drops an imaginary part and a mask where it makes floats of them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def floats(values: Any) -> NDArray[np.float64]:
    """Make an array of floats, of the caller's own, of values that lose nothing by it.

    Raises:
        ValueError: Some are not real, or masked; or they are no numbers, as `numpy.array` says it, which may raise a
            TypeError or an OverflowError too.
    """
    if isinstance(values, np.ndarray):
        if values.dtype.kind == "c" and (count := np.count_nonzero(values.imag)):
            raise ValueError(
                f"{count} of {values.size} numbers have an imaginary part; of real ones say .real"
            )
        if isinstance(values, np.ma.MaskedArray) and (count := np.count_nonzero(values.mask)):
            raise ValueError(
                f"{count} of {values.size} numbers are masked; say .filled(...) if they hold something"
            )
        if values.dtype.kind == "c":
            values = values.real
    return np.array(values, dtype=np.float64)


def equal(one: Any, other: Any) -> bool:
    """Return whether two arrays have the same shape and the same elements.

    `numpy.array_equal` returns False if a signal handler raises an `Exception` inside of it.
    """
    a, b = np.asarray(one), np.asarray(other)
    return a.shape == b.shape and bool(np.all(a == b))
