"""One search finished by another: composition by wrapping."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from kinseek.problem import Problem
from kinseek.solution import Solution

from .base import Solver
from .coordinate_descent import CoordinateDescent
from .divide_and_conquer import DivideAndConquer


@dataclass(frozen=True)
class Polished:
    """Start the second search where the first one ends; the better of the two answers counts."""

    search: Solver = field(
        default_factory=lambda: DivideAndConquer(branching_factor=10**6, breadth=2, beam=16, children=2)
    )
    finish: Solver = CoordinateDescent()

    def solve(self, problem: Problem) -> Solution:
        """Answer by both searches in turn."""
        first = self.search.solve(problem)
        last = self.finish.solve(replace(problem, near=first.q))
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
        if not problem.goal.shape:
            merged = {name: value.item() for name, value in merged.items()}
        return replace(last, q=np.where(pick[..., None], first.q, last.q), **merged)
