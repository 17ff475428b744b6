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

from .gaps import (
    DOUBT,
    FREE,
    TOUCH,
    Query,
    Separation,
    ball_gap,
    depth_below,
    from_box,
    full_check,
    gap_below,
    near_core,
    padded,
    quick_check,
    separating_plane,
)
from .model import (
    LANES,
    CollisionModel,
    LaneState,
    Pair,
    collision_model_of,
    groups_of,
    lanes_frames,
    load_lanes,
    make_lane_state,
    meeting_at,
    memory_for,
    pair_at,
)

PART_OF_TURN = 0.5 / math.pi


@inlined
def keep(memory: Array) -> None:
    """Use a memory for the last time: views by address do not keep it alive, and Numba frees it after its last use."""
    memory[0] = 0.0


@inlined
def lanes_balls(model: CollisionModel, state: LaneState, moving: bool, w: int) -> None:
    """Compute the centres of the balls of all moving groups, or of all fixed ones, at the eight q."""
    for g in range(len(model.group)):
        p = model.group[g]
        if (model.joint[p] > 0) != moving:
            continue
        T, balls, centre = state.frames[model.joint[p]], state.balls[g], row(model.ball, p)
        for r in range(3):
            for l in range(w):
                along = Vector(T[4 * r, l], T[4 * r + 1, l], T[4 * r + 2, l])
                balls[r, l] = dot(along, centre) + T[4 * r + 3, l]


@inlined
def lanes_inside(model: CollisionModel, state: LaneState, w: int) -> bool:
    """Return True if all of the eight q are within the limits."""
    outside = 0
    for i in range(len(model.chain.lower)):
        q, low, high = state.q[i], model.chain.lower[i], model.chain.upper[i]
        for l in range(w):
            outside += 1 if q[l] < low or q[l] > high else 0
    return outside == 0


@inlined
def lanes_near(model: CollisionModel, state: LaneState, least: float, w: int) -> None:
    """Store the meetings to examine for each of the eight q: those whose groups the balls do not prove to be free."""
    inside = lanes_inside(model, state, w)
    gaps, counts = state.gaps, state.counts
    for l in range(LANES):
        counts[l] = 0
    for m in range(len(model.meeting)):
        if inside and model.apart_inside[m] > least:
            break
        if model.apart[m] > least:
            continue
        meeting = meeting_at(model, m)
        G, H = state.balls[meeting.one], state.balls[meeting.other]
        g, h = model.group[meeting.one], model.group[meeting.other]
        reach = model.ball[g, 3] + model.ball[h, 3] + model.widest[m] + least
        some = 0
        for l in range(w):
            offset = minus(column(G, l), column(H, l))
            gaps[l] = dot(offset, offset) - reach * reach
            some += 1 if gaps[l] <= 0.0 else 0
        if some == 0:
            continue
        if model.joint[g] == 0:  # A fixed group: its core is the same for all of them.
            into, half = transform_at(model.into_core[g]), row(model.half, g)
            reach = model.ball[h, 3] + model.thick[g] + model.widest[m] + least
            for l in range(w):
                offset = from_box(apply(into, column(H, l)), half)
                gaps[l] = max(gaps[l], dot(offset, offset) - reach * reach)
        for l in range(LANES):
            state.near[l, counts[l]] = m
            counts[l] += 1 if gaps[l] <= 0.0 else 0


@inlined
def part_of_turn(chain: ChainArrays, k: int, q: Array, l: int) -> float:
    """Angle of a revolute joint in a lane as a part of a full turn, in [0, 1)."""
    turn = (chain.multiplier[k] * q[chain.leader[k], l] + chain.offset[k]) * PART_OF_TURN
    part: float = turn - np.floor(turn)
    return part


@inlined
def chart_bound(model: CollisionModel, state: LaneState, m: int, l: int) -> float:
    """Return the bound in the chart of a meeting in a lane, from the smallest part of its cell."""
    axes, chain, below = model.chart_axes[model.chart_of[m]], model.chain, model.below
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    u, v = part_of_turn(chain, j, state.q, l) * rows, part_of_turn(chain, k, state.q, l) * columns
    r, c = min(int(u), rows - 1), min(int(v), columns - 1)
    at = first + r * columns + c
    # A cell of one joint is divided into four, a cell of two joints into two by two.
    rows, columns = (1, 4) if j == k else (2, 2)
    while below[at] > 0:
        u, v = (u - r) * rows, (v - c) * columns
        r, c = min(int(u), rows - 1), min(int(v), columns - 1)
        at = first + below[at] + r * columns + c
    bound: float = model.chart[at]
    return bound


