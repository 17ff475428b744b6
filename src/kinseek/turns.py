"""Angles that mean the same after a full turn: the way from one to another, and ranges that hold a turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TURN = 2 * np.pi
"""[rad]"""

_ROUNDINGS = 8.0 * np.finfo(float).eps
"""Relative to the larger end of a range, or to a turn: what 15 decimal digits leave of both ends, as many as a double keeps.
A range that is shorter by no more holds a turn: forward kinematics rounds an angle by as much. A range of ±3.14159 does not:
it leaves 5.3e-6 rad out."""
_SAME_END = 1e-6
"""Part of a turn by which a range may miss a whole number of them and still end where it begins."""


def nearest_turns(gap: Array) -> Array:
    """The angle of whole turns that is nearest to an angle [rad], of any shape."""
    return np.asarray(TURN * np.round(gap / TURN))


def shortest(gap: Array) -> Array:
    """The same angle within [-π, π]: from one direction to another the short way round [rad], of any shape."""
    return np.asarray(gap - nearest_turns(gap))


def holds_a_turn(lower: Array, upper: Array) -> Flags:
    """Of each range [rad], (n,): does it hold every direction, but for rounding in the 15th digit of its ends?

    A range that was meant as a turn and written with fewer digits does not: inside of it there is no way across the gap.
    """
    large = np.maximum(np.maximum(np.abs(lower), np.abs(upper)), TURN)
    return np.asarray(upper - lower >= TURN - _ROUNDINGS * large)


def ends_meet(lower: Array, upper: Array) -> Flags:
    """Of each range [rad], (n,): is it nearly a whole number of turns, so that it ends about where it begins?

    This decides where a grid search looks next, never what it returns or what is claimed: ±3.14159 counts.
    """
    turns = (upper - lower) / TURN
    return np.asarray((turns > 0.5) & (np.abs(turns - np.round(turns)) < _SAME_END))


def one_turn(lower: Array, upper: Array, turning: Flags) -> tuple[Array, Array]:
    """Ranges, (n,), cut to the turn in their middle where they are `turning` and wider: one turn has every direction."""
    lower, upper = lower.copy(), upper.copy()
    wide = turning & (upper - lower > TURN)
    middle = (lower + upper) / 2
    lower[wide], upper[wide] = middle[wide] - np.pi, middle[wide] + np.pi
    return lower, upper
