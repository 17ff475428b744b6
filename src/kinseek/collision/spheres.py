"""Spheres that contain a shape, and spheres inside it, for the broad phase.

Planes cut the hull of a shape into pieces, and each piece lies in a sphere around its corners. So the spheres contain the
shape by construction, wherever the cuts are. The piece whose sphere protrudes most is cut again, across the one of its axes
that helps most. A sphere's centre is moved inwards if the sphere then protrudes less.

Inner spheres are as large as the planes of the body's sides allow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.support.caching import WeakCache
from kinseek.support.lazy import lazy

from .geometry import library
from .hulls import farthest_beyond
from .shapes import Box, Capsule, Shape, Sphere

Array = NDArray[np.float64]

FEW, COUNT = 8, 32
"""Numbers of spheres of one part: few for a quick check, and more, outer and inner, for full vector lanes."""

_CANDIDATES, _SAMPLES = 300, 800
"""Numbers of candidate inner spheres, and of points of the body by which they are chosen. Not examined further."""

_MOST_CORNERS = 2**13
"""Maximum number of corners of a hull that is cut into pieces; this many on two circles take some 15 s. Larger hulls use
slices.
"""

_PULLS = np.linspace(0.0, 1.0, 9)[:, None]
"""Fractions of the way from the centre of a piece to that of the hull, at which the centre of its sphere is tried."""

_NONE = -1e30
"""Radius of an absent sphere: it overlaps nothing."""


class Cover(NamedTuple):
    """Guaranteed bounds of a shape, in its own frame, lengths in [m]."""

    rough: Array
    """Spheres that together contain the shape: x, y, z, radius, (4, FEW); some may be repeated."""
    outer: Array
    """More spheres that contain the shape and protrude less, (4, COUNT)."""
    inner: Array
    """Spheres inside the shape, (4, COUNT); absent ones have a radius far below 0."""
    core: Array
    """Pose of a box that, made thicker by the shape's `thickness`, contains the shape, (4, 4)."""
    half: Array
    """Half of its edge lengths, (3,)."""
    exact: bool
    """Is the thickened box equal to the shape?"""
    corners: Array
    """Points whose thickened hull contains the shape, (k, 3)."""
    solid: bool
    """Is the thickened hull equal to the shape?"""
    ball: Array
    """A small sphere around the corners: x, y, z, radius, (4,)."""


_COVERS: WeakCache[Shape, str, Cover] = WeakCache()


def cover_of(shape: Shape) -> Cover:
    """Return spheres and a box around a shape, fitted once."""
    return _COVERS.of(shape).get("cover", lambda: _fitted(shape))


def _fitted(shape: Shape) -> Cover:
    solid = shape.is_hull
    hull = _hull(shape.corners)
    corners = shape.corners if hull is None else hull.points[hull.vertices]
    simple = isinstance(shape, Box | Sphere | Capsule)
    core = np.eye(4) if simple else _frame_of(corners)
    # The axes of the box come first; then its centre is moved to the middle of the corners along them.
    inside = (corners - core[:3, 3]) @ core[:3, :3]
    low, high = inside.min(axis=0), inside.max(axis=0)
    core[:3, 3] += core[:3, :3] @ ((low + high) / 2)
    if hull is None:
        rough, outer = (slices(corners, shape.thickness, most) for most in (FEW, COUNT))
    elif isinstance(shape, Box):
        rough, outer = (_balls_around_cells(np.asarray(shape.size) / 2, most) for most in (FEW, COUNT))
    else:
        planes, surface = _unique_planes(hull.equations), hull.points[hull.simplices]
        # The small set is a beginning of the large one, so its cuts are reused.
        few = pieces_of(surface, planes, FEW)
        more = pieces_of(surface, planes, COUNT, few)
        rough, outer = (np.array([ball for _, ball, _ in pieces]).T for pieces in (few, more))
        rough[3], outer[3] = rough[3] + shape.thickness, outer[3] + shape.thickness
    inner = _balls_inside(shape, hull if solid else _hull(shape.inner_corners))
    half = (high - low) / 2
    spheres = (_padded(rough, FEW), _padded(outer), _padded(inner))
    return Cover(*spheres, core, half, simple, corners, solid, ball_around(corners))


def cover_of_many(points: Array, thickness: float) -> Cover:
    """Fit spheres and a box to the thickened hull of points; the cover has no inner spheres."""
    cover = _fitted(_Thick(points, thickness))
    return cover._replace(inner=_padded(np.zeros((4, 0))), exact=False, solid=False)


