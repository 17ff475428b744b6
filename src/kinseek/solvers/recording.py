"""Record what a search does, pass by pass, if the problem requests a trace."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.problem import Problem
from kinseek.solution import Solution, judge
from kinseek.support.validation import arrays_equal
from kinseek.trace import Pass, Trace, require_memory

from .base import Found

if TYPE_CHECKING:
    from kinseek.kernels.grid.descent import Grid

    from .grid_search import Plan

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Region(NamedTuple):
    """Region that a pass searches."""

    spacing: Array
    """Spacing of each joint, (n,), [rad] or [m]; NaN for a joint that does not move."""
    lower: Array
    """Lower ends, (n,), [rad] or [m]."""
    upper: Array
    """Upper ends, (n,), [rad] or [m]."""
    counts: NDArray[np.int64]
    """Number of values of each joint, (n,)."""


class Recorder:
    """Records the passes of the search for one target, and creates a `Trace` of them.

    A search creates a recorder only if ``problem.trace`` is set; otherwise nothing is stored and nothing gets slower.
    """

    def __init__(self, problem: Problem, search: object) -> None:
        """Record the passes of `search`, an object or its name, for one target."""
        self.problem = problem
        self.search = search if isinstance(search, str) else type(search).__name__
        self._passes: list[dict[str, Any]] = []
        self._q: list[Array] = []
        self._starts: list[Array | None] = []
        self._notes: list[str] = []
        self._totals = (0, 0, 0)

    def add(
        self,
        name: str,
        q: Array,
        spent: int,
        created: int = 0,
        expanded: int = 0,
        *,
        memory: int = 0,
        window: Region | None = None,
        cells: int = 1,
        start: ArrayLike | None = None,
        spacing: Array | None = None,
    ) -> None:
        """Record a pass.

        Args:
            name: Name of the pass.
            q: The best joint values after the pass, (n,), as the search has them.
            spent: FK evaluations of this pass and all before it.
            created: Nodes created, counted in the same way.
            expanded: Nodes visited, counted in the same way.
            memory: Memory used while it ran [bytes].
            window: Region that was searched.
            cells: Number of windows.
            start: Where the pass began, (n,), if this is not the best before it.
            spacing: Spacing of each joint, (n,), if there is no window.
        """
        totals = int(spent), int(created), int(expanded)
        now = (new - old for new, old in zip(totals, self._totals, strict=True))
        fields: dict[str, Any] = dict(
            zip(("evaluations", "nodes_created", "nodes_expanded"), now, strict=True)
        )
        self._totals = totals
        best = np.array(self.problem.placed(np.asarray(q, dtype=float)))
        if spacing is not None:
            fields["spacing"] = np.array(spacing, dtype=float)
        if window is not None:
            # If a continuous joint was turned to be near the requested values, its window turns with it.
            shift = np.where(self.problem.mechanism.endless, best - q, 0.0)
            fields |= {
                "spacing": np.array(window.spacing, dtype=float),
                "lower": window.lower + shift,
                "upper": window.upper + shift,
                "counts": np.array(window.counts, dtype=np.int64),
            }
        self._passes.append({"name": name, "memory": int(memory), "cells": int(cells), **fields})
        self._q.append(best)
        self._starts.append(None if start is None else np.array(start, dtype=float))

    def note(self, sentence: str) -> None:
        """Record a sentence, once."""
        if sentence not in self._notes:
            self._notes.append(sentence)

    @property
    def spent(self) -> int:
        """FK evaluations up to the end of the last recorded pass."""
        return self._totals[0]

    @property
    def empty(self) -> bool:
        """Whether no pass is recorded yet."""
        return not self._passes

    @property
    def noted(self) -> bool:
        """Whether a sentence is recorded."""
        return bool(self._notes)

    def add_rest(self, name: str, found: Found) -> None:
        """Record the work after the last recorded pass, if there is any."""
        if (found.evaluations, found.nodes_created, found.nodes_expanded) != self._totals:
            memory = self._passes[-1]["memory"] if self._passes else 0
            self.add(name, *found[:4], memory=memory)

    def note_end(self, found: Found) -> None:
        """Record the reason if the search ended early."""
        budget = self.problem.budget
        if found.out_of_time:
            self.note("The time limit ended the search.")
        elif budget is not None and found.evaluations >= budget:
            self.note(f"The budget of {budget:,} evaluations is spent.")

    def finish(self) -> Trace:
        """Return the trace; every pass is evaluated by plain forward kinematics."""
        passes = []
        if self._passes:
            errors = [self.judged(q) for q in self._q]
            first = [float("nan") if start is None else self.judged(start)[2] for start in self._starts]
            for fields, q, start, row, error in zip(
                self._passes, self._q, self._starts, errors, first, strict=True
            ):
                passes.append(
                    Pass(
                        q=q,
                        position_error=row[0],
                        orientation_error=row[1],
                        weighted_error=row[2],
                        start=start,
                        start_error=error,
                        **fields,
                    )
                )
        chain = self.problem.mechanism
        return Trace(self.search, chain.joint_names, chain.kinds, tuple(passes), tuple(self._notes))

    def judged(self, q: Array) -> tuple[float, float, float]:
        """Return position error [m], orientation error [rad] and weighted error at joint values, (n,)."""
        position, orientation, weighted = judge(self.problem, q[None])[0].tolist()
        return position, orientation, weighted


def require_room(problem: Problem, passes: int) -> None:
    """Reject a trace of more targets than fit into memory, with `passes` passes each at most.

    Raises:
        InvalidUse: The traces do not fit; the message has the memory that they would take.
    """
    if problem.trace:
        require_memory(len(problem.goal.targets), passes, problem.mechanism.dof)


def bytes_of(*arrays: Any) -> int:
    """Return the size of arrays, also inside tuples [bytes]."""
    return sum(each.nbytes if isinstance(each, np.ndarray) else _bytes_in(each) for each in arrays)


def _bytes_in(arrays: Any) -> int:
    return bytes_of(*arrays) if isinstance(arrays, tuple) else 0


def grid_window(grid: Grid, nodes: list[Indices], centre: Indices | None = None) -> Region:
    """Return the window of a pass over a grid.

    Args:
        grid: The nodes.
        nodes: Indices of each joint's nodes, in order, n arrays.
        centre: Centre of a later pass, (n,). The window of a joint that wraps is given around it, if necessary beyond the
            range.
    """
    first = np.array([each[0] for each in nodes], dtype=np.int64)
    counts = np.array([len(each) for each in nodes], dtype=np.int64)
    # If a window crosses the seam of a joint that wraps, its nodes continue from 0.
    steps = [
        np.diff(each) % grid.size if w else np.diff(each) for each, w in zip(nodes, grid.wraps, strict=True)
    ]
    last = first + np.array([int(each.sum()) for each in steps], dtype=np.int64)
    if centre is not None:
        over = np.where(grid.wraps & (first > centre), grid.size, 0)
        first, last = first - over, last - over
    between = np.where(counts > 1, (last - first) / np.maximum(counts - 1, 1), np.nan)
    return Region(grid.step * between, grid.lower + grid.step * first, grid.lower + grid.step * last, counts)


def record_pass(recorder: Recorder, plan: Plan, k: int, before: Array, found: Found, memory: int) -> None:
    """Record pass k of a descent through a grid.

    Args:
        recorder: Receives the pass.
        plan: The plan.
        k: Index of the pass, from 0 on.
        before: Best joint values of the pass before, (n,), around which this one searched.
        found: Result after the pass.
        memory: Memory used [bytes].
    """
    grid, passes = plan.grid, plan.passes
    if k == 0:
        window = grid_window(grid, plan.first)
    else:
        steps = np.where(grid.step > 0, grid.step, 1.0)
        centre = np.rint((before - grid.lower) / steps).astype(np.int64)
        spacing, wraps = int(passes.spacings[k]), grid.wraps.tolist()
        from .nodes import window_around

        nodes = window_around(wraps, grid.size, centre.tolist(), spacing, passes.counts[k], passes.clips)
        window = grid_window(grid, nodes, centre)
    leaves = found.evaluations - recorder.spent
    cells = -(-leaves // int(np.prod(window.counts))) if k else 1
    recorder.add(f"pass {k + 1}", *found[:4], memory=memory, window=window, cells=max(cells, 1))


def joined(name: str, answer: Solution, first: Solution, last: Solution | None) -> Trace | None:
    """Combine the traces of a search and of the one that finished it; None if one of them has no trace."""
    parts = [first] if last is None else [first, last]
    traces: list[Trace | None] = [part._trace for part in parts]
    passes: list[Pass] = []
    notes: list[str] = []
    for begin, trace in zip(("first: ", "then: "), traces, strict=False):
        if trace is None:
            return None
        passes += [replace(each, name=begin + each.name) for each in trace]
        notes += [f"{trace.search}: {note}" for note in trace.notes]
    if passes and not arrays_equal(passes[-1].q, answer.q):
        errors = answer.weighted_error, answer.position_error, answer.orientation_error
        passes.append(Pass("the better of both", answer.q, *errors, evaluations=0, memory=passes[-1].memory))
    chain = answer.problem.mechanism
    return Trace(name, chain.joint_names, chain.kinds, tuple(passes), tuple(notes))
