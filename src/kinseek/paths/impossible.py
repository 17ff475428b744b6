"""Prove that no continuous motion inside the limits leads from one pose of a path to another.

Take two poses i < j whose sets of solutions are known and proved to be complete. Each solution is followed towards the other
pose, tube after tube. An arm at a solution of pose i that moves on continuously has to stay on its branch. If the branch
leaves the limits, the motion ends there. If it arrives, it arrives at one solution of pose j, and no other motion leads
there. A branch that is not decided, e.g. at a singularity, may lead to every solution of pose j whose origin is not proved.
So the solutions that can be reached at pose i give a superset of those that can be reached at pose j. If this set is empty,
no motion exists.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import freedom
from kinseek.kernels.paths.steps import INSIDE, LEAVES, OUTSIDE, SOMEWHERE
from kinseek.problem import Problem
from kinseek.proof.root_isolation import isolate
from kinseek.robots.chain import SerialChain
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN

from .branches import Follower, Piece
from .certify import prove_rows
from .joints import Turning
from .path import Path, intervals

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

EVERY = 16
"""Poses from one complete set of solutions to the next; it is halved where a branch stays undecided."""

TIGHT = 1e-9
"""Tolerances of the completeness proofs [m], [rad]: only solutions that reach the poses exactly are followed."""

RIM = 1e-5
"""The tubes contain all solutions within this distance of the followed ones [rad] or [m]."""

BOXES, MOST = 20_000, 500_000
"""Most boxes for proving that the solutions of one pose are complete, and for all poses of a path."""

ROOM = 1e-6
"""The limits are widened by this before the completeness proofs, so that solutions at a limit are followed as well."""


@dataclass(frozen=True)
class CompleteSet:
    """All solutions of a pose inside the limits, modulo whole turns."""

    q: Array
    """Solutions, (k, n)."""
    distance: Array
    """Upper bound of the distance between each solution and the exact one, (k, n)."""


@dataclass(frozen=True)
class Passage:
    """Connections from the solutions of one pose to those of a later one."""

    joined: Flags
    """Flags (k, m): a proved branch leads from the first solution to the second."""
    open_forward: Flags
    """Flags of solutions of the first pose whose destination is not decided, (k,)."""
    open_backward: Flags
    """Flags of solutions of the later pose whose origin is not decided, (m,)."""


def impossible_pairs(
    problem: Problem, path: Path, deadline: Deadline | None = None
) -> tuple[tuple[int, int], ...]:
    """Return pairs (i, j) of poses that no continuous motion joins, in order, as many as were found; see `PathProof`.

    Only isolated solutions are examined, and only intervals of reached poses that contain a break. In other intervals the
    path itself leads from pose to pose, though the hand may leave the straight motion.
    """
    if freedom(problem) > 0 or problem.chain.dof != problem.goal.form.constraints:
        return ()
    found: list[tuple[int, int]] = []
    search = Search(problem, deadline)
    for first, last in intervals(path.reached):
        if ((path.breaks >= first) & (path.breaks < last)).any():
            found += search.intervals(first, last)
    return tuple((i, j) for i, j in found if ((path.breaks >= i) & (path.breaks < j)).any())


class Search:
    """Follow all solutions of one arm along one path."""

    def __init__(self, problem: Problem, deadline: Deadline | None = None) -> None:
        """Build what is needed once; after the deadline nothing more is decided."""
        self.deadline = Deadline() if deadline is None else deadline
        self.problem, turning = problem, Turning(problem.chain)
        # A joint with room for more than one turn is treated as one without limits. This can only enlarge the reachable set.
        free = turning.copies > 1
        lower, upper = turning.open_lower - ROOM, turning.open_upper + ROOM
        self.limits = np.where(free, -np.inf, lower), np.where(free, np.inf, upper)
        self.follower = Follower(problem, np.zeros(problem.chain.dof))
        goal = replace(problem.goal, position_tolerance=TIGHT, orientation_tolerance=TIGHT)
        self.tight = Problem(_roomier(problem.chain), goal)
        self.left = MOST
        self._known: dict[int, CompleteSet | None] = {}

    def step(self, gap: Array) -> Array:
        """Differences of joint values, (k, n), without full turns of joints that are compared modulo whole turns."""
        return np.where(self.problem.chain.periodic, gap - TURN * np.round(gap / TURN), gap)

    def intervals(self, first: int, last: int) -> list[tuple[int, int]]:
        """Return all impossible pairs between two poses: the search for the next begins where one ends."""
        found, i = [], first
        while i < last and not self.deadline.passed:
            begin, solutions = i, self.solutions(i)
            # A pose without a complete set of solutions cannot begin an interval; the next one is tried.
            i += solutions is None
            reached = np.ones(0 if solutions is None else len(solutions.q), dtype=np.bool_)
            while i < last and reached.any() and not self.deadline.passed:
                next_pose = self.next_complete(i, min(i + EVERY, last))
                if next_pose is None:
                    i += 1
                    break
                i, reached = self.advance(i, next_pose, reached)
            if solutions is not None and not reached.any():
                found.append((begin, i))
        return found

    def solutions(self, i: int) -> CompleteSet | None:
        """Return all solutions of pose i; None if they are not proved complete, or the time is up."""
        if i not in self._known and self.left > 0 and not self.deadline.passed:
            one = Problem(self.tight.mechanism, self.tight.goal.at(self.tight.goal.target[i]))
            found = isolate(one, budget=min(BOXES, self.left), deadline=self.deadline)
            self.left -= found.boxes
            good = found.complete and bool((found.distance <= RIM / 2).all())
            self._known[i] = CompleteSet(found.q, found.distance) if good else None
        return self._known.get(i)

    def next_complete(self, i: int, j: int) -> int | None:
        """Return the last pose in (i, j] whose solutions are all known; None if there is none."""
        while j > i and self.solutions(j) is None:
            j = (i + j) // 2
        return j if j > i else None

    def advance(self, i: int, j: int, reached: Flags) -> tuple[int, Flags]:
        """Return the pose that was reached, j or the first with an empty set, and flags of its reachable solutions."""
        if self.deadline.passed and (solutions := self.solutions(j)) is not None:
            # Nothing more is decided: every solution counts as reachable.
            return j, np.ones(len(solutions.q), dtype=np.bool_)
        passage = self.passage(i, j)
        after: Flags = np.asarray((passage.joined & reached[:, None]).any(axis=0))
        undecided = bool((passage.open_forward & reached).any())
        if undecided:
            after |= passage.open_backward
        # A branch may be undecided only because the distance is long; half of it may be decided.
        half = self.next_complete(i, (i + j) // 2)
        if half is not None and (undecided or not after.any()):
            at, between = self.advance(i, half, reached)
            return self.advance(at, j, between) if between.any() else (at, between)
        return j, after

    def passage(self, i: int, j: int) -> Passage:
        """Follow all solutions of pose i to pose j, and those of j that are not reached from i back to i."""
        begin, end = self.solutions(i), self.solutions(j)
        assert begin is not None
        assert end is not None
        joined = np.zeros((len(begin.q), len(end.q)), dtype=np.bool_)
        ended_forward, ended_backward = (
            np.zeros(len(begin.q), dtype=np.bool_),
            np.zeros(len(end.q), dtype=np.bool_),
        )
        for k, piece in enumerate(self.follower.follow(begin.q, i, j)):
            joined[k], ended_forward[k] = self.arrivals(piece, i, j, end)
        rest = np.flatnonzero(~joined.any(axis=0))
        for k, piece in zip(rest.tolist(), self.follower.follow(end.q[rest], j, i), strict=True):
            joined[:, k], ended_backward[k] = self.arrivals(piece, j, i, begin)
        return Passage(joined, ~(ended_forward | joined.any(axis=1)), ~(ended_backward | joined.any(axis=0)))

    def arrivals(self, piece: Piece, i: int, j: int, solutions: CompleteSet) -> tuple[Flags, bool]:
        """Return the solutions of pose j that a proved branch from pose i reaches, (m,), and whether it leaves the limits.

        A branch that arrives at none of the solutions is outside the limits at pose j.
        """
        nothing = np.zeros(len(solutions.q), dtype=np.bool_)
        goal, rows = self.tight.goal, np.arange(piece.first, piece.first + len(piece.q))
        proved = prove_rows(
            Problem(self.tight.mechanism, goal.at(goal.target[rows])),
            piece.q,
            np.arange(len(rows) - 1),
            keep=False,
            rims=np.full(len(rows), RIM),
            limits=self.limits,
            deadline=self.deadline,
        )
        for state in proved.state if i < j else proved.state[::-1]:
            if state == OUTSIDE or (state == LEAVES and i < j):
                return nothing, True
            if state not in (INSIDE, SOMEWHERE):
                return nothing, False
        if not piece.covers(j):
            return nothing, False
        off = np.abs(self.step(piece.q[j - piece.first] - solutions.q))
        may_be = (off <= RIM + solutions.distance).all(axis=1)
        is_sure = (off + solutions.distance <= RIM).all(axis=1)
        # The branch arrives near a solution, but the bounds do not show at which one.
        if (may_be & ~is_sure).any():
            return nothing, False
        return np.asarray(is_sure), not is_sure.any()


def _roomier(chain: SerialChain) -> SerialChain:
    """Return the arm with its limits widened by `ROOM`."""
    return chain.limited(chain.lower - ROOM, chain.upper + ROOM, chain.kinds)
