"""Which joint values a path may take, and which steps: what a scene leaves free, and what the user's `valid` agrees to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import Valid, is_valid
from kinseek.deadline import Deadline

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.05
"""Points between two poses at which `valid` is asked stand no farther apart in any joint [rad or m]; one at least."""


ROWS = 128
"""Rows that a scene is asked about together where a deadline has to be kept: some milliseconds."""

FEW = 16
"""Poses of which the user is asked together where a deadline has to be kept: it may take milliseconds each."""


class Obstacles(Protocol):
    """What a path asks of a scene."""

    def free(self, q: Any, clearance: float = 0.0) -> Any:
        """See `Scene.free`."""

    def free_motion(self, q0: Any, q1: Any, clearance: float = 0.0) -> Any:
        """See `Scene.free_motion`."""

    def hits_between(self, q0: Any, q1: Any, clearance: float = 0.0) -> Sequence[object]:
        """See `Scene.hits_between`."""

    def distance(self, q: Any) -> Any:
        """See `Scene.distance`."""

    def hits(self, q: Any, clearance: float = 0.0) -> Sequence[object]:
        """See `Scene.hits`."""


@dataclass(frozen=True)
class Allowed:
    """Asks a scene and the user. It can be called as a `valid`.

    Raises:
        TimeUp: By the methods that ask about many rows, once the deadline has passed.
    """

    valid: Valid | None = None
    scene: Obstacles | None = None
    clearance: float = 0.0
    own: slice = field(default_factory=lambda: slice(None))
    """The joints of the arm itself, where others stand for ranges of the goal."""
    deadline: Deadline = field(default_factory=Deadline)

    def at_once(self, count: int) -> int:
        """How many of so many poses are asked about, with the steps between them, before the next are."""
        if not self.deadline.limited:
            return max(count, 1)
        return ROWS if self.valid is None else FEW

    def __call__(self, q: Array) -> bool:
        """Is one q, (n,), free, and does the user agree?"""
        return bool(self.each(q[None])[0])

    def each(self, q: Array) -> Flags:
        """Of each q, (k, n): is it free, and does the user agree? (k,)."""
        free = self.free(q)
        free[free] = self.agreed(q[free])
        return free

    def ways(self, a: Array, b: Array) -> Flags:
        """Of each straight way, (k, n) to (k, n): is all of it free, and does the user agree to points of it? (k,)."""
        free = self.free_ways(a, b)
        free[free] = self.agreed_ways(a[free], b[free])
        return free

    def free(self, q: Array) -> Flags:
        """Of each q, (k, n): is it free in the scene? (k,)."""
        if self.scene is None or not len(q):
            return np.ones(len(q), dtype=np.bool_)
        scene, own = self.scene, q[:, self.own]
        return self._in_parts(len(q), lambda some: scene.free(own[some], self.clearance))

    def free_ways(self, a: Array, b: Array) -> Flags:
        """Of each straight way, (k, n) to (k, n): is all of it free in the scene? (k,)."""
        if self.scene is None or not len(a):
            return np.ones(len(a), dtype=np.bool_)
        scene, begins, ends = self.scene, a[:, self.own], b[:, self.own]
        return self._in_parts(
            len(a), lambda some: scene.free_motion(begins[some], ends[some], self.clearance)
        )

    def _in_parts(self, count: int, ask: Callable[[slice], Any]) -> Flags:
        """Ask about so many rows, all at once unless a deadline has to be kept, (count,)."""
        size = ROWS if self.deadline.limited else count
        report = []
        for begin in range(0, count, size):
            self.deadline.check()
            report.append(np.asarray(ask(slice(begin, begin + size)), dtype=np.bool_))
        return np.concatenate(report)

    def agreed(self, q: Array) -> Flags:
        """Of each q, (k, n): does the user agree? (k,)."""
        if self.valid is None:
            return np.ones(len(q), dtype=np.bool_)
        report = []
        for row in q:
            self.deadline.check()
            report.append(is_valid(self.valid, row[self.own]))
        return np.array(report, dtype=np.bool_)

    def agreed_ways(self, a: Array, b: Array) -> Flags:
        """Of each straight way, (k, n) to (k, n): does the user agree to all points of it that are asked? (k,)."""
        if self.valid is None:
            return np.ones(len(a), dtype=np.bool_)
        return np.array(
            [self._agreed_way(one, other) for one, other in zip(a, b, strict=True)], dtype=np.bool_
        )

    def _agreed_way(self, a: Array, b: Array) -> bool:
        assert self.valid is not None
        self.deadline.check()
        a, b = a[self.own], b[self.own]
        parts = max(2, math.ceil(float(np.abs(b - a).max()) / APART))
        return all(is_valid(self.valid, a + (b - a) * k / parts) for k in range(1, parts))

    def against(self, q: Array) -> str:
        """What stands against one q, (n,), that is not allowed: a phrase for people."""
        if self.scene is not None and (found := self.scene.hits(q[self.own], self.clearance)):
            return _report(found)
        return "valid refuses it"

    def against_way(self, a: Array, b: Array) -> str:
        """What stands against a straight way that is not allowed, (n,) to (n,)."""
        a, b = a[self.own], b[self.own]
        if self.scene is not None and (found := self.scene.hits_between(a, b, self.clearance)):
            return _report(found)
        return "valid refuses a point of it"


def _report(found: Sequence[object]) -> str:
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"{found[0]}{more}"
