"""Distances between joint vectors, modulo full turns of the joints that have the same pose after one.

The difference of two values of such a joint is ``a - b - 2π ⌊(a - b)/2π + ½⌋``, the shorter way; `rate` is 1/(2π) for
it and 0 for other joints. Loops that compare one joint vector with many handle six joints by value, because the overhead
of an innermost loop over six joints dominates: a goal that is not redundant has at most six.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

MOST_JOINTS = 6
"""A goal fixes at most six degrees of freedom of the hand: an arm with more joints is redundant, and its solutions are
sampled."""


class Six(NamedTuple):
    """Values of six joints; with fewer joints the last one counts more than once."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float


@inlined
def six_of(q: Array) -> Six:
    """Read a joint vector, (n,)."""
    last = len(q) - 1
    return Six(q[0], q[min(1, last)], q[min(2, last)], q[min(3, last)], q[min(4, last)], q[min(5, last)])


@inlined
def six_in_column(columns: Array, dof: int, k: int) -> Six:
    """Read a joint vector that is stored joint by joint, (at least dof, k + 1 or more)."""
    last = dof - 1
    return Six(
        columns[0, k],
        columns[min(1, last), k],
        columns[min(2, last), k],
        columns[min(3, last), k],
        columns[min(4, last), k],
        columns[min(5, last), k],
    )


@inlined
def joint_gap(a: float, b: float, rate: float) -> float:
    """Difference of two joint values, the shorter way if `rate` is 1/(2π) and not 0."""
    gap: float = a - b
    gap -= 2.0 * math.pi * np.floor(gap * rate + 0.5)
    return gap


@inlined
def six_gaps(x: Six, y: Six, rates: Six) -> Six:
    """Differences of all six joints."""
    return Six(
        joint_gap(x.a, y.a, rates.a),
        joint_gap(x.b, y.b, rates.b),
        joint_gap(x.c, y.c, rates.c),
        joint_gap(x.d, y.d, rates.d),
        joint_gap(x.e, y.e, rates.e),
        joint_gap(x.f, y.f, rates.f),
    )


@inlined
def plus_scaled(x: Six, factor: float, y: Six) -> Six:
    """``x + factor · y``."""
    return Six(
        x.a + factor * y.a,
        x.b + factor * y.b,
        x.c + factor * y.c,
        x.d + factor * y.d,
        x.e + factor * y.e,
        x.f + factor * y.f,
    )


@inlined
def squares(x: Six) -> float:
    """Sum of the squares."""
    return x.a * x.a + x.b * x.b + x.c * x.c + x.d * x.d + x.e * x.e + x.f * x.f


@inlined
def squared_gap(rates: Array, rows: Array, row: int, q: Array) -> float:
    """Squared distance between a row of joint values and q, (n,) with any number of joints."""
    total = 0.0
    for i in range(len(q)):
        gap = joint_gap(rows[row, i], q[i], rates[i])
        total += gap * gap
    return total
