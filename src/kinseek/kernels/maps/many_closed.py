"""Test which of many poses a closed form reaches; it decides most of them at the cost of its candidates."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.task import TOLERANCES, Handle, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry
from kinseek.kernels.structure.candidates import NUMBERS
from kinseek.kernels.structure.closed import closed_starts, serves

LEFT, NO, YES = 0, 1, 2
"""Results for a pose: it is left to a search; it has no candidate within the limits or close to them; a candidate is a
solution."""


@entry
def many_closed(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    structure: Annotated[Array, NUMBERS],
    targets: Annotated[Array, "k", 3, 4],
    report: Annotated[Indices, "k", OUT],
    w: int,
) -> int:
    """Test whether a closed form reaches poses.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        structure: See `structure.candidates.STRUCTURE`, (NUMBERS,).
        targets: Rigid transforms, (k, 3, 4), lengths in [m].
        report: Receives LEFT, NO or YES, (k,).
        w: LANES.

    Returns:
        The number of poses left.
    """
    task = task_of(handle, tolerances)
    dof = len(task.lower)
    left = len(targets)
    if not serves(task, structure):
        for i in range(left):
            report[i] = LEFT
        return left
    memory = np.zeros(scratch_size(dof, len(task.chain.leader)))
    scratch, T = make_scratch(memory, dof, len(task.chain.leader)), np.empty((3, 4))
    seeds = scratch.found
    for i in range(len(targets)):
        closed = closed_starts(task, structure, targets[i], scratch, seeds, w)
        # If the closed form certainly gives no candidate, there is no solution. A candidate that misses the pose excludes
        # nothing.
        report[i] = LEFT if closed.tried > 0 or closed.unsure else NO
        goal = GoalArrays(targets[i], task.position_weight, task.axis_weights)
        for j in range(closed.tried):
            forward(task.chain, seeds[j], T)
            position, orientation = errors(T, goal)
            if position <= task.position_tolerance and orientation <= task.orientation_tolerance:
                report[i] = YES
                break
        left -= 1 if report[i] != LEFT else 0
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return left
