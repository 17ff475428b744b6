"""Starts for an arm that nearly has a closed form, from poses around the target: where its own equations may differ.

An answer q of the arm is an answer of the nearby arm as well, to the pose that this one has at q. That pose lies about as
far from the target as the arms differ. Which way is not known: seven ways are tried, as far from each other as they can be.
Where two answers of the nearby arm all but meet, or have met and are gone, or an angle is all but left to choose, some of
these poses have them apart, and on the other side as well.

Most is open where axis 6 all but points along the three that are parallel. How far it leans from them is given, and of the
nearby arm joint 6 tells whither: there are two such values. The arm itself leans by a little more that changes with joint 6,
so there may be four, anywhere on the circle, and no pose nearby need have them all.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch
from kinseek.kernels.atlas.task import task_of
from kinseek.kernels.jit import inlined, kernel
from kinseek.kernels.structure.candidates import DEVIATION, H5, H6, SIZE, WORK, H, joint_of
from kinseek.kernels.structure.closed import REPORT, TRIED, closed_starts
from kinseek.kernels.structure.subproblems import dot, rotate

from .refine_all import squared_gap

WAYS = 7
"""Poses at each distance: the corners of a regular simplex in the six motions of a hand."""


FIRST, FINAL = 1, 4
"""How many distances are tried first, and in all."""


BESIDE = 0.05
"""Starts this close [rad] to an answer or to each other are one."""


@inlined
def least_lean(structure: Array, rows: Array, count: int) -> float:
    """Sine of the least angle between axis 6 and the parallel ones in any row, (capacity, n); 1 if there is no row."""
    S, i, least = structure, joint_of(structure, 4, rows.shape[1]), 1.0
    for j in range(count):
        c, s = math.cos(rows[j, i]), math.sin(rows[j, i])
        x, y, z = rotate(S[H5], S[H5 + 1], S[H5 + 2], c, s, S[H6], S[H6 + 1], S[H6 + 2])
        along = dot(S[H], S[H + 1], S[H + 2], x, y, z)
        least = min(least, math.sqrt(max(1.0 - along * along, 0.0)))
    return least


@inlined
def distance(k: int) -> float:
    """How far the k-th poses lie, by trial, in deviations of the arm; on the other side if negative."""
    if k == 0:
        return 3.0
    if k == 1:
        return -1.0
    return -10.0 if k == 2 else 30.0


@inlined
def corner(way: int, i: int) -> float:
    """Part i of six of a corner of the simplex, whose corners are of length 1 and -1/6 of each other."""
    if way == 0:
        return math.sqrt(1.0 / 6.0)
    even = -(math.sqrt(7.0) + 1.0) / (6.0 * math.sqrt(6.0))
    return even + math.sqrt(7.0 / 6.0) if way == i + 1 else even


@kernel
def starts_around(
    handle: Indices,
    tolerances: Array,
    memory: Array,
    structure: Array,
    target: Array,
    rates: Array,
    rows: Array,
    count: int,
    first: int,
    last: int,
    seeds: Array,
    w: int,
) -> int:
    """Write candidates of poses around the target that are near to no known answer into seeds; return how many.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        memory: The scratch memory.
        structure: See `candidates.KIND`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        rates: See `refine_all.joint_gap`, (n,).
        rows: Answers, (capacity, n).
        count: How many are known.
        first: First distance, see `distance`.
        last: One past the last.
        seeds: Receives joint values, (k, n).
        w: LANES.
    """
    task = task_of(handle, tolerances)
    dof = len(task.lower)
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    pose, fresh, report, work, one = (
        np.empty((4, 4)),
        np.empty((LANES, dof)),
        np.empty(REPORT),
        np.empty(WORK),
        np.empty(dof),
    )
    many = 0
    for k in range(first * WAYS, last * WAYS):
        far = distance(k // WAYS) * structure[DEVIATION]
        rx, ry, rz = corner(k % WAYS, 3), corner(k % WAYS, 4), corner(k % WAYS, 5)
        length = math.sqrt(rx * rx + ry * ry + rz * rz)
        rx, ry, rz = rx / length, ry / length, rz / length
        cosine, sine = math.cos(far * length), math.sin(far * length)
        for c in range(3):
            x, y, z = rotate(rx, ry, rz, cosine, sine, target[0, c], target[1, c], target[2, c])
            pose[0, c], pose[1, c], pose[2, c] = x, y, z
        for r in range(3):
            pose[r, 3] = target[r, 3] + far * structure[SIZE] * corner(k % WAYS, r)
        closed_starts(task, structure, pose, scratch.spare, work, fresh, report, w)
        for l in range(int(report[TRIED])):
            fits = many < len(seeds)
            for i in range(dof):
                one[i] = fresh[l, i]
            for j in range(count):
                fits = fits and squared_gap(rates, rows, j, one) > BESIDE * BESIDE
            for j in range(many):
                fits = fits and squared_gap(rates, seeds, j, one) > BESIDE * BESIDE
            if fits:
                for i in range(dof):
                    seeds[many, i] = one[i]
                many += 1
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return many
