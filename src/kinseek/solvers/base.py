"""The one method that every search has, and the loop over a batch that they share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.problem import Problem
from kinseek.solution import Solution, conclude, with_traces
from kinseek.trace import Trace
from kinseek.validation import NO_BOUND, as_integer

from .threads import Watch, progress_bar, unwatched


def require_whole(solver: object, name: str, least: int, most: int = NO_BOUND) -> None:
    """Read a parameter of a frozen solver that has to be a whole number in a range, and keep it as an `int`.

    Raises:
        InvalidSolver: It is not.
    """
    object.__setattr__(solver, name, as_integer(name, getattr(solver, name), least, most))


class Solver(Protocol):
    """A search: a frozen dataclass of its parameters, with one method."""

    def solve(self, problem: Problem) -> Solution:
        """Answer a problem, or each of a batch."""
        ...


class Found(NamedTuple):
    """What a search brings back for one target, before it is judged."""

    q: NDArray[np.float64]
    evaluations: int
    nodes_created: int = 0
    nodes_expanded: int = 0
    out_of_time: bool = False
    trace: Trace | None = None
    """What the search did, if the problem asks for it; see `solvers.recording`."""


def watch_each(
    problem: Problem,
    search: Callable[[Problem, Deadline, Callable[[int], object]], Found],
    work: int,
    wanted: bool,
    deadline: Deadline | None = None,
) -> Solution:
    """Do what `solve_each` does, with a progress bar if one is wanted.

    Args:
        problem: One target or a batch.
        search: Answers one target, and tells the watch how much of its work is done.
        work: What one target takes at most, in any unit.
        wanted: Show it.
        deadline: When to end.
    """
    if not wanted:
        return solve_each(problem, lambda one, until: search(one, until, unwatched), deadline)
    with progress_bar(wanted, work * len(problem.goal.targets)) as advance:
        watch = Watch(advance, work)

        def watched(one: Problem, deadline: Deadline) -> Found:
            found = search(one, deadline, watch)
            watch.end()
            return found

        return solve_each(problem, watched, deadline)


def solve_each(
    problem: Problem, search: Callable[[Problem, Deadline], Found], deadline: Deadline | None = None
) -> Solution:
    """Run a search on every target of a batch, one after the other, and judge the answers.

    When the time is up the targets that are left get what their search would start from.
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
