"""The last poses of a tracker, and where they lead: the hand keeps its rates of rotation and of curvature."""

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

    def store(self, T: Array) -> None:
        """Store the pose of a period, (4, 4), in the ring of the last poses."""
        self._poses[self.count % len(self._poses)] = T
        self.count += 1

    def pose(self, back: int = 0) -> Array:
        """Return the pose stored `back` periods ago."""
        return np.array(self._poses[(self.count - 1 - back) % len(self._poses)])

    def coming(self, seconds: float, looks: int, longer: float = 0.0) -> tuple[Array, int]:
        """Return `looks` poses to come and some for `longer`, (k, 4, 4), and how many periods lie between them."""
        if self.count < 2:
            raise InvalidProblem("looking ahead needs two poses: call step(T) twice first")
        looks = as_integer("looks", looks, 1, error=InvalidProblem)
        seconds = as_number("seconds", seconds, *TIMES, InvalidProblem)
        at_once = max(1, round(seconds / looks / self.period))
        count = int(np.ceil((seconds + longer) / self.period / at_once - 1e-9))
        # After only a few steps, the three poses of the extrapolation are closer together.
        apart = max(1, min(self._apart, (self.count - 1) // 2))
        now, middle = self.pose(), self.pose(apart)
        before = self.pose(2 * apart) if self.count > 2 * apart else middle
        times = np.arange(1.0, count + 1.0) * (at_once / apart)
        return extrapolated(before, middle, now, times), at_once


def extrapolated(before: Array, middle: Array, now: Array, times: Array) -> Array:
    """Extrapolate three poses that are equally spaced in time.

    The hand keeps its last angular velocity about its own axis. Its linear velocity keeps its size and turns at the rate of
    the last two chords. So a line continues as a line and a circle as the same circle, whether or not the hand turns with
    it.

    Args:
        before: Pose, (4, 4); the same as `middle` if nothing is known of it.
        middle: Pose, (4, 4).
        now: Pose, (4, 4).
        times: Times of the requested poses, (k,), in units of the time between two of the three poses.

    Returns:
        Poses, (k, 4, 4).
    """
    chord, earlier = now[:3, 3] - middle[:3, 3], middle[:3, 3] - before[:3, 3]
    normal = np.cross(earlier, chord)
    sine = float(np.linalg.norm(normal))
    bend = float(np.arctan2(sine, earlier @ chord))
    poses = np.empty((len(times), 4, 4))
    poses[:, 3] = 0.0, 0.0, 0.0, 1.0
    if 1e-9 < bend < CORNER:
        axis = normal / sine
        # Convert the last chord into the velocity at its end: turn it by half the bend, and lengthen it to the arc.
        velocity = _turned(axis, bend / 2, chord) * (bend / 2) / np.sin(bend / 2)
        angle = (bend * times)[:, None]
        way = (np.sin(angle) * velocity + (1.0 - np.cos(angle)) * np.cross(axis, velocity)) / bend
    else:
        way = times[:, None] * chord
    poses[:, :3, 3] = now[:3, 3] + way
    (rotation_vector,) = rotation_vectors((middle[:3, :3].T @ now[:3, :3])[None])
    poses[:, :3, :3] = now[:3, :3] @ rotations(times[:, None] * rotation_vector)
    return as_pose(poses)


def _turned(axis: Array, angle: float, vector: Array) -> Array:
    """Rotate a vector about an axis at right angles to it."""
    return np.asarray(np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector))
