"""Deviation of the hand from straight motion between two poses, while the joints move linearly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.problem import Problem
from kinseek.support.transforms import rotation_vectors, rotations

Array = NDArray[np.float64]

SHARES = (0.25, 0.5, 0.75)
"""Fractions of a step at which the pose of the hand is computed. Not examined further."""

AT_ONCE = 4096
"""Steps that are processed together, so that memory does not grow with the length of the path."""


def between(q: Array, breaks: NDArray[np.int64], shares: tuple[float, ...]) -> Array:
    """Interpolate joint values between consecutive poses, without the breaks, (m, len(shares), n)."""
    whole = np.delete(np.arange(len(q) - 1), breaks[breaks < len(q) - 1])
    a, b = q[whole], q[whole + 1]
    part = np.array(shares)[None, :, None]
    return np.asarray(a[:, None] + part * (b - a)[:, None])


def deviation_between(problem: Problem, q: Array, breaks: NDArray[np.int64]) -> tuple[float, float]:
    """Return the largest deviation from straight motion between poses: distance [m] and angle [rad]."""
    farthest = np.zeros(2)
    for first in range(0, len(q) - 1, AT_ONCE):
        rows = q[first : first + AT_ONCE + 1]
        inside = breaks[(breaks >= first) & (breaks < first + len(rows) - 1)] - first
        farthest = np.maximum(farthest, _deviation(problem, rows, inside))
    return float(farthest[0]), float(farthest[1])


def _deviation(problem: Problem, q: Array, breaks: NDArray[np.int64]) -> tuple[float, float]:
    middle = between(q, breaks, SHARES)
    if not len(middle):
        return 0.0, 0.0
    whole = np.delete(np.arange(len(q) - 1), breaks[breaks < len(q) - 1])
    poses = forward_many(problem.arrays, q)
    a, b = poses[whole], poses[whole + 1]
    reached = forward_many(problem.arrays, np.ascontiguousarray(middle.reshape(-1, q.shape[1])))
    reached = reached.reshape(*middle.shape[:2], 4, 4)
    part = np.array(SHARES)
    straight = a[:, None, :3, 3] + part[None, :, None] * (b - a)[:, None, :3, 3]
    distance = np.linalg.norm(reached[..., :3, 3] - straight, axis=-1)
    vector = rotation_vectors(np.swapaxes(a[:, :3, :3], 1, 2) @ b[:, :3, :3])
    turned = rotations((part[None, :, None] * vector[:, None]).reshape(-1, 3)).reshape(
        *middle.shape[:2], 3, 3
    )
    rotation = a[:, None, :3, :3] @ turned
    off = np.swapaxes(rotation, -1, -2) @ reached[..., :3, :3]
    turn = np.linalg.norm(rotation_vectors(off.reshape(-1, 3, 3)), axis=-1)
    return float(distance.max()), float(turn.max())


def apart(one: Array, other: Array) -> tuple[Array, Array]:
    """Return distances [m] and angles [rad] between poses, (k, 4, 4) each -> (k,) and (k,)."""
    turn = rotation_vectors(np.swapaxes(one[:, :3, :3], 1, 2) @ other[:, :3, :3])
    return np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1), np.linalg.norm(turn, axis=1)
