"""Inverse kinematics by twists and matrix exponentials, in NumPy: what the paper's Sec. 5 compares its search with.

The product of exponentials (Brockett 1984) and Newton steps along the spatial twist that is still missing, damped
(Levenberg 1944), from random starts until one converges. Written as one would write it down, not to be fast.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .plain import PlainArm, pose_of

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""Of the missing twist, in [m] and [rad]."""
_MOST_STEPS, _MOST_STARTS = 60, 20


def home_of(arm: PlainArm) -> tuple[Array, Array]:
    """The twists of the joints at zero, (n, 6), moment before direction, and the pose of the tip there, (4, 4).

    Raises:
        ValueError: A joint slides.
    """
    axes = {"rx": 0, "ry": 1, "rz": 2}
    origin, twists = np.zeros(3), []
    for link in arm.links:
        if link.kind not in axes:
            raise ValueError(f"every joint must turn, got {link.kind!r}")
        origin = origin + link.offset
        axis = np.eye(3)[axes[link.kind]]
        twists.append(np.concatenate([-np.cross(axis, origin), axis]))
    return np.array(twists), matrix_of(pose_of(arm, [0.0] * len(arm.links)))


def matrix_of(frame: tuple[float, ...]) -> Array:
    """A frame of twelve numbers as a pose, (4, 4)."""
    pose = np.eye(4)
    pose[:3, 3], pose[:3, :3] = frame[:3], np.reshape(frame[3:], (3, 3)).T
    return pose


def hat(axis: Array) -> Array:
    """The matrix of a cross product, (3, 3)."""
    return np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])


def exponential(twist: Array, angle: float) -> Array:
    """The motion along a twist of unit direction, (4, 4)."""
    moment, axis = twist[:3], twist[3:]
    cross = hat(axis)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    motion = np.eye(4)
    motion[:3, :3] = turn
    motion[:3, 3] = (np.eye(3) - turn) @ np.cross(axis, moment)
    return motion


def missing(pose: Array, goal: Array) -> Array:
    """The small twist at the tip, in the base's axes, from one pose to another, (6,)."""
    turn = goal[:3, :3] @ pose[:3, :3].T
    vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine = np.linalg.norm(vector) / 2
    angle = np.arctan2(sine, (np.trace(turn) - 1) / 2)
    scale = 0.5 if sine < 1e-9 else angle / (2 * sine)
    return np.concatenate([goal[:3, 3] - pose[:3, 3], scale * vector])


def solve(arm: PlainArm, goal: Array, rng: np.random.Generator) -> Array | None:
    """Joint values for a pose, (n,) [rad], or None if no start comes home."""
    twists, home = home_of(arm)
    for _ in range(_MOST_STARTS):
        q = rng.uniform(-np.pi, np.pi, len(twists))
        for _ in range(_MOST_STEPS):
            motion, columns = np.eye(4), []
            for twist, angle in zip(twists, q, strict=True):
                axis = motion[:3, :3] @ twist[3:]
                moment = motion[:3, :3] @ twist[:3] + np.cross(motion[:3, 3], axis)
                columns.append(np.concatenate([moment, axis]))
                motion = motion @ exponential(twist, angle)
            pose = motion @ home
            wanted = missing(pose, goal)
            if np.abs(wanted).max() < TOLERANCE:
                return q
            jacobian = np.array(columns).T
            jacobian[:3] += np.cross(jacobian[3:].T, pose[:3, 3]).T
            damped = jacobian @ jacobian.T + 1e-6 * np.eye(6)
            q = q + np.clip(jacobian.T @ np.linalg.solve(damped, wanted), -1, 1)
    return None
