"""The atlas: sort the search space once, then one answer takes microseconds (the default).

The paper's divide and conquer assumes that what it searches is sorted, and forward kinematics is not. So it is
sorted: see `kernels.atlas` for the idea, and `kernels.refine` for what happens to one goal.
"""

from __future__ import annotations

import math
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.errors import MissingExtra
from kinseek.goal import DEFAULT_TOLERANCE, KINDS, Goal
from kinseek.kernels.arrays import Array, ChainArrays, Indices
from kinseek.kernels.atlas.batch import solve_many, solve_some
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.near import solve_many_near
from kinseek.kernels.atlas.one_goal import add_ending, routines
from kinseek.kernels.atlas.samples import NONE, SLIDE, TURN, Division, build_atlas
from kinseek.kernels.atlas.task import OPEN, task_arrays
from kinseek.kernels.atlas.tree import LEAF
from kinseek.kernels.pointers import handle_of
from kinseek.problem import Problem
from kinseek.ranges import free_turns
from kinseek.robots.blackbox import BlackBox
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution, conclude
from kinseek.solvers.base import Found, solve_each, whole
from kinseek.solvers.threads import GoOn, spread

SAMPLES = 16_384

CHUNK = 1024
"""Targets that a thread takes at a time: some milliseconds, so that Ctrl-C is heard."""

_PIECE = 16
"""Targets that are done at a stretch one after the other: some milliseconds if they are hard."""


