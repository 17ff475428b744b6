"""Proofs that linear motions are free: intervals of a motion are halved until each pair keeps its distance in all of them.

Conservative advancement (*Mirtich 1996*), with intervals instead of steps: two bodies at distance d in the middle of an
interval do not touch in it if no point of one moves by d relative to the other from the middle to an end. All intervals of
equal length come before their halves, so that a contact somewhere on the way is found after few of them.

How far a point x(t) moves within h of t = 0 is bounded by |x'(0)| h + B h² / 2, where B bounds |x''|. For points in a
ball of radius r about c on a link that turns at the velocity w, |x'| is at most |c'| + |w| r. The derivative of a point
by joint j is at most as long as its lever l(j), and so are second derivatives by j and joints before it: B is the sum of
|Δi Δj| l(max(i, j)) over all i and j. For short intervals the bound is about half of the sum of |Δj| l(j), which holds
for the whole motion.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import Vector, column, cross, norm, plus
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined
from kinseek.kernels.layout import Layout

from . import gaps, model
from .first_pass import chart_bound, groups_gap, is_far, keep, lanes_balls
from .gaps import DOUBT, FREE, TOUCH, Query
from .model import LANES, CollisionModel, LaneState, Meeting, Pair

MOST = 256
"""Intervals of equal length of one motion that may be open; with more the motion stays in doubt. Found by trial with
`python -m benchmarks.planning`: with 96 more motions of a way fail, and their replacements take longer."""

HALVINGS = 16
"""The shortest intervals are so many times halved eighths of a motion: bodies move by about 1e-5 m in them."""

FIRST = 4
"""A motion is divided into twice as many intervals at first: as many as lanes."""

STEPS = 16
"""Largest number of steps to look for a plane between two parts, or for a point in both. Not examined further."""

HULLS = 3
"""Verdict on two parts of which the hulls are too near, while the parts may be farther apart."""

MANY = 4
"""Verdict on a motion of which too many intervals are open."""

BLUNT = 5e-3
"""Such pairs are left to exact distances where bodies move by less than this in an interval [m]. Not examined further."""


class Needs(NamedTuple):
    """What the pairs of two groups need in a motion, and the intervals that are open."""

    travel: Annotated[Array, "joints"]
    """How far each joint of the mechanism moves, (joint,)."""
    pair_rate: Annotated[Array, "pairs"]
    """Bound on the motion of each pair in the whole motion, (pair,) [m]."""

    rate: Annotated[Array, "meetings"]
    """The largest of these of each meeting, (meeting,) [m]."""
    bend: Annotated[Array, "meetings"]
    """Bound on the second derivative of the motion of their points, (meeting,) [m]."""
    least: Annotated[Array, "meetings"]
    """The largest distance that one of them keeps, (meeting,) [m]."""
    twists: Annotated[Array, "joints+1", 6, LANES]
    """Velocities of the base and all links at eight moments, in the base: w and m, where x' = w × x + m."""
    middle: Annotated[Array, 2, MOST]
    """Middles of the open intervals of the last length and of the next, as fractions of the motion."""
    counts: Annotated[Indices, 2, MOST]
    """Number of meetings that are open in each."""
    meetings: Annotated[Indices, 2 * MOST, "meetings"]
    """These meetings; first the rows of the last length, then those of the next."""


LAYOUT = Layout(Needs, model.MADE_FOR)
"""Layout in the memory of a call."""

needs_size, lay_needs = LAYOUT.size, LAYOUT.make


class Motion(NamedTuple):
    """A linear motion, and what each pair needs in it."""

    q: Array
    """Joint values at its begin, and how far they move, (2, n) [rad] or [m]."""
    levers: Array
    """Bounds on the derivative of a point of each pair by each joint, 0 for joints not between its parts, (pair, joint)."""
    least: Array
    """The distance that each pair keeps, (pair,) [m]."""


@inlined
def is_inside(scene: CollisionModel, q: Array) -> bool:
    """Return True if a motion, (2, n), is within the limits."""
    outside = 0
    for i in range(q.shape[1]):
        begin, end = q[0, i], q[0, i] + q[1, i]
        outside += (
            1 if min(begin, end) < scene.chain.lower[i] or max(begin, end) > scene.chain.upper[i] else 0
        )
    return outside == 0


