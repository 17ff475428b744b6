"""Shapes of many equal parts: point clouds, and grids whose cells are occupied or free."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidScene
from kinseek.support.lazy import lazy
from kinseek.support.validation import as_float_array

from .geometry import library, triangles
from .shapes import MOST_LENGTH, MOST_TRIANGLES, Shape, box_corners, length

Array = NDArray[np.float64]

GRAIN = 1e-5
"""A point of a cloud is a triangle of this size for coal, which has no points; the cloud is larger by as much [m]."""

_MOST_CELLS = 32_768
"""Maximum number of cells of a grid along an axis, as in octomap."""


class Cloud(Shape):
    """Many equal cubes about points, made thicker by `thickness`; nothing is known of what lies between them."""

    places: Array
    """The points, (k, 3) [m]."""

    @property
    def half(self) -> float:
        """Half of the edge length of a cube [m]; by default the cubes are points."""
        return 0.0

    @property
    @abstractmethod
    def inner_radius(self) -> float:
        """Radius of a ball about each point that lies in the shape [m]."""

    @property
    def is_hull(self) -> bool:
        """False: the cubes do not fill their bounding box."""
        return False

    @lazy
    def corners(self) -> Array:
        """The corners of the bounding box of all cubes."""
        return box_corners(
            np.stack([self.places.min(axis=0) - self.half, self.places.max(axis=0) + self.half])
        )


@dataclass(frozen=True, eq=False)
class Points(Cloud):
    """A point cloud; each point is a small sphere.

    Raises:
        InvalidScene: No points, more than a million, NaN, infinity or a point farther than 1e6 m off, or not a radius from
            1e-9 m to 1e6 m.
    """

    cloud: ArrayLike
    """Points, (k, 3) [m]."""
    radius: float
    """Radius of every point [m]."""
    places: Array = field(init=False, repr=False)
    """The points as a float array, (k, 3) [m]."""

    def __post_init__(self) -> None:
        """Validate points and radius."""
        cloud = cloud_points(self.cloud)
        if len(cloud) > MOST_TRIANGLES:
            raise InvalidScene(
                f"a cloud has at most {MOST_TRIANGLES:,} points, got {len(cloud):,}: merge points that are close, "
                "simplify=0.002"
            )
        object.__setattr__(self, "cloud", cloud)
        object.__setattr__(self, "places", cloud)
        object.__setattr__(self, "radius", length("radius", self.radius))

    @classmethod
    def merged(cls, cloud: ArrayLike, radius: float, tolerance: float) -> Self:
        """Merge points of a cloud, and enlarge the radius by how far they are moved, so that no ball becomes smaller.

        Args:
            cloud: Any number of points, (k, 3) [m].
            radius: Radius of every point [m].
            tolerance: Largest motion of a point [m].

        Raises:
            InvalidScene: As of the class, or `tolerance` is no length.
        """
        points, radius = cloud_points(cloud), length("radius", radius)
        # Two points of such a cube are at most twice the tolerance apart.
        cube = np.floor(points / (length("simplify", tolerance) * 2 / np.sqrt(3.0)))
        order = np.lexsort(cube.T)
        first = np.flatnonzero((np.diff(cube[order], axis=0, prepend=np.nan) != 0).any(axis=1))
        least, most = (end.reduceat(points[order], first) for end in (np.minimum, np.maximum))
        moved = float(np.linalg.norm(most - least, axis=1).max()) / 2
        return cls((least + most) / 2, radius + moved)

    @property
    def thickness(self) -> float:
        """The radius of its points, and the size of the triangles by which coal represents them."""
        return self.radius + GRAIN

    @property
    def inner_radius(self) -> float:
        """The radius of its points."""
        return self.radius

    @property
    def excess(self) -> float:
        """The radius of its points, which coal does not include."""
        return self.radius

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        grain = GRAIN * np.array([[1.0, 0.0, 0.0], [-0.5, 0.75, 0.25], [-0.5, -0.75, -0.25]])
        vertices = (self.places[:, None] + grain).reshape(-1, 3)
        return triangles(vertices, np.arange(len(vertices)).reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class Voxels(Cloud):
    """The occupied cubes of a grid, whose first cell has a corner at the origin.

    Raises:
        InvalidScene: Not Boolean values in three dimensions, none or more than a million of them true, more than 32,768
            along an axis, or an invalid size.
    """

    occupied: ArrayLike
    """Which cells are occupied, (i, j, k) bool, along x, y and z."""
    size: float
    """Edge length of a cell [m]."""
    places: Array = field(init=False, repr=False)
    """The centres of the occupied cells, (k, 3) [m]."""

    def __post_init__(self) -> None:
        """Validate grid and size."""
        try:
            grid = np.array(self.occupied)
        except ValueError as error:
            raise InvalidScene(f"occupied must be an array with 3 dimensions: {error}") from None
        if grid.ndim != 3 or grid.dtype != np.bool_:
            raise InvalidScene(
                f"occupied must be Boolean, with 3 dimensions, got {grid.dtype} of shape {grid.shape}; compare "
                "probabilities with a threshold: grid > 0.5"
            )
        # Whether the type is plain is asked first, as in `as_float_array`.
        given: Any = self.occupied
        if type(given) is not np.ndarray and (count := int(np.ma.getmaskarray(given).sum())):
            raise InvalidScene(
                f"{count:,} of {grid.size:,} cells are masked; say whether they are occupied: occupied.filled(True)"
            )
        if max(grid.shape) > _MOST_CELLS:
            raise InvalidScene(
                f"a grid has at most {_MOST_CELLS:,} cells along each axis, got shape {grid.shape}"
            )
        cells = np.argwhere(grid)
        if not 1 <= len(cells) <= MOST_TRIANGLES:
            raise InvalidScene(
                f"a grid must have 1 to {MOST_TRIANGLES:,} occupied cells, got {len(cells):,} in a grid of shape "
                f"{grid.shape}"
            )
        size = length("size", self.size)
        if (farthest := float(size * max(grid.shape))) > MOST_LENGTH:
            raise InvalidScene(
                f"a grid must be at most {MOST_LENGTH:g} m long along each axis, got {farthest:g} m"
            )
        object.__setattr__(self, "occupied", grid)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "places", (cells + 0.5) * size)

    @property
    def half(self) -> float:
        """Half of the edge length of a cell."""
        return self.size / 2

    @property
    def inner_radius(self) -> float:
        """The radius of the ball in a cell."""
        return self.size / 2

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return library("coal").makeOctree(self.places, self.size)


def cloud_points(cloud: ArrayLike) -> Array:
    """Read the points of a cloud, (k, 3) [m].

    Raises:
        InvalidScene: There are no points, or they are not finite, have another shape, or are too far from the origin.
    """
    try:
        points = as_float_array(cloud)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidScene(f"a cloud must be numbers, (k, 3): {error}") from None
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        none = (
            "; where a camera sees nothing, remove the cloud from the scene" if points.shape == (0, 3) else ""
        )
        raise InvalidScene(f"a cloud must have shape (k, 3) with k at least 1, got {points.shape}{none}")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise InvalidScene(
            f"a cloud must be finite: {int(bad.sum()):,} of {len(points):,} points hold NaN or infinity, the first "
            f"is point {int(np.argmax(bad))}; remove them: cloud[numpy.isfinite(cloud).all(axis=1)]"
        )
    if (farthest := float(np.abs(points).max())) > MOST_LENGTH:
        raise InvalidScene(
            f"points of a cloud must lie within {MOST_LENGTH:g} m of its origin along each axis, got {farthest:g} "
            f"m: remove points that are farther away: cloud[(abs(cloud) <= {MOST_LENGTH:g}).all(axis=1)]"
        )
    return points
