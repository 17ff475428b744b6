"""Find the best path through a long list of poses window by window, with little memory and the same result as at once.

The memory for a path grows with the solutions of its poses. Between most poses nothing happens: every branch continues, none
comes close to another, and no full turn is passed. Over such a run each branch is one step whose cost is its length. All
poses of the run except the two at its ends are left out, and one dynamic program covers what remains of all windows. Then
the windows are processed again, and the solution that the search chose is kept for each pose. A path without breaks is the
best of all. If there are breaks, there are as few as any path has, and each is at an end of a run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.kernels.paths import viterbi
from kinseek.kernels.paths.viterbi import COPIED, DISTANCE, ROOM, STRAIGHT, TIME
from kinseek.turns import TURN

from .ends import fill_missed, inside_limits, with_ends
from .joints import Turning
from .layers import EVERY, Layers, isolated_layers
from .request import PathRequest, open_beside

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

WINDOW = 64 * EVERY
"""Poses in a window."""

LONG = 8 * WINDOW
"""Poses from which on a path is processed in windows; the solutions of a shorter path take up to some 30 MB."""

FIRST_PART = 0.45
"""Fraction of a time limit for the first pass over all windows; the second pass takes as long. Not examined further."""

STAYS = 1e-12
"""Over a run a branch leads only to itself: solutions farther off than this [rad or m] are not linked."""


def in_windows(request: PathRequest) -> bool:
    """Return whether a path with isolated solutions is processed in windows: without `cost`, `valid` or `closed`."""
    return len(request) > LONG and request.cost is None and request.valid is None and not request.closed


@dataclass(frozen=True)
class Run:
    """The kept poses of a window, and how each branch continues from one of them to the next."""

    chosen_poses: Indices
    """Indices of the kept poses in the window, (k,), with the first and the last."""
    layers: Layers
    """Solutions of these poses."""
    costs: Array
    """Cost of each solution until the next kept pose, (k, width); 0 if that is the very next pose."""
    count: int
    """Number of poses of the window."""


class Windows:
    """The solutions for a long path, one window at a time."""

    def __init__(self, request: PathRequest, threads: int | None) -> None:
        """Take a path whose solutions are isolated."""
        self.request, self._threads = request, threads
        self.turning = Turning(request.problem.chain)
        self._count = len(request)
        self.begins = list(range(0, self._count, WINDOW))
        self._longest = request.longest.max(axis=0)
        self._wide: tuple[int, Layers] | None = None
        self.missed = np.zeros(self._count, dtype=np.bool_)
        """Flags of the poses without a solution, (N,); only set for windows that were processed."""

    def __len__(self) -> int:
        """Return the number of poses."""
        return self._count

    def at(self, i: int) -> Array:
        """Return the solutions of pose i, with widened limits, (k, n)."""
        begin = i - i % WINDOW
        if self._wide is None or self._wide[0] != begin:
            # The last window is kept, because a caller usually asks for adjacent poses.
            self._wide = begin, self._isolated(begin, _silent, Deadline())
        return self._wide[1].at(i - begin)

    def _isolated(self, begin: int, advance: Callable[[int], object], deadline: Deadline) -> Layers:
        return isolated_layers(self._part(begin).problem, self._longest, self._threads, advance, deadline)

    def _part(self, begin: int) -> PathRequest:
        return self.request.part(begin, min(begin + WINDOW, self._count))

    def layers(
        self, begin: int, advance: Callable[[int], object], deadline: Deadline
    ) -> tuple[Layers, tuple[int, int], PathRequest] | None:
        """Return the solutions inside the limits of the window at `begin`, the nodes of its given ends, and its request.

        If the time is up, the window is shorter; None if nothing is left of it.
        """
        part = self._part(begin)
        layers, missed = inside_limits(part.problem, self._isolated(begin, advance, deadline)), None
        if len(layers):
            layers, missed = fill_missed(part.problem, layers, self._threads, deadline)
        if missed is None or not len(layers):
            return None
        part = part.part(0, len(layers))
        self.missed[begin : begin + len(layers)] = missed
        layers, ends = with_ends(part, layers)
        return layers, ends, replace(part, longest=open_beside(part.longest, missed))


def _silent(done: int) -> None:
    pass


def best_in_windows(windows: Windows, advance: Callable[[int], object]) -> tuple[Array, Indices]:
    """Find the best path through a long list of poses: joint values, (N, n), and its breaks.

    If the time is up, the path covers only the first poses.
    """
    turning, deadline = windows.turning, windows.request.deadline
    half = deadline.share(FIRST_PART)
    runs: list[Run] = []
    first = last = -1
    for begin in windows.begins:
        found = windows.layers(begin, lambda done: advance(done // 2), half)
        if found is None:
            break
        layers, ends, part = found
        runs.append(shortened(part, layers, turning))
        first, last = (ends[0] if begin == 0 else first), ends[1]
        # The second pass over the same windows needs the rest of the time.
        if half.passed:
            break
    q, breaks, place = [np.empty((0, len(turning.lower)))], [np.zeros(0, dtype=np.int64)], 0
    nodes, report = _best(windows, runs, (first, last)) if runs else (breaks[0], np.zeros(0, dtype=np.bool_))
    for begin, run in zip(windows.begins, runs, strict=False):
        found = windows.layers(begin, lambda done: advance(done // 2), deadline)
        if found is None:
            break
        # The solutions are computed again, since those of all windows together would need too much memory.
        layers = found[0]
        mine = slice(place, place + len(run.chosen_poses))
        breaks.append(begin + run.chosen_poses[report[mine]] - 1)
        # Over a run the node stays the same.
        chosen = np.repeat(nodes[mine], np.diff(run.chosen_poses, append=run.count))[: len(layers)]
        solutions, turns = chosen // turning.total, chosen % turning.total
        values = turning.node_values(layers.q[np.arange(len(chosen)), solutions], turns)
        q.append(np.clip(values, turning.open_lower, turning.open_upper))
        place += len(run.chosen_poses)
        if len(chosen) < run.count:
            break
    rows = np.concatenate(q)
    breaks_of_all = np.concatenate(breaks)
    return turning.unwrapped(rows), breaks_of_all[breaks_of_all < max(len(rows) - 1, 0)]


def shortened(request: PathRequest, layers: Layers, turning: Turning) -> Run:
    """Remove from a window the poses at which nothing happens."""
    q, there = layers.q, layers.there
    longest = np.broadcast_to(request.longest, (len(q) - 1, q.shape[2]))
    together = there[:-1, :, None] & there[1:, None, :]
    close, itself = together.copy(), np.ones((len(q) - 1, q.shape[1]), dtype=np.bool_)
    costs = np.zeros((len(q), q.shape[1]))
    weights = request.weights if request.velocity is None else request.weights / request.velocity
    for j, kind in enumerate(turning.kind):
        gap = q[1:, None, :, j] - q[:-1, :, None, j]
        if kind != STRAIGHT:
            turns = np.rint(gap / TURN)
            gap -= TURN * turns
            if kind == COPIED:
                # A full turn that is passed, or room for one more or less, counts as an event.
                room = np.floor((turning.upper[j] + ROOM - q[..., j]) / TURN)
                itself &= (np.einsum("iaa->ia", turns) == 0) & (room[1:] == room[:-1])
        close &= np.abs(gap) <= longest[:, j, None, None]
        step = np.abs(np.einsum("iaa->ia", gap)) * weights[j]
        costs[:-1] = np.hypot(costs[:-1], step) if request.velocity is None else np.maximum(costs[:-1], step)
    alone = close == (together & np.eye(q.shape[1], dtype=np.bool_))
    steady = alone.all(axis=(1, 2)) & ((there[1:] == there[:-1]) & (itself | ~there[1:])).all(axis=1)
    chosen_poses = (
        np.flatnonzero(np.concatenate([[True], ~(steady[1:] & steady[:-1]), [True]])) if len(q) > 1 else [0]
    )
    chosen_poses = np.asarray(chosen_poses, dtype=np.int64)
    sums = np.add.reduceat(costs, chosen_poses, axis=0)
    sums[np.diff(chosen_poses, append=len(q)) == 1] = 0.0
    return Run(chosen_poses, Layers(q[chosen_poses], there[chosen_poses]), sums, len(q))


def _best(windows: Windows, runs: list[Run], ends: tuple[int, int]) -> tuple[Indices, Flags]:
    """Return the best path through all kept poses: a node for each, and whether it is reached by a break."""
    request, turning = windows.request, windows.turning
    width = max(run.layers.q.shape[1] for run in runs)
    count, dof = sum(len(run.chosen_poses) for run in runs), len(turning.lower)
    # One more column holds the cost of a branch over a run: it is added as the distance to the next kept pose.
    q, arrivals = np.zeros((2, count, width, dof + 1))
    longest = np.empty((max(count - 1, 1), dof + 1))
    # The additional column is a cost and no motion, so it never makes a break.
    longest[:, -1] = np.inf
    number, place = np.empty(count, dtype=np.int64), 0
    for begin, run in zip(windows.begins, runs, strict=False):
        mine, wide = slice(place, place + len(run.chosen_poses)), run.layers.q.shape[1]
        q[mine, :wide, :-1] = arrivals[mine, :wide, :-1] = run.layers.q
        number[mine] = run.layers.count
        rows = slice(place, min(place + len(run.chosen_poses), count - 1))
        steps = np.minimum(begin + run.chosen_poses, len(request.longest) - 1)[: rows.stop - rows.start]
        longest[rows, :-1] = request.longest[steps]
        following = np.minimum(begin + run.chosen_poses + 1, len(request) - 1)
        open_steps = windows.missed[begin + run.chosen_poses] | windows.missed[following]
        # Steps to and from missed poses do not count as breaks.
        longest[rows, :-1][open_steps[: rows.stop - rows.start]] = np.inf
        over = np.flatnonzero(np.diff(run.chosen_poses) > 1)
        arrivals[place + over, :wide, :-1] = run.layers.q[over + 1]
        arrivals[place + over, :wide, -1] = -run.costs[over]
        longest[place + over, :-1] = STAYS
        place += len(run.chosen_poses)
    weights = request.weights if request.velocity is None else request.weights / request.velocity
    path, report = np.zeros(count, dtype=np.int64), np.zeros(count)
    turns = viterbi.Turns(
        *(np.append(row, one) for row, one in zip(turning.turns, (-1.0, 1.0, STRAIGHT, 1), strict=True))
    )
    mode = DISTANCE if request.velocity is None else TIME
    costs, refused = np.zeros((0, 0)), np.zeros((0, 0), dtype=np.bool_)
    rules = viterbi.Rules(costs, refused, np.zeros((0, 3), dtype=np.int64), np.array(ends, dtype=np.int64))
    bounds = viterbi.Steps(longest, np.append(weights, 1.0), mode)
    viterbi.viterbi(viterbi.Layers(q, arrivals, number), turns, bounds, rules, path, report)
    return path, np.concatenate([[False], report[1:] > 0])
