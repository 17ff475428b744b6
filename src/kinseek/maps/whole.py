"""The fraction of a cell of which every pose is proved reached.

A ball of poses contains a part of the cell. For a solution of its centre it can be proved that the solution continues to
every pose of the ball, inside the limits (`kernels.paths.around`). If this fails for every solution, the part is halved: it
may be too large for the proof, or too near the edge of the workspace.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import BranchesBatch
from kinseek.goal import Goal
from kinseek.kernels.paths.around import answers_around
from kinseek.paths.certify import margins_of
from kinseek.problem import Problem
from kinseek.robots.geometry import open_limits

from .cell import LEVER, Cell
from .last_joint import LastJoint, wide_ball

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

DEPTH = 8
"""Maximum number of halvings of a cell. Twice as many prove more of it, at sixteen times the cost."""

PROBES = 4
"""Number of balls that are tried before a cell is halved. If none is proved, hardly any part is, and a divided cell has
hundreds. Not examined further."""


def whole_share(arm: Arm, cell: Cell, depth: int) -> float:
    """Return the fraction of a cell that is proved completely reached.

    The cell is halved `depth` times, at most `DEPTH` times.
    """
    parts, share, last = [cell], 0.0, LastJoint.of(arm.chain)
    depth = min(depth, DEPTH)
    # Most cells at the boundary of the workspace cannot be proved, and a few balls show that at a fraction of the cost.
    if not _promising(arm, cell, depth, last):
        return share
    for level in range(depth + 1):
        T, position, orientation = zip(*(wide_ball(part, last) for part in parts), strict=True)
        proved = around(arm, np.array(T), np.array(position), np.array(orientation))
        share += 0.5**level * int(proved.sum())
        left = [part for part, good in zip(parts, proved, strict=True) if not good]
        parts = [half for part in left for half in part.halves(LEVER * arm.chain.reach)]
        if not parts:
            break
    return share


def _promising(arm: Arm, cell: Cell, depth: int, last: LastJoint | None) -> bool:
    """Return whether a ball the size of the smallest parts is proved, for some balls spread over the cell."""
    part = cell
    for _ in range(depth):
        part, _ = part.halves(LEVER * arm.chain.reach)
    _, position, orientation = wide_ball(part, last)
    return bool(
        around(arm, cell.sample(PROBES), np.full(PROBES, position), np.full(PROBES, orientation)).any()
    )


def around(arm: Arm, T: Array, position: Array, orientation: Array) -> Flags:
    """Return for balls of poses whether every pose of them is proved reached.

    Args:
        arm: An arm with axes.
        T: Centres of the balls, (k, 4, 4), lengths in [m].
        position: Radii, (k,), [m].
        orientation: Largest rotations, (k,), [rad].
    """
    proved = np.zeros(len(T), dtype=bool)
    redundancy = arm.dof - 6
    if redundancy < 0:
        return proved  # With fewer joints no ball is reached.
    whose, q = _solutions(arm, T, redundancy)
    if not len(q):
        return proved
    goal = Goal.pose(T[whose])
    # The null space: these directions are fixed, so that a redundant arm has one solution per pose in the proof.
    hold = np.ascontiguousarray(np.linalg.svd(arm.jacobian(q))[2][:, 6:])
    lower, upper = open_limits(arm.chain)
    # A continuous joint has no limits in the proof; finite ones would exclude solutions beside them.
    turning = upper > lower + 1e100
    chain = arm.chain.arrays._replace(
        lower=np.where(turning, -np.inf, lower), upper=np.where(turning, np.inf, upper)
    )
    good = np.zeros(len(q), dtype=bool)
    margins = margins_of(Problem(arm.mechanism, goal), q)
    answers_around(chain, goal.targets, q, hold, position[whose], orientation[whose], margins, good)
    proved[whose[good]] = True
    return proved


def _solutions(arm: Arm, T: Array, redundancy: int) -> tuple[NDArray[np.int64], Array]:
    """Return solutions of poses with the index of each one's pose: all of them, or one each for a redundant arm."""
    if redundancy:
        solution = arm.ik(T, threads=1)
        return np.flatnonzero(solution.success), np.ascontiguousarray(solution.q[solution.success])
    branches = cast(BranchesBatch, arm.branches(Goal.pose(T), threads=1))
    return np.repeat(np.arange(len(T)), branches.counts), np.ascontiguousarray(branches.q)
