"""Divide and conquer with the paper's heuristics, and with a beam against local minima (Sec. 3.1, 3.2).

The first pass uses a coarse grid over every joint. Each later pass uses a finer grid around the best node so far, until the
spacing is one node. ``breadth`` is the paper's constant breadth (one number) or breadth tuning (one a joint), ``tree`` its
dynamically-created tree. The paper notes that the error is not sorted along any joint, so that the search may dive into a
local minimum: ``beam`` follows the K best cells of each pass instead of one.

This file is longer than others, since the search, its readings of the paper and the tuning of its breadths share one plan.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from numbers import Real
from typing import Any, ClassVar, NamedTuple

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.grid.descent import BEGINNING, STOPPED, TRIED, VISITED, Grid, Passes, descend
from kinseek.kernels.grid.memory import memory_size
from kinseek.kernels.grid.window import PART
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution
from kinseek.validation import is_finite_number

from .base import Found, require_whole, solve_each, watch_each
from .breadth_tuning import Walk, probe_joints, widen_by_trial, window_leaves
from .nodes import (
    MOST_NODES,
    joint_grid,
    require_error,
    require_memory,
    require_patience,
    require_ties,
    spread_nodes,
    tie_of,
    window_around,
    zero_nodes,
)
from .recording import Recorder, bytes_of, record_pass, require_room
from .threads import unwatched
from .traits import Near, Traits, require

_MOST_CELLS = 10**6
"""Largest beam, and largest breadth: more would not fit into memory, or never end."""


@dataclass(frozen=True)
class DivideAndConquer:
    """Refine a grid around the best node, pass by pass (the paper, Alg. 1 and 2).

    The static and the dynamic tree give the same bits; only memory and counts differ.

    Raises:
        InvalidSolver: A parameter is out of its range, a static tree is too large for memory, or the search takes more than
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
    breadth: float | tuple[float, ...] | str = 1
    """Br: later passes try 2(⌊D/2⌋ + Br) - 1 values a joint. One number is the paper's constant breadth (CB), one a joint
    its breadth tuning (BT). ``"tuned"`` chooses breadths by trial. With ``"reach"`` every joint can reach all nodes from any
    wrong cell of the first pass. A fraction is the mean over the later passes: with 2.5 the first four of seven have a
    breadth of 3, and the others a breadth of 2."""
    tree: str = "dynamic"
    """``"static"`` makes all nodes first; ``"dynamic"`` makes them when needed (DT)."""
    beam: int = 1
    """K: cells that a pass passes to the next; the paper has 1."""
    children: int | None = None
    """Most cells that one cell passes to the next pass; fewer keep the beam spread out. None sets no limit."""
    node_budget: int = 20_000
    """Leaves per pass and cell that ``breadth="tuned"`` may use."""
    wrap: bool = True
    """Whether the neighbourhood of a joint with a full turn may cross from its last node to its first."""
    most_nodes: int | None = MOST_NODES
    """Nodes of the longest search that is started without a time limit, about a minute of them; None sets no limit."""
    first: str = "D"
    """The first pass tries ``"D"`` values, spread over the range (Sec. 3.1), or as many as the ``"formula"`` of Sec. 3.2
    gives for every pass: 2(⌊D/2⌋ + Br) - 1, at a spacing of B/D around the zero configuration, with which Algorithm 2
    begins."""
    offset: float | tuple[float | None, ...] | None = None
    """Position of the first pass's nodes in their cells: 0 at the lower end, 0.5 in the middle. One number, or one a joint;
    None is 0 for a joint with a full turn, and 0.5 for one with limits."""
    limited: str = "middles"
    """Nodes of joints with limits. ``"middles"`` gives them both limits as nodes, begins in the middles of D cells, and
    slides windows inward at a limit. The ``"letter"`` of the paper gives them 360/B · i as for full turns, with the first
    node at the lower limit, and drops the part of a window beyond a limit."""
    stop_below: float = 0.0
    """Stop at the first node whose weighted error is below this; 0 makes all passes."""
    ties: str = "rounding"
    """Rule for equally good nodes. ``"first"`` takes the first, as the paper's algorithm does in exact arithmetic; with
    ``"rounding"`` the last bit of their errors decides."""
    progress: bool = False
    """Show a progress bar."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        require_whole(self, "branching_factor", 1)
        require_whole(self, "divisions", 2)
        require_whole(self, "beam", 1, _MOST_CELLS)
        require_whole(self, "node_budget", 1)
        if self.children is not None:
            require_whole(self, "children", 1)
        if self.most_nodes is not None:
            require_whole(self, "most_nodes", 1)
        if self.tree not in ("static", "dynamic"):
            raise InvalidSolver(f"tree must be 'static' or 'dynamic', got {self.tree!r}")
        if self.first not in ("D", "formula"):
            raise InvalidSolver(f"first must be 'D' or 'formula', got {self.first!r}")
        if self.limited not in ("middles", "letter"):
            raise InvalidSolver(f"limited must be 'middles' or 'letter', got {self.limited!r}")
        require_error(self.stop_below)
        if not isinstance(self.wrap, bool | np.bool_):
            raise InvalidSolver(f"wrap must be True or False, got {self.wrap!r:.200}")
        require_ties(self.ties)
        if self.ties == "first" and self.beam > 1:
            raise InvalidSolver(
                f"ties='first' is the rule of a search that keeps one cell, the paper's; got beam={self.beam}"
            )
        if self.offset is not None:
            object.__setattr__(self, "offset", _offsets(self.offset))
        if isinstance(self.breadth, str):
            if self.breadth not in ("tuned", "reach"):
                raise InvalidSolver(
                    f"breadth must be a number, one number a joint, 'reach' or 'tuned'; got {self.breadth!r}"
                )
        elif isinstance(self.breadth, Sequence | np.ndarray):
            each = tuple(_breadth("every breadth", b) for b in self.breadth)
            object.__setattr__(self, "breadth", each)
        else:
            object.__setattr__(self, "breadth", _breadth("breadth", self.breadth))

    def solve(self, problem: Problem) -> Solution:
        """Return the best node found."""
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
        require_room(problem, len(plan.passes.spacings))
        memory = np.empty(0) if problem.axes is None else np.empty(_memory_size(*plan.sizes))

        def search(one: Problem, until: Deadline, watch: Callable[[int], object] = unwatched) -> Found:
            if one.axes is None:
                return self._ask(one, plan, until, watch)
            return self._search(one, plan, memory, until, watch)

        change = "a smaller breadth, beam or number of divisions"
        require_patience(problem, plan.nodes, self.most_nodes, change, search)
        return watch_each(problem, search, plan.leaves, self.progress, deadline)

    def breadths(self, problem: Problem, deadline: Deadline | None = None) -> tuple[float, ...]:
        """Return the breadth of every joint, (n,), for any form of the parameter.

        A fraction is a mean over the later passes.

        Raises:
            InvalidSolver: The number of breadths is not the number of joints.
        """
        chain = problem.mechanism
        if self.breadth == "reach":
            return self._reaching(tuple((chain.wraps & self.wrap).tolist()))
        if isinstance(self.breadth, str):
            return tuned_breadth(problem.chain, problem.goal, self.divisions, self.node_budget, deadline)
        if not isinstance(self.breadth, tuple):
            return (self.breadth,) * chain.dof
        if len(self.breadth) != chain.dof:
            raise InvalidSolver(
                f"breadth must be one number or {chain.dof}, one a joint "
                f"({', '.join(chain.joint_names)}); got {len(self.breadth)}: {self.breadth}"
            )
        return self.breadth

    def reach_notes(self, problem: Problem) -> tuple[str, ...]:
        """Return a sentence for each joint that cannot reach every node from a wrong cell of the first pass.

        See `breadth_tuning.Walk`.
        """
        breadths = self.breadths(problem)
        walks = self._walks(tuple((problem.mechanism.wraps & self.wrap).tolist()))
        short: dict[tuple[float, int], list[str]] = {}
        each = zip(problem.mechanism.joint_names, breadths, walks, self._sides(breadths).T, strict=True)
        for name, breadth, walk, sides in each:
            if walk.shortfall(sides.tolist()):
                short.setdefault((breadth, walk.breadth(self.divisions)), []).append(name)
        return tuple(
            f"{', '.join(names)}: from a wrong first cell a breadth of {breadth} cannot always lead back; "
            f"{enough} can (breadth='reach')"
            for (breadth, enough), names in short.items()
        )

    @lru_cache(maxsize=64)  # noqa: B019  # As of `_nodes`.
    def _reaching(self, wraps: tuple[bool, ...]) -> tuple[int, ...]:
        return tuple(walk.breadth(self.divisions) for walk in self._walks(wraps))

    def _walks(self, wraps: tuple[bool, ...]) -> list[Walk]:
        """Return how each joint continues from the first pass."""
        later = self._spacings[1:]
        # Around the zero configuration the first nodes may be anywhere; at a limit the distance is largest.
        at_limit = [np.zeros(1, dtype=np.int64)] * len(wraps)
        first = at_limit if self.first == "formula" else self._spread(self._offsets(np.array(wraps)))
        clips = self.limited == "letter"
        return [
            Walk(later, self.branching_factor, each, clips, nodes)
            for each, nodes in zip(wraps, first, strict=True)
        ]

    @property
    def _spacings(self) -> list[int]:
        """Return the spacings of all passes, in nodes."""
        spacings = [max(self.branching_factor // self.divisions, 1)]
        while spacings[-1] > 1:
            # Departs from the paper: with B = 10, D = 4 its spacing goes 2, 0; here the last one is always 1.
            spacings.append(max(spacings[-1] // self.divisions, 1))
        return spacings

    def _sides(self, breadths: tuple[float, ...]) -> Indices:
        """Return nodes to each side in every later pass, (passes, n); one row if there is no later pass.

        A fraction gives the first passes the next larger breadth, as many of them as bring the mean nearest to it, and the
        others the next smaller one. The first spacings are the largest, so one more node reaches farthest there. `python -m
        experiments fraction` compares this with other mixtures.
        """
        passes = max(len(self._spacings) - 1, 1)
        wider = [math.floor((b - math.floor(b)) * passes + 0.5) for b in breadths]
        rows = [
            [self.divisions // 2 + math.floor(b) + (k < w) - 1 for b, w in zip(breadths, wider, strict=True)]
            for k in range(passes)
        ]
        return np.array(rows, dtype=np.int64)

    def _offsets(self, wraps: Flags) -> list[Fraction]:
        """Return the positions of the first nodes of each joint in their cells.

        Raises:
            InvalidSolver: The number of offsets is not the number of joints.
        """
        given = self.offset if isinstance(self.offset, tuple) else (self.offset,) * len(wraps)
        if len(given) != len(wraps):
            raise InvalidSolver(
                f"offset must be one number or {len(wraps)}, one a joint; got {len(given)}: {self.offset}"
            )
        # Departs from the paper, which starts at the lower limit for every joint. The middles of D equal cells keep both
        # ends of a range within reach of the later, ever smaller windows.
        middles = ~wraps & (self.limited != "letter")
        default = [Fraction(1, 2) if each else Fraction(0) for each in middles]
        return [own if each is None else Fraction(each) for own, each in zip(default, given, strict=True)]

    def _plan(self, problem: Problem, deadline: Deadline) -> _Plan:
        """Return the plan that all targets of a problem share."""
        static, letter = self.tree == "static", self.limited == "letter"
        size = self.branching_factor
        grid = joint_grid(problem.mechanism, size, static=static, wrap=self.wrap, letter=letter)
        breadths = self.breadths(problem, deadline)
        # The first nodes depend on the arm only if they are placed around the zero configuration.
        zero = tuple(zero_nodes(grid)) if self.first == "formula" else None
        return _Plan(grid, *self._nodes(breadths, tuple(grid.wraps.tolist()), zero))

    @lru_cache(maxsize=64)  # noqa: B019  # A plan takes longer than a small search; this keeps searches, which are small too.
    def _nodes(
        self, breadths: tuple[int, ...], wraps: tuple[bool, ...], zero: tuple[int, ...] | None
    ) -> tuple[list[Indices], Passes, Indices, list[int], int, int]:
        """Return the fields of a `_Plan` after the grid."""
        spacings = self._spacings
        # A window that loses what is beyond a limit may have a whole range to each side.
        widest = 2 * self.branching_factor - 1 if self.limited == "letter" else self.branching_factor
        later = np.minimum(2 * self._sides(breadths) + 1, widest)
        first = self._first(wraps, zero, spacings[0], later[0])
        # The kernel's memory layout depends on the largest window that is passed to it, so all calls have to pass the same.
        most = int(later.max()) if (later != later[0]).any() else 0
        padded = np.zeros((len(first), max(most, *map(len, first))), dtype=np.int64)
        for row, nodes in zip(padded, first, strict=True):
            row[: len(nodes)] = nodes
        passes = Passes(
            np.array(spacings, dtype=np.int64),
            later[0],
            padded,
            np.array([len(nodes) for nodes in first], dtype=np.int64),
            self.limited == "letter",
            float(self.stop_below) or -1.0,
            0.0,
            self.beam,
            min(self.children or self.beam, self.beam),
        )
        windows = [(1, passes.counts.tolist())]
        windows += [(self.beam, each) for each in later[: len(spacings) - 1].tolist()]
        leaves = sum(cells * math.prod(counts) for cells, counts in windows)
        nodes = sum(
            cells * sum(math.prod(counts[:d]) for d in range(1, len(counts) + 1)) for cells, counts in windows
        )
        changes = np.flatnonzero((later[1:] != later[:-1]).any(axis=1)) + 2
        return first, passes, later, [*changes.tolist(), len(spacings)], leaves, nodes

    def _first(
        self, wraps: tuple[bool, ...], zero: tuple[int, ...] | None, spacing: int, later: Indices
    ) -> list[Indices]:
        """Return the nodes of the first pass, for each joint."""
        offsets, size = self._offsets(np.array(wraps)), self.branching_factor
        if zero is not None:
            if self.offset is not None:
                shifted = [node + int(each * spacing) for node, each in zip(zero, offsets, strict=True)]
                zero = tuple(
                    node % size if wrap else min(node, size - 1)
                    for node, wrap in zip(shifted, wraps, strict=True)
                )
            return window_around(wraps, size, zero, spacing, later, self.limited == "letter")
        return self._spread(offsets)

    def _spread(self, offsets: list[Fraction]) -> list[Indices]:
        """Return D nodes of each joint, one in each cell."""
        count = min(self.divisions, self.branching_factor)
        require_memory(len(offsets) * count, "the first pass tries D values of every joint")
        return [spread_nodes(self.branching_factor, count, each) for each in offsets]

    def _search(
        self,
        problem: Problem,
        plan: _Plan,
        memory: Array,
        deadline: Deadline,
        watch: Callable[[int], object],
    ) -> Found:
        budget = int(np.iinfo(np.int64).max if problem.budget is None else problem.budget)
        plan = self._with_ties(problem, plan)
        arrays, goal, q = problem.arrays, problem.goal.arrays, np.empty(problem.mechanism.dof)
        at = np.array(BEGINNING)
        recorder, before, ends = None, q, plan.ends
        if problem.trace:  # One more pass at a time instead of all at once: the bits are the same.
            recorder, before = self._recorder(problem), problem.start
            ends = list(range(1, len(plan.passes.spacings) + 1))
        for end in ends:
            now = plan.until(end)
            done = descend(arrays, goal, plan.grid, now, budget, PART, memory, at, q)
            while not done and not deadline.passed:
                watch(int(at[TRIED]))
                done = descend(arrays, goal, plan.grid, now, budget, PART, memory, at, q)
            leaves, expanded = int(at[TRIED]), int(at[VISITED])
            created = problem.mechanism.dof * self.branching_factor if self.tree == "static" else expanded
            found = Found(q if leaves else problem.start, leaves, created, expanded, not done)
            if recorder is not None and leaves > recorder.spent:
                held = bytes_of(memory, plan.grid)
                record_pass(recorder, plan.grid, plan.first, now, end - 1, before, found, held)
            if at[STOPPED] or not done:
                break
            before = found.q.copy()
        return found if recorder is None else self._report(recorder, found)

    def _recorder(self, problem: Problem) -> Recorder:
        """Return a recorder of the passes, with a sentence for each joint that may be locked out."""
        recorder = Recorder(problem, self)
        for sentence in self.reach_notes(problem):
            recorder.note(sentence)
        return recorder

    def _report(self, recorder: Recorder, found: Found) -> Found:
        """Add the trace to the result."""
        recorder.note_end(found)
        if recorder.judged(found.q)[2] < self.stop_below:
            recorder.note(f"Stopped at a node with a weighted error below {self.stop_below:g}.")
        return found._replace(trace=recorder.finish())

    def _with_ties(self, problem: Problem, plan: _Plan) -> _Plan:
        tie = tie_of(problem, self.ties)
        return plan._replace(passes=plan.passes._replace(tie=tie)) if tie else plan

    def _ask(
        self, problem: Problem, plan: _Plan, deadline: Deadline, watch: Callable[[int], object]
    ) -> Found:
        from .black_box.asking import Asker
        from .black_box.grid import best_or_start, descend

        box = problem.mechanism
        plan = self._with_ties(problem, plan)
        asker = Asker(box, problem, deadline)
        recorder, held = self._recorder(problem) if problem.trace else None, bytes_of(plan.grid)
        stored = box.dof * self.branching_factor if self.tree == "static" else 0
        before = problem.start

        def on_pass(k: int, q: Array | None, expanded: int) -> None:
            nonlocal before
            best = best_or_start(q, box, problem.start)
            now = Found(best, asker.spent, stored or expanded, expanded)
            if recorder and asker.spent > recorder.spent:
                record_pass(recorder, plan.grid, plan.first, plan.until(k + 1), k, before, now, held)
            before = best

        q, expanded = descend(asker, plan.grid, plan.passes, plan.later, plan.first, watch, on_pass)
        q = best_or_start(q, box, problem.start)
        found = Found(q, asker.spent, stored or expanded, expanded, asker.out_of_time)
        return found if recorder is None else self._report(recorder, found)


def _offsets(given: object) -> float | tuple[float | None, ...]:
    """Read the offset of the first lattice.

    Raises:
        InvalidSolver: The offset is not a fraction of a cell.
    """
    if isinstance(given, Sequence | np.ndarray) and not isinstance(given, str):
        return tuple(None if each is None else _offset(each) for each in given)
    return _offset(given)


def _breadth(name: str, given: Any) -> float:
    """Read a breadth; a whole one as a whole number.

    Raises:
        InvalidSolver: The value is not a breadth.
    """
    number: Any = given if isinstance(given, Real) and not isinstance(given, bool) else math.nan
    # Checked before it becomes a float: a whole number may be larger than any float.
    if 1 <= number <= _MOST_CELLS:
        number = float(number)
        return int(number) if number.is_integer() else number
    raise InvalidSolver(f"{name} must be a number from 1 to {_MOST_CELLS:,}, got {given!r:.200}")


def _offset(given: Any) -> float:
    if is_finite_number(given) and 0.0 <= float(given) < 1.0:
        return float(given)
    raise InvalidSolver(
        f"offset must be at least 0 and below 1, in cells of the first pass; got {given!r:.200}"
    )


class _Plan(NamedTuple):
    """Steps of a search that are the same for every target."""

    grid: Grid
    first: list[Indices]
    """Nodes of the first pass, for each joint."""
    passes: Passes
    """All passes; their breadth is that of the first later one, see `until`."""
    later: Indices
    """Number of nodes of each joint in each pass after the first, (passes, n)."""
    ends: list[int]
    """Numbers of passes after which the breadth changes, and of all passes: the kernel makes those in between in one
    call."""
    leaves: int
    """Most leaves that the passes try."""
    nodes: int
    """Most nodes that the passes visit."""

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Number of joints, most values of any joint, cells, and children of a cell."""
        most = max(self.passes.first.shape[1], int(self.later.max()))
        return len(self.passes.later), most, self.passes.beam, self.passes.children

    def until(self, end: int) -> Passes:
        """Return the first `end` passes, with the breadth of the last of them; a kernel makes those not done yet."""
        if self.ends == [end]:
            return self.passes
        return self.passes._replace(spacings=self.passes.spacings[:end], later=self.later[max(end - 2, 0)])


_memory_size = lru_cache(maxsize=64)(memory_size)  # Summing up takes as long as a hundred leaves.


class _OutOfTimeError(Exception):
    """Raised within a tuning that runs out of time, so that its result is not cached."""


class _Clock:
    """A deadline that does not affect cache keys."""

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

    This takes up to some seconds for six joints, once: the result is cached for the chain.
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
