"""Array types with a known number of dimensions, so that a type checker can distinguish one pose from a batch.

NumPy's types know the number of dimensions of some arrays: of ``np.zeros((4, 4))``, of the result of `kinseek.pose` for
plain lists, and of the result of `Arm.fk` for one joint vector. For others, such as every ``NDArray[np.float64]``, they do
not. Overloads match these first, by a type that no known shape fits: ``tuple[Any, ...]`` fits every tuple, including
``tuple[Never, ...]``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Never, Protocol

import numpy as np
from numpy.typing import ArrayLike

Unshaped = np.ndarray[tuple[Never, ...], np.dtype[Any]]
"""An array of unknown shape, as ``NDArray[...]`` declares it."""
Vector = np.ndarray[tuple[int], np.dtype[Any]]
Matrix = np.ndarray[tuple[int, int], np.dtype[Any]]
Stack = np.ndarray[tuple[int, int, int], np.dtype[Any]]

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""Joint vectors, (k, n)."""
Pose = np.ndarray[tuple[int, int], np.dtype[np.float64]]
"""One pose, (4, 4)."""
Poses = np.ndarray[tuple[int, int, int], np.dtype[np.float64]]
"""A sequence of poses, (k, 4, 4)."""


class JointMessage(Protocol):
    """Joint values by name, such as a ROS JointState. Unknown names are ignored."""

    @property
    def name(self) -> Any:
        """Names of joints, in any order."""

    @property
    def position(self) -> Any:
        """Value of each of these joints, [rad] or [m]."""


ByName = Mapping[str, ArrayLike] | JointMessage
"""Joint values by name."""
Joints = ArrayLike | ByName
"""Joint values, (..., n) base to tip, or by name, [rad] or [m]."""

OneGoal = Matrix | Sequence[Sequence[float]]
"""Types that are certainly one goal."""
ManyGoals = Stack | Sequence[Matrix]
"""Types that are certainly a batch of goals."""
UnshapedGoal = Unshaped | Sequence[Unshaped]
"""An array that may be one goal or a batch."""
