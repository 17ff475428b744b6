"""Grid search for black-box kinematics: divide and conquer and brute force (the paper, Sec. 3.1), many leaves per call.

The nodes and their order are those of the compiled searches. Without links there are no shared prefixes, so a leaf is one
pose, and nodes above the leaves are counted but cost nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.grid.descent import Grid, Passes
from kinseek.kernels.grid.window import nodes_until
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.nodes import window_around

from .evaluator import Evaluator

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_CHUNK, _DEAR_CHUNK = 8192, 256
"""Leaves per call; fewer if every row runs Python code, so that a time limit takes effect."""


@dataclass
class Cells:
    """The best leaves so far, best first."""

    most: int
    nodes: Indices
    """Grid nodes, (k, n)."""
    q: Array = field(default_factory=lambda: np.empty((0, 0)))
    """Joint values, (k, n)."""
    errors: Array = field(default_factory=lambda: np.empty(0))
    """Weighted errors, (k,)."""
    tie: float = 0.0
    """For a single cell: it is only replaced by a leaf that is better by more than this."""

    @classmethod
    def empty(cls, most: int, dof: int, tie: float = 0.0) -> Cells:
        """Return an object without leaves."""
        return cls(most, np.empty((0, dof), dtype=np.int64), np.empty((0, dof)), np.empty(0), tie)

    def offer(self, nodes: Indices, q: Array, errors: Array) -> None:
        """Add leaves, each node once, and keep the best."""
        if self.tie > 0 and self.most == 1:
            return self._offer_in_order(nodes, q, errors)
        finite = np.isfinite(errors)
        if len(errors) > 4 * self.most:  # Most are worse than those already kept.
            finite &= errors <= np.partition(errors, self.most)[self.most]
        nodes = np.concatenate([self.nodes, nodes[finite]])
        q = np.concatenate([self.q, q[finite]])
        errors = np.concatenate([self.errors, errors[finite]])
        order = np.argsort(errors, kind="stable")
        _, first = np.unique(nodes[order], axis=0, return_index=True)
        kept = order[np.sort(first)[: self.most]]
        self.nodes, self.q, self.errors = nodes[kept], q[kept], errors[kept]

    def _offer_in_order(self, nodes: Indices, q: Array, errors: Array) -> None:
        """Add leaves one after the other if they are better by more than a tie."""
        best, at = self.errors[0] if len(self.errors) else np.inf, 0
        while len(better := np.flatnonzero(errors[at:] < best - self.tie)):
            at += int(better[0]) + 1
            best = errors[at - 1]
            self.nodes, self.q, self.errors = nodes[at - 1 : at], q[at - 1 : at], errors[at - 1 : at]


def search_window(
    evaluator: Evaluator,
    values: list[Array],
    nodes: list[Indices],
    cells: Cells,
    stop_below: float = -1.0,
    watch: Callable[[int], object] = lambda leaves: None,
) -> int:
    """Evaluate every leaf of a window, last joint fastest, within the budget; return the number of evaluated leaves.

    Args:
        evaluator: The function and the target.
        values: Values of each joint.
        nodes: The caller's numbers of these values.
        cells: Receives the best leaves.
        stop_below: Stop at the first leaf whose weighted error is below this.
        watch: Called with the number of leaves so far.
    """
    counts = tuple(len(each) for each in values)
    total, evaluated = math.prod(counts), 0
    most = _CHUNK if evaluator.box.cheap else _DEAR_CHUNK
    chunk = most if stop_below < 0 else 64
    while evaluated < total and (left := evaluator.left) > 0:
        flat = np.arange(evaluated, evaluated + min(chunk, total - evaluated, left))
        chunk = min(2 * chunk, most)
        place = np.unravel_index(flat, counts)
        q = np.stack([each[i] for each, i in zip(values, place, strict=True)], axis=1)
        named = np.stack([each[i] for each, i in zip(nodes, place, strict=True)], axis=1)
        errors = evaluator.weighted(evaluator.differences(q))
        evaluated += len(flat)
        below = np.flatnonzero(errors < stop_below)
        end = int(below[0]) + 1 if len(below) else len(flat)
        cells.offer(named[:end], q[:end], errors[:end])
        watch(evaluated)
        if len(below):
            break
    return evaluated


def descend(
    evaluator: Evaluator,
    grid: Grid,
    passes: Passes,
    later: Indices,
    first: list[Indices],
    watch: Callable[[int], object],
    on_pass: Callable[[int, Array | None, int], None] = lambda k, q, expanded: None,
) -> tuple[Array | None, int]:
    """Refine a grid around the best leaves, pass by pass; return the best joint values and the number of expanded nodes.

    Args:
        evaluator: The function and the target.
        grid: The nodes.
        passes: The plan.
        later: Number of nodes of each joint in each pass after the first, (passes, n).
        first: Nodes of the first pass, for each joint.
        watch: Called with the number of leaves so far.
        on_pass: Called after each pass with its number and the current return values.
    """
    dof = len(grid.lower)
    cells, expanded, leaves = Cells.empty(passes.beam, dof, passes.tie), 0, 0
    wraps = grid.wraps.tolist()
    for k, spacing in enumerate(passes.spacings):
        before, cells = cells, Cells.empty(passes.beam, dof, passes.tie)
        if len(before.q):
            cells.offer(before.nodes[:1], before.q[:1], before.errors[:1])
        for cell in range(1 if k == 0 else len(before.q)):
            if evaluator.left <= 0:
                break
            nodes = first
            if k > 0:
                centre = before.nodes[cell].tolist()
                nodes = window_around(wraps, grid.size, centre, int(spacing), later[k - 1], passes.clips)
            values = [node_values(grid, d, each) for d, each in enumerate(nodes)]
            children = Cells.empty(passes.children if k else passes.beam, dof, passes.tie)
            if passes.tie > 0 and len(cells.q):  # A leaf has to be clearly better than the best so far.
                children.offer(cells.nodes, cells.q, cells.errors)
            evaluated = search_window(
                evaluator, values, nodes, children, passes.stop_below, _after(leaves, watch)
            )
            cells.offer(children.nodes, children.q, children.errors)
            leaves += evaluated
            counts = [len(each) for each in nodes]
            if len(cells.errors) and cells.errors[0] < passes.stop_below:
                expanded += nodes_until(np.array(counts, dtype=np.int64), evaluated - 1)
                on_pass(k, cells.q[0], expanded)
                return cells.q[0], expanded
            expanded += sum(math.prod(counts[: d + 1]) for d in range(dof))
        on_pass(k, cells.q[0] if len(cells.q) else None, expanded)
    return (cells.q[0] if len(cells.q) else None), expanded


def _after(leaves: int, watch: Callable[[int], object]) -> Callable[[int], object]:
    """Return a watch that adds an offset to the number of leaves."""
    return lambda more: watch(leaves + more)


def node_values(grid: Grid, d: int, nodes: Indices) -> Array:
    """Return values of nodes of joint d with the bits of the compiled search, (k,)."""
    return np.asarray(np.minimum(grid.lower[d] + grid.step[d] * nodes, grid.upper[d]))


def best_or_start(q: Array | None, box: Mechanism, start: Array) -> Array:
    """Return what a grid search found, or the start if no node has a pose."""
    return np.asarray(start if q is None else q).reshape(box.dof)
