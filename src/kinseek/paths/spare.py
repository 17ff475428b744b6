"""Arms with joints to spare: many branches followed side by side, the best way among them, then all poses at once.

The way is planned on some of the poses, chosen by how far the hand goes, and filled in between them. At the first pose
answers are sampled all over the self-motion. Each is followed with the least motion of the joints from layer to layer; at
each layer answers beside them, along the self-motion, keep them well spread, and a few fresh samples join them. So the best
way through all of them (see `kernels.paths.programme.link`) keeps to branches, and changes from one to another sideways, by
little at a time. What it leaves of corners is smoothed away, on the poses of the plan first, then on all. Where a step is
still too large, that part of the path is planned again, more finely; if that does not help, all of it is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import BranchIndex, index_of
from kinseek.branches.order import is_valid
from kinseek.branches.result import answers_of
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.grow import gather, lead_on
from kinseek.kernels.paths.programme import link
from kinseek.kernels.paths.trace import trace
from kinseek.problem import Problem
from kinseek.robots.geometry import arm_length
from kinseek.solvers import Atlas
from kinseek.solvers.atlas.index import wanted_of

from .asked import Asked
from .between import apart
from .joints import Turning
from .smooth import Row, Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]


class Effort(NamedTuple):
    """How finely a path is planned."""

    way: float
    """So far the hand goes from row to row: its turn [rad], and its way in thirds of the arm's length."""
    rows: int
    """Rows from one layer to the next."""
    samples: int
    """Answers sampled at the first pose."""
    fresh: int
    """Fresh ones at each other layer."""
    most: int
    """Answers at a layer at most."""
    apart: float
    """Answers nearer than this [rad or m] in every joint go on as one."""


COARSE = Effort(0.25, 3, 100, 4, 200, 0.1)
FINE = Effort(0.2, 2, 150, 4, 250, 0.08)
EACH = Effort(0.0, 4, 150, 4, 400, 0.08)
"""All poses are rows: near a singularity what lies between two rows is not known well enough to fill it in."""

AROUND = (3.0, 8.0)
"""Before and behind a break so much of the hand's way is planned anew."""

SIDEWAYS = 0.4
"""A way along the self-motion leads so far in every joint [rad or m] at most; what is farther off is another branch."""

BESIDE = 2.0
"""So many times as far along the self-motion as answers are apart, more are looked for beside each."""

LEAPS = 0.6
"""A branch ends where a joint goes farther than this from row to row [rad or m]."""

CROWD = 1.2
"""Where there is no room for all answers at a layer, they are so many times as far apart at the next."""

FIRST_PASSES, LAST_PASSES = 10, 4
"""Passes of smoothing at most, on the rows of the plan and on all poses."""

POWERS, POWER_PASSES, EASED = (6, 12), 20, 4.0
"""Where steps are still too large, powers of the steps' lengths whose sum is made small instead, in so many passes at most,
on so much of the hand's way before and behind."""

UNBOUND = 1e6
"""Stands for a step without a bound."""


class Layer(NamedTuple):
    """Answers at one layer, and the best way to each of them."""

    q: Array
    """In the first turn, (k, n)."""
    along: Array
    """Directions of the self-motion, (k, n)."""
    fault: Indices
    """Breaks on the way to each node, -1 for those that are none, (k · copies,)."""
    sums: Array
    """What the way costs, (k · copies,)."""
    came: Indices
    """See `link`, (k · copies,)."""


