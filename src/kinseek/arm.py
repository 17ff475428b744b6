"""The front door: an `Arm`, its forward kinematics and its inverse kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .goal import Goal
from .kernels.forward import forward_many
from .problem import Problem, as_joints
from .robots import read, read_dh
from .robots.chain import SerialChain
from .solution import Solution
from .solvers import Polished, Solver

Array = NDArray[np.float64]


class Arm:
    """A serial arm. Make one with `kinseek.load` or `Arm.from_dh`."""

    def __init__(self, chain: SerialChain) -> None:
        """Wrap a chain that a reader made."""
        self.chain = chain

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[Sequence[float] | Mapping[str, float]] | Array,
        lower: ArrayLike,
        upper: ArrayLike,
        **options: Any,
    ) -> Self:
        """Build an arm from Denavit-Hartenberg rows (a [m], alpha [rad], d [m], theta [rad]).

        Args:
            rows: One a joint, (n, 4), or mappings with the names a, alpha, d and theta.
            lower: Lower limits, (n,), [rad] or [m].
            upper: Upper limits, (n,), [rad] or [m]; infinite limits make a continuous joint.
            options: ``convention="standard" | "modified"``, ``kinds="RRP…"``, ``names``, ``base`` and ``tool``
                (4, 4), ``name``; see `kinseek.robots.read_dh`.

        Raises:
            InvalidRobot: Wrong shapes, NaN, unknown convention or kind, lower above upper.
        """
        return cls(read_dh(rows, lower, upper, **options))

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self.chain.name

    @property
    def dof(self) -> int:
        """Number of joint variables n."""
        return self.chain.dof

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joint variables, base to tip."""
        return self.chain.joint_names

    @property
    def lower(self) -> Array:
        """Lower limits, (n,), [rad] or [m]; -π for a continuous joint."""
        return self.chain.lower.copy()

    @property
    def upper(self) -> Array:
        """Upper limits, (n,), [rad] or [m]; π for a continuous joint."""
        return self.chain.upper.copy()

    def fk(self, q: ArrayLike) -> Array:
        """Pose of the tip in the base.

        Args:
            q: Joint values, (..., n), [rad] or [m]; may lie outside the limits.

        Returns:
            Transforms, (..., 4, 4), lengths in [m].

        Raises:
            InvalidProblem: A wrong shape, NaN or infinity.
        """
        joints = as_joints(self.chain, q)
        flat = np.ascontiguousarray(joints.reshape(-1, self.dof))
        return forward_many(self.chain.arrays, flat).reshape(*joints.shape[:-1], 4, 4)

    def ik(self, goal: Any, *, near: ArrayLike | None = None, solver: Solver | None = None) -> Solution:
        """Find joint values that reach a goal, or come as near to it as the search can.

        Args:
            goal: A pose, (4, 4) or (..., 4, 4); an object that carries one (SciPy, pinocchio, spatialmath); or a
                `Goal`.
            near: Joint values to start from, (n,) or (..., n), [rad] or [m].
            solver: One of `kinseek.solvers`; by default a beam divide and conquer finished by coordinate descent.

        Returns:
            Joint values inside the limits, their errors recomputed by FK, and whether they meet the tolerances.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: `near` does not fit the arm.
            InvalidSolver: The solver's parameters do not fit the arm.
        """
        asked = goal if isinstance(goal, Goal) else Goal.pose(goal)
        problem = Problem(self.chain, asked, None if near is None else np.asarray(near, dtype=float))
        return (solver or Polished()).solve(problem)

    def __repr__(self) -> str:
        """Name, joints and frames."""
        return f"Arm({self.name!r}, {self.dof} joints, {self.chain.base!r} -> {self.chain.tip!r})"


def load(source: str | Path, base: str | None = None, tip: str | None = None) -> Arm:
    """Load an arm.

    Args:
        source: name of a bundled arm (`kinseek robots` lists them), or a path to a .urdf, .xacro or MJCF .xml file.
        base: Link that stays; the root of the file unless given.
        tip: Link whose pose is meant; the only leaf of the file unless given.

    Raises:
        InvalidRobot: Unknown name, missing or broken file, unknown or unconnected links, bad joints.
        MissingExtra: An MJCF file, and MuJoCo is not installed.
    """
    return Arm(read(source, base, tip))
