"""The axes of an arm as lines in space, and points where lines intersect."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.support.transforms import rotations, square


class Axes(NamedTuple):
    """An arm as a product of exponentials of its axes, ``T = E₁(q₁) … Eₙ(qₙ) T₀`` (Brockett 1984)."""

    direction: Array
    """Direction of each axis at q = 0, unit vectors, (n, 3); the rotation follows the right-hand rule."""
    point: Array
    """A point on each axis, (n, 3), [m]."""
    slides: NDArray[np.bool_]
    """Whether the joint is prismatic, (n,)."""
    home: Array
    """T₀, the pose of the tip at q = 0, (4, 4), lengths in [m]."""

    def backwards(self) -> Axes:
        """Return the arm from its tip to its base; it produces the inverse transforms."""
        return Axes(-self.direction[::-1], self.point[::-1], self.slides[::-1], self.home)

    def distal_to(self, joints: int) -> Axes:
        """Return the part of the arm distal to its first `joints` joints."""
        return Axes(self.direction[joints:], self.point[joints:], self.slides[joints:], self.home)


def axes_of(arrays: ChainArrays) -> Axes | None:
    """Return the axes of an arm whose joints each have a variable of their own, with factor 1; None for any other arm."""
    joints = len(arrays.leader)
    plain = (arrays.leader == np.arange(joints)).all() and len(arrays.lower) == joints
    if not plain or (np.abs(arrays.multiplier) != 1.0).any():
        return None
    frame, directions, points = np.eye(4), [], []
    for k in range(joints):
        frame = frame @ square(arrays.fixed[k])
        directions.append(frame[:3, 2] * arrays.multiplier[k])
        points.append(frame[:3, 3].copy())
        slides = arrays.prismatic[k]
        angle, along = (0.0, arrays.offset[k]) if slides else (arrays.offset[k], 0.0)
        cosine, sine = np.cos(angle), np.sin(angle)
        frame = frame @ np.array(
            [[cosine, -sine, 0, 0], [sine, cosine, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]]
        )
    home = frame @ square(arrays.fixed[joints])
    return Axes(np.array(directions), np.array(points), arrays.prismatic.astype(bool), home)


def meeting(direction: Array, point: Array) -> tuple[Array, float]:
    """Return the point nearest to some lines, (3,), and its largest distance from one of them [m]; lines as (k, 3) each.

    Parallel lines do not intersect: the distance is infinite.
    """
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    # The sum of the projections is singular exactly if all lines are parallel.
    values = np.linalg.svd(across.sum(axis=0), compute_uv=False)
    if values[-1] < 1e-6:
        return point[0], np.inf
    # The squared distances add up to the least where Σ P_k (x - p_k) = 0, with the projection P_k across line k. Around
    # the mean of the points the numbers are small.
    centre = point.mean(axis=0)
    offset = np.einsum("kij,kj->i", across, point - centre)
    x = centre + np.linalg.solve(across.sum(axis=0), offset)
    return x, float(np.linalg.norm(np.einsum("kij,kj->ki", across, x - point), axis=1).max())


def slant(direction: Array) -> float:
    """Return the largest angle between the first of some axes, (k, 3), and the others, regardless of their sign [rad]."""
    sines = np.linalg.norm(np.cross(direction[0], direction[1:]), axis=1)
    return float(np.arcsin(np.minimum(sines, 1.0)).max())


def lean(before: Array, after: Array) -> tuple[float, float, float]:
    """Return a, b, c of the cosine a cos v + b sin v + c of the angle between two axes, v being the joint between them.

    Args:
        before: Transform from the first axis to the joint between, (3, 4).
        after: Transform from there to the last axis, (3, 4).
    """
    x, y, z = after[:3, 2]
    a, b = before[2, 0] * x + before[2, 1] * y, before[2, 1] * x - before[2, 0] * y
    return float(a), float(b), float(before[2, 2] * z)


def nearest_on(direction: Array, point: Array, x: Array) -> Array:
    """Return the point of each line, (k, 3), that is nearest to x, (3,)."""
    return np.asarray(point + direction * np.einsum("kj,kj->k", direction, x - point)[:, None])


BENT = 0.1
"""Sine of the least angle between axes that must not be parallel. Not examined further."""


def foot(axes: Axes, on: int, near: int) -> Array | None:
    """Return the point on one axis nearest to another one, by index, (3,); None if they are nearly parallel."""
    a, b = axes.direction[on], axes.direction[near]
    normal = np.cross(a, b)
    square = float(normal @ normal)
    if square < BENT**2:
        return None
    between = axes.point[near] - axes.point[on]
    return np.asarray(axes.point[on] + a * (np.cross(between, b) @ normal) / square)


class Motions(NamedTuple):
    """Displacement of one link from where it is at q = 0, at k configurations."""

    R: Array
    """(k, 3, 3)"""
    p: Array
    """(k, 3), [m]"""

    def turned(self, direction: Array) -> Array:
        """Return a direction of the link, (3,) at q = 0, at each configuration, (k, 3)."""
        return self.R @ direction

    def moved(self, point: Array) -> Array:
        """Return a point of the link, (3,) at q = 0, at each configuration, (k, 3) [m]."""
        return self.R @ point + self.p


def displaced(axes: Axes, q: Array) -> list[Motions]:
    """Return the displacements of the links distal to each of the first revolute joints, for q, (k, number of these)."""
    R, p = np.broadcast_to(np.eye(3), (len(q), 3, 3)), np.zeros((len(q), 3))
    found = []
    for angles, h, point in zip(q.T, axes.direction, axes.point, strict=False):
        turn = rotations(angles[:, None] * h)
        p = p + (R @ (point - turn @ point)[:, :, None])[:, :, 0]
        R = R @ turn
        found.append(Motions(R, p))
    return found
