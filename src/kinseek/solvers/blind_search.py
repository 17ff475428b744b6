"""Blind search (Cubero 2008, as told in the paper's Sec. 1): local, and the baseline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays
from kinseek.kernels.forward import forward
from kinseek.kernels.grid import Window, make_beam, make_scratch, search_window, window_nodes
from kinseek.kernels.jit import inner, kernel
from kinseek.kernels.pose_error import errors, weighted_error
from kinseek.problem import Problem
from kinseek.solution import Solution

from .base import Found, solve_each, whole
from .nodes import require_memory


@dataclass(frozen=True)
class BlindSearch:
    """From a start, try all 3^n combinations of -Δ, 0, +Δ; take the best; shrink Δ when none helps.

    Only works from a start close to the goal, as its author says. Each step costs 3^n FK evaluations.

    Raises:
        InvalidSolver: A parameter out of its range.
    """

    step: float = 0.1
    """Δ at the start, [rad] or [m]."""
    shrink: float = 0.5
    """Factor on Δ when no combination helps."""
    smallest_step: float = 1e-9
    """Stop below this Δ, [rad] or [m]."""
    most_steps: int = 1000

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not (np.isfinite(self.step) and self.step > 0):
            raise InvalidSolver(f"step must be a finite number > 0, got {self.step}")
        if not 0 < self.shrink < 1:
            raise InvalidSolver(f"shrink must be between 0 and 1, got {self.shrink}")
        if not (np.isfinite(self.smallest_step) and self.smallest_step > 0):
            raise InvalidSolver(f"smallest_step must be a finite number > 0, got {self.smallest_step}")
        whole("most_steps", self.most_steps, 1)

    def solve(self, problem: Problem) -> Solution:
        """Answer by the best configuration on the way from `problem.start`."""
        return solve_each(problem, self._search)

    def _search(self, problem: Problem) -> Found:
        leaves_a_step = 3**problem.chain.dof
        require_memory(leaves_a_step // 1000, "one step of blind search tries 3^n combinations")
        most = self.most_steps
        if problem.budget is not None:
            most = min(most, max(problem.budget - 1, 0) // leaves_a_step)
        parameters = np.array([self.step, self.shrink, self.smallest_step, float(most)])
        q = problem.start.copy()
        goal = problem.goal
        tolerances = np.array([goal.position_tolerance, goal.orientation_tolerance])
        leaves, expanded = walk(problem.arrays, goal.arrays, problem.chain.wraps, tolerances, parameters, q)
        return Found(q, leaves, expanded, expanded)


@kernel
def walk(
    chain: ChainArrays, goal: GoalArrays, wraps: Flags, tolerances: Array, parameters: Array, q: Array
) -> tuple[int, int]:
    """Walk q downhill in place; return leaves evaluated and nodes expanded.

    Args:
        chain: The arm.
        goal: What is wanted.
        wraps: Of each joint, may it cross from one end of its range to the other?
        tolerances: Stop within these, [m] and [rad], (2,).
        parameters: First step, shrink factor, smallest step, most steps, (4,).
        q: Start, and then the answer, (n,).
    """
    dof = len(q)
    step, shrink, smallest, most = parameters[0], parameters[1], parameters[2], parameters[3]
    window = Window(np.empty((dof, 3)), np.empty((dof, 3), dtype=np.int64), np.empty(dof, dtype=np.int64))
    scratch, beam, T = make_scratch(dof), make_beam(1, dof), np.empty((3, 4))
    forward(chain, q, T)
    best = weighted_error(T, goal)
    leaves, expanded, steps = 1, 0, 0
    while step >= smallest and steps < most:
        position, orientation = errors(T, goal)
        if position <= tolerances[0] and orientation <= tolerances[1]:
            break
        combinations(chain, wraps, q, step, window)
        beam.errors[0] = best
        more, _ = search_window(chain, goal, window, -1.0, 1 << 62, beam, scratch)
        leaves += more
        expanded += window_nodes(window.counts)
        steps += 1
        if beam.errors[0] < best * (1.0 - 1e-15):
            best = beam.errors[0]
            for d in range(dof):
                q[d] = beam.q[0, d]
            forward(chain, q, T)
        else:
            step *= shrink
    return leaves, expanded


@inner
def combinations(chain: ChainArrays, wraps: Flags, q: Array, step: float, window: Window) -> None:
    """Put q - Δ, q and q + Δ, held inside the limits, into the window."""
    for d in range(len(q)):
        window.counts[d] = 3
        turn = chain.upper[d] - chain.lower[d]
        for i in range(3):
            value = q[d] + (i - 1) * step
            if wraps[d] and value > chain.upper[d]:
                value -= turn
            if wraps[d] and value < chain.lower[d]:
                value += turn
            window.nodes[d, i] = i - 1
            window.values[d, i] = min(max(value, chain.lower[d]), chain.upper[d])
