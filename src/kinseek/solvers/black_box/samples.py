"""The samples of a function: made once, sorted by where the tip is, dropped with the arm.

Without axes nothing can be divided out, as the compiled atlas does, so all joints are sampled, and the samples are
filed under the whole of what a goal compares.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from kinseek.caching import LRUCache, WeakCache
from kinseek.errors import InvalidRobot
from kinseek.goal import Goal
from kinseek.kinds import Kind
from kinseek.robots.mechanism import Mechanism
from kinseek.robots.sampling import spread_inside

from .asking import features

Array = NDArray[np.float64]

_DEAR = 8
"""A function that runs Python for every row gets this many times fewer samples."""


MOST_FEATURES = 16
"""Kinds of goals and tools whose features are kept, the last ones used."""


class Samples:
    """Joint values spread over the limits, their poses, and their features for each kind of goal."""

    def __init__(self, box: Mechanism, count: int) -> None:
        """Ask the function.

        Raises:
            InvalidRobot: The mechanism cannot be put together at any of the samples.
        """
        began = time.perf_counter()
        wanted = min(count if box.cheap else max(count // _DEAR, 8), 64**box.dof)
        q = spread(box, wanted)
        poses = box.forward(q)
        there = ~np.isnan(poses).any(axis=(1, 2))
        if not there.any():
            raise InvalidRobot(f"fk of {box.name!r} gave NaN at all of {len(q)} samples inside the limits")
        self.q, self.poses = q[there], poses[there]
        place = self.poses[:, :3, 3]
        spread_of = float(np.sqrt(((place - place.mean(axis=0)) ** 2).sum(axis=1).mean()))
        self.length = spread_of if spread_of > 1e-9 else 1.0
        """How far the tip is from its mean, root mean square [m]: makes lengths and directions comparable."""
        self.samples = len(self.q)
        """Number of samples where the mechanism can be put together."""
        self.evaluations = len(q)
        """Poses asked for."""
        self.memory = self.q.nbytes + self.poses.nbytes
        """[bytes], without the features."""
        self.build_time = time.perf_counter() - began
        """[s]"""
        self._features: LRUCache[tuple[Kind, bytes | None], Array] = LRUCache(MOST_FEATURES)

    def nearest(self, goal: Goal, target: Array, count: int) -> NDArray[np.int64]:
        """Samples nearest to the features of a target, (m,), nearest first, (k,)."""
        columns = self._features.get(goal.prepared_as, lambda: self._columns(goal))
        return nearest_columns(columns, self._scaled(target[None], goal.form)[0], min(count, self.samples))

    def _columns(self, goal: Goal) -> Array:
        """Features of all samples, (m, N): one feature after the other, as `nearest_columns` goes through them."""
        points = features(self.poses, goal.tip, tuple(range(goal.columns)))
        return np.ascontiguousarray(self._scaled(points, goal.form).T)

    def _scaled(self, points: Array, kind: Kind) -> Array:
        """Two columns hold the third."""
        place, turn = points[:, :3] / self.length, points[:, 3:9]
        return np.concatenate([place, turn * np.sqrt(kind.column_weight)], axis=1)

    def __repr__(self) -> str:
        """Size and cost."""
        return f"Samples({self.samples} samples, {self.memory / 2**20:.1f} MiB, built in {self.build_time * 1e3:.0f} ms)"


_samples: WeakCache[Mechanism, int, Samples] = WeakCache()


def samples_of(box: Mechanism, count: int) -> Samples:
    """The samples of a function: made at the first call, dropped with the arm."""
    return _samples.of(box).get(count, lambda: Samples(box, count))


def spread(box: Mechanism, count: int) -> Array:
    """Joint values spread inside the limits, (count, n); none is a rounding outside, where nobody may ask a function."""
    return np.clip(spread_inside(box.lower, box.upper, box.turns, count), box.lower, box.upper)


def nearest_columns(points: Array, target: Array, count: int) -> NDArray[np.int64]:
    """Numbers of the points nearest to a target, nearest first, (count,).

    All are compared. Among 16,384 samples that takes a fifth of a millisecond longer than a k-d tree does, and nothing to
    build; the walks that begin there take some milliseconds.

    Args:
        points: One in each column, (m, N).
        target: (m,)
        count: At least 1 and at most N.
    """
    away = np.zeros(points.shape[1])
    for values, value in zip(points, target, strict=True):
        away += (values - value) ** 2
    near = np.argpartition(away, count - 1)[:count]
    return np.asarray(near[np.lexsort((near, away[near]))])
