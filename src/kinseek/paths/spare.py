"""Arms with joints to spare: many branches followed side by side, the best way among them, then all poses at once.

At the first pose answers are sampled all over the self-motion. Each is followed with the least motion of the joints to the
next of some evenly spread poses; there a few fresh samples join them, and those that have come together go on as one. From
where a branch leads to what stands near it at the same pose there is a way along the self-motion. So the best way through
all of them (see `kernels.paths.programme`) keeps to branches, and changes from one to another sideways, by little at a time.
What it leaves of corners is smoothed away afterwards, for all poses together. Where a step is still too large, everything is
tried again with more samples.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import BranchIndex, constraint_jacobian, index_of
from kinseek.branches.result import answers_of
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.programme import SQUARES, STRAIGHT, best_way
from kinseek.kernels.paths.trace import trace
from kinseek.problem import Problem
from kinseek.robots.geometry import arm_length
from kinseek.solvers import Atlas
from kinseek.solvers.atlas.index import wanted_of

from .asked import Asked
from .between import apart
from .joints import Turning
from .smooth import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]

ATTEMPTS = ((10, 60, 12, 120), (5, 150, 60, 250))
"""Of each attempt: poses from one layer to the next, samples at the first, fresh ones at the others, branches at most."""

APART = 1.0
"""The hand turns by so much [rad], or moves by as much of a third of the arm's length, between two layers at most, unless
they are a quarter as far apart as usual already."""

SIDEWAYS = 0.4
"""A way along the self-motion leads so far in every joint [rad or m] at most; what is farther off is another branch."""

BESIDE = 0.25
"""So far along the self-motion [rad or m] two answers are looked for beside each branch, one to each side."""

TOGETHER = 0.1
"""Branches this close [rad or m] in every joint go on as one."""

LEAPS = 0.5
"""A branch ends where a joint goes farther than this from pose to pose [rad or m]."""

PASSES = ((10, 2), (20, 6), (20, 12))
"""Passes of smoothing at most, and the power of the steps' lengths whose sum they make small; the higher powers only where
steps are still too large."""


TRIES = 20
"""Ways through tracks that are tried until one is free in the scene all along."""


@dataclass(frozen=True)
class Tracks:
    """Branches from one layer to the next; where they are in between is found again for those that are taken."""

    nodes: list[Array]
    """Answers at each layer, (k, n)."""
    ahead: list[Array]
    """Where they are at the next layer, (k, n)."""
    costs: list[Array]
    """What it costs to follow them there, (k,); infinite for those that do not get there."""


def layers_of(problem: Problem, every: int) -> Indices:
    """Numbers of the poses at which there are layers, the first and the last among them."""
    last = len(problem.goal.targets) - 1
    if not last:
        return np.zeros(1, dtype=np.int64)
    poses = np.zeros((last + 1, 4, 4))
    poses[:, :3], poses[:, 3, 3] = problem.goal.targets, 1.0
    distance, turn = apart(poses[:-1], poses[1:])
    way = float((distance / arm_length(problem.chain) * 3 + turn).sum())
    parts = np.clip(way / APART, last / every, last * 4 / every)
    return np.unique(np.round(np.linspace(0, last, int(np.ceil(parts)) + 1)).astype(np.int64))


def one_each(q: Array, most: int) -> Array:
    """One of those that lie together, and of what is left so many at most, evenly taken out of all, (k, n) -> (m, n)."""
    _, first = np.unique(np.floor(q / TOGETHER), axis=0, return_index=True)
    kept = q[np.sort(first)]
    if len(kept) <= most:
        return np.asarray(kept)
    return np.asarray(kept[np.linspace(0, len(kept) - 1, most).astype(np.int64)])


class Sampler:
    """Samples and follows the answers of one arm with joints to spare."""

    def __init__(self, asked: Asked) -> None:
        """Build what the arm needs once."""
        problem = asked.problem
        self.asked, self.problem, self.dof = asked, problem, problem.chain.dof
        self.smoother = _smoother(asked)
        self.index: BranchIndex = index_of(problem)
        self.wanted, self.turning = wanted_of(problem.goal), Turning(problem.chain)
        self.rows = np.ascontiguousarray(problem.goal.targets)

    def sample(self, i: int, count: int) -> Array:
        """Answers to target i, well spread, (k, n)."""
        target = np.eye(4)
        target[:3] = self.rows[i]
        rows = self.index.search(self.wanted, target, self.index.view, count)
        found = answers_of(rows, self.dof).q if len(rows) else np.zeros((0, self.dof))
        return self.allowed(found)

    def allowed(self, q: Array) -> Array:
        """Those answers, (k, n), in the first turn, that lie inside the limits and that `valid` takes."""
        first = self.turning.first_turn(q)
        inside = self.turning.inside(first)
        if self.asked.valid is not None:
            inside[inside] = self.asked.valid.each(self._clipped(first[inside]))
        return np.asarray(first[inside])

    def _clipped(self, q: Array) -> Array:
        return np.clip(q, self.turning.open_lower, self.turning.open_upper)

    def beside(self, q: Array, i: int) -> Array:
        """Answers to target i on both sides of some, (k, n), along their self-motion."""
        if not len(q):
            return q
        J = constraint_jacobian(self.problem, q)
        J[:, :3] /= self.smoother.scale
        # Any direction without what moves the hand; no coordinate of it is special.
        any_way = 1.0 + 0.37 * np.arange(self.dof) * (-1.0) ** np.arange(self.dof)
        gram = J @ np.swapaxes(J, 1, 2) + 1e-9 * np.eye(J.shape[1])
        lost = np.swapaxes(J, 1, 2) @ np.linalg.solve(gram, (J @ any_way)[..., None])
        along = any_way - lost[..., 0]
        along *= BESIDE / np.maximum(np.abs(along).max(axis=1, keepdims=True), 1e-9)
        found = np.concatenate([q + along, q - along])
        there = self.smoother.settle(found, np.repeat(self.rows[i][None], len(found), axis=0))
        return self.allowed(found[there])

    def follow(self, answers: Array, begin: int, end: int) -> tuple[Array, Flags]:
        """Where answers to target `begin`, (k, n), go until target `end`, (poses, k, n), and whether they get there."""
        ways, alive = (
            np.zeros((end - begin + 1, len(answers), self.dof)),
            np.zeros(len(answers), dtype=np.bool_),
        )
        longest = np.full(self.dof, LEAPS)
        for first in range(0, len(answers), LANES):
            some = answers[first : first + LANES]
            q, ends = np.zeros((end - begin + 1, LANES, self.dof)), np.zeros(LANES, dtype=np.int64)
            q[0, : len(some)] = some
            trace(
                self.index.fine.handle,
                self.wanted,
                self.rows[begin : end + 1],
                0,
                end - begin,
                len(some),
                longest,
                q,
                ends,
                LANES,
            )
            ways[:, first : first + len(some)] = q[:, : len(some)]
            alive[first : first + len(some)] = ends[: len(some)] == end - begin
        return ways, alive

    def tracks(self, keys: Indices, count: int, fresh: int, most: int, advance: Advance) -> Tracks:
        """Branches from layer to layer."""
        first = (
            self.sample(0, count)
            if self.asked.start is None
            else self.turning.first_turn(self.turning.off_ends(self.asked.start[None]))
        )
        made = Tracks([self._some(first, 0)], [], [])
        for begin, end in zip(keys[:-1].tolist(), keys[1:].tolist(), strict=True):
            ways, alive = self.follow(made.nodes[-1], begin, end)
            if end == keys[-1] and self.asked.end is not None:
                nodes = self.turning.first_turn(self.turning.off_ends(self.asked.end[None]))
            else:
                arrived = one_each(self.allowed(ways[-1, alive]), most)
                nodes = one_each(
                    np.concatenate([arrived, self.sample(end, fresh), self.beside(arrived, end)]), most
                )
            made.nodes.append(self._some(nodes, end))
            made.ahead.append(ways[-1].copy())
            made.costs.append(np.where(alive & self._free(ways), self._cost(ways), np.inf))
            advance(end - begin)
        return made

    def _some(self, nodes: Array, i: int) -> Array:
        """The nodes, or where there are none the nearest that the atlas finds."""
        if len(nodes):
            return nodes
        goal = self.problem.goal.at(self.problem.goal.target[i])
        return self.turning.first_turn(Atlas(threads=1).solve(Problem(self.problem.mechanism, goal)).q[None])

    def _free(self, ways: Array) -> Flags:
        """Are branches, (poses, k, n), free in the scene at every pose? (k,)."""
        if self.asked.valid is None:
            return np.ones(ways.shape[1], dtype=np.bool_)
        rows = self._clipped(ways.reshape(-1, self.dof))
        return np.asarray(self.asked.valid.free(rows).reshape(ways.shape[:2]).all(axis=0))

    def _cost(self, ways: Array) -> Array:
        """What it costs to follow branches, (poses, k, n) -> (k,)."""
        steps = np.diff(ways, axis=0)
        # A step that is nearly too large, or is too large, counts for many.
        share = (np.abs(steps) / self.asked.longest.min(axis=0)).max(axis=2)
        cost = ((steps * self.smoother.weights) ** 2).sum(axis=2) * (1 + share**4)
        return np.asarray(cost.sum(axis=0))

    def best(self, made: Tracks, keys: Indices, barred: set[tuple[int, int, int]]) -> tuple[Array, Indices]:
        """The best way through tracks, pose by pose, (N, n), and its nodes at the layers; `barred` steps are not taken."""
        turning, width = self.turning, max(map(len, made.nodes))
        # One more column holds what it costs to follow a branch: its difference from where it leads is the root of that.
        q, ahead = np.zeros((2, len(keys), width, self.dof + 1))
        count = np.array([len(nodes) for nodes in made.nodes])
        for k, nodes in enumerate(made.nodes):
            q[k, : len(nodes), :-1] = nodes
            if k < len(made.ahead):
                ahead[k, : len(nodes), :-1] = made.ahead[k]
                # No step leads on from a branch that has ended: this one is infinite.
                ahead[k, : len(nodes), -1] = np.sqrt(made.costs[k])
        longest = np.full(self.dof + 1, 1e6)
        longest[:-1] = np.where(np.isinf(self.asked.longest.max(axis=0)), 1e6, SIDEWAYS)
        path, told = np.zeros(len(keys), dtype=np.int64), np.zeros(len(keys))
        nothing = np.zeros((0, 0))
        best_way(
            q,
            ahead,
            count,
            np.append(turning.lower, -1.0),
            np.append(turning.upper, 1.0),
            np.append(turning.kind, STRAIGHT),
            np.append(turning.copies, 1),
            longest[None],
            np.append(self.smoother.weights, 1.0),
            SQUARES,
            nothing,
            nothing.astype(np.bool_),
            np.array(sorted(barred), dtype=np.int64).reshape(-1, 3),
            np.array([self._turned(self.asked.start), self._turned(self.asked.end)]),
            path,
            told,
        )
        return self._filled(made, keys, path, told), path

    def _turned(self, q: Array | None) -> int:
        return -1 if q is None else self.turning.turns_of(self.turning.off_ends(q))

    def _filled(self, made: Tracks, keys: Indices, path: Indices, told: Array) -> Array:
        """Along each branch, and sideways to the next evenly over all poses in between."""
        total, rows = self.turning.total, []
        answers, turns = path // total, path % total
        chosen = np.array([nodes[a] for nodes, a in zip(made.nodes, answers, strict=True)])
        values = self.turning.node_values(chosen, turns)
        for k in range(len(made.ahead)):
            ways, _ = self.follow(chosen[k : k + 1], int(keys[k]), int(keys[k + 1]))
            way = ways[:, 0] + (values[k] - chosen[k])
            if not told[k + 1]:
                sideways = self.turning.step(values[k + 1] - way[-1])
                way = way + np.linspace(0, 1, len(way))[:, None] * sideways
            rows.append(way[:-1])
        return self.turning.unwrapped(np.concatenate([*rows, values[-1:]]))


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
        _smoother(asked).settle(row, np.ascontiguousarray(goal.targets[:1]))
        round_trip = replace(asked, problem=around, longest=longest, start=row[0], end=row[0], closed=False)
        way = _open_way(round_trip, _silent)
        if best is None or _faults(round_trip, way) < _faults(round_trip, best):
            best = way
    assert best is not None
    gaps = Turning(asked.problem.chain).way(np.diff(best, axis=0))
    return best[:-1], np.flatnonzero((np.abs(gaps) > longest).any(axis=1))


def _silent(done: int) -> None:
    pass


def _smoother(asked: Asked) -> Smoother:
    weights = asked.weights if asked.velocity is None else asked.weights / asked.velocity
    return Smoother(asked.problem, weights / weights.max(), asked.valid)


def _open_way(asked: Asked, advance: Advance) -> Array:
    """The better of two attempts, the second with more samples, if the first breaks."""
    best: Array | None = None
    for attempt in ATTEMPTS:
        q = _attempt(asked, attempt, advance if best is None else _silent)
        if best is None or _faults(asked, q) < _faults(asked, best):
            best = q
        if not _faults(asked, best)[0]:
            break
    assert best is not None
    return best


def _faults(asked: Asked, q: Array) -> tuple[int, float]:
    """Breaks, steps that are not free among them, and the sum of the squared steps."""
    whole = unbroken(asked, q)
    if asked.valid is not None:
        whole[whole] = asked.valid.free_ways(q[:-1][whole], q[1:][whole])
    return int((~whole).sum()), float((np.diff(q, axis=0) ** 2).sum())


def _best_free(sampler: Sampler, made: Tracks, keys: Indices, fixed: Flags) -> Array:
    """The best way through tracks, every pose on its target, free in the scene if that is found in some tries."""
    asked, barred, best = sampler.asked, set[tuple[int, int, int]](), None
    for _ in range(TRIES):
        q, path = sampler.best(made, keys, barred)
        if asked.start is not None:
            q[0] = asked.start
        if asked.end is not None:
            q[-1] = asked.end + sampler.turning.whole_turns(q[-1] - asked.end)
        moved = q.copy()
        sampler.smoother.onto(moved, sampler.rows)
        moved[fixed] = q[fixed]
        if best is None or _faults(asked, moved) < _faults(asked, best):
            best = moved
        if asked.valid is None:
            break
        hits = np.flatnonzero(~asked.valid.free_ways(moved[:-1], moved[1:]))
        layers = np.unique(np.searchsorted(keys, hits, side="right") - 1).tolist()
        more = {(k, int(path[k]), int(path[k + 1])) for k in layers} - barred
        if not more:
            break
        barred |= more
    assert best is not None
    return best


def _attempt(asked: Asked, attempt: tuple[int, int, int, int], advance: Advance) -> Array:
    every, count, fresh, most = attempt
    sampler = Sampler(asked)
    smoother = sampler.smoother
    keys = layers_of(asked.problem, every)
    targets = sampler.rows
    fixed = np.zeros(len(targets), dtype=np.bool_)
    fixed[0], fixed[-1] = asked.start is not None, asked.end is not None
    q = _best_free(sampler, sampler.tracks(keys, count, fresh, most, advance), keys, fixed)
    for passes, power in PASSES:
        q = smoother.smooth(q, targets, passes, fixed, power)
        if unbroken(asked, q).all():
            break
    jumps = np.flatnonzero(~unbroken(asked, q))
    if not len(jumps):
        return q
    # A jump pulls at both sides of it: each stretch between two is smoothed by itself.
    cuts = [0, *(int(i) + 1 for i in jumps), len(q)]
    for a, b in itertools.pairwise(cuts):
        part = np.ascontiguousarray(targets[a:b])
        for passes, power in PASSES:
            q[a:b] = smoother.smooth(q[a:b], part, passes, fixed[a:b], power)
    return q
