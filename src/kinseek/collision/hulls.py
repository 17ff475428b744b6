"""Distances of points beyond the planes of a convex hull, and selection of points that may be its corners."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene
from kinseek.support.interrupts import uninterrupted

from .geometry import library

Array = NDArray[np.float64]

MOST_CORNERS = 18_000
"""Maximum number of candidate corners of one hull: on a sphere coal takes about 0.3 s for them, during which nothing
interrupts it."""

MOST_ON_SIDE = 1_500
"""Maximum number of corners of one flat side of a hull. The time grows with the square of their number: for two circles of
1,000 coal takes 0.1 s, of 2,000 0.6 s, and of 4,000 2 s."""

_PRODUCTS = 2**24
"""Maximum number of point-plane products computed at once."""

_DIRECTIONS = (32, 128, 512, 2048, 8192)
"""Numbers of directions in which the farthest points are searched, until few points lie outside their hull. Not examined
further."""

_HELPS = 0.9
"""No more directions are tried after a step that keeps more than this fraction of the points. Not examined further."""

_DEEP = 1e-9
"""Depth below all sides of a hull beyond which a point is inside despite rounding, relative to the hull's size."""


def convex_hull(vertices: Array, name: str) -> Any:
    """Return the convex hull of points that span all directions, (k, 3), as coal takes it.

    Raises:
        InvalidScene: It has too many corners, or cannot be made; the error names the shape.
    """
    coal = library("coal")
    outer = outermost(np.unique(vertices, axis=0))
    if len(outer) > MOST_CORNERS:
        raise InvalidScene(
            f"{name}: {len(outer):,} of its points may be corners of its convex hull, expected at most "
            f"{MOST_CORNERS:,}: simplify the mesh, so that it has fewer vertices where it is curved"
        )
    spatial = library("scipy.spatial")
    try:  # Where Qhull fails, coal, which uses it too, may end the process. And coal is not interrupted.
        hull = uninterrupted(lambda: spatial.ConvexHull(outer))
    except spatial.QhullError as error:
        raise InvalidScene(
            f"{name}: Qhull cannot make its convex hull: {str(error).strip().partition(chr(10))[0]}"
        ) from None
    if (most := corners_of_sides(hull.equations)) > MOST_ON_SIDE:
        raise InvalidScene(
            f"{name}: a flat side of its convex hull has {most:,} corners, expected at most {MOST_ON_SIDE:,}: "
            f"simplify the mesh, so that it has fewer vertices where it is round"
        )
    points = coal.StdVec_Vec3s()
    for vertex in outer:
        points.append(vertex)
    try:  # Flat sides stay whole: if cut into triangles, a corner may have more neighbours than coal accepts.
        return coal.ConvexBase.convexHull(points, False, "")
    except RuntimeError as error:
        why = str(error).rpartition("message:")[2].strip()
        raise InvalidScene(f"{name}: coal cannot make its convex hull: {why}") from error


def sides_of_hull(corners: Array) -> NDArray[np.int64]:
    """Return the triangles of a convex hull, seen from outside, as indices of its corners, (k, 3) -> (f, 3)."""
    spatial = library("scipy.spatial")
    # Joggled, since Qhull then fails for no corners; a picture does not show it.
    hull = uninterrupted(lambda: spatial.ConvexHull(corners, qhull_options="QJ"))
    a, b, c = np.moveaxis(corners[hull.simplices], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    return np.asarray(np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices), dtype=np.int64)


def corners_of_sides(planes: Array) -> int:
    """Return the largest number of corners of a flat side of a hull.

    Args:
        planes: Planes of the triangles of all sides, (f, 4), as Qhull returns them: those of one side are equal.
    """
    order = np.lexsort(planes.T)
    begins = np.flatnonzero(np.r_[True, (planes[order][1:] != planes[order][:-1]).any(axis=1), True])
    return int(np.diff(begins).max()) + 2


def farthest_beyond(points: Array, planes: Array) -> Array:
    """Return how far points (k, 3) lie beyond the planes (4, f) of a convex hull, negative inside, (k,).

    The memory does not grow with the number of planes.
    """
    count = max(_PRODUCTS // len(points), 1)
    most = np.full(len(points), -np.inf)
    for first in range(0, planes.shape[1], count):
        some = planes[:, first : first + count]
        np.maximum(most, (points @ some[:3] + some[3]).max(axis=1), out=most)
    return most


def outermost(points: Array, most: int = MOST_CORNERS) -> Array:
    """Remove points that lie inside the hull of the others, (k, 3) -> (l, 3); at most `most` points are returned unchanged.

    The hull stays the same. More than `most` points may remain.
    """
    for count in _DIRECTIONS:
        if len(points) <= most:
            break
        before, points = len(points), points[~_inside_farthest(points, count)]
        if len(points) > _HELPS * before:
            break
    return points


def _inside_farthest(points: Array, count: int) -> NDArray[np.bool_]:
    """Return which points lie inside the hull of the farthest points in `count` directions."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    scaled = (points - low) / np.where(size > 0, size, 1.0)
    farthest = np.unique([np.argmax(scaled @ way) for way in directions(count)])
    spatial = library("scipy.spatial")
    try:
        hull = spatial.ConvexHull(scaled[farthest])
    except spatial.QhullError:  # Too few points, or all in a plane.
        return np.zeros(len(points), dtype=np.bool_)
    return farthest_beyond(scaled, np.ascontiguousarray(hull.equations.T)) < -_DEEP


def directions(count: int) -> Array:
    """Return evenly spread unit vectors, (count, 3): a Fibonacci lattice (Swinbank and Purser 2006)."""
    numbers = np.arange(count) + 0.5
    z, angles = 1 - 2 * numbers / count, np.pi * (1 + np.sqrt(5)) * numbers
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(angles), around * np.sin(angles), z], axis=-1)
