"""Spread joint values over their ranges."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import NONE, Division
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.tree import LEAF_SIZE
from kinseek.support.turns import one_turn

from .chain import SerialChain

Flags = NDArray[np.bool_]

A_JOINT = 64
"""Most samples of one joint: an arm with few joints needs no more. Tried on 4-joint arms: with 32 a goal takes 6 % more FK
evaluations; with 128 it takes 7 % fewer, with four times as many samples. The program of this trial is not in the
repository."""


def middle_samples(chain: SerialChain, division: Division, samples: int) -> tuple[Array, int]:
    """Spread samples over the joints that are not divided out; return them and the index of the first such joint."""
    first, last = int(division.head != NONE), chain.dof - int(division.tail != NONE)
    requested = min(samples, A_JOINT ** max(last - first, 0))
    # The tree of samples is halved down to its leaves, so their number is a power of two times the leaf size.
    count = LEAF_SIZE * 2 ** max(math.ceil(math.log2(max(requested, LEAF_SIZE) / LEAF_SIZE)), 0)
    turns = chain.turns[first:last]
    return spread_inside(chain.lower[first:last], chain.upper[first:last], turns, count), first


def spread_inside(lower: Array, upper: Array, turns: Flags, count: int) -> Array:
    """Spread joint values over their ranges, or over one turn if a range contains more, (count, n).

    Many solutions are in the corners of the limits, and a start inside often leads past them. So every eighth sample is
    spread twice as wide and clipped, so that each of its joints is at a limit half of the time.
    """
    lower, upper = one_turn(lower, upper, turns)
    centred = low_discrepancy(count, len(lower)) - 0.5
    corner = np.arange(count) % 8 == 7
    centred[corner] = np.clip(2 * centred[corner], -0.5, 0.5)
    return np.ascontiguousarray(lower + (centred + 0.5) * (upper - lower))


def low_discrepancy(count: int, dimensions: int) -> Array:
    """Return well-spread points of the unit cube, (count, dimensions) (Roberts 2018, the R_d sequence)."""
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * low_discrepancy_steps(dimensions)) % 1.0)


def low_discrepancy_steps(dimensions: int) -> Array:
    """Return the increment of each coordinate from one point of `low_discrepancy` to the next, (dimensions,)."""
    g = 2.0
    for _ in range(40):
        g = (1 + g) ** (1 / (dimensions + 1))
    return np.asarray(g ** -np.arange(1.0, dimensions + 1))


def weyl(count: int, dimensions: int) -> Array:
    """Return points of the unit cube in steps of square roots of primes, (count, dimensions) (Weyl 1916).

    They are spread less well than `low_discrepancy`, but no two coordinates of few points are close to a simple ratio.
    """
    steps = np.sqrt(np.resize(np.array(_primes(), dtype=float), dimensions))
    return np.asarray((np.arange(1, count + 1)[:, None] * steps) % 1.0)


@cache
def _primes() -> tuple[int, ...]:
    return tuple(p for p in range(2, 400) if all(p % i for i in range(2, int(p**0.5) + 1)))
