"""How far points lie beyond the planes of a convex hull, and which points of many may be its corners."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .shapes import library

Array = NDArray[np.float64]

MOST_CORNERS = 18_000
"""Points that may be corners of one hull. For so many on two circles Qhull takes some seconds, and for twice as many four
times as long."""

_PRODUCTS = 2**24
"""Of points and planes that are computed at once."""

_DIRECTIONS = (32, 128, 512, 2048, 8192)
"""In so many directions the farthest points are looked for, until few points lie outside their hull."""

_HELPS = 0.9
"""More directions are not tried after a step that leaves more than this share of the points."""

_DEEP = 1e-9
"""A point that lies this much below all sides of a hull is inside, whatever rounding does, as a share of the hull's size."""


def farthest_beyond(points: Array, planes: Array) -> Array:
    """How far points (k, 3) lie beyond the planes (4, f) of a convex hull, negative inside, (k,).

    The memory does not grow with the number of planes.
    """
    count = max(_PRODUCTS // len(points), 1)
    most = np.full(len(points), -np.inf)
    for first in range(0, planes.shape[1], count):
        some = planes[:, first : first + count]
        np.maximum(most, (points @ some[:3] + some[3]).max(axis=1), out=most)
    return most


def outermost(points: Array, most: int = MOST_CORNERS) -> Array:
    """Leave points out that lie inside the hull of others, (k, 3) -> (l, 3); of at most so many points none.

    The hull stays the same. There may be more than `most` points left.
    """
    for count in _DIRECTIONS:
        if len(points) <= most:
            break
        before, points = len(points), points[~_inside_farthest(points, count)]
        if len(points) > _HELPS * before:
            break
    return points


def _inside_farthest(points: Array, count: int) -> NDArray[np.bool_]:
    """Which points lie inside the hull of those that are farthest in some directions?"""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    scaled = (points - low) / np.where(size > 0, size, 1.0)
    farthest = np.unique([np.argmax(scaled @ way) for way in _directions(count)])
    spatial = library("scipy.spatial")
    try:
        hull = spatial.ConvexHull(scaled[farthest])
    except spatial.QhullError:  # They are too few, or lie in a plane.
        return np.zeros(len(points), dtype=np.bool_)
    return farthest_beyond(scaled, np.ascontiguousarray(hull.equations.T)) < -_DEEP


def _directions(count: int) -> Array:
    """Unit vectors that are evenly spread, (count, 3): a Fibonacci lattice (Swinbank and Purser 2006)."""
    numbers = np.arange(count) + 0.5
    z, angles = 1 - 2 * numbers / count, np.pi * (1 + np.sqrt(5)) * numbers
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(angles), around * np.sin(angles), z], axis=-1)
