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
from typing import NamedTuple, cast

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.kernels.arrays import ChainArrays, GoalArrays, Indices
from kinseek.kernels.forward import forward_many
from kinseek.kernels.grid import (
    PART,
    PAUSED,
    WHOLE,
    Beam,
    Scratch,
    Window,
    clear,
    make_beam,
    make_scratch,
    make_window,
    nodes_until,
    offer,
    search_part,
    window_nodes,
)
from kinseek.kernels.jit import exact, inner, kernel
from kinseek.problem import Problem
from kinseek.robots.blackbox import BlackBox
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution

from .base import Found, solve_each, whole
from .breadth_tuning import probe_joints, widen_by_trial, window_leaves
from .nodes import MOST_NODES, Grid, joint_grid, require_patience

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
        if isinstance(problem.chain, BlackBox) and self.breadth == "tuned":
            raise InvalidSolver(
                "breadth='tuned' tries the search many thousand times, too dear for an arm that is a function; "
                "give one number, or one a joint"
            )
        deadline = Deadline(problem.time_limit)
        try:
            plan = self._plan(problem, deadline)
        except _OutOfTimeError:
            return solve_each(problem, lambda one, _: Found(one.start, 0, out_of_time=True), deadline)
        require_patience(
            problem, self._most_nodes(plan), self.most_nodes, "a smaller breadth, beam or number of divisions"
        )
        if isinstance(problem.chain, BlackBox):
            return solve_each(problem, lambda one, _: self._ask(one, plan, deadline), deadline)
        memory = self._memory(plan)
        return solve_each(problem, lambda one, _: self._search(one, plan, memory, deadline), deadline)

    def breadths(self, problem: Problem, deadline: Deadline | None = None) -> tuple[int, ...]:
        """The breadth of every joint, (n,), whichever way it was given.

        Raises:
            InvalidSolver: The number of breadths is not the number of joints.
        """
        chain = problem.chain
        if isinstance(self.breadth, str):
            return tuned_breadth(chain, problem.goal, self.divisions, self.node_budget, deadline)
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
        grid = joint_grid(problem.chain, count, static=self.tree == "static", wrap=self.wrap)
        spacings = [max(count // self.divisions, 1)]
        while spacings[-1] > 1:
            # Departs from the paper: with B = 10, D = 4 its spacing goes 2, 0; here the last one is always 1.
            spacings.append(max(spacings[-1] // self.divisions, 1))
        later = [min(2 * (self.divisions // 2 + b) - 1, count) for b in self.breadths(problem, deadline)]
        return grid, np.array(spacings, dtype=np.int64), np.array(later, dtype=np.int64)

    def _most_nodes(self, plan: tuple[Grid, Indices, Indices]) -> int:
        """Nodes that the passes visit at most."""
        grid, spacings, later = plan
        first = min(self.divisions, grid.size)
        counts = [[first] * len(later), [int(count) for count in later]]
        nodes = [sum(math.prod(each[: d + 1]) for d in range(len(each))) for each in counts]
        return nodes[0] + (len(spacings) - 1) * self.beam * nodes[1]

    def _memory(self, plan: tuple[Grid, Indices, Indices]) -> Memory:
        """Memory for one descent after the other."""
        grid, _, later = plan
        dof, most = len(later), max(min(self.divisions, grid.size), *later.tolist())
        return Memory(
            make_window(dof, most),
            make_scratch(dof),
            make_beam(self.beam, dof),
            make_beam(self.beam, dof),
            make_beam(min(self.children or self.beam, self.beam), dof),
        )

    def _search(
        self, problem: Problem, plan: tuple[Grid, Indices, Indices], memory: Memory, deadline: Deadline
    ) -> Found:
        grid, spacings, later = plan
        budget = int(np.iinfo(np.int64).max if problem.budget is None else problem.budget)
        passes = Passes(spacings, later, self.divisions, self.beam, len(memory.litter.errors))
        arrays, goal, at = problem.arrays, problem.goal.arrays, np.array([0, -1, 0, -1, 0, 0], dtype=np.int64)
        done = descend(arrays, goal, grid, passes, budget, PART, memory, at)
        while not done and not deadline.passed:
            done = descend(arrays, goal, grid, passes, budget, PART, memory, at)
        expanded, leaves = int(at[EXPANDED]), int(at[LEAVES])
        if at[LEAF] > 0:  # The time ended in the middle of a window.
            leaves += int(at[LEAF])
            expanded += nodes_until(memory.window.counts, int(at[LEAF]) - 1)
        last, before = (
            (memory.second, memory.first) if len(spacings) % 2 == 0 else (memory.first, memory.second)
        )
        beam = last if done else min(last, before, memory.litter, key=lambda each: each.errors.min())
        created = problem.chain.dof * self.branching_factor if self.tree == "static" else expanded
        q = beam.q[np.argmin(beam.errors)].copy() if leaves else problem.start
        return Found(q, leaves, created, expanded, not done)

    def _ask(self, problem: Problem, plan: tuple[Grid, Indices, Indices], deadline: Deadline) -> Found:
        from .black_box.asking import Asker
        from .black_box.grid import best_or_start, descend

        box, (grid, spacings, later) = cast("BlackBox", problem.chain), plan
        asker, children = Asker(box, problem, deadline), min(self.children or self.beam, self.beam)
        q, expanded = descend(asker, grid, spacings, later, self.divisions, self.beam, children)
        created = box.dof * self.branching_factor if self.tree == "static" else expanded
        return Found(best_or_start(q, box, problem.start), asker.spent, created, expanded, asker.out_of_time)


class Passes(NamedTuple):
    """The plan of a descent."""

    spacings: Indices
    """In nodes, one a pass, falling to 1."""
    later: Indices
    """Nodes each joint has in the passes after the first, (n,)."""
    divisions: int
    beam: int
    children: int


class Memory(NamedTuple):
    """Memory of a descent, and what it knows."""

    window: Window
    scratch: Scratch
    first: Beam
    """Of the first pass, the third, and so on, (K,)."""
    second: Beam
    """Of the second pass, the fourth, and so on, (K,)."""
    litter: Beam
    """What one cell leaves to the next pass, where that is limited."""


PASS, CELL, LEAF, MERGED, LEAVES, EXPANDED = range(6)
"""Where a descent is at: its pass; the cell of it, -1 before the first; the next leaf of that cell's window; the next place
of the litter to merge, -1 before its window is searched; and of the windows that are done, the leaves and the nodes."""


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
    chain: ChainArrays,
    goal: GoalArrays,
    grid: Grid,
    passes: Passes,
    budget: int,
    work: int,
    memory: Memory,
    at: Indices,
) -> bool:
    """Go on with a descent; say whether it is done.

    Args:
        chain: The arm.
        goal: What is wanted.
        grid: The nodes.
        passes: The plan.
        budget: Leaves that may be evaluated in all passes.
        work: What this call may do, in leaves; it does a little more.
        memory: What is known so far; the best leaves of the last pass are in its beam.
        at: Where the descent is, see `PASS`: 0, -1, 0, -1, 0, 0 at its beginning.
    """
    window, scratch, litter = memory.window, memory.scratch, memory.litter
    while at[PASS] < len(passes.spacings):
        k = at[PASS]
        cells, beam = memory.second, memory.first
        if k % 2 == 1:
            cells, beam = memory.first, memory.second
        limited = k > 0 and passes.children < passes.beam
        if at[CELL] < 0:
            if k == 0:
                clear(cells)
                clear(litter)
            keep_best(cells, beam)
            at[CELL] = 0
        while at[CELL] < (1 if k == 0 else passes.beam):
            if at[MERGED] < 0:
                if at[LEAF] == 0:
                    cell = at[CELL]
                    if k == 0:
                        first_window(grid, passes.divisions, window)
                    elif cells.errors[cell] < np.inf and at[LEAVES] < budget:
                        later_window(grid, cells.nodes[cell], passes.spacings[k], passes.later, window)
                    else:
                        at[CELL] += 1
                        continue
                    clear(litter)
                found = litter if limited else beam
                leaf, ended, work = search_part(
                    chain, goal, window, -1.0, budget - at[LEAVES], at[LEAF], work, found, scratch
                )
                at[LEAF] = leaf
                if ended == PAUSED:
                    return False
                at[LEAVES] += leaf
                at[EXPANDED] += (
                    window_nodes(window.counts) if ended == WHOLE else nodes_until(window.counts, leaf - 1)
                )
                at[LEAF], at[MERGED] = 0, 0 if limited else len(litter.errors)
            while at[MERGED] < len(litter.errors):
                m = at[MERGED]
                if litter.errors[m] < np.inf:
                    offer(beam, litter.errors[m], litter.nodes[m], litter.q[m])
                    work -= len(beam.errors)
                at[MERGED] += 1
                if work <= 0:
                    return False
            at[MERGED] = -1
            at[CELL] += 1
            if work <= 0:
                return False
        at[PASS] += 1
        at[CELL] = -1
    return True


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
