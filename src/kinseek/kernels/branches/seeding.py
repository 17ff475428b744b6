"""Starts of the search for all solutions: samples near a goal, each improved by a tabulated step, without similar ones.

A sample has values of the middle joints and the pose K of the last axis seen from the first. For a goal G the first joint
is the angle about its axis, and the last joint the rotation about its own, that make K closest to G. The rest of the pose
error is reduced by a tabulated step: the table has the damped inverse of the Jacobian of each sample, ``Jᵀ (J Jᵀ + λ I)⁻¹``
(Levenberg 1944), without the joints that are divided out. Starts that are close together after this step nearly always
converge to the same solution, so only the nearest sample of these is refined.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.division import NONE, SLIDE, TURN
from kinseek.kernels.arm.trigonometry import rough_angle, sine_cosine
from kinseek.kernels.arm.vectors import Twist, Vector, column, cross, dot, minus, plus, rotated, scaled
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import free_turn, reset_weights
from kinseek.kernels.atlas.lanes import (
    LANES,
    lanes_forward,
    lanes_gram,
    lanes_jacobian,
    lanes_solve,
    pose_column,
    set_twist,
    twist_at,
)
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_of, scratch_size
from kinseek.kernels.atlas.samples import coordinates
from kinseek.kernels.atlas.seeds import MARGIN, see
from kinseek.kernels.atlas.task import Handle, Task, plain_tolerances, task_at, task_of
from kinseek.kernels.atlas.tree import LEAF_SIZE
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, kernel

from .distance import six_gaps, six_in_column, six_of, squares
from .refine_all import Search

STARTS, DEEP_STARTS = 128, 512
"""Number of samples for every goal, and for a goal that may have more solutions."""

FIRST_ROOM = STARTS + STARTS // 10
"""Largest number of samples in the first round, see `radius`."""

ROOM = (FIRST_ROOM + DEEP_STARTS + LANES - 1) // LANES * LANES
"""Largest number of starts that are compared for likeness, a multiple of LANES."""

DAMPED = 0.03
"""Damping of the steps in the table, tried on three arms and not examined further. Less damping overshoots, because the
samples are far from the goal."""

FARTHEST = 1.2
"""Largest tabulated step of a joint [rad or m]. Not examined further."""

BUCKETS = 64
"""Number of buckets for sorting samples by distance; the order within a bucket is irrelevant."""

HALVINGS = 40
"""Largest number of tries for a radius; three are usually enough."""

APART = 0.8
"""A start closer than this to an earlier one [rad or m], after the first step, leads to the same solution. Not examined
further."""

POSE, FIRST, LAST = 0, 12, 13
"""Rows of eight samples, one in each lane, that `complete_eight` reads: the pose K, row-major (3, 4); and the values of
the first and the last joint, used if they are not divided out."""

ERROR, COMPLETED_FIRST, COMPLETED_LAST, BEYOND = 14, 20, 21, 22
"""Rows that it writes: the remaining pose error, position in units of the arm's length and then rotation; the first and
the last joint, within their limits; and how far outside they were [rad or m]."""

EIGHT_ROWS = BEYOND + 1
"""Number of these rows."""


class Sorting(NamedTuple):
    """Memory for sorting samples by their distance from the goal."""

    distance: Array
    """Squared distances of all samples, (samples,)."""
    inside: Indices
    """Samples between two distances, unsorted, (samples + 1,)."""
    order: Indices
    """The same, nearest first, (samples,)."""
    bucket: Indices
    """First place in the order of each bucket, (BUCKETS + 1,)."""


class Eight(NamedTuple):
    """Eight samples, one in each lane, and memory for one."""

    rows: Array
    """See `POSE` and `ERROR`, (EIGHT_ROWS, LANES)."""
    chosen: Indices
    """Which samples, (LANES,)."""
    move: Array
    """The tabulated step of one of them, (LANES,)."""


class EndJoint(NamedTuple):
    """The first or the last joint, when it is completed from the rest of a pose."""

    turns: float
    """1 if it is divided out and revolute, else 0."""
    slides: float
    """1 if it is divided out and prismatic, else 0."""
    stays: float
    """1 if it is not divided out, so that the sample has its value, else 0."""
    low: float
    """[rad] or [m]"""
    high: float


class Round(NamedTuple):
    """Which samples become starts."""

    more: bool
    """True for those after the `STARTS` nearest ones, up to `DEEP_STARTS`; False for the nearest ones."""
    kept: int
    """Number of starts made so far."""
    thin: bool
    """True to skip similar starts; False near a singularity, where solutions are close together."""


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
    reset_weights(task, scratch)
    for l in range(LANES):
        scratch.floor[l] = DAMPED
    J, e = lanes.jacobian, lanes.residual
    for group in range(len(steps) // LANES):
        for l in range(LANES):
            for j in range(atlas.middle.shape[1]):
                lanes.q[first + j, l] = atlas.middle[group * LANES + l, j]
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
        see_from_first(task, scratch)
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
def see_from_first(task: Task, scratch: Scratch) -> None:
    """Change the Jacobians of all lanes to the motion of a point on the last axis, in the frame of the first axis."""
    T, J, atlas = scratch.lanes.pose, scratch.lanes.jacobian, task.atlas
    for l in range(LANES):
        # From the tip to the point on the last axis.
        lever = Vector(0.0, 0.0, 0.0)
        for c in range(3):
            part = scaled(atlas.inverse_tip[c, 3], pose_column(T, c, l))
            lever = plus(lever, Vector(part.x / task.length, part.y / task.length, part.z / task.length))
        for i in range(len(J)):
            motion = twist_at(J[i], l)
            linear = plus(motion.linear, cross(motion.angular, lever))
            seen = Twist(rotated(atlas.inverse_head, linear), rotated(atlas.inverse_head, motion.angular))
            set_twist(J[i], l, seen)


@kernel
def write_sampled_starts(search: Search, steps: Array, known: Array, samples: Round) -> int:
    """Make starts from the samples nearest to the target, each after the tabulated step; return their number.

    Args:
        search: The search; receives the starts.
        steps: See `fill_steps`.
        known: The starts made so far, joint by joint, see `is_alike`; receives the new ones, (MOST_JOINTS, ROOM).
        samples: Which samples.
    """
    job, starts, rates, count = search.job, search.starts, search.metric.rates, len(steps)
    task = task_at(job)
    scratch = scratch_of(job, task)
    eight = Eight(np.empty((EIGHT_ROWS, LANES)), np.empty(LANES, dtype=np.int64), np.empty(LANES))
    sorting = Sorting(
        np.empty(count),
        np.empty(count + 1, dtype=np.int64),
        np.empty(count, dtype=np.int64),
        np.empty(BUCKETS + 1, dtype=np.int64),
    )
    see(task, scratch, search.target)
    coordinates(scratch.seen, task.division, scratch.point)
    measure_samples(task.atlas.tree.points, scratch.point, sorting.distance)
    inner, outer, most = 0.0, radius(sorting.distance, STARTS), FIRST_ROOM
    if samples.more:
        inner, outer, most = outer, radius(sorting.distance, DEEP_STARTS), DEEP_STARTS
    found, many = sort_samples(sorting, inner, outer, most), 0
    for begin in range(0, found, LANES):
        for l in range(LANES):
            # Lanes without a sample of their own repeat the last one, so that they compute with valid numbers.
            eight.chosen[l] = sorting.order[min(begin + l, found - 1)]
        complete_eight(task, scratch.seen, eight.chosen, eight.rows, job.width)
        for l in range(min(LANES, found - begin)):
            if eight.rows[BEYOND, l] > MARGIN:
                continue
            q, at = starts[many], samples.kept + many
            step_ahead(task, eight, l, steps[eight.chosen[l]], q)
            if samples.thin and is_alike(known, at, rates, q):
                continue
            keep_start(known, at, q)
            many += 1
    return many


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
def sort_samples(sorting: Sorting, low: float, high: float, most: int) -> int:
    """Sort the samples at squared distances in [low, high) by a counting sort; return their number, at most `most`."""
    distance, inside, bucket, found = sorting.distance, sorting.inside, sorting.bucket, 0
    for i in range(len(distance)):
        # Every index is written, and counted if it is inside: a branch would be unpredictable.
        inside[found] = i
        found += 1 if low <= distance[i] < high else 0
    nearest, farthest = np.inf, 0.0
    for k in range(found):
        nearest, farthest = min(nearest, distance[inside[k]]), max(farthest, distance[inside[k]])
    share = (BUCKETS - 1) / max(farthest - nearest, 1e-300)
    for b in range(BUCKETS + 1):
        bucket[b] = 0
    for k in range(found):
        bucket[1 + int((distance[inside[k]] - nearest) * share)] += 1
    for b in range(BUCKETS):
        bucket[1 + b] += bucket[b]
    for k in range(found):
        b = int((distance[inside[k]] - nearest) * share)
        sorting.order[bucket[b]] = inside[k]
        bucket[b] += 1
    return min(found, most)


@inlined
def complete_eight(task: Task, goal: Array, chosen: Indices, eight: Array, w: int) -> None:
    """Complete eight samples as `samples.complete_seed` does, one in each lane.

    All rows are in one array and there are no branches, so that LLVM vectorizes the loop.

    Args:
        task: The task.
        goal: The goal in the coordinates of the atlas, (3, 4).
        chosen: The samples, (LANES,).
        eight: See `POSE` and `ERROR`, (EIGHT_ROWS, LANES).
        w: LANES.
    """
    atlas, division = task.atlas, task.division
    head, tail = first_joint(task), last_joint(task)
    for l in range(LANES):
        sample = chosen[l]
        for r in range(3):
            for c in range(4):
                eight[POSE + 4 * r + c, l] = atlas.poses[sample, r, c]
        # Joints that are not divided out are among the middle ones.
        eight[FIRST, l] = atlas.middle[sample, 0] if head.stays > 0.0 else 0.0
        eight[LAST, l] = atlas.middle[sample, atlas.middle.shape[1] - 1] if tail.stays > 0.0 else 0.0
    square = division.length * division.length
    weight_x = square if tail.stays > 0.0 and division.columns > 0 else 0.0
    weight_y = square if tail.stays > 0.0 and division.columns > 1 else 0.0
    weight_z = square if tail.turns > 0.0 and division.columns > 0 else 0.0
    goal_x, goal_y, goal_z, goal_p = column(goal, 0), column(goal, 1), column(goal, 2), column(goal, 3)
    share_x, share_y, share_z = task.columns[0], task.columns[1], task.columns[2]
    scale = 1.0 / task.length
    for l in range(w):
        x, y = sample_column(eight, 0, l), sample_column(eight, 1, l)
        z, p = sample_column(eight, 2, l), sample_column(eight, 3, l)
        along = flat_dot(p, goal_p) + weight_x * flat_dot(x, goal_x)
        along += weight_y * flat_dot(y, goal_y) + weight_z * flat_dot(z, goal_z)
        across = flat_cross(p, goal_p) + weight_x * flat_cross(x, goal_x)
        across += weight_y * flat_cross(y, goal_y) + weight_z * flat_cross(z, goal_z)
        first = head.turns * copy_near_middle(rough_angle(across, along), head)
        first += head.slides * (goal_p.z - p.z) + head.stays * eight[FIRST, l]
        beyond = max(head.low - first, first - head.high)
        first = min(max(first, head.low), head.high)
        sine, cosine = sine_cosine(head.turns * first)
        # The goal without the motion of the first joint.
        seen_x, seen_y = rotate_back(cosine, sine, goal_x), rotate_back(cosine, sine, goal_y)
        seen_z, seen_p = rotate_back(cosine, sine, goal_z), rotate_back(cosine, sine, goal_p)
        position = minus(seen_p, p)
        # The rotation about the last axis that is closest to the remaining one.
        along = dot(x, seen_x) + y.x * seen_y.x + y.y * seen_y.y + y.z * seen_y.z
        across = dot(y, seen_x) - x.x * seen_y.x - x.y * seen_y.y - x.z * seen_y.z
        last = tail.turns * copy_near_middle(rough_angle(across, along), tail) + tail.stays * eight[LAST, l]
        beyond = max(beyond, tail.low - last, last - tail.high)
        last = min(max(last, tail.low), tail.high)
        sine, cosine = sine_cosine(tail.turns * last)
        end_x = minus(scaled(cosine, seen_x), scaled(sine, seen_y))
        end_y = plus(scaled(cosine, seen_y), scaled(sine, seen_x))
        turn = plus(scaled(share_x, cross(x, end_x)), scaled(share_y, cross(y, end_y)))
        turn = plus(turn, scaled(share_z, cross(z, seen_z)))
        eight[ERROR, l], eight[ERROR + 1, l] = scale * position.x, scale * position.y
        eight[ERROR + 2, l] = scale * (position.z - head.slides * first)
        eight[ERROR + 3, l], eight[ERROR + 4, l], eight[ERROR + 5, l] = turn.x, turn.y, turn.z
        eight[COMPLETED_FIRST, l], eight[COMPLETED_LAST, l], eight[BEYOND, l] = first, last, beyond


@inlined
def first_joint(task: Task) -> EndJoint:
    """The first joint of the arm."""
    turns, slides = 1.0 if task.division.head == TURN else 0.0, 1.0 if task.division.head == SLIDE else 0.0
    stays = 1.0 if task.division.head == NONE else 0.0
    return EndJoint(turns, slides, stays, task.chain.lower[0], task.chain.upper[0])


@inlined
def last_joint(task: Task) -> EndJoint:
    """The last joint of the arm; it is never divided out if it is prismatic."""
    turns, last = 1.0 if task.division.tail == TURN else 0.0, len(task.lower) - 1
    return EndJoint(turns, 0.0, 1.0 - turns, task.chain.lower[last], task.chain.upper[last])


@inlined
def sample_column(eight: Array, c: int, l: int) -> Vector:
    """Column c of the pose of the sample in lane l."""
    return Vector(eight[POSE + c, l], eight[POSE + 4 + c, l], eight[POSE + 8 + c, l])


@inlined
def flat_dot(a: Vector, b: Vector) -> float:
    """Dot product of the components normal to the first axis."""
    return a.x * b.x + a.y * b.y


@inlined
def flat_cross(a: Vector, b: Vector) -> float:
    """Component of the cross product along the first axis."""
    return a.x * b.y - a.y * b.x


@inlined
def rotate_back(cosine: float, sine: float, v: Vector) -> Vector:
    """Rotate v about the first axis by the negative of an angle."""
    return Vector(cosine * v.x + sine * v.y, cosine * v.y - sine * v.x, v.z)


@inlined
def copy_near_middle(angle: float, joint: EndJoint) -> float:
    """Add full turns to move an angle as close as possible to the middle of a joint's range."""
    middle = 0.5 * (joint.low + joint.high)
    copy: float = angle + 2.0 * math.pi * np.floor((middle - angle) * (0.5 / math.pi) + 0.5)
    return copy


