"""Branches of isolated solutions, followed from pose to pose.

Limits are widened to a whole turn, so that a branch that leaves the limits and comes back is still the same branch. Without
limits, branches appear and vanish only at singularities. If a branch ends between two poses whose solutions are known, all
branches are found at the pose where it was lost, and new ones are followed in both directions. If two branches end there
together, they met and vanished, and no search is made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import BranchIndex, index_of
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.trace import JOINED, TAKEN, Leg, part_ways, trace
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.support.turns import shortest

from .joints import opened

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SAME = 1e-3
"""Solutions closer than this in every joint [rad or m] belong to one branch."""

LEAPS = 0.5
"""Largest joint motion of a branch from pose to pose [rad or m], or the caller's largest step if that is larger."""

FOLD = 1.0
"""Two branches that vanish together between two poses are closer than this in every joint [rad or m]."""


@dataclass
class Piece:
    """One branch over poses first … first + len(q) - 1 of an interval."""

    first: int
    q: Array

    def covers(self, i: int) -> bool:
        """Return whether the branch has a solution of pose i."""
        return self.first <= i < self.first + len(self.q)


class Loss(NamedTuple):
    """The place where a branch could not be followed any farther."""

    target: int
    """The first target for which the branch has no solution."""
    way: int
    """1 if the branch was followed forward, -1 if backward."""
    q: Array
    """The last solution of the branch, (n,)."""
    taken: bool
    """Whether the branch ran into another branch."""


