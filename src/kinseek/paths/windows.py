"""The best way through a long path with little memory, window by window; as good as that through all of it at once.

What grows with a path are the answers to its poses. From most poses to the next nothing happens: every branch goes on, none
comes close to another, no full turn is passed. Over such a run each branch is one step that costs as much as it is long: all
but the two poses at its ends are left out, and one programme goes through what is left of all windows. Then the windows are
gone through again, and of each pose the answer is kept that the search chose. A way without breaks is the best of all;
where there are breaks they are as few, and each stands at an end of a run.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.kernels.paths.viterbi import COPIED, DISTANCE, ROOM, STRAIGHT, TIME, viterbi
from kinseek.turns import TURN

from .ends import fill_missed, inside_limits, with_ends
from .joints import Turning
from .layers import EVERY, Layers, isolated_layers
from .request import PathRequest, open_beside

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

WINDOW = 64 * EVERY
"""Poses of a window."""

LONG = 8 * WINDOW
"""Poses from which on a path is followed so: below, all its answers fit into some 30 MB."""

FIRST_PART = 0.45
"""Of a time limit so much is left to the first look at all windows: the second takes as long."""

STAYS = 1e-12
"""Over a run a branch leads to itself, and to nothing that is farther off than this [rad or m]."""


def in_windows(request: PathRequest) -> bool:
    """Is a path with isolated answers followed in windows? The user's own cost and judgement are asked of whole paths."""
    return len(request) > LONG and request.cost is None and request.valid is None and not request.closed


@dataclass(frozen=True)
class Run:
    """What is left of a window: some of its poses, and how each branch goes from one of them to the next."""

    kept: Indices
    """Numbers of the poses in the window, (k,); the first and the last are among them."""
    layers: Layers
    """Answers to these."""
    costs: Array
    """What each answer costs until the next kept pose, (k, width); 0 where that is the next of all."""
    count: int
    """Poses of the window."""


