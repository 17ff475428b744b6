"""Check which joint values and steps a path may take, against a collision scene and the user's `valid`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import Valid, is_valid
from kinseek.support.deadline import Deadline
from kinseek.timing.obstacles import Obstacles

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.05
"""Largest distance in any joint [rad or m] between points of a step at which `valid` is called; at least one point is
checked."""


ROWS = 128
"""Rows per call of the scene if there is a deadline: a call then takes some milliseconds."""

REMEMBERED = 100_000
"""Most steps whose proofs are remembered; each takes some 200 bytes. Not examined further."""

FEW = 16
"""Poses per call of the user's `valid` if there is a deadline: each may take milliseconds."""


@dataclass(frozen=True)
class Allowed:
    """Check joint values and steps against a scene and the user's `valid`. An instance can be passed as a `valid`.

    Raises:
        TimeUp: By the methods that check many rows, if the deadline has passed.
    """

    valid: Valid | None = None
    scene: Obstacles | None = None
    clearance: float = 0.0
    own: slice = field(default_factory=lambda: slice(None))
    """The arm's own joints, if the chain also has virtual joints for ranges of the goal."""
    deadline: Deadline = field(default_factory=Deadline)
    _proofs: dict[tuple[bytes, float], bool] = field(default_factory=dict, repr=False, compare=False)
    """Steps that were checked, with the deviation of the joints, and whether they are proved free."""

    def at_least(self, seconds: float) -> Allowed:
        """Return these checks with at least some seconds left, even if the deadline has passed."""
        return replace(self, deadline=self.deadline.at_least(seconds))

    def at_once(self, count: int) -> int:
        """Return how many of `count` poses, and the steps between them, are checked in one batch."""
        if not self.deadline.limited:
            return max(count, 1)
        return ROWS if self.valid is None else FEW

    def __call__(self, q: Array) -> bool:
        """Return whether one q, (n,), is free and `valid` accepts it."""
        return bool(self.each(q[None])[0])

    def each(self, q: Array) -> Flags:
        """Return for each q, (k, n), whether it is free and `valid` accepts it, (k,)."""
        free = self.free(q)
        free[free] = self.agreed(q[free])
        return free

    def ways(self, a: Array, b: Array) -> Flags:
        """Return for each straight step, (k, n) to (k, n), whether it is free and `valid` accepts points of it, (k,)."""
        free = self.free_ways(a, b)
        free[free] = self.agreed_ways(a[free], b[free])
        return free

    def free(self, q: Array, margin: float = 0.0) -> Flags:
        """Return for each q, (k, n), whether it is free in the scene, (k,), by a margin beyond the clearance [m]."""
        if self.scene is None or not len(q):
            return np.ones(len(q), dtype=np.bool_)
        scene, own = self.scene, q[:, self.own]
        return self._in_parts(len(q), lambda some: scene.free(own[some], self.clearance + margin))

    def free_ways(self, a: Array, b: Array, around: float = 0.0) -> Flags:
        """Return for each straight step, (k, n) to (k, n), whether all of it is proved free in the scene, (k,).

        With `around`, this holds for all motions whose joints deviate from the step by at most this [rad or m].
        """
        if self.scene is None or not len(a):
            return np.ones(len(a), dtype=np.bool_)
        scene, begins, ends = self.scene, a[:, self.own], b[:, self.own]
        deviation = np.full(begins.shape[1], around) if around else None
        steps = [(step.tobytes(), around) for step in np.concatenate([begins, ends], axis=1)]
        # Most steps of a path are proved several times, and a step close to contact takes as long as thousands of others.
        known = [self._proofs.get(step) for step in steps]
        new = np.array([i for i, proof in enumerate(known) if proof is None], dtype=np.int64)
        free = np.array(known, dtype=np.bool_)
        if len(new):
            free[new] = self._in_parts(
                len(new),
                lambda some: scene.free_motion(begins[new[some]], ends[new[some]], self.clearance, deviation),
            )
            if len(self._proofs) > REMEMBERED:
                self._proofs.clear()
            self._proofs.update(zip([steps[i] for i in new], free[new].tolist(), strict=True))
        return free

    def probably_free(self, a: Array, b: Array, margin: float = 0.0) -> Flags:
        """Return for each straight step, (k, n) to (k, n), whether points of it at most `APART` apart are free, (k,).

        This proves nothing, and takes a small part of the time of `free_ways`. With a margin [m], the points keep this much
        more than the clearance, and the ends are checked too.
        """
        if self.scene is None or not len(a):
            return np.ones(len(a), dtype=np.bool_)
        parts = np.maximum(np.ceil(np.abs(b - a).max(axis=1) / APART), 2.0).astype(np.int64)
        begin = 0 if margin else 1
        counts = parts + 1 - 2 * begin
        first = np.cumsum(counts) - counts
        step = np.repeat(np.arange(len(a)), counts)
        share = (np.arange(len(step)) - first[step] + begin) / parts[step]
        q = a[step] + share[:, None] * (b - a)[step]
        return np.logical_and.reduceat(self.free(q, margin), first)

    def _in_parts(self, count: int, check: Callable[[slice], Any]) -> Flags:
        """Check `count` rows, (count,), all at once if there is no deadline, otherwise in batches."""
        # Without a deadline one call is fastest; with one the calls must end soon enough to notice it.
        size = ROWS if self.deadline.limited else count
        report = []
        for begin in range(0, count, size):
            self.deadline.check()
            report.append(np.asarray(check(slice(begin, begin + size)), dtype=np.bool_))
        return np.concatenate(report)

    def agreed(self, q: Array) -> Flags:
        """Return for each q, (k, n), whether `valid` accepts it, (k,)."""
        if self.valid is None:
            return np.ones(len(q), dtype=np.bool_)
        report = []
        for row in q:
            self.deadline.check()
            report.append(is_valid(self.valid, row[self.own]))
        return np.array(report, dtype=np.bool_)

    def agreed_ways(self, a: Array, b: Array) -> Flags:
        """Return for each straight step, (k, n) to (k, n), whether `valid` accepts all sampled points of it, (k,)."""
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
        """Describe in a phrase why one q, (n,), is not allowed."""
        if self.scene is not None and (found := self.scene.hits(q[self.own], self.clearance)):
            return _report(found)
        return "valid rejects it"

    def against_way(self, a: Array, b: Array) -> str:
        """Describe in a phrase why a straight step, (n,) to (n,), is not allowed."""
        a, b = a[self.own], b[self.own]
        if self.scene is not None and (found := self.scene.hits_between(a, b, self.clearance)):
            return _report(found)
        return "valid rejects a point of it"


def _report(found: Sequence[object]) -> str:
    more = f", and {len(found) - 1} more" if len(found) > 1 else ""
    return f"{found[0]}{more}"
