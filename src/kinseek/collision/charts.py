"""Charts of two groups of parts: whether they are free of each other, tabulated over the one or two joints between them.

The pose of an arm's wrist relative to its forearm depends on two joints only, so it is tabulated once. Full turns of both
joints are divided into cells. The bound at the centre of a cell, minus the largest possible motion within the cell, holds in
the whole cell. Such groups are always close to each other; without a chart they would be checked for every q.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import chain_arrays
from kinseek.kernels.collision.first_pass import bound_pairs
from kinseek.kernels.collision.model import LANES, ROWS
from kinseek.kernels.pointers import handle_of

from .cells import NEVER_APART, Charts, Meeting, Member, make_collision_model
from .shapes import Shape
from .spheres import cover_of

if TYPE_CHECKING:
    from .engine import Solid

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_FIRST, _LEVELS = 1024, 6
"""Number of cells with which a chart starts, a power of two, and of levels: undecided cells are divided into four. Not
examined further."""

_MOST = 5_000
"""Number of cells up to which undecided ones are divided. Each takes 2 to 7 µs. With 200,000 cells later checks of meshes of
Panda, UR5 and PR2, and of capsules of Baxter and Atlas, are no faster; with 3,000 those of Panda take 1.5 times as long."""

_STEPS = 24
"""Maximum number of planes tried between two parts. Not examined further."""

_MARGIN = 1e-9
"""Angle that rounding may move into the next cell [rad]."""


class Carried(NamedTuple):
    """A part in the frame of its joint, used as a cache key."""

    shape: Shape
    pose: bytes
    """Pose in the frame of that joint, (4, 4), row by row."""

    @classmethod
    def of(cls, solid: Solid) -> Self:
        """Return the key of a part, which does not depend on the joint's position in an arm."""
        return cls(solid.shape, solid.pose.tobytes())

    def member(self, joint: int) -> Member:
        """Return its cover, carried by the given joint."""
        pose = np.frombuffer(self.pose).reshape(4, 4)
        return Member.placed(joint, pose, cover_of(self.shape), self.shape.thickness)


class Chart(NamedTuple):
    """The chart of two groups."""

    cells: Array
    """See `CollisionModel.chart`, (k,)."""
    below: NDArray[np.int64]
    """See `CollisionModel.below`, (k,)."""
    axes: tuple[int, ...]
    """The two joints, or one twice, and the number of parts into which their turns are divided."""
    apart: float
    """Lower bound on the distance of the groups inside the limits [m]; `NEVER_APART` if it is unknown."""


@lru_cache(maxsize=64)  # A changed scene, or a moved part in it, leaves the arm the same.
def chart_of(
    joints: tuple[int, int],
    links: bytes,
    limits: tuple[tuple[float, float], ...],
    parts: tuple[Carried, ...],
    others: tuple[Carried, ...],
    pairs: tuple[tuple[int, int], ...],
    pads: tuple[float, ...],
) -> Chart:
    """Make the chart of two groups with one or two revolute joints between them.

    Args:
        joints: Joints that carry the two groups, counted from 1.
        links: Transforms from the frame that carries the first group to the first joint, and from there to the second, (1 or
            2, 3, 4).
        limits: Limits of the joints between them [rad]; nothing is computed outside.
        parts: Parts of the first group.
        others: Parts of the second group.
        pairs: Numbers of the two parts of each checked pair.
        pads: Padding of each pair, by which it is closer than its parts [m].
    """
    ways = np.frombuffer(links).reshape(-1, 3, 4)
    turning = len(ways)
    members = [*(part.member(0) for part in parts), *(part.member(turning) for part in others)]
    endless = np.full(turning, np.inf)
    chain = chain_arrays(
        np.concatenate([ways, np.eye(4)[None, :3]]),
        np.zeros(turning, dtype=np.bool_),
        np.arange(turning),
        np.ones(turning),
        np.zeros(turning),
        (-endless, endless),
    )
    numbered = np.array([(i, len(parts) + j, n) for n, (i, j) in enumerate(pairs)], dtype=np.int64)
    cell = make_collision_model(
        chain,
        members,
        [i if member.solid else -1 for i, member in enumerate(members)],
        numbered,
        np.array(pads),
        [Meeting(i, j, n, n + 1) for i, j, n in numbered.tolist()],
        np.full(len(pairs), NEVER_APART),
        np.full(len(pairs), NEVER_APART),
        charts_of([None] * len(pairs)),
    )
    arrays = ROWS.arrays(cell)
    handle, moves = handle_of(arrays), _moves(ways, members[: len(parts)], members[len(parts) :])
    again = (1, 4) if turning == 1 else (2, 2)

    def cell_bounds(where: NDArray[np.int64], counts: tuple[int, int]) -> Array:
        """Return the bounds that hold in whole cells, by row and column."""
        angles = ((where + 0.5) * (2 * np.pi / np.array(counts)))[:, 2 - turning :]
        q = np.ascontiguousarray(angles)
        bounds, depths = np.empty((len(q), len(pairs))), np.empty(len(q))
        bound_pairs(handle, q, _STEPS, LANES, bounds, depths)
        # Half a cell's width of each joint, plus rounding, times the largest lever of that joint.
        moved = sum(move * (np.pi / count + _MARGIN) for move, count in zip(moves, counts, strict=True))
        free, deep = bounds.min(axis=1) - moved, depths - moved
        return np.where(free > 0, free, np.minimum(-deep, 0.0))

    def within_limits(counts: tuple[int, int]) -> Flags:
        """Return which cells overlap the limits."""
        along = [_inside(count, limit) for count, limit in zip(counts[2 - turning :], limits, strict=True)]
        inside_limits = np.zeros(counts, dtype=np.bool_)
        inside_limits[np.ix_(*([0], *along)[-2:])] = True
        return inside_limits

    counts = top = _counts(moves, _FIRST)
    where, spent = np.argwhere(np.ones(counts)), 0
    cells, below, inside = np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    for level in range(_LEVELS):
        overlap, values = within_limits(counts)[tuple(where.T)], np.zeros(len(where))
        values[overlap] = cell_bounds(where[overlap], counts)
        left, spent = overlap & (values == 0), spent + int(overlap.sum())
        places = len(cells) + np.flatnonzero(left)
        cells, inside = np.concatenate([cells, values]), np.concatenate([inside, overlap])
        below = np.concatenate([below, np.zeros(len(where), dtype=np.int64)])
        # Cells of the last level are not divided: kernels would read children that do not exist.
        if level == _LEVELS - 1 or not len(places) or spent + 4 * len(places) > _MOST:
            break
        # Children are appended in groups of four, so one index per cell is enough.
        below[places] = len(cells) + 4 * np.arange(len(places))
        where = (where[left][:, None] * again + np.argwhere(np.ones(again))).reshape(-1, 2)
        counts = (counts[0] * again[0], counts[1] * again[1])
    least = cells[inside & (below == 0)].min(initial=np.inf)
    return Chart(cells, below, (joints[0], joints[1] - 1, *top), float(least) if least > 0 else NEVER_APART)


