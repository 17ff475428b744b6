"""Brute force: try every node of the full grid (the paper, Sec. 3.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import ChainArrays, GoalArrays, Indices
from kinseek.kernels.grid import Beam, Window, make_beam, make_scratch, nodes_until, search_window
from kinseek.kernels.jit import kernel
from kinseek.problem import Problem
from kinseek.robots.blackbox import BlackBox
from kinseek.solution import Solution

from .base import Found, solve_each, whole
from .nodes import Grid, joint_grid, require_memory

ORDERS = ("paper", "low-discrepancy", "random")


@dataclass(frozen=True)
class BruteForce:
    """Search the full grid of B values a joint, depth first, last joint fastest.

    Finds the best node of the grid, and takes Σ B^i node expansions for it (Eq. 1). The paper names two
    improvements and leaves them out; both are here: stop at an error, and another order of the values.

    Raises:
        InvalidSolver: A parameter out of its range, or a tree too large for memory.
    """

    branching_factor: int = 60
    """B: values a joint."""
    stop_below: float = 0.0
    """Stop at the first node whose weighted error is below this; 0 searches everything."""
    order: str = "paper"
    """Of a joint's values. ``"paper"``: from the lower limit up; ``"low-discrepancy"``: in steps of the
    golden ratio; ``"random"``: shuffled by `seed`."""
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the parameters."""
        whole("branching_factor", self.branching_factor, 1)
        whole("seed", self.seed, 0)
        if not self.stop_below >= 0:
            raise InvalidSolver(f"stop_below must be a number >= 0, got {self.stop_below}")
        if self.order not in ORDERS:
            raise InvalidSolver(f"order must be one of {', '.join(ORDERS)}; got {self.order!r}")

    def solve(self, problem: Problem) -> Solution:
        """Answer by the best node of the grid."""
        return solve_each(problem, self._search)

    def _search(self, problem: Problem) -> Found:
        dof, count = problem.chain.dof, self.branching_factor
        require_memory(dof * count, "brute force keeps every node")
        if count**dof > np.iinfo(np.int64).max:
            raise InvalidSolver(
                f"{count}^{dof} leaves cannot be counted in 64 bits; choose a smaller branching_factor"
            )
        grid = joint_grid(problem.chain, count)
        nodes = np.stack([self._order(count, joint) for joint in range(dof)])
        if isinstance(problem.chain, BlackBox):
            return self._ask(problem.chain, problem, grid, nodes)
        window = Window(grid.values_of(nodes), nodes, np.full(dof, count, dtype=np.int64))
        budget = count**dof if problem.budget is None else problem.budget
        beam, leaves = search_grid(
            problem.arrays, problem.goal.arrays, window, float(self.stop_below), int(budget)
        )
        expanded = nodes_until(window.counts, leaves - 1) if leaves else 0
        q = beam.q[0] if leaves else problem.start
        return Found(q, leaves, dof * count, expanded)

    def _ask(self, box: BlackBox, problem: Problem, grid: Grid, nodes: Indices) -> Found:
        from .black_box.asking import Asker
        from .black_box.grid import Cells, best_or_start, node_values, search_window

        asker, cells = Asker(box, problem), Cells.empty(1, box.dof)
        values = [node_values(grid, d, each) for d, each in enumerate(nodes)]
        leaves = search_window(asker, values, list(nodes), cells, float(self.stop_below) or -1.0)
        expanded = (
            nodes_until(np.full(box.dof, self.branching_factor, dtype=np.int64), leaves - 1) if leaves else 0
        )
        q = best_or_start(cells.q[0] if len(cells.q) else None, box, problem.start)
        return Found(q, asker.spent, box.dof * self.branching_factor, expanded)

    def _order(self, count: int, joint: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        if self.order == "paper":
            return np.arange(count, dtype=np.int64)
        if self.order == "random":
            return np.random.default_rng([self.seed, joint]).permutation(count).astype(np.int64)
        golden = (
            np.arange(count) * 0.6180339887498949
        ) % 1.0  # Weyl's sequence: every prefix is well spread.
        return np.argsort(np.argsort(golden)).astype(np.int64)


@kernel
def search_grid(
    chain: ChainArrays, goal: GoalArrays, window: Window, stop_below: float, budget: int
) -> tuple[Beam, int]:
    """Search one window and keep the single best leaf; return it and the leaves evaluated."""
    beam = make_beam(1, len(window.counts))
    scratch = make_scratch(len(window.counts))
    leaves, _ = search_window(chain, goal, window, stop_below, budget, beam, scratch)
    return beam, leaves
