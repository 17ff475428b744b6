"""The last joint divided out: a pose rotated about the tip's z axis needs a change of the last joint only."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.division import TURN
from kinseek.kinds import POSE
from kinseek.robots import SerialChain
from kinseek.robots.geometry import divide
from kinseek.support.turns import holds_a_turn

from .cell import Cell

Array = NDArray[np.float64]

ON_AXIS = 1e-4
"""Largest offset [m] and tilt [rad] with which a last joint counts as rotating about the tip's z axis. Goals that represent
all rotations allow for it.
"""


class LastJoint(NamedTuple):
    """A last joint that rotates about the tip's z axis."""

    free: bool
    """Can it make a full turn?"""
    position: float
    """Largest position error of the tip, when the joint makes a rotation of the pose about its z axis [m]."""
    orientation: float
    """Largest orientation error in that case [rad]."""

    @classmethod
    def of(cls, chain: SerialChain) -> LastJoint | None:
        """Return the last joint of an arm; None if it does not rotate about the tip's z axis."""
        off = float(np.hypot(*chain.fixed[-1][:2, 3]))
        tilt = float(np.hypot(*chain.fixed[-1][:2, 2]))
        if divide(chain, POSE).tail != TURN or max(off, tilt) > ON_AXIS:
            return None
        free = bool(holds_a_turn(chain.lower[-1:], chain.upper[-1:])[0])
        return cls(free, 2.0 * off, np.pi * tilt)


def wide_ball(part: Cell, last: LastJoint | None) -> tuple[Array, float, float]:
    """Return a ball that contains a part of a cell, see `Cell.ball`; for a stack it includes the last joint's errors.

    Args:
        part: Part of a cell, or of all cells of one position and direction.
        last: The last joint of the arm.
    """
    T, position, angle = part.ball()
    if part.arc is None and last is not None:
        position, angle = position + last.position, angle + last.orientation
    return T, position, angle


def opened(chain: SerialChain) -> SerialChain:
    """Return the same arm with a last joint that can make a full turn."""
    lower, upper = np.append(chain.lower[:-1], -np.pi), np.append(chain.upper[:-1], np.pi)
    return chain.limited(lower, upper, (*chain.kinds[:-1], "continuous"))
