"""Spheres that contain a shape, and spheres inside it, for the broad phase.

A box is divided into equal cells. Planes cut the hull of any other shape into pieces, and each piece lies in a sphere around
its corners. So the spheres contain the shape by construction, wherever the cuts are. Each piece is cut in two across the
axis that helps most, until there are enough. A sphere's centre is moved inwards if the sphere then protrudes less.

Inner spheres are as large as the planes of the body's sides allow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.support.caching import LRUCache

from .clouds import Cloud
from .geometry import library
from .hulls import directions, farthest_beyond
from .shapes import Box, Capsule, Cylinder, Shape, Sphere, digest_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FEW, COUNT = 8, 32
"""Numbers of spheres of one part: few for a quick check, and more, outer and inner, for full vector lanes."""

_SIZE = 0.02
"""Weight of a piece's size beside how far its sphere protrudes, when an axis is chosen: the sphere of half of a thin disc
protrudes as far as that of the disc, but a quarter's protrudes less. With 0, spheres of thin discs stay large; with 0.1, all
protrude 5 % more.
"""

_SHARES = 1 - np.array([0.0, 0.1, 0.2, 0.35, 0.5, 0.75])
"""Parts of the way from the centre of the hull to that of a piece, at which the centre of its sphere is tried."""

_WAYS = np.concatenate([directions(64), np.eye(3), -np.eye(3)]).T
"""Directions in which it is measured how far a sphere protrudes, (3, w)."""

_MOST_CORNERS, _TOGETHER = 2**13, 32
"""Maximum number of corners of a hull that is cut into pieces; larger hulls use slices. And number of hulls that are cut
together: of small ones alone, most of the time goes into the calls of NumPy."""

_CELLS = {
    most: np.array(
        [
            (i, j, k)
            for i in range(1, most + 1)
            for j in range(1, most // i + 1)
            for k in range(1, most // (i * j) + 1)
        ]
    )
    for most in (FEW, COUNT)
}
"""Numbers of cells along the axes of a box, so that there are at most so many in all, (k, 3)."""

_GRID = np.stack(np.meshgrid(*[np.arange(-8, 9, 2) / 9] * 3), axis=-1).reshape(-1, 3)
"""Points of a cube of half edge length 1, by which inner spheres are chosen, (k, 3). An odd number along each axis, so that
some lie in the middle. With 7 along each axis, inner spheres contain 3 % less."""

_CANDIDATES = 150
"""Number of candidate inner spheres. With 300, inner spheres contain 1 % more."""

_STEPS = 20
"""Number of steps to a small ball around points. After 100 steps it is 0.4 % smaller."""

_SAME = 13
"""Decimals of equal planes: Qhull divides a flat side into triangles, whose planes differ by rounding only."""

_CLUMPS = 128
"""Number of neighbourhoods into which a cloud is split: of 64 some are so large that coal has to decide often, and 256 take
twice the time of 128. Found by trial with 10,000 and 100,000 points of a table and a wall."""

_SAMPLE = 64
"""Number of points of a group that choose the axis across which it is halved."""

_CUBE = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
"""Corners of a cube of half edge length 1, (8, 3)."""

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


_COVERS: LRUCache[bytes, Cover] = LRUCache(most=1024)
"""Covers by the digests of their shapes."""


def cover_of(shape: Shape) -> Cover:
    """Return spheres and a box around a shape."""
    return covers_of([shape])[0]


def covers_of(shapes: Sequence[Shape]) -> list[Cover]:
    """Return spheres and a box around each shape; equal shapes are fitted once, and new ones together."""
    new = [shape for shape in dict.fromkeys(shapes) if digest_of(shape) not in _COVERS]
    fitted = dict(zip(new, _fitted(new), strict=True))

    def make(shape: Shape) -> Cover:
        # Another thread, or the rest of a large scene, may have displaced a cover that was there before.
        return fitted[shape] if shape in fitted else _fitted([shape])[0]

    return [_COVERS.get(digest_of(shape), partial(make, shape)) for shape in shapes]


def cover_of_many(points: Array, thickness: float) -> Cover:
    """Fit a few spheres and a box to the thickened hull of points; the cover has no inner spheres."""
    body = Boxed.of(points, thickness, False)
    (few,) = _spheres_around([body], [FEW])[0]
    return body.cover(few, few, np.zeros((4, 0)), False)


def covers_of_cloud(cloud: Cloud) -> list[Cover]:
    """Split a cloud into at most `_CLUMPS` neighbourhoods of equal number, and return the cover of each."""
    clumps = max(min(_CLUMPS, 2 ** int(np.log2(max(len(cloud.places) / COUNT, 1)))), 1)
    # Each is split further into as many groups of neighbours as it has spheres.
    groups = neighbours(cloud.places, clumps * COUNT)
    outer = _balls_around(groups, cloud)
    rough = _balls_around(groups.reshape(clumps * FEW, -1, 3), cloud)
    inner = np.concatenate([groups[:, 0].T, np.full((1, len(groups)), cloud.inner_radius)])
    rough, outer, inner = (each.reshape(4, clumps, -1).transpose(1, 0, 2) for each in (rough, outer, inner))
    places = groups.reshape(clumps, -1, 3)
    low, high = places.min(axis=1), places.max(axis=1)
    middle, half = (low + high) / 2, (high - low) / 2 + cloud.half
    corners = (places[:, :, None] + cloud.half * _CUBE[: None if cloud.half else 1]).reshape(clumps, -1, 3)
    far = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1)
    core = np.tile(np.eye(4), (clumps, 1, 1))
    core[:, :3, 3] = middle
    return [
        Cover(*spheres, *box, False, inside, False, np.array([*centre, radius]))
        for spheres, box, inside, centre, radius in zip(
            zip(rough, outer, inner, strict=True),
            zip(core, half, strict=True),
            corners,
            middle,
            far,
            strict=True,
        )
    ]


def neighbours(points: Array, count: int) -> Array:
    """Split points, (k, 3), into `count` groups of neighbours, a power of two, (count, m, 3); some points are repeated.

    Each group is halved across the axis for which the boxes around both halves have the least surface (MacDonald and Booth
    1990), which separates the walls of a room. A sample of the group chooses the axis.
    """
    every = np.arange(-(-len(points) // count) * count) % len(points)
    groups = np.ascontiguousarray(points[every].T[:, None])
    while (found := groups.shape[1]) < count:
        some = groups[:, :, :: -(-groups.shape[2] // _SAMPLE)]
        surfaces = []
        for along in some:
            middle = some.shape[2] // 2
            halves = np.split(_ordered(some, along, middle), [middle], axis=2)
            edges = np.stack([np.ptp(half, axis=2) for half in halves])
            surfaces.append((edges * np.roll(edges, 1, axis=1)).sum(axis=(0, 1)))
        axis, middle = np.argmin(surfaces, axis=0), groups.shape[2] // 2
        groups = _ordered(groups, groups[axis, np.arange(found)], middle).reshape(3, 2 * found, -1)
    return groups.transpose(1, 2, 0)


def _ordered(groups: Array, along: Array, middle: int) -> Array:
    """Sort groups of points, (3, k, m), so that those with the least values `along`, (k, m), come before the middle."""
    return np.take_along_axis(groups, np.argpartition(along, middle, axis=1)[None], axis=2)


def _balls_around(groups: Array, cloud: Cloud) -> Array:
    """Return a ball around the pieces of a cloud at some points, (k, m, 3): x, y, z, radius, (4, k) [m]."""
    middle = (groups.min(axis=1) + groups.max(axis=1)) / 2
    away = np.linalg.norm(groups - middle[:, None], axis=2).max(axis=1)
    return np.vstack([middle.T, away + (np.sqrt(3) * cloud.half + cloud.thickness + 1e-12)])


class Boxed(NamedTuple):
    """Points whose thickened hull contains a shape, and a box around them, lengths in [m]."""

    corners: Array
    """The points, (k, 3)."""
    thickness: float
    core: Array
    """Pose of the box, (4, 4)."""
    half: Array
    """Half of its edge lengths, (3,)."""
    hull: Any
    """Their convex hull, of SciPy; or None if it is not needed, or cannot be made."""
    exact: bool
    """Is the thickened box equal to the shape?"""

    @classmethod
    def of(cls, points: Array, thickness: float, exact: bool) -> Self:
        """Return the hull of points, and a box around it, which is along the axes if it is exact."""
        hull = None if exact else _hull(points)
        corners = points if hull is None else hull.points[hull.vertices]
        return cls(
            corners, thickness, *_box_around(corners, np.eye(3) if exact else _axes_of(corners)), hull, exact
        )

    def cover(self, rough: Array, outer: Array, inner: Array, solid: bool) -> Cover:
        """Return the cover with these spheres, (4, at most so many)."""
        spheres = (_padded(rough, FEW), _padded(outer), _padded(inner))
        middle = np.array([*self.core[:3, 3], np.linalg.norm(self.half)])
        ball = middle if self.exact else ball_around(self.corners)
        return Cover(*spheres, self.core, self.half, self.exact, self.corners, solid, ball)

    def inside(self, points: Array) -> Array:
        """Return points, (..., 3), in the frame of the box."""
        return np.asarray((points - self.core[:3, 3]) @ self.core[:3, :3])

    def spheres(self, centres: Array, radii: Array) -> Array:
        """Return spheres around the corners, given in the frame of the box, as spheres around the body, in its own frame.

        Args:
            centres: (s, 3) [m]
            radii: (s,) [m]

        Returns:
            x, y, z, radius, (4, s).
        """
        turned = self.core[:3, :3] @ centres.T + self.core[:3, 3:]
        return np.vstack([turned, radii + (1e-12 + self.thickness)])


def _fitted(shapes: Sequence[Shape]) -> list[Cover]:
    bodies = [
        Boxed.of(shape.corners, shape.thickness, isinstance(shape, Box | Sphere | Capsule))
        for shape in shapes
    ]
    return [
        body.cover(few, more, _spheres_inside(shape, body), shape.is_hull)
        for shape, body, (few, more) in zip(
            shapes, bodies, _spheres_around(bodies, [FEW, COUNT]), strict=True
        )
    ]


def _spheres_around(bodies: Sequence[Boxed], counts: Sequence[int]) -> list[list[Array]]:
    """Return spheres around each body, at most so many of these numbers, `FEW` or more: x, y, z, radius, (4, s)."""
    around: dict[int, list[Array]] = {}
    for i, body in enumerate(bodies):
        if body.exact:
            around[i] = [_around_cells(body, count) for count in counts]
        elif body.hull is None:
            around[i] = [slices(body.corners, body.thickness, count) for count in counts]
    left = [i for i in range(len(bodies)) if i not in around]
    for first in range(0, len(left), _TOGETHER):
        some = left[first : first + _TOGETHER]
        around |= zip(some, _around_pieces([bodies[i] for i in some], counts), strict=True)
    return [around[i] for i in range(len(bodies))]


def _around_cells(body: Boxed, most: int) -> Array:
    """Return spheres around equal cells of the thickened box of a body, (4, at most `most`)."""
    counts = _CELLS[most]
    best = counts[np.linalg.norm(body.half / counts, axis=1).argmin()]
    places = [
        size * ((2 * np.arange(count) + 1) / count - 1) for size, count in zip(body.half, best, strict=True)
    ]
    centres = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
    return body.spheres(centres, np.full(len(centres), np.linalg.norm(body.half / best)))


def _around_pieces(hulls: Sequence[Boxed], counts: Sequence[int]) -> list[list[Array]]:
    """Return spheres around these numbers of pieces of each hull, which are powers of two."""
    around = []
    for corners, centre in halved(hulls, max(counts)):
        if len(centre) // len(hulls) in counts:
            radii = np.zeros(len(centre))
            away = np.linalg.norm(corners.points - centre[corners.piece], axis=1)
            np.maximum.at(radii, corners.piece, away)
            each = zip(hulls, np.split(centre, len(hulls)), np.split(radii, len(hulls)), strict=True)
            around.append([hull.spheres(*spheres) for hull, *spheres in each])
    return [list(spheres) for spheres in zip(*around, strict=True)]


def halved(hulls: Sequence[Boxed], most: int) -> Iterator[tuple[_Grouped, Array]]:
    """Cut each hull into 2 pieces, 4, 8 and so on, up to `most`.

    Yields:
        Corners of all pieces, first those of the first hull, and the centres of their spheres, in the frames of the boxes.
    """
    corners = _Grouped.of(hulls, [hull.corners for hull in hulls])
    edges = _Grouped.of(hulls, [_edges(hull.hull) for hull in hulls])
    heights = np.stack([(hull.inside(hull.corners) @ _WAYS).max(axis=0) for hull in hulls])
    middle = np.zeros((len(hulls), 3))
    while len(middle) < most * len(hulls):
        # Piece i becomes the pieces 2 i and 2 i + 1.
        halves, every = _halves(corners, edges, middle), np.arange(len(middle))
        heights = heights.repeat(2, axis=0)
        cost, centres, middles = _fit(halves, np.tile(heights, (3, 1)))
        # An axis is judged by its worse half first: the piece that protrudes most determines the bound.
        better, worse = np.sort(cost.reshape(3, -1, 2), axis=2).transpose(2, 0, 1)
        axis = np.argmin(worse + 1e-3 * better, axis=0)
        edges = _cut_edges(edges, axis, middle[every, axis])
        chosen = (2 * (axis * len(middle) + every)[:, None] + [0, 1]).ravel()
        corners, middle = halves.some(chosen), middles[chosen]
        yield corners, centres[chosen]


class _Grouped(NamedTuple):
    """Corners or edges of pieces, in the frames of the boxes around their hulls."""

    points: Array
    """Corners, (k, 3), or both ends of edges, (k, 2, 3) [m]."""
    piece: Indices
    """The piece of each, (k,)."""

    @classmethod
    def of(cls, hulls: Sequence[Boxed], points: Sequence[Array]) -> Self:
        """Group points of uncut hulls, given in their own frames."""
        local = [hull.inside(each) for hull, each in zip(hulls, points, strict=True)]
        return cls(np.concatenate(local), np.arange(len(hulls)).repeat([len(each) for each in local]))

    def some(self, which: Indices) -> Self:
        """Return those of some pieces, numbered in this order."""
        number = np.full(max(which.max(), self.piece.max()) + 1, -1)
        number[which] = np.arange(len(which))
        new = number[self.piece]
        return type(self)(self.points[new >= 0], new[new >= 0])


def _fit(corners: _Grouped, heights: Array) -> tuple[Array, Array, Array]:
    """Fit spheres to pieces.

    Args:
        corners: Their corners, piece by piece.
        heights: Heights of their hulls in `_WAYS`, (p, w) [m].

    Returns:
        The cost of each piece, which is mostly how far its sphere protrudes from the whole hull, (p,) [m]; the centre of the
        sphere, (p, 3); and the middle of the box around the piece, (p, 3) [m].
    """
    starts = np.searchsorted(corners.piece, np.arange(len(heights)))
    points, shares = corners.points, _SHARES[:, None]
    low, high = np.minimum.reduceat(points, starts), np.maximum.reduceat(points, starts)
    middle = (low + high) / 2
    # |x - s m|² = |x|² - 2 s x·m + s² |m|² for all shares s at once, exact enough for a comparison.
    squares = (points**2).sum(axis=1) - 2 * shares * (points * middle[corners.piece]).sum(axis=1)
    squares = np.maximum.reduceat(squares, starts, axis=1) + shares**2 * (middle**2).sum(axis=1)
    beyond = (shares[:, :, None] * (middle @ _WAYS) - heights).max(axis=2)
    beyond += np.sqrt(np.maximum(squares, 0))
    cost = beyond.min(axis=0) + _SIZE * np.linalg.norm(high - low, axis=1)
    return cost, middle * _SHARES[beyond.argmin(axis=0), None], middle


def _halves(corners: _Grouped, edges: _Grouped, middle: Array) -> _Grouped:
    """Return the corners of both halves of p pieces for a cut across each axis, at these coordinates, (p, 3), half by half.

    The halves of piece i for axis k are 2 (k p + i), below the cut, and the next one, above it.
    """
    side, sides = corners.points - middle[corners.piece], edges.points - middle[edges.piece][:, None]
    edge, axis = np.nonzero(sides[:, 0] * sides[:, 1] < 0)
    between = _between(edges.points[edge], sides[edge, :, axis])
    first = 2 * len(middle) * np.arange(3)
    half, crossed = first + 2 * corners.piece[:, None], first[axis] + 2 * edges.piece[edge]
    (below, _), (above, _) = np.nonzero(side <= 0), np.nonzero(side >= 0)
    points = np.concatenate([corners.points[below], corners.points[above], between, between])
    piece = np.concatenate([half[side <= 0], half[side >= 0] + 1, crossed, crossed + 1])
    # NumPy sorts numbers of 16 bits in linear time; there are fewer halves, see `_TOGETHER`.
    order = np.argsort(piece.astype(np.uint16), kind="stable")
    return _Grouped(points[order], piece[order])


def _cut_edges(edges: _Grouped, axis: Indices, at: Array) -> _Grouped:
    """Return the edges of both halves of each piece: of piece i those of 2 i below the cut, and of 2 i + 1 above it.

    Args:
        edges: Edges of all pieces.
        axis: Axis across which each piece is cut, (p,).
        at: Coordinate of the cut, (p,) [m].
    """
    side = edges.points[np.arange(len(edges.points)), :, axis[edges.piece]] - at[edges.piece, None]
    below, above = (side <= 0).all(axis=1), (side >= 0).all(axis=1)
    crossed, (on, _) = ~(below | above), np.nonzero(side == 0)
    between = _between(edges.points[crossed], side[crossed])
    lower, upper = (
        np.where((side[crossed] < 0)[:, :, None] == is_below, edges.points[crossed], between[:, None])
        for is_below in (True, False)
    )
    sides, owner = _polygons(
        np.concatenate([between, edges.points[side == 0]]),
        np.concatenate([edges.piece[crossed], edges.piece[on]]),
        axis,
    )
    piece, own = edges.piece, edges.piece[crossed]
    points = [edges.points[below], lower, sides, edges.points[above], upper, sides]
    halves = [2 * piece[below], 2 * own, 2 * owner, 2 * piece[above] + 1, 2 * own + 1, 2 * owner + 1]
    return _Grouped(np.concatenate(points), np.concatenate(halves))


def _polygons(corners: Array, piece: Indices, axis: Indices) -> tuple[Array, Indices]:
    """Return the sides of convex polygons, (k, 2, 3), and the piece of each, (k,).

    Args:
        corners: Corners of all polygons, (k, 3) [m].
        piece: The piece whose cut each belongs to, (k,).
        axis: Axis that is normal to the polygon of each piece, (p,).
    """
    count = np.bincount(piece, minlength=len(axis))
    middle = np.stack([np.bincount(piece, each, len(axis)) for each in corners.T], axis=1) / count[:, None]
    away, every = corners - middle[piece], np.arange(len(piece))
    angle = np.arctan2(away[every, axis[piece] - 1], away[every, axis[piece] - 2])
    order, following, last = np.lexsort((angle, piece)), every + 1, np.cumsum(count) - 1
    following[last] = last + 1 - count
    return corners[order][np.stack([every, following], axis=1)], piece[order]


def _between(ends: Array, side: Array) -> Array:
    """Return where edges, (e, 2, 3), cross a plane, given the signed distances of their ends, (e, 2) -> (e, 3)."""
    share = side[:, :1] / (side[:, :1] - side[:, 1:])
    return np.asarray(ends[:, 0] + share * (ends[:, 1] - ends[:, 0]))


def _edges(hull: Any) -> Array:
    """Return the edges between sides of a hull, (e, 2, 3) [m]; not those of triangles inside a flat side."""
    _, side = np.unique(hull.equations.round(_SAME), axis=0, return_inverse=True)
    side, other = side.ravel(), hull.neighbors
    # Neighbour k is opposite to corner k. Each edge belongs to two triangles and is taken from the first.
    triangle, k = np.nonzero((np.arange(len(side))[:, None] < other) & (side[:, None] != side[other]))
    return np.asarray(hull.points[hull.simplices[triangle[:, None], (k[:, None] + [1, 2]) % 3]])


def _spheres_inside(shape: Shape, body: Boxed) -> Array:
    """Return spheres inside a shape, those that contain most of it first: x, y, z, radius, (4, at most `COUNT`) [m]."""
    ends, grid = shape.inner_corners, _GRID * body.half
    points = grid @ body.core[:3, :3].T + body.core[:3, 3]
    # The depth below all sides is the radius of the largest sphere inside the shape at that point.
    if not len(ends):
        return np.zeros((4, 0))
    if isinstance(shape, Box):
        depths = (body.half - np.abs(grid)).min(axis=1)
    elif isinstance(shape, Cylinder):
        across = shape.radius - np.hypot(points[:, 0], points[:, 1])
        depths = np.minimum(across, shape.length / 2 - np.abs(points[:, 2]))
    elif body.hull is not None:
        depths = -farthest_beyond(points, _unique_planes(body.hull.equations))
    else:
        # A ball, a line, a flat hull or one of too many corners: after thickening, every point is the centre of a sphere
        # inside.
        share = np.linspace(0.0, 1.0, COUNT)[:, None] if len(ends) > 1 else np.zeros((1, 1))
        places = ends[0] + share * (ends[-1] - ends[0])
        return np.vstack([places.T, np.full(len(places), shape.thickness)])
    points, depths = points[depths > 0], depths[depths > 0]
    tried = np.argsort(-depths)[:_CANDIDATES]
    one, other = points.astype(np.float32), points[tried].astype(np.float32)
    # |x - c|² <= r², with rounding that does not matter for a choice.
    near = (one**2).sum(axis=1)[:, None] - 2 * one @ other.T <= depths[tried] ** 2 - (other**2).sum(axis=1)
    chosen, gains = list[int](), near.sum(axis=0)
    while len(chosen) < COUNT and gains.any():
        # Greedy covering: the next sphere is the one that contains most points that no sphere contains yet.
        chosen.append(best := int(gains.argmax()))
        gains -= near[near[:, best]].sum(axis=0)
        near = near[~near[:, best]]
    return np.vstack([points[tried[chosen]].T, depths[tried[chosen]] - 1e-12 + shape.thickness])


def ball_around(points: Array) -> Array:
    """Return a small sphere around points, (k, 3): x, y, z, radius; by the method of Badoiu and Clarkson (2003)."""
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    best = np.full(4, np.inf)
    for step in range(_STEPS):
        away = np.linalg.norm(points - centre, axis=1)
        if away.max() < best[3]:
            best = np.array([*centre, away.max()])
        centre = centre + (points[np.argmax(away)] - centre) / (step + 2)
    return best


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


def _axes_of(corners: Array) -> Array:
    """Return the axes of a small box around points, either their own or the frame's, (3, 3)."""
    off = corners - corners.mean(axis=0)
    own = np.linalg.eigh(off.T @ off)[1]
    own *= np.sign(np.linalg.det(own))
    frame = np.eye(3)
    return own if np.ptp(off @ own, axis=0).prod() < 0.999 * np.ptp(off, axis=0).prod() else frame


def _box_around(points: Array, axes: Array) -> tuple[Array, Array]:
    """Return the box around points with these axes, (3, 3): its pose, (4, 4), and half of its edge lengths, (3,)."""
    along = points @ axes
    low, high = along.min(axis=0), along.max(axis=0)
    core = np.eye(4)
    core[:3, :3], core[:3, 3] = axes, axes @ ((low + high) / 2)
    return core, (high - low) / 2


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
    return np.ascontiguousarray(np.unique(equations.round(_SAME), axis=0).T)


def _padded(spheres: Array, count: int = COUNT) -> Array:
    """Pad spheres to `count`, for full vector lanes."""
    if not spheres.shape[1]:
        return np.vstack([np.zeros((3, count)), np.full(count, _NONE)])
    return np.ascontiguousarray(spheres[:, np.arange(count) % spheres.shape[1]])
