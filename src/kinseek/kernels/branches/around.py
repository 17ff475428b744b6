"""Starts for an arm that nearly has a closed form, from poses around the target, where its equations may differ.

A solution q of the arm also solves the nearby arm for the pose that the nearby arm has at q. That pose differs from the
target by about as much as the arms differ, in an unknown direction. Seven directions are tried, as far from each other as
possible: the vertices of a regular simplex. Solutions of the nearby arm may nearly merge, may have merged and vanished,
or an angle may be nearly undetermined. Some of these poses then separate them, also on the other side.

The uncertainty is largest if axis 6 is nearly parallel to the three parallel axes. Its angle to them is given, and joint
6 of the nearby arm determines its direction: there are two such values. The angle of the real arm differs a little and
varies with joint 6, so it may have four solutions, anywhere on the circle, and no pose nearby need have all of them.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.vectors import Vector, column, dot, norm, rotate, write_column
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.task import task_at
from kinseek.kernels.jit import inlined, kernel
from kinseek.kernels.structure.candidates import joint_of, read_structure
from kinseek.kernels.structure.closed import closed_starts

from .distance import squared_gap
from .refine_all import Search

DIRECTIONS = 7
"""Poses at each distance: the vertices of a regular simplex in the six degrees of freedom of a hand."""

BESIDE = 0.05
"""Starts this close [rad] to a solution or to each other count as one. Not examined further."""


@inlined
def least_lean(structure: Array, rows: Array, count: int) -> float:
    """Sine of the smallest angle between axis 6 and the parallel axes in any row, (capacity, n); 1 if there is no row."""
    axes = read_structure(structure)
    i, least = joint_of(structure, 4, rows.shape[1]), 1.0
    for j in range(count):
        along = dot(axes.parallel, rotate(axes.axis5, math.cos(rows[j, i]), math.sin(rows[j, i]), axes.axis6))
        least = min(least, math.sqrt(max(1.0 - along * along, 0.0)))
    return least


@inlined
def distance_of(k: int) -> float:
    """Distance of the k-th poses as a multiple of the arm's deviation; negative on the other side.

    The first is tried alone at first. Not examined further.
    """
    return 3.0 if k == 0 else -1.0 if k == 1 else -10.0 if k == 2 else 30.0


@inlined
def vertex(k: int, i: int) -> float:
    """Component i of six of a vertex of the simplex; vertices have length 1 and pairwise scalar products of -1/6."""
    if k == 0:
        return math.sqrt(1.0 / 6.0)
    even = -(math.sqrt(7.0) + 1.0) / (6.0 * math.sqrt(6.0))
    return even + math.sqrt(7.0 / 6.0) if k == i + 1 else even


@inlined
def displace(target: Array, k: int, far: float, size: float, pose: Array) -> None:
    """Write a target, (4, 4), moved by `far` [rad] towards vertex k, with lengths relative to `size` [m], (4, 4)."""
    turn = Vector(vertex(k, 3), vertex(k, 4), vertex(k, 5))
    length = norm(turn)
    axis = Vector(turn.x / length, turn.y / length, turn.z / length)
    cosine, sine = math.cos(far * length), math.sin(far * length)
    for c in range(3):
        write_column(rotate(axis, cosine, sine, column(target, c)), pose, c)
    for r in range(3):
        pose[r, 3] = target[r, 3] + far * size * vertex(k, r)


@kernel
def write_starts_around(search: Search, structure: Array, far: bool, count: int) -> int:
    """Write candidates of poses around the target that are not near a known solution into the starts.

    Args:
        search: The search.
        structure: See `candidates.STRUCTURE`, (NUMBERS,).
        far: Whether to try the farther poses, see `distance_of`; else those that are tried first.
        count: Number of known solutions.

    Returns:
        The number of starts.
    """
    job, starts, rates, many = search.job, search.starts, search.metric.rates, 0
    task = task_at(job)
    dof = len(task.lower)
    scratch = scratch_of(job, task)
    pose = np.empty((4, 4))
    for pose_number in range(DIRECTIONS if far else 0, 4 * DIRECTIONS if far else DIRECTIONS):
        distance = distance_of(pose_number // DIRECTIONS) * read_structure(structure).deviation
        displace(search.target, pose_number % DIRECTIONS, distance, read_structure(structure).size, pose)
        closed = closed_starts(task, structure, pose, scratch, scratch.found, job.width)
        for l in range(closed.tried):
            if many == len(starts):
                break
            q = starts[many]
            for i in range(dof):
                q[i] = scratch.found[l, i]
            new = True
            for j in range(count):
                new = new and squared_gap(rates, search.rows, j, q) > BESIDE * BESIDE
            for j in range(many):
                new = new and squared_gap(rates, starts, j, q) > BESIDE * BESIDE
            many += 1 if new else 0
    return many
