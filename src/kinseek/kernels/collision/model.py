"""The data of a scene in kernels, and the frames of its joints at eight joint vectors."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arm.vectors import Matrix, Transform, Vector, dot, relative, transform_at
from kinseek.kernels.arrays import Array, ChainArrays, Flags, Indices
from kinseek.kernels.jit import inlined
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
    into_core: Annotated[Array, "part", 3, 4]
    """Transform into the frame of a box that contains the part after thickening, (part, 3, 4)."""
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
    corners: Annotated[Array, 3, "corner"]
    """x, y and z of all corners, (3, corner)."""
    ball: Annotated[Array, "part", 4]
    """Ball around each part, x, y, z, radius, (part, 4)."""
    pair: Annotated[Indices, "pair", 3]
    """The two parts, that of the distal joint first, and the caller's number of the pair, (pair, 3)."""
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
    """Frames and verdicts at eight q in parallel, and what a search for a plane collects; `l` is the lane."""

    q: Annotated[Array, "dof", LANES]
    """The eight q, (n, LANES)."""
    frames: Annotated[Array, "joints+1", 12, LANES]
    """Frames of the base and of all joints, row-major, (m + 1, 12, LANES)."""
    balls: Annotated[Array, "groups", 3, LANES]
    """Centres of the balls of all groups, (group, 3, LANES)."""
    gaps: Annotated[Array, LANES]
    """Distance measure of two groups; positive where they are free of each other, (LANES,)."""
    near: Annotated[Indices, LANES, "meetings"]
    """Meetings to examine in each lane, (LANES, meeting)."""
    counts: Annotated[Indices, LANES]
    """Number of these, (LANES,)."""
    left: Annotated[Indices, "pairs"]
    """Pairs that spheres and boxes leave undecided, (pair,)."""
    simplex: Annotated[Array, 4, 3]
    """Corners of the difference of two parts, (4, 3)."""
    weight: Annotated[Array, 4]
    """Weight of each corner in a convex combination, (4,)."""


MADE_FOR = ("dof", "joints", "groups", "meetings", "pairs")

LAYOUT = Layout(LaneState, MADE_FOR)
"""Layout in the memory of a call."""

lane_state_size, lay_lane_state = LAYOUT.size, LAYOUT.make


@inlined
def sizes_of(model: CollisionModel) -> tuple[int, int, int, int, int]:
    """The sizes in `MADE_FOR`."""
    chain = model.chain
    return len(chain.lower), len(chain.leader), len(model.group), len(model.meeting), len(model.pair)


@inlined
def memory_for(model: CollisionModel) -> int:
    """Length in numbers of the memory for `make_lane_state`."""
    size: int = lane_state_size(*sizes_of(model))
    return size


@inlined
def make_lane_state(model: CollisionModel, memory: Array) -> LaneState:
    """Create the views in a memory; only the frame of the base is set."""
    state: LaneState = lay_lane_state(memory.ctypes.data, *sizes_of(model))
    for r in range(12):
        for l in range(LANES):
            # Entries 0, 5 and 10 are the diagonal of a matrix (3, 4) that is stored row by row.
            state.frames[0, r, l] = 1.0 if r % 5 == 0 else 0.0
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
    """Compute the frames of all joints at the eight q: each is the one before times a fixed transform and a motion."""
    for k in range(len(chain.leader)):
        A, q = transform_at(chain.fixed[k]), state.q[chain.leader[k]]
        T, S = state.frames[k], state.frames[k + 1]
        rate, offset, slides = chain.multiplier[k], chain.offset[k], 1.0 if chain.prismatic[k] else 0.0
        for l in range(w):
            value = rate * q[l] + offset
            # A prismatic joint gets the angle 0 and a revolute one the slide 0, without a branch in the loop.
            sine, cosine = sine_cosine((1.0 - slides) * value)
            slide = slides * value
            for r in range(0, 12, 4):
                axes = Vector(T[r, l], T[r + 1, l], T[r + 2, l])
                x, y, z = dot(axes, A.R.x), dot(axes, A.R.y), dot(axes, A.R.z)
                S[r, l], S[r + 1, l], S[r + 2, l] = x * cosine + y * sine, y * cosine - x * sine, z
                S[r + 3, l] = dot(axes, A.p) + T[r + 3, l] + z * slide


@inlined
def joint_frame(state: LaneState, k: int, l: int) -> Transform:
    """Frame of joint k in the base (0: of the base) in a lane."""
    F = state.frames[k]
    x, y = Vector(F[0, l], F[4, l], F[8, l]), Vector(F[1, l], F[5, l], F[9, l])
    z = Vector(F[2, l], F[6, l], F[10, l])
    return Transform(Matrix(x, y, z), Vector(F[3, l], F[7, l], F[11, l]))


class Pair(NamedTuple):
    """Two parts, or two groups by the parts that contain them, and how they lie to each other."""

    a: int
    b: int
    way: Transform
    """From the frame of a's joint to that of b's."""


@inlined
def seen(model: CollisionModel, state: LaneState, l: int, a: int, b: int) -> Pair:
    """Two parts in a lane."""
    frame, other = joint_frame(state, model.joint[a], l), joint_frame(state, model.joint[b], l)
    return Pair(a, b, relative(other, frame))


@inlined
def pair_at(model: CollisionModel, state: LaneState, l: int, n: int) -> Pair:
    """Pair n in a lane."""
    return seen(model, state, l, model.pair[n, 0], model.pair[n, 1])


class Meeting(NamedTuple):
    """Two groups, that of the proximal joint first, and the range of their pairs."""

    one: int
    other: int
    first: int
    last: int


@inlined
def meeting_at(model: CollisionModel, m: int) -> Meeting:
    """Meeting m."""
    row = model.meeting[m]
    return Meeting(row[0], row[1], row[2], row[3])


@inlined
def groups_of(model: CollisionModel, state: LaneState, l: int, meeting: Meeting) -> Pair:
    """The groups of a meeting in a lane, that of the distal joint first, as in all its pairs."""
    return seen(model, state, l, model.group[meeting.other], model.group[meeting.one])