class Windows:
    """The answers to a long path, a window at a time."""

    def __init__(self, request: PathRequest, threads: int | None) -> None:
        """Take a path whose answers are isolated."""
        self.request, self._threads = request, threads
        self.turning = Turning(request.problem.chain)
        self._count = len(request)
        self.begins = list(range(0, self._count, WINDOW))
        self._longest = request.longest.max(axis=0)
        self._wide: tuple[int, Layers] | None = None
        self.missed = np.zeros(self._count, dtype=np.bool_)
        """Which poses have no answer; known of the windows that were looked at, (N,)."""

    def __len__(self) -> int:
        """Number of poses."""
        return self._count

    def at(self, i: int) -> Array:
        """Answers to pose i, limits opened, (k, n)."""
        begin = i - i % WINDOW
        if self._wide is None or self._wide[0] != begin:
            self._wide = begin, self._isolated(begin, _silent, Deadline())
        return self._wide[1].at(i - begin)

    def _isolated(self, begin: int, advance: Callable[[int], object], deadline: Deadline) -> Layers:
        return isolated_layers(self._part(begin).problem, self._longest, self._threads, advance, deadline)

    def _part(self, begin: int) -> PathRequest:
        return self.request.part(begin, min(begin + WINDOW, self._count))

    def layers(
        self, begin: int, advance: Callable[[int], object], deadline: Deadline
    ) -> tuple[Layers, tuple[int, int], PathRequest] | None:
        """Answers inside the limits of the window that begins at a pose, the nodes of its wanted ends, and the window.

        If the time is up the window is shorter; None if nothing is left of it.
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
    """The best way through a long path: joint values, (N, n), and its breaks; if the time is up, of its first poses."""
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
        if half.passed:
            break
    q, breaks, place = [np.empty((0, len(turning.lower)))], [np.zeros(0, dtype=np.int64)], 0
    nodes, report = _best(windows, runs, (first, last)) if runs else (breaks[0], np.zeros(0, dtype=np.bool_))
    for begin, run in zip(windows.begins, runs, strict=False):
        found = windows.layers(begin, lambda done: advance(done // 2), deadline)
        if found is None:
            break
        layers = found[0]
        mine = slice(place, place + len(run.kept))
        breaks.append(begin + run.kept[report[mine]] - 1)
        # Over a run the node stays the same.
        chosen = np.repeat(nodes[mine], np.diff(run.kept, append=run.count))[: len(layers)]
        answers, turns = chosen // turning.total, chosen % turning.total
        values = turning.node_values(layers.q[np.arange(len(chosen)), answers], turns)
        q.append(np.clip(values, turning.open_lower, turning.open_upper))
        place += len(run.kept)
        if len(chosen) < run.count:
            break
    rows = np.concatenate(q)
    breaks_of_all = np.concatenate(breaks)
    return turning.unwrapped(rows), breaks_of_all[breaks_of_all < max(len(rows) - 1, 0)]


def shortened(request: PathRequest, layers: Layers, turning: Turning) -> Run:
    """Leave out of a window the poses at which nothing happens."""
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
                # A full turn that is passed, or room for one more or less, is something that happens.
                room = np.floor((turning.upper[j] + ROOM - q[..., j]) / TURN)
                itself &= (np.einsum("iaa->ia", turns) == 0) & (room[1:] == room[:-1])
        close &= np.abs(gap) <= longest[:, j, None, None]
        step = np.abs(np.einsum("iaa->ia", gap)) * weights[j]
        costs[:-1] = np.hypot(costs[:-1], step) if request.velocity is None else np.maximum(costs[:-1], step)
    alone = close == (together & np.eye(q.shape[1], dtype=np.bool_))
    steady = alone.all(axis=(1, 2)) & ((there[1:] == there[:-1]) & (itself | ~there[1:])).all(axis=1)
    kept = (
        np.flatnonzero(np.concatenate([[True], ~(steady[1:] & steady[:-1]), [True]])) if len(q) > 1 else [0]
    )
    kept = np.asarray(kept, dtype=np.int64)
    sums = np.add.reduceat(costs, kept, axis=0)
    sums[np.diff(kept, append=len(q)) == 1] = 0.0
    return Run(kept, Layers(q[kept], there[kept]), sums, len(q))


def _best(windows: Windows, runs: list[Run], ends: tuple[int, int]) -> tuple[Indices, Flags]:
    """The best way through what is left of all windows: a node for each kept pose, and whether it comes by a break."""
    request, turning = windows.request, windows.turning
    width = max(run.layers.q.shape[1] for run in runs)
    count, dof = sum(len(run.kept) for run in runs), len(turning.lower)
    # One more column holds what a branch costs on its way: where it leads, it is so far off there.
    q, ahead = np.zeros((2, count, width, dof + 1))
    longest = np.empty((max(count - 1, 1), dof + 1))
    longest[:, -1] = np.inf
    number, place = np.empty(count, dtype=np.int64), 0
    for begin, run in zip(windows.begins, runs, strict=False):
        mine, wide = slice(place, place + len(run.kept)), run.layers.q.shape[1]
        q[mine, :wide, :-1] = ahead[mine, :wide, :-1] = run.layers.q
        number[mine] = run.layers.count
        rows = slice(place, min(place + len(run.kept), count - 1))
        steps = np.minimum(begin + run.kept, len(request.longest) - 1)[: rows.stop - rows.start]
        longest[rows, :-1] = request.longest[steps]
        following = np.minimum(begin + run.kept + 1, len(request) - 1)
        open_steps = windows.missed[begin + run.kept] | windows.missed[following]
        longest[rows, :-1][open_steps[: rows.stop - rows.start]] = np.inf
        over = np.flatnonzero(np.diff(run.kept) > 1)
        ahead[place + over, :wide, :-1] = run.layers.q[over + 1]
        ahead[place + over, :wide, -1] = -run.costs[over]
        longest[place + over, :-1] = STAYS
        place += len(run.kept)
    weights = request.weights if request.velocity is None else request.weights / request.velocity
    path, report = np.zeros(count, dtype=np.int64), np.zeros(count)
    viterbi(
        q,
        ahead,
        number,
        np.append(turning.lower, -1.0),
        np.append(turning.upper, 1.0),
        np.append(turning.kind, STRAIGHT),
        np.append(turning.copies, 1),
        longest,
        np.append(weights, 1.0),
        DISTANCE if request.velocity is None else TIME,
        np.zeros((0, 0)),
        np.zeros((0, 0), dtype=np.bool_),
        np.zeros((0, 3), dtype=np.int64),
        np.array(ends, dtype=np.int64),
        path,
        report,
    )
    return path, np.concatenate([[False], report[1:] > 0])
