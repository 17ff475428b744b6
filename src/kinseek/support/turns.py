"""Angles modulo full turns: differences between them, and ranges that contain a full turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TURN = 2 * np.pi
"""A full turn [rad]."""

_ROUNDINGS = 8.0 * np.finfo(float).eps
"""Rounding of a range's ends, relative to the larger end or to a turn: both ends written with 15 decimal digits.

A range that is shorter than a turn by no more than this contains a full turn, because forward kinematics rounds an angle by
as much. A range of ±3.14159 does not: it excludes 5.3e-6 rad.
"""
_SAME_END = 1e-6
"""Largest distance of a range from a whole number of turns, as a fraction of a turn, with which its ends still coincide."""


def nearest_turns(gap: Array) -> Array:
    """Return the multiple of a full turn that is nearest to an angle [rad], of any shape."""
    return np.asarray(TURN * np.round(gap / TURN))


def shortest(gap: Array) -> Array:
    """Return the same angle within [-π, π], i.e. the shortest difference of two directions [rad], of any shape."""
    return np.asarray(gap - nearest_turns(gap))


def holds_a_turn(lower: Array, upper: Array) -> Flags:
    """Return whether each range [rad], (n,), contains every direction, up to rounding in the 15th digit of its ends.

    A range that was meant as a turn but written with fewer digits does not: no motion inside it crosses the gap.
    """
    large = np.maximum(np.maximum(np.abs(lower), np.abs(upper)), TURN)
    return np.asarray(upper - lower >= TURN - _ROUNDINGS * large)


def ends_meet(lower: Array, upper: Array) -> Flags:
    """Return whether each range [rad], (n,), is nearly a whole number of turns, so that its ends nearly coincide.

    This decides where a grid search looks next, never its results or claims. So ±3.14159 counts.
    """
    turns = (upper - lower) / TURN
    return np.asarray((turns > 0.5) & (np.abs(turns - np.round(turns)) < _SAME_END))


def one_turn(lower: Array, upper: Array, turning: Flags) -> tuple[Array, Array]:
    """Cut the ranges, (n,), that are `turning` and wider than a turn to the turn in their middle.

    One turn has every direction.
    """
    lower, upper = lower.copy(), upper.copy()
    wide = turning & (upper - lower > TURN)
    middle = (lower + upper) / 2
    lower[wide], upper[wide] = middle[wide] - np.pi, middle[wide] + np.pi
    return lower, upper
