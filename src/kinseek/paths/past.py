"""The last poses of a tracker, extrapolated: angular velocity, speed and curvature of the path stay constant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.poses import as_pose
from kinseek.support.transforms import rotation_vectors, rotations
from kinseek.support.validation import as_integer, as_number

Array = NDArray[np.float64]

SPAN, MOST_PERIODS_BACK = 0.2, 200
"""Age of the oldest pose used for extrapolation [s], and the largest number of periods this may be. Not examined
further."""

TIMES = (1e-9, 1e9)
"""Bounds of the period and of times to look ahead [s]."""

TRUSTED = 5.0
"""How far to look ahead, in units of the time for which poses are known: noise of 0.1 mm on lines and circles gave thrice
as many false alarms without this bound (`python -m benchmarks.servoing`)."""

CORNER = 1.0
"""If the direction of motion changes by more than this between two chords, the extrapolation is a straight line [rad]."""


class PastPoses:
    """The poses of the last periods."""

    def __init__(self, period: float) -> None:
        """Start without poses; `period` is the time between two of them [s]."""
        self.period = period
        self.count = 0
        """Number of poses that were stored, of which the last ones are kept."""
        self._apart = min(max(1, round(SPAN / period)), MOST_PERIODS_BACK)
        self._poses = np.zeros((2 * self._apart + 1, 4, 4))

    @property
    def capacity(self) -> int:
        """The number of poses that are kept at most."""
        return len(self._poses)

    def store(self, T: Array) -> None:
        """Store the pose of a period, (4, 4), in the ring of the last poses."""
        self._poses[self.count % len(self._poses)] = T
        self.count += 1

    def pose(self, back: int = 0) -> Array:
        """Return the pose stored `back` periods ago."""
        return np.array(self._poses[(self.count - 1 - back) % len(self._poses)])

    def coming(self, seconds: float, looks: int, longer: float = 0.0) -> tuple[Array, int, int]:
        """Return poses to come and some for `longer`, (k, 4, 4), how many periods lie between them, and how many are near.

        The near ones cover `seconds` with `looks` poses, but at most `TRUSTED` times what is known.
        """
        if self.count < 2:
            raise InvalidProblem("looking ahead needs two poses: call step(T) twice first")
        looks = as_integer("looks", looks, 1, error=InvalidProblem)
        seconds = as_number("seconds", seconds, *TIMES, InvalidProblem)
        at_once = max(1, round(seconds / looks / self.period))
        known = min(self.count, len(self._poses))
        ahead = min(seconds, TRUSTED * (known - 1) * self.period)
        near, count = (int(np.ceil(each / self.period / at_once - 1e-9)) for each in (ahead, ahead + longer))
        poses = self._poses[np.arange(max(0, self.count - len(self._poses)), self.count) % len(self._poses)]
        return extrapolated(poses, np.arange(1.0, count + 1.0) * at_once), at_once, near


def extrapolated(poses: Array, times: Array) -> Array:
    """Extrapolate poses that are equally spaced in time.

    The hand keeps its last angular velocity about its own axis. Its linear velocity keeps its size and turns at a constant
    rate. So a line continues as a line and a circle as the same circle, whether or not the hand turns with it. Means over
    several poses reduce the noise: the positions of the last, the middle and the first third, and a line through the
    rotation vectors of the later half. The mean of equally spaced points of an arc lies on its bisector, nearer to the
    centre by the Dirichlet kernel ``sin(k α / 2) / k sin(α / 2)`` of the angle α between two points.

    Args:
        poses: The last poses, (k, 4, 4), k ≥ 2.
        times: Times of the requested poses after the last one, (m,), in units of the time between two poses.

    Returns:
        Poses, (m, 4, 4).
    """
    found = np.empty((len(times), 4, 4))
    found[:, 3] = 0.0, 0.0, 0.0, 1.0
    found[:, :3, 3] = _positions(poses[:, :3, 3], times)
    found[:, :3, :3] = _rotations(poses[(len(poses) - 1) // 2 :, :3, :3], times)
    return as_pose(found)


def _positions(points: Array, times: Array) -> Array:
    """Extrapolate positions, (k, 3) -> (m, 3)."""
    count = max(1, len(points) // 3)
    apart = max(1, (len(points) - count) // 2)
    ends = len(points) - apart * np.arange(2 if len(points) > 2 * apart else 1, -1, -1)
    *earlier, middle, now = (points[end - count : end].mean(axis=0) for end in ends)
    chord, before = now - middle, middle - earlier[0] if earlier else np.zeros(3)
    # From the middle of the last third, in units of the time between two thirds.
    since = (times + (count - 1) / 2) / apart
    normal = np.cross(before, chord)
    sine = float(np.linalg.norm(normal))
    bend = float(np.arctan2(sine, before @ chord))
    if not 1e-9 < bend < CORNER:
        return np.asarray(now + since[:, None] * chord)
    axis, angle = normal / sine, bend / apart
    # From the last chord to the radius of the arc of means, and to that of the points.
    radius = _turned(axis, bend / 2, np.cross(chord, axis)) / (2.0 * np.sin(bend / 2))
    centre = now - radius
    radius = radius * (count * np.sin(angle / 2) / np.sin(count * angle / 2))
    turn = (bend * since)[:, None]
    return np.asarray(centre + np.cos(turn) * radius + np.sin(turn) * np.cross(axis, radius))


def _rotations(R: Array, times: Array) -> Array:
    """Extrapolate rotations, (k, 3, 3) -> (m, 3, 3): a line through rotation vectors from the one in the middle."""
    middle, at = R[len(R) // 2], np.arange(1.0 - len(R), 1.0)
    vectors = rotation_vectors(np.asarray(middle.T @ R))
    mean, from_mean = vectors.mean(axis=0), at - at.mean()
    rate = from_mean @ vectors / (from_mean @ from_mean)
    return np.asarray(middle @ rotations(mean + (times - at.mean())[:, None] * rate))


def _turned(axis: Array, angle: float, vector: Array) -> Array:
    """Rotate a vector about an axis at right angles to it."""
    return np.asarray(np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector))
