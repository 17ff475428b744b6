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
from typing import Any, ClassVar

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Flags, Indices
from kinseek.kernels.grid.descent import Passes
from kinseek.kernels.grid.window import FINISHED
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline
from kinseek.support.validation import as_flag, is_finite_number

from .base import Found, require_whole, solve_each, watch_each
from .breadth_tuning import Walk, probe_joints, widen_by_trial, window_leaves
from .grid_search import GridSearch, Plan, passes_of
from .nodes import (
    MOST_NODES,
    evenly_spaced_nodes,
    joint_grid,
    require_error,
    require_memory,
    require_patience,
    require_ties,
    window_around,
    zero_nodes,
)
from .recording import Recorder, record_pass, require_room
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
        work="proportional to log B",
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
    """K: cells of a pass that the next one searches; the paper has 1."""
    children: int | None = None
    """Most cells of the beam that come from one cell of the pass before; fewer keep it spread out. None sets no limit."""
    node_budget: int = 20_000
    """Leaves per pass and cell that ``breadth="tuned"`` may use."""
    wrap: bool = True
    """Whether the neighbourhood of a joint with a full turn may cross from its last node to its first."""
    most_nodes: int | None = MOST_NODES
    """Largest number of nodes of a search without a time limit, about a minute of work; None sets no limit."""
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
    """Stop at the first node whose weighted error is below this; 0 never stops early."""
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
        as_flag("wrap", self.wrap, InvalidSolver)
        require_ties(self.ties)
        if self.ties == "first" and self.beam > 1:
            raise InvalidSolver(
                f"ties='first' needs a search that keeps one cell, as in the paper; got beam={self.beam}"
            )
        if self.offset is not None:
            object.__setattr__(self, "offset", _offsets(self.offset))
        if isinstance(self.breadth, str):
            if self.breadth not in ("tuned", "reach"):
                raise InvalidSolver(
                    f"breadth must be a number, one number per joint, 'reach' or 'tuned'; got {self.breadth!r}"
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
                "breadth='tuned' runs the search many thousand times, which is too expensive for black-box "
                "kinematics; give one number, or one per joint"
            )
        deadline = Deadline(problem.time_limit)
        try:
            plan = self._plan(problem, deadline)
        except _OutOfTimeError:
            return solve_each(problem, lambda one, _: Found(one.start, 0, out_of_time=True), deadline)
        require_room(problem, len(plan.passes.spacings))
        memory = plan.memory

        def search(one: Problem, until: Deadline, watch: Callable[[int], object] = unwatched) -> Found:
            return self._search(one, GridSearch(one, plan, self.ties, memory, until, watch))

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
                f"breadth must be one number or {chain.dof}, one per joint ({', '.join(chain.joint_names)}); got "
                f"{len(self.breadth)}: {self.breadth}"
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
        spacings = self._spacings[1:]
        # Around the zero configuration the first nodes may be anywhere; at a limit the distance is largest.
        at_limit = [np.zeros(1, dtype=np.int64)] * len(wraps)
        first = at_limit if self.first == "formula" else self._evenly_spaced(self._offsets(np.array(wraps)))
        clips = self.limited == "letter"
        return [
            Walk(spacings, self.branching_factor, each, clips, nodes)
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
                f"offset must be one number or {len(wraps)}, one per joint; got {len(given)}: {self.offset}"
            )
        # Departs from the paper, which starts at the lower limit for every joint. The middles of D equal cells keep both
        # ends of a range within reach of the later, ever smaller windows.
        middles = ~wraps & (self.limited != "letter")
        default = [Fraction(1, 2) if each else Fraction(0) for each in middles]
        return [own if each is None else Fraction(each) for own, each in zip(default, given, strict=True)]

    def _plan(self, problem: Problem, deadline: Deadline) -> Plan:
        """Return the plan that all targets of a problem share."""
        static, letter = self.tree == "static", self.limited == "letter"
        size, mechanism = self.branching_factor, problem.mechanism
        grid = joint_grid(mechanism, size, static=static, wrap=self.wrap, letter=letter)
        breadths = self.breadths(problem, deadline)
        # The first nodes depend on the arm only if they are placed around the zero configuration.
        zero = tuple(zero_nodes(grid)) if self.first == "formula" else None
        passes, leaves, nodes = self._passes(breadths, tuple(grid.wraps.tolist()), zero)
        return Plan(grid, passes, mechanism.dof * size if static else 0, leaves, nodes)

    @lru_cache(maxsize=64)  # noqa: B019  # A plan takes longer than a small search; this keeps searches, which are small too.
    def _passes(
        self, breadths: tuple[int, ...], wraps: tuple[bool, ...], zero: tuple[int, ...] | None
    ) -> tuple[Passes, int, int]:
        """Return the passes, the most leaves that they try, and the most nodes that they visit."""
        spacings, letter = self._spacings, self.limited == "letter"
        # A window that loses what is beyond a limit may have a whole range to each side.
        widest = 2 * self.branching_factor - 1 if letter else self.branching_factor
        counts = np.minimum(2 * self._sides(breadths) + 1, widest)
        first = self._first(wraps, zero, spacings[0], counts[0])
        return passes_of(
            first,
            counts[: len(spacings) - 1],
            spacings,
            clips=letter,
            stop_below=self.stop_below,
            beam=self.beam,
            children=self.children,
        )

    def _first(
        self, wraps: tuple[bool, ...], zero: tuple[int, ...] | None, spacing: int, counts: Indices
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
            return window_around(wraps, size, zero, spacing, counts, self.limited == "letter")
        return self._evenly_spaced(offsets)

    def _evenly_spaced(self, offsets: list[Fraction]) -> list[Indices]:
        """Return D nodes of each joint, one in each cell."""
        count = min(self.divisions, self.branching_factor)
        require_memory(len(offsets) * count, "the first pass tries D values of every joint")
        return [evenly_spaced_nodes(self.branching_factor, count, each) for each in offsets]

    def _search(self, problem: Problem, search: GridSearch) -> Found:
        plan = search.plan
        passes = len(plan.passes.spacings)
        if not problem.trace:
            return search.until(passes)
        recorder, before = Recorder(problem, self), problem.start
        for sentence in self.reach_notes(problem):
            recorder.note(sentence)
        # The search continues after each pass and is not repeated, so the trace costs no evaluations.
        for end in range(1, passes + 1):
            found = search.until(end)
            if found.evaluations > recorder.spent:
                record_pass(recorder, plan, end - 1, before, found, search.bytes_used)
            if search.ended != FINISHED:
                break
            before = found.q
        recorder.note_end(found)
        if recorder.judged(found.q)[2] < self.stop_below:
            recorder.note(f"Stopped at a node with a weighted error below {self.stop_below:g}.")
        return found._replace(trace=recorder.finish())


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