def rough_cover(points: Array, thickness: float) -> Cover:
    """Do the same faster: with slices, and a box along the axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    core = np.eye(4)
    core[:3, 3] = (low + high) / 2
    none = _padded(np.zeros((4, 0)))
    rough, outer = (_padded(slices(points, thickness, most), most) for most in (FEW, COUNT))
    return Cover(rough, outer, none, core, (high - low) / 2, False, points, False, ball_around(points))


def ball_around(points: Array) -> Array:
    """Return a small sphere around points, (k, 3): x, y, z, radius; by the method of Badoiu and Clarkson (2003)."""
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    for step in range(1, 100):
        away = np.linalg.norm(points - centre, axis=1)
        centre = centre + (points[np.argmax(away)] - centre) / (step + 1)
    return np.array([*centre, np.linalg.norm(points - centre, axis=1).max()])


@dataclass(frozen=True, eq=False)
class _Thick(Shape):
    """A thickened hull of points, which contains some shapes."""

    points: Array
    thick: float

    @property
    def thickness(self) -> float:
        return self.thick

    @property
    def is_hull(self) -> bool:
        return False

    @lazy
    def corners(self) -> Array:
        return self.points

    def geometry(self) -> Any:
        raise NotImplementedError("coal uses the shapes themselves")


def slices(corners: Array, thickness: float, most: int = COUNT) -> Array:
    """Return spheres around slices of a cylinder about the corners' longest axis, x, y, z, radius, (4, at most `most`)."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    off = corners - middle
    axis = np.linalg.eigh(off.T @ off)[1][:, -1]
    along = off @ axis
    wide = float(np.linalg.norm(off - np.outer(along, axis), axis=1).max())
    low, high = float(along.min()), float(along.max())
    one = float(np.linalg.norm(off, axis=1).max())
    count = int(np.clip(np.ceil((high - low) / max(wide + thickness, 1e-9)), 1, most))
    ends = np.linspace(low, high, count + 1)
    radius = float(np.hypot((high - low) / count / 2, wide))
    if count == 1 or one <= radius:
        return np.array([[*middle, one + thickness]]).T
    centres = middle + np.outer((ends[:-1] + ends[1:]) / 2, axis)
    return np.vstack([centres.T, np.full(count, radius + thickness)])


