"""The atlas: sort the search space once, then solve a goal in microseconds (the default search).

The paper's divide and conquer assumes that the search space is sorted, but forward kinematics is not. The atlas sorts it:
see docs/atlas.md for the idea, and `kernels.atlas.one_goal` for the steps of one goal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kinseek.goal import Goal
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.batch import solve_many, solve_some
from kinseek.kernels.atlas.lanes import LANES
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import Mechanism
from kinseek.solution import Solution
from kinseek.solvers.base import Found, require_whole, solve_each
from kinseek.solvers.recording import Recorder, require_room
from kinseek.solvers.threads import GoOn, parallel_for, progress_bar
from kinseek.solvers.traits import Near, Traits
from kinseek.support.deadline import Deadline

from .index import SAMPLES, atlas_of, tolerance_numbers, tolerances_of
from .rows import batch_solution

CHUNK = 1024
"""Targets that a thread takes at a time: some milliseconds, so that Ctrl-C takes effect soon."""


WIDE = 1e-4
"""Tolerance from which on a missed goal is searched again, see `Atlas._retry_missed`: [rad], or relative to the length of
the arm. Below it two tolerances hardly leave weights a choice. Not examined further."""


_PIECE = 16
"""Targets that are solved in one piece, one after the other: some milliseconds if they are hard."""


@dataclass(frozen=True)
class Atlas:
    """Look the goal up among sorted samples of the arm, and refine the nearest.

    Raises:
        InvalidSolver: A parameter is out of its range.
    """

    traits: ClassVar[Traits] = Traits(
        source="kinseek, the default",
        finds="a solution in nearly all cases, if one exists",
        work="a few to some tens of FK evaluations, after one table per arm",
        near=Near.NEAREST,
        ranges=True,
    )

    samples: int = SAMPLES
    """Number of samples of the middle joints. More samples cost memory and time to build, and start closer to the goal."""
    threads: int | None = None
    """Threads for a batch; None uses every core. The solutions have the same bits. Black-box kinematics are called by one
    thread."""
    progress: bool = False
    """Show a progress bar."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        require_whole(self, "samples", 8, 2**24)
        if self.threads is not None:
            require_whole(self, "threads", 1)

    def solve(self, problem: Problem) -> Solution:
        """Refine the nearest sample, then the next ones if it fails; if all fail, return the best pose found."""
        goal, chain = problem.goal, problem.axes
        if chain is None:
            return self._solve_black_box(problem.mechanism, problem)
        if goal.form.ranges:
            from .ranges import solve_ranges

            self._require_room(problem)
            return self._report(solve_ranges(self, problem))
        self._require_room(problem)
        deadline = Deadline(problem.time_limit)
        index = atlas_of(chain, goal, self.samples)
        tolerances = tolerances_of(goal, problem.budget, problem.nearest)
        targets, near = goal.targets, self._starts(problem)
        results, done = np.empty((len(targets), chain.dof + 4)), np.zeros(len(targets), dtype=bool)

        def one_by_one(some: Indices, go_on: GoOn) -> None:
            for first in range(0, len(some), _PIECE):
                if not go_on():
                    return
                last = min(first + _PIECE, len(some))
                piece = some[first:last]
                solve_some(index.handle, tolerances, targets, near, results, piece, LANES)
                done[piece] = True

        def in_lanes(begin: int, end: int, go_on: GoOn) -> None:
            left = np.empty(end - begin, dtype=np.int64)
            count = solve_many(index.handle, tolerances, targets, results, left, begin, end, LANES)
            done[begin:end] = True
            if count:
                done[left[:count]] = False
                one_by_one(left[:count], go_on)

        # A trace belongs to one target, and so do the evaluations that it counts.
        alone = problem.budget is not None or len(targets) == 1 or problem.trace
        if problem.near is None and alone:
            one_by_one(np.arange(len(targets)), lambda: not deadline.passed)
        elif problem.near is None:
            self.parallel_for(in_lanes, len(targets), deadline)
        else:
            self.parallel_for(
                lambda begin, end, go_on: one_by_one(np.arange(begin, end), go_on), len(targets), deadline
            )
        self._retry_missed(problem, index.handle, results, done, deadline)
        return self._report(batch_solution(problem, results, done))

    def _retry_missed(
        self, problem: Problem, handle: Indices, results: Array, done: NDArray[np.bool_], deadline: Deadline
    ) -> None:
        """Search missed goals once more with equally weighted tolerances.

        This is done if one tolerance is wide enough to make a difference. The search keeps what is best by the goal's
        weights. The weights define which pose is nearest, but must not decide whether a goal is reached: a pose well within
        a wide tolerance may have a larger weighted error than one that misses the other tolerance.
        """
        goal, dof = problem.goal, problem.chain.dof
        if problem.budget is not None:
            return
        missed = np.flatnonzero(done & ~goal.met(results[:, dof:]))
        if not len(missed) or not retries_missed(goal, problem.chain):
            return
        missed_goal, near = goal.at(goal.target.reshape(-1, 4, 4)[missed]), self._starts(problem)
        tolerances = tolerance_numbers(
            goal.position_tolerance,
            goal.orientation_tolerance,
            1.0 / goal.position_tolerance,
            2.0 / goal.orientation_tolerance**2 * (goal.axis_weights > 0.0),
            nearest=problem.nearest,
        )
        found, near = np.full((len(missed), results.shape[1]), np.inf), near[missed] if len(near) else near

        def retry(begin: int, end: int, go_on: GoOn) -> None:
            for k in range(begin, end):
                if not go_on():
                    return
                solve_some(handle, tolerances, missed_goal.targets, near, found, np.array([k]), LANES)
                results[missed[k], -1] += found[k, -1]

        parallel_for(retry, len(missed), _PIECE, self.threads, deadline)
        better = np.flatnonzero(goal.met(found[:, dof:]))
        if len(better):
            measured = missed_goal.at(missed_goal.target[better]).measure(problem.arrays, found[better, :dof])
            results[missed[better], :-1] = np.column_stack([found[better, :dof], measured])

    @staticmethod
    def _starts(problem: Problem) -> Array:
        """Return the joint values that each solution shall be near to, (k, n), or none, (0, n)."""
        dof = problem.chain.dof
        if problem.near is None:
            return np.empty((0, dof))
        return np.ascontiguousarray(np.broadcast_to(problem.near, (*problem.goal.shape, dof))).reshape(
            -1, dof
        )

    @staticmethod
    def _require_room(problem: Problem) -> None:
        if problem.trace:
            from .tracing import MOST_PASSES

            require_room(problem, MOST_PASSES)

    def _report(self, solution: Solution) -> Solution:
        """Add the trace to the solution if it is requested."""
        problem = solution.problem
        if not problem.trace:
            return solution
        from .tracing import traced

        return traced(solution, atlas_of(problem.chain, problem.goal, self.samples))

    def _solve_black_box(self, box: Mechanism, problem: Problem) -> Solution:
        from kinseek.solvers.black_box.atlas import MOST_PASSES, solve_target

        require_room(problem, MOST_PASSES)
        with progress_bar(self.progress, len(problem.goal.targets)) as advance:

            def search(one: Problem, deadline: Deadline) -> Found:
                recorder = Recorder(one, self) if problem.trace else None
                found = solve_target(box, one, self.samples, deadline, recorder)
                advance(1)
                if recorder is None:
                    return found
                recorder.add_rest("nearest pose", found)
                recorder.note_end(found)
                return found._replace(trace=recorder.finish())

            return solve_each(problem, search)

    def parallel_for(self, work: Callable[[int, int, GoOn], None], count: int, deadline: Deadline) -> None:
        """Run the work for all targets, on all threads, with a progress bar; see `threads.parallel_for`."""
        # The same, without overhead as large as a target's work.
        if 0 < count <= CHUNK and not self.progress:
            if not deadline.passed:
                work(0, count, lambda: not deadline.passed)
            return
        with progress_bar(self.progress, count) as advance:
            parallel_for(work, count, CHUNK, self.threads, deadline, advance)


def retries_missed(goal: Goal, chain: SerialChain) -> bool:
    """Return whether both tolerances of a goal are above 0 and one is so wide that missed goals are searched again."""
    position, orientation = goal.position_tolerance, goal.orientation_tolerance
    both = 0.0 < position < math.inf and 0.0 < orientation < math.inf
    return both and max(position / chain.length, orientation) >= WIDE
