"""The collision model for kernels, assembled from the covers of a scene's parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene
from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.collision.gaps import NUMBERS
from kinseek.kernels.collision.model import BLOCK, LANES, CollisionModel

from .spheres import COUNT, Cover, cover_of_many

if TYPE_CHECKING:
    from .engine import Solid

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Rounding error of the data that bounds are computed from, relative to the size of the scene, and at least this [m]."""

NEVER_APART = -1e300
"""A lower bound on a distance without meaning."""


class Member(NamedTuple):
    """A part, or several carried by one joint, in the frame of that joint; see `Cover`."""

    joint: int
    rough: Array
    outer: Array
    inner: Array
    core: Array
    half: Array
    thick: float
    exact: bool
    solid: bool
    corners: Array
    """Points of the hull, (3, k) [m]."""
    ball: Array
    """Sphere around all of it: x, y, z, radius, (4,)."""

    @classmethod
    def of(cls, solid: Solid, cover: Cover) -> Self:
        """Return the cover of a part, given in its own frame, in the frame of its joint."""
        return cls.placed(solid.joint, solid.pose, cover, solid.shape.thickness)

    def inside(self, solid: Solid) -> Self:
        """Return the hull inside a part that this covers; its spheres and its box only help to find a plane."""
        corners = solid.pose[:3, :3] @ solid.shape.inner_corners.T + solid.pose[:3, 3:]
        return self._replace(corners=corners, solid=True)

    @classmethod
    def placed(cls, joint: int, pose: Array, cover: Cover, thick: float) -> Self:
        """Return a cover transformed by a pose."""
        turn, place = pose[:3, :3], pose[:3, 3:]
        spheres = (cover.rough, cover.outer, cover.inner)
        rough, outer, inner = (np.vstack([turn @ s[:3] + place, s[3:]]) for s in spheres)
        corners = turn @ cover.corners.T + place
        core = (pose @ cover.core)[:3]
        ball = np.array([*(turn @ cover.ball[:3] + place[:, 0]), cover.ball[3] + thick + 1e-12])
        return cls(
            joint, rough, outer, inner, core, cover.half, thick, cover.exact, cover.solid, corners, ball
        )

    @classmethod
    def together(cls, parts: Sequence[Self]) -> Self:
        """Return a cover of some parts that one joint carries."""
        thick = max(part.thick for part in parts)
        cover = cover_of_many(np.concatenate([part.corners.T for part in parts]), thick)
        return cls.placed(parts[0].joint, np.eye(4), cover, thick)


class Charts(NamedTuple):
    """Charts of some meetings; see the fields of `CollisionModel`."""

    chart_of: NDArray[np.int64]
    chart: Array
    below: NDArray[np.int64]
    chart_axes: NDArray[np.int64]


class Meeting(NamedTuple):
    """Two groups of parts that are checked together."""

    one: int
    """Number of the part that covers the group of the proximal joint."""
    other: int
    """Number of the part that covers the other group."""
    first: int
    """First of its pairs."""
    last: int
    """One past its last pair."""


def make_collision_model(
    chain: ChainArrays,
    parts: Sequence[Member],
    within: Sequence[int],
    pairs: NDArray[np.int64],
    pads: Array,
    meetings: Sequence[Meeting],
    apart: Array,
    apart_inside: Array,
    charts: Charts,
) -> CollisionModel:
    """Assemble the collision model for kernels; see the fields of `CollisionModel`."""
    used = sorted({part for meeting in meetings for part in meeting[:2]})
    balls = np.array([part.ball for part in parts]).reshape(-1, 4)
    corner_at, corners = _flat([part.corners for part in parts])
    size = max(1.0, np.abs(chain.fixed[:, :, 3]).sum(), np.abs(balls).max(initial=0.0))
    place = {part: n for n, part in enumerate(used)}
    spans = [(place[each.one], place[each.other], each.first, each.last) for each in meetings]
    return CollisionModel(
        chain=chain,
        joint=np.array([part.joint for part in parts], dtype=np.int64),
        rough=np.array([part.rough for part in parts]).reshape(-1, 4, LANES),
        outer=np.array([part.outer for part in parts]).reshape(-1, 4, COUNT),
        inner=np.array([part.inner for part in parts]).reshape(-1, 4, COUNT),
        into_core=np.array([_inverse(part.core) for part in parts]).reshape(-1, 3, 4),
        half=np.array([part.half for part in parts]).reshape(-1, 3),
        thick=np.array([part.thick for part in parts], dtype=np.float64),
        exact=np.array([part.exact for part in parts], dtype=np.bool_),
        within=np.array(within, dtype=np.int64),
        corner_at=corner_at,
        corners=corners,
        ball=balls,
        pair=np.reshape([_distal_first(parts, *pair) for pair in pairs.tolist()], (-1, 3)).astype(np.int64),
        pad=pads,
        group=np.array(used, dtype=np.int64),
        meeting=np.array(spans, dtype=np.int64).reshape(-1, 4),
        widest=np.array([pads[each.first : each.last].max() for each in meetings], dtype=np.float64),
        apart=apart,
        apart_inside=apart_inside,
        **charts._asdict(),
        rounding=np.array([_ROUNDING * size]),
    )


def _flat(columns: Sequence[Array]) -> tuple[NDArray[np.int64], Array]:
    """Concatenate the corners of all parts, (3, k) each, padded to full vector lanes, with their start indices.

    Raises:
        InvalidScene: More corners than a kernel can number.
    """
    most = max((one.shape[1] for one in columns), default=0)
    if most > 2**NUMBERS - BLOCK:
        raise InvalidScene(
            f"a hull has {most:,} corners, expected at most {2**NUMBERS - BLOCK:,}; simplify it"
        )
    full = [one[:, np.arange(-(-one.shape[1] // BLOCK) * BLOCK) % max(one.shape[1], 1)] for one in columns]
    at = np.cumsum([0, *(one.shape[1] for one in full)], dtype=np.int64)
    return at, np.concatenate([np.zeros((3, 0)), *full], axis=1)


def _inverse(pose: Array) -> Array:
    """Return the inverse of a pose, (3, 4)."""
    turn = pose[:, :3].T
    return np.column_stack([turn, -turn @ pose[:, 3]])


def _distal_first(parts: Sequence[Member], one: int, other: int, number: int) -> tuple[int, int, int]:
    """Return a pair with the part of the distal joint first."""
    return (one, other, number) if parts[one].joint >= parts[other].joint else (other, one, number)
