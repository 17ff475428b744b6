"""The first pass: what is free or touches for sure, by spheres, planes and points that prove it, for many q at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import FAR
from kinseek.kernels.collision.cell import LANES, Cell
from kinseek.kernels.collision.first_pass import bound_pairs, sort_out
from kinseek.kernels.collision.gaps import DOUBT
from kinseek.robots.chain import Frame, SerialChain

from .shapes import GRAIN, Points
from .spheres import COUNT, Cover, cover_of_many, rough_cover

if TYPE_CHECKING:
    from .engine import Solid

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_ROUNDING = 1e-9
"""Of what bounds are worked out from, relative to the size of the scene, and at least so many [m]."""

_STEPS = 16
"""Planes tried between two parts; what no plane parts and no point shows to touch is in doubt."""


class Broad:
    """The first pass over the pairs of a scene.

    Args:
        chain: The arm.
        solids: All parts.
        pairs: Numbers of the two parts of each pair; at most one of them stands in the base.
        pads: How much closer each pair is than its parts, for their padding [m].
    """

    def __init__(
        self, chain: SerialChain, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]], pads: Array
    ) -> None:
        """Put the covers of all parts where their joints carry them."""
        self.count = len(pairs)
        parts = [Member.of(solid) for solid in solids]
        # A cloud is looked at handful by handful: what is free of all of them is free of the cloud.
        pieces = [[i] for i in range(len(parts))]
        for i, solid in enumerate(solids):
            if isinstance(solid.shape, Points) and len(solid.shape.places) > COUNT:
                some = _handfuls(solid)
                pieces[i] = list(range(len(parts), len(parts) + len(some)))
                parts += some
        numbers = [n for n, (i, j) in enumerate(pairs) for _ in range(len(pieces[i]) * len(pieces[j]))]
        pairs = [(a, b) for i, j in pairs for a in pieces[i] for b in pieces[j]]
        pads = np.asarray(pads, dtype=np.float64)[numbers]
        self._firsts = np.searchsorted(numbers, np.arange(self.count))
        single = len(parts)
        meetings, order, groups = _meetings(parts, pairs)
        # A group of several parts is one more part: what is free of all that holds them is free of each.
        number = {group: len(parts) + n for n, group in enumerate(groups)}
        parts += [_together([parts[i] for i in group]) for group in groups]
        number |= {(i,): i for i in range(single)}
        within = [i if part.solid else -1 for i, part in enumerate(parts)]
        for i, solid in enumerate(solids):
            if not parts[i].solid and len(solid.shape.inner_corners):
                within[i] = len(parts)
                parts.append(Member.inside(solid))
                within.append(within[i])
        used = sorted({group for meeting in meetings for group in meeting[:2]})
        place = {group: n for n, group in enumerate(used)}
        balls = np.array([part.ball for part in parts]).reshape(-1, 4)
        corner_at, corners = _table([part.corners for part in parts], 3)
        sizes = [np.abs(chain.fixed[:, :, 3]).sum(), np.abs(balls).max(initial=0.0)]
        self._rounding = _ROUNDING * max(1.0, *sizes)
        pads = pads[order]
        self._cell = Cell(
            chain.arrays_to(Frame(len(chain.leader), np.eye(4))),
            np.array([part.joint for part in parts], dtype=np.int64),
            np.array([part.outer for part in parts]).reshape(-1, 4, COUNT),
            np.array([part.inner for part in parts]).reshape(-1, 4, COUNT),
            np.array([part.core for part in parts]).reshape(-1, 3, 4),
            np.array([part.half for part in parts]).reshape(-1, 3),
            np.array([part.thick for part in parts], dtype=np.float64),
            np.array([part.exact for part in parts], dtype=np.bool_),
            np.array(within, dtype=np.int64),
            corner_at,
            corners,
            balls,
            np.array([[*pairs[n], n] for n in order], dtype=np.int64).reshape(-1, 3),
            pads,
            np.array([number[group] for group in used], dtype=np.int64),
            np.array([[place[g], place[h], *span] for g, h, *span in meetings], dtype=np.int64).reshape(
                -1, 4
            ),
            np.array([pads[first:last].max() for _, _, first, last in meetings], dtype=np.float64),
            self._rounding,
        )

    def sort_out(self, q: Array, clearance: float, touch: float) -> tuple[NDArray[np.int64], Flags]:
        """Sort joint values, (k, n), into free, touching and in doubt.

        Args:
            q: Joint values.
            clearance: What is nearer than this touches [m].
            touch: What is farther apart than the clearance and this is free [m].

        Returns:
            `FREE`, `TOUCH` or `DOUBT` of `kernels.collision.gaps`, (k,), and the pairs in doubt, (k, pairs).
        """
        verdicts, doubts = np.empty(len(q), dtype=np.int64), self._table_of(q, np.bool_)
        least = clearance + touch + self._rounding
        sort_out(self._cell, np.ascontiguousarray(q), clearance, least, _STEPS, LANES, verdicts, doubts)
        far = np.abs(q).max(axis=1) > FAR  # There the quick sine is not good to the last bits.
        if far.any():
            verdicts[far], doubts[far] = DOUBT, True
        if doubts.shape[1] > self.count:
            doubts = np.logical_or.reduceat(doubts, self._firsts, axis=1)
        return verdicts, doubts

    def bounds(self, q: Array, steps: int = 0) -> Array:
        """No pair is closer than this, (k, n) -> (k, pairs) [m]; where it is negative it says nothing.

        With `steps` those that may be the nearest are looked at more closely.
        """
        out = self._table_of(q, np.float64)
        bound_pairs(self._cell, np.ascontiguousarray(q), steps, LANES, out)
        out[np.abs(q).max(axis=1) > FAR] = -np.inf
        return np.minimum.reduceat(out, self._firsts, axis=1) if out.shape[1] > self.count else out

    def _table_of(self, q: Array, kind: type) -> NDArray[Any]:
        return np.zeros((len(q), len(self._cell.pair)), dtype=kind)


def _handfuls(solid: Solid) -> list[Member]:
    """The points of a cloud in neighbourhoods of at most `COUNT`."""
    shape = solid.shape
    assert isinstance(shape, Points)
    left, found = [shape.places], []
    while left:
        points = left.pop()
        if len(points) > COUNT:
            along = points[:, np.argmax(np.ptp(points, axis=0))]
            half = np.argpartition(along, len(points) // 2)
            left += [points[half[: len(points) // 2]], points[half[len(points) // 2 :]]]
            continue
        thick = shape.thickness + GRAIN
        found.append(Member.placed(solid.joint, solid.pose, rough_cover(points, thick), thick))
    return found


class Member(NamedTuple):
    """A part, or several that one joint carries, in the frame of that joint; see `Cover`."""

    joint: int
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
        outer, inner = (np.vstack([turn @ s[:3] + place, s[3:]]) for s in (cover.outer, cover.inner))
        corners = turn @ cover.corners.T + place
        core = (pose @ cover.core)[:3]
        ball = np.array([*(turn @ cover.ball[:3] + place[:, 0]), cover.ball[3] + thick + 1e-12])
        return cls(joint, outer, inner, core, cover.half, thick, cover.exact, cover.solid, corners, ball)


Group = tuple[int, ...]
"""Numbers of the parts that are looked at together."""


def _meetings(
    parts: Sequence[Member], pairs: Sequence[tuple[int, int]]
) -> tuple[list[tuple[Group, Group, int, int]], list[int], list[Group]]:
    """Gather pairs whose parts the same two joints carry; what stands in the base stands alone.

    Returns:
        Two groups, the first of their pairs and one past the last; the pairs in this order; the groups of several parts.
    """
    # What one joint carries is one side of a meeting, and so is each part that stands.
    side_of = [(part.joint, -1 if part.joint else i) for i, part in enumerate(parts)]
    gathered: dict[tuple[tuple[int, int], ...], list[int]] = {}
    for n, pair in enumerate(pairs):
        gathered.setdefault(tuple(sorted(side_of[i] for i in pair)), []).append(n)
    meetings: list[tuple[Group, Group, int, int]] = []
    order: list[int] = []
    for sides, numbers in sorted(gathered.items()):
        members = sorted({i for n in numbers for i in pairs[n]})
        g, h = (tuple(i for i in members if side_of[i] == side) for side in sides)
        meetings.append((g, h, len(order), len(order) + len(numbers)))
        order += numbers
    several = {group for meeting in meetings for group in meeting[:2] if len(group) > 1}
    return meetings, order, sorted(several)


def _together(parts: Sequence[Member]) -> Member:
    """What holds some parts that one joint carries."""
    thick = max(part.thick for part in parts)
    cover = cover_of_many(np.concatenate([part.corners.T for part in parts]), thick)
    return Member.placed(parts[0].joint, np.eye(4), cover, thick)


def _table(columns: Sequence[Array], rows: int) -> tuple[NDArray[np.int64], Array]:
    """Columns of all parts side by side, those of each repeated until loops are full, and where each begins."""
    full = [one[:, np.arange(-(-one.shape[1] // COUNT) * COUNT) % max(one.shape[1], 1)] for one in columns]
    at = np.cumsum([0, *(one.shape[1] for one in full)], dtype=np.int64)
    return at, np.ascontiguousarray(np.concatenate([np.zeros((rows, 0)), *full], axis=1))
