"""Starts of the search for all solutions: samples near a goal, each improved by a tabulated step, without similar ones.

The table has the damped inverse of the Jacobian of each sample, without the joints that are divided out. The first step
of a start is the product of this inverse and the remaining pose error. Starts that are close together after this step
nearly always converge to the same solution, so only the nearest sample of these is refined.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arm.division import NONE, SLIDE, TURN
from kinseek.kernels.arm.trigonometry import rough_angle, sine_cosine
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import free_turn, reset_weights
from kinseek.kernels.atlas.lanes import LANES, lanes_forward, lanes_gram, lanes_jacobian, lanes_solve
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_size
from kinseek.kernels.atlas.seeds import MARGIN
from kinseek.kernels.atlas.task import Handle, Task, plain_tolerances, task_of
from kinseek.kernels.atlas.tree import LEAF_SIZE
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

DAMPED = 0.03
"""Damping of the steps in the table, tried on three arms and not examined further. Less damping overshoots, because the
samples are far from the goal."""


FARTHEST = 1.2
"""Largest tabulated step of a joint [rad or m]."""


BUCKETS = 64
"""Number of buckets for sorting samples by distance; the order within a bucket is irrelevant."""


HALVINGS = 40
"""Largest number of tries for a radius; three are usually enough."""


APART = 0.8
"""A start closer than this to an earlier one [rad or m], after the first step, leads to the same solution."""


MOST_JOINTS = 6
"""A goal fixes at most six degrees of freedom of the hand: an arm with more joints is redundant, and its solutions are
sampled."""


FIRST, FINAL, BEYOND = 12, 13, 14
"""Rows after the twelve of a pose, see `complete_eight`."""


NOWHERE = 1e9
"""Squared distance of an empty entry."""


@entry
def fill_steps(handle: Handle, steps: Annotated[Array, "s", 6, LANES, OUT], w: int) -> None:
    """Fill the table of an arm that has at most `LANES` joints.

    Args:
        handle: The task with the samples, see `task_of`.
        steps: Receives for each sample the joint motion for six components of the remaining pose error: the position and
            the rotation of the last axis in the frame of the first, in units of the arm's length and in radians, (s, 6,
            LANES).
        w: LANES.
    """
    task = task_of(handle, plain_tolerances(handle))
    dof, atlas = len(task.lower), task.atlas
    memory = np.zeros(scratch_size(dof, len(task.chain.leader)))
    scratch = make_scratch(memory, dof, len(task.chain.leader))
    lanes, first = scratch.lanes, 0 if task.division.head == NONE else 1
    away, row = np.empty(3), np.empty(6)
    reset_weights(task, scratch)
    for l in range(LANES):
        scratch.floor[l] = DAMPED
    T, J, e = lanes.pose, lanes.jacobian, lanes.residual
    for group in range(len(steps) // LANES):
        for l in range(LANES):
            for j in range(atlas.middle.shape[1]):
                lanes.q[first + j, l] = atlas.middle[group * LANES + l, j]
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
        for l in range(LANES):
            for r in range(3):
                away[r] = 0.0
                for c in range(3):
                    away[r] += T[r, c, l] * atlas.inverse_tip[c, 3] / task.length
            for i in range(dof):
                for r in range(6):
                    row[r] = J[i, r, l]
                # From the tip to the point on the last axis.
                row[0] += row[4] * away[2] - row[5] * away[1]
                row[1] += row[5] * away[0] - row[3] * away[2]
                row[2] += row[3] * away[1] - row[4] * away[0]
                # From the base to the frame of the first axis.
                for r in range(3):
                    J[i, r, l], J[i, 3 + r, l] = 0.0, 0.0
                    for c in range(3):
                        J[i, r, l] += atlas.inverse_head[r, c] * row[c]
                        J[i, 3 + r, l] += atlas.inverse_head[r, c] * row[3 + c]
        lanes_gram(0.0, scratch.floor, lanes, w)
        for part in range(6):
            for r in range(6):
                for l in range(LANES):
                    e[r, l] = 1.0 if r == part else 0.0
            lanes_solve(lanes, w)
            for l in range(LANES):
                for i in range(LANES):
                    value = 0.0
                    if i < dof:
                        for r in range(6):
                            value += J[i, r, l] * e[r, l]
                    steps[group * LANES + l, part, i] = value
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.


@inlined
def measure_samples(points: Array, point: Array, distance: Array) -> None:
    """Compute the squared distances of all samples from a point.

    Args:
        points: See `Tree.points`, (leaves, dimensions, LEAF_SIZE).
        point: (dimensions,)
        distance: Receives the squared distances, (samples,).
    """
    for leaf in range(points.shape[0]):
        o = leaf * LEAF_SIZE
        for j in range(LEAF_SIZE):
            distance[o + j] = 0.0
        for d in range(points.shape[1]):
            x = point[d]
            for j in range(LEAF_SIZE):
                gap = points[leaf, d, j] - x
                distance[o + j] += gap * gap


@inlined
def radius(distance: Array, most: int) -> float:
    """Squared radius that contains `most` samples to within a tenth; infinite if there are not more samples."""
    count, total = len(distance), 0.0
    if count <= most:
        return np.inf
    for i in range(count):
        total += distance[i]
    low, high, square = 0.0, np.inf, 0.4 * total / count
    for _ in range(HALVINGS):
        closer = 0
        for i in range(count):
            closer += 1 if distance[i] < square else 0
        if abs(closer - most) <= most // 10:
            break
        low, high = (square, high) if closer < most else (low, square)
        # In four dimensions the number of samples grows with the square of the squared radius.
        square *= math.sqrt(most / max(closer, 1))
        if not low < square < high:
            square = 0.5 * (low + high)
    return square


@inlined
def sort_samples(distance: Array, low: float, high: float, most: int, apart: Indices, order: Indices) -> int:
    """Write the samples between two distances, nearest first; return their number, at most `most`.

    Args:
        distance: Squared distances of all samples, (samples,).
        low: Smallest squared distance.
        high: Squared distance, exclusive.
        most: Largest number of samples.
        apart: Scratch memory, (samples + 1,).
        order: Receives the samples, followed by scratch memory, (samples + BUCKETS + 1,) in total.
    """
    count, found, nearest, farthest = len(distance), 0, np.inf, 0.0
    for i in range(count):
        apart[found] = i
        found += 1 if low <= distance[i] < high else 0
    for k in range(found):
        nearest, farthest = min(nearest, distance[apart[k]]), max(farthest, distance[apart[k]])
    # A counting sort.
    share = (BUCKETS - 1) / max(farthest - nearest, 1e-300)
    for b in range(BUCKETS + 1):
        order[count + b] = 0
    for k in range(found):
        order[count + 1 + int((distance[apart[k]] - nearest) * share)] += 1
    for b in range(BUCKETS):
        order[count + 1 + b] += order[count + b]
    for k in range(found):
        b = count + int((distance[apart[k]] - nearest) * share)
        order[order[b]] = apart[k]
        order[b] += 1
    return min(found, most)


@inlined
def complete_eight(task: Task, K: Array, G: Array, order: Indices, begin: int, end: int, w: int) -> None:
    """Complete samples begin … begin + 7 of an order as `samples.complete_seed` does, one in each lane.

    The last sample is repeated at the end. Input and output share one array and there are no branches, so that LLVM
    vectorizes the loop.

    Args:
        task: The task.
        K: (at least 15, LANES). Receives the remaining pose error, six rows; in `FIRST` and `FINAL` the
            first and the last joint, within their limits; and in `BEYOND` how far outside they were [rad or m].
        G: The goal in the coordinates of the atlas, (3, 4).
        order: See `sort_samples`.
        begin: First of the samples.
        end: One past the last.
        w: LANES.
    """
    columns, atlas, division = task.columns, task.atlas, task.division
    last, offset = len(task.lower) - 1, 0 if task.division.head == NONE else 1
    for l in range(LANES):
        sample = order[min(begin + l, end - 1)]
        for r in range(3):
            for c in range(4):
                K[4 * r + c, l] = atlas.poses[sample, r, c]
        # Joints that are not divided out are among the middle ones.
        K[FIRST, l] = atlas.middle[sample, 0] if offset == 0 else 0.0
        K[FINAL, l] = atlas.middle[sample, last - offset] if last - offset < atlas.middle.shape[1] else 0.0
    turning, slides = 1.0 if division.head == TURN else 0.0, 1.0 if division.head == SLIDE else 0.0
    twisting, square = 1.0 if division.tail == TURN else 0.0, division.length * division.length
    stays, ends = 1.0 if division.head == NONE else 0.0, 1.0 - twisting
    w0 = square if twisting == 0.0 and division.columns > 0 else 0.0
    w1 = square if twisting == 0.0 and division.columns > 1 else 0.0
    w2 = square if twisting > 0.0 and division.columns > 0 else 0.0
    g00, g01, g02, g03 = G[0, 0], G[0, 1], G[0, 2], G[0, 3]
    g10, g11, g12, g13 = G[1, 0], G[1, 1], G[1, 2], G[1, 3]
    g20, g21, g22, g23 = G[2, 0], G[2, 1], G[2, 2], G[2, 3]
    low, high = task.chain.lower[0], task.chain.upper[0]
    low_last, high_last = task.chain.lower[last], task.chain.upper[last]
    mid, mid_last, turn, scale = (
        0.5 * (low + high),
        0.5 * (low_last + high_last),
        2.0 * math.pi,
        1.0 / task.length,
    )
    per_turn, c0, c1, c2 = 0.5 / math.pi, columns[0], columns[1], columns[2]
    for l in range(w):
        k00, k01, k02, k03 = K[0, l], K[1, l], K[2, l], K[3, l]
        k10, k11, k12, k13 = K[4, l], K[5, l], K[6, l], K[7, l]
        k20, k21, k22, k23 = K[8, l], K[9, l], K[10, l], K[11, l]
        dot = k03 * g03 + k13 * g13 + w0 * (k00 * g00 + k10 * g10)
        dot += w1 * (k01 * g01 + k11 * g11) + w2 * (k02 * g02 + k12 * g12)
        cross = k03 * g13 - k13 * g03 + w0 * (k00 * g10 - k10 * g00)
        cross += w1 * (k01 * g11 - k11 * g01) + w2 * (k02 * g12 - k12 * g02)
        first = rough_angle(cross, dot)
        first += turn * np.floor((mid - first) * per_turn + 0.5)
        first = turning * first + slides * (g23 - k23) + stays * K[FIRST, l]
        beyond = max(low - first, first - high)
        first = min(max(first, low), high)
        sine, cosine = sine_cosine(turning * first)
        # The goal without the rotation of the first joint.
        a00, a10 = cosine * g00 + sine * g10, cosine * g10 - sine * g00
        a01, a11 = cosine * g01 + sine * g11, cosine * g11 - sine * g01
        a02, a12 = cosine * g02 + sine * g12, cosine * g12 - sine * g02
        x, y = cosine * g03 + sine * g13 - k03, cosine * g13 - sine * g03 - k13
        z = g23 - k23 - slides * first
        # The rotation about the last axis that is closest to the remaining one.
        along = k00 * a00 + k10 * a10 + k20 * g20 + k01 * a01 + k11 * a11 + k21 * g21
        across = k01 * a00 + k11 * a10 + k21 * g20 - k00 * a01 - k10 * a11 - k20 * g21
        final = rough_angle(across, along)
        final += turn * np.floor((mid_last - final) * per_turn + 0.5)
        final = twisting * final + ends * K[FINAL, l]
        beyond = max(beyond, low_last - final, final - high_last)
        final = min(max(final, low_last), high_last)
        sine, cosine = sine_cosine(twisting * final)
        b00, b10, b20 = cosine * a00 - sine * a01, cosine * a10 - sine * a11, cosine * g20 - sine * g21
        b01, b11, b21 = cosine * a01 + sine * a00, cosine * a11 + sine * a10, cosine * g21 + sine * g20
        rx = c0 * (k10 * b20 - k20 * b10) + c1 * (k11 * b21 - k21 * b11) + c2 * (k12 * g22 - k22 * a12)
        ry = c0 * (k20 * b00 - k00 * b20) + c1 * (k21 * b01 - k01 * b21) + c2 * (k22 * a02 - k02 * g22)
        rz = c0 * (k00 * b10 - k10 * b00) + c1 * (k01 * b11 - k11 * b01) + c2 * (k02 * a12 - k12 * a02)
        K[0, l], K[1, l], K[2, l] = scale * x, scale * y, scale * z
        K[3, l], K[4, l], K[5, l] = rx, ry, rz
        K[FIRST, l], K[FINAL, l], K[BEYOND, l] = first, final, beyond


@inlined
def answer(row: Array, K: Array, l: int, i: int) -> float:
    """Motion of joint i for the remaining pose error in a lane, from the table of a sample, (6, LANES)."""
    value: float = row[0, i] * K[0, l] + row[1, i] * K[1, l] + row[2, i] * K[2, l]
    value += row[3, i] * K[3, l] + row[4, i] * K[4, l] + row[5, i] * K[5, l]
    return value


@inlined
def step_ahead(task: Task, K: Array, l: int, sample: int, steps: Array, move: Array, q: Array) -> None:
    """Write the start in a lane of `complete_eight`, after the tabulated step, into q, (n,); `move` is scratch memory."""
    row, last = steps[sample], len(q) - 1
    a, b, c = answer(row, K, l, 0), answer(row, K, l, 1), answer(row, K, l, 2)
    d, e, f = answer(row, K, l, 3), answer(row, K, l, 4), answer(row, K, l, 5)
    far = FARTHEST / max(FARTHEST, abs(a), abs(b), abs(c), abs(d), abs(e), abs(f))
    move[0], move[1], move[2], move[3], move[4], move[5] = a, b, c, d, e, f
    middle, first = task.atlas.middle, 0 if task.division.head == NONE else 1
    for j in range(middle.shape[1]):
        q[first + j] = middle[sample, j]
    q[0], q[last] = K[FIRST, l], K[FINAL, l]
    for i in range(len(q)):
        q[i] = min(max(q[i] + move[i] * far, task.lower[i]), task.upper[i])


@inlined
def is_alike(known: Array, kept: int, rates: Array, q: Array) -> bool:
    """Return True if a start, (n,), is closer than `APART` to one of those kept, modulo full turns.

    One loop over the kept starts handles all joints, because the overhead of short loops dominates.

    Args:
        known: The kept starts, joint by joint; the last row is 0, or `NOWHERE` for empty entries, (MOST_JOINTS + 1,
            capacity).
        kept: Number of kept starts.
        rates: See `refine_all.joint_gap`, (n,).
        q: Joint values.
    """
    dof, turn = len(q), 2.0 * math.pi
    # With fewer joints the last counts more than once.
    b, c, d = min(1, dof - 1), min(2, dof - 1), min(3, dof - 1)
    e, f = min(4, dof - 1), min(5, dof - 1)
    qa, qb, qc, qd, qe, qf = q[0], q[b], q[c], q[d], q[e], q[f]
    ra, rb, rc, rd, re, rf = rates[0], rates[b], rates[c], rates[d], rates[e], rates[f]
    close, square = 0, APART * APART
    for j in range((kept + LANES - 1) // LANES * LANES):
        ga, gb, gc = known[0, j] - qa, known[b, j] - qb, known[c, j] - qc
        gd, ge, gf = known[d, j] - qd, known[e, j] - qe, known[f, j] - qf
        ga -= turn * np.floor(ga * ra + 0.5)
        gb -= turn * np.floor(gb * rb + 0.5)
        gc -= turn * np.floor(gc * rc + 0.5)
        gd -= turn * np.floor(gd * rd + 0.5)
        ge -= turn * np.floor(ge * re + 0.5)
        gf -= turn * np.floor(gf * rf + 0.5)
        gap = known[MOST_JOINTS, j] + ga * ga + gb * gb + gc * gc + gd * gd + ge * ge + gf * gf
        close += 1 if gap < square else 0
    return close > 0


@inlined
def spread_starts(
    task: Task,
    scratch: Scratch,
    steps: Array,
    order: Indices,
    found: int,
    rates: Array,
    thin: bool,
    known: Array,
    kept: int,
    seeds: Array,
    w: int,
) -> int:
    """Make starts from the samples of an order, each after the tabulated step, without similar ones; return their number.

    Args:
        task: The task.
        scratch: Its memory, with the goal in `seen`.
        steps: See `fill_steps`.
        order: See `sort_samples`.
        found: Number of samples in it.
        rates: See `refine_all.joint_gap`, (n,).
        thin: True to skip similar starts; False near a singularity, where solutions are close together.
        known: Starts kept so far, see `is_alike`; receives the new ones.
        kept: Number of starts kept so far.
        seeds: Receives the new starts, (at least found, n).
        w: LANES.
    """
    many, q, K = 0, scratch.seed, scratch.lanes.gram
    for begin in range(0, found, LANES):
        complete_eight(task, K, scratch.seen, order, begin, found, w)
        for lane in range(min(LANES, found - begin)):
            if K[BEYOND, lane] > MARGIN:
                continue
            step_ahead(task, K, lane, order[begin + lane], steps, scratch.bound, q)
            if thin and is_alike(known, kept + many, rates, q):
                continue
            at = kept + many
            if at % LANES == 0:
                for i in range(MOST_JOINTS + 1):
                    for l in range(LANES):
                        known[i, at + l] = NOWHERE if i == MOST_JOINTS else 0.0
            for i in range(len(q)):
                seeds[many, i] = q[i]
                known[i, at] = q[i]
            known[MOST_JOINTS, at] = 0.0
            many += 1
    return many
