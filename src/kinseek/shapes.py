"""What the type of an array may say of its shape, so that a type checker can tell one pose from a batch.

NumPy's types know the number of dimensions of some arrays: of ``np.zeros((4, 4))``, of what `kinseek.pose` makes of plain
lists, of what `Arm.fk` makes of one joint vector. Of others, of every ``NDArray[np.float64]``, they know nothing. Overloads
take these first, by a type that no known shape fits: ``tuple[Any, ...]`` fits every tuple, ``tuple[Never, ...]`` included.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Never, Protocol

import numpy as np
from numpy.typing import ArrayLike

Unshaped = np.ndarray[tuple[Never, ...], np.dtype[Any]]
"""An array of which only that is known: what is written ``NDArray[...]``."""
Vector = np.ndarray[tuple[int], np.dtype[Any]]
Matrix = np.ndarray[tuple[int, int], np.dtype[Any]]
Stack = np.ndarray[tuple[int, int, int], np.dtype[Any]]

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""Joint vectors, (k, n)."""
Pose = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""One pose, (4, 4)."""
Poses = np.ndarray[tuple[int, int, int], np.dtype[np.float64]]
"""Poses one after the other, (k, 4, 4)."""


class JointMessage(Protocol):
    """What tells joint values by name, as a ROS JointState does; it may tell of joints that an arm has not."""

    @property
    def name(self) -> Any:
        """Names of joints, in any order."""

    @property
    def position(self) -> Any:
        """Of each of them its value, [rad] or [m]."""


ByName = Mapping[str, ArrayLike] | JointMessage
"""Joint values by name."""
Joints = ArrayLike | ByName
"""Joint values, (..., n) base to tip, or by name, [rad] or [m]."""

OneGoal = Matrix | Sequence[Sequence[float]]
"""What is one goal by its type."""
ManyGoals = Stack | Sequence[Matrix]
"""What is a batch of goals by its type."""
UnshapedGoal = Unshaped | Sequence[Unshaped]
"""An array that may be either."""