class Bounds(NamedTuple):
    """Bounds on the motion of any point of a pair."""

    rate: float
    """In the whole motion [m]."""
    bend: float
    """Of its second derivative [m]."""


@inlined
def motion_of_pair(travel: Array, levers: Array) -> Bounds:
    """Bound the motion of a pair by the motions of the joints and their levers, (joint,)."""
    rate, bend, before = 0.0, 0.0, 0.0
    for j in range(len(travel)):
        moved = travel[j] if levers[j] > 0.0 else 0.0
        rate += moved * levers[j]
        bend += moved * levers[j] * (2.0 * before + moved)
        before += moved
    return Bounds(rate, bend)


@inlined
def begin_motion(scene: CollisionModel, needs: Needs, motion: Motion) -> int:
    """Collect what each meeting needs, open the first intervals, and return the number of these."""
    inside, count, chain = is_inside(scene, motion.q), 0, scene.chain
    for j in range(len(chain.leader)):
        needs.travel[j] = abs(chain.multiplier[j] * motion.q[1, chain.leader[j]])
    for m in range(len(scene.meeting)):
        meeting, rate, bend, least = model.meeting_at(scene, m), 0.0, 0.0, -1e300
        for n in range(meeting.first, meeting.last):
            bounds = motion_of_pair(needs.travel, motion.levers[scene.pair[n, 2]])
            needs.pair_rate[n] = bounds.rate
            rate, bend = max(rate, bounds.rate), max(bend, bounds.bend)
            least = max(least, motion.least[scene.pair[n, 2]])
        needs.rate[m], needs.bend[m], needs.least[m] = rate, bend, least + scene.rounding[0]
        if (inside and scene.apart_inside[m] > needs.least[m]) or scene.apart[m] > needs.least[m]:
            continue  # The groups are always farther apart.
        needs.meetings[0, count] = m
        count += 1
    for i in range(FIRST):
        needs.middle[0, i], needs.counts[0, i] = (2.0 * i + 1.0) / (2.0 * FIRST), count
        for each in range(count):
            needs.meetings[i, each] = needs.meetings[0, each]
    return FIRST if count > 0 else 0


@inlined
def lanes_twists(chain: ChainArrays, state: LaneState, needs: Needs, way: Array, w: int) -> None:
    """Compute the velocities of all links at eight moments of a motion by `way`, (n,)."""
    for k in range(len(chain.leader)):
        rate = chain.multiplier[k] * way[chain.leader[k]]
        turns, slides = (0.0, rate) if chain.prismatic[k] else (rate, 0.0)
        F, before, after = state.frames[k + 1], needs.twists[k], needs.twists[k + 1]
        for l in range(w):
            axis, origin = Vector(F[2, l], F[6, l], F[10, l]), Vector(F[3, l], F[7, l], F[11, l])
            moment = cross(origin, axis)
            after[0, l] = before[0, l] + turns * axis.x
            after[1, l] = before[1, l] + turns * axis.y
            after[2, l] = before[2, l] + turns * axis.z
            after[3, l] = before[3, l] + turns * moment.x + slides * axis.x
            after[4, l] = before[4, l] + turns * moment.y + slides * axis.y
            after[5, l] = before[5, l] + turns * moment.z + slides * axis.z


@inlined
def speed(scene: CollisionModel, state: LaneState, needs: Needs, meeting: Meeting, l: int) -> float:
    """Bound on the velocity of any point of the distal group, relative to the proximal one, in a lane."""
    g, h = scene.group[meeting.one], scene.group[meeting.other]
    A, B, c = (
        needs.twists[scene.joint[g]],
        needs.twists[scene.joint[h]],
        column(state.balls[meeting.other], l),
    )
    w = Vector(B[0, l] - A[0, l], B[1, l] - A[1, l], B[2, l] - A[2, l])
    m = Vector(B[3, l] - A[3, l], B[4, l] - A[4, l], B[5, l] - A[5, l])
    bound: float = norm(plus(cross(w, c), m)) + norm(w) * scene.ball[h, 3]
    return bound


class Groups(NamedTuple):
    """The result of checking two groups as a whole."""

    verdict: int
    """`FREE`, `TOUCH` or `DOUBT`."""
    moved: float
    """Bound on their motion from a moment to an end of an interval [m]."""


