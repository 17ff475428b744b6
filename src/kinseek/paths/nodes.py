"""Turn layers of solutions into joint values: find the best path through them, with the user's `valid` and `cost`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import cost_of
from kinseek.kernels.paths import viterbi
from kinseek.kernels.paths.viterbi import DISTANCE, ENDLESS, GIVEN, TIME
from kinseek.support.deadline import TimeUp

from .joints import Turning
from .layers import Layers
from .request import PathRequest
from .steps import open_beside

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

GRACE = 0.1
"""Least time for checking the best path, even if the deadline passes before [s]: an unchecked pose is not returned."""

LAST_PART = 0.5
"""Time that the search for the best path may take after the costs are computed, as a fraction of the time spent until then;
0.4 was measured. The program of this trial is not in the repository."""


class LayerGraph:
    """Nodes of a path: solutions inside the limits, together with their full turns."""

    def __init__(self, request: PathRequest, layers: Layers, missed: Flags) -> None:
        """Take layers, (N, width, n), and flags of the missed poses, (N,); steps to and from these do not count as breaks.

        Solutions outside the limits must have been removed from the layers.
        """
        self.request, self.turning = request, Turning(request.problem.chain)
        self.q, self.count = layers.q, layers.count
        self.nodes = self.q.shape[1] * self.turning.total
        self._forbidden_edges: set[tuple[int, int, int]] = set()
        self._refused: NDArray[np.bool_] = np.zeros((0, 0), dtype=np.bool_)
        self._agreed: set[tuple[int, int]] = set()
        self._passed: set[tuple[int, int, int]] = set()
        self.unreachable: set[int] = set(np.flatnonzero(missed).tolist())
        """Poses that are missed, and poses whose every solution collides or was rejected by `valid`."""
        self.mode = DISTANCE if request.velocity is None else TIME
        self.costs = np.zeros((0, 0))
        if request.cost is not None:
            self.mode, self.costs = GIVEN, self._costs()

    def _costs(self) -> Array:
        """Return the user's cost of each node, (N, nodes); 0 at poses for which the time did not suffice."""
        assert self.request.cost is not None
        # Rows that are never written take no memory; those of 100,000 poses of a UR5e have 400 MB.
        costs = np.zeros((len(self.q), self.nodes))
        deadline = self.request.deadline.before(LAST_PART)
        for i, count in enumerate(self.count):
            if deadline.passed:
                break  # The search for the best path skips nodes outside the limits by itself.
            nodes, q = self._inside(i, count)
            costs[i] = np.inf
            if len(nodes):
                costs[i, nodes] = cost_of(self.request.cost, self._clipped(q))
        return costs

    def _clipped(self, q: Array) -> Array:
        return np.clip(q, self.turning.open_lower, self.turning.open_upper)

    def values(self, i: Indices, nodes: Indices) -> Array:
        """Return joint values of nodes at poses i, (k,) and (k,) -> (k, n)."""
        solution, turns = nodes // self.turning.total, nodes % self.turning.total
        return self.turning.node_values(self.q[i, solution], turns)

    def best(self, first: int = -1, last: int = -1) -> tuple[Array, Indices, float, Indices]:
        """Return the best path: joint values (N, n), its breaks, its cost, and its nodes (N,)."""
        turning, count = self.turning, len(self.q)
        path, report = np.zeros(count, dtype=np.int64), np.zeros(count)
        forbidden_edges = np.array(sorted(self._forbidden_edges), dtype=np.int64).reshape(-1, 3)
        layers = viterbi.Layers(self.q, self.count)
        steps = viterbi.Steps(open_beside(self.request, self._missed()), self.request.step_weights, self.mode)
        ends = np.array([first, last], dtype=np.int64)
        rules = viterbi.Rules(self.costs, self._refused, forbidden_edges, ends)
        viterbi.viterbi(layers, turning.turns, steps, rules, path, report)
        empty = np.flatnonzero(path < 0)
        if len(empty) and len(self._refused):
            # No node is left there: the pose counts as missed, and the path leads through rejected nodes.
            self.unreachable |= set(empty.tolist())
            self._refused[empty] = False
            return self.best(first, last)
        breaks = np.flatnonzero(report[1:] > 0)
        q = turning.unwrapped(self._clipped(self.values(np.arange(count), np.maximum(path, 0))))
        return q, breaks, float(report[0]), path

    def _missed(self) -> Flags:
        flags = np.zeros(len(self.q), dtype=np.bool_)
        flags[list(self.unreachable)] = True
        return flags

    def check(self, q: Array, breaks: Indices, path: Indices) -> tuple[bool, int]:
        """Check a path and points between its poses with `valid`; what is rejected is excluded from now on.

        Returns:
            Whether all is accepted, and how many of the first poses are accepted together with the steps between them. The
            number is smaller if the time was up before all were checked.
        """
        request, valid = self.request, self.request.valid
        assert valid is not None
        self.request = replace(request, valid=replace(valid, deadline=request.deadline.at_least(GRACE)))
        try:
            return self._check(q, breaks, path)
        finally:
            self.request = request

    def _check(self, q: Array, breaks: Indices, path: Indices) -> tuple[bool, int]:
        assert self.request.valid is not None
        steps = np.setdiff1d(np.arange(len(q) if self.request.closed else len(q) - 1), breaks)
        agreed, count, all_fine = list[bool](), len(q), True
        size = self.request.valid.at_once(len(q))
        for first in range(0, len(q), size):
            # The steps to some poses are checked together with these: if the time ends, a first part of the path is then
            # known.
            last = min(first + size, len(q))
            begin, end = np.searchsorted(steps, [first - 1, last - 1 if last < len(q) else last])
            try:
                agreed += [self._node_agreed(i, int(path[i]), q[i]) for i in range(first, last)]
                edges, fine = self._steps_agreed(steps[begin:end].tolist(), q, path, agreed)
            except TimeUp:
                return False, min(count, first)
            if False in agreed[first:]:
                count = min(count, agreed.index(False))
            if False in fine:
                all_fine, count = False, min(count, edges[fine.index(False)] + 1)
        return all_fine and count == len(q), count

    def _steps_agreed(
        self, steps: list[int], q: Array, path: Indices, agreed: list[bool]
    ) -> tuple[list[int], list[bool]]:
        """Check those steps that were not checked yet: return their indices, and for each whether it is accepted."""
        edges, ends = [], []
        for i in steps:
            j = (i + 1) % len(q)
            edge = (i, int(path[i]), int(path[j]))
            if agreed[i] and agreed[j] and not {i, j} & self.unreachable and edge not in self._passed:
                edges.append(edge)
                ends.append(q[i] + (q[j] - q[i] if j else self.turning.way(q[j] - q[i])))
        return [edge[0] for edge in edges], self._edges_agreed(edges, q, ends) if edges else []

    def _edges_agreed(self, edges: list[tuple[int, int, int]], q: Array, ends: list[Array]) -> list[bool]:
        """Check some steps of a path with `valid`, and exclude the rejected ones from now on."""
        valid = self.request.valid
        assert valid is not None
        starts = q[[edge[0] for edge in edges]]
        free = valid.free_ways(starts, np.array(ends))
        fine = free.copy()
        fine[free] = valid.agreed_ways(starts[free], np.array(ends)[free])
        for edge, passed, hits in zip(edges, fine.tolist(), (~free).tolist(), strict=True):
            if passed:
                self._passed.add(edge)
            else:
                self._forbidden_edges |= self._turned_alike(edge) if hits else {edge}
        return [bool(each) for each in fine]

    def refuse_blocked(self) -> None:
        """Exclude the solutions that are not free, with all their full turns: a scene does not distinguish full turns."""
        valid = self.request.valid
        if valid is None or valid.scene is None:
            return
        there = (np.arange(self.q.shape[1]) < self.count[:, None]) & ~self._missed()[:, None]
        hits = np.zeros(there.shape, dtype=np.bool_)
        hits[there] = ~valid.free(self._clipped(self.q[there]))
        self._refused = np.repeat(hits, self.turning.total, axis=1)

    def _turned_alike(self, edge: tuple[int, int, int]) -> set[tuple[int, int, int]]:
        """Return a step and all steps that differ from it only by the same full turns at both ends."""
        i, node, following = edge
        total, units, copies = self.turning.total, self.turning.units, self.turning.copies
        digits = np.arange(total)[:, None] // units % copies
        there = digits + digits[following % total] - digits[node % total]
        (same,) = np.nonzero(((there >= 0) & (there < copies)).all(axis=1))
        first, last = node - node % total, following - following % total
        return {(i, first + int(s), last + int(there[s] @ units)) for s in same}

    def check_all_nodes(self) -> None:
        """Check with `valid` every node that was not checked yet."""
        for i, count in enumerate(self.count):
            if i in self.unreachable:
                continue
            nodes, q = self._inside(i, count)
            for node, row in zip(nodes.tolist(), self._clipped(q), strict=True):
                if not (len(self._refused) and self._refused[i, node]):
                    self._node_agreed(i, node, row)

    def _inside(self, i: int, count: int) -> tuple[Indices, Array]:
        """Return the nodes of a pose that lie inside the limits, (k,), and their joint values, (k, n)."""
        nodes = np.arange(count * self.turning.total)
        q = self.values(np.full(len(nodes), i), nodes)
        inside = (q <= self.turning.open_upper + 1e-9).all(axis=1)
        return nodes[inside], q[inside]

    def _node_agreed(self, i: int, node: int, q: Array) -> bool:
        valid = self.request.valid
        assert valid is not None
        if valid.valid is None or (i, node) in self._agreed or i in self.unreachable:
            return True
        if valid.agreed(q[None])[0]:
            self._agreed.add((i, node))
            return True
        if not len(self._refused):
            self._refused = np.zeros((len(self.q), self.nodes), dtype=np.bool_)
        self._refused[i, node] = True
        return False

    def exists(self, i: int, node: int) -> bool:
        """Return whether a node of pose i is inside the limits and was not rejected."""
        if len(self._refused) and self._refused[i, node]:
            return False
        q = self.values(np.array([i]), np.array([node]))[0]
        return bool((q <= self.turning.open_upper + 1e-9).all())

    def beside(self, first: int, longest: Array) -> list[int]:
        """Return the nodes of the last pose from which one step leads to a given node of the first."""
        last, total = len(self.q) - 1, self.turning.total
        q = self.values(np.array([0]), np.array([first]))[0]
        found = []
        for solution in range(self.count[last]):
            step = self.turning.step(self.q[last, solution] - q)
            there = q + step
            inside = (there >= self.turning.open_lower - 1e-9) & (there <= self.turning.open_upper + 1e-9)
            if (np.abs(step) <= longest).all() and inside.all():
                digits = np.round((there - self.q[last, solution]) / (2 * np.pi)).astype(np.int64)
                digits = np.where(self.turning.kind == ENDLESS, 0, digits)
                node = solution * total + int((digits * self.turning.units).sum())
                refused = len(self._refused) and self._refused[last, node]
                if not refused and (last, node, first) not in self._forbidden_edges:
                    found.append(node)
        return found
