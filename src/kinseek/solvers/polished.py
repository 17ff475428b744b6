"""Finish one search by another: composition of searches."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from kinseek.problem import Problem
from kinseek.solution import Solution, conclude, with_traces
from kinseek.support.deadline import Deadline
from kinseek.support.validation import arrays_equal

from .base import Solver
from .checks import as_solver
from .coordinate_descent import CoordinateDescent
from .divide_and_conquer import DivideAndConquer
from .recording import joined
from .traits import Near, Traits


@dataclass(frozen=True)
class Polished:
    """Start the second search where the first one ends; the better of the two solutions is returned.

    Each may use half of a problem's budget; the first uses at most half of a time limit.
    """

    traits: ClassVar[Traits] = Traits(
        source="kinseek",
        finds="the result of a second search that starts where the first one ends",
        work="both",
        near=Near.TURN,
        made_of=True,
    )

    search: Solver = field(
        default_factory=lambda: DivideAndConquer(branching_factor=10**6, breadth=2, beam=16, children=2)
    )
    finish: Solver = field(default_factory=CoordinateDescent)

    def __post_init__(self) -> None:
        """Check that both are searches.

        Raises:
            InvalidSolver: One is not a search.
        """
        as_solver(self.search, "search")
        as_solver(self.finish, "finish")

    def solve(self, problem: Problem) -> Solution:
        """Run both searches, one after the other."""
        budget, limit, deadline = problem.budget, problem.time_limit, Deadline(problem.time_limit)
        half, soon = None if budget is None else (budget + 1) // 2, None if limit is None else limit / 2
        part = problem if (half, soon) == (None, None) else replace(problem, budget=half, time_limit=soon)
        first = self.search.solve(part)
        # The only evaluation is spent, so nothing is left for the second search.
        if budget == 1:
            return self._report(replace(first, problem=problem), first, None)
        half = None if budget is None else budget // 2
        last = self.finish.solve(replace(problem, near=first.q, budget=half, time_limit=deadline.left))
        better = first.success | (last.weighted_error > first.weighted_error) & ~np.asarray(last.success)
        pick = np.asarray(better)
        merged = {
            name: np.where(pick, getattr(first, name), getattr(last, name))
            for name in ("success", "position_error", "orientation_error", "weighted_error")
        }
        merged |= {
            name: np.asarray(getattr(first, name) + getattr(last, name))
            for name in ("evaluations", "nodes_created", "nodes_expanded")
        }
        merged["out_of_time"] = np.asarray(first.out_of_time | last.out_of_time)
        if not problem.goal.shape:
            merged = {name: value.item() for name, value in merged.items()}
        q = np.where(pick[..., None], first.q, last.q)
        # The last search stayed near the first result, and may have left [-π, π].
        if not arrays_equal(problem.placed(q), q):
            work = [np.ravel(merged[name]) for name in ("evaluations", "nodes_created", "nodes_expanded")]
            placed = problem.placed(q).reshape(-1, q.shape[-1])
            solution = conclude(problem, placed, np.stack(work, axis=1))
            return self._report(solution, first, last)
        return self._report(replace(last, q=q, problem=problem, **merged), first, last)

    @staticmethod
    def _report(solution: Solution, first: Solution, last: Solution | None) -> Solution:
        """Combine the traces of both searches in the solution, if they were requested and kept."""
        if not solution.problem.trace:
            return solution
        lasts = [None] * len(solution.problem.goal.targets) if last is None else last.each()
        pairs = zip(solution.each(), first.each(), lasts, strict=True)
        return with_traces(solution, [joined("Polished", *each) for each in pairs])
