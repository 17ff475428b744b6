"""The method that every search has, and the loop over a batch that searches share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.solution import Solution, conclude, with_traces
from kinseek.support.deadline import Deadline
from kinseek.support.validation import NO_BOUND, as_integer
from kinseek.trace import Trace

from .threads import Watch, progress_bar, unwatched


def require_whole(solver: object, name: str, least: int, most: int = NO_BOUND) -> None:
    """Convert a parameter of a frozen solver to an `int` in a range, and store it.

    Raises:
        InvalidSolver: The parameter is not a whole number in this range.
    """
    object.__setattr__(solver, name, as_integer(name, getattr(solver, name), least, most))


class Solver(Protocol):
    """A search: a frozen dataclass of its parameters, with one method."""

    def solve(self, problem: Problem) -> Solution:
        """Solve a problem, or each target of a batch."""
        ...


class Found(NamedTuple):
    """Result of a search for one target, before it is evaluated."""

    q: NDArray[np.float64]
    evaluations: int
    nodes_created: int = 0
    nodes_expanded: int = 0
    out_of_time: bool = False
    trace: Trace | None = None
    """Trace of the search, if the problem requests it; see `solvers.recording`."""


def watch_each(
    problem: Problem,
    search: Callable[[Problem, Deadline, Callable[[int], object]], Found],
    work: int,
    show_progress: bool,
    deadline: Deadline | None = None,
) -> Solution:
    """Do the same as `solve_each`, with a progress bar if `show_progress` is set.

    Args:
        problem: One target or a batch.
        search: Solves one target, and reports to the watch how much of its work is done.
        work: Most work for one target, in any unit.
        show_progress: Whether to show the progress bar.
        deadline: When to end.
    """
    if not show_progress:
        return solve_each(problem, lambda one, until: search(one, until, unwatched), deadline)
    with progress_bar(show_progress, work * len(problem.goal.targets)) as advance:
        watch = Watch(advance, work)

        def with_watch(one: Problem, deadline: Deadline) -> Found:
            found = search(one, deadline, watch)
            watch.end()
            return found

        return solve_each(problem, with_watch, deadline)


def solve_each(
    problem: Problem, search: Callable[[Problem, Deadline], Found], deadline: Deadline | None = None
) -> Solution:
    """Run a search on every target of a batch, one after the other, and evaluate the solutions.

    If the time is up, the remaining targets get the start of their search.
    """
    deadline = deadline or Deadline(problem.time_limit)
    found, rows = [], []
    for one in problem.each():
        found.append(Found(one.start, 0, out_of_time=True) if deadline.passed else search(one, deadline))
        rows.append(one.placed(found[-1].q))
    q = np.array(rows).reshape(-1, problem.mechanism.dof)
    work = np.array([f[1:4] for f in found], dtype=np.int64).reshape(-1, 3)
    solution = conclude(problem, q, work, np.array([f.out_of_time for f in found], dtype=bool))
    if not problem.trace:
        return solution
    chain, late = problem.mechanism, "The time limit passed before this search began."
    none = Trace("no search", chain.joint_names, chain.kinds, (), (late,))
    traces = [none if f.out_of_time and not f.evaluations else f.trace for f in found]
    return with_traces(solution, traces)