@inlined
def quick_check_meeting(
    model: CollisionModel, state: LaneState, m: int, l: int, query: Query, left: int
) -> int:
    """Append undecided pairs of two groups to `left` others and return the total; -1 if some pair touches."""
    if model.chart_of[m] >= 0:
        bound = chart_bound(model, state, m, l)
        if bound > query.free:
            return left
        if bound < 0.0:
            return -1
    meeting = meeting_at(model, m)
    groups, several = groups_of(model, state, l, meeting), meeting.last - meeting.first > 1
    if several and near_core(model, model.rough[groups.a], groups, query.free + model.widest[m]) == 0:
        return left  # Each part of the groups is free, too.
    for n in range(meeting.first, meeting.last):
        pair, asked = Pair(model.pair[n, 0], model.pair[n, 1], groups.way), padded(query, model.pad[n])
        if several and ball_gap(model, pair) > asked.free:
            continue
        found = quick_check(model, pair, asked)
        if found == TOUCH:
            return -1
        if found == DOUBT:
            state.left[left] = n
            left += 1
    return left


@inlined
def check_lane(model: CollisionModel, state: LaneState, l: int, query: Query, doubts: Flags) -> int:
    """Return the verdict on the q of a lane; pairs in doubt are stored if requested.

    Cheap tests come first: if spheres prove that two parts touch, the other pairs need not be decided.
    """
    left, verdict = 0, FREE
    for each in range(state.counts[l]):
        left = quick_check_meeting(model, state, state.near[l, each], l, query, left)
        if left < 0:
            return TOUCH
    for each in range(left):
        n = state.left[each]
        found = full_check(model, state, pair_at(model, state, l, n), padded(query, model.pad[n]))
        if found == TOUCH:
            return TOUCH
        if found == DOUBT:
            verdict = DOUBT
            if len(doubts) > 0:
                doubts[model.pair[n, 2]] = True
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
    model = collision_model_of(handle, 0)
    memory = np.empty(memory_for(model))
    state, query = make_lane_state(model, memory), Query(clearance + model.rounding[0], least, steps)
    nowhere = np.empty(0, dtype=np.bool_)
    in_doubt = 0
    lanes_balls(model, state, False, w)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, state.q)
        lanes_frames(model.chain, state, w)
        lanes_balls(model, state, True, w)
        lanes_near(model, state, least, w)
        for l in range(min(LANES, len(q) - first)):
            k = first + l
            doubt = doubts[k] if len(doubts) > 0 else nowhere
            if is_far(q[k]):
                verdicts[k] = DOUBT
                doubt[:] = True
            else:
                verdicts[k] = check_lane(model, state, l, query, doubt)
            in_doubt += 1 if verdicts[k] == DOUBT else 0
    keep(memory)
    return in_doubt


@inlined
def bound_pair(
    model: CollisionModel, state: LaneState, pair: Pair, query: Query, nearest: float
) -> Separation:
    """Return bounds of the distance of two parts, by planes if they may be nearer than `nearest`."""
    lower, upper = gap_below(model, pair), 1e300
    if query.steps > 0 and lower < nearest:
        found = separating_plane(model, state, pair, query)
        lower = max(lower, found.lower)
        if model.within[pair.a] == pair.a and model.within[pair.b] == pair.b:
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
    model = collision_model_of(handle, 0)
    memory = np.empty(memory_for(model))
    state, query = make_lane_state(model, memory), Query(-1e300, 1e300, steps)
    lanes_balls(model, state, False, w)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, state.q)
        lanes_frames(model.chain, state, w)
        lanes_balls(model, state, True, w)
        for l in range(min(LANES, len(q) - first)):
            k, nearest, depth = first + l, 1e300, -1e300
            if is_far(q[k]):
                bounds[k, :] = -1.0
                continue
            for m in range(len(model.meeting)):
                meeting = meeting_at(model, m)
                offset = minus(column(state.balls[meeting.one], l), column(state.balls[meeting.other], l))
                g, h = model.group[meeting.one], model.group[meeting.other]
                apart = norm(offset) - model.ball[g, 3] - model.ball[h, 3]
                for n in range(meeting.first, meeting.last):
                    pad, bound = model.pad[n], apart
                    if steps == 0 or apart - pad < nearest:
                        found = bound_pair(model, state, pair_at(model, state, l, n), query, nearest + pad)
                        bound, nearest = max(bound, found.lower), min(nearest, found.upper - pad)
                    bound = bound - pad - model.rounding[0]
                    bounds[k, model.pair[n, 2]] = bound
                    if len(depths) > 0 and bound <= 0.0:
                        inside = depth_below(model, pair_at(model, state, l, n))
                        depth = max(depth, inside - model.rounding[0])
            if len(depths) > 0:
                depths[k] = depth
    keep(memory)
