"""Layers: the isolated solutions of every pose of a path.

All branches are found at every `EVERY`-th pose. From each of these poses all branches are followed forward to the next, and
branches of that pose that no other one arrived at are followed backward, see `branches`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.solvers.threads import GoOn, parallel_for
from kinseek.support.deadline import Deadline

from .branches import Follower, Piece
from .bridge import nearest_to
from .joints import Turning
from .request import PathRequest

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

EVERY = 32
"""Poses from one search for all branches to the next."""

GROUP = 16
"""Intervals between two searches that are processed together if there is a deadline: a few hundred poses."""

AT_ONCE = 512
"""Poses whose solutions are processed together, so that the working set fits into the processor's cache."""


@dataclass(frozen=True)
class Layers:
    """Solutions of each of N poses, with widened limits."""

    q: Array
    """Joint values, (N, width, n), [rad] or [m]."""
    there: NDArray[np.bool_]
    """Flags of the entries that hold a solution, (N, width)."""

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.q)

    @property
    def count(self) -> NDArray[np.int64]:
        """Return the number of solutions of each pose, (N,)."""
        return np.asarray(self.there.sum(axis=1))

    def at(self, i: int) -> Array:
        """Return the solutions of pose i, (k, n)."""
        return np.asarray(self.q[i, self.there[i]])


def isolated_layers(
    problem: Problem,
    longest: Array,
    threads: int | None,
    advance: Callable[[int], object],
    deadline: Deadline | None = None,
) -> Layers:
    """Find the branches at every pose of a path, with widened limits; if the time is up, only at its first poses.

    Args:
        problem: The arm and its N targets; the arm is not redundant for this goal.
        longest: Largest step of each joint from pose to pose, (n,).
        threads: Threads that share the poses; None uses every core.
        advance: Called with the number of poses that were completed since the last call.
        deadline: No further search is started after it.
    """
    deadline = Deadline() if deadline is None else deadline
    follower = Follower(problem, longest)
    count = len(follower.rows)
    keys = sorted({*range(0, count, EVERY), count - 1})
    found: list[Array] = [np.zeros((0, follower.dof))] * len(keys)
    pieces: list[list[Piece]] = [[] for _ in keys]
    known, linked = np.zeros((2, len(keys)), dtype=np.bool_)
    size = GROUP if deadline.limited else len(keys)
    for low in range(0, max(len(keys) - 1, 1), size):
        high = min(low + size, len(keys) - 1)

        some = [k for k in range(low, high + 1) if not known[k]]

        def find(begin: int, end: int, go_on: GoOn, some: list[int] = some) -> None:
            for k in some[begin:end]:
                if not go_on():
                    return
                found[k] = follower.all_at(keys[k])
                known[k] = True

        def link(begin: int, end: int, go_on: GoOn, low: int = low) -> None:
            for k in range(low + begin, low + end):
                if not (go_on() and known[k] and known[k + 1]):
                    return
                pieces[k] = follower.between(keys[k], keys[k + 1], found[k], found[k + 1])
                linked[k] = True

        parallel_for(find, len(some), 8, threads, deadline)
        parallel_for(link, high - low, 4, threads, deadline, lambda done: advance(done * EVERY))
        if deadline.passed:
            break
    if count == 1:
        pieces[0] = [Piece(0, row[None]) for row in found[0]]
        return _layers(pieces, keys, int(known[0]), follower.dof)
    whole = int(np.argmin(linked))  # The last interval is none: the first that was not linked.
    return _layers(pieces[:whole], keys, keys[whole] + 1 if whole else 0, follower.dof)


def _layers(pieces: list[list[Piece]], keys: list[int], count: int, dof: int) -> Layers:
    """Combine pieces into layers; a pose where two intervals meet has the solutions of the earlier one."""
    cut: list[Piece] = []
    for k, some in enumerate(pieces):
        for piece in some:
            skip = 1 if k > 0 and piece.first == keys[k] else 0
            if len(piece.q) > skip:
                cut.append(Piece(piece.first + skip, piece.q[skip:]))
    cut.sort(key=lambda piece: piece.first)
    columns: list[int] = []
    places = []
    for piece in cut:
        # Use the first column that is free from here on, or a new one if there is none.
        column = next((c for c, end in enumerate(columns) if end <= piece.first), len(columns))
        columns += [0] * (column == len(columns))
        columns[column] = piece.first + len(piece.q)
        places.append(column)
    q = np.zeros((count, max(len(columns), 1), dof))
    there = np.zeros(q.shape[:2], dtype=np.bool_)
    for piece, column in zip(cut, places, strict=True):
        where = slice(piece.first, piece.first + len(piece.q))
        q[where, column], there[where, column] = piece.q, True
    return Layers(q, there)


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


def fill_missed(
    problem: Problem, layers: Layers, threads: int | None, deadline: Deadline
) -> tuple[Layers, Flags]:
    """Give each pose without a solution the nearest one that the atlas finds; if the time is up, only the first poses.

    Returns:
        Layers with at least one row for every pose, and flags of the missed poses, (N,).
    """
    missed = layers.count == 0
    some = np.flatnonzero(missed)
    if not len(some):
        return layers, missed
    q, there = layers.q.copy(), layers.there.copy()
    nearest, out_of_reach = nearest_to(problem, some, threads, deadline)
    count = len(q) if len(nearest) == len(some) else int(some[len(nearest)])
    some = some[: len(nearest)]
    q[some, 0], there[some, 0] = Turning(problem.chain).first_turn(nearest), True
    missed[some] = out_of_reach
    return Layers(q[:count], there[:count]), missed[:count]


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
