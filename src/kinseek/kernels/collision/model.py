"""The data of a scene in kernels, and the positions of its parts at the current joint values."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arrays import Array, ChainArrays, Flags, Indices
from kinseek.kernels.jit import array_view, inlined
from kinseek.kernels.layout import Layout, Rows

LANES, BLOCK = 8, 16
"""Number of joint vectors in parallel, as many as the widest vectors hold doubles; and corners of a part in one iteration
of a loop."""


class CollisionModel(NamedTuple):
    """Parts of bodies, each in the frame of its joint (0: the base), and pairs of them; lengths in [m].

    A group consists of all parts of one joint, or of one fixed part. Pairs of the same two groups are consecutive.
    """

    chain: ChainArrays
    joint: Annotated[Indices, "part"]
    """Joint of each part, (part,)."""
    rough: Annotated[Array, "part", 4, LANES]
    """A few spheres that contain the part together, x, y, z, radius, (part, 4, LANES)."""
    outer: Annotated[Array, "part", 4, "sphere"]
    """More of them, which fit more tightly, (part, 4, sphere)."""
    inner: Annotated[Array, "part", 4, "sphere_inside"]
    """Spheres inside it, in the same format."""
    core: Annotated[Array, "part", 12]
    """Pose of a box that contains the part after thickening, row-major (3, 4), (part, 12)."""
    half: Annotated[Array, "part", 3]
    """Half of its edges, (part, 3)."""
    thick: Annotated[Array, "part"]
    """Thickness that is added to the box, (part,)."""
    exact: Annotated[Flags, "part"]
    """True if the thickened box equals the part, (part,)."""
    within: Annotated[Indices, "part"]
    """The part whose thickened hull of corners lies in this one: itself if it is nothing else; or -1, (part,)."""
    corner_at: Annotated[Indices, "part+1"]
    """Corners of part p are ``corner_at[p] … corner_at[p + 1] - 1``, a multiple of `BLOCK`, (part + 1,)."""
    corners: Annotated[Array, "*"]
    """All x of a part, then all y, then all z, (3 · corner,)."""
    ball: Annotated[Array, "part", 4]
    """Ball around each part, x, y, z, radius, (part, 4)."""
    pair: Annotated[Indices, "pair", 3]
    """The two parts, and the caller's number of the pair, (pair, 3)."""
    pad: Annotated[Array, "pair"]
    """Padding of each pair, which is subtracted from the distance of its parts, (pair,)."""
    group: Annotated[Indices, "group"]
    """The part that contains all of each group, (group,)."""
    meeting: Annotated[Indices, "meeting", 4]
    """Two groups, that of the proximal joint first; the first of their pairs; and one past the last, (meeting, 4)."""
    widest: Annotated[Array, "meeting"]
    """The largest `pad` of a meeting, (meeting,)."""
    apart: Annotated[Array, "meeting"]
    """Lower bound of the distance of the groups of a meeting at any q, (meeting,)."""
    apart_inside: Annotated[Array, "meeting"]
    """The same for q within the limits, in ascending order, (meeting,)."""
    chart_of: Annotated[Indices, "meeting"]
    """Chart of each meeting, or -1, (meeting,)."""
    chart: Annotated[Array, "cell"]
    """Results for two groups wherever two joints are in a cell. Positive: a lower bound of their distance, minus padding.
    Negative: they intersect. 0: nothing is known. The cells of one chart are consecutive, row-major."""
    below: Annotated[Indices, "cell"]
    """First of the four parts of each of these cells, counted from the first cell of the chart; 0 if it is not divided."""
    chart_axes: Annotated[Indices, "chart", 5]
    """The two joints, or one twice; the numbers of parts of their turns; and the first cell, (chart, 5)."""
    rounding: Annotated[Array, 1]
    """Upper bound of the error of every length, (1,)."""


ROWS = Rows(CollisionModel)
"""Declaration of the rows of a scene's handle."""

collision_model_of = ROWS.make