def charts_of(charts: Sequence[Chart | None]) -> Charts:
    """Convert the charts of some meetings for kernels."""
    some = [chart for chart in charts if chart is not None]
    firsts = np.cumsum([0, *(len(chart.cells) for chart in some)])
    numbers = np.cumsum([chart is not None for chart in charts], dtype=np.int64) - 1
    axes = [(*chart.axes, first) for chart, first in zip(some, firsts, strict=False)]
    return Charts(
        np.where([chart is None for chart in charts], -1, numbers).astype(np.int64),
        np.concatenate([np.zeros(0), *(chart.cells for chart in some)]),
        np.concatenate([np.zeros(0, dtype=np.int64), *(chart.below for chart in some)]),
        np.array(axes, dtype=np.int64).reshape(-1, 5),
    )


def _inside(count: int, limits: tuple[float, float]) -> NDArray[np.int64]:
    """Return which of `count` equal parts of a turn overlap the limits [rad]."""
    low, high = (limit * count / (2 * np.pi) for limit in limits)
    if not high - low < count:
        return np.arange(count)
    return np.unique(np.arange(np.floor(low), np.floor(high) + 1) % count).astype(np.int64)


def _moves(links: Array, parts: Sequence[Member], others: Sequence[Member]) -> tuple[float, float]:
    """Return the largest motion of a point of one group, seen from the other, per radian of each joint [m]."""
    one, thick = _corners(parts)
    two, thicker = _corners(others)
    last = float(np.hypot(two[0], two[1]).max()) + thicker
    reach = float(np.linalg.norm(two, axis=0).max()) + thicker
    off = one - links[0, :, 3:]
    first = float(np.linalg.norm(np.cross(links[0, :, 2], off.T), axis=1).max()) + thick
    if len(links) == 1:
        return 0.0, min(first, last)
    along = float(np.linalg.norm(links[1, :, 3]))
    back = float(np.linalg.norm(off, axis=0).max()) + thick + along
    return min(first, along + reach), min(back, last)


def _counts(moves: tuple[float, float], size: int) -> tuple[int, int]:
    """Return the numbers of parts into which the turns of two joints are divided, so that motion within a cell is small."""
    tried = [2**k for k in range(size.bit_length())]
    return min(
        ((count, size // count) for count in tried),
        key=lambda two: sum(move / count for move, count in zip(moves, two, strict=True)),
    )


def _corners(parts: Sequence[Member]) -> tuple[Array, float]:
    """Return all corners, (3, k), and the largest thickness."""
    return np.concatenate([part.corners for part in parts], axis=1), max(part.thick for part in parts)
