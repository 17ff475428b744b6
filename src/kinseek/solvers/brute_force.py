"""Brute force: try every node of the full grid (the paper, Sec. 3.1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import Indices
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline

from .base import Found, require_whole, watch_each
from .grid_search import GridSearch, Plan, passes_of
from .nodes import MOST_NODES, joint_grid, require_error, require_memory, require_patience, require_ties
from .recording import Recorder, grid_window, require_room
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
    """Stop at the first node whose weighted error is below this; 0 never stops early."""
    order: str = "paper"
    """Order of a joint's values. ``"paper"``: from the lower limit up; ``"low-discrepancy"``: in steps of the golden ratio;
    ``"random"``: shuffled by `seed`."""
    seed: int = 0
    """Seed of the random order."""
    most_nodes: int | None = MOST_NODES
    """Largest number of nodes of a search without a time limit, about a minute of work; None sets no limit."""
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
        leaves, plan = min(count**dof, problem.budget or count**dof), self._plan(problem.mechanism)
        memory = plan.memory

        def search(one: Problem, until: Deadline, watch: Callable[[int], object] = unwatched) -> Found:
            return self._search(one, GridSearch(one, plan, self.ties, memory, until, watch))

        require_patience(problem, plan.nodes, self.most_nodes, "a smaller branching_factor", search)
        return watch_each(problem, search, leaves, self.progress, deadline)

    def _plan(self, mechanism: Mechanism) -> Plan:
        """Return the plan of a descent in a single pass, whose window is the whole grid."""
        dof, count = mechanism.dof, self.branching_factor
        order = [self._order(count, joint) for joint in range(dof)]
        later_counts = np.empty((0, dof), dtype=np.int64)
        passes, leaves, nodes = passes_of(order, later_counts, [1], stop_below=self.stop_below)
        return Plan(joint_grid(mechanism, count), passes, dof * count, leaves, nodes)

    def _search(self, problem: Problem, search: GridSearch) -> Found:
        found = search.until(1)
        if not problem.trace:
            return found
        recorder, grid = Recorder(problem, self), search.plan.grid
        window = grid_window(grid, [np.arange(grid.size)] * problem.mechanism.dof)
        recorder.add("the whole grid", *found[:4], memory=search.bytes_used, window=window)
        recorder.note_end(found)
        if found.evaluations < search.plan.leaves and not recorder.noted:
            recorder.note(f"Stopped at the first node with a weighted error below {self.stop_below:g}.")
        return found._replace(trace=recorder.finish())

    def _order(self, count: int, joint: int) -> Indices:
        if self.order == "paper":
            return np.arange(count, dtype=np.int64)
        if self.order == "random":
            return np.random.default_rng([self.seed, joint]).permutation(count).astype(np.int64)
        golden = (
            np.arange(count) * 0.6180339887498949
        ) % 1.0  # Weyl's sequence: every prefix is well spread.
        return np.argsort(np.argsort(golden)).astype(np.int64)
