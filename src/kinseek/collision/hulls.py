"""Distances of points beyond the planes of a convex hull, and selection of points that may be its corners."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene
from kinseek.support.interrupts import uninterrupted

from .geometry import library

Array = NDArray[np.float64]

LEAST_APART = 1e-11
"""Distance of corners, relative to their largest coordinate, up to which one of them is left out. Hulls of corners 1e-15 to
1e-13 apart are folded by rounding, and coal, which walks along the edges of a hull, does not find the farthest corner."""

MOST_CORNERS = 18_000
"""Maximum number of candidate corners of one hull: on a sphere Qhull takes about 0.3 s for them, during which nothing
interrupts it."""

MOST_ON_SIDE = 1_500
"""Maximum number of corners of one flat side of a hull. The time grows with the square of their number: for two circles of
1,000 Qhull takes 0.2 s, of 2,000 0.9 s, of 4,000 4 s, and of 8,900 18 s."""

_FAN = 32
"""A flat side with more triangles is divided into a strip."""

_ROWS, _PLANES = 2**12, 2**6
"""Numbers of points and planes whose products are computed at once: they fit into the cache of a processor."""

_DIRECTIONS = (32, 128, 512, 2048, 8192)
"""Numbers of directions in which the farthest points are searched, until few points lie outside their hull. Not examined
further."""

_HELPS, _MANY = 0.9, 200_000
"""No more directions are tried after a step that keeps more than this fraction of the points, if these are many: on a sphere
no number of directions helps. A thin wall needs some hundred. Not examined further."""

_WORK, _WORK_OF_POINT = 2**27, 2**10
"""Maximum number of products of points with directions and planes, and how many more for each point: a few seconds for a
million points. Not examined further."""

_DEEP = 1e-9
"""Depth below all sides of a hull beyond which a point is inside despite rounding, relative to the hull's size."""


def convex_hull(vertices: Array, name: str) -> Any:
    """Return the convex hull of points that span all directions, (k, 3), as coal takes it.

    Raises:
        InvalidScene: It has too many corners, or cannot be made; the error names the shape.
    """
    outer = _apart(outermost(np.unique(vertices, axis=0)))
    if len(outer) > MOST_CORNERS:
        raise InvalidScene(
            f"{name}: {len(outer):,} of its points may be corners of its convex hull, expected at most "
            f"{MOST_CORNERS:,}: simplify the mesh, so that it has fewer vertices where it is curved"
        )
    if (most := _most_on_side(outer)) > MOST_ON_SIDE:
        raise InvalidScene(
            f"{name}: a flat side of its convex hull has {most:,} corners, expected at most {MOST_ON_SIDE:,}: "
            f"simplify the mesh, so that it has fewer vertices where it is round"
        )
    spatial = library("scipy.spatial")
    try:
        hull = uninterrupted(lambda: spatial.ConvexHull(outer))
    except spatial.QhullError as error:
        raise InvalidScene(
            f"{name}: Qhull cannot make its convex hull: {str(error).strip().partition(chr(10))[0]}"
        ) from None
    # Not by coal: where its Qhull warns of rounding, the process ends.
    coal = library("coal")
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(outer[hull.vertices]))
    for corners in np.searchsorted(hull.vertices, _few_neighbours(hull)).tolist():
        triangles.append(coal.Triangle(*corners))
    try:
        return coal.Convex(points, triangles)
    except RuntimeError as error:
        why = str(error).rpartition("message:")[2].strip()
        raise InvalidScene(f"{name}: coal cannot use its convex hull: {why}") from error


def _apart(points: Array) -> Array:
    """Leave out points that are nearer than `LEAST_APART` to one that stays, (k, 3) -> (l, 3)."""
    least = LEAST_APART * float(np.abs(points).max())
    _, first = np.unique(np.round(points / least), axis=0, return_index=True)
    points = points[np.sort(first)]  # At most one in each cell, so that pairs are few.
    pairs = library("scipy.spatial").cKDTree(points).query_pairs(least, output_type="ndarray")
    stays = np.ones(len(points), dtype=np.bool_)
    for one, other in pairs[np.lexsort(pairs.T[::-1])].tolist():
        stays[other] &= not stays[one]
    return points[stays]


def _few_neighbours(hull: Any) -> NDArray[np.int64]:
    """Return the triangles of a hull of SciPy, (f, 3), with few edges inside of flat sides at each corner.

    Qhull divides a side into a fan, and coal accepts at most 254 neighbours of a corner. Here a side with many corners is
    divided into a strip.
    """
    triangles = np.array(hull.simplices, dtype=np.int64)
    order, begins = _sides(hull.equations)
    for side in np.flatnonzero(np.diff(begins) > _FAN).tolist():
        fan = order[begins[side] : begins[side + 1]]
        triangles[fan] = _strip(triangles[fan])
    return triangles


