"""What kernels know of a scene, and where everything is at the joint values that are looked at."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arrays import CHAIN, Array, ChainArrays, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64, Bundle
from kinseek.kernels.jit import hidden, view

LANES = 8
"""Joint values side by side, and corners and spheres of one shape: as many doubles as the widest vectors hold."""


class Cell(NamedTuple):
    """Parts of bodies, each in the frame of the joint that carries it (0: the base), and pairs of them; lengths in [m].

    Pairs of the same two groups, all that one joint carries or one part that stands, follow one another.
    """

    chain: ChainArrays
    joint: Indices
    """That carries each part, (part,)."""
    outer: Array
    """Spheres that hold the part together, x, y, z, radius, (part, 4, sphere)."""
    inner: Array
    """Spheres inside it, likewise."""
    core: Array
    """Pose of a box that holds the part when made thicker, (part, 3, 4)."""
    half: Array
    """Half of its edges, (part, 3)."""
    thick: Array
    """How much thicker, (part,)."""
    exact: Flags
    """Is that the very part? (part,)"""
    within: Indices
    """The part whose thicker hull of corners lies in this one: itself, where it is nothing else; or -1, (part,)."""
    corner_at: Indices
    """Corners of part p are ``corner_at[p] … corner_at[p + 1] - 1``, (part + 1,)."""
    corners: Array
    """(3, corner)"""
    ball: Array
    """Around each part, x, y, z, radius, (part, 4)."""
    pair: Indices
    """The two parts, and the number the caller knows the pair by, (pair, 3)."""
    pad: Array
    """How much closer a pair is than its parts, (pair,)."""
    group: Indices
    """The part that holds all of each group, (group,)."""
    meeting: Indices
    """Two groups, the first of their pairs, and one past the last, (meeting, 4)."""
    widest: Array
    """The greatest `pad` of a meeting, (meeting,)."""
    rounding: float
    """Every length is known at least that well."""


CELL = Bundle(
    Cell,
    chain=CHAIN,
    joint=I64["part"],
    outer=F64["part", 4, "sphere"],
    inner=F64["part", 4, "sphere"],
    core=F64["part", 3, 4],
    half=F64["part", 3],
    thick=F64["part"],
    exact=FLAG["part"],
    within=I64["part"],
    corner_at=I64["part+1"],
    corners=F64[3, "corner"],
    ball=F64["part", 4],
    pair=I64["pair", 3],
    pad=F64["pair"],
    group=I64["group"],
    meeting=I64["meeting", 4],
    widest=F64["meeting"],
    rounding=F64,
)


class Here(NamedTuple):
    """Where the parts are at one q, in the base; worked out for a part when it is first asked for."""

    frames: Array
    """Of the base and of all joints, (m + 1, 12), row-major (3, 4)."""
    into: Array
    """From the base into the core's frame, (part, 12)."""
    middle: Array
    """Of the part's ball, (part, 3)."""
    known: Indices
    """1 where a part's place is known, (part,)."""
    along: Array
    """Heights of the corners of one part, as many as the most that one has."""
    spot: Array
    """Numbers that a search hands on, (12,)."""
    simplex: Array
    """Corners of the difference of two parts, (4, 3)."""
    share: Array
    """Of each corner in a mixture of them, (4,)."""


@view
def make_here(cell: Cell) -> Here:
    """Memory for one q."""
    parts, most = len(cell.joint), 0
    for p in range(parts):
        most = max(most, cell.corner_at[p + 1] - cell.corner_at[p])
    return Here(
        np.empty((len(cell.chain.leader) + 1, 12)),
        np.empty((parts, 12)),
        np.empty((parts, 3)),
        np.zeros(parts, dtype=np.int64),
        np.empty(most),
        np.empty(12),
        np.empty((4, 3)),
        np.empty(4),
    )


@hidden
def lanes_frames(chain: ChainArrays, q: Array, frames: Array, w: int) -> None:
    """Frames of the base and of all joints at eight q, (n, LANES), into `frames`, (m + 1, 12 · LANES), row after row."""
    W = LANES
    for r in range(12):
        for l in range(w):
            frames[0, r * W + l] = 1.0 if r % 5 == 0 else 0.0
    for k in range(len(chain.leader)):
        A, i, rate, at = chain.fixed[k], chain.leader[k], chain.multiplier[k], chain.offset[k]
        slides = 1.0 if chain.prismatic[k] else 0.0
        T, S = frames[k], frames[k + 1]
        for l in range(w):
            value = rate * q[i, l] + at
            s, c = sine_cosine((1.0 - slides) * value)
            slide = slides * value
            for r in range(3):
                o = 4 * r * W + l
                t0, t1, t2, t3 = T[o], T[o + W], T[o + 2 * W], T[o + 3 * W]
                x = t0 * A[0, 0] + t1 * A[1, 0] + t2 * A[2, 0]
                y = t0 * A[0, 1] + t1 * A[1, 1] + t2 * A[2, 1]
                z = t0 * A[0, 2] + t1 * A[1, 2] + t2 * A[2, 2]
                p = t0 * A[0, 3] + t1 * A[1, 3] + t2 * A[2, 3] + t3
                S[o], S[o + W] = x * c + y * s, y * c - x * s
                S[o + 2 * W], S[o + 3 * W] = z, p + z * slide


@hidden
def enter(cell: Cell, here: Here, frames: Array, lane: int) -> None:
    """Go to the q of one lane; what stands stays known."""
    for k in range(frames.shape[0]):
        for r in range(12):
            here.frames[k, r] = frames[k, r * LANES + lane]
    for p in range(len(cell.joint)):
        if cell.joint[p] > 0:
            here.known[p] = 0


@hidden
def place(cell: Cell, here: Here, p: int) -> None:
    """Work out where a part is, if that is not known."""
    if here.known[p] == 1:
        return
    here.known[p] = 1
    T, C, B, middle = here.frames[cell.joint[p]], cell.core[p], cell.ball[p], here.middle[p]
    for r in range(3):
        middle[r] = T[4 * r] * B[0] + T[4 * r + 1] * B[1] + T[4 * r + 2] * B[2] + T[4 * r + 3]
    # The core's frame in the base is T C; into it leads the transpose.
    px = T[0] * C[0, 3] + T[1] * C[1, 3] + T[2] * C[2, 3] + T[3]
    py = T[4] * C[0, 3] + T[5] * C[1, 3] + T[6] * C[2, 3] + T[7]
    pz = T[8] * C[0, 3] + T[9] * C[1, 3] + T[10] * C[2, 3] + T[11]
    for c in range(3):
        x = T[0] * C[0, c] + T[1] * C[1, c] + T[2] * C[2, c]
        y = T[4] * C[0, c] + T[5] * C[1, c] + T[6] * C[2, c]
        z = T[8] * C[0, c] + T[9] * C[1, c] + T[10] * C[2, c]
        into = here.into[p]
        into[4 * c], into[4 * c + 1], into[4 * c + 2] = x, y, z
        into[4 * c + 3] = -(x * px + y * py + z * pz)
