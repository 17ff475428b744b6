"""Rotations and rigid transforms as matrices; what is given as one is checked in `poses`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY = 1e-300
"""Stands for a length of 0 where it is divided by: no length that anybody gives is shorter."""


def rotation(axis: Array, angle: float) -> Array:
    """Rotation by `angle` [rad] about the unit vector `axis`, (3, 3), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def rotations(vectors: Array) -> Array:
    """Rotation matrices of rotation vectors [rad], (m, 3) -> (m, 3, 3), by Rodrigues' formula."""
    angles = np.linalg.norm(vectors, axis=1)
    x, y, z = (vectors / np.maximum(angles, _TINY)[:, None]).T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, cosine = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))


def rotation_onto(start: Array, end: Array) -> Array:
    """A rotation that takes the unit vector `start` onto `end`, (3, 3)."""
    frames = []
    for axis in (start, end):
        other = np.eye(3)[np.argmin(np.abs(axis))]
        second = np.cross(axis, other)
        second /= np.linalg.norm(second)
        frames.append(np.stack([axis, second, np.cross(axis, second)], axis=1))
    return np.asarray(frames[1] @ frames[0].T)


def transform(turn: Array, translation: Sequence[float] | Array) -> Array:
    """Put a rotation, (3, 3), and a translation [m], (3,), together, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = translation
    return pose


def inverse(A: Array) -> Array:
    """Inverse of a rigid transform, (3, 4) or (4, 4), as (3, 4)."""
    turn = A[:3, :3].T
    return np.hstack([turn, -turn @ A[:3, 3:]])


def square(A: Array) -> Array:
    """A transform without its last row, (3, 4), with it, (4, 4)."""
    whole = np.zeros((4, 4))
    whole[:3], whole[3, 3] = A, 1.0
    return whole