def _strip(fan: NDArray[np.int64]) -> NDArray[np.int64]:
    """Divide a polygon that is divided into triangles, (f, 3), into as many triangles of a strip."""
    edges = np.sort(fan[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, count = np.unique(edges, axis=0, return_counts=True)
    beside: dict[int, list[int]] = {}
    for one, other in edges[count == 1].tolist():
        beside.setdefault(one, []).append(other)
        beside.setdefault(other, []).append(one)
    if any(len(two) != 2 for two in beside.values()):
        return fan  # Not a polygon, because of rounding.
    around = [next(iter(beside))]
    while len(around) < len(fan) + 2:
        before, after = beside[around[-1]]
        around.append(after if len(around) > 1 and before == around[-2] else before)
    if len(set(around)) < len(around):
        return fan
    zigzag = np.empty(len(around), dtype=np.int64)
    zigzag[0::2], zigzag[1::2] = around[: (len(around) + 1) // 2], around[::-1][: len(around) // 2]
    return np.stack([zigzag[:-2], zigzag[1:-1], zigzag[2:]], axis=1)


def sides_of_hull(corners: Array) -> NDArray[np.int64]:
    """Return the triangles of a convex hull, seen from outside, as indices of its corners, (k, 3) -> (f, 3)."""
    spatial = library("scipy.spatial")
    # Joggled, since Qhull then fails for no corners; a picture does not show it.
    hull = uninterrupted(lambda: spatial.ConvexHull(corners, qhull_options="QJ"))
    a, b, c = np.moveaxis(corners[hull.simplices], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    return np.asarray(np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices), dtype=np.int64)


def _sides(planes: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the order of triangles by the sides of a hull that they lie in, (f,), and where each side begins, (s + 1,).

    Args:
        planes: Planes of the triangles, (f, 4), as Qhull returns them: those of one side are equal.
    """
    order = np.lexsort(planes.T)
    changes = (planes[order][1:] != planes[order][:-1]).any(axis=1)
    return order, np.flatnonzero(np.r_[True, changes, True])


def farthest_beyond(points: Array, planes: Array) -> Array:
    """Return how far points (k, 3) lie beyond the planes (4, f) of a convex hull, negative inside, (k,).

    The memory does not grow with the number of planes.
    """
    most = np.full(len(points), -np.inf)
    for row in range(0, len(points), _ROWS):
        rows, known = points[row : row + _ROWS], most[row : row + _ROWS]
        for first in range(0, planes.shape[1], _PLANES):
            some = planes[:, first : first + _PLANES]
            np.maximum(known, (rows @ some[:3] + some[3]).max(axis=1), out=known)
    return most


def outermost(points: Array, most: int = MOST_CORNERS) -> Array:
    """Remove points that lie inside the hull of the others, (k, 3) -> (l, 3); at most `most` points are returned unchanged.

    The hull stays the same. More than `most` points may remain.
    """
    left = _WORK + _WORK_OF_POINT * len(points)
    for count in _DIRECTIONS:
        left -= 3 * count * len(points)  # A hull of n corners has up to 2 n - 4 sides.
        if len(points) <= most or left < 0:
            break
        before, points = len(points), points[~_inside_farthest(points, count)]
        if len(points) > max(_HELPS * before, _MANY):
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


def _most_on_side(points: Array) -> int:
    """Return how many points lie on the flat side of their hull with the most corners, found in the hull of some of them."""
    if len(points) <= MOST_ON_SIDE:
        return 0
    some = points[np.random.default_rng(0).permutation(len(points))[:MOST_ON_SIDE]]
    spatial = library("scipy.spatial")
    try:
        planes = uninterrupted(lambda: spatial.ConvexHull(some)).equations
    except spatial.QhullError:
        return 0
    order, begins = _sides(planes)
    plane = planes[order[begins[np.argmax(np.diff(begins))]]]
    return int((np.abs(points @ plane[:3] + plane[3]) < _DEEP * float(np.ptp(points, axis=0).max())).sum())


def directions(count: int) -> Array:
    """Return evenly spread unit vectors, (count, 3): a Fibonacci lattice (Swinbank and Purser 2006)."""
    numbers = np.arange(count) + 0.5
    z, angles = 1 - 2 * numbers / count, np.pi * (1 + np.sqrt(5)) * numbers
    around = np.sqrt(1 - z**2)
    return np.stack([around * np.cos(angles), around * np.sin(angles), z], axis=-1)
