"""Views by address: the same memory, of the shape and elements asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from kinseek.kernels import pointers
from kinseek.kernels.jit import exposed
from kinseek.kernels.pointers import ROW, handle_of

pytestmark = pytest.mark.jit

ARRAYS: list[tuple[str, Any]] = [
    ("floats1", np.arange(3.0)),
    ("floats2", np.arange(6.0).reshape(2, 3)),
    ("floats3", np.arange(24.0).reshape(2, 3, 4)),
    ("integers", np.arange(5)),
    ("flags", np.array([True, False, True])),
]


def same_memory(view: Any, array: Any) -> bool:
    return (view.ctypes.data, view.shape, view.dtype) == (array.ctypes.data, array.shape, array.dtype)


@pytest.mark.parametrize(("name", "array"), ARRAYS, ids=[name for name, _ in ARRAYS])
def test_a_handle_leads_to_its_arrays(name: str, array: Any) -> None:
    before = np.zeros((2, 2))
    handle = handle_of([before, array])
    assert handle.shape == (2 * ROW,)
    seen = exposed(getattr(pointers, name))(handle, 1)
    assert same_memory(seen, array)
    np.testing.assert_array_equal(seen, array)
    seen[...] = seen[::-1].copy()
    np.testing.assert_array_equal(seen, array)
    assert not before.any()


def test_parts_of_a_memory_are_views_of_it() -> None:
    memory, numbers = np.arange(20.0), np.arange(9)
    at = memory.ctypes.data
    assert same_memory(exposed(pointers.part1)(at, 3, 5), memory[3:8])
    assert same_memory(exposed(pointers.part2)(at, 2, 3, 4), memory[2:14].reshape(3, 4))
    assert same_memory(exposed(pointers.integer_part)(numbers.ctypes.data, 4, 2), numbers[4:6])
    assert exposed(pointers.part1)(at, 20, 0).shape == (0,)
