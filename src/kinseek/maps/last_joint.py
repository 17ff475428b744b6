"""The last joint divided out: a pose turned about the tip's z axis is reached by the same joint values but for the last."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import TURN
from kinseek.kinds import POSE
from kinseek.robots import SerialChain
from kinseek.robots.geometry import divide
from kinseek.turns import holds_a_turn

from .cell import Cell

Array = NDArray[np.float64]

ON_AXIS = 1e-4
"""A last joint turns about the tip's z axis if that is no more off [m], and no more tilted [rad]. What is asked of all turns
at once allows for it."""


class LastJoint(NamedTuple):
    """What a last joint that turns about the tip's z axis gives."""

    free: bool
    """Does it turn all around?"""
    position: float
    """By how much the tip misses a pose that is turned about its z axis, if the joint makes that turn, at most [m]."""
    orientation: float
    """And [rad]."""

    @classmethod
    def of(cls, chain: SerialChain) -> LastJoint | None:
        """The last joint of an arm; None if it does anything else than turn about the tip's z axis."""
        off = float(np.hypot(*chain.fixed[-1][:2, 3]))
        tilt = float(np.hypot(*chain.fixed[-1][:2, 2]))
        if divide(chain, POSE).tail != TURN or max(off, tilt) > ON_AXIS:
            return None
        free = bool(holds_a_turn(chain.lower[-1:], chain.upper[-1:])[0])
        return cls(free, 2.0 * off, np.pi * tilt)


def wide_ball(part: Cell, last: LastJoint | None) -> tuple[Array, float, float]:
    """A ball that holds a part of a cell, see `Cell.ball`; of a stack it allows for what the last joint misses.

    Args:
        part: Of a cell, or of all cells of one place and direction.
        last: The last joint of the arm.
    """
    T, position, angle = part.ball()
    if part.arc is None and last is not None:
        position, angle = position + last.position, angle + last.orientation
    return T, position, angle


def opened(chain: SerialChain) -> SerialChain:
    """The same arm with a last joint that turns all around."""
    lower, upper = np.append(chain.lower[:-1], -np.pi), np.append(chain.upper[:-1], np.pi)
    return chain.limited(lower, upper, (*chain.kinds[:-1], "continuous"))