class Planner:
    """Finds the best way through a path for one arm with joints to spare."""

    def __init__(self, asked: Asked, effort: Effort) -> None:
        """Choose rows and layers.

        Args:
            asked: The path.
            effort: How finely it is planned.
        """
        problem = asked.problem
        self.asked, self.effort, self.problem, self.dof = asked, effort, problem, problem.chain.dof
        self.smoother, self.turning = smoother_of(asked), Turning(problem.chain)
        self.index: BranchIndex = index_of(problem)
        self.wanted, self.targets = wanted_of(problem.goal), np.ascontiguousarray(problem.goal.targets)
        self.gone = gone_of(problem)
        """How far the hand has gone at each pose, see `Effort.way`, (N,)."""
        self.rows = rows_of(self.gone, effort.way)
        """Numbers of the poses on which the way is planned."""
        self.row_targets = np.ascontiguousarray(self.targets[self.rows])
        last = len(self.rows) - 1
        self.keys = np.unique(np.round(np.linspace(0, last, -(-last // effort.rows) + 1)).astype(np.int64))
        """Which rows are layers."""
        longest = asked.longest.min(axis=0)
        self.longest = np.where(np.isinf(longest), UNBOUND, longest)
        self.sideways = np.where(np.isinf(asked.longest.max(axis=0)), UNBOUND, SIDEWAYS)
        self.apart = effort.apart

    def sample(self, i: int, count: int) -> Array:
        """Answers to pose i, well spread, (k, n)."""
        target = np.eye(4)
        target[:3] = self.targets[i]
        rows = self.index.search(self.wanted, target, self.index.view, count) if count else ()
        return answers_of(rows, self.dof).q if len(rows) else np.zeros((0, self.dof))

    def layer(self, k: int, arrived: Array, fresh: Array, spread: bool = True) -> tuple[Array, Array]:
        """Answers at a layer, (k, n), and the directions of the self-motion there."""
        given, turning = np.concatenate([arrived, fresh]), self.turning
        q, along = np.empty((2, self.effort.most, self.dof))
        beside = BESIDE * self.apart * spread
        target = self.row_targets[self.keys[k]]
        handle = self.index.fine.handle
        limits = (turning.lower, turning.upper, turning.kind)
        count = gather(
            handle, self.wanted, target, given, len(arrived), *limits, self.apart, beside, q, along, LANES
        )
        self.apart = self.apart * CROWD if count == len(q) else max(self.effort.apart, self.apart / CROWD)
        q, along = q[:count], along[:count]
        if self.asked.valid is not None:
            lower, upper = turning.open_lower, turning.open_upper
            good = [is_valid(self.asked.valid, np.clip(row, lower, upper)) for row in q]
            q, along = q[np.array(good, dtype=np.bool_)], along[np.array(good, dtype=np.bool_)]
        if len(q):
            return q, along
        # None at all: the nearest that the atlas finds.
        goal = self.problem.goal.at(self.problem.goal.target[self.rows[self.keys[k]]])
        nearest = Atlas(threads=1).solve(Problem(self.problem.mechanism, goal)).q
        return turning.first_turn(nearest[None]), np.zeros((1, self.dof))

    def plan(self, advance: Advance) -> Array:
        """Joint values for all rows, (rows, n)."""
        asked, turning = self.asked, self.turning
        fixed = [None if q is None else turning.off_ends(q) for q in (asked.start, asked.end)]
        if fixed[0] is None:
            q, along = self.layer(0, self.sample(0, self.effort.samples), np.zeros((0, self.dof)))
        else:
            q, along = self.layer(0, turning.first_turn(fixed[0][None]), np.zeros((0, self.dof)), spread=False)
        nothing = np.zeros(0)
        before = Layer(*np.zeros((2, 0, self.dof)), np.zeros(0, dtype=np.int64), nothing, np.zeros(0, dtype=np.int64))
        layers = [self.linked(before, q, along, (nothing, nothing, nothing), 0, fixed[0])]
        for k in range(1, len(self.keys)):
            begin, end = self.keys[k - 1], self.keys[k]
            before = layers[-1]
            led = self.lead_on(before.q, int(begin), int(end))
            ahead, told, _ = led
            if k == len(self.keys) - 1 and fixed[1] is not None:
                q, along = self.layer(k, turning.first_turn(fixed[1][None]), np.zeros((0, self.dof)), spread=False)
            else:
                q, along = self.layer(k, ahead[np.isfinite(told[:, 0])], self.sample(self.rows[end], self.effort.fresh))
            last = fixed[1] if k == len(self.keys) - 1 else None
            layers.append(self.linked(before, q, along, led, int(self.rows[end] - self.rows[begin]), last))
            advance(int(self.rows[end] - self.rows[begin]))
        return self.filled(layers)

    def lead_on(self, q: Array, begin: int, end: int) -> tuple[Array, Array, Array]:
        """Where answers to a row lead at another, what is told of them, and directions there; see `grow.lead_on`."""
        ahead, along = np.empty((2, *q.shape))
        told = np.empty((len(q), 1 + 2 * self.dof))
        leaps = np.full(self.dof, LEAPS)
        moments = self.rows[begin : end + 1].astype(np.float64)
        targets = self.row_targets[begin : end + 1]
        lead_on(
            self.index.fine.handle, self.wanted, targets, moments, leaps, self.smoother.weights, q, ahead, told, along, LANES
        )
        return ahead, told, along

    def linked(
        self, before: Layer, q: Array, along: Array, led: tuple[Array, Array, Array], poses: int, only: Array | None
    ) -> Layer:
        """Answers as a layer, reached from the layer before; with `only`, (n,), no other turn of it."""
        turning = self.turning
        if not len(before.q):
            led = (before.q, np.zeros((0, 1 + 2 * self.dof)), before.q)
        nodes = len(q) * turning.total
        made = Layer(q, along, np.empty(nodes, dtype=np.int64), np.empty(nodes), np.empty(nodes, dtype=np.int64))
        link(
            before.q,
            *led,
            q,
            along,
            turning.lower,
            turning.upper,
            turning.kind,
            turning.copies,
            self.longest,
            self.sideways,
            self.smoother.weights,
            float(poses),
            np.zeros(0),
            before.fault,
            before.sums,
            made.fault,
            made.sums,
            made.came,
        )
        if only is not None:
            made.fault[np.arange(nodes) != turning.turns_of(only)] = -1
        return made

    def filled(self, layers: list[Layer]) -> Array:
        """Joint values of all rows: along each branch, and sideways to the next evenly over all poses in between."""
        nodes, total, turning = [], self.turning.total, self.turning
        end = layers[-1]
        node = int(np.lexsort((end.sums, np.where(end.fault < 0, np.iinfo(np.int64).max, end.fault)))[0])
        joined = []
        for layer in reversed(layers):
            nodes.append(node)
            joined.append(layer.came[node] >= 0)
            node = int(layer.came[node]) if layer.came[node] >= 0 else -2 - int(layer.came[node])
        nodes, joined = nodes[::-1], joined[::-1]
        chosen = [layer.q[node // total] for layer, node in zip(layers, nodes, strict=True)]
        values = [
            turning.node_values(q[None], np.array([node % total]))[0] for q, node in zip(chosen, nodes, strict=True)
        ]
        parts = []
        for k, (begin, end_row) in enumerate(itertools.pairwise(self.keys.tolist())):
            way = self.followed(chosen[k], begin, end_row) + (values[k] - chosen[k])
            if joined[k + 1]:
                moments = self.rows[begin : end_row + 1]
                share = (moments - moments[0]) / (moments[-1] - moments[0])
                way = way + share[:, None] * turning.step(values[k + 1] - way[-1])
            parts.append(way[:-1])
        return turning.unwrapped(np.concatenate([*parts, values[-1][None]]))

    def followed(self, q: Array, begin: int, end: int) -> Array:
        """One branch from row to row, (rows, n)."""
        ways, ends = np.zeros((end - begin + 1, LANES, self.dof)), np.zeros(LANES, dtype=np.int64)
        ways[0] = q
        targets, leaps = self.row_targets[begin : end + 1], np.full(self.dof, LEAPS)
        trace(self.index.fine.handle, self.wanted, targets, 0, end - begin, 1, leaps, ways, ends, LANES)
        ways[ends[0] + 1 :, 0] = ways[ends[0], 0]
        return ways[:, 0]


def gone_of(problem: Problem) -> Array:
    """How far the hand has gone at each pose, its turn [rad] and its way in thirds of the arm's length, (N,)."""
    poses = np.zeros((len(problem.goal.targets), 4, 4))
    poses[:, :3], poses[:, 3, 3] = problem.goal.targets, 1.0
    distance, turn = apart(poses[:-1], poses[1:])
    return np.concatenate([[0.0], np.cumsum(distance / arm_length(problem.chain) * 3 + turn)])


def rows_of(gone: Array, way: float) -> Indices:
    """Numbers of poses between which the hand goes so far, the first and the last among them; all of them for 0."""
    last = len(gone) - 1
    if way <= 0.0:
        return np.arange(last + 1)
    parts = max(int(np.ceil(gone[-1] / way)), min(last, 2))
    rows = np.searchsorted(gone, np.linspace(0, gone[-1], parts + 1))
    return np.unique(np.concatenate([[0], rows, [last]]).clip(0, last)).astype(np.int64)


def between_rows(rows: Indices, q: Array) -> Array:
    """Values for all poses, from those of some, by cubic polynomials (Hermite) without a corner, (rows, n) -> (N, n)."""
    if len(rows) < 3:
        share = np.arange(rows[-1] + 1) / max(rows[-1], 1)
        return q[0] + share[:, None] * (q[-1] - q[0])
    spans = np.diff(rows).astype(np.float64)[:, None]
    slopes = np.diff(q, axis=0) / spans
    middle = (slopes[:-1] * spans[1:] + slopes[1:] * spans[:-1]) / (spans[1:] + spans[:-1])
    tangents = np.concatenate([slopes[:1], middle, slopes[-1:]])
    poses = np.arange(rows[-1] + 1)
    i = np.clip(np.searchsorted(rows, poses, side="right") - 1, 0, len(rows) - 2)
    span = spans[i]
    t = (poses - rows[i])[:, None] / span
    one = t * t * (3 - 2 * t)
    return np.asarray(
        q[i] + one * (q[i + 1] - q[i]) + span * t * (1 - t) * ((1 - t) * tangents[i] - t * tangents[i + 1])
    )


def unbroken(asked: Asked, q: Array) -> Flags:
    """Of each step of a path, (N - 1,): does no joint go too far?"""
    return np.asarray((np.abs(np.diff(q, axis=0)) <= asked.longest * (1 + 1e-9)).all(axis=1))


def follow_samples(asked: Asked, advance: Advance) -> tuple[Array, Indices]:
    """Joint values for every pose of a path that leaves joints to spare, (N, n), and its breaks."""
    q = _open_way(asked, advance)
    if not asked.closed or len(q) == 1:
        return q, np.flatnonzero(~unbroken(asked, q))
    goal, best = asked.problem.goal, None
    around = Problem(asked.problem.mechanism, goal.at(np.concatenate([goal.target, goal.target[:1]])))
    longest = asked.longest
    if len(longest) > 1:
        longest = np.concatenate([longest, longest[-1:]])
    # One more pose leads back: to where the open way begins, or on from where it ends.
    for start in [q[0], q[-1]] if asked.start is None else [asked.start]:
        row = np.ascontiguousarray(start[None])
        smoother_of(asked).settle(row, np.ascontiguousarray(goal.targets[:1]))
        round_trip = replace(asked, problem=around, longest=longest, start=row[0], end=row[0], closed=False)
        way = _open_way(round_trip, _silent)
        if best is None or _faults(round_trip, way) < _faults(round_trip, best):
            best = way
    assert best is not None
    gaps = Turning(asked.problem.chain).way(np.diff(best, axis=0))
    return best[:-1], np.flatnonzero((np.abs(gaps) > longest).any(axis=1))


def _silent(done: int) -> None:
    pass


def smoother_of(asked: Asked) -> Smoother:
    """What makes its paths short."""
    weights = asked.weights if asked.velocity is None else asked.weights / asked.velocity
    return Smoother(asked.problem, weights / weights.max(), asked.valid)


def _open_way(asked: Asked, advance: Advance) -> Array:
    """The best of a few plans, each made if those before it break, and parts of each planned anew around its breaks."""
    best: Array | None = None
    for effort in (COARSE, FINE, EACH):
        q = _mended(asked, _planned(asked, effort, advance if best is None else _silent))
        if best is None or _faults(asked, q) < _faults(asked, best):
            best = q
        if not _faults(asked, best)[0]:
            break
    assert best is not None
    return best


def _mended(asked: Asked, q: Array) -> Array:
    """Parts of a path around its breaks planned anew and finely, where that mends them."""
    gone = gone_of(asked.problem)
    for around in AROUND:
        for first, last in _around(asked, q, gone, around):
            part = _part(asked, q, first, last)
            made = _planned(part, EACH, _silent)
            if _faults(part, made) < _faults(part, q[first : last + 1]):
                # Endless joints may come out by whole turns farther on: what follows goes along.
                q = np.concatenate([q[:first], made, q[last + 1 :] + (made[-1] - q[last])])
    return q


def _part(asked: Asked, q: Array, first: int, last: int) -> Asked:
    """From one pose of a path to another, both as they are, but for the ends of the whole that are open."""
    goal = asked.problem.goal
    longest = asked.longest if len(asked.longest) == 1 else asked.longest[first:last]
    return replace(
        asked,
        problem=Problem(asked.problem.mechanism, goal.at(goal.target[first : last + 1])),
        start=asked.start if first == 0 else q[first],
        end=asked.end if last == len(q) - 1 else q[last],
        longest=longest,
        closed=False,
    )


def _faults(asked: Asked, q: Array) -> tuple[int, float]:
    """Breaks, and the sum of the squared steps."""
    return int((~unbroken(asked, q)).sum()), float((np.diff(q, axis=0) ** 2).sum())


def _planned(asked: Asked, effort: Effort, advance: Advance) -> Array:
    planner = Planner(asked, effort)
    smoother, rows = planner.smoother, planner.rows
    if len(rows) == 1:
        only = planner.layer(0, planner.sample(0, effort.samples), np.zeros((0, planner.dof)))[0][:1]
        return only if asked.start is None else asked.start[None]
    some, all_of_them = _row(asked, rows), _row(asked, np.arange(rows[-1] + 1))
    q = _put(asked, smoother, planner.plan(advance), some)
    q = smoother.smooth(q, some, FIRST_PASSES, 2)
    if len(rows) < len(all_of_them.targets):
        q = _put(asked, smoother, between_rows(rows, q), all_of_them)
    q = smoother.smooth(q, all_of_them, LAST_PASSES, 2)
    gone = planner.gone
    for power in POWERS:
        for first, last in _around(asked, q, gone, EASED):
            part = _row(_part(asked, q, first, last), np.arange(last + 1 - first))
            q[first : last + 1] = smoother.smooth(q[first : last + 1], part, POWER_PASSES, power)
    return q


def _around(asked: Asked, q: Array, gone: Array, way: float) -> list[tuple[int, int]]:
    """First and last pose of each part of a path that holds its breaks, and so much of the hand's way at both sides."""
    parts: list[tuple[int, int]] = []
    for i in np.flatnonzero(~unbroken(asked, q)).tolist():
        first = int(np.searchsorted(gone, gone[i] - way))
        last = min(int(np.searchsorted(gone, gone[i + 1] + way)), len(q) - 1)
        if parts and first <= parts[-1][1]:
            first = parts.pop()[0]
        parts.append((first, last))
    return parts


def _row(asked: Asked, rows: Indices) -> Row:
    """Some poses of a path, the first and the last among them."""
    fixed = np.zeros(len(rows), dtype=np.bool_)
    fixed[0], fixed[-1] = asked.start is not None, asked.end is not None
    spans = np.diff(rows)
    if len(asked.longest) == 1:
        longest = asked.longest * spans[:, None]
    else:
        longest = np.add.reduceat(asked.longest, rows[:-1], axis=0)
    targets = np.ascontiguousarray(asked.problem.goal.targets[rows])
    return Row(targets, fixed, spans.astype(np.float64)[:, None], longest)


def _put(asked: Asked, smoother: Smoother, q: Array, row: Row) -> Array:
    """Bring rows onto their targets; those that are fixed are what was asked for."""
    if asked.start is not None:
        q[0] = asked.start
    if asked.end is not None:
        q[-1] = asked.end
    moved = q.copy()
    smoother.onto(moved, row.targets)
    moved[row.fixed] = q[row.fixed]
    return moved