@dataclass(frozen=True)
class Atlas:
    """Look the goal up among sorted samples of the arm, and refine the nearest.

    Raises:
        InvalidSolver: A parameter out of its range.
    """

    samples: int = SAMPLES
    """Samples of the middle joints; more cost memory and time to build, and start closer."""
    threads: int | None = None
    """Threads for a batch; None takes every core. The answers are the same bits. An arm that is a function is asked by
    one thread."""
    progress: bool = False
    """Show a progress bar while a batch is solved."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        whole("samples", self.samples, 8, 2**24)
        if self.threads is not None:
            whole("threads", self.threads, 1)

    def solve(self, problem: Problem) -> Solution:
        """Answer by what the nearest sample leads to, else the next nearest; else by the best pose found."""
        goal, chain = problem.goal, problem.chain
        if isinstance(chain, BlackBox):
            return self._ask(chain, problem)
        if goal.kind == "box":
            from .ranges import solve_ranges

            return solve_ranges(self, problem)
        deadline = Deadline(problem.time_limit)
        index = atlas_of(chain, goal, self.samples)
        wanted = wanted_of(goal, problem.budget)
        targets = goal.targets
        results, done = np.empty((len(targets), chain.dof + 4)), np.zeros(len(targets), dtype=bool)

        def one_by_one(some: Indices, go_on: GoOn) -> None:
            for first in range(0, len(some), _PIECE):
                if not go_on():
                    return
                last = min(first + _PIECE, len(some))
                solve_some(index.handle, wanted, targets, results, some, first, last, LANES)
                done[some[first:last]] = True

        def in_lanes(begin: int, end: int, go_on: GoOn) -> None:
            left = np.empty(end - begin, dtype=np.int64)
            count = solve_many(index.handle, wanted, targets, results, left, begin, end, LANES)
            done[begin:end] = True
            if count:
                done[left[:count]] = False
                one_by_one(left[:count], go_on)

        if problem.near is None and (problem.budget is not None or len(targets) == 1):
            one_by_one(np.arange(len(targets)), lambda: not deadline.passed)
        elif problem.near is None:
            self.spread(in_lanes, len(targets), deadline)
        else:
            near = np.ascontiguousarray(np.broadcast_to(problem.near, (*goal.shape, chain.dof)))
            near = near.reshape(-1, chain.dof)

            def from_starts(begin: int, end: int, go_on: GoOn) -> None:
                for first in range(begin, end, _PIECE):
                    if not go_on():
                        return
                    last = min(first + _PIECE, end)
                    solve_many_near(index.handle, wanted, targets, near, results, first, last, LANES)
                    done[first:last] = True

            self.spread(from_starts, len(targets), deadline)
        return batch_solution(problem, results, done)

    def _ask(self, box: BlackBox, problem: Problem) -> Solution:
        from kinseek.solvers.black_box.atlas import answer

        with _progress_bar(self.progress, len(problem.goal.targets)) as advance:

            def search(one: Problem, deadline: Deadline) -> Found:
                found = answer(box, one, self.samples, deadline)
                advance(1)
                return found

            return solve_each(problem, search)

    def spread(self, work: Callable[[int, int, GoOn], None], count: int, deadline: Deadline) -> None:
        """Do the work on all targets, on all threads, with a progress bar; see `threads.spread`."""
        if 0 < count <= CHUNK and not self.progress:  # The same, without what takes as long as a target does.
            if not deadline.passed:
                work(0, count, lambda: not deadline.passed)
            return
        with _progress_bar(self.progress, count) as advance:
            spread(work, count, CHUNK, self.threads, deadline, advance)


class AtlasIndex:
    """The atlas of one arm for one kind of goal: immutable, shared by threads."""

    def __init__(
        self,
        chain: SerialChain,
        kind: str,
        arrays: ChainArrays,
        samples: int,
        of_tip: AtlasIndex | None = None,
        tool: Array | None = None,
    ) -> None:
        """Sample the middle joints and sort the samples; or share those of the tip's own atlas.

        Where the whole pose of a tool is asked, that of the tip is known: the samples of one serve the other.
        """
        began = time.perf_counter()
        division = divide(chain, kind)
        if of_tip is None or tool is None:
            points, first = middle_samples(chain, division, samples)
            head = inverse(chain.fixed[0]) if division.head != NONE else np.eye(4)[:3]
            tip = inverse(arrays.fixed[-1]) if division.tail != NONE else np.eye(4)[:3]
            self.sorted = build_atlas(arrays, division, points, first, head.copy(), tip.copy())
        else:
            tip = inverse(arrays.fixed[-1] if division.tail != NONE else tool[:3])
            self.sorted = of_tip.sorted._replace(inverse_tip=tip)
        lower, upper = open_limits(chain)
        counted = KINDS[kind]
        columns = (np.arange(3) < counted).astype(float) * (0.5 if counted == 3 else 1.0)
        self._routines = routines()
        self._arrays = task_arrays(
            arrays, self.sorted, division, lower, upper, columns, arm_length(chain) / 3, self._routines, PLAIN
        )
        self._addresses = handle_of(self._arrays)
        self.address: int = self._addresses.ctypes.data
        """Address of the handle, for the kernels that may do with the routines that every goal needs."""
        self.samples = len(self.sorted.middle)
        """Number of samples."""
        self.memory = sum(array.nbytes for array in self._arrays)
        """[bytes]"""
        self.build_time = time.perf_counter() - began
        """[s]; the first in a process includes loading or compiling the kernels."""

    @cached_property
    def handle(self) -> Indices:
        """Addresses of the arrays, for kernels, and of every routine they may call."""
        add_ending(self._routines)  # The very array that kernels read, for it is contiguous.
        return self._addresses

    def __repr__(self) -> str:
        """Size and cost."""
        return (
            f"AtlasIndex({self.samples} samples, {self.memory / 2**20:.1f} MiB, "
            f"built in {self.build_time * 1e3:.0f} ms)"
        )


_Shelf = OrderedDict[tuple[str, int, bytes | None], AtlasIndex]
_indices: weakref.WeakKeyDictionary[SerialChain, _Shelf] = weakref.WeakKeyDictionary()
_building = threading.RLock()

KEPT = 16
"""Atlases of other tools and tool axes that an arm keeps, the last ones used."""


def atlas_of(chain: SerialChain, goal: Goal | None = None, samples: int = SAMPLES) -> AtlasIndex:
    """The atlas of an arm for a kind of goal: built at the first call, dropped with the arm.

    Another tool shares the samples where the whole pose is asked; where the tip's pose is open, it has its own. Those of
    the last `KEPT` tools and tool axes are kept.
    """
    kind = "pose" if goal is None else seeded_as(goal)
    tip = None if goal is None else goal.tip
    key = (kind, samples, None if tip is None else tip.tobytes())
    with _building:
        mine = _indices.setdefault(chain, OrderedDict())
        if key not in mine:
            arrays = chain.arrays if goal is None else Problem(chain, goal).arrays
            of_tip = atlas_of(chain, None, samples) if kind == "pose" and tip is not None else None
            mine[key] = AtlasIndex(chain, kind, arrays, samples, of_tip, tip)
        mine.move_to_end(key)
        of_tools = [other for other in mine if other[2] is not None]
        for oldest in of_tools[:-KEPT]:
            del mine[oldest]
        return mine[key]


def seeded_as(goal: Goal) -> str:
    """Kind of the atlas that gives a goal its seeds: ranges that leave every orientation need positions alone."""
    if goal.kind != "box" or goal.ranges is None:
        return goal.kind
    return "position" if goal.swing is None and len(free_turns(goal.ranges)) == 3 else "pose"


def wanted_of(goal: Goal, budget: int | None = None) -> Array:
    """A goal's tolerances and weights as the kernels take them, (7,)."""
    most = np.inf if budget is None else float(budget)
    boxed = np.array([goal.orientation_weight, 0.0, 0.0])
    weights = boxed if goal.kind == "box" else goal.arrays.axis_weights
    return np.array(
        [goal.position_tolerance, goal.orientation_tolerance, goal.position_weight, most, *weights],
        dtype=float,
    )


