"""Divide and conquer with the paper's heuristics, and with the beam that cures its diving (Sec. 3.1, 3.2).

A coarse grid over every joint first; then, pass by pass, a finer grid around the best so far, until the
spacing is one node. ``breadth`` is the paper's constant breadth (one number) or breadth tuning (one a joint),
``tree`` its dynamically-created tree. The paper notes that the error is not sorted along any joint, so that
the search may dive into a local minimum: ``beam`` follows the K best cells of each pass instead of one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.grid.descent import BEGINNING, TRIED, VISITED, Grid, Passes, descend
from kinseek.kernels.grid.memory import memory_size
from kinseek.kernels.grid.window import PART
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution

from .base import Found, solve_each, whole
from .breadth_tuning import probe_joints, widen_by_trial, window_leaves
from .nodes import A_ROW, MOST_NODES, joint_grid, require_patience
from .traits import Near, Traits, require

_MOST_CELLS = 10**6
"""Of a beam, and of a breadth: more would not fit into memory, or never end."""


@dataclass(frozen=True)
class DivideAndConquer:
    """Refine a grid around the best node, pass by pass (the paper, Alg. 1 and 2).

    The answers of the static and of the dynamic tree are the same bits; only memory and counts differ.

    Raises:
        InvalidSolver: A parameter out of its range, a static tree too large for memory, or a search too long for
            `most_nodes`.
    """

    traits: ClassVar[Traits] = Traits(
        source="the paper",
        finds="a good node of a very fine grid",
        work="grows with log B",
        near=Near.TURN,
    )

    branching_factor: int = 7200
    """B: nodes a joint; the last pass has a spacing of one node."""
    divisions: int = 3
    """D: values a joint in the first pass; each later pass divides the spacing by D."""
    breadth: int | tuple[int, ...] | str = 1
    """Br: later passes try 2(⌊D/2⌋ + Br) - 1 values a joint. One number is the paper's constant breadth (CB),
    one a joint its breadth tuning (BT), and ``"tuned"`` chooses those by trial."""
    tree: str = "dynamic"
    """``"static"`` makes all nodes first; ``"dynamic"`` makes them when needed (DT)."""
    beam: int = 1
    """K: cells a pass leaves to the next; the paper has 1."""
    children: int | None = None
    """Cells that one cell may leave to the next pass; fewer keep the beam spread out. None sets no limit."""
    node_budget: int = 20_000
    """Leaves a pass and cell that ``breadth="tuned"`` may spend."""
    wrap: bool = True
    """May the neighbourhood of a joint that turns fully cross from its last node to its first?"""
    most_nodes: int | None = MOST_NODES
    """Nodes of the longest search that is begun without a time limit, about a minute of them; None sets no limit."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        whole("branching_factor", self.branching_factor, 1)
        whole("divisions", self.divisions, 2)
        whole("beam", self.beam, 1, _MOST_CELLS)
        whole("node_budget", self.node_budget, 1)
        if self.children is not None:
            whole("children", self.children, 1)
        if self.most_nodes is not None:
            whole("most_nodes", self.most_nodes, 1)
        if self.tree not in ("static", "dynamic"):
            raise InvalidSolver(f"tree must be 'static' or 'dynamic', got {self.tree!r}")
        if isinstance(self.breadth, str):
            if self.breadth != "tuned":
                raise InvalidSolver(
                    f"breadth must be a number, one number a joint, or 'tuned'; got {self.breadth!r}"
                )
        elif isinstance(self.breadth, Sequence | np.ndarray):
            each = tuple(whole("every breadth", b, 1, _MOST_CELLS) for b in self.breadth)
            object.__setattr__(self, "breadth", each)
        else:
            whole("breadth", self.breadth, 1, _MOST_CELLS)

    def solve(self, problem: Problem) -> Solution:
        """Answer by the best node found."""
        require(self, problem)
        if problem.axes is None and self.breadth == "tuned":
            raise InvalidSolver(
                "breadth='tuned' tries the search many thousand times, too dear for an arm that is a function; "
                "give one number, or one a joint"
            )
        deadline = Deadline(problem.time_limit)
        try:
            plan = self._plan(problem, deadline)
        except _OutOfTimeError:
            return solve_each(problem, lambda one, _: Found(one.start, 0, out_of_time=True), deadline)
        self._require_patience(problem, plan)
        if problem.axes is None:
            return solve_each(problem, lambda one, _: self._ask(one, plan, deadline), deadline)
        memory = np.empty(memory_size(*self._sizes(plan)))
        return solve_each(problem, lambda one, _: self._search(one, plan, memory, deadline), deadline)

    def breadths(self, problem: Problem, deadline: Deadline | None = None) -> tuple[int, ...]:
        """The breadth of every joint, (n,), whichever way it was given.

        Raises:
            InvalidSolver: The number of breadths is not the number of joints.
        """
        chain = problem.mechanism
        if isinstance(self.breadth, str):
            return tuned_breadth(problem.chain, problem.goal, self.divisions, self.node_budget, deadline)
        if isinstance(self.breadth, int):
            return (self.breadth,) * chain.dof
        if len(self.breadth) != chain.dof:
            raise InvalidSolver(
                f"breadth must be one number or {chain.dof}, one a joint "
                f"({', '.join(chain.joint_names)}); got {len(self.breadth)}: {self.breadth}"
            )
        return self.breadth

    def _plan(self, problem: Problem, deadline: Deadline) -> tuple[Grid, Indices, Indices]:
        """The grid, the spacing of every pass, and the nodes each joint has in a later pass."""
        count = self.branching_factor
        grid = joint_grid(problem.mechanism, count, static=self.tree == "static", wrap=self.wrap)
        spacings = [max(count // self.divisions, 1)]
        while spacings[-1] > 1:
            # Departs from the paper: with B = 10, D = 4 its spacing goes 2, 0; here the last one is always 1.
            spacings.append(max(spacings[-1] // self.divisions, 1))
        later = [min(2 * (self.divisions // 2 + b) - 1, count) for b in self.breadths(problem, deadline)]
        return grid, np.array(spacings, dtype=np.int64), np.array(later, dtype=np.int64)

    def _sizes(self, plan: tuple[Grid, Indices, Indices]) -> tuple[int, int, int, int]:
        """Joints, values of any joint at most, cells, and children of a cell."""
        grid, _, later = plan
        most = max(min(self.divisions, grid.size), *later.tolist())
        return len(later), most, self.beam, min(self.children or self.beam, self.beam)

    def _require_patience(self, problem: Problem, plan: tuple[Grid, Indices, Indices]) -> None:
        """Count the nodes that the passes visit at most."""
        if self.most_nodes is None:
            return
        grid, spacings, later = plan
        first, counts = min(self.divisions, grid.size), later.tolist()
        passes = (len(spacings) - 1) * self.beam
        dof = len(counts)
        if dof * (first**dof + passes * max(counts) ** dof) * A_ROW <= self.most_nodes:
            return  # Seen at a glance.
        nodes = sum(first**d for d in range(1, dof + 1))
        nodes += passes * sum(math.prod(counts[:d]) for d in range(1, dof + 1))
        require_patience(problem, nodes, self.most_nodes, "a smaller breadth, beam or number of divisions")

    def _search(
        self, problem: Problem, plan: tuple[Grid, Indices, Indices], memory: Array, deadline: Deadline
    ) -> Found:
        grid, spacings, later = plan
        budget = int(np.iinfo(np.int64).max if problem.budget is None else problem.budget)
        passes = Passes(
            spacings, later, self.divisions, self.beam, min(self.children or self.beam, self.beam)
        )
        arrays, goal, q = problem.arrays, problem.goal.arrays, np.empty(problem.chain.dof)
        at = np.array(BEGINNING)
        done = descend(arrays, goal, grid, passes, budget, PART, memory, at, q)
        while not done and not deadline.passed:
            done = descend(arrays, goal, grid, passes, budget, PART, memory, at, q)
        leaves, expanded = int(at[TRIED]), int(at[VISITED])
        created = problem.chain.dof * self.branching_factor if self.tree == "static" else expanded
        return Found(q if leaves else problem.start, leaves, created, expanded, not done)

    def _ask(self, problem: Problem, plan: tuple[Grid, Indices, Indices], deadline: Deadline) -> Found:
        from .black_box.asking import Asker
        from .black_box.grid import best_or_start, descend

        box, (grid, spacings, later) = problem.mechanism, plan
        asker, children = Asker(box, problem, deadline), min(self.children or self.beam, self.beam)
        q, expanded = descend(asker, grid, spacings, later, self.divisions, self.beam, children)
        created = box.dof * self.branching_factor if self.tree == "static" else expanded
        return Found(best_or_start(q, box, problem.start), asker.spent, created, expanded, asker.out_of_time)


class _OutOfTimeError(Exception):
    """Raised within a tuning that is cut short, so that it is not kept."""


class _Clock:
    """A deadline that makes no difference to what is kept."""

    def __init__(self, deadline: Deadline) -> None:
        self.deadline = deadline

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Clock)

    def __hash__(self) -> int:
        return 0


def tuned_breadth(
    chain: SerialChain, goal: Goal, divisions: int, node_budget: int, deadline: Deadline | None = None
) -> tuple[int, ...]:
    """Choose a breadth for each joint by trial, for goals of this kind and these weights (Sec. 3.2).

    Takes up to some seconds for six joints, once: the answer is kept for the chain.
    """
    scale = goal.position_weight / goal.orientation_weight
    clock = _Clock(deadline or Deadline())
    return _tuned(chain, goal.kind, goal.tool_axis, scale, divisions, node_budget, clock)


@lru_cache(maxsize=64)
def _tuned(
    chain: SerialChain,
    kind: str,
    tool_axis: tuple[float, float, float],
    scale: float,
    divisions: int,
    budget: int,
    clock: _Clock,
) -> tuple[int, ...]:
    targets = forward_many(chain.arrays, probe_joints(chain))
    problem = Problem(chain, Goal(targets, kind, tool_axis, position_weight=scale))

    def mean_error(breadth: tuple[int, ...]) -> float:
        if clock.deadline.passed:
            raise _OutOfTimeError
        search = DivideAndConquer(divisions=divisions, breadth=breadth, most_nodes=None)
        return float(np.mean(search.solve(problem).weighted_error))

    return widen_by_trial(chain.dof, lambda b: window_leaves(b, divisions), budget, mean_error)