class LaneState(NamedTuple):
    """Positions of the parts at eight q in parallel, and at one of them, computed for a part when first needed.

    Row r of lane l is element ``r · LANES + l`` of a flat array. Poses are row-major (3, 4).
    """

    lanes: Annotated[Array, "dof", LANES]
    """The eight q, (n, LANES)."""
    pose: Annotated[Array, 12 * LANES]
    """Pose of the current joint, 12 rows."""
    turn: Annotated[Array, 3 * LANES]
    """Its sine, cosine and translation, 3 rows."""
    frames: Annotated[Array, "joints+1", 12 * LANES]
    """Frames of the base and of all joints, 12 rows each, (m + 1, 12 · LANES)."""
    balls: Annotated[Array, "groups", 3 * LANES]
    """Centres of the balls of all groups, 3 rows each, (group, 3 · LANES)."""
    gaps: Annotated[Array, LANES]
    """Distance measure of two groups; positive where they are free of each other, (LANES,)."""
    near: Annotated[Indices, LANES, "meetings"]
    """Meetings to examine in each lane, (LANES, meeting)."""
    counts: Annotated[Indices, LANES]
    """Number of these, (LANES,)."""
    hits: Annotated[Indices, LANES]
    """1 where a chart proves that groups intersect, (LANES,)."""
    left: Annotated[Indices, "pairs"]
    """Pairs that spheres and boxes leave undecided, (pair,)."""
    now: Annotated[Indices, 2]
    """The current lane, and the number of q so far, (2,)."""
    frame: Annotated[Array, "joints+1", 12]
    """Frames of the base and all joints at that q, (m + 1, 12)."""
    framed: Annotated[Indices, "joints+1"]
    """Count of q, as in `now`, for which `frame` was computed last, (m + 1,)."""
    into: Annotated[Array, "parts", 12]
    """Transform from the base into the core's frame, (part, 12)."""
    known: Annotated[Indices, "parts"]
    """Count of q for which `into` was computed last, (part,)."""
    middle: Annotated[Array, "parts", 3]
    """Centre of the part's ball, (part, 3)."""
    centred: Annotated[Indices, "parts"]
    """Count of q for which `middle` was computed last, (part,)."""
    spot: Annotated[Array, 12]
    """Intermediate results of a search, (12,)."""
    simplex: Annotated[Array, 4, 3]
    """Corners of the difference of two parts, (4, 3)."""
    share: Annotated[Array, 4]
    """Weight of each corner in a convex combination, (4,)."""


MADE_FOR = ("dof", "joints", "parts", "groups", "meetings", "pairs")

LAYOUT = Layout(LaneState, MADE_FOR)
"""Layout in the memory of a call."""

lane_state_size, lay_lane_state = LAYOUT.size, LAYOUT.make

STANDS, UNKNOWN = -1, -2
"""Values in `LaneState.known` and `LaneState.centred`: a part of the base does not move; or nothing was computed yet."""


@inlined
def memory_for(model: CollisionModel) -> int:
    """Length in numbers of the memory for `make_lane_state`."""
    size: int = lane_state_size(
        len(model.chain.lower),
        len(model.chain.leader),
        len(model.joint),
        len(model.group),
        len(model.meeting),
        len(model.pair),
    )
    return size


@array_view
def make_lane_state(model: CollisionModel, memory: Array) -> LaneState:
    """Create the views in a memory; only the frame of the base is set."""
    state: LaneState = lay_lane_state(
        memory.ctypes.data,
        len(model.chain.lower),
        len(model.chain.leader),
        len(model.joint),
        len(model.group),
        len(model.meeting),
        len(model.pair),
    )
    state.now[1] = 0
    for p in range(len(model.joint)):
        state.known[p] = state.centred[p] = UNKNOWN
    for k in range(len(state.framed)):
        state.framed[k] = UNKNOWN
    for r in range(12):
        state.frame[0, r] = 1.0 if r % 5 == 0 else 0.0
        for l in range(LANES):
            state.frames[0, r * LANES + l] = state.frame[0, r]
    return state


@inlined
def load_lanes(q: Array, first: int, lanes: Array) -> None:
    """Load eight q from row `first` on, (n, LANES); the last one is repeated at the end."""
    for l in range(LANES):
        k = min(first + l, len(q) - 1)
        for i in range(q.shape[1]):
            lanes[i, l] = q[k, i]


