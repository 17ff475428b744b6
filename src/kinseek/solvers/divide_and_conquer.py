"""Divide and conquer with the paper's heuristics, and with the beam that cures its diving (Sec. 3.1, 3.2).

A coarse grid over every joint first; then, pass by pass, a finer grid around the best so far, until the
spacing is one node. ``breadth`` is the paper's constant breadth (one number) or breadth tuning (one a joint),
``tree`` its dynamically-created tree. The paper notes that the error is not sorted along any joint, so that
the search may dive into a local minimum: ``beam`` follows the K best cells of each pass instead of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.kernels.arrays import ChainArrays, GoalArrays, Indices
from kinseek.kernels.forward import forward_many
from kinseek.kernels.grid import (
    Beam,
    Window,
    clear,
    make_beam,
    make_scratch,
    merge,
    nodes_until,
    offer,
    search_window,
    window_nodes,
)
from kinseek.kernels.jit import exact, inner, kernel
from kinseek.problem import Problem
from kinseek.robots.blackbox import BlackBox
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution

from .base import Found, solve_each, whole
from .breadth_tuning import probe_joints, widen_by_trial, window_leaves
from .nodes import Grid, joint_grid

_MOST_CELLS = 10**6
"""Of a beam, and of a breadth: more would not fit into memory, or never end."""


@dataclass(frozen=True)
class DivideAndConquer:
    """Refine a grid around the best node, pass by pass (the paper, Alg. 1 and 2).

    The answers of the static and of the dynamic tree are the same bits; only memory and counts differ.

    Raises:
        InvalidSolver: A parameter out of its range, or a static tree too large for memory.
    """

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

    def __post_init__(self) -> None:
        """Check the parameters."""
        whole("branching_factor", self.branching_factor, 1)
        whole("divisions", self.divisions, 2)
        whole("beam", self.beam, 1, _MOST_CELLS)
        whole("node_budget", self.node_budget, 1)
        if self.children is not None:
            whole("children", self.children, 1)
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
        if isinstance(problem.chain, BlackBox) and self.breadth == "tuned":
            raise InvalidSolver(
                "breadth='tuned' tries the search many thousand times, too dear for an arm that is a function; "
                "give one number, or one a joint"
            )
        plan = self._plan(problem)
        return solve_each(problem, lambda one: self._search(one, plan))

    def breadths(self, problem: Problem) -> tuple[int, ...]:
        """The breadth of every joint, (n,), whichever way it was given.

        Raises:
            InvalidSolver: The number of breadths is not the number of joints.
        """
        chain = problem.chain
        if isinstance(self.breadth, str):
            return tuned_breadth(chain, problem.goal, self.divisions, self.node_budget)
        if isinstance(self.breadth, int):
            return (self.breadth,) * chain.dof
        if len(self.breadth) != chain.dof:
            raise InvalidSolver(
                f"breadth must be one number or {chain.dof}, one a joint "
                f"({', '.join(chain.joint_names)}); got {len(self.breadth)}: {self.breadth}"
            )
        return self.breadth

    def _plan(self, problem: Problem) -> tuple[Grid, Indices, Indices]:
        """The grid, the spacing of every pass, and the nodes each joint has in a later pass."""
        count = self.branching_factor
        grid = joint_grid(problem.chain, count, static=self.tree == "static", wrap=self.wrap)
        spacings = [max(count // self.divisions, 1)]
        while spacings[-1] > 1:
            # Departs from the paper: with B = 10, D = 4 its spacing goes 2, 0; here the last one is always 1.
            spacings.append(max(spacings[-1] // self.divisions, 1))
        later = [min(2 * (self.divisions // 2 + b) - 1, count) for b in self.breadths(problem)]
        return grid, np.array(spacings, dtype=np.int64), np.array(later, dtype=np.int64)

    def _search(self, problem: Problem, plan: tuple[Grid, Indices, Indices]) -> Found:
        grid, spacings, later = plan
        if isinstance(problem.chain, BlackBox):
            return self._ask(problem.chain, problem, plan)
        budget = np.iinfo(np.int64).max if problem.budget is None else problem.budget
        beam, leaves, expanded = descend(
            problem.arrays,
            problem.goal.arrays,
            grid,
            Passes(spacings, later, self.divisions, self.beam, min(self.children or self.beam, self.beam)),
            int(budget),
        )
        created = problem.chain.dof * self.branching_factor if self.tree == "static" else expanded
        q = beam.q[np.argmin(beam.errors)] if leaves else problem.start
        return Found(q, leaves, created, expanded)

    def _ask(self, box: BlackBox, problem: Problem, plan: tuple[Grid, Indices, Indices]) -> Found:
        from .black_box.asking import Asker
        from .black_box.grid import best_or_start, descend

        grid, spacings, later = plan
        asker, children = Asker(box, problem), min(self.children or self.beam, self.beam)
        q, expanded = descend(asker, grid, spacings, later, self.divisions, self.beam, children)
        created = box.dof * self.branching_factor if self.tree == "static" else expanded
        return Found(best_or_start(q, box, problem.start), asker.spent, created, expanded)


class Passes(NamedTuple):
    """The plan of a descent."""

    spacings: Indices
    """In nodes, one a pass, falling to 1."""
    later: Indices
    """Nodes each joint has in the passes after the first, (n,)."""
    divisions: int
    beam: int
    children: int


@exact
def node_value(grid: Grid, d: int, node: int) -> float:
    """Value of a node [rad] or [m]: looked up in the static tree, made anew, bit for bit, in the dynamic."""
    stored = grid.table.shape[1] > 0
    value: float = grid.table[d, node] if stored else min(grid.lower[d] + grid.step[d] * node, grid.upper[d])
    return value


@inner
def first_window(grid: Grid, divisions: int, window: Window) -> None:
    """Spread D nodes over each joint's range."""
    count = min(divisions, grid.size)
    for d in range(len(grid.lower)):
        window.counts[d] = count
        for i in range(count):
            node = i * grid.size // count
            if not grid.wraps[d]:
                # Departs from the paper, which starts at the lower limit for every joint: the middles of D
                # equal cells leave no end of a range out of reach of the later, ever smaller windows.
                node = ((2 * i + 1) * grid.size) // (2 * count)
            window.nodes[d, i] = node
            window.values[d, i] = node_value(grid, d, node)


