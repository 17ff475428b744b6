"""Reached or not, of many poses in a scene: answers in lanes first, then all branches, then more of the self-motion."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import BranchesBatch
from kinseek.collision import Scene
from kinseek.goal import Goal

from .search import PATIENCE, reached

Flags = NDArray[np.bool_]


def reached_freely(
    arm: Arm, goal: Goal, scene: Scene, clearance: float, patience: int | None = PATIENCE
) -> Flags:
    """Say of many poses whether an answer is found that is free in a scene; one thread.

    The first answer of most is free. Where it is not, all branches are asked in one call; and where none of these is free,
    and they are a sample of endlessly many, `Arm.ik` looks through more of them.

    Args:
        arm: With axes.
        goal: Poses, (k, 4, 4), and tolerances.
        scene: Of the arm.
        clearance: How far apart its bodies have to be [m].
        patience: See `search.reached`.

    Returns:
        (k,): is there an answer that is free? A no is no proof.
    """
    free = reached(arm, goal, patience)
    left = np.flatnonzero(free)
    if len(left):
        first = arm.ik(goal.at(goal.target[left]), threads=1)
        free[left] = first.success & scene.free(first.q, clearance, threads=1)
        left = left[~free[left]]
    if len(left):
        every = cast(BranchesBatch, arm.branches(goal.at(goal.target[left]), threads=1))
        owners = np.repeat(np.arange(len(left)), every.counts)
        free[left[owners[scene.free(every.q, clearance, threads=1)]]] = True
        missed = np.flatnonzero(~free[left]).tolist()
        left = left[[i for i in missed if not len(every[i]) or every[i].sampled]]
    if len(left):
        more = arm.ik(goal.at(goal.target[left]), scene=scene, clearance=clearance, threads=1)
        free[left] = more.success
    return free
