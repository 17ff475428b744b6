"""Joints that can be divided out of a search, the first and the last; and full turns of a joint."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

NONE, TURN, SLIDE = 0, 1, 2


class Division(NamedTuple):
    """Joints that are divided out of the atlas, and parts of the pose that are kept."""

    head: int
    """The first joint: NONE, TURN or SLIDE."""
    tail: int
    """The last joint: NONE or TURN."""
    columns: int
    """Directions kept: 2 for the whole orientation, 1 for an axis, 0 for none."""
    length: float
    """Length of a direction [m]."""


@inlined
def product(A: Array, B: Array, C: Array) -> None:
    """Write the product of two transforms, (3, 4), into C."""
    for r in range(3):
        for c in range(4):
            C[r, c] = A[r, 0] * B[0, c] + A[r, 1] * B[1, c] + A[r, 2] * B[2, c]
        C[r, 3] += A[r, 3]


@inlined
def nearest_copy(value: float, low: float, high: float, to: float) -> float:
    """Add full turns to move an angle into [low, high], near `to`; if none fits, as near to the range as possible."""
    turn = 2.0 * math.pi
    value += turn * np.rint((to - value) / turn)
    if value > high:
        down = value - turn * np.ceil((value - high) / turn)
        return down if down >= low or low - down < value - high else value
    if value < low:
        up = value + turn * np.ceil((low - value) / turn)
        return up if up <= high or up - high < low - value else value
    return value
