"""Extrapolate poses: the hand keeps its rates of rotation and of curvature."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.poses import as_pose
from kinseek.support.transforms import rotation_vectors, rotations

Array = NDArray[np.float64]

CORNER = 1.0
"""If the direction of motion changes by more than this between two chords, the extrapolation is a straight line [rad]."""


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
