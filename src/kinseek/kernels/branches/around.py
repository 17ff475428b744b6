"""Starts for an arm that nearly has a closed form, from poses around the target, where its equations may differ.

A solution q of the arm also solves the nearby arm for the pose that the nearby arm has at q. That pose differs from the
target by about as much as the arms differ, in an unknown direction. Seven directions are tried, as far from each other as
possible. Solutions of the nearby arm may nearly merge, may have merged and vanished, or an angle may be nearly
undetermined. Some of these poses then separate them, also on the other side.

The uncertainty is largest if axis 6 is nearly parallel to the three parallel axes. Its angle to them is given, and joint
6 of the nearby arm determines its direction: there are two such values. The angle of the real arm differs a little and
varies with joint 6, so it may have four solutions, anywhere on the circle, and no pose nearby need have all of them.
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
"""Poses at each distance: the vertices of a regular simplex in the six degrees of freedom of a hand."""


FIRST, FINAL = 1, 4
"""Number of distances that are tried first, and in total."""


BESIDE = 0.05
"""Starts this close [rad] to a solution or to each other count as one."""


@inlined
def least_lean(structure: Array, rows: Array, count: int) -> float:
    """Sine of the smallest angle between axis 6 and the parallel axes in any row, (capacity, n); 1 if there is no row."""
    S, i, least = structure, joint_of(structure, 4, rows.shape[1]), 1.0
    for j in range(count):
        c, s = math.cos(rows[j, i]), math.sin(rows[j, i])
        x, y, z = rotate(S[H5], S[H5 + 1], S[H5 + 2], c, s, S[H6], S[H6 + 1], S[H6 + 2])
        along = dot(S[H], S[H + 1], S[H + 2], x, y, z)
        least = min(least, math.sqrt(max(1.0 - along * along, 0.0)))
    return least


@inlined
def distance(k: int) -> float:
    """Distance of the k-th poses as a multiple of the arm's deviation; negative on the other side.

    Not examined further.
    """
    if k == 0:
        return 3.0
    if k == 1:
        return -1.0
    return -10.0 if k == 2 else 30.0


@inlined
def corner(way: int, i: int) -> float:
    """Component i of six of a vertex of the simplex; vertices have length 1 and pairwise scalar products of -1/6."""
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
    """Write candidates of poses around the target that are not near a known solution into seeds; return their number.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        memory: The scratch memory.
        structure: See `candidates.KIND`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        rates: See `refine_all.joint_gap`, (n,).
        rows: Solutions, (capacity, n).
        count: Number of known solutions.
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
