"""The first pass over joint values in a scene: balls and boxes around groups for eight q at a time, then parts, q by q."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import FAR
from kinseek.kernels.arm.vectors import Vector, apply, column, dot, minus, norm, row, transform_at
from kinseek.kernels.arrays import Array, ChainArrays, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from . import gaps, model
from .gaps import DOUBT, FREE, TOUCH, Query, Separation
from .model import LANES, CollisionModel, LaneState, Meeting, Pair

PART_OF_TURN = 0.5 / math.pi


@inlined
def keep(memory: Array) -> None:
    """Use a memory for the last time: views by address do not keep it alive, and Numba frees it after its last use."""
    memory[0] = 0.0


@inlined
def lanes_balls(scene: CollisionModel, state: LaneState, moving: bool, w: int) -> None:
    """Compute the centres of the balls of all moving groups, or of all fixed ones, at the eight q."""
    for g in range(len(scene.group)):
        p = scene.group[g]
        if (scene.joint[p] > 0) != moving:
            continue
        T, balls, centre = state.frames[scene.joint[p]], state.balls[g], row(scene.ball, p)
        for r in range(3):
            for l in range(w):
                along = Vector(T[4 * r, l], T[4 * r + 1, l], T[4 * r + 2, l])
                balls[r, l] = dot(along, centre) + T[4 * r + 3, l]


@inlined
def lanes_inside(scene: CollisionModel, state: LaneState, w: int) -> bool:
    """Return True if all of the eight q are within the limits."""
    outside = 0
    for i in range(len(scene.chain.lower)):
        q, low, high = state.q[i], scene.chain.lower[i], scene.chain.upper[i]
        for l in range(w):
            outside += 1 if q[l] < low or q[l] > high else 0
    return outside == 0


@inlined
def lanes_near(scene: CollisionModel, state: LaneState, least: float, w: int) -> None:
    """Store the meetings to examine for each of the eight q: those whose groups the balls do not prove to be free."""
    inside = lanes_inside(scene, state, w)
    counts = state.counts
    for l in range(LANES):
        counts[l] = 0
    for m in range(len(scene.meeting)):
        # The bounds are in ascending order: all further meetings are free as well.
        if inside and scene.apart_inside[m] > least:
            break
        if scene.apart[m] > least:
            continue
        meeting = model.meeting_at(scene, m)
        G, H = state.balls[meeting.one], state.balls[meeting.other]
        g, h = scene.group[meeting.one], scene.group[meeting.other]
        reach = scene.ball[g, 3] + scene.ball[h, 3] + scene.widest[m] + least
        some = 0
        for l in range(w):
            offset = minus(column(G, l), column(H, l))
            state.gaps[l] = dot(offset, offset) - reach * reach
            some += 1 if state.gaps[l] <= 0.0 else 0
        if some == 0:
            continue
        if scene.joint[g] == 0:  # A fixed group: its core is the same for all of them.
            into, half = transform_at(scene.into_core[g]), row(scene.half, g)
            reach = scene.ball[h, 3] + scene.thick[g] + scene.widest[m] + least
            for l in range(w):
                offset = gaps.from_box(apply(into, column(H, l)), half)
                state.gaps[l] = max(state.gaps[l], dot(offset, offset) - reach * reach)
        for l in range(LANES):
            # Every lane is written, and counted if it is near, which avoids a branch.
            state.near[l, counts[l]] = m
            counts[l] += 1 if state.gaps[l] <= 0.0 else 0


@inlined
def groups_gap(scene: CollisionModel, state: LaneState, meeting: Meeting, l: int) -> float:
    """Distance of the balls around two groups in a lane."""
    offset = minus(column(state.balls[meeting.one], l), column(state.balls[meeting.other], l))
    g, h = scene.group[meeting.one], scene.group[meeting.other]
    gap: float = norm(offset) - scene.ball[g, 3] - scene.ball[h, 3]
    return gap


@inlined
def part_of_turn(chain: ChainArrays, k: int, q: Array, l: int) -> float:
    """Angle of a revolute joint in a lane as a part of a full turn, in [0, 1)."""
    turn = (chain.multiplier[k] * q[chain.leader[k], l] + chain.offset[k]) * PART_OF_TURN
    part: float = turn - np.floor(turn)
    return part


@inlined
def chart_bound(scene: CollisionModel, state: LaneState, m: int, l: int) -> float:
    """Return the bound in the chart of a meeting in a lane, from the smallest part of its cell."""
    axes, chain, below = scene.chart_axes[scene.chart_of[m]], scene.chain, scene.below
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    u, v = part_of_turn(chain, j, state.q, l) * rows, part_of_turn(chain, k, state.q, l) * columns
    # Rounding may make the part of a turn 1, for example that of -1e-17.
    r, c = min(int(u), rows - 1), min(int(v), columns - 1)
    at = first + r * columns + c
    # A cell of one joint is divided into four, a cell of two joints into two by two.
    rows, columns = (1, 4) if j == k else (2, 2)
    while below[at] > 0:
        u, v = (u - r) * rows, (v - c) * columns
        r, c = min(int(u), rows - 1), min(int(v), columns - 1)
        at = first + below[at] + r * columns + c
    bound: float = scene.chart[at]
    return bound


@inlined
def quick_check_meeting(
    scene: CollisionModel, state: LaneState, m: int, l: int, query: Query, left: int
) -> int:
    """Append undecided pairs of two groups to `left` others and return the total; -1 if some pair touches."""
    if scene.chart_of[m] >= 0:
        bound = chart_bound(scene, state, m, l)
        if bound > query.free:
            return left
        if bound < 0.0:
            return -1
    meeting = model.meeting_at(scene, m)
    groups, several = model.groups_of(scene, state, l, meeting), meeting.last - meeting.first > 1
    if several and gaps.near_core(scene, scene.rough[groups.a], groups, query.free + scene.widest[m]) == 0:
        return left  # Each part of the groups is free, too.
    for n in range(meeting.first, meeting.last):
        pair, pair_query = (
            Pair(scene.pair[n, 0], scene.pair[n, 1], groups.way),
            gaps.padded(query, scene.pad[n]),
        )
        if several and gaps.ball_gap(scene, pair) > pair_query.free:
            continue
        found = gaps.quick_check(scene, pair, pair_query)
        if found == TOUCH:
            return -1
        if found == DOUBT:
            state.left[left] = n
            left += 1
    return left


@inlined
def check_lane(scene: CollisionModel, state: LaneState, l: int, query: Query, doubts: Flags) -> int:
    """Return the verdict on the q of a lane; pairs in doubt are stored if requested.

    Cheap tests come first: if spheres prove that two parts touch, the other pairs need not be decided.
    """
    left, verdict = 0, FREE
    for each in range(state.counts[l]):
        left = quick_check_meeting(scene, state, state.near[l, each], l, query, left)
        if left < 0:
            return TOUCH
    for each in range(left):
        n = state.left[each]
        found = gaps.separation(
            scene, state, model.pair_at(scene, state, l, n), gaps.padded(query, scene.pad[n])
        ).verdict
        if found == TOUCH:
            return TOUCH
        if found == DOUBT:
            verdict = DOUBT
            if len(doubts) > 0:
                doubts[scene.pair[n, 2]] = True
    return verdict


@inlined
def is_far(q: Array) -> bool:
    """Return True if a joint value is NaN, or so large that the fast sine loses its last bits."""
    far = False
    for i in range(len(q)):
        far = far or not abs(q[i]) <= FAR
    return far


@entry
def sort_out(
    handle: Annotated[Indices, "*"],
    q: Annotated[Array, "k", "n"],
    clearance: float,
    least: float,
    steps: int,
    w: int,
    verdicts: Annotated[Indices, "k", OUT],
    doubts: Annotated[Flags, "*", "*", OUT],
) -> int:
    """Classify joint values as certainly free, certainly touching, or in doubt.

    Args:
        handle: The scene, see `model.ROWS`.
        q: (k, n) [rad] or [m]
        clearance: Distance, after subtracting padding, below which parts touch [m].
        least: Distance above which parts are free [m].
        steps: Largest number of steps to look for a plane between two parts, or for a point in both.
        w: `LANES`.
        verdicts: Receives `FREE`, `TOUCH` or `DOUBT`, (k,).
        doubts: Receives True for pairs in doubt, False before, (k, pair); or (0, 0) to skip this.

    Returns:
        The number of joint vectors in doubt.
    """
    scene = model.collision_model_of(handle, 0)
    memory = np.empty(model.memory_for(scene))
    state, query = model.make_lane_state(scene, memory), Query(clearance + scene.rounding[0], least, steps)
    nowhere = np.empty(0, dtype=np.bool_)
    in_doubt = 0
    lanes_balls(scene, state, False, w)
    for first in range(0, len(q), LANES):
        model.load_lanes(q, first, state.q)
        model.lanes_frames(scene.chain, state, w)
        lanes_balls(scene, state, True, w)
        lanes_near(scene, state, least, w)
        for l in range(min(LANES, len(q) - first)):
            k = first + l
            doubt = doubts[k] if len(doubts) > 0 else nowhere
            if is_far(q[k]):
                verdicts[k] = DOUBT
                doubt[:] = True
            else:
                verdicts[k] = check_lane(scene, state, l, query, doubt)
            in_doubt += 1 if verdicts[k] == DOUBT else 0
    keep(memory)
    return in_doubt


@entry
def free_samples(
    handle: Annotated[Indices, "*"],
    motions: Annotated[Array, "k", 2, "n"],
    counts: Annotated[Indices, "k"],
    clearance: float,
    least: float,
    steps: int,
    w: int,
    free: Annotated[Indices, "k", OUT],
) -> None:
    """Count the samples of linear motions that are free before the first that is not; the begin is not a sample.

    Args:
        handle: The scene, see `model.ROWS`.
        motions: Joint values at the begin of each motion, and how far the joints move, (k, 2, n) [rad] or [m].
        counts: Number of samples of each motion, (k,).
        clearance: See `sort_out`.
        least: See `sort_out`.
        steps: See `sort_out`.
        w: `LANES`.
        free: Receives the number of free samples, or -1 if a sample in doubt comes before the first contact, (k,).
    """
    scene = model.collision_model_of(handle, 0)
    memory = np.empty(model.memory_for(scene))
    state, query = model.make_lane_state(scene, memory), Query(clearance + scene.rounding[0], least, steps)
    lanes_balls(scene, state, False, w)
    for k in range(len(motions)):
        count, verdict = 0, DOUBT if is_far(motions[k, 0]) or is_far(motions[k, 1]) else FREE
        while verdict == FREE and count < counts[k]:
            for l in range(LANES):
                share = min(count + l + 1, counts[k]) / counts[k]
                for i in range(motions.shape[2]):
                    state.q[i, l] = motions[k, 0, i] + share * motions[k, 1, i]
            model.lanes_frames(scene.chain, state, w)
            lanes_balls(scene, state, True, w)
            lanes_near(scene, state, least, w)
            for l in range(min(LANES, counts[k] - count)):
                verdict = check_lane(scene, state, l, query, np.empty(0, dtype=np.bool_))
                if verdict != FREE:
                    break
                count += 1
        free[k] = -1 if verdict == DOUBT else count
    keep(memory)


@inlined
def bound_pair(
    scene: CollisionModel, state: LaneState, pair: Pair, query: Query, nearest: float
) -> Separation:
    """Return bounds of the distance of two parts, by planes if they may be nearer than `nearest`."""
    lower, upper = gaps.gap_below(scene, pair), 1e300
    if query.steps > 0 and lower < nearest:
        found = gaps.separating_plane(scene, state, pair, query)
        lower = max(lower, found.lower)
        if scene.within[pair.a] == pair.a and scene.within[pair.b] == pair.b:
            upper = found.upper
    return Separation(DOUBT, lower, upper)


@entry
def bound_pairs(
    handle: Annotated[Indices, "*"],
    q: Annotated[Array, "k", "n"],
    steps: int,
    w: int,
    bounds: Annotated[Array, "k", "*", OUT],
    depths: Annotated[Array, "*", OUT],
) -> None:
    """Write lower bounds of the distance of every pair, (k, pair) [m], and of the deepest penetration at every q.

    A negative bound has no meaning.

    Args:
        handle: The scene, see `model.ROWS`.
        q: (k, n) [rad] or [m]; beyond `FAR` all bounds are -1, and depths are left as they are.
        steps: Largest number of steps to improve the bound if a pair may be the nearest of all; 0 uses spheres only.
        w: `LANES`.
        bounds: Receives the bounds.
        depths: Receives lower bounds of the motion that separates the parts of the deepest pair, (k,) [m]; or (0,) to
            skip them.
    """
    scene = model.collision_model_of(handle, 0)
    memory = np.empty(model.memory_for(scene))
    state, query = model.make_lane_state(scene, memory), Query(-1e300, 1e300, steps)
    lanes_balls(scene, state, False, w)
    for first in range(0, len(q), LANES):
        model.load_lanes(q, first, state.q)
        model.lanes_frames(scene.chain, state, w)
        lanes_balls(scene, state, True, w)
        for l in range(min(LANES, len(q) - first)):
            k, nearest, depth = first + l, 1e300, -1e300
            if is_far(q[k]):
                bounds[k, :] = -1.0
                continue
            for m in range(len(scene.meeting)):
                meeting = model.meeting_at(scene, m)
                apart = groups_gap(scene, state, meeting, l)
                for n in range(meeting.first, meeting.last):
                    pad, bound = scene.pad[n], apart
                    if steps == 0 or apart - pad < nearest:
                        found = bound_pair(
                            scene, state, model.pair_at(scene, state, l, n), query, nearest + pad
                        )
                        bound, nearest = max(bound, found.lower), min(nearest, found.upper - pad)
                    bound = bound - pad - scene.rounding[0]
                    bounds[k, scene.pair[n, 2]] = bound
                    if len(depths) > 0 and bound <= 0.0:
                        inside = gaps.depth_below(scene, model.pair_at(scene, state, l, n))
                        depth = max(depth, inside - scene.rounding[0])
            if len(depths) > 0:
                depths[k] = depth
    keep(memory)
