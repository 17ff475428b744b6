"""Siblings of a solution: across a singularity, and mirror images of the arm."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import FLOOR, free_turn
from kinseek.kernels.atlas.lanes import (
    LANES,
    lanes_forward,
    lanes_gram,
    lanes_jacobian,
    lanes_residual,
    lanes_solve,
)
from kinseek.kernels.atlas.memory import make_scratch
from kinseek.kernels.atlas.task import Task, task_of
from kinseek.kernels.jit import inlined, kernel

from .refine_all import CONTINUA, EQUAL, EVALUATED, WEAKEST, squared_gap

WEAK = 0.02
"""Singular value of the scaled Jacobian at a solution below which there may be others close to it."""


FAR = 2.0
"""Twins farther away than this [rad] are left to the starts, because the second-order model is not valid there."""


SINGULAR = 0.1
"""Length of the part of a step in the null space of J above which the Jacobian counts as singular up to rounding."""


PROBE, FLAT = 0.05, 1e-6
"""Length of the probing step along the weakest direction, and the scaled error along it below which solutions form a
continuum."""


PHASES = 3
"""Number of FK evaluations: one at the solution for the weakest direction, and one on each side of it."""


LEAN = 0.27
"""The inverse iteration begins at ``1, 1 - LEAN, 1 - 2 LEAN …``. No two of these numbers are equal or opposite, and none
is 0, so that the vector is not orthogonal to the weakest direction of the many arms with right angles."""


FULL_FLOOR, SHORT_FLOOR = 1e-13, 1e-9
"""Regularisation of the diagonal of J Jᵀ: small with six joints and more; larger with fewer, because no joint moves some
rows. Not examined further."""


TINY = 1e-300
"""Prevents division by zero for a direction of no length."""


SIGNS, SHIFTS, TURNING = range(3)
"""Rows of a mirror image ``q → sign · q + shift``: sign and shift of each joint, and 1 for a revolute joint, else 0, (n,)
each."""


@kernel
def twins(
    handle: Indices,
    tolerances: Array,
    memory: Array,
    rows: Array,
    first: int,
    last: int,
    seeds: Array,
    tally: Array,
    w: int,
) -> int:
    """Write the estimated twins of solutions first … last-1, at most LANES, into seeds; return their number.

    CONTINUA of the tally increases by the number of solutions on a continuum, whose pose is stationary along the weakest
    direction to second order. WEAKEST becomes the smallest singular value of their scaled Jacobians if it is smaller.
    """
    task = task_of(handle, tolerances)
    dof = len(task.lower)
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    lanes = scratch.lanes
    e, J = lanes.residual, lanes.jacobian
    U, way, weak, bent = np.empty((6, LANES)), np.empty(dof), np.empty(LANES), np.zeros(LANES)
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = rows[min(first + l, last - 1), i]
        # Rows that no joint can move make J Jᵀ singular.
        scratch.floor[l] = FULL_FLOOR if dof >= 6 else SHORT_FLOOR
    for phase in range(PHASES):
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_residual(lanes, scratch.columns, w)
        if phase == 0:
            lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
            lanes_gram(0.0, scratch.floor, lanes, w)
            for i in range(dof):
                for l in range(w):
                    lanes.step[i, l] = 1.0 - LEAN * i
            # Inverse iteration, u → (J Jᵀ)⁻¹ u; if there are rows that no joint moves, v → Jᵀ (J Jᵀ)⁻² J v. Exactly at a
            # singularity Jᵀ u is zero; the last turn then takes the part in the null space of J, v - Jᵀ (J Jᵀ)⁻¹ J v.
            for turn in range(6):
                if turn == 5 or (dof < 6 and turn not in (1, 3)):
                    fresh = 1.0 if turn in (0, 5) else 0.0
                    for r in range(6):
                        for l in range(w):
                            e[r, l] = 0.0
                    for i in range(dof):
                        for r in range(6):
                            for l in range(w):
                                v = fresh * (1.0 - LEAN * i) + (1.0 - fresh) * lanes.step[i, l]
                                e[r, l] += J[i, r, l] * v
                elif turn == 0:
                    for r in range(6):
                        for l in range(w):
                            e[r, l] = 1.0 - LEAN * r
                lanes_solve(lanes, w)
                if turn < 5:
                    for l in range(w):
                        size = TINY
                        for r in range(6):
                            size += e[r, l] * e[r, l]
                        size = 1.0 / math.sqrt(size)
                        for r in range(6):
                            e[r, l] *= size
                if turn in (0, 2):
                    continue
                for l in range(w):
                    size = TINY
                    for i in range(dof):
                        d = 0.0
                        for r in range(6):
                            d += J[i, r, l] * e[r, l]
                        d = 1.0 - LEAN * i - d if turn == 5 else d
                        size += d * d
                        way[i] = d
                    size = math.sqrt(size)
                    if turn == 5 and size < SINGULAR:
                        continue
                    weak[l] = 0.0 if turn == 5 else size
                    for i in range(dof):
                        lanes.step[i, l] = way[i] / size
                if turn == 4:
                    for r in range(6):
                        for l in range(w):
                            U[r, l] = e[r, l]
        else:
            for l in range(w):
                for r in range(6):
                    bent[l] += e[r, l] * U[r, l]
        shift = -2.0 * PROBE if phase == 1 else PROBE
        for i in range(dof):
            for l in range(w):
                lanes.q[i, l] += shift * lanes.step[i, l]
    many = 0
    for l in range(LANES):
        scratch.floor[l] = FLOOR
        if first + l >= last:
            continue
        tally[EVALUATED] += PHASES
        tally[WEAKEST] = min(tally[WEAKEST], weak[l])
        moved, bend = weak[l] * PROBE, bent[l]
        if moved < FLAT and abs(bend) < FLAT:
            tally[CONTINUA] += 1.0
        if 2.0 * moved * PROBE < FAR * abs(bend):
            t = 2.0 * moved * PROBE / bend
            for i in range(dof):
                value = lanes.q[i, l] + t * lanes.step[i, l]
                seeds[many, i] = min(max(value, task.lower[i]), task.upper[i])
            many += 1
    memory[0] += 0.0  # Its last use, see `one_goal.solve_pose`.
    return many


@inlined
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
    """Append the unknown mirror images of solutions first … last-1 to seeds; return the number of seeds."""
    for j in range(first, last):
        for k in range(len(mirrors)):
            fits = many < len(seeds)
            for i in range(len(image)):
                low, high = task.chain.lower[i], task.chain.upper[i]
                value = mirrors[k, SIGNS, i] * rows[j, i] + mirrors[k, SHIFTS, i]
                if mirrors[k, TURNING, i] > 0.0:
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