def batch_solution(problem: Problem, results: Array, done: NDArray[np.bool_]) -> Solution:
    """Make a solution of the rows that the kernels write, (k, n + 4); those not done, (k,), get where a search starts."""
    late = problem.time_limit is not None and not done.all()
    if late:
        results[~done] = _starts(problem, ~done)
    goal, dof, shape = problem.goal, problem.chain.dof, problem.goal.shape
    position, orientation, weighted, spent = (results[:, dof + i] for i in range(4))
    success = (position <= goal.position_tolerance) & (orientation <= goal.orientation_tolerance)

    def field(column: Any) -> Any:
        return column.reshape(shape).copy() if shape else column[0].item()

    nothing = np.zeros(len(results), dtype=np.int64)
    return Solution(
        q=results[:, :dof].reshape(*shape, dof).copy(),
        success=field(success),
        position_error=field(position),
        orientation_error=field(orientation),
        weighted_error=field(weighted),
        evaluations=field(spent.astype(np.int64)),
        nodes_created=field(nothing),
        nodes_expanded=field(nothing),
        problem=problem,
        out_of_time=field(~done) if late else np.zeros(shape, dtype=bool) if shape else False,
    )


def _starts(problem: Problem, late: NDArray[np.bool_]) -> Array:
    """Rows as the kernels write them for targets that were not begun, (k, n + 4)."""
    goal, dof = problem.goal, problem.chain.dof
    q = np.broadcast_to(problem.start, (*goal.shape, dof)).reshape(-1, dof)[late]
    targets = np.asarray(goal.target).reshape(-1, *goal.target.shape[len(goal.shape) :])[late]
    judged = conclude(
        replace(problem, goal=goal.at(targets), near=None), q, np.zeros((len(q), 3), dtype=np.int64)
    )
    errors = judged.position_error, judged.orientation_error, judged.weighted_error, np.zeros(len(q))
    return np.column_stack([q, *errors])