@inlined
def lanes_frames(chain: ChainArrays, state: LaneState, w: int) -> None:
    """Compute the frames of all joints at the eight q.

    One array is multiplied in place with constant strides, so that LLVM vectorizes the loops.
    """
    W, T, turn = LANES, state.pose, state.turn
    for r in range(12):
        for l in range(w):
            T[r * W + l] = 1.0 if r % 5 == 0 else 0.0
    for k in range(len(chain.leader)):
        A, q, rate, at = chain.fixed[k], state.lanes[chain.leader[k]], chain.multiplier[k], chain.offset[k]
        slides = 1.0 if chain.prismatic[k] else 0.0
        a0, a1, a2, b0, b1, b2 = A[0, 0], A[0, 1], A[0, 2], A[1, 0], A[1, 1], A[1, 2]
        c0, c1, c2, px, py, pz = A[2, 0], A[2, 1], A[2, 2], A[0, 3], A[1, 3], A[2, 3]
        for l in range(w):
            value = rate * q[l] + at
            turn[l], turn[W + l] = sine_cosine((1.0 - slides) * value)
            turn[2 * W + l] = slides * value
        for r in range(3):
            o = 4 * r * W
            for l in range(w):
                s, c, slide = turn[l], turn[W + l], turn[2 * W + l]
                t0, t1, t2, t3 = T[o + l], T[o + W + l], T[o + 2 * W + l], T[o + 3 * W + l]
                x, y, z = (
                    t0 * a0 + t1 * b0 + t2 * c0,
                    t0 * a1 + t1 * b1 + t2 * c1,
                    t0 * a2 + t1 * b2 + t2 * c2,
                )
                T[o + l], T[o + W + l], T[o + 2 * W + l] = x * c + y * s, y * c - x * s, z
                T[o + 3 * W + l] = t0 * px + t1 * py + t2 * pz + t3 + z * slide
        S = state.frames[k + 1]
        for r in range(12 * w):
            S[r] = T[r]


@inlined
def enter(state: LaneState, lane: int) -> None:
    """Switch to the q of one lane; results for fixed parts stay valid."""
    state.now[0], state.now[1] = lane, state.now[1] + 1


@inlined
def frame_of(state: LaneState, k: int) -> None:
    """Compute ``state.frame[k]`` if it is not up to date."""
    if k == 0 or state.framed[k] == state.now[1]:
        return
    state.framed[k] = state.now[1]
    frames, frame, lane = state.frames[k], state.frame[k], state.now[0]
    for r in range(12):
        frame[r] = frames[r * LANES + lane]


@inlined
def centre(model: CollisionModel, state: LaneState, p: int) -> None:
    """Compute the centre of a part's ball if it is not up to date."""
    k = model.joint[p]
    if state.centred[p] == STANDS or state.centred[p] == state.now[1]:
        return
    state.centred[p] = state.now[1] if k > 0 else STANDS
    frame_of(state, k)
    T, B, middle = state.frame[k], model.ball[p], state.middle[p]
    for r in range(3):
        middle[r] = T[4 * r] * B[0] + T[4 * r + 1] * B[1] + T[4 * r + 2] * B[2] + T[4 * r + 3]


@inlined
def place(model: CollisionModel, state: LaneState, p: int) -> None:
    """Compute the transform into a part's core, and its joint's frame, if they are not up to date."""
    k = model.joint[p]
    if state.known[p] == STANDS or state.known[p] == state.now[1]:
        return
    state.known[p] = state.now[1] if k > 0 else STANDS
    frame_of(state, k)
    # The core's frame in the base is T C; the transform into it is the transpose.
    T, C = state.frame[k], model.core[p]
    px = T[0] * C[3] + T[1] * C[7] + T[2] * C[11] + T[3]
    py = T[4] * C[3] + T[5] * C[7] + T[6] * C[11] + T[7]
    pz = T[8] * C[3] + T[9] * C[7] + T[10] * C[11] + T[11]
    into = state.into[p]
    for c in range(3):
        x = T[0] * C[c] + T[1] * C[4 + c] + T[2] * C[8 + c]
        y = T[4] * C[c] + T[5] * C[4 + c] + T[6] * C[8 + c]
        z = T[8] * C[c] + T[9] * C[4 + c] + T[10] * C[8 + c]
        into[4 * c], into[4 * c + 1], into[4 * c + 2] = x, y, z
        into[4 * c + 3] = -(x * px + y * py + z * pz)
