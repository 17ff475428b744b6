"""The one method that every search has, and the loop over a batch that they share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.solution import Solution, conclude


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


def solve_each(problem: Problem, search: Callable[[Problem], Found]) -> Solution:
    """Run a search on every target of a batch, one after the other, and judge the answers."""
    found = [search(one) for one in problem.each()]
    q = np.array([f.q for f in found]).reshape(-1, problem.chain.dof)
    work = np.array([f[1:] for f in found], dtype=np.int64).reshape(-1, 3)
    return conclude(problem, q, work)
