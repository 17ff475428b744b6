"""Reachability of many poses in a scene: batched solutions first, then all branches, then more of the self-motion."""

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
    """Return for many poses whether a collision-free solution is found; one thread.

    For most poses the first solution is free. Otherwise all branches are computed in one call. If none of these is free and
    they are a sample of infinitely many, `Arm.ik` searches more of them.

    Args:
        arm: An arm with axes.
        goal: Poses, (k, 4, 4), and tolerances.
        scene: Scene of the arm.
        clearance: Minimum distance of its bodies [m].
        patience: See `search.reached`.

    Returns:
        Is a free solution found, (k,)? False proves nothing.
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
