"""Samples of black-box kinematics: computed once, sorted by the pose of the tip, dropped with the arm.

Without axes nothing can be divided out as in the compiled atlas. So all joints are sampled, and the samples are indexed by
all features that a goal compares.
"""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot
from kinseek.goal import Goal
from kinseek.kinds import Kind
from kinseek.robots.mechanism import Mechanism
from kinseek.robots.sampling import spread_inside
from kinseek.support.caching import LRUCache, WeakCache

from .evaluator import features

Array = NDArray[np.float64]

_DEAR = 8
"""A function that runs Python code for every row gets this many times fewer samples. Not examined further."""


MOST_FEATURES = 16
"""Number of kinds of goals and tools whose features are kept, the last ones used."""


class Samples:
    """Joint values spread over the limits, their poses, and their features for each kind of goal."""

    def __init__(self, box: Mechanism, count: int) -> None:
        """Evaluate the function.

        Raises:
            InvalidRobot: The mechanism cannot be assembled at any of the samples.
        """
        began = time.perf_counter()
        requested = min(count if box.cheap else max(count // _DEAR, 8), 64**box.dof)
        q = sample_joints(box, requested)
        poses = box.forward(q)
        there = ~np.isnan(poses).any(axis=(1, 2))
        if not there.any():
            raise InvalidRobot(f"fk of {box.name!r} gave NaN at all of {len(q)} samples inside the limits")
        self.q, self.poses = q[there], poses[there]
        place = self.poses[:, :3, 3]
        rms = float(np.sqrt(((place - place.mean(axis=0)) ** 2).sum(axis=1).mean()))
        self.length = rms if rms > 1e-9 else 1.0
        """Root mean square distance of the tip from its mean [m]: makes lengths and directions comparable."""
        self.samples = len(self.q)
        """Number of samples at which the mechanism can be assembled."""
        self.evaluations = len(q)
        """Poses evaluated."""
        self.memory = self.q.nbytes + self.poses.nbytes
        """Memory [bytes], without the features."""
        self.build_time = time.perf_counter() - began
        """Time for building [s]."""
        self._features: LRUCache[tuple[Kind, bytes | None], Array] = LRUCache(MOST_FEATURES)

    def nearest(self, goal: Goal, target: Array, count: int) -> NDArray[np.int64]:
        """Return the samples nearest to the features of a target, (m,), nearest first, (k,)."""
        columns = self._features.get(goal.prepared_as, lambda: self._columns(goal))
        return nearest_columns(columns, self._scaled(target[None], goal.form)[0], min(count, self.samples))

    def _columns(self, goal: Goal) -> Array:
        """Return features of all samples, (m, N): one feature after the other, as `nearest_columns` reads them."""
        points = features(self.poses, goal.tip, tuple(range(goal.columns)))
        return np.ascontiguousarray(self._scaled(points, goal.form).T)

    def _scaled(self, points: Array, kind: Kind) -> Array:
        """Scale features; two columns determine the third."""
        place, turn = points[:, :3] / self.length, points[:, 3:9]
        return np.concatenate([place, turn * np.sqrt(kind.column_weight)], axis=1)

    def __repr__(self) -> str:
        """Return size and cost."""
        return f"Samples({self.samples} samples, {self.memory / 2**20:.1f} MiB, built in {self.build_time * 1e3:.0f} ms)"


_samples: WeakCache[Mechanism, int, Samples] = WeakCache()


def samples_of(box: Mechanism, count: int) -> Samples:
    """Return the samples of a function: computed at the first call, dropped with the arm."""
    return _samples.of(box).get(count, lambda: Samples(box, count))


def sample_joints(box: Mechanism, count: int) -> Array:
    """Return joint values spread inside the limits, (count, n); none exceeds a limit by a rounding error."""
    return np.clip(spread_inside(box.lower, box.upper, box.turns, count), box.lower, box.upper)


def nearest_columns(points: Array, target: Array, count: int) -> NDArray[np.int64]:
    """Return the indices of the points nearest to a target, nearest first, (count,).

    All points are compared. With 16,384 samples this takes a fifth of a millisecond longer than a k-d tree, but needs no
    building; the walks that start there take some milliseconds.

    Args:
        points: One point in each column, (m, N).
        target: Features, (m,).
        count: At least 1 and at most N.
    """
    away = np.zeros(points.shape[1])
    for values, value in zip(points, target, strict=True):
        away += (values - value) ** 2
    near = np.argpartition(away, count - 1)[:count]
    return np.asarray(near[np.lexsort((near, away[near]))])
