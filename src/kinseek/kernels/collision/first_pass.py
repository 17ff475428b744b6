"""The first pass over joint values in a scene: balls and boxes around groups for eight q at a time, then parts, q by q."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import FAR
from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .gaps import (
    DOUBT,
    FREE,
    TOUCH,
    ball_gap,
    depth_below,
    gap_below,
    near_core,
    quick_check,
    separating_plane,
    settle,
    way_into,
)
from .model import (
    LANES,
    CollisionModel,
    LaneState,
    collision_model_of,
    enter,
    lanes_frames,
    load_lanes,
    make_lane_state,
    memory_for,
    place,
)


@inlined
def keep(memory: Array) -> None:
    """Use a memory for the last time: views by address do not keep it alive, and Numba frees it after its last use."""
    memory[0] = 0.0


PART_OF_TURN = 0.5 / math.pi


@inlined
def lanes_balls(model: CollisionModel, state: LaneState, moving: bool, w: int) -> None:
    """Compute the centres of the balls of all moving groups, or of all fixed ones, at the eight q."""
    W = LANES
    for g in range(len(model.group)):
        p, B = model.group[g], state.balls[g]
        if (model.joint[p] > 0) != moving:
            continue
        T, x, y, z = state.frames[model.joint[p]], model.ball[p, 0], model.ball[p, 1], model.ball[p, 2]
        for r in range(3):
            o = 4 * r * W
            for l in range(w):
                B[r * W + l] = T[o + l] * x + T[o + W + l] * y + T[o + 2 * W + l] * z + T[o + 3 * W + l]


@inlined
def lanes_inside(model: CollisionModel, state: LaneState, w: int) -> bool:
    """Return True if all of the eight q are within the limits."""
    outside = 0
    for i in range(len(model.chain.lower)):
        q, low, high = state.lanes[i], model.chain.lower[i], model.chain.upper[i]
        for l in range(w):
            outside += 1 if q[l] < low or q[l] > high else 0
    return outside == 0


@inlined
def lanes_near(model: CollisionModel, state: LaneState, least: float, w: int) -> None:
    """Store the meetings to examine for each of the eight q: those whose groups the balls do not prove to be free."""
    inside = lanes_inside(model, state, w)
    W, gaps, counts = LANES, state.gaps, state.counts
    for l in range(W):
        counts[l], state.hits[l] = 0, 0
    for m in range(len(model.meeting)):
        if inside and model.apart_inside[m] > least:
            break
        if model.apart[m] > least:
            continue
        G, H = state.balls[model.meeting[m, 0]], state.balls[model.meeting[m, 1]]
        g, h = model.group[model.meeting[m, 0]], model.group[model.meeting[m, 1]]
        reach = model.ball[g, 3] + model.ball[h, 3] + model.widest[m] + least
        square = reach * reach
        some = 0
        for l in range(w):
            dx, dy, dz = G[l] - H[l], G[W + l] - H[W + l], G[2 * W + l] - H[2 * W + l]
            some += 1 if dx * dx + dy * dy + dz * dz <= square else 0
        if some == 0:
            continue
        for l in range(w):
            dx, dy, dz = G[l] - H[l], G[W + l] - H[W + l], G[2 * W + l] - H[2 * W + l]
            gaps[l] = dx * dx + dy * dy + dz * dz - square
        if model.joint[g] == 0:  # A fixed group: its core is the same for all of them.
            place(model, state, g)
            M, ex, ey, ez = state.into[g], model.half[g, 0], model.half[g, 1], model.half[g, 2]
            reach = model.ball[h, 3] + model.thick[g] + model.widest[m] + least
            square = reach * reach
            m0, m1, m2, m3, m4, m5 = M[0], M[1], M[2], M[3], M[4], M[5]
            m6, m7, m8, m9, m10, m11 = M[6], M[7], M[8], M[9], M[10], M[11]
            for l in range(w):
                x, y, z = H[l], H[W + l], H[2 * W + l]
                dx = max(abs(m0 * x + m1 * y + m2 * z + m3) - ex, 0.0)
                dy = max(abs(m4 * x + m5 * y + m6 * z + m7) - ey, 0.0)
                dz = max(abs(m8 * x + m9 * y + m10 * z + m11) - ez, 0.0)
                gaps[l] = max(gaps[l], dx * dx + dy * dy + dz * dz - square)
        if model.chart_of[m] >= 0:
            look_up(model, state, m, least, w)
        for l in range(W):
            state.near[l, counts[l]] = m
            counts[l] += 1 if gaps[l] <= 0.0 else 0


@inlined
def look_up(model: CollisionModel, state: LaneState, m: int, least: float, w: int) -> None:
    """Mark in `LaneState.gaps` where the chart of a meeting decides, and in `LaneState.hits` where its groups touch."""
    axes, chart, gaps, hits = model.chart_axes[model.chart_of[m]], model.chart, state.gaps, state.hits
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    one, other = state.lanes[model.chain.leader[j]], state.lanes[model.chain.leader[k]]
    for l in range(w):
        u = (model.chain.multiplier[j] * one[l] + model.chain.offset[j]) * PART_OF_TURN
        v = (model.chain.multiplier[k] * other[l] + model.chain.offset[k]) * PART_OF_TURN
        # At least 0: NaN converted to an integer is undefined, and such a q is in doubt later.
        row = max(min(int((u - np.floor(u)) * rows), rows - 1), 0)
        column = max(min(int((v - np.floor(v)) * columns), columns - 1), 0)
        bound = chart[first + row * columns + column]
        gaps[l] = 1.0 if bound > least or bound < 0.0 else gaps[l]
        hits[l] = 1 if bound < 0.0 else hits[l]


@inlined
def look_closer(model: CollisionModel, state: LaneState, m: int) -> float:
    """Return the bound in the chart of a meeting at the current q, from the smallest part of its cell."""
    axes, chart, below, l = model.chart_axes[model.chart_of[m]], model.chart, model.below, state.now[0]
    j, k, rows, columns, first = axes[0], axes[1], axes[2], axes[3], axes[4]
    one, other = state.lanes[model.chain.leader[j], l], state.lanes[model.chain.leader[k], l]
    u = (model.chain.multiplier[j] * one + model.chain.offset[j]) * PART_OF_TURN
    v = (model.chain.multiplier[k] * other + model.chain.offset[k]) * PART_OF_TURN
    u, v = (u - np.floor(u)) * rows, (v - np.floor(v)) * columns
    row, column = min(int(u), rows - 1), min(int(v), columns - 1)
    at = first + row * columns + column
    while below[at] > 0:
        # Position in the cell, as fractions. A cell of one joint is divided into four, a cell of two joints into two by
        # two.
        u, v = u - row, v - column
        if j == k:
            u, v = 0.0, 4.0 * v
            row, column = 0, min(int(v), 3)
            at = first + below[at] + column
        else:
            u, v = 2.0 * u, 2.0 * v
            row, column = min(int(u), 1), min(int(v), 1)
            at = first + below[at] + 2 * row + column
    bound: float = chart[at]
    return bound


@inlined
def quick_check_meeting(
    model: CollisionModel, state: LaneState, m: int, clearance: float, least: float, left: int
) -> int:
    """Append undecided pairs of two groups to `left` others and return the total; -1 if some pair touches."""
    if model.chart_of[m] >= 0:
        bound = look_closer(model, state, m)
        if bound > least:
            return left
        if bound < 0.0:
            return -1
    g, h = model.group[model.meeting[m, 0]], model.group[model.meeting[m, 1]]
    first, last = model.meeting[m, 2], model.meeting[m, 3]
    if last - first > 1:
        # If the group's outer shape is free, each of its parts is free.
        way_into(model, state, h, g)
        if (
            near_core(model.rough[h], state.spot, model.half[g], least + model.widest[m] + model.thick[g])
            == 0
        ):
            return left
    for n in range(first, last):
        a, b, pad = model.pair[n, 0], model.pair[n, 1], model.pad[n]
        if last - first > 1 and ball_gap(model, state, a, b) > least + pad:
            continue
        found = quick_check(model, state, a, b, least + pad, clearance + pad + model.rounding[0])
        if found == TOUCH:
            return -1
        if found == DOUBT:
            state.left[left] = n
            left += 1
    return left


@inlined
def settle_left(
    model: CollisionModel,
    state: LaneState,
    left: int,
    clearance: float,
    least: float,
    steps: int,
    doubts: Flags,
) -> int:
    """Return the verdict on the undecided pairs if all others are free; pairs in doubt are stored if requested."""
    verdict = FREE
    for each in range(left):
        n = state.left[each]
        a, b, pad = model.pair[n, 0], model.pair[n, 1], model.pad[n]
        found = settle(model, state, a, b, least + pad, clearance + pad + model.rounding[0], steps)
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


@inlined
def is_number(q: Array) -> bool:
    """Return True if every joint value is finite."""
    finite = True
    for i in range(len(q)):
        finite = finite and abs(q[i]) < np.inf
    return finite


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
    state = make_lane_state(model, memory)
    nowhere = np.empty(0, dtype=np.bool_)
    in_doubt = 0
    lanes_balls(model, state, False, w)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, state.lanes)
        lanes_frames(model.chain, state, w)
        lanes_balls(model, state, True, w)
        lanes_near(model, state, least, w)
        for l in range(min(LANES, len(q) - first)):
            k, verdict = first + l, FREE
            doubt = doubts[k] if len(doubts) > 0 else nowhere
            enter(state, l)
            if is_far(q[k]):
                verdict = DOUBT
                doubt[:] = True
            elif state.hits[l] == 1:
                verdict = TOUCH
            else:
                # Cheap tests come first: if spheres prove that two parts touch, the other pairs need not be decided.
                left = 0
                for each in range(state.counts[l]):
                    if left >= 0:
                        left = quick_check_meeting(model, state, state.near[l, each], clearance, least, left)
                verdict = (
                    TOUCH if left < 0 else settle_left(model, state, left, clearance, least, steps, doubt)
                )
            verdicts[k] = verdict
            in_doubt += 1 if verdict == DOUBT else 0
    keep(memory)
    return in_doubt


@entry
def bound_pairs(
    handle: Annotated[Indices, "*"],
    q: Annotated[Array, "k", "n"],
    steps: int,
    w: int,
    bounds: Annotated[Array, "k", "*", OUT],
) -> None:
    """Write lower bounds of the distance of every pair, (k, pair) [m]; a negative bound has no meaning.

    Args:
        handle: The scene, see `model.ROWS`.
        q: (k, n) [rad] or [m]
        steps: Largest number of steps to improve the bound if a pair may be the nearest of all; 0 uses spheres only.
        w: `LANES`.
        bounds: Receives the bounds.
    """
    model = collision_model_of(handle, 0)
    memory = np.empty(memory_for(model))
    state = make_lane_state(model, memory)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, state.lanes)
        lanes_frames(model.chain, state, w)
        for l in range(min(LANES, len(q) - first)):
            enter(state, l)
            k, nearest = first + l, 1e300
            if not is_number(q[k]):
                bounds[k, :] = -1.0
                continue
            for m in range(len(model.meeting)):
                g, h = model.group[model.meeting[m, 0]], model.group[model.meeting[m, 1]]
                apart = ball_gap(model, state, g, h)
                for n in range(model.meeting[m, 2], model.meeting[m, 3]):
                    a, b, pad = model.pair[n, 0], model.pair[n, 1], model.pad[n]
                    bound = apart
                    if steps == 0 or apart - pad < nearest:
                        bound = max(bound, gap_below(model, state, a, b))
                        if steps > 0 and bound - pad < nearest:
                            separating_plane(model, state, a, b, 1e300, -1e300, steps)
                            bound = max(bound, state.spot[9])
                            if model.within[a] == a and model.within[b] == b:
                                nearest = min(nearest, state.spot[10] - pad)
                    bounds[k, model.pair[n, 2]] = bound - pad - model.rounding[0]
    keep(memory)


@entry
def bound_depths(
    handle: Annotated[Indices, "*"],
    q: Annotated[Array, "k", "n"],
    bounds: Annotated[Array, "k", "*"],
    w: int,
    depths: Annotated[Array, "k", OUT],
) -> None:
    """Write lower bounds of the motion that separates the parts of the deepest pair at every q, (k,) [m].

    Args:
        handle: The scene, see `model.ROWS`.
        q: (k, n) [rad] or [m]
        bounds: From `bound_pairs`; pairs that they prove to be apart are skipped.
        w: `LANES`.
        depths: Receives the bounds; a negative bound has no meaning.
    """
    model = collision_model_of(handle, 0)
    memory = np.empty(memory_for(model))
    state = make_lane_state(model, memory)
    for first in range(0, len(q), LANES):
        load_lanes(q, first, state.lanes)
        lanes_frames(model.chain, state, w)
        for l in range(min(LANES, len(q) - first)):
            enter(state, l)
            depth = -1e300
            for n in range(len(model.pair)):
                if bounds[first + l, model.pair[n, 2]] <= 0.0:
                    depth = max(depth, depth_below(model, state, model.pair[n, 0], model.pair[n, 1]))
            depths[first + l] = depth - model.rounding[0]
    keep(memory)
