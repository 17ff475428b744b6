"""Siblings of a solution: across a singularity, and mirror images of the arm.

Let v be the direction of joint space along which the pose moves least, u the direction in which it moves, and σ the
singular value of the scaled Jacobian J. Along v the pose moves by ``σ t + ½ t² u·H(v, v)`` to second order, which is zero
again at ``t = -2 σ / u·H(v, v)``: the *twin* of the solution. Two probes measure the curvature,
``u·e(q + h v) + u·e(q - h v) = -h² u·H(v, v)`` for the residual e.

v and u come from inverse iteration, ``u → (J Jᵀ)⁻¹ u`` and ``v = Jᵀ u / |Jᵀ u|`` (Golub & Van Loan 2013, Sec. 7.6).
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import FLOOR, free_turn, iterate
from kinseek.kernels.atlas.lanes import LANES, Lanes, lanes_gram, lanes_jacobian, lanes_solve
from kinseek.kernels.atlas.memory import Scratch, scratch_of
from kinseek.kernels.atlas.task import Task, task_at, task_of
from kinseek.kernels.jit import inlined, kernel

from .distance import squared_gap
from .refine_all import CONTINUA, EQUAL, EVALUATED, SIBLING, WEAKEST, Batch, Search, refine_all

WEAK = 0.02
"""Singular value of the scaled Jacobian at a solution below which there may be others close to it."""

FAR = 2.0
"""Twins farther away than this [rad] are left to the starts, because the second-order model is not valid there."""

SINGULAR = 0.1
"""Length of the part of a step in the null space of J above which the Jacobian counts as singular up to rounding."""

PROBE, FLAT = 0.05, 1e-6
"""Length of the probing step along the weakest direction, and the scaled error along it below which solutions form a
continuum."""

EVALUATIONS = 3
"""FK evaluations for a twin: one at the solution for the weakest direction, and one on each side of it."""

ITERATIONS = 5
"""Number of inverse iterations. Not examined further."""

LEAN = 0.27
"""The inverse iteration begins at ``1, 1 - LEAN, 1 - 2 LEAN …``. No two of these numbers are equal or opposite, and none
is 0, so that the vector is not orthogonal to the weakest direction of the many arms with right angles."""

FULL_FLOOR, SHORT_FLOOR = 1e-13, 1e-9
"""Regularisation of the diagonal of J Jᵀ: small with six joints and more; larger with fewer, because no joint moves some
rows. Not examined further."""

TINY = 1e-300
"""Prevents division by zero for a direction of no length."""

SIGNS, SHIFTS, TURNING = 0, 1, 2
"""Rows of a mirror image ``q → sign · q + shift``: sign and shift of each joint, and 1 for a revolute joint, else 0, (n,)
each."""


@kernel
def refine_siblings(search: Search, mirrors: Array, first: int, count: int, done: bool) -> int:
    """Refine the siblings of all solutions from `first` on, and of those found this way; return the number of solutions.

    Args:
        search: The search.
        mirrors: Mirror images, see `SIGNS`, (k, 3, n).
        first: First solution whose siblings are unknown.
        count: Number of solutions.
        done: Whether the solutions are known to be complete unless one is close to a singularity.
    """
    while first < count < len(search.rows):
        last = min(count, first + LANES)
        many = write_twins(search, first, last)
        if done and last == count and search.tally[WEAKEST] >= WEAK:
            break
        many = write_images(search, mirrors, first, last, many)
        count = refine_all(search, Batch(0, many, many, SIBLING), count)
        first = last
    return count


@kernel
def write_twins(search: Search, first: int, last: int) -> int:
    """Write the estimated twins of solutions first … last-1, at most LANES, into the starts; return their number.

    CONTINUA of the tally increases by the number of solutions on a continuum, whose pose is stationary along the weakest
    direction to second order. WEAKEST becomes the smallest singular value of their scaled Jacobians if it is smaller.
    """
    job, tally, w, many = search.job, search.tally, search.job.width, 0
    task = task_at(job)
    dof = len(task.lower)
    scratch = scratch_of(job, task)
    lanes = scratch.lanes
    weakest, bends, across = np.zeros(LANES), np.zeros(LANES), np.zeros((6, LANES))
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = search.rows[min(first + l, last - 1), i]
    iterate(job, False)
    find_weakest_directions(task, scratch, np.empty((dof, LANES)), weakest, across, w)
    for shift in (PROBE, -2.0 * PROBE):
        move_along(lanes, shift, w)
        iterate(job, False)
        for r in range(6):
            for l in range(w):
                bends[l] += lanes.residual[r, l] * across[r, l]
    move_along(lanes, PROBE, w)
    for l in range(last - first):
        tally[EVALUATED] += EVALUATIONS
        tally[WEAKEST] = min(tally[WEAKEST], weakest[l])
        moved, bend = weakest[l] * PROBE, bends[l]
        if moved < FLAT and abs(bend) < FLAT:
            tally[CONTINUA] += 1.0
        # t = -2 σ / u·H(v, v) with moved = σ PROBE and bend = -PROBE² u·H(v, v). The comparison |t| < FAR needs no
        # division.
        if 2.0 * moved * PROBE < FAR * abs(bend):
            t = 2.0 * moved * PROBE / bend
            for i in range(dof):
                value = lanes.q[i, l] + t * lanes.step[i, l]
                search.starts[many, i] = min(max(value, task.lower[i]), task.upper[i])
            many += 1
    return many


@inlined
def find_weakest_directions(
    task: Task, scratch: Scratch, begin: Array, weakest: Array, across: Array, w: int
) -> None:
    """Find the direction of joint space along which the pose of each lane moves least.

    Inverse iteration, ``u → (J Jᵀ)⁻¹ u``. With fewer than six joints there are rows that no joint moves, and v is iterated,
    ``v → Jᵀ (J Jᵀ)⁻² J v``. Exactly at a singularity Jᵀ u is zero. The part of the first v in the null space of J,
    ``v - Jᵀ (J Jᵀ)⁻¹ J v``, then replaces it.

    Args:
        task: The task.
        scratch: Its memory, with poses and axes; receives v in `lanes.step`.
        begin: Scratch memory, (n, LANES).
        weakest: Receives the singular values, (LANES,).
        across: Receives u, (6, LANES).
        w: LANES.
    """
    lanes, dof = scratch.lanes, len(begin)
    short = dof < 6
    lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
    for l in range(LANES):
        scratch.floor[l] = SHORT_FLOOR if short else FULL_FLOOR
    lanes_gram(0.0, scratch.floor, lanes, w)
    for l in range(LANES):
        scratch.floor[l] = FLOOR
        for i in range(dof):
            begin[i, l] = lanes.step[i, l] = 1.0 - LEAN * i
        for r in range(6):
            lanes.residual[r, l] = 1.0 - LEAN * r
    for k in range(ITERATIONS + 1):
        null_space = k == ITERATIONS
        if null_space:
            multiply(lanes, begin, w)
        elif short and k % 2 == 0:
            multiply(lanes, lanes.step, w)
        lanes_solve(lanes, w)
        if null_space:
            take_null_space(lanes, begin, weakest, w)
        else:
            normalise(lanes, w)
            if k == ITERATIONS - 1 or (short and k % 2 == 1):
                pull_back(lanes, weakest, w)
        if k == ITERATIONS - 1:
            for r in range(6):
                for l in range(w):
                    across[r, l] = lanes.residual[r, l]


@inlined
def multiply(lanes: Lanes, v: Array, w: int) -> None:
    """Write ``J v`` into the residual of every lane."""
    J, e = lanes.jacobian, lanes.residual
    for r in range(6):
        for l in range(w):
            e[r, l] = 0.0
    for i in range(len(v)):
        for r in range(6):
            for l in range(w):
                e[r, l] += J[i, r, l] * v[i, l]


@inlined
def normalise(lanes: Lanes, w: int) -> None:
    """Scale the residual of every lane to length 1."""
    e = lanes.residual
    for l in range(w):
        size = TINY
        for r in range(6):
            size += e[r, l] * e[r, l]
        size = 1.0 / math.sqrt(size)
        for r in range(6):
            e[r, l] *= size


@inlined
def transposed_row(lanes: Lanes, i: int, l: int) -> float:
    """Entry i of ``Jᵀ e`` for the residual e of lane l."""
    total = 0.0
    for r in range(6):
        total += lanes.jacobian[i, r, l] * lanes.residual[r, l]
    return total


@inlined
def pull_back(lanes: Lanes, weakest: Array, w: int) -> None:
    """Write ``v = Jᵀ u / |Jᵀ u|`` into the step of every lane, and ``|Jᵀ u|`` into `weakest`, (LANES,)."""
    step = lanes.step
    for l in range(w):
        size = TINY
        for i in range(len(step)):
            step[i, l] = transposed_row(lanes, i, l)
            size += step[i, l] * step[i, l]
        weakest[l] = math.sqrt(size)
        for i in range(len(step)):
            step[i, l] /= weakest[l]


@inlined
def take_null_space(lanes: Lanes, begin: Array, weakest: Array, w: int) -> None:
    """Replace the step of a lane by ``begin - Jᵀ e``, normalised, if that is longer than `SINGULAR`."""
    for l in range(w):
        size = TINY
        for i in range(len(begin)):
            begin[i, l] -= transposed_row(lanes, i, l)
            size += begin[i, l] * begin[i, l]
        size = math.sqrt(size)
        if size < SINGULAR:
            continue
        weakest[l] = 0.0
        for i in range(len(begin)):
            lanes.step[i, l] = begin[i, l] / size


@inlined
def move_along(lanes: Lanes, far: float, w: int) -> None:
    """Move the joints of every lane along its step, without limits."""
    for i in range(len(lanes.step)):
        for l in range(w):
            lanes.q[i, l] += far * lanes.step[i, l]


@inlined
def write_images(search: Search, mirrors: Array, first: int, last: int, many: int) -> int:
    """Append the unknown mirror images of solutions first … last-1 to the starts; return the number of starts."""
    task = task_of(search.job.handle, search.job.tolerances)
    starts, rates, chain = search.starts, search.metric.rates, task.chain
    for j in range(first, last):
        for k in range(len(mirrors)):
            if many == len(starts):
                return many
            image, fits = starts[many], True
            for i in range(len(image)):
                low, high = chain.lower[i], chain.upper[i]
                value = mirrors[k, SIGNS, i] * search.rows[j, i] + mirrors[k, SHIFTS, i]
                if mirrors[k, TURNING, i] > 0.0:
                    value = nearest_copy(value, low, high, 0.5 * (low + high))
                fits = fits and low - EQUAL <= value <= high + EQUAL
                image[i] = min(max(value, low), high)
            for c in range(last):
                fits = fits and squared_gap(rates, search.rows, c, image) > EQUAL * EQUAL
            many += 1 if fits else 0
    return many
