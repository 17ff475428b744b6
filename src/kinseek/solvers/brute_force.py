"""Brute force: try every node of the full grid (the paper, Sec. 3.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import Indices
from kinseek.kernels.grid.descent import Grid
from kinseek.kernels.grid.memory import Window, make_beam, make_node_scratch
from kinseek.kernels.grid.window import nodes_until, search_window
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.solution import Solution

from .base import Found, require_whole, watch_each
from .nodes import (
    MOST_NODES,
    joint_grid,
    require_error,
    require_memory,
    require_patience,
    require_ties,
    tie_of,
)
from .recording import Recorder, bytes_of, grid_window, require_room
from .threads import unwatched
from .traits import Near, Traits, require

ORDERS = ("paper", "low-discrepancy", "random")


@dataclass(frozen=True)
class BruteForce:
    """Search the full grid of B values a joint, depth first, last joint fastest.

    The search finds the best node of the grid with Σ B^i node expansions (Eq. 1). The paper names two improvements and
    leaves them out; both are available here: stopping at an error, and another order of the values.

    Raises:
        InvalidSolver: A parameter is out of its range, or the tree is too large for memory or for `most_nodes`.
    """

    traits: ClassVar[Traits] = Traits(
        source="the paper",
        finds="the best node of a grid with B values per joint",
        work="B + B² + … + Bⁿ nodes",
        near=Near.TURN,
    )

    branching_factor: int = 60
    """B: values a joint."""
    stop_below: float = 0.0
    """Stop at the first node whose weighted error is below this; 0 searches everything."""
    order: str = "paper"
    """Order of a joint's values. ``"paper"``: from the lower limit up; ``"low-discrepancy"``: in steps of the golden ratio;
    ``"random"``: shuffled by `seed`."""
    seed: int = 0
    """Seed of the random order."""
    most_nodes: int | None = MOST_NODES
    """Nodes of the largest tree that is searched without a time limit, about a minute of them; None sets no limit."""
    ties: str = "rounding"
    """Rule for equally good nodes. ``"first"`` takes the first, as the paper's algorithm does in exact arithmetic; with
    ``"rounding"`` the last bit of their errors decides."""
    progress: bool = False
    """Show a progress bar."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        require_whole(self, "branching_factor", 1)
        require_whole(self, "seed", 0)
        if self.most_nodes is not None:
            require_whole(self, "most_nodes", 1)
        require_error(self.stop_below)
        require_ties(self.ties)
        if self.order not in ORDERS:
            raise InvalidSolver(f"order must be one of {', '.join(ORDERS)}; got {self.order!r}")

    def solve(self, problem: Problem) -> Solution:
        """Return the best node of the grid."""
        require(self, problem)
        require_room(problem, 1)
        dof, count = problem.mechanism.dof, self.branching_factor
        require_memory(dof * count, "brute force keeps every node")
        if count**dof > np.iinfo(np.int64).max:
            raise InvalidSolver(
                f"{count}^{dof} leaves cannot be counted in 64 bits; choose a smaller branching_factor"
            )
        deadline = Deadline(problem.time_limit)
        change = "a smaller branching_factor"
        require_patience(problem, equation_1(count, dof), self.most_nodes, change, self._search)
        leaves = min(count**dof, problem.budget or count**dof)
        return watch_each(problem, self._search, leaves, self.progress, deadline)

    def _search(
        self, problem: Problem, deadline: Deadline, watch: Callable[[int], object] = unwatched
    ) -> Found:
        dof, count = problem.mechanism.dof, self.branching_factor
        grid = joint_grid(problem.mechanism, count)
        order = np.stack([self._order(count, joint) for joint in range(dof)])
        if problem.axes is None:
            result = self._search_black_box(problem.mechanism, problem, grid, order, deadline, watch)
            return self._report(problem, grid, result, 2 * order.nbytes) if problem.trace else result
        window = Window(grid.values_of(order), order, np.full(dof, count, dtype=np.int64))
        budget = count**dof if problem.budget is None else problem.budget
        beam, scratch = make_beam(1, dof), make_node_scratch(dof)
        leaves, early = search_window(
            problem.arrays,
            problem.goal.arrays,
            window,
            float(self.stop_below),
            int(budget),
            beam,
            scratch,
            lambda: deadline.passed,
            tie=tie_of(problem, self.ties),
            done=watch,
        )
        expanded = nodes_until(window.counts, leaves - 1) if leaves else 0
        q = beam.q[0] if leaves else problem.start
        cut = early and leaves < budget and not beam.errors[0] < self.stop_below
        found = Found(q, leaves, dof * count, expanded, cut)
        return self._report(problem, grid, found, bytes_of(window, beam, scratch)) if problem.trace else found

    def _report(self, problem: Problem, grid: Grid, found: Found, memory: int) -> Found:
        """Add the trace to the result: the one pass over the whole grid."""
        recorder, nodes = Recorder(problem, self), np.arange(grid.size)
        window = grid_window(grid, [nodes] * problem.mechanism.dof)
        recorder.add("the whole grid", *found[:4], memory=memory, window=window)
        recorder.note_end(found)
        if found.evaluations < grid.size**problem.mechanism.dof and not recorder.noted:
            recorder.note(f"Stopped at the first node with a weighted error below {self.stop_below:g}.")
        return found._replace(trace=recorder.finish())

    def _search_black_box(
        self,
        box: Mechanism,
        problem: Problem,
        grid: Grid,
        order: Indices,
        deadline: Deadline,
        watch: Callable[[int], object],
    ) -> Found:
        from .black_box.evaluator import Evaluator
        from .black_box.grid import Cells, best_or_start, node_values, search_window

        evaluator, cells = (
            Evaluator(box, problem, deadline),
            Cells.empty(1, box.dof, tie_of(problem, self.ties)),
        )
        values = [node_values(grid, d, each) for d, each in enumerate(order)]
        leaves = search_window(evaluator, values, list(order), cells, float(self.stop_below) or -1.0, watch)
        expanded = (
            nodes_until(np.full(box.dof, self.branching_factor, dtype=np.int64), leaves - 1) if leaves else 0
        )
        q = best_or_start(cells.q[0] if len(cells.q) else None, box, problem.start)
        return Found(q, evaluator.spent, box.dof * self.branching_factor, expanded, evaluator.out_of_time)

    def _order(self, count: int, joint: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        if self.order == "paper":
            return np.arange(count, dtype=np.int64)
        if self.order == "random":
            return np.random.default_rng([self.seed, joint]).permutation(count).astype(np.int64)
        golden = (
            np.arange(count) * 0.6180339887498949
        ) % 1.0  # Weyl's sequence: every prefix is well spread.
        return np.argsort(np.argsort(golden)).astype(np.int64)


def equation_1(branching_factor: int, dof: int) -> int:
    """Return the nodes that brute force expands: Σ_{i=1}^{DOF} B^i (the paper, Eq. 1)."""
    return sum(branching_factor**i for i in range(1, dof + 1))
