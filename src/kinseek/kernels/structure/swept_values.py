"""Find the values of a swept joint that serve best. This is done once, when an arm is loaded; see `swept_joint`."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.seeds import middle, restart
from kinseek.kernels.atlas.task import Handle, plain_tolerances, task_of
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry

from .candidates import displacement, read_structure
from .choice import order_candidates, take_candidate
from .swept_joint import direction, given_value


@entry
def try_swept_values(
    handle: Handle, swept_values: Annotated[Array, "m"], report: Annotated[Indices, "k", "m", OUT], w: int
) -> None:
    """Find which offsets of the swept joint solve which poses, made from joint values spread over the limits.

    Args:
        handle: The task, see `task_of`.
        swept_values: (m,), [rad] or [m].
        report: Receives 1 where an offset leaves a candidate within the limits, else 0, for each pose, (k, m).
        w: LANES.
    """
    task = task_of(handle, plain_tolerances(handle))
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    near, target, q = np.empty(dof), np.empty((3, 4)), np.empty(dof)
    s = read_structure(task.structure)
    middle(task, near)
    for t in range(len(report)):
        restart(task, t, q)
        forward(task.chain, q, target)
        displacement(task.structure, target, scratch.displacement)
        towards = direction(s, scratch.displacement)
        for k in range(len(swept_values)):
            value, inside = given_value(task, towards + swept_values[k], near)
            report[t, k] = 0
            if inside:
                order_candidates(task, scratch, value, near, False, w)
                report[t, k] = 1 if take_candidate(task, scratch, q) >= 0 else 0
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
