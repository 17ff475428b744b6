"""Rows of answers, as the kernels write them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import Array
from kinseek.problem import Problem
from kinseek.solution import Solution, reported


def batch_solution(problem: Problem, results: Array, done: NDArray[np.bool_]) -> Solution:
    """Create a solution from rows that the kernels write, (k, n + 4).

    Rows that are not done, by the flags (k,), get the start of a search.
    """
    goal, dof = problem.goal, problem.chain.dof
    late = ~done
    if late.any():
        starts = np.broadcast_to(problem.start, (*goal.shape, dof)).reshape(-1, dof)[late]
        measured = goal.at(goal.target.reshape(-1, 4, 4)[late]).measure(problem.arrays, starts)
        results[late] = np.column_stack([starts, measured, np.zeros(len(starts))])
    work = np.zeros((len(results), 3), dtype=np.int64)
    work[:, 0] = results[:, dof + 3]
    return reported(problem, results[:, :dof].copy(), results[:, dof : dof + 3], work, late)