def _balls_around_cells(half: Array, most: int) -> Array:
    """Return spheres around equal cells of a box about the origin, x, y, z, radius, (4, at most `most`)."""
    counts = [
        (i, j, k)
        for i in range(1, most + 1)
        for j in range(1, most // i + 1)
        for k in range(1, most // (i * j) + 1)
    ]
    best = np.array(min(counts, key=lambda count: float(np.linalg.norm(half / count))))
    places = [
        -size + size * (2 * np.arange(count) + 1) / count for size, count in zip(half, best, strict=True)
    ]
    centres = np.array(np.meshgrid(*places, indexing="ij")).reshape(3, -1)
    return np.vstack([centres, np.full(centres.shape[1], np.linalg.norm(half / best) + 1e-12)])


def pieces_of(
    triangles: Array,
    planes: Array,
    most: int = COUNT,
    begun: Sequence[tuple[float, Array, Array]] = (),
) -> list[tuple[float, Array, Array]]:
    """Cut the hull with this surface, (f, 3, 3), and these planes into `most` pieces, starting from the pieces in `begun`.

    Returns:
        For each piece how far its sphere protrudes from the hull [m], the sphere, x, y, z, radius, (4,), and the piece's
        surface, (f, 3, 3).
    """
    middle = (triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2
    triangles = triangles - middle
    room = planes[3] + middle @ planes[:3]

    def fit(piece: Array) -> tuple[float, Array, Array]:
        points = piece.reshape(-1, 3)
        own = (points.min(axis=0) + points.max(axis=0)) / 2
        centres = own * (1 - _PULLS)
        radii = np.sqrt(_squares(centres, points).max(axis=1))
        beyond = (centres @ planes[:3] + room).max(axis=1) + radii
        best = int(np.argmin(beyond))
        radius = float(np.linalg.norm(points - centres[best], axis=1).max()) + 1e-12
        return float(beyond[best]), np.array([*centres[best] + middle, radius]), piece

    pieces = list(begun) or [fit(triangles)]
    while len(pieces) < most:
        piece = pieces.pop(max(range(len(pieces)), key=lambda i: pieces[i][0]))[2]
        points = piece.reshape(-1, 3)
        ways = []
        for direction in np.linalg.eigh(np.cov(points.T))[1].T:
            along = points @ direction
            at = float(along.min() + along.max()) / 2
            ways.append([fit(half) for half in cut(piece, direction, at)])
        # A cut is judged by its worse half first: the piece that protrudes most determines the bound.
        pieces += min(ways, key=lambda two: (max(one[0] for one in two), sum(one[0] for one in two)))
    return pieces


def cut(triangles: Array, direction: Array, at: float) -> tuple[Array, Array]:
    """Cut a convex body with this surface, (f, 3, 3), along a plane; return the closed surfaces of both parts."""
    side = triangles @ direction - at
    crossed = (side.min(axis=1) < 0) & (side.max(axis=1) > 0)
    split, heights = triangles[crossed], side[crossed]
    # Rotate each triangle so that its first corner is alone on its side; corners in the plane are on neither side.
    above = (heights > 0).sum(axis=1) == 1
    alone = np.where(above, (heights > 0).argmax(axis=1), (heights < 0).argmax(axis=1))
    rows, turned = np.arange(len(split))[:, None], (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(split[rows, turned], 1, 0)
    ha, hb, hc = heights[rows, turned].T[:, :, None]
    ab, ac = a + ha / (ha - hb) * (b - a), a + ha / (ha - hc) * (c - a)
    tip = np.stack([a, ab, ac], axis=1)
    rest = np.concatenate([np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)])
    # The cut is a convex polygon: a fan of triangles from a point in it to its edges.
    lying = ((side == 0).sum(axis=1) == 2) & ~crossed
    ends = triangles[lying][side[lying] == 0].reshape(-1, 2, 3)
    edges = np.concatenate([np.stack([ab, ac], axis=1), ends])
    hub = np.broadcast_to(edges.mean(axis=(0, 1)), (len(edges), 1, 3))
    fan = np.concatenate([hub, edges], axis=1)
    below = [triangles[(side <= 0).all(axis=1)], tip[~above], rest[np.tile(above, 2)], fan]
    beyond = [triangles[(side >= 0).all(axis=1)], tip[above], rest[np.tile(~above, 2)], fan]
    return np.concatenate(below), np.concatenate(beyond)


def _balls_inside(shape: Shape, hull: Any) -> Array:
    """Return spheres inside a shape with this hull of its inner corners, or None, those that contain most of it first."""
    if hull is None:
        if not len(shape.inner_corners):
            return np.zeros((4, 0))
        # A ball, a line, a flat hull or one of too many corners: after thickening, every point is the centre of a sphere
        # inside.
        ends = shape.inner_corners
        share = np.linspace(0.0, 1.0, COUNT)[:, None] if len(ends) > 1 else np.zeros((1, 1))
        places = ends[0] + share * (ends[-1] - ends[0])
        return np.vstack([places.T, np.full(len(places), shape.thickness)])
    planes = _unique_planes(hull.equations)
    rng, ends = np.random.default_rng(0), hull.points[hull.vertices]
    low, high = ends.min(axis=0), ends.max(axis=0)
    points = rng.uniform(low, high, (4 * _SAMPLES, 3))
    # The depth below all sides is the radius of the largest sphere inside the hull at that point.
    depths = -farthest_beyond(points, planes)
    points, depths = points[depths > 0][:_SAMPLES], depths[depths > 0][:_SAMPLES]
    if not len(points):
        return np.zeros((4, 0))
    tried = np.argsort(-depths)[:_CANDIDATES]
    near = (_squares(points, points[tried]) <= depths[tried] ** 2).astype(np.float32)
    chosen, left = [], np.ones(len(points), dtype=np.float32)
    for _ in range(COUNT):
        # Greedy covering: the next sphere is the one that contains most points that no sphere contains yet.
        gains = left @ near
        if not gains.max():
            break
        chosen.append(best := int(np.argmax(gains)))
        left[near[:, best] > 0] = 0
    return np.vstack([points[tried[chosen]].T, depths[tried[chosen]] - 1e-12 + shape.thickness])


def _squares(one: Array, other: Array) -> Array:
    """Return squared distances of points, (k, 3) and (l, 3) -> (k, l), accurate enough for comparisons."""
    return np.asarray((one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T)


def _frame_of(corners: Array) -> Array:
    """Return the axes of a small box around points, either their own or the frame's, (4, 4), placed at the first point."""
    off = corners - corners.mean(axis=0)
    best, least = np.eye(3), np.inf
    own = np.linalg.eigh(off.T @ off)[1]
    for turn in (np.eye(3), own * np.sign(np.linalg.det(own))):
        size = np.ptp(off @ turn, axis=0)
        if size.prod() < 0.999 * least:
            best, least = turn, float(size.prod())
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = best, corners[0]
    return pose


def _hull(corners: Array) -> Any:
    """Return the convex hull of points, or None if they span no volume or are too many."""
    if (
        not 4 <= len(corners) <= _MOST_CORNERS
        or np.linalg.matrix_rank(corners - corners.mean(axis=0), tol=1e-9) < 3
    ):
        return None
    spatial = library("scipy.spatial")
    try:
        return spatial.ConvexHull(corners)
    except spatial.QhullError:  # So thin that rounding decides: slices are used instead.
        return None


def _unique_planes(equations: Array) -> Array:
    """Return the planes of a hull, (4, f), without the repetitions from triangles on one flat side."""
    # Qhull divides a flat side into triangles, whose planes differ by rounding only.
    return np.ascontiguousarray(np.unique(equations.round(13), axis=0).T)


def _padded(spheres: Array, count: int = COUNT) -> Array:
    """Pad spheres to `count`, for full vector lanes."""
    if not spheres.shape[1]:
        return np.vstack([np.zeros((3, count)), np.full(count, _NONE)])
    return np.ascontiguousarray(spheres[:, np.arange(count) % spheres.shape[1]])