def middle_samples(chain: SerialChain, division: Division, samples: int) -> tuple[Array, int]:
    """Spread samples over the joints that are not divided out; return them and the first such joint."""
    first, last = int(division.head != NONE), chain.dof - int(division.tail != NONE)
    wanted = min(samples, 64 ** max(last - first, 0))
    count = LEAF * 2 ** max(math.ceil(math.log2(max(wanted, LEAF) / LEAF)), 0)
    lower, upper = chain.lower[first:last].copy(), chain.upper[first:last].copy()
    turns = np.array([kind != "prismatic" for kind in chain.kinds[first:last]], dtype=bool)
    wide = turns & (upper - lower > 2 * np.pi)  # One turn has them all.
    middle = (lower + upper) / 2
    lower[wide], upper[wide] = middle[wide] - np.pi, middle[wide] + np.pi
    centred = low_discrepancy(count, last - first) - 0.5
    # Answers crowd in the corners of the limits, where a sample inside leads past them: every eighth sample is
    # spread twice as wide and brought back, so that each of its joints stands at a limit half of the time.
    corner = np.arange(count) % 8 == 7
    centred[corner] = np.clip(2 * centred[corner], -0.5, 0.5)
    return np.ascontiguousarray(lower + (centred + 0.5) * (upper - lower)), first


def open_limits(chain: SerialChain) -> tuple[Array, Array]:
    """Limits for refining: none for a joint whose range holds a full turn, since it can always go on."""
    free = (chain.upper - chain.lower >= 2 * np.pi - 1e-9) & chain.periodic
    far = np.where(np.array(chain.kinds) == "continuous", np.inf, OPEN)
    return np.where(free, -far, chain.lower), np.where(free, far, chain.upper)


def divide(chain: SerialChain, kind: str) -> Division:
    """Choose what can be divided out of an arm for a kind of goal."""
    dof, _joints = chain.dof, len(chain.leader)
    alone = np.bincount(chain.leader, minlength=dof) == 1
    head = NONE
    if dof > 1 and chain.leader[0] == 0 and alone[0]:
        head = SLIDE if chain.prismatic[0] else TURN
    tail = NONE
    if kind == "pose" and dof > 1 and chain.leader[-1] == dof - 1 and alone[-1] and not chain.prismatic[-1]:
        tail = TURN
    columns = {"pose": 1 if tail == TURN else 2, "pointing": 1, "position": 0}[kind]
    return Division(head, tail, columns, arm_length(chain) / 3)


def arm_length(chain: SerialChain) -> float:
    """Length of the stretched arm from its first axis on [m]: links, and the longer half of each slide."""
    links = float(np.linalg.norm(chain.fixed[1:, :, 3], axis=1).sum())
    for k in np.flatnonzero(chain.prismatic):
        i = chain.leader[k]
        links += max(abs(chain.lower[i]), abs(chain.upper[i])) * abs(float(chain.multiplier[k])) / 2
    return max(links, 1e-3)


def low_discrepancy(count: int, dimensions: int) -> Array:
    """Well-spread points of the unit cube, (count, dimensions) (Roberts 2018, the R_d sequence)."""
    g = 2.0
    for _ in range(40):
        g = (1 + g) ** (1 / (dimensions + 1))
    steps = g ** -np.arange(1.0, dimensions + 1)
    return np.asarray((0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0)


def inverse(A: Array) -> Array:
    """Inverse of a rigid transform, (3, 4)."""
    turn = A[:, :3].T
    return np.hstack([turn, -turn @ A[:, 3:]])


PLAIN = np.array([DEFAULT_TOLERANCE, DEFAULT_TOLERANCE, 1.0, np.inf, 1.0, 1.0, 0.0])
"""`wanted_of` a goal that is just a pose; written out, since to make a goal runs a kernel, and importing shall run none."""


@contextmanager
def _progress_bar(wanted: bool, total: int) -> Iterator[Callable[[int], object]]:
    """Give a function that is told how many more targets are done."""
    if not wanted:
        yield lambda count: None
        return
    try:
        from rich.console import Console
        from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn
    except ImportError:
        raise MissingExtra("A progress bar", "cli") from None
    columns = (*Progress.get_default_columns()[:-1], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("solving", total=total)
        yield lambda count: bar.advance(task, count)
