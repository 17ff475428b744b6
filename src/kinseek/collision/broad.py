"""The broad phase: proves for many q at once, by spheres, planes and points, which pairs are free and which touch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import FAR
from kinseek.kernels.collision.first_pass import bound_pairs, free_samples, sort_out
from kinseek.kernels.collision.model import LANES, ROWS
from kinseek.kernels.collision.motions import free_motions
from kinseek.kernels.pointers import handle_of
from kinseek.robots.chain import Frame, SerialChain

from .cells import NEVER_APART, Meeting, Member, make_collision_model
from .charts import Carried, Chart, chart_of, charts_of
from .clouds import Cloud
from .spheres import covers_of, covers_of_cloud

if TYPE_CHECKING:
    from .engine import Solid

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Verdicts = NDArray[np.int64]

_STEPS = 16
"""Maximum number of planes tried per pair; without a separating plane or a common point the pair is in doubt. Not examined
further."""

_NEAR = 1e-6
"""Groups that may come nearer than this are always checked, in the order of the joints that carry them [m]."""

_OPEN = 16
"""Intervals in doubt of each motion, in the mean, for which there is room. Not examined further."""

_NO_DOUBTS = np.zeros((0, 0), dtype=np.bool_)
"""Passed to the kernel if the pairs in doubt are not requested."""


class Broad:
    """The broad phase of the pairs of a scene.

    Args:
        chain: The arm.
        solids: All parts.
        pairs: Numbers of the two parts of each pair; at most one of them is fixed in the base.
        pads: Padding of each pair, by which it is closer than its parts [m].
    """

    def __init__(
        self, chain: SerialChain, solids: Sequence[Solid], pairs: Sequence[tuple[int, int]], pads: Array
    ) -> None:
        """Attach the covers of all parts to their joints."""
        self.count = len(pairs)
        covers = covers_of([solid.shape for solid in solids])
        parts = [Member.of(solid, cover) for solid, cover in zip(solids, covers, strict=True)]
        # A cloud is split into neighbourhoods: free of all of them implies free of the cloud.
        pieces = [[i] for i in range(len(parts))]
        for i, solid in enumerate(solids):
            if isinstance(solid.shape, Cloud):
                some = [Member.of(solid, cover) for cover in covers_of_cloud(solid.shape)]
                pieces[i] = list(range(len(parts), len(parts) + len(some)))
                parts += some
        numbers = [n for n, (i, j) in enumerate(pairs) for _ in range(len(pieces[i]) * len(pieces[j]))]
        pairs = [(a, b) for i, j in pairs for a in pieces[i] for b in pieces[j]]
        pads = np.asarray(pads, dtype=np.float64)[numbers]
        self._numbers = np.array(numbers, dtype=np.int64)
        self._firsts = np.searchsorted(numbers, np.arange(self.count))
        gathered = _gathered(parts, pairs)
        # A group of several parts is one more part: free of its cover implies free of each.
        number: dict[Group, int] = {(i,): i for i in range(len(parts))}
        for group in sorted({group for each in gathered for group in each.groups} - number.keys()):
            number[group] = len(parts)
            one = _together(tuple(Carried.of(solids[i]) for i in group))
            parts.append(one._replace(joint=parts[group[0]].joint))
        within = [i if part.solid else -1 for i, part in enumerate(parts)]
        for i, solid in enumerate(solids):
            if not parts[i].solid and len(solid.shape.inner_corners):
                within[i] = len(parts)
                parts.append(parts[i].inside(solid))
                within.append(within[i])
        charts = [_chart(chain, solids, each, pairs, pads) for each in gathered]
        sides = [(number[each.groups[0]], number[each.groups[1]]) for each in gathered]
        reach = _Reach(chain, parts)
        apart = [
            reach.apart(one, other) - float(pads[each.pairs].max())
            for each, (one, other) in zip(gathered, sides, strict=True)
        ]
        inside = [max(far, chart.apart if chart else far) for far, chart in zip(apart, charts, strict=True)]
        # Pairs that are never near come last, so that a kernel may end before them.
        rising = sorted(range(len(gathered)), key=lambda m: max(inside[m], _NEAR))
        order = [n for m in rising for n in gathered[m].pairs]
        ends = np.cumsum([len(gathered[m].pairs) for m in rising], dtype=np.int64)
        cell = make_collision_model(
            chain.arrays_to(Frame(len(chain.leader), np.eye(4))),
            parts,
            within,
            np.array([(*pairs[n], n) for n in order], dtype=np.int64),
            pads[order],
            [
                Meeting(*sides[m], end - len(gathered[m].pairs), end)
                for m, end in zip(rising, ends.tolist(), strict=True)
            ],
            _beyond([apart[m] for m in rising]),
            _beyond([inside[m] for m in rising]),
            charts_of([charts[m] for m in rising]),
        )
        self._pairs, self._rounding = len(pairs), float(cell.rounding[0])
        self._arrays = ROWS.arrays(cell)
        self._handle = handle_of(self._arrays)

    def verdicts(self, q: Array, clearance: float, touch: float) -> tuple[Verdicts, int]:
        """Classify joint values, (k, n), as free, touching or in doubt, and count the last; see `sort_out`."""
        return self._classify(q, clearance, touch, _NO_DOUBTS)

    def sort_out(self, q: Array, clearance: float, touch: float) -> tuple[Verdicts, Flags]:
        """Classify joint values, (k, n), as free, touching or in doubt.

        Args:
            q: Joint values.
            clearance: Parts closer than this touch [m].
            touch: Parts farther apart than the clearance plus this are free [m].

        Returns:
            `FREE`, `TOUCH` or `DOUBT` of `kernels.collision.gaps`, (k,), and the pairs in doubt, (k, pairs).
        """
        doubts = self._table_of(q, np.bool_)
        verdicts, _ = self._classify(q, clearance, touch, doubts)
        if doubts.shape[1] > self.count:
            doubts = np.logical_or.reduceat(doubts, self._firsts, axis=1)
        return verdicts, doubts

    def _classify(self, q: Array, clearance: float, touch: float, doubts: Flags) -> tuple[Verdicts, int]:
        verdicts = np.empty(len(q), dtype=np.int64)
        # All bounds have rounding errors, so a pair is free only if it is farther apart by this margin.
        least = clearance + touch + self._rounding
        q = np.ascontiguousarray(q)
        return verdicts, sort_out(self._handle, q, clearance, least, _STEPS, LANES, verdicts, doubts)

    def free_samples(
        self, q: Array, way: Array, counts: NDArray[np.int64], clearance: float, touch: float
    ) -> NDArray[np.int64]:
        """Count the samples of linear motions that are free before the first that touches, -1 if one is in doubt, (k,).

        Args:
            q: Joint values at the begins of the motions, (k, n); the first sample comes after it.
            way: How far the joints move, (k, n).
            counts: Number of samples of each motion, (k,).
            clearance: See `sort_out`.
            touch: See `sort_out`.
        """
        free, least = np.empty(len(q), dtype=np.int64), clearance + touch + self._rounding
        free_samples(self._handle, np.stack([q, way], axis=1), counts, clearance, least, _STEPS, LANES, free)
        return free

    def bounds(self, q: Array, steps: int = 0) -> Array:
        """Return lower bounds on the distance of each pair, (k, n) -> (k, pairs) [m]; a negative bound has no meaning.

        With `steps` planes are tried between pairs that may be the nearest.
        """
        out = self._table_of(q, np.float64)
        bound_pairs(self._handle, np.ascontiguousarray(q), steps, LANES, out, np.empty(0))
        out[np.abs(q).max(axis=1) > FAR] = -np.inf
        return np.minimum.reduceat(out, self._firsts, axis=1) if out.shape[1] > self.count else out

    def free_motions(
        self, q: Array, way: Array, levers: Array, least: Array
    ) -> tuple[Verdicts, NDArray[np.int64], Array]:
        """Classify linear motions as free, not free or in doubt.

        Args:
            q: Joint values at their begins, (k, n).
            way: How far the joints move, (k, n).
            levers: Bounds on the derivative of a point of each pair by each joint of the mechanism, 0 for joints that are
                not between its parts, (k or 1, pairs, joints).
            least: The distance that each pair keeps in each motion, (k, pairs) [m].

        Returns:
            `FREE`, `TOUCH`, `DOUBT` or `MANY` of `kernels.collision.motions`, (k,), and the intervals in doubt: the numbers
            of their motions, (m,), and their begins and ends as fractions of these, (m, 2). `MANY` has none.
        """
        if self._pairs > self.count:
            levers, least = levers[:, self._numbers], least[:, self._numbers]
        verdicts, most = np.empty(len(q), dtype=np.int64), _OPEN * len(q)
        numbers, opened = np.empty(most, dtype=np.int64), np.empty((most, 2))
        motions = np.stack([q, way], axis=1)
        levers, least = np.ascontiguousarray(levers), np.ascontiguousarray(least)
        count = free_motions(self._handle, motions, levers, least, LANES, verdicts, numbers, opened)
        return verdicts, numbers[:count], opened[:count]

    def _table_of(self, q: Array, kind: type) -> NDArray[Any]:
        return np.zeros((len(q), self._pairs), dtype=kind)


Group = tuple[int, ...]
"""Numbers of parts that are checked together."""


class _Gathered(NamedTuple):
    """Pairs whose parts are carried by the same two joints."""

    groups: tuple[Group, Group]
    """The group of the proximal joint first."""
    pairs: list[int]


def _gathered(parts: Sequence[Member], pairs: Sequence[tuple[int, int]]) -> list[_Gathered]:
    """Group the pairs by their two joints; each part fixed in the base is a group of its own."""
    # One side of a meeting is all that one joint carries, or one part that is fixed in the base.
    side_of = [(part.joint, -1 if part.joint else i) for i, part in enumerate(parts)]
    gathered: dict[tuple[tuple[int, int], ...], list[int]] = {}
    for n, pair in enumerate(pairs):
        gathered.setdefault(tuple(sorted(side_of[i] for i in pair)), []).append(n)
    meetings = []
    for sides, numbers in sorted(gathered.items()):
        members = sorted({i for n in numbers for i in pairs[n]})
        one, other = (tuple(i for i in members if side_of[i] == side) for side in sides)
        meetings.append(_Gathered((one, other), numbers))
    return meetings


@lru_cache(maxsize=64)  # A changed scene leaves the arm the same.
def _together(parts: tuple[Carried, ...]) -> Member:
    """Return a cover of some parts that one joint carries."""
    return Member.together([part.member(0) for part in parts])


def _chart(
    chain: SerialChain,
    solids: Sequence[Solid],
    meeting: _Gathered,
    pairs: Sequence[tuple[int, int]],
    pads: Array,
) -> Chart | None:
    """Return the chart of two groups that the arm carries with one or two revolute joints between them."""
    (one, other), numbers = meeting
    if max(*one, *other) >= len(solids):
        return None  # A neighbourhood of a cloud, fixed in the base.
    first, last = solids[one[0]].joint, solids[other[0]].joint
    if first == 0 or not 1 <= last - first <= 2 or chain.prismatic[first:last].any():
        return None
    multiplier, offset = chain.multiplier[first:last], chain.offset[first:last]
    leader = chain.leader[first:last]
    ends = np.sort(multiplier * np.stack([chain.lower[leader], chain.upper[leader]]) + offset, axis=0)
    in_order = [pairs[n] if pairs[n][0] in one else pairs[n][::-1] for n in numbers]
    return chart_of(
        (first, last),
        chain.fixed[first:last].tobytes(),
        tuple(zip(*ends.tolist(), strict=True)),
        tuple(Carried.of(solids[i]) for i in one),
        tuple(Carried.of(solids[i]) for i in other),
        tuple((one.index(i), other.index(j)) for i, j in in_order),
        tuple(pads[numbers].tolist()),
    )


def _beyond(apart: Sequence[float]) -> Array:
    """Replace bounds too small to be useful by `NEVER_APART`."""
    return np.array([bound if bound > _NEAR else NEVER_APART for bound in apart], dtype=np.float64)


class _Reach:
    """Lower bounds on distances at any q, from the arm's reach beyond the first joint between two parts."""

    def __init__(self, chain: SerialChain, parts: Sequence[Member]) -> None:
        lengths = np.linalg.norm(chain.fixed[:, :, 3], axis=1) * (1.0 + 1e-12)
        self._along = [0.0, *np.cumsum(lengths).tolist()]
        self._slides = [0, *np.cumsum(chain.prismatic).tolist()]
        self._joints = [part.joint for part in parts]
        self._far = [float(np.linalg.norm(part.ball[:3]) + part.ball[3]) for part in parts]
        self._away = [_distance(part, chain.fixed[part.joint, :, 3]) for part in parts]

    def apart(self, one: int, other: int) -> float:
        """Bound for two parts, proximal first [m]; `NEVER_APART` if there is no joint between them, or a prismatic one."""
        first, last = self._joints[one], self._joints[other]
        if last == first or self._slides[last] > self._slides[first]:
            return NEVER_APART
        links: float = self._along[last] - self._along[first + 1]
        return self._away[one] - links - self._far[other]


def _distance(part: Member, point: Array) -> float:
    """Return a lower bound on the distance of a part from a point in the frame of its joint [m]."""
    local = np.abs(part.core[:, :3].T @ (point - part.core[:, 3])) - part.half
    box = np.linalg.norm(np.maximum(local, 0.0)) - part.thick
    return float(max(box, np.linalg.norm(point - part.ball[:3]) - part.ball[3]))