@inlined
def step_ahead(task: Task, eight: Eight, l: int, steps: Array, q: Array) -> None:
    """Write the completed sample in lane l, after the step of its table, (6, LANES), into q, (n,); see `fill_steps`."""
    rows, move, sample, middle = eight.rows, eight.move, eight.chosen[l], task.atlas.middle
    first, longest = 0 if task.division.head == NONE else 1, FARTHEST
    e0, e1, e2 = rows[ERROR, l], rows[ERROR + 1, l], rows[ERROR + 2, l]
    e3, e4, e5 = rows[ERROR + 3, l], rows[ERROR + 4, l], rows[ERROR + 5, l]
    for i in range(LANES):
        step = steps[0, i] * e0 + steps[1, i] * e1 + steps[2, i] * e2
        step += steps[3, i] * e3 + steps[4, i] * e4 + steps[5, i] * e5
        move[i] = step
        longest = max(longest, abs(step))
    for j in range(middle.shape[1]):
        q[first + j] = middle[sample, j]
    q[0], q[len(q) - 1] = rows[COMPLETED_FIRST, l], rows[COMPLETED_LAST, l]
    for i in range(len(q)):
        q[i] = min(max(q[i] + move[i] * (FARTHEST / longest), task.lower[i]), task.upper[i])


@inlined
def is_alike(known: Array, kept: int, rates: Array, q: Array) -> bool:
    """Return True if a start, (n,), is closer than `APART` to one of the first `kept` known ones, modulo full turns.

    Args:
        known: See `keep_start`.
        kept: Number of known starts.
        rates: See `distance.joint_gap`, (n,).
        q: Joint values.
    """
    mine, six_rates, close = six_of(q), six_of(rates), 0
    for j in range((kept + LANES - 1) // LANES * LANES):
        gap = squares(six_gaps(six_in_column(known, len(q), j), mine, six_rates))
        close += 1 if gap < APART * APART else 0
    return close > 0


@inlined
def keep_start(known: Array, at: int, q: Array) -> None:
    """Add a start, (n,), to the known ones, stored joint by joint, (MOST_JOINTS, a multiple of LANES).

    The entries up to the next multiple of LANES, which `is_alike` reads too, become copies of it.
    """
    for i in range(len(q)):
        for j in range(at, (at + LANES) // LANES * LANES):
            known[i, j] = q[i]