class Follower:
    """Find and follow the branches of one arm and one kind of goal along targets."""

    def __init__(self, problem: Problem, longest: Array) -> None:
        """Build what the arm needs once.

        Args:
            problem: The arm and its targets.
            longest: Largest step of each joint from pose to pose, (n,).
        """
        wide = Problem(opened(problem.chain), problem.goal)
        self.index: BranchIndex = index_of(wide)
        if self.index.freedom:
            # An arm that is almost singular may count as redundant only with widened limits, so its own limits are kept.
            wide, self.index = problem, index_of(problem)
        self.tolerances = tolerances_of(problem.goal)
        self.rows = np.ascontiguousarray(problem.goal.targets)
        self.longest = np.maximum(longest * 1.5, LEAPS)
        self.dof = problem.chain.dof
        self._turns = (wide.chain.periodic & wide.chain.turns).astype(np.int64)

    def all_at(self, i: int) -> Array:
        """Return all branches at target i, (k, n)."""
        return self.index.solutions(self.tolerances, self.rows[i])

    def unknown(self, found: Array, known: Array) -> Array:
        """Return the solutions of `found`, (k, n), that are not in `known`, (m, n)."""
        if not len(known):
            return found
        half = (found[:, None] - known[None]) / 2
        # The sine of half the difference ignores full turns.
        gap = np.where(self._turns, np.sin(half), half)
        return np.asarray(found[~(np.abs(gap).max(axis=-1) < SAME / 2).any(axis=1)])

    def follow(self, solutions: Array, begin: int, end: int) -> list[Piece]:
        """Follow solutions of target `begin`, (k, n), to target `end`, forward or backward."""
        low = min(begin, end)
        rows, spans = self._traced(solutions, begin, end)
        return [Piece(low + one, rows[one : last + 1, k]) for k, (one, last) in enumerate(spans.tolist())]

    def _traced(self, solutions: Array, begin: int, end: int) -> tuple[Array, Indices]:
        """Like `follow`, but return one array of joint values, (rows, k, n), from the lower target on.

        The second return value is the first and the last row of each branch, (k, 2).
        """
        low, high = min(begin, end), max(begin, end)
        begin, end, targets = begin - low, end - low, self.rows[low : high + 1]
        parts, spans = [], np.full((len(solutions), 2), begin)
        for first in range(0, len(solutions), LANES):
            some = solutions[first : first + LANES]
            q, ends = np.zeros((len(targets), LANES, self.dof)), np.zeros(LANES, dtype=np.int64)
            q[begin, : len(some)] = some
            job = self.index.fine.job(self.tolerances)
            trace(job, targets, Leg(begin, end, len(some)), self.longest, q, ends)
            parts.append(q[:, : len(some)])
            spans[first : first + LANES, 0 if end < begin else 1] = ends[: len(some)]
        return np.concatenate(parts, axis=1) if parts else np.zeros((len(targets), 0, self.dof)), spans

    def extend(self, pieces: list[Piece], solutions: Array, begin: int, end: int) -> list[Loss]:
        """Follow solutions that are not known yet from target to target, as long as they stay on their branches.

        Args:
            pieces: Known pieces of branches; the pieces that are found are appended.
            solutions: Solutions of target `begin`, (k, n).
            begin: Index of the target where they are.
            end: Index of the target up to which they are followed, forward or backward.

        Returns:
            The branches that were lost on the way.
        """
        if not len(solutions):
            return []
        low, way, lost = min(begin, end), 1 if end >= begin else -1, list[Loss]()
        rows, spans = self._traced(solutions, begin, end)
        known, known_spans = _table(pieces, low, max(begin, end), self.dof)
        rows, spans = np.concatenate([known, rows], axis=1), np.concatenate([known_spans, spans])
        became = np.zeros(len(spans), dtype=np.int64)
        part_ways(rows, len(known_spans), way, self._turns, spans, became)
        for k in range(len(known_spans), len(spans)):
            one, last = spans[k].tolist()
            pieces.append(Piece(low + one, rows[one : last + 1, k]))
            ended = low + (last if way > 0 else one)
            if ended != end and became[k] != JOINED:
                lost.append(Loss(ended + way, way, rows[ended - low, k], bool(became[k] == TAKEN)))
        return lost

    def between(self, begin: int, end: int, at_begin: Array, at_end: Array) -> list[Piece]:
        """Return all branches between two targets at which all solutions are known, both included."""
        pieces: list[Piece] = []
        lost = self.extend(pieces, at_begin, begin, end)
        lost += self.extend(pieces, self.unknown(at_end, _solutions_at(pieces, end, self.dof)), end, begin)
        done: set[int] = set()
        while doubtful := {one.target for one in lost} - done:
            i = min(doubtful)
            done.add(i)
            if self.vanish(i, lost):
                continue
            fresh = self.unknown(self.all_at(i), _solutions_at(pieces, i, self.dof))
            lost += self.extend(pieces, fresh, i, end) if i < end else []
            lost += self.extend(pieces, fresh, i, begin) if i > begin else []
        return pieces

    def vanish(self, i: int, lost: list[Loss]) -> bool:
        """Return whether the branches lost at a target are pairs that met and vanished, so that nothing continues there.

        Two branches that meet at a fold end together and close together, and no branch arrives from the other side.
        """
        here = [one for one in lost if one.target == i]
        other = -here[0].way
        if any(one.taken for one in here) or any(
            one.way == other and abs(one.target - i) <= 1 for one in lost
        ):
            return False
        rows = np.array([one.q for one in here])
        while len(rows) > 1:
            gap = rows[1:] - rows[0]
            gap = np.abs(np.where(self._turns, shortest(gap), gap)).max(axis=1)
            if gap.min() >= FOLD:
                return False
            rows = np.delete(rows[1:], gap.argmin(), axis=0)
        return not len(rows)


def _solutions_at(pieces: list[Piece], i: int, dof: int) -> Array:
    """Return the solutions that pieces have for pose i, (k, n)."""
    rows = [p.q[i - p.first] for p in pieces if p.covers(i)]
    return np.array(rows).reshape(-1, dof)


def _table(pieces: list[Piece], low: int, high: int, dof: int) -> tuple[Array, Indices]:
    """Tabulate pieces for targets low … high, (high - low + 1, k, n), and the first and last target of each, (k, 2)."""
    there = [piece for piece in pieces if piece.first <= high and piece.first + len(piece.q) > low]
    rows = np.zeros((high - low + 1, len(there), dof))
    spans = np.zeros((len(there), 2), dtype=np.int64)
    for k, piece in enumerate(there):
        first, end = max(piece.first, low), min(piece.first + len(piece.q), high + 1)
        rows[first - low : end - low, k] = piece.q[first - piece.first : end - piece.first]
        spans[k] = first - low, end - 1 - low
    return rows, spans
