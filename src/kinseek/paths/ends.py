"""Prepare layers and find the best path through them: limits, missed poses, given ends, closed paths, `valid`."""

from __future__ import annotations

import itertools
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline, TimeUp

from .joints import Turning
from .layers import SAME, Layers
from .nodes import LayerGraph
from .request import PathRequest
from .steps import short_steps, steps_of

MOST = 250
"""Largest number of solutions per pose, since the search stores their numbers in a byte. There are at most sixteen isolated
ones, and some appear twice."""

ROUNDS = 10
"""Paths that are tried before `valid` is called for every solution of every pose."""

AT_ONCE = 512
"""Poses whose solutions are processed together, so that the working set fits into the processor's cache."""

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def inside_limits(problem: Problem, wide: Layers) -> Layers:
    """Keep the solutions inside the limits, each joint in its first turn."""
    if not len(wide):
        return wide
    turning = Turning(problem.chain)
    rows: list[Array] = []
    counts: list[Indices] = []
    parts = [slice(begin, begin + AT_ONCE) for begin in range(0, len(wide), AT_ONCE)]
    for some in parts:
        first = turning.first_turn(wide.q[some])
        first, good = _at_both_ends(turning, first, turning.inside(first) & wide.there[some])
        # More solutions do not fit into the byte that stores their number.
        good &= np.cumsum(good, axis=1) <= MOST
        rows.append(first[good])
        counts.append(good.sum(axis=1))
    count = np.concatenate(counts)
    there = np.arange(max(int(count.max()), 1)) < count[:, None]
    # The columns that are not used any more are dropped, since the work grows with the square of their number.
    packed = np.zeros((*there.shape, wide.q.shape[2]))
    for some, values in zip(parts, rows, strict=True):
        packed[some][there[some]] = values
    return Layers(packed, there)


