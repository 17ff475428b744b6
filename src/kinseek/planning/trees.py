"""Search for a way between joint values by two trees that grow towards each other (*Kuffner & LaValle 2000*).

Samples come from a fixed sequence, so the same call finds the same way. Some samples are processed together: NumPy finds
their nearest nodes, and the scene checks all motions towards them in one call. Motions are checked by samples while the
trees grow. Only those of a way that was found are proved; one that fails is removed from its tree, with what grew from it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.support.deadline import Deadline
from kinseek.support.turns import nearest_turns

from .space import Space

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TOGETHER = 16
"""Samples that are processed together."""

LONGEST = 1.5
"""Longest motion from a node towards a sample [rad or m]."""

SHORTEST = 0.02
"""A motion that ends in contact sooner than after this adds no node [rad or m]."""

OFTEN, FINER = 4, 16.0
"""One in so many rounds makes so many times shorter motions from everywhere in a tree, which lead out of narrow places."""

PENALTY = 1.0
"""By how much farther away, as a fraction, a node counts for each motion from it that failed."""

MOST = 50_000
"""Samples after which the search ends without a result."""

_GOLDEN = (5.0**0.5 - 1.0) / 2.0
"""Multiples of this fill the interval from 0 to 1 evenly."""


class Tree:
    """Joint values that are connected with a root by free motions."""

    def __init__(self, space: Space, roots: Array) -> None:
        """Begin with the roots, (k, n)."""
        self.space = space
        self._q, self._parents = roots.copy(), np.full(len(roots), -1)
        self._failures = np.zeros(len(roots))
        self._count = len(roots)

    def __len__(self) -> int:
        """Return the number of nodes."""
        return self._count

    @property
    def q(self) -> Array:
        """Joint values of all nodes, (N, n)."""
        return self._q[: self._count]

    @property
    def parents(self) -> Indices:
        """The node from which each node grew, -1 for roots, (N,)."""
        return self._parents[: self._count]

    def add(self, q: Array, parents: Indices) -> None:
        """Add nodes, (k, n), with their parents, (k,)."""
        begin, self._count = self._count, self._count + len(q)
        if self._count > len(self._q):
            more = max(self._count, 2 * len(self._q))
            self._q = np.concatenate([self._q[:begin], np.empty((more - begin, q.shape[1]))])
            self._parents = np.concatenate([self._parents[:begin], np.empty(more - begin, dtype=np.int64)])
            self._failures = np.concatenate([self._failures[:begin], np.zeros(more - begin)])
        self._q[begin : self._count], self._parents[begin : self._count] = q, parents

    def grow(self, parents: Indices, rows: list[Array]) -> Indices:
        """Add nodes one after another from each parent, (k,), to the ends of its motions; return the last ones, (k,)."""
        counts = np.array([len(each) for each in rows], dtype=np.int64)
        last = self._count + np.cumsum(counts) - 1
        before = np.arange(self._count - 1, self._count - 1 + counts.sum())
        before[last - counts + 1 - self._count] = parents
        self.add(np.concatenate([np.zeros((0, self._q.shape[1])), *rows]), before)
        return last

    def fail(self, nodes: Indices) -> None:
        """Count motions that lead nowhere from nodes, (k,)."""
        np.add.at(self._failures, nodes, 1.0)

    def nearest(self, q: Array, promising: bool = False) -> tuple[Indices, Array]:
        """Return the node nearest to each of some joint values, (k, n), and the ways from there, (k, n).

        With `promising` nodes from which motions fail count as farther away: without this, those at an obstacle, which are
        nearest to all samples behind it, would be tried again and again (*Yershova et al. 2005*).
        """
        # Joints first, so that NumPy runs along the nodes.
        gaps = q.T[:, :, None] - np.ascontiguousarray(self.q.T)[:, None]
        for j in np.flatnonzero(self.space.endless):
            gaps[j] -= nearest_turns(gaps[j])
        squares = np.einsum("nkm,nkm->km", gaps, gaps)
        if promising:
            squares *= (1.0 + PENALTY * self._failures[: self._count]) ** 2
        nodes = squares.argmin(axis=1)
        return nodes, self.space.way(q - self.q[nodes])

    def branch(self, node: int) -> list[int]:
        """Return the nodes from a root to a node."""
        nodes = [node]
        while (node := int(self._parents[node])) >= 0:
            nodes.append(node)
        return nodes[::-1]

    def remove(self, nodes: list[int]) -> None:
        """Remove nodes and all that grew from them; the others get new numbers."""
        gone = np.zeros(self._count, dtype=np.bool_)
        gone[nodes] = True
        for i in range(min(nodes), self._count):
            gone[i] |= self._parents[i] >= 0 and gone[self._parents[i]]
        left = ~gone
        numbers = np.cumsum(left) - 1
        parents = self.parents[left]
        self._q, self._parents = self.q[left], np.where(parents < 0, -1, numbers[parents])
        self._failures = self._failures[: self._count][left]
        self._count = len(self._q)


class Found(NamedTuple):
    """The result of a search."""

    way: Array | None
    """Joint values of a way that is proved free, (N, n); None if there is no result."""
    nodes: int
    """Number of nodes of both trees."""
    samples: int
    """Number of samples of the sequence."""


def search(space: Space, begin: Array, ends: Array, deadline: Deadline) -> Found:
    """Search for a way from joint values, (n,), to one of some others, (k, n), all of them free."""
    trees, samples = (Tree(space, begin[None]), Tree(space, ends)), 0
    while samples < MOST and not deadline.passed:
        growing, other = trees if samples // TOGETHER % 2 else trees[::-1]
        goals, finer = space.samples(samples, TOGETHER), 1.0
        samples += TOGETHER
        if samples // TOGETHER % (2 * OFTEN) <= 1:  # Two rounds in a row: one for each tree.
            nodes = np.arange(samples, samples + TOGETHER) * _GOLDEN % 1.0 * len(growing)
            goals, finer = space.around(growing.q[nodes.astype(np.int64)], goals), FINER
        grown = _grow(growing, goals, LONGEST / finer, SHORTEST / finer)
        if len(grown) and (way := _connect(growing, other, grown, growing is trees[0])) is not None:
            way = way - space.turns(way[0] - begin)
            way[0] = begin  # Turning there and back rounds.
            return Found(way, len(trees[0]) + len(trees[1]), samples)
    return Found(None, len(trees[0]) + len(trees[1]), samples)


def _grow(tree: Tree, goals: Array, longest: float, shortest: float) -> Indices:
    """Grow a tree towards samples, (k, n), as far as the motions are free; return the new nodes.

    Motions are at most as long as `longest`, and those shorter than `shortest` add no node [rad or m].
    """
    space = tree.space
    parents, ways = tree.nearest(goals, promising=True)
    lengths = np.linalg.norm(ways, axis=1)
    ways *= np.minimum(1.0, longest / np.maximum(lengths, longest))[:, None]
    rows, _ = space.advance(tree.q[parents], ways)
    kept = _lengths(tree.q[parents], rows) > shortest
    tree.fail(parents[~kept])
    return tree.grow(parents[kept], [rows[i] for i in np.flatnonzero(kept)])


def _lengths(begins: Array, rows: list[Array]) -> Array:
    """Return how far the last of some rows, (m, n) each, are from the begins, (k, n); 0 where there are none."""
    ends = np.array([each[-1] if len(each) else begin for begin, each in zip(begins, rows, strict=True)])
    return np.asarray(np.linalg.norm(ends - begins, axis=1))


def _connect(growing: Tree, other: Tree, grown: Indices, forward: bool) -> Array | None:
    """Grow the other tree towards new nodes; return a way through one that it reaches, if it is proved free."""
    space = growing.space
    parents, ways = other.nearest(growing.q[grown])
    rows, reached = space.advance(other.q[parents], ways)
    for i in np.flatnonzero(reached):
        one, two = growing.branch(int(grown[i])), other.branch(int(parents[i]))
        a, b, between = growing.q[one], other.q[two], rows[i][-2::-1]
        turns = space.turns(growing.q[grown[i]] - b[-1])
        way = np.concatenate([a, between + turns, (b + turns)[::-1]])
        free = space.proved(way[:-1], way[1:])
        if free.all():
            return way if forward else way[::-1]
        bad_one = [one[k + 1] for k in range(len(one) - 1) if not free[k]]
        bad_two = [two[k + 1] for k in range(len(two) - 1) if not free[len(way) - 2 - k]]
        if bad_one:
            growing.remove(bad_one)
        if bad_two:
            other.remove(bad_two)
        if bad_one or bad_two:
            return None
    part = np.flatnonzero(~reached & (_lengths(other.q[parents], rows) > SHORTEST))
    other.grow(parents[part], [rows[i] for i in part])
    return None
