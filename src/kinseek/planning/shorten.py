"""Shorten a way that is proved free, and round its corners; every motion that replaces others is proved free too.

Shortcuts between two places on the way are the method of *Geraerts & Overmars 2007, section 3.1*; the places come from a
fixed sequence instead of random numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.support.deadline import Deadline

from .along import Along
from .space import STEP, Space

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

TOGETHER = 24
"""Shortcuts that are checked together."""

LEAST = 5e-3
"""Shortening ends after a round that shortens the way by less than this fraction. Found by trial with
`python -m benchmarks.planning`: with 0.2 % in three rounds ways are 1 % shorter, and take twice the time."""

NEARER = 1e-9
"""A shortcut has to be shorter by this fraction."""

ROUNDED = 5
"""How often the radius of a corner is halved until its motions are proved free."""

CORNER = 8
"""Motions that replace a corner."""

DENSE = 0.05
"""Bound on the motion of any point of the arm between neighbouring rows of a path [m]."""

MARGIN = 2e-3
"""Distance from obstacles beyond the clearance that is kept where the way has it [m]. `Path.timed` moves along a spline
through the rows; where it comes too near to obstacles, the arm has to stop. Found by trial with
`python -m benchmarks.planning`."""

BESIDE = 0.25
"""Greatest distance of a row from the middle of the motion into which it is inserted, relative to the motion."""

_GOLDEN = np.array([0.7548776662466927, 0.5698402909980532])
"""The steps of the sequence of *Roberts 2018* in two dimensions."""


def shortened(space: Space, way: Array, deadline: Deadline) -> Array:
    """Shorten a way, (N, n), that is proved free, until nothing gets shorter or the time is up.

    At first all that is new keeps the margin, so parts of the way that are too near to obstacles stay. They are shortened
    afterwards.
    """
    way = _shortened(space, way, deadline, True)
    if space.along is None and len(way) > 2 and not space.proved(way[:-1], way[1:], MARGIN).all():
        way = _shortened(space, way, deadline, False)
    return way


def _shortened(space: Space, way: Array, deadline: Deadline, wide: bool) -> Array:
    """Shorten a way, (N, n), by motions that keep the margin: all of them, or those whose ends keep it."""
    first, before = 0, np.inf
    while len(way) > 2 and not deadline.passed and (length := lengths(way).sum()) <= (1.0 - LEAST) * before:
        before = length
        shares = (0.5 + np.arange(first + 1, first + TOGETHER + 1)[:, None] * _GOLDEN) % 1.0
        first += TOGETHER
        if space.along is None:
            way = _with_shortcuts(space, _without_corners(space, way, wide), shares, wide)
        else:
            way = _with_advances(space, way, shares)
    return way


def lengths(way: Array) -> Array:
    """Return the lengths of the motions of a way, (N, n), (N - 1,) [rad or m]."""
    return np.asarray(np.linalg.norm(np.diff(way, axis=0), axis=1))


def _without_corners(space: Space, way: Array, wide: bool) -> Array:
    """Leave out rows, (N, n), whose neighbours are connected by a free motion."""
    while len(way) > 2:
        free = _free(space, way[:-2], way[2:], _kept(space, way[:-2], way[2:], wide))
        if not free.any():
            break
        gains = lengths(way)[:-1] + lengths(way)[1:] - np.linalg.norm(way[2:] - way[:-2], axis=1)
        kept = np.ones(len(way), dtype=np.bool_)
        for i in np.argsort(-gains, kind="stable"):
            # The motion replaces two others, so its neighbours stay.
            if free[i] and kept[i] and kept[i + 2]:
                kept[i + 1] = False
                free[max(i - 1, 0) : i + 2] = False
        way = way[kept]
    return way


def _with_shortcuts(space: Space, way: Array, shares: Array, wide: bool) -> Array:
    """Try shortcuts between places on a way, (N, n), given as shares of its length, (k, 2); the best first."""
    along = np.concatenate([[0.0], np.cumsum(lengths(way))])
    places = np.sort(shares * along[-1], axis=1)
    piece = np.clip(np.searchsorted(along, places, side="right") - 1, 0, len(way) - 2)
    part = (places - along[piece]) / np.maximum(along[piece + 1] - along[piece], 1e-300)
    ends = way[piece] + part[..., None] * (way[piece + 1] - way[piece])
    gains = places[:, 1] - places[:, 0] - np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    some = np.flatnonzero((piece[:, 0] < piece[:, 1]) & (gains > NEARER * along[-1]))
    a, b = ends[some, 0], ends[some, 1]
    some = some[_free(space, a, b, _kept(space, a, b, wide))]
    taken = _best(some, gains, places)
    for i in sorted(
        taken, key=lambda i: -places[i, 0]
    ):  # From the end, so that the numbers of the rows before stay.
        way = np.concatenate([way[: piece[i, 0] + 1], ends[i], way[piece[i, 1] + 1 :]])
    return way


def _best(some: Indices, gains: Array, places: Array) -> list[int]:
    """Return which of some intervals, (k, 2), to take: those of the largest gains that do not overlap."""
    taken: list[int] = []
    for i in some[np.argsort(-gains[some], kind="stable")].tolist():
        if all(places[i, 1] <= places[j, 0] or places[j, 1] <= places[i, 0] for j in taken):
            taken.append(i)
    return taken


def _with_advances(space: Space, way: Array, shares: Array) -> Array:
    """Do as `_with_shortcuts` for a way along which a goal holds: shortcuts lead from row to row, in steps."""
    along = np.concatenate([[0.0], np.cumsum(lengths(way))])
    at = np.sort(np.searchsorted(along, shares * along[-1]), axis=1)
    at = at[at[:, 1] > at[:, 0] + 1]
    rows, reached = space.advance(way[at[:, 0]], way[at[:, 1]] - way[at[:, 0]])
    new = [np.concatenate([way[i : i + 1], each]) for i, each in zip(at[:, 0], rows, strict=True)]
    gains = along[at[:, 1]] - along[at[:, 0]] - np.array([lengths(each).sum() for each in new])
    taken = _best(np.flatnonzero(reached & (gains > NEARER * along[-1])), gains, at)
    for i in sorted(taken, key=lambda i: -at[i, 0]):
        if space.proved(new[i][:-1], new[i][1:]).all():
            way = np.concatenate([way[: at[i, 0]], new[i], way[at[i, 1] + 1 :]])
    return way


def refined(space: Space, along: Along, way: Array) -> Array:
    """Insert joint values at which the goal holds into the motions of a way, (N, n), where the halves are proved free.

    Motions longer than `STEP` are divided again. A projection may end far away, where the goal holds as well: then there
    would be a jump and one back.
    """
    for longest in (0.0, STEP, STEP):
        some = np.flatnonzero(lengths(way) > longest)
        begins, ends = way[some], way[some + 1]
        straight = (begins + ends) / 2.0
        middles, holds = along.projected(straight)
        holds &= np.linalg.norm(middles - straight, axis=1) <= BESIDE * np.linalg.norm(ends - begins, axis=1)
        holds &= space.proved(begins, middles) & space.proved(middles, ends)
        way = np.insert(way, some[holds] + 1, middles[holds], axis=0)
    return way


def _kept(space: Space, begins: Array, ends: Array, wide: bool) -> Flags:
    """Return which motions keep the margin, (k,): all, or those whose ends do."""
    if wide or not len(begins):
        return np.ones(len(begins), dtype=np.bool_)
    return space.free(begins, MARGIN) & space.free(ends, MARGIN)


def _free(space: Space, begins: Array, ends: Array, kept: Flags) -> Flags:
    """Return which motions are proved free, (k,), with the margin where it is kept; samples reject most others."""
    free = np.zeros(len(begins), dtype=np.bool_)
    for margin, group in ((MARGIN, np.flatnonzero(kept)), (0.0, np.flatnonzero(~kept))):
        some = group[space.free_part(begins[group], (ends - begins)[group], margin) == 1.0]
        free[some] = space.proved(begins[some], ends[some], margin)
    return free


def rounded(space: Space, way: Array, deadline: Deadline) -> Array:
    """Replace the corners of a way, (N, n), by parabolas of short motions that are proved free.

    A corner starts and ends at most halfway to its neighbours. Where a motion is not proved free, it becomes smaller.
    """
    if len(way) < 3:
        return way
    corners = np.arange(1, len(way) - 1)
    size = lengths(way)
    before, after = way[corners] - way[corners - 1], way[corners + 1] - way[corners]
    radius = np.minimum(size[:-1], size[1:]) / 2.0
    t = np.linspace(0.0, 1.0, CORNER + 1)[None, :, None]
    found: dict[int, Array] = {}
    kept = space.free(way, MARGIN)
    for _ in range(ROUNDED):
        if not len(corners) or deadline.passed:
            break
        share = radius[corners - 1, None, None]
        a = way[corners, None] - share * (before / size[:-1, None])[corners - 1, None]
        b = way[corners, None] + share * (after / size[1:, None])[corners - 1, None]
        rows = (1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * way[corners, None] + t**2 * b
        flat = rows[:, :-1].reshape(-1, way.shape[1]), rows[:, 1:].reshape(-1, way.shape[1])
        free = np.all(_free(space, *flat, np.repeat(kept[corners], CORNER)).reshape(-1, CORNER), axis=1)
        found |= {int(i): rows[k] for k, i in enumerate(corners) if free[k]}
        corners = corners[np.flatnonzero(~free)]
        radius[corners - 1] /= 2.0
    return np.concatenate([found.get(i, way[i : i + 1]) for i in range(len(way))])


def dense(space: Space, way: Array) -> Array:
    """Return a way with more rows on its linear motions, (M, n), so that a spline through them hardly leaves it."""
    gaps = np.diff(way, axis=0)
    counts = np.maximum(np.ceil(np.abs(gaps) @ space.reach / DENSE), 1.0).astype(np.int64)
    which = np.repeat(np.arange(len(gaps)), counts)
    number = np.arange(len(which)) - (np.cumsum(counts) - counts)[which]
    rows = way[which] + (number / counts[which])[:, None] * gaps[which]
    return np.concatenate([rows, way[-1:]])