@inner
def later_window(grid: Grid, centre: Indices, spacing: int, counts: Indices, window: Window) -> None:
    """Take the nodes around a centre: the centre and as many on either side."""
    for d in range(len(centre)):
        count = min(counts[d], (grid.size - 1) // spacing + 1)
        first = centre[d] - (count // 2) * spacing
        if not grid.wraps[d]:
            # The window slides inward at a limit, so that the nodes stay as many as the paper's formula says.
            while first < 0:
                first += spacing
            while first + (count - 1) * spacing >= grid.size and first >= spacing:
                first -= spacing
        kept = 0
        for i in range(count):
            node = first + i * spacing
            if grid.wraps[d]:
                node %= grid.size
            elif node >= grid.size:
                break
            window.nodes[d, kept] = node
            window.values[d, kept] = node_value(grid, d, node)
            kept += 1
        window.counts[d] = kept


@kernel
def descend(
    chain: ChainArrays, goal: GoalArrays, grid: Grid, passes: Passes, budget: int
) -> tuple[Beam, int, int]:
    """Run every pass; return the last beam, the leaves evaluated and the nodes expanded."""
    dof = len(grid.lower)
    most = min(passes.divisions, grid.size)
    for d in range(dof):
        most = max(most, passes.later[d])
    window = Window(
        np.empty((dof, most)), np.empty((dof, most), dtype=np.int64), np.empty(dof, dtype=np.int64)
    )
    scratch = make_scratch(dof)
    cells, beam = make_beam(passes.beam, dof), make_beam(passes.beam, dof)
    own, litter = passes.children < passes.beam, make_beam(passes.children, dof)
    leaves = expanded = 0
    for k in range(len(passes.spacings)):
        cells, beam = beam, cells
        keep_best(cells, beam)
        for cell in range(1 if k == 0 else passes.beam):
            if k == 0:
                first_window(grid, passes.divisions, window)
            elif cells.errors[cell] < np.inf and leaves < budget:
                later_window(grid, cells.nodes[cell], passes.spacings[k], passes.later, window)
            else:
                continue
            limited = own and k > 0
            clear(litter)
            more, early = search_window(
                chain, goal, window, -1.0, budget - leaves, litter if limited else beam, scratch
            )
            if limited:
                merge(litter, beam)
            leaves += more
            expanded += nodes_until(window.counts, more - 1) if early else window_nodes(window.counts)
    return beam, leaves, expanded


@inner
def keep_best(cells: Beam, beam: Beam) -> None:
    """Start a pass with the best so far, which is also a node of its own window."""
    clear(beam)
    best = 0
    for k in range(1, len(cells.errors)):
        if cells.errors[k] < cells.errors[best]:
            best = k
    if cells.errors[best] < np.inf:
        offer(beam, cells.errors[best], cells.nodes[best], cells.q[best])


def tuned_breadth(chain: SerialChain, goal: Goal, divisions: int, node_budget: int) -> tuple[int, ...]:
    """Choose a breadth for each joint by trial, for goals of this kind and these weights (Sec. 3.2).

    Takes up to some seconds for six joints, once: the answer is kept for the chain.
    """
    scale = goal.position_weight / goal.orientation_weight
    return _tuned(chain, goal.kind, goal.tool_axis, scale, divisions, node_budget)


@lru_cache(maxsize=64)
def _tuned(
    chain: SerialChain,
    kind: str,
    tool_axis: tuple[float, float, float],
    scale: float,
    divisions: int,
    budget: int,
) -> tuple[int, ...]:
    targets = forward_many(chain.arrays, probe_joints(chain))
    problem = Problem(chain, Goal(targets, kind, tool_axis, position_weight=scale))

    def mean_error(breadth: tuple[int, ...]) -> float:
        solution = DivideAndConquer(divisions=divisions, breadth=breadth).solve(problem)
        return float(np.mean(solution.weighted_error))

    return widen_by_trial(chain.dof, lambda b: window_leaves(b, divisions), budget, mean_error)
