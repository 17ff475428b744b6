"""Blind search (Cubero 2008, as described in the paper's Sec. 1): a local search, and the baseline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.grid.memory import Window, grid_memory, memory_size
from kinseek.kernels.grid.window import PART, PAUSED, Limits, leaf_count, nodes_expanded, search_window
from kinseek.kernels.jit import entry, inlined
from kinseek.problem import Problem
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline

from .base import Found, require_whole, watch_each
from .nodes import require_memory, require_patience
from .recording import Recorder, Region, require_room
from .threads import unwatched
from .traits import Near, Traits, require


@dataclass(frozen=True)
class BlindSearch:
    """From a start, try all 3^n combinations of -Δ, 0, +Δ, take the best, and shrink Δ if none improves.

    This departs from the paper, whose changes are fixed: ``shrink=None`` is the paper's version. The search only works from
    a start close to the goal, as its author says. Each step costs 3^n FK evaluations.

    Raises:
        InvalidSolver: A parameter is out of its range.
    """

    traits: ClassVar[Traits] = Traits(
        source="Cubero 2008",
        finds="a local minimum",
        work="3ⁿ FK evaluations per step",
        near=Near.START,
        axes=True,
    )

    step: float = 0.1
    """Δ at the start, [rad] or [m]."""
    shrink: float | None = 0.5
    """Factor on Δ if no combination improves; None keeps Δ fixed, as the paper does, and ends the search there."""
    smallest_step: float = 1e-9
    """Stop below this Δ, [rad] or [m]; not used with a fixed Δ."""
    most_steps: int = 1000
    """Maximum number of steps."""
    progress: bool = False
    """Show a progress bar of the largest possible number of steps."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        if not (np.isfinite(self.step) and self.step > 0):
            raise InvalidSolver(f"step must be a finite number > 0, got {self.step}")
        if self.shrink is not None and not 0 < self.shrink < 1:
            raise InvalidSolver(
                f"shrink must be between 0 and 1, or None for the paper's fixed changes, got {self.shrink}"
            )
        if not (np.isfinite(self.smallest_step) and self.smallest_step > 0):
            raise InvalidSolver(f"smallest_step must be a finite number > 0, got {self.smallest_step}")
        require_whole(self, "most_steps", 1)

    def solve(self, problem: Problem) -> Solution:
        """Return the best configuration on the way from `problem.start`."""
        require(self, problem)
        require_room(problem, self.most_steps + 1)
        leaves_a_step = 3**problem.chain.dof
        require_memory(leaves_a_step // 1000, "one step of blind search tries 3^n combinations")
        deadline = Deadline(problem.time_limit)
        nodes = self.most_steps * sum(3**d for d in range(1, problem.chain.dof + 1))
        memory = np.empty(memory_size(problem.chain.dof, 3, 1, 1))

        def search(one: Problem, until: Deadline, watch: Callable[[int], object] = unwatched) -> Found:
            return self._search(one, memory, until, watch)

        require_patience(problem, nodes, None, "", search, at_most=True)
        return watch_each(problem, search, self.most_steps, self.progress, deadline)

    def _search(
        self, problem: Problem, memory: Array, deadline: Deadline, watch: Callable[[int], object]
    ) -> Found:
        goal, chain, dof = problem.goal, problem.chain, problem.chain.dof
        most = self.most_steps
        if problem.budget is not None:
            most = min(most, max(problem.budget - 1, 0) // 3**dof)
        shrink, smallest = (0.0, self.step) if self.shrink is None else (self.shrink, self.smallest_step)
        tolerances = goal.position_tolerance, goal.orientation_tolerance
        rules = Rules(chain.wraps, *tolerances, shrink, smallest, most)
        q = problem.start.copy()
        now, progress = np.array([self.step, np.inf]), np.zeros(4, dtype=np.int64)

        def walk_until(step: int) -> bool:
            until = problem.arrays, goal.arrays, rules._replace(most_steps=min(step, most))
            done = walk(*until, PART, memory, progress, now, q)
            while not done and not deadline.passed:
                watch(int(progress[STEPS]))
                done = walk(*until, PART, memory, progress, now, q)
            return done

        if not problem.trace:
            done = walk_until(most)
            return Found(q, *_work_of(progress), not done)
        recorder = Recorder(problem, self)
        for step in range(most + 1):
            before, delta = q.copy(), float(now[STEP])
            done = walk_until(step + 1)
            if recorder.empty:
                recorder.add("start", before, 1, memory=memory.nbytes)
            if not done or progress[STEPS] == step:  # Without a step the walk is done.
                break
            reach = np.where(chain.wraps, delta, 0.0)
            low = np.maximum(before - delta, chain.lower - reach)
            high = np.minimum(before + delta, chain.upper + reach)
            window = Region(np.full(dof, delta), low, high, np.full(dof, 3))
            recorder.add(f"step {step + 1}", q, *_work_of(progress), memory=memory.nbytes, window=window)
        found = Found(q, *_work_of(progress), not done)
        recorder.add_rest("a step cut short", found)
        recorder.note_end(found)
        return found._replace(trace=recorder.finish())


class Rules(NamedTuple):
    """Rules of a walk."""

    wraps: Annotated[Flags, "n"]
    """True for a joint that may cross from one end of its range to the other, (n,)."""
    position_tolerance: float
    """The walk ends within both tolerances, [m]."""
    orientation_tolerance: float
    """[rad]"""
    shrink: float
    """Factor on the step Δ if no combination improves."""
    smallest_step: float
    """The walk ends below this Δ, [rad] or [m]."""
    most_steps: int


STEP, ERROR = range(2)
"""State of a walk: the step Δ, [rad] or [m], and the weighted error at q."""
STEPS, LEAF, LEAVES, NODES = range(4)
"""Progress of a walk: finished steps; evaluated leaves of the present step; and all leaves and nodes so far."""


def _work_of(progress: Indices) -> tuple[int, int, int]:
    """Return evaluations, and nodes created and visited."""
    leaves, nodes = progress[LEAVES:].tolist()
    return leaves, nodes, nodes


@entry
def walk(
    chain: ChainArrays,
    goal: GoalArrays,
    rules: Rules,
    work: int,
    memory: Annotated[Array, "*", OUT],
    progress: Annotated[Indices, 4, OUT],
    now: Annotated[Array, 2, OUT],
    q: Annotated[Array, "n", OUT],
) -> bool:
    """Walk q downhill in place; return whether the walk is done.

    Args:
        chain: The arm.
        goal: The goal.
        rules: When a step is made, and when the walk ends.
        work: Work of this call, in leaves; it does slightly more.
        memory: Memory of a descent with three values a joint and one cell.
        progress: Progress of the walk, see `STEPS`: zeros at its beginning.
        now: State of the walk, see `STEP`: the first step and no error at its beginning.
        q: Start, and then the best so far, (n,).
    """
    views = grid_memory(memory, len(q), 3, 1, 1)
    scratch, best, T = views.scratch, views.odd, np.empty((3, 4))
    forward(chain, q, T)
    if progress[LEAVES] == 0:
        now[ERROR], progress[LEAVES] = weighted_error(T, goal), 1
    while now[STEP] >= rules.smallest_step and progress[STEPS] < rules.most_steps:
        if progress[LEAF] == 0:
            position, orientation = errors(T, goal)
            if position <= rules.position_tolerance and orientation <= rules.orientation_tolerance:
                break
            write_combinations(chain, rules.wraps, q, now[STEP], scratch.window)
            best.errors[0] = now[ERROR]
        limits = Limits(-1.0, 0.0, leaf_count(scratch.window.counts, 0), work)
        state = search_window(chain, goal, limits, progress[LEAF], best, scratch)
        counts, before, work = scratch.window.counts, progress[LEAF], state.work
        progress[LEAVES] += state.leaf - before
        progress[NODES] += nodes_expanded(counts, state.leaf) - nodes_expanded(counts, before)
        # A decrease by rounding alone is no progress.
        better = best.errors[0] < now[ERROR] * (1.0 - 1e-15)
        if better:
            for d in range(len(q)):
                q[d] = best.q[0, d]
        progress[LEAF] = state.leaf
        if state.ended == PAUSED:
            return False
        progress[LEAF] = 0
        progress[STEPS] += 1
        if better:
            now[ERROR] = best.errors[0]
            forward(chain, q, T)
        else:
            now[STEP] *= rules.shrink
        if work <= 0:
            return False
    return True


@inlined
def write_combinations(chain: ChainArrays, wraps: Flags, q: Array, step: float, window: Window) -> None:
    """Write q - Δ, q and q + Δ, clipped to the limits, into the window."""
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
