"""Siblings of an answer: across a singularity, and mirror images of the arm."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import free_turn
from kinseek.kernels.atlas.lanes import (
    LANES,
    lanes_forward,
    lanes_gram,
    lanes_jacobian,
    lanes_residual,
    lanes_solve,
)
from kinseek.kernels.atlas.memory import make_desk
from kinseek.kernels.atlas.task import Task, task_of
from kinseek.kernels.jit import hidden, kernel

from .refine_all import EQUAL, squared_gap

WEAK = 0.02
"""Singular value of the scaled Jacobian at an answer below which others may hide beside it."""


FAR = 2.0
"""Twins farther off than this [rad] are left to the starts: the second order does not reach there."""


SINGULAR = 0.1
"""How much of a step is left, where J makes nothing of it, for the Jacobian to count as singular to rounding."""


PROBE, FLAT = 0.05, 1e-6
"""Length of the probing step along the weakest direction, and the scaled error along it that tells a continuum."""


@kernel
def twins(
    handle: Indices,
    wanted: Array,
    memory: Array,
    rows: Array,
    first: int,
    last: int,
    seeds: Array,
    spent: Array,
    w: int,
) -> int:
    """Write where the twins of answers first … last-1, at most LANES, should be into seeds; return how many.

    The second number of `spent` is increased by the answers that lie on a continuum of answers: those whose pose stays
    where it is along the weakest direction, to second order. The third becomes the least singular value of their
    scaled Jacobians, if it is less.
    """
    task = task_of(handle, wanted)
    dof = len(task.lower)
    desk = make_desk(memory, dof, len(task.chain.leader))
    lanes, W = desk.lanes, LANES
    U, e, J, work = lanes.gram, lanes.residual, lanes.jacobian, lanes.work
    way = np.empty(dof)
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = rows[min(first + l, last - 1), i]
        desk.floor[l] = 1e-13 if dof >= 6 else 1e-9  # Rows that no joint can move make J Jᵀ singular.
        work[W + l] = 0.0
    for phase in range(3):
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_residual(lanes, desk.columns, w)
        if phase == 0:
            lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
            lanes_gram(0.0, desk.floor, lanes, w)
            for i in range(dof):
                for l in range(w):
                    lanes.step[i, l] = 1.0 - 0.27 * i
            # Inverse iteration, u → (J Jᵀ)⁻¹ u; where there are rows that no joint moves, v → Jᵀ (J Jᵀ)⁻² J v. Exactly at a
            # singularity Jᵀ u leads nowhere; there the last turn takes what J makes nothing of, v - Jᵀ (J Jᵀ)⁻¹ J v.
            for turn in range(6):
                if turn == 5 or (dof < 6 and turn not in (1, 3)):
                    fresh = 1.0 if turn in (0, 5) else 0.0
                    for r in range(6 * LANES):
                        e[r] = 0.0
                    for i in range(dof):
                        for r in range(6):
                            for l in range(w):
                                v = fresh * (1.0 - 0.27 * i) + (1.0 - fresh) * lanes.step[i, l]
                                e[r * W + l] += J[i, r * W + l] * v
                elif turn == 0:
                    for r in range(6):
                        for l in range(w):
                            e[r * W + l] = 1.0 - 0.27 * r
                lanes_solve(lanes, w)
                if turn < 5:
                    for l in range(w):
                        size = 1e-300
                        for r in range(6):
                            size += e[r * W + l] * e[r * W + l]
                        size = 1.0 / math.sqrt(size)
                        for r in range(6):
                            e[r * W + l] *= size
                if turn in (0, 2):
                    continue
                for l in range(w):
                    size = 1e-300
                    for i in range(dof):
                        d = 0.0
                        for r in range(6):
                            d += J[i, r * W + l] * e[r * W + l]
                        d = 1.0 - 0.27 * i - d if turn == 5 else d
                        size += d * d
                        way[i] = d
                    size = math.sqrt(size)
                    if turn == 5 and size < SINGULAR:
                        continue
                    work[l] = 0.0 if turn == 5 else size
                    for i in range(dof):
                        lanes.step[i, l] = way[i] / size
                if turn == 4:
                    for r in range(6 * LANES):
                        lanes.pose[r] = e[r]  # Kept there until the gram matrix gives way to it.
            for r in range(6 * LANES):
                U[r] = lanes.pose[r]
        else:
            for l in range(w):
                for r in range(6):
                    work[W + l] += e[r * W + l] * U[r * W + l]
        shift = -2.0 * PROBE if phase == 1 else PROBE
        for i in range(dof):
            for l in range(w):
                lanes.q[i, l] += shift * lanes.step[i, l]
    many = 0
    for l in range(LANES):
        desk.floor[l] = 1e-11
        if first + l >= last:
            continue
        spent[0] += 3.0
        spent[2] = min(spent[2], work[l])
        moved, bend = work[l] * PROBE, work[W + l]
        if moved < FLAT and abs(bend) < FLAT:
            spent[1] += 1.0
        if 2.0 * moved * PROBE < FAR * abs(bend):
            t = 2.0 * moved * PROBE / bend
            for i in range(dof):
                value = lanes.q[i, l] + t * lanes.step[i, l]
                seeds[many, i] = min(max(value, task.lower[i]), task.upper[i])
            many += 1
    memory[0] += 0.0  # Its last use, see `solve_pose`.
    return many


@hidden
def images(
    task: Task,
    mirrors: Array,
    rates: Array,
    rows: Array,
    first: int,
    last: int,
    seeds: Array,
    many: int,
    image: Array,
) -> int:
    """Append the mirror images of answers first … last-1 that are not known to seeds; return how many there are."""
    for j in range(first, last):
        for k in range(len(mirrors)):
            fits = many < len(seeds)
            for i in range(len(image)):
                low, high = task.chain.lower[i], task.chain.upper[i]
                value = mirrors[k, 0, i] * rows[j, i] + mirrors[k, 1, i]
                if mirrors[k, 2, i] > 0.0:
                    value = nearest_copy(value, low, high, 0.5 * (low + high))
                fits = fits and low - EQUAL <= value <= high + EQUAL
                image[i] = min(max(value, low), high)
            for c in range(last):
                fits = fits and squared_gap(rates, rows, c, image) > EQUAL * EQUAL
            if fits:
                for i in range(len(image)):
                    seeds[many, i] = image[i]
                many += 1
    return many
