"""Poses to come, from those that came: the hand goes on turning, and its way goes on bending, as it did."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.poses import as_pose
from kinseek.transforms import rotations

Array = NDArray[np.float64]

CORNER = 1.0
"""A way that bends by more than this between two looks back has a corner, and goes straight on from there [rad]."""


def poses_ahead(before: Array, middle: Array, now: Array, times: Array) -> Array:
    """Go on from three poses that are equally far apart in time.

    The hand turns on at its last rate about its own axis. Its velocity keeps its size and turns on at the rate of the last
    two chords, so that a line goes on as a line, and a circle as that circle, whether the hand turns with it or not.

    Args:
        before: (4, 4); the same as `middle` where nothing is known of it.
        middle: (4, 4)
        now: (4, 4)
        times: When the poses are wanted, (k,), the time from one of the three to the next being 1.

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
        # From the chord to the velocity at its end: half the bend on, and the arc is longer than its chord.
        velocity = _turned(axis, bend / 2, chord) * (bend / 2) / np.sin(bend / 2)
        angle = (bend * times)[:, None]
        way = (np.sin(angle) * velocity + (1.0 - np.cos(angle)) * np.cross(axis, velocity)) / bend
    else:
        way = times[:, None] * chord
    poses[:, :3, 3] = now[:3, 3] + way
    spin = _vector(middle[:3, :3].T @ now[:3, :3])
    poses[:, :3, :3] = now[:3, :3] @ rotations(times[:, None] * spin)
    return as_pose(poses)


def _turned(axis: Array, angle: float, vector: Array) -> Array:
    """A vector at right angles to an axis, turned about it."""
    return np.asarray(np.cos(angle) * vector + np.sin(angle) * np.cross(axis, vector))


def _vector(turn: Array) -> Array:
    """Rotation vector of a rotation by less than half a turn, (3,)."""
    twice = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = float(np.linalg.norm(twice))
    return np.asarray(twice * (np.arctan2(sine, np.trace(turn) - 1.0) / max(sine, 1e-300)))
