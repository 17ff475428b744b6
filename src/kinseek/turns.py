"""Angles that mean the same after a full turn: the way from one to another, and ranges that hold a turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TURN = 2 * np.pi
"""[rad]"""

_ROUNDING = 1e-9
"""By so much [rad] a range may fall short of a turn that is written down in decimals."""
_SAME_END = 1e-6
"""Part of a turn by which a range may miss a whole number of them and still end where it begins."""


def nearest_turns(gap: Array) -> Array:
    """The angle of whole turns that is nearest to an angle [rad], of any shape."""
    return np.asarray(TURN * np.round(gap / TURN))


def shortest(gap: Array) -> Array:
    """The same angle within [-π, π]: from one direction to another the short way round [rad], of any shape."""
    return np.asarray(gap - nearest_turns(gap))


def holds_a_turn(lower: Array, upper: Array) -> Flags:
    """Of each range [rad], (n,): does it hold every direction?"""
    return np.asarray(upper - lower >= TURN - _ROUNDING)


def ends_meet(lower: Array, upper: Array) -> Flags:
    """Of each range [rad], (n,): is it a whole number of turns, so that it ends in the direction where it begins?"""
    turns = (upper - lower) / TURN
    return np.asarray((turns > 0.5) & (np.abs(turns - np.round(turns)) < _SAME_END))


def one_turn(lower: Array, upper: Array, turning: Flags) -> tuple[Array, Array]:
    """Ranges, (n,), cut to the turn in their middle where they are `turning` and wider: one turn has every direction."""
    lower, upper = lower.copy(), upper.copy()
    wide = turning & (upper - lower > TURN)
    middle = (lower + upper) / 2
    lower[wide], upper[wide] = middle[wide] - np.pi, middle[wide] + np.pi
    return lower, upper
