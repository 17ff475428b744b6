"""Grids of joint values on a function: divide and conquer and brute force (the paper, Sec. 3.1), many leaves a call.

The same nodes in the same order as the compiled searches; without links there are no prefixes to share, so a leaf is
one pose, and nodes above the leaves are counted but cost nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.grid.descent import Grid
from kinseek.robots.mechanism import Mechanism

from .asking import Asker

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_CHUNK, _DEAR_CHUNK = 8192, 256
"""Leaves asked for at once; fewer where Python runs for every row, so that a time limit is seen."""


@dataclass
class Cells:
    """The best leaves so far, best first."""

    most: int
    nodes: Indices
    """(k, n)"""
    q: Array = field(default_factory=lambda: np.empty((0, 0)))
    """(k, n)"""
    errors: Array = field(default_factory=lambda: np.empty(0))
    """Weighted, (k,)."""

    @classmethod
    def empty(cls, most: int, dof: int) -> Cells:
        """No leaves yet."""
        return cls(most, np.empty((0, dof), dtype=np.int64), np.empty((0, dof)), np.empty(0))

    def offer(self, nodes: Indices, q: Array, errors: Array) -> None:
        """Take leaves in, each node once, and keep the best."""
        finite = np.isfinite(errors)
        if len(errors) > 4 * self.most:  # Most are beaten anyway.
            finite &= errors <= np.partition(errors, self.most)[self.most]
        nodes = np.concatenate([self.nodes, nodes[finite]])
        q = np.concatenate([self.q, q[finite]])
        errors = np.concatenate([self.errors, errors[finite]])
        order = np.argsort(errors, kind="stable")
        _, first = np.unique(nodes[order], axis=0, return_index=True)
        kept = order[np.sort(first)[: self.most]]
        self.nodes, self.q, self.errors = nodes[kept], q[kept], errors[kept]


def search_window(
    asker: Asker, values: list[Array], nodes: list[Indices], cells: Cells, stop_below: float = -1.0
) -> int:
    """Ask for every leaf of a window, last joint fastest, within the budget; return how many were asked for.

    Args:
        asker: The function and the target.
        values: Of each joint.
        nodes: What the caller calls them.
        cells: Where the best are kept.
        stop_below: Stop at the first leaf whose weighted error is below this.
    """
    counts = tuple(len(each) for each in values)
    total, asked = math.prod(counts), 0
    most = _CHUNK if asker.box.cheap else _DEAR_CHUNK
    chunk = most if stop_below < 0 else 64
    while asked < total and (left := asker.left) > 0:
        flat = np.arange(asked, asked + min(chunk, total - asked, left))
        chunk = min(2 * chunk, most)
        place = np.unravel_index(flat, counts)
        q = np.stack([each[i] for each, i in zip(values, place, strict=True)], axis=1)
        named = np.stack([each[i] for each, i in zip(nodes, place, strict=True)], axis=1)
        errors = asker.weighted(asker.ask(q))
        asked += len(flat)
        below = np.flatnonzero(errors < stop_below)
        end = int(below[0]) + 1 if len(below) else len(flat)
        cells.offer(named[:end], q[:end], errors[:end])
        if len(below):
            break
    return asked


def descend(
    asker: Asker, grid: Grid, spacings: Indices, later: Indices, divisions: int, beam: int, children: int
) -> tuple[Array | None, int]:
    """Refine a grid around the best leaves, pass by pass; return the best joint values and the nodes expanded."""
    dof = len(grid.lower)
    cells, expanded = Cells.empty(beam, dof), 0
    for k, spacing in enumerate(spacings):
        before, cells = cells, Cells.empty(beam, dof)
        if len(before.q):
            cells.offer(before.nodes[:1], before.q[:1], before.errors[:1])
        for cell in range(1 if k == 0 else len(before.q)):
            if asker.left <= 0:
                break
            nodes = (
                first_window(grid, divisions)
                if k == 0
                else later_window(grid, before.nodes[cell], spacing, later)
            )
            values = [node_values(grid, d, each) for d, each in enumerate(nodes)]
            litter = Cells.empty(children if k else beam, dof)
            search_window(asker, values, nodes, litter)
            cells.offer(litter.nodes, litter.q, litter.errors)
            expanded += sum(math.prod(len(each) for each in nodes[: d + 1]) for d in range(dof))
    return (cells.q[0] if len(cells.q) else None), expanded


def node_values(grid: Grid, d: int, nodes: Indices) -> Array:
    """Values of nodes of joint d, as the compiled search makes them, (k,)."""
    return np.asarray(np.minimum(grid.lower[d] + grid.step[d] * nodes, grid.upper[d]))


def first_window(grid: Grid, divisions: int) -> list[Indices]:
    """Spread D nodes over each joint's range: see `kernels.grid.descent.first_window`."""
    count = min(divisions, grid.size)
    i = np.arange(count, dtype=np.int64)
    whole, halves = i * grid.size // count, (2 * i + 1) * grid.size // (2 * count)
    return [whole if wraps else halves for wraps in grid.wraps]


def later_window(grid: Grid, centre: Indices, spacing: int, counts: Indices) -> list[Indices]:
    """Take the nodes around a centre: see `kernels.grid.descent.later_window`."""
    result = []
    for d, middle in enumerate(centre):
        count = min(int(counts[d]), (grid.size - 1) // int(spacing) + 1)
        first = int(middle) - (count // 2) * int(spacing)
        if not grid.wraps[d]:
            while first < 0:
                first += int(spacing)
            while first + (count - 1) * spacing >= grid.size and first >= spacing:
                first -= int(spacing)
        nodes = first + np.arange(count, dtype=np.int64) * spacing
        result.append(nodes % grid.size if grid.wraps[d] else nodes[nodes < grid.size])
    return result


def best_or_start(q: Array | None, box: Mechanism, start: Array) -> Array:
    """What a grid found, or where nothing closes on it, the start."""
    return np.asarray(start if q is None else q).reshape(box.dof)
