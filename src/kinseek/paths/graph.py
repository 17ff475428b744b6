"""The best path through layers of isolated solutions that `valid` and the scene allow.

Nodes and steps are checked only where the best path leads; what is rejected is excluded, and the best path is found again
(Bohlin and Kavraki 2000).
"""

from __future__ import annotations

import itertools
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import cost_of
from kinseek.kernels.paths import viterbi
from kinseek.kernels.paths.viterbi import DISTANCE, GIVEN, STRAIGHT, TIME
from kinseek.support.deadline import TimeUp

from .allowed import Allowed
from .branches import SAME
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

ROUNDS = 10
"""Paths that are tried before `valid` is called for every solution of every pose."""


class Way(NamedTuple):
    """A path through the layers."""

    q: Array
    """Joint values, (N, n)."""
    breaks: Indices
    """Poses from which the path continues with a break, (k,)."""
    cost: float
    nodes: Indices
    """One node per pose, (N,)."""

    @property
    def order(self) -> tuple[int, float]:
        """Return what is compared: the breaks count first."""
        return len(self.breaks), self.cost


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
        self._refused: Flags = np.zeros((0, 0), dtype=np.bool_)
        self._agreed: set[tuple[int, int]] = set()
        self._passed: set[tuple[int, int, int]] = set()
        self.unreachable = missed.copy()
        """Flags of poses that are missed, and of poses whose every solution collides or was rejected by `valid`, (N,)."""
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
        for i in range(len(self.q)):
            if deadline.passed:
                break  # The search for the best path skips nodes outside the limits by itself.
            nodes, q = self._inside(i)
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

    def _inside(self, i: int) -> tuple[Indices, Array]:
        """Return the nodes of a pose that lie inside the limits, (k,), and their joint values, (k, n)."""
        nodes = np.arange(self.count[i] * self.turning.total)
        q = self.values(np.full(len(nodes), i), nodes)
        inside = (q <= self.turning.open_upper + 1e-9).all(axis=1)
        return nodes[inside], q[inside]

    def _open(self, i: int) -> tuple[Indices, Array]:
        """Return the nodes of a pose inside the limits that are not rejected, (k,), and their joint values, (k, n)."""
        nodes, q = self._inside(i)
        good = ~self._refused[i, nodes] if len(self._refused) else np.ones(len(nodes), dtype=np.bool_)
        return nodes[good], q[good]

    def best(self, first: int = -1, last: int = -1) -> Way:
        """Return the best path between given nodes of the first and the last pose, or -1 for any."""
        turning, count = self.turning, len(self.q)
        path, report = np.zeros(count, dtype=np.int64), np.zeros(count)
        forbidden_edges = np.array(sorted(self._forbidden_edges), dtype=np.int64).reshape(-1, 3)
        layers = viterbi.Layers(self.q, self.count)
        steps = viterbi.Steps(
            open_beside(self.request, self.unreachable), self.request.step_weights, self.mode
        )
        ends = np.array([first, last], dtype=np.int64)
        rules = viterbi.Rules(self.costs, self._refused, forbidden_edges, ends)
        viterbi.viterbi(layers, turning.turns, steps, rules, path, report)
        empty = path < 0
        if empty.any() and len(self._refused):
            # No node is left there: the pose counts as missed, and the path leads through rejected nodes.
            self.unreachable |= empty
            self._refused[empty] = False
            return self.best(first, last)
        q = turning.unwrapped(self._clipped(self.values(np.arange(count), np.maximum(path, 0))))
        return Way(q, np.flatnonzero(report[1:] > 0), float(report[0]), path)

    def best_of(self, first: int, last: int) -> Way:
        """Return the best path; of a closed path, try every solution of the first pose.

        Args:
            first: Node of the first pose, or -1 for any.
            last: Node of the last pose, or -1 for any.
        """
        open_way = self.best(first, last)
        if not self.request.closed:
            return open_way
        best: Way | None = None
        firsts = [node for node in self._open(0)[0].tolist() if first in (node, -1)]
        # The best open path probably begins at the best node, so the bound below ends the loop early.
        for node in sorted(firsts, key=lambda node: node != open_way.nodes[0]):
            if best is not None and self.request.deadline.passed:
                break
            for end in self._before(node) if last < 0 else [last]:
                way = self.best(node, end)
                if best is None or way.order < best.order:
                    best = way
            # An open path is never worse than a closed one, so nothing better exists.
            if (
                best is not None
                and len(best.breaks) == len(open_way.breaks)
                and best.cost <= open_way.cost * (1 + 1e-9)
            ):
                break
        if best is not None and len(best.breaks) <= len(open_way.breaks) + 1:
            return best
        return open_way._replace(breaks=np.append(open_way.breaks, len(self.q) - 1))

    def _before(self, first: int) -> list[int]:
        """Return the nodes of the last pose from which one step leads to a given node of the first."""
        last, turning, longest = len(self.q) - 1, self.turning, self.request.longest[-1]
        if self.request.ends_where_it_begins:
            # First and last pose are the same: the joints must return to the same values, not just near them.
            longest = np.minimum(longest, SAME)
        if self.unreachable[0] or self.unreachable[last]:
            longest = np.full_like(longest, np.inf)
        # Of the copies of a solution only the nearest is of interest.
        longest = np.where(turning.kind == STRAIGHT, longest, np.minimum(longest, np.pi))
        nodes, q = self._open(last)
        step = turning.way(self.values(np.array([0]), np.array([first])) - q)
        near = (np.abs(step) <= longest).all(axis=1)
        return [node for node in nodes[near].tolist() if (last, node, first) not in self._forbidden_edges]

    def check(self, way: Way) -> tuple[bool, int]:
        """Check a path and points between its poses with `valid`; what is rejected is excluded from now on.

        Returns:
            Whether all is accepted, and how many of the first poses are accepted together with the steps between them. The
            number is smaller if the time was up before all were checked.
        """
        assert self.request.valid is not None
        valid, q = self.request.valid.at_least(GRACE), way.q
        steps = np.setdiff1d(np.arange(len(q) if self.request.closed else len(q) - 1), way.breaks)
        agreed, count, all_fine = list[bool](), len(q), True
        size = valid.at_once(len(q))
        for first in range(0, len(q), size):
            # The steps to some poses are checked together with these: if the time ends, a first part of the path is then
            # known.
            last = min(first + size, len(q))
            begin, end = np.searchsorted(steps, [first - 1, last - 1 if last < len(q) else last])
            try:
                agreed += [self._node_agreed(valid, i, int(way.nodes[i]), q[i]) for i in range(first, last)]
                edges, fine = self._steps_agreed(valid, steps[begin:end].tolist(), way, agreed)
            except TimeUp:
                return False, min(count, first)
            if False in agreed[first:]:
                count = min(count, agreed.index(False))
            if False in fine:
                all_fine, count = False, min(count, edges[fine.index(False)] + 1)
        return all_fine and count == len(q), count

    def _steps_agreed(
        self, valid: Allowed, steps: list[int], way: Way, agreed: list[bool]
    ) -> tuple[list[int], list[bool]]:
        """Check those steps that were not checked yet, and exclude the rejected ones from now on.

        Returns:
            Their indices, and for each whether it is accepted.
        """
        edges, ends, q = list[tuple[int, int, int]](), list[Array](), way.q
        for i in steps:
            j = (i + 1) % len(q)
            edge = (i, int(way.nodes[i]), int(way.nodes[j]))
            missed = self.unreachable[i] or self.unreachable[j]
            if agreed[i] and agreed[j] and not missed and edge not in self._passed:
                edges.append(edge)
                ends.append(q[i] + (q[j] - q[i] if j else self.turning.way(q[j] - q[i])))
        if not edges:
            return [], []
        rows = [edge[0] for edge in edges]
        free = valid.free_ways(q[rows], np.array(ends))
        fine = free.copy()
        fine[free] = valid.agreed_ways(q[rows][free], np.array(ends)[free])
        for edge, passed, hits in zip(edges, fine.tolist(), (~free).tolist(), strict=True):
            if passed:
                self._passed.add(edge)
            else:
                self._forbidden_edges |= self._turned_alike(edge) if hits else {edge}
        return rows, fine.tolist()

    def _turned_alike(self, edge: tuple[int, int, int]) -> set[tuple[int, int, int]]:
        """Return a step and all steps that differ from it only by the same full turns at both ends."""
        i, node, following = edge
        total, units, copies = self.turning.total, self.turning.units, self.turning.copies
        digits = np.arange(total)[:, None] // units % copies
        there = digits + digits[following % total] - digits[node % total]
        (same,) = np.nonzero(((there >= 0) & (there < copies)).all(axis=1))
        first, last = node - node % total, following - following % total
        return {(i, first + int(s), last + int(there[s] @ units)) for s in same}

    def _node_agreed(self, valid: Allowed, i: int, node: int, q: Array) -> bool:
        if valid.valid is None or (i, node) in self._agreed or self.unreachable[i]:
            return True
        if valid.agreed(q[None])[0]:
            self._agreed.add((i, node))
            return True
        if not len(self._refused):
            self._refused = np.zeros((len(self.q), self.nodes), dtype=np.bool_)
        self._refused[i, node] = True
        return False

    def refuse_blocked(self) -> None:
        """Exclude the solutions that are not free, with all their full turns: a scene does not distinguish full turns."""
        valid = self.request.valid
        if valid is None or valid.scene is None:
            return
        there = (np.arange(self.q.shape[1]) < self.count[:, None]) & ~self.unreachable[:, None]
        hits = np.zeros(there.shape, dtype=np.bool_)
        hits[there] = ~valid.free(self._clipped(self.q[there]))
        self._refused = np.repeat(hits, self.turning.total, axis=1)

    def check_all_nodes(self) -> None:
        """Check with `valid` every node that was not checked yet."""
        assert self.request.valid is not None
        for i in np.flatnonzero(~self.unreachable).tolist():
            nodes, q = self._open(i)
            for node, row in zip(nodes.tolist(), self._clipped(q), strict=True):
                self._node_agreed(self.request.valid, i, node, row)


def best_allowed(graph: LayerGraph, ends: tuple[int, int]) -> tuple[Array, Indices]:
    """Find the best path that `valid` and the scene allow, by checking the best path repeatedly.

    Returns:
        Joint values and breaks; if the time is up, only for the first poses, which `valid` accepted.
    """
    request = graph.request
    with suppress(TimeUp):
        graph.refuse_blocked()
    for tries in itertools.count(1):
        way = graph.best_of(*ends)
        if request.valid is None:
            return way.q, way.breaks
        agreed, count = graph.check(way)
        if agreed:
            return way.q, way.breaks
        if request.deadline.passed:
            break
        # The best paths keep failing: it is then cheaper to check every node once than one more path at a time.
        if tries == ROUNDS:
            with suppress(TimeUp):
                graph.check_all_nodes()
    if count == len(way.q):  # The step from the last pose to the first is not included.
        return way.q, np.append(way.breaks, len(way.q) - 1)
    return way.q[:count], way.breaks[way.breaks < count - 1]
