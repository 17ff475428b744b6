"""The search of a grid for one target, pass by pass, by machine code or by calling the user's kinematics.

Both kinds of search have the same plan, windows, beams and counts, those of `kernels.grid.descent`; they differ in what
evaluates the leaves. Black-box kinematics have no links and so no shared prefixes: a leaf is one pose, and nodes above the
leaves are counted but cost nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.grid.descent import (
    BEGINNING,
    LEAF,
    LEAVES,
    NODES,
    Grid,
    Passes,
    descend,
    keep_leaves,
    write_leaves,
)
from kinseek.kernels.grid.memory import memory_size
from kinseek.kernels.grid.window import FINISHED, PART, PAUSED, STOPPED
from kinseek.problem import Problem
from kinseek.support.deadline import Deadline

from .base import Found
from .black_box.evaluator import Evaluator
from .nodes import tie_of
from .recording import bytes_of

CALL, DEAR_CALL, FIRST_CALL = 8192, 256, 64
"""Most leaves in a call of the user's function; fewer if every row runs Python code, so that a time limit takes effect; and
those of the first call of a window if a good leaf ends the search."""


class Plan(NamedTuple):
    """Steps of a search that are the same for every target."""

    grid: Grid
    passes: Passes
    created: int
    """Nodes that are made in advance; 0 if each is made when it is visited."""
    leaves: int
    """Most leaves that the passes try."""
    nodes: int
    """Most nodes that the passes visit."""

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Number of joints, most values of any joint, cells, and children of a cell."""
        return *self.passes.first.shape, self.passes.beam, self.passes.children

    @property
    def memory(self) -> Array:
        """New memory for the searches of all targets, one after the other."""
        return np.empty(memory_size(*self.sizes))

    @property
    def first(self) -> list[Indices]:
        """Nodes of the first pass, for each joint."""
        return [nodes[:count] for nodes, count in zip(self.passes.first, self.passes.counts[0], strict=True)]


def passes_of(
    first: list[Indices],
    later_counts: Indices,
    spacings: list[int],
    *,
    clips: bool = False,
    stop_below: float = 0.0,
    beam: int = 1,
    children: int | None = None,
) -> tuple[Passes, int, int]:
    """Return the passes of a plan, the most leaves that they try, and the most nodes that they visit.

    Args:
        first: Nodes of the first pass, for each joint.
        later_counts: Number of nodes of each joint in each later pass, (passes - 1, n).
        spacings: Spacing of the nodes in each pass.
        clips: Whether a window is truncated at a limit.
        stop_below: Weighted error of a leaf that ends the search; 0 for none.
        beam: Number of cells that a pass leaves to the next.
        children: Number of cells that one cell may leave; None sets no limit.
    """
    counts = np.array([[len(nodes) for nodes in first], *later_counts.tolist()], dtype=np.int64)
    padded = np.zeros((len(first), int(counts.max())), dtype=np.int64)
    for row, nodes in zip(padded, first, strict=True):
        row[: len(nodes)] = nodes
    windows = [(beam if k else 1, each) for k, each in enumerate(counts.tolist())]
    leaves = sum(cells * math.prod(each) for cells, each in windows)
    nodes_visited = sum(
        cells * sum(math.prod(each[:d]) for d in range(1, len(each) + 1)) for cells, each in windows
    )
    # No error is below -1, so the search then never stops early.
    stop, few = float(stop_below) or -1.0, min(children or beam, beam)
    spaced = np.array(spacings, dtype=np.int64)
    no_budget = np.iinfo(np.int64).max
    passes = Passes(spaced, counts, padded, clips, stop, 0.0, int(no_budget), beam, few)
    return passes, leaves, nodes_visited


class GridSearch:
    """The search of one target."""

    def __init__(
        self,
        problem: Problem,
        plan: Plan,
        ties: str,
        memory: Array,
        deadline: Deadline,
        watch: Callable[[int], object],
    ) -> None:
        """Begin a search.

        Args:
            problem: One target.
            plan: The plan.
            ties: Rule that chooses between equally good leaves.
            memory: Memory of the plan.
            deadline: When to end.
            watch: Called with the number of leaves so far.
        """
        self.problem, self.plan, self.memory = problem, plan, memory
        self._deadline, self._watch = deadline, watch
        self._evaluator = Evaluator(problem.mechanism, problem, deadline) if problem.axes is None else None
        self._passes = plan.passes._replace(tie=tie_of(problem, ties))
        if problem.budget is not None and self._evaluator is None:
            self._passes = self._passes._replace(budget=problem.budget)
        # The kernel keeps its position in `progress`, so that it can return for a deadline or Ctrl-C and continue.
        self._progress, self._q = np.array(BEGINNING), problem.start.copy()
        self.ended = FINISHED
        """FINISHED, STOPPED at a good leaf, or PAUSED if the time or the evaluations are spent."""

    @property
    def bytes_used(self) -> int:
        """Memory of the search and of its grid."""
        return bytes_of(self.memory, self.plan.grid)

    def until(self, end: int) -> Found:
        """Make the passes up to number `end` that are not made yet; return the result."""
        passes = self._passes
        if end < len(passes.spacings):
            passes = passes._replace(spacings=passes.spacings[:end], counts=passes.counts[:end])
        self.ended = (
            self._descend(passes) if self._evaluator is None else self._evaluate(passes, self._evaluator)
        )
        leaves, nodes = int(self._progress[LEAVES]), int(self._progress[NODES])
        late = self.ended == PAUSED
        if self._evaluator is not None:
            leaves, late = self._evaluator.spent, self._evaluator.out_of_time
        return Found(self._q.copy(), leaves, self.plan.created or nodes, nodes, late)

    def _descend(self, passes: Passes) -> int:
        problem, plan, progress = self.problem, self.plan, self._progress
        given = problem.arrays, problem.goal.arrays, plan.grid, passes
        ended = descend(*given, PART, self.memory, progress, self._q)
        while ended == PAUSED and not self._deadline.passed:
            self._watch(int(progress[LEAVES]))
            ended = descend(*given, PART, self.memory, progress, self._q)
        return ended

    def _evaluate(self, passes: Passes, evaluator: Evaluator) -> int:
        """Do the same with leaves that the user's function evaluates."""
        progress = self._progress
        most = CALL if evaluator.box.cheap else DEAR_CALL
        begin = most if passes.stop_below < 0 else FIRST_CALL
        length = begin
        while (left := evaluator.left) > 0:
            length = begin if progress[LEAF] == 0 else min(2 * length, most)
            q = np.empty((min(length, left), evaluator.box.dof))
            count = write_leaves(self.plan.grid, passes, self.memory, progress, q)
            if not count:
                return FINISHED
            errors = evaluator.weighted(evaluator.differences(q[:count]))
            ended = keep_leaves(errors, passes, self.memory, progress, self._q)
            self._watch(int(progress[LEAVES]))
            if ended == STOPPED:
                return STOPPED
        return PAUSED
