"""Joint values at which a lost pose can be reached again."""

from __future__ import annotations

from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import index_of
from kinseek.kernels.atlas.near import solve_goal
from kinseek.kernels.paths.servo import State
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.support.transforms import rotation_vectors

from .joints import Turning

Array = NDArray[np.float64]

SPREAD = 60
"""Solutions that are examined when a redundant arm looks for another branch."""

ELSEWHERE = 0.5
"""Another branch differs by more than this from given joint values, in some joint [rad or m]. Not examined further."""

AWAY = (1e-3, 1e-2)
"""The hand has lost its pose if its error exceeds these values [m], [rad]. A target that moves by less rests."""

RETRY = 0.05
"""Time between two attempts to reach a lost pose again [s]. Not examined further."""

RESTS = (0.2, 0.4)
"""If a lost target has rested so long [s], any branch is taken: of an arm that is held, and of one that lags. Not examined
further."""


AGAIN = 1.0
"""A target that rests and was not reached after that is looked for again after this time [s]."""

ROUNDING = 1e-9
"""Of times [s]."""


class Recovery:
    """What is known of a lost pose, and a search for it beside the loop: it takes milliseconds if a pose is out of reach."""

    def __init__(self, problem: Problem, turning: Turning, own: slice) -> None:
        """Begin without a lost pose.

        Args:
            problem: The arm, and the goal with any target.
            turning: The joints.
            own: Those of the arm among all, which decide what is another branch.
        """
        self._problem, self._turning, self._own = problem, turning, own
        self.forget()

    def forget(self) -> None:
        """Begin again: a pose was reached, or no pose is tracked."""
        self.lost_for = 0.0
        """Time since a pose was lost [s]."""
        self._due, self._gap = RETRY, RETRY
        self._was_unreachable = False
        self._search: _Search | None = None
        self._searched, self._since, self._rest = 0.0, 0.0, np.eye(4)

    def is_due(self, h: float) -> bool:
        """Count a period of duration h with a lost pose, and return whether it is time to call `solutions`."""
        self.lost_for += h
        if self.lost_for < self._due - ROUNDING:
            return False
        self._due, self._gap = self.lost_for + RETRY, max(RETRY, h)
        return True

    def solutions(self, target: Array, state: State, lags: bool) -> Array:
        """Return what the last search has found, (k, n), none if the arm should stay, and begin another search.

        What a search finds also shows whether a pose was out of reach, which matters even while the arm only lags.

        Args:
            target: As kernels take it, (4, 4).
            state: Of the tracker.
            lags: Whether the arm is on its way, as fast as it may.
        """
        rested = self._rested(target)
        rests = rested >= RESTS[lags] - ROUNDING
        found = np.zeros((0, len(state.now)))
        if self._search is not None:
            found = self._search.result()
            self._was_unreachable |= not len(found)
            if not rests:
                far = np.abs(self._turning.step(found - state.reached)[:, self._own]).max(axis=1) > ELSEWHERE
                found = found[np.full(len(found), not lags) & (~far | self._was_unreachable)]
        # The next call may find that the target rests.
        rests = rested + self._gap >= min(RESTS) - ROUNDING
        near = state.now if rests or self._was_unreachable else state.reached
        self._search = None
        if rested <= max(RESTS) + ROUNDING or self.lost_for >= self._searched + AGAIN:
            self._searched = self.lost_for
            self._search = _Search(self._problem, target[:3].copy(), near.copy(), rests)
        return found

    def _rested(self, target: Array) -> float:
        """Return for how long a target, (4, 4), has been at rest when it was looked at [s]."""
        (turn,) = rotation_vectors((target[:3, :3] @ self._rest[:3, :3].T)[None])
        if is_away(float(np.linalg.norm(target[:3, 3] - self._rest[:3, 3])), float(np.linalg.norm(turn))):
            self._rest, self._since = target.copy(), self.lost_for
        return self.lost_for - self._since


def is_away(position: float, orientation: float) -> bool:
    """Return whether the hand has lost its pose."""
    return position > AWAY[0] or orientation > AWAY[1]


class _Search:
    """Solutions of a pose, the one nearest to joint values first, found in a thread; kernels release the GIL."""

    def __init__(self, problem: Problem, target: Array, near: Array, anywhere: bool) -> None:
        """Begin; the target is (3, 4), as kernels take it, the joint values are (n,); `anywhere` for others as well."""
        self._q = np.zeros((0, len(near)))

        def run() -> None:
            q, tolerances = np.empty(len(near)), tolerances_of(problem.goal)
            address = atlas_of(problem.chain, problem.goal).address
            *_, success = solve_goal(address, tolerances, target, near, True, q)
            found = q[None] if success else self._q
            if success and anywhere:
                found = np.concatenate([found, solutions_of(problem, target)])
            self._q = found

        self._thread: Thread | None = Thread(target=run, daemon=True)
        self._thread.start()

    def __getstate__(self) -> dict[str, Any]:
        """Return what was found, for pickles and copies."""
        return {"_q": self.result(), "_thread": None}

    def result(self) -> Array:
        """Wait for the solutions and return them, (k, n); none if the pose is out of reach."""
        if self._thread is not None:
            self._thread.join()
        return self._q


def solutions_of(problem: Problem, target: Array) -> Array:
    """Return the solutions of a pose, (3, 4), or some of those of a redundant arm, (k, n)."""
    index = index_of(problem)
    return index.solutions(tolerances_of(problem.goal), target, SPREAD if index.freedom else 0)
