"""Rotations and rigid transforms as matrices; `poses` validates user input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY = 1e-300
"""Replaces a length of 0 in divisions; no real length is as short."""


def rotation(axis: Array, angle: float) -> Array:
    """Rotation by `angle` [rad] about the unit vector `axis`, (3, 3), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross))


def rotations(vectors: Array) -> Array:
    """Return rotation matrices of rotation vectors [rad], (..., 3) -> (..., 3, 3), by Rodrigues' formula."""
    angles = np.linalg.norm(vectors, axis=-1)
    x, y, z = np.moveaxis(vectors / np.maximum(angles, _TINY)[..., None], -1, 0)
    zero = np.zeros_like(x)
    cross = _matrix([zero, -z, y], [z, zero, -x], [-y, x, zero])
    sine, cosine = np.sin(angles)[..., None, None], np.cos(angles)[..., None, None]
    return np.asarray(np.eye(3) + sine * cross + (1.0 - cosine) * (cross @ cross))


def rotation_vectors(R: Array) -> Array:
    """Rotation vectors [rad] of rotations by less than half a turn, (k, 3, 3) -> (k, 3)."""
    twice = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    sine, cosine = np.linalg.norm(twice, axis=1) / 2, (np.trace(R, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    return np.asarray(twice * (angle / np.maximum(2 * sine, 1e-300))[:, None])


def from_rpy(angles: Array) -> Array:
    """Rotation matrices of roll, pitch and yaw [rad] about the fixed axes x, y, z in this order, (..., 3) -> (..., 3, 3)."""
    (sr, sp, sy), (cr, cp, cy) = (np.moveaxis(of(angles), -1, 0) for of in (np.sin, np.cos))
    return _matrix(
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    )


def from_quaternion(wxyz: Array) -> Array:
    """Rotation matrices of quaternions with their real part first and of any length but 0, (..., 4) -> (..., 3, 3)."""
    scaled = wxyz / np.abs(wxyz).max(axis=-1, keepdims=True)  # Squares of a length might overflow.
    w, x, y, z = np.moveaxis(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True), -1, 0)
    return _matrix(
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    )


def quaternion(turn: Array) -> Array:
    """Unit quaternions w, x, y, z of rotations, (..., 3, 3) -> (..., 4); the first nonzero number is positive.

    Shepperd 1978: the products of any two numbers of the quaternion are sums of entries of the rotation. Those with the
    largest number give all four without subtracting nearly equal numbers.
    """
    (a, b, c), (d, e, f), (g, h, i) = np.moveaxis(turn, (-2, -1), (0, 1))
    products = _matrix(  # 4 q qᵀ
        [1 + a + e + i, h - f, c - g, d - b],
        [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h],
        [d - b, c + g, f + h, 1 - a - e + i],
    )
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    first = np.take_along_axis(row, np.argmax(row != 0.0, axis=-1)[..., None], axis=-1)
    return np.asarray(np.where(first < 0.0, -row, row) + 0.0)  # Adding zero turns -0 into 0.


def angles_between(one: Array, other: Array) -> Array:
    """Angles between unit vectors [rad], (k, 3) each -> (k,); precise near 0 and near π, too."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(one, other), axis=-1), (one * other).sum(axis=-1)))


def from_axes(exact: Array, other: Array, i: int, j: int) -> Array:
    """Rotation matrices whose column i is `exact` and whose column j is nearest to `other`, (k, 3) each -> (k, 3, 3).

    Gram-Schmidt, applied twice: if both unit vectors are nearly parallel, rounding leaves the first result oblique.
    """
    for _ in range(2):
        other = other - (other * exact).sum(axis=-1, keepdims=True) * exact
        other = other / np.linalg.norm(other, axis=-1, keepdims=True)
    result = np.empty((len(exact), 3, 3))
    result[:, :, i], result[:, :, j] = exact, other
    right_handed = (j - i) % 3 == 1  # Then the third axis is the first of both cross the second.
    result[:, :, 3 - i - j] = np.cross(exact, other) if right_handed else np.cross(other, exact)
    return result


def rotation_onto(start: Array, end: Array) -> Array:
    """Return a rotation that maps the unit vector `start` to `end`, (3, 3)."""
    frames = []
    for axis in (start, end):
        other = np.eye(3)[np.argmin(np.abs(axis))]
        second = _cross(axis, other)
        second /= np.linalg.norm(second)
        frames.append(np.array([axis, second, _cross(axis, second)]).T)
    return np.asarray(frames[1] @ frames[0].T)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, (3,); `np.cross` takes twenty times as long."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def transform(turn: Array, translation: Sequence[float] | Array) -> Array:
    """Combine a rotation, (3, 3), and a translation [m], (3,), into a transform, (4, 4)."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    pose[:3, 3] = translation
    return pose


def inverse(A: Array) -> Array:
    """Inverse of a rigid transform, (3, 4) or (4, 4), as (3, 4)."""
    turn = A[:3, :3].T
    return np.hstack([turn, -turn @ A[:3, 3:]])


def square(A: Array) -> Array:
    """Append the last row to a transform, (3, 4) -> (4, 4)."""
    whole = np.zeros((4, 4))
    whole[:3], whole[3, 3] = A, 1.0
    return whole


def _matrix(*rows: Sequence[Array]) -> Array:
    """Assemble matrices from rows of numbers, each (...), as (..., rows, columns)."""
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