def _at_both_ends(turning: Turning, q: Array, good: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Add a twin at the upper end to solutions, (N, width, n), with a joint at the lower end of a range of whole turns.

    At the ends one more copy lies inside the limits than there are nodes for. The twin is off the end by a rounding error,
    so it has a node of its own.
    """
    for joint in np.flatnonzero(turning.at_lower_end(q)[good].any(axis=0)):
        at_end = turning.at_lower_end(q)[..., joint] & good
        some = at_end.any(axis=0)
        twins = q[:, some].copy()
        twins[..., joint] = turning.off_upper_end[joint]
        q, good = np.concatenate([q, twins], axis=1), np.concatenate([good, at_end[:, some]], axis=1)
    return q, good


class Filled(NamedTuple):
    """Layers with at least one row of joint values for every pose."""

    layers: Layers
    missed: NDArray[np.bool_]
    """Flags of poses without a solution, (N,); their joint values put the hand nearest to the pose."""


def fill_missed(problem: Problem, layers: Layers, threads: int | None, deadline: Deadline) -> Filled:
    """Give each pose without a solution the nearest one that the atlas finds; if the time is up, only the first poses."""
    missed = layers.count == 0
    some = np.flatnonzero(missed)
    if not len(some):
        return Filled(layers, missed)
    goal = problem.goal.at(problem.goal.target[some])
    found = Atlas(threads=threads).solve(Problem(problem.mechanism, goal, time_limit=deadline.left))
    q, there = layers.q.copy(), layers.there.copy()
    q[some, 0], there[some, 0] = Turning(problem.chain).first_turn(found.q), True
    missed[some] = ~np.asarray(found.success)
    late = some[np.asarray(found.out_of_time)]
    count = int(late[0]) if len(late) else len(q)
    return Filled(Layers(q[:count], there[:count]), missed[:count])


def with_ends(request: PathRequest, layers: Layers) -> tuple[Layers, tuple[int, int]]:
    """Add the given start and end to the solutions of the first and the last pose; return also their nodes, or -1."""
    turning, nodes = Turning(request.problem.chain), [-1, -1]
    for k, (fixed_q, i) in enumerate(((request.start, 0), (request.end, len(layers.q) - 1))):
        if fixed_q is None:
            continue
        q = np.concatenate([layers.q, np.zeros_like(layers.q[:, :1])], axis=1)
        there = np.concatenate([layers.there, np.zeros_like(layers.there[:, :1])], axis=1)
        place, inside = int(layers.count[i]), turning.off_ends(fixed_q)
        q[i, place], there[i, place] = turning.first_turn(inside), True
        nodes[k] = place * turning.total + turning.turns_of(inside)
        layers = Layers(q, there)
    return layers, (nodes[0], nodes[1])


def best_valid(graph: LayerGraph, ends: tuple[int, int]) -> tuple[Array, Indices]:
    """Find the best path that `valid` accepts by checking the best path repeatedly (Bohlin and Kavraki 2000).

    Returns:
        Joint values and breaks; if the time is up, only for the first poses, which `valid` accepted.
    """
    request = graph.request
    with suppress(TimeUp):
        graph.refuse_blocked()
    for tries in itertools.count(1):
        q, breaks, _, path = best_of(graph, ends)
        if request.valid is None:
            return q, breaks
        agreed, count = graph.check(q, breaks, path)
        if agreed:
            return q, breaks
        if request.deadline.passed:
            break
        # The best paths keep failing: it is then cheaper to check every node once than one more path at a time.
        if tries == ROUNDS:
            with suppress(TimeUp):
                graph.check_all_nodes()
    if count == len(q):  # The step from the last pose to the first is not included.
        return q, np.append(breaks, len(q) - 1)
    return q[:count], breaks[breaks < count - 1]


def best_of(graph: LayerGraph, ends: tuple[int, int]) -> tuple[Array, Indices, float, Indices]:
    """Find the best path. For a closed path, try every solution of the first pose and return the best result."""
    request = graph.request
    if not request.closed:
        return graph.best(*ends)
    best: tuple[Array, Indices, float, Indices] | None = None
    longest, turning = request.longest[-1], graph.turning
    if request.ends_where_it_begins:
        # First and last pose are the same: the joints must return to the same values, not just near them.
        longest = np.minimum(longest, SAME)
    if graph.unreachable & {0, len(graph.q) - 1}:
        longest = np.full_like(longest, np.inf)
    firsts = range(graph.count[0] * turning.total) if ends[0] < 0 else [ends[0]]
    open_way = graph.best(*ends)
    # The best open path probably begins at the best node, so the bound below ends the loop early.
    firsts = [int(open_way[3][0]), *(node for node in firsts if node != open_way[3][0])]
    for first in firsts:
        if not graph.exists(0, first):
            continue
        if best is not None and request.deadline.passed:
            break
        for last in graph.beside(first, longest) if ends[1] < 0 else [ends[1]]:
            way = graph.best(first, last)
            if best is None or (len(way[1]), way[2]) < (len(best[1]), best[2]):
                best = way
        # An open path is never worse than a closed one, so nothing better exists.
        if best is not None and len(best[1]) == len(open_way[1]) and best[2] <= open_way[2] * (1 + 1e-9):
            break
    if best is not None and len(best[1]) <= len(open_way[1]) + 1:
        return best
    q, breaks, cost, path = open_way
    return q, np.append(breaks, len(q) - 1), cost, path


def refusals(request: PathRequest, q: Array) -> tuple[set[int], Indices, int]:
    """Check a path, (M, n), against a scene and the user's `valid`.

    Returns:
        Indices of poses that are not allowed; indices of poses from which the step to the next is not allowed; and how many
        poses were checked before the time was up.
    """
    valid = request.valid
    forbidden_edges = list[Indices]([np.zeros(0, dtype=np.int64)])
    if valid is None or not len(q):
        return set(), forbidden_edges[0], len(q)
    goal, refused = request.problem.goal, np.zeros(len(q), dtype=np.bool_)
    begin, end = steps_of(request, q)
    # Steps to and from a missed pose are not checked, nor are steps that are breaks in any case.
    short = short_steps(request, begin, end)
    goal = goal.at(goal.target[: len(q)])
    there = goal.met(goal.measure(request.problem.arrays, np.ascontiguousarray(q)))
    size = valid.at_once(len(q))
    for first in range(0, len(q), size):
        try:
            some = first + np.flatnonzero(there[first : first + size])
            refused[some] = ~valid.each(q[some])
            ways = np.arange(max(first - 1, 0), min(first + size, len(q)) - 1)
            if len(begin) == len(q) and first + size >= len(q):
                ways = np.append(ways, len(q) - 1)
            fine = np.asarray(there & ~refused)
            ways = ways[short[ways] & fine[ways] & fine[(ways + 1) % len(q)]]
            forbidden_edges.append(ways[~valid.ways(begin[ways], end[ways])])
        except TimeUp:
            refused[first:] = False
            return set(np.flatnonzero(refused).tolist()), np.concatenate(forbidden_edges), first
    return set(np.flatnonzero(refused).tolist()), np.concatenate(forbidden_edges), len(q)