@inlined
def check_groups(
    scene: CollisionModel, state: LaneState, place: tuple[int, int], needs: Needs, half: float
) -> Groups:
    """Check that two groups keep their distance within `half` of a moment; see `check_meeting`."""
    m, l = place
    meeting, wide = model.meeting_at(scene, m), needs.least[m] + scene.widest[m]
    gap, moved = groups_gap(scene, state, meeting, l), needs.rate[m] * half
    if gap > wide + moved:
        return Groups(FREE, moved)
    moved = min(moved, (speed(scene, state, needs, meeting, l) + needs.bend[m] * half / 2.0) * half)
    verdict = FREE if gap > wide + moved else DOUBT
    if verdict == DOUBT and scene.chart_of[m] >= 0:
        bound = chart_bound(scene, state, m, l)
        verdict = FREE if bound > needs.least[m] + moved else TOUCH if bound < 0.0 else DOUBT
    if verdict == DOUBT and meeting.last - meeting.first > 1:
        groups = model.groups_of(scene, state, l, meeting)
        some = gaps.near_core(scene, scene.rough[groups.a], groups, wide + moved)
        verdict = FREE if some == 0 else DOUBT
    return Groups(verdict, moved)


@inlined
def check_meeting(
    scene: CollisionModel, state: LaneState, place: tuple[int, int], needs: Needs, motion: Motion, half: float
) -> int:
    """Check that all pairs of two groups keep their distances within `half` of a moment of the motion.

    Args:
        scene: The scene.
        state: Frames at eight moments.
        place: The meeting, and the lane of the moment.
        needs: What the meetings need.
        motion: The motion.
        half: Half of the interval, as a fraction of the motion.

    Returns:
        `FREE`, `TOUCH` if some pair does not at the moment itself, `DOUBT`, or `HULLS` if exact distances may decide.
    """
    m, l = place
    groups = check_groups(scene, state, place, needs, half)
    if groups.verdict != DOUBT:
        return groups.verdict
    meeting, verdict = model.meeting_at(scene, m), FREE
    way = model.groups_of(scene, state, l, meeting).way
    for n in range(meeting.first, meeting.last):
        pair, moved = (
            Pair(scene.pair[n, 0], scene.pair[n, 1], way),
            min(groups.moved, needs.pair_rate[n] * half),
        )
        least = motion.least[scene.pair[n, 2]] + scene.pad[n]
        query = Query(least, least + moved + scene.rounding[0], STEPS)
        if meeting.last - meeting.first > 1 and gaps.ball_gap(scene, pair) > query.free:
            continue
        found = gaps.quick_check(scene, pair, query)
        if found == DOUBT:
            apart = gaps.separation(scene, state, pair, query)
            found = HULLS if apart.verdict == DOUBT and apart.upper < least else apart.verdict
        if found == TOUCH:
            return TOUCH
        if found == HULLS and moved < BLUNT:
            verdict = HULLS
        elif found != FREE and verdict == FREE:
            verdict = DOUBT
    return verdict


