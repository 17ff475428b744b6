"""What kernels know of a scene, put together from covers of its parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene
from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.collision.gaps import NUMBERS
from kinseek.kernels.collision.model import BLOCK, LANES, CollisionModel

from .shapes import GRAIN, Points
from .spheres import COUNT, Cover, cover_of_many

if TYPE_CHECKING:
    from .engine import Solid

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Of what bounds are worked out from, relative to the size of the scene, and at least so many [m]."""

NEVER_APART = -1e300
"""A bound on a distance that says nothing."""


class Member(NamedTuple):
    """A part, or several that one joint carries, in the frame of that joint; see `Cover`."""

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
    """(3, k)"""
    ball: Array
    """Around all of it: x, y, z, radius, (4,)."""

    @classmethod
    def of(cls, solid: Solid) -> Self:
        """Put the cover of a part where its joint carries it."""
        # To coal a point of a cloud is a grain: it shall never touch what is said to be free.
        thick = solid.shape.thickness + GRAIN * isinstance(solid.shape, Points)
        return cls.placed(solid.joint, solid.pose, solid.shape.cover, thick)

    @classmethod
    def inside(cls, solid: Solid) -> Self:
        """Put what is known to be in a part where its joint carries it."""
        cover = cover_of_many(solid.shape.inner_corners, solid.shape.thickness)
        return cls.placed(solid.joint, solid.pose, cover, solid.shape.thickness)._replace(solid=True)

    @classmethod
    def placed(cls, joint: int, pose: Array, cover: Cover, thick: float) -> Self:
        """Put a cover somewhere."""
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
        """What holds some parts that one joint carries."""
        thick = max(part.thick for part in parts)
        cover = cover_of_many(np.concatenate([part.corners.T for part in parts]), thick)
        return cls.placed(parts[0].joint, np.eye(4), cover, thick)


class Charts(NamedTuple):
    """Those of some meetings, see the fields of `CollisionModel`."""

    chart_of: NDArray[np.int64]
    chart: Array
    below: NDArray[np.int64]
    chart_axes: NDArray[np.int64]


class Meeting(NamedTuple):
    """Two groups of parts that are looked at together."""

    one: int
    """The part that holds all of the group of the earlier joint."""
    other: int
    """The same of the other group."""
    first: int
    """Of its pairs."""
    last: int
    """One past the last."""


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
    """Put together what kernels know of a scene; see the fields of `CollisionModel`."""
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
        core=np.array([part.core for part in parts]).reshape(-1, 12),
        half=np.array([part.half for part in parts]).reshape(-1, 3),
        thick=np.array([part.thick for part in parts], dtype=np.float64),
        exact=np.array([part.exact for part in parts], dtype=np.bool_),
        within=np.array(within, dtype=np.int64),
        corner_at=corner_at,
        corners=corners,
        ball=balls,
        pair=pairs.reshape(-1, 3),
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
    """Corners of all parts, (3, k) each, one part after the other, repeated until loops are full; and where each begins.

    Raises:
        InvalidScene: So many corners that a kernel could not number them.
    """
    most = max((one.shape[1] for one in columns), default=0)
    if most > 2**NUMBERS - BLOCK:
        raise InvalidScene(
            f"a hull of {most:,} corners is too much, at most {2**NUMBERS - BLOCK:,}; simplify it"
        )
    full = [one[:, np.arange(-(-one.shape[1] // BLOCK) * BLOCK) % max(one.shape[1], 1)] for one in columns]
    at = np.cumsum([0, *(one.shape[1] for one in full)], dtype=np.int64)
    return at, np.concatenate([np.zeros(0), *(one.ravel() for one in full)])
