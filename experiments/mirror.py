"""What the two experiments behind question 6 share: the two-link arm's first pass, and where it leads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import kinseek

from .arms import BRANCHING_FACTOR, Array, spacings

Flags = NDArray[np.bool_]
UPPER, FORE = 0.5, 0.25
"""The paper's links [m]."""
LOST = 0.01
"""Farther than this is lost [m]: the grid's own error is a hundred times smaller."""
NEAR, TURNED = 0.005, 0.05
"""Settled at the mirrored elbow: within the first [m], and turned by more than the second [rad]."""


def arm_with_lattice(turn: float) -> kinseek.Arm:
    """The two-link arm whose elbow is counted from `turn` [rad] on: the same poses, other samples."""
    lower = np.array([0.0, turn])
    return kinseek.Arm.from_dh([[UPPER, 0, 0, 0], [FORE, 0, 0, 0]], lower, lower + 2 * np.pi)


def travel(divisions: int, breadth: int, size: int = BRANCHING_FACTOR) -> float:
    """How far a joint may still go after the first pass [rad].

    Later passes reach ⌊D/2⌋ + Br - 1 nodes to a side, at spacings that are divided by D until they are one node.
    """
    return (divisions // 2 + breadth - 1) * sum(spacings(size, divisions)[1:]) * 2 * np.pi / size


def mirrored_of(q: Array) -> Array:
    """The joint values with the elbow bent the other way and the tip at the same place, (k, 2), [rad]."""
    bend = 2 * np.arctan2(FORE * np.sin(q[:, 1]), UPPER + FORE * np.cos(q[:, 1]))
    return np.stack([q[:, 0] + bend, -q[:, 1]], axis=1)


def apart(first: Array, second: Array) -> Array:
    """The larger of both joints' differences, the short way round, (k,), [rad]."""
    return np.asarray(np.abs((first - second + np.pi) % (2 * np.pi) - np.pi).max(axis=1))


@dataclass(frozen=True)
class Walk:
    """What became of goals made from known joint values, (k,) each."""

    position: Array
    """Position errors [m]."""
    turn: Array
    """Orientation errors [rad]."""
    mirrored_first: Flags
    """Is the best node of the first pass nearer to the mirrored elbow than to the true one?"""
    out_of_reach: Flags
    """Is the true answer farther from that node than all later passes can go?"""
    mirrored_last: Flags
    """Is the final answer nearer to the mirrored elbow?"""

    @property
    def lost(self) -> Flags:
        """Ended centimetres off."""
        return self.position > LOST

    @property
    def settled(self) -> Flags:
        """Ended at the mirrored elbow: the right place, and a wrong turn."""
        return self.mirrored_last & (self.position < NEAR) & (self.turn > TURNED)


def walk(arm: kinseek.Arm, q: Array, divisions: int, breadth: int, position_weight: float) -> Walk:
    """Solve for the poses of `q`, (k, 2), and look at the first pass and at the end."""
    goal = kinseek.Goal.pose(arm.fk(q), position_weight=position_weight)
    # The first pass is a brute force over D values a joint.
    first = arm.ik(goal, solver=kinseek.BruteForce(divisions)).q
    solution = arm.ik(goal, solver=kinseek.DivideAndConquer(BRANCHING_FACTOR, divisions, breadth))
    mirrored = mirrored_of(q)
    return Walk(
        solution.position_error,
        solution.orientation_error,
        apart(first, mirrored) < apart(first, q),
        # The node nearest to an answer is up to half a node from it.
        apart(first, q) > travel(divisions, breadth) + np.pi / BRANCHING_FACTOR,
        apart(solution.q, mirrored) < apart(solution.q, q),
    )


def share(part: Flags, of: Flags) -> float:
    """How much of one set lies in another, 0 where there is none."""
    return float(part[of].mean()) if of.any() else 0.0