@inlined
def middle_of_half(middles: Array, i: int, half: float) -> float:
    """Middle of a half, numbered 2r and 2r + 1, of interval r; `half` is half of its length."""
    middle: float = middles[i // 2] + (half if i % 2 else -half)
    return middle


class Halved(NamedTuple):
    """The result of checking all intervals of one length."""

    verdict: int
    """`TOUCH` if the motion is not free, `MANY` if too many intervals are open, otherwise `FREE`."""
    rows: int
    """Number of intervals that are left to be halved."""
    left: int
    """Number of intervals that were left to exact distances."""


@inlined
def halve(
    scene: CollisionModel,
    state: LaneState,
    needs: Needs,
    motion: Motion,
    level: tuple[int, int, int],
    opened: Array,
) -> Halved:
    """Halve all open intervals and check their halves.

    Args:
        scene: The scene.
        state: Memory for eight moments.
        needs: The open intervals.
        motion: The motion.
        level: How often its eighths are halved, the number of open intervals, and `LANES`.
        opened: Receives begins and ends of the intervals that are left to exact distances, (m, 2).
    """
    depth, rows, w = level
    half, at, to = 0.25 / FIRST / 2.0**depth, depth % 2, 1 - depth % 2
    kept, count = 0, 0
    for first in range(0, 2 * rows, LANES):
        for l in range(LANES):
            moment = middle_of_half(needs.middle[at], min(first + l, 2 * rows - 1), half)
            for j in range(motion.q.shape[1]):
                state.q[j, l] = motion.q[0, j] + moment * motion.q[1, j]
        model.lanes_frames(scene.chain, state, w)
        lanes_balls(scene, state, True, w)
        lanes_twists(scene.chain, state, needs, motion.q[1], w)
        for l in range(min(LANES, 2 * rows - first)):
            row, left, exact = (first + l) // 2, 0, False
            if kept == MOST or count == len(opened):
                return Halved(MANY, 0, 0)
            for each in range(needs.counts[at, row]):
                m = needs.meetings[at * MOST + row, each]
                found = check_meeting(scene, state, (m, l), needs, motion, half)
                if found == TOUCH:
                    return Halved(TOUCH, 0, 0)
                exact = exact or found == HULLS
                if found != FREE:
                    needs.meetings[to * MOST + kept, left] = m
                    left += 1
            moment = middle_of_half(needs.middle[at], first + l, half)
            if exact:
                opened[count, 0], opened[count, 1] = moment - half, moment + half
                count += 1
            elif left > 0:
                needs.middle[to, kept], needs.counts[to, kept] = moment, left
                kept += 1
    return Halved(FREE, kept, count)


@inlined
def check_motion(
    scene: CollisionModel, state: LaneState, needs: Needs, motion: Motion, opened: Array, w: int
) -> tuple[int, int]:
    """Return the verdict on a motion, and the number of intervals in doubt that were written, (m, 2)."""
    if is_far(motion.q[0]) or is_far(motion.q[1]):
        return MANY, 0
    rows, count = begin_motion(scene, needs, motion), 0
    for depth in range(HALVINGS):
        if rows == 0:
            break
        found = halve(scene, state, needs, motion, (depth, rows, w), opened[count:])
        if found.verdict != FREE:
            return found.verdict, 0
        rows, count = found.rows, count + found.left
    if rows > len(opened) - count:
        return MANY, 0
    half, at = 0.25 / FIRST / 2.0 ** (HALVINGS - 1), HALVINGS % 2
    for row in range(rows):
        opened[count + row, 0] = needs.middle[at, row] - half
        opened[count + row, 1] = needs.middle[at, row] + half
    count += rows
    return DOUBT if count > 0 else FREE, count


@entry
def free_motions(
    handle: Annotated[Indices, "*"],
    motions: Annotated[Array, "k", 2, "n"],
    levers: Annotated[Array, "*", "p", "j"],
    least: Annotated[Array, "k", "p"],
    w: int,
    verdicts: Annotated[Indices, "k", OUT],
    numbers: Annotated[Indices, "m", OUT],
    opened: Annotated[Array, "m", 2, OUT],
) -> int:
    """Classify linear motions as certainly free, certainly not free, or in doubt in some intervals.

    Args:
        handle: The scene, see `model.ROWS`.
        motions: Joint values at the begin of each motion, and how far the joints move, (k, 2, n) [rad] or [m].
        levers: Bounds on the derivative of a point of each pair by each joint of the mechanism, 0 for joints that are not
            between its parts, for each motion or (1, pair, joint) for all of them.
        least: The distance that each pair keeps, (k, pair) [m].
        w: `LANES`.
        verdicts: Receives `FREE`, `TOUCH`, `DOUBT`, or `MANY` where too many intervals are in doubt to write them, (k,).
        numbers: Receives the numbers of the motions of the intervals in doubt, (m,).
        opened: Receives the begins and ends of these, as fractions of the motion, (m, 2).

    Returns:
        The number of intervals in doubt.
    """
    scene = model.collision_model_of(handle, 0)
    sizes = model.sizes_of(scene)
    memory, more = np.empty(model.memory_for(scene)), np.empty(needs_size(*sizes))
    state = model.make_lane_state(scene, memory)
    needs: Needs = lay_needs(more.ctypes.data, *sizes)
    lanes_balls(scene, state, False, w)
    needs.twists[0, :, :] = 0.0
    total = 0
    for k in range(len(motions)):
        motion = Motion(motions[k], levers[min(k, len(levers) - 1)], least[k])
        verdict, count = check_motion(scene, state, needs, motion, opened[total:], w)
        numbers[total : total + count] = k
        verdicts[k], total = verdict, total + count
    keep(memory)
    keep(more)
    return total
