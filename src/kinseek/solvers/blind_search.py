"""Blind search (Cubero 2008, as described in the paper's Sec. 1): a local search, and the baseline."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.grid.memory import (
    Beam,
    NodeScratch,
    Window,
    make_beam,
    make_node_scratch,
    make_window,
)
from kinseek.kernels.grid.window import PART, PAUSED, nodes_until, search_part, window_nodes
from kinseek.kernels.jit import entry, inlined_with_wrapper
from kinseek.problem import Problem
from kinseek.solution import Solution

from .base import Found, require_whole, watch_each
from .nodes import require_memory, require_patience
from .recording import Look, Recorder, bytes_of, require_room
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
        require_patience(problem, nodes, None, "", self._search, at_most=True)
        return watch_each(problem, self._search, self.most_steps, self.progress, deadline)

    def _search(
        self, problem: Problem, deadline: Deadline, watch: Callable[[int], object] = unwatched
    ) -> Found:
        leaves_a_step = 3**problem.chain.dof
        most = self.most_steps
        if problem.budget is not None:
            most = min(most, max(problem.budget - 1, 0) // leaves_a_step)
        shrink, smallest = (0.0, self.step) if self.shrink is None else (self.shrink, self.smallest_step)
        parameters = np.array([self.step, shrink, smallest, float(most)])
        q = problem.start.copy()
        goal = problem.goal
        tolerances = np.array([goal.position_tolerance, goal.orientation_tolerance])
        dof, best, at = len(q), np.array([self.step, np.inf]), np.zeros(4, dtype=np.int64)
        memory = Memory(make_window(dof, 3), make_node_scratch(dof), make_beam(1, dof), best)
        given = problem.arrays, goal.arrays, problem.chain.wraps, tolerances, parameters
        recorder = Recorder(problem, self) if problem.trace else None
        if recorder:
            done = self._walk_and_record(recorder, given, memory, at, q, deadline)
        else:
            done = walk(*given, PART, memory, at, q)
        while not done and not deadline.passed:
            watch(int(at[STEPS]))
            done = walk(*given, PART, memory, at, q)
        leaves, expanded = int(at[LEAVES]), int(at[EXPANDED])
        if at[NEXT_LEAF] > 0:  # The time ended in the middle of a step.
            leaves += int(at[NEXT_LEAF])
            expanded += nodes_until(memory.window.counts, int(at[NEXT_LEAF]) - 1)
            if memory.beam.errors[0] < best[BEST]:
                q = memory.beam.q[0].copy()
        found = Found(q, leaves, expanded, expanded, not done)
        if recorder:
            recorder.add_rest("a step cut short", found)
            recorder.note_end(found)
            return found._replace(trace=recorder.finish())
        return found

    def _walk_and_record(
        self,
        recorder: Recorder,
        given: tuple[Any, Any, Any, Any, Array],
        memory: Memory,
        at: Indices,
        q: Array,
        deadline: Deadline,
    ) -> bool:
        """Make one step after the other and record each; return whether the walk is done. The bits are those of one call."""
        arrays, goal, wraps, tolerances, parameters = given
        chain, most, memory_bytes = recorder.problem.chain, int(parameters[3]), bytes_of(memory)
        for step in range(most + 1):
            before, delta = q.copy(), float(memory.now[STEP])
            until = np.array([*parameters[:3], float(min(step + 1, most))])
            ended = walk(arrays, goal, wraps, tolerances, until, PART, memory, at, q)
            while not ended and not deadline.passed:
                ended = walk(arrays, goal, wraps, tolerances, until, PART, memory, at, q)
            if recorder.empty:
                recorder.add("start", before, 1, memory=memory_bytes)
            if not ended:
                return False
            if at[STEPS] == step:  # No step was made: the walk is done.
                return True
            reach = np.where(chain.wraps, delta, 0.0)
            low = np.maximum(before - delta, chain.lower - reach)
            high = np.minimum(before + delta, chain.upper + reach)
            window = Look(np.full(len(q), delta), low, high, np.full(len(q), 3))
            spent, expanded = int(at[LEAVES]), int(at[EXPANDED])
            recorder.add(f"step {step + 1}", q, spent, expanded, expanded, memory=memory_bytes, window=window)
        return True


class Memory(NamedTuple):
    """Memory and state of a walk."""

    window: Window
    scratch: NodeScratch
    beam: Beam
    """Beam with one leaf."""
    now: Annotated[Array, 2, OUT]
    """The step Δ, and the weighted error at q, (2,)."""


STEP, BEST = range(2)
NEXT_LEAF, LEAVES, EXPANDED, STEPS = range(4)
"""Progress of a walk: index of the next leaf in its step's window; total leaves, nodes and steps that are done."""


@entry
def walk(
    chain: ChainArrays,
    goal: GoalArrays,
    wraps: Annotated[Flags, "n"],
    tolerances: Annotated[Array, 2],
    parameters: Annotated[Array, 4],
    work: int,
    memory: Memory,
    at: Annotated[Indices, 4, OUT],
    q: Annotated[Array, "n", OUT],
) -> bool:
    """Walk q downhill in place; return whether the walk is done.

    Args:
        chain: The arm.
        goal: The goal.
        wraps: Whether each joint may cross from one end of its range to the other.
        tolerances: Stop within these, [m] and [rad], (2,).
        parameters: First step, shrink factor, smallest step, most steps, (4,).
        work: Work of this call, in leaves; it does slightly more.
        memory: At the beginning it holds the first step and no error.
        at: Progress of the walk, see `NEXT_LEAF`: zeros at its beginning.
        q: Start, and then the result, (n,).
    """
    dof, window, scratch, beam, now = len(q), memory.window, memory.scratch, memory.beam, memory.now
    T = np.empty((3, 4))
    forward(chain, q, T)
    if at[LEAVES] == 0:
        now[BEST], at[LEAVES] = weighted_error(T, goal), 1
    while now[STEP] >= parameters[2] and at[STEPS] < parameters[3]:
        if at[NEXT_LEAF] == 0:
            position, orientation = errors(T, goal)
            if position <= tolerances[0] and orientation <= tolerances[1]:
                break
            combinations(chain, wraps, q, now[STEP], window)
            beam.errors[0] = now[BEST]
        leaf, ended, work = search_part(
            chain, goal, window, -1.0, 0.0, 1 << 62, at[NEXT_LEAF], work, beam, scratch
        )
        at[NEXT_LEAF] = leaf
        if ended == PAUSED:
            return False
        at[NEXT_LEAF] = 0
        at[LEAVES] += leaf
        at[EXPANDED] += window_nodes(window.counts)
        at[STEPS] += 1
        if beam.errors[0] < now[BEST] * (1.0 - 1e-15):
            now[BEST] = beam.errors[0]
            for d in range(dof):
                q[d] = beam.q[0, d]
            forward(chain, q, T)
        else:
            now[STEP] *= parameters[1]
        if work <= 0:
            return False
    return True


@inlined_with_wrapper
def combinations(chain: ChainArrays, wraps: Flags, q: Array, step: float, window: Window) -> None:
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
