"""Grids of poses: boxes of positions, or rings about the first joint's axis, times orientations."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidMap
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.support.lazy import Lazy, lazy

from .orientations import Orientations, about_z, orientations_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Range = tuple[float, float, float]
"""Lower end, upper end, and width of a cell [m]."""

MOST = 10**11
"""Maximum number of cells of a grid."""

MOST_PLACES = 2**22
"""Maximum number of cells along one dimension of positions, whose centres are kept."""

BLOCK = 524_288
"""Approximate number of poses of a block: a tenth of a second to some seconds of one core."""

_FITS = 1e-6
"""Tolerance, as a fraction of a cell, for a range to be a whole number of cells: numbers such as 0.05 are rounded."""


class Cells(Lazy):
    """The common base of both kinds of grid. Positions are along `places`; orientations are the last dimension."""

    names: ClassVar[tuple[str, ...]]
    """Dimensions before that of orientations."""
    rows: ClassVar[tuple[int, ...]]
    """Coordinates of a pose's position that these dimensions are."""
    orientations: Orientations

    @lazy
    def places(self) -> tuple[Array, ...]:
        """Centres of the cells along each dimension before the last [m]."""
        ranges = (getattr(self, name) for name in self.names)
        return tuple(low + step * (np.arange(_count(low, high, step)) + 0.5) for low, high, step in ranges)

    @property
    def widths(self) -> tuple[float, ...]:
        """Widths of a cell along each dimension before the last [m]."""
        return tuple(float(getattr(self, name)[2]) for name in self.names)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of cells along each dimension, orientations last."""
        return (*(_count(*getattr(self, name)) for name in self.names), len(self.orientations))

    @property
    def dims(self) -> tuple[str, ...]:
        """Names of the dimensions."""
        return (*self.names, "orientation")

    @property
    def size(self) -> int:
        """Total number of cells."""
        return int(np.prod([float(n) for n in self.shape]))

    @property
    def half_diagonal(self) -> float:
        """Largest distance of a position in a cell from its centre [m]."""
        return float(np.linalg.norm(self.widths)) / 2

    def chunks(self, poses: int = BLOCK) -> tuple[int, ...]:
        """Return the shape of blocks of about `poses` poses: a cube of positions with as many orientations as fit.

        If a grid is thinner than that cube, its blocks are longer along the other dimensions.
        """
        if self.size <= poses:
            return self.shape
        turns = min(self.shape[-1], poses)
        positions = self.shape[:-1]
        sides, left = [1] * len(positions), poses // turns
        for done, k in enumerate(sorted(range(len(positions)), key=positions.__getitem__)):
            sides[k] = max(1, min(positions[k], round(left ** (1.0 / (len(positions) - done)))))
            left //= sides[k]
        return (*sides, turns)

    def middles(self, cells: Indices) -> Array:
        """Return the poses at the centres of some cells, (k, 4, 4), lengths in [m].

        Args:
            cells: Indices of each cell along every dimension, (k, d).
        """
        T = np.tile(np.eye(4), (len(cells), 1, 1))
        T[:, :3, :3] = self.orientations.matrices[cells[:, -1]]
        for k, row in enumerate(self.rows):
            T[:, row, 3] = self.places[k][cells[:, k]]
        return T

    def description(self) -> dict[str, Any]:
        """Return the definition of the grid, as JSON takes it."""
        ranges = {name: list(map(float, getattr(self, name))) for name in self.names}
        turns = {"orientations": len(self.orientations), "directions": len(self.orientations.regions)}
        digest = hashlib.sha256(np.ascontiguousarray(self.orientations.regions).tobytes()).hexdigest()
        return {"kind": type(self).__name__, **ranges, **turns, "orientations_digest": digest[:16]}

    def _check(self) -> None:
        for name in self.names:
            object.__setattr__(self, name, _range(name, getattr(self, name)))
        if not isinstance(self.orientations, Orientations):
            got = type(self.orientations).__name__
            raise InvalidMap(f"orientations must be made by maps.orientations(count), got {got}")
        if self.size > MOST:
            hours, room = self.size * 3e-6 / 3600, self.size / 1e9
            raise InvalidMap(
                f"a grid of {self.size:.3g} cells ({' x '.join(map(str, self.shape))}) is too large: even at 3 µs a cell it "
                f"takes {hours:,.0f} core-hours, and {room:,.0f} GB a variable; a map has at most {MOST:,} cells. Widen the "
                f"step, take fewer orientations, map a part, or divide out the first joint with Rings"
            )

    def _index(self, name: str, values: Array) -> Indices:
        low, high, step = getattr(self, name)
        cell = np.floor((values - low) / step).astype(np.int64)
        # A value at an end of the range may lie outside by a rounding; it belongs to the cell there.
        inside = (values >= low - _FITS * step) & (values <= high + _FITS * step)
        return np.where(inside, np.clip(cell, 0, _count(low, high, step) - 1), -1)


@dataclass(frozen=True, eq=False)
class Grid(Cells):
    """Boxes of positions in the arm's base, times orientations of its tip.

    Raises:
        InvalidMap: An invalid range, or more cells than a map can have.
    """

    names: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    rows: ClassVar[tuple[int, ...]] = (0, 1, 2)
    x: Range
    """Lower end, upper end, and width of a cell [m]; the cells fill the range."""
    y: Range
    z: Range
    orientations: Orientations
    """A grid on SO(3), see `kinseek.maps.orientations`."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        self._check()

    def poses(self, part: Sequence[slice]) -> Array:
        """Return the poses at the centres of some cells, (a, b, c, k, 4, 4), lengths in [m].

        Args:
            part: Range of cells along each dimension.
        """
        x, y, z = (each[some] for each, some in zip(self.places, part, strict=False))
        turns = self.orientations.matrices[part[-1]]
        T = np.zeros((len(x), len(y), len(z), len(turns), 4, 4))
        T[..., 3, 3] = 1.0
        T[..., :3, :3] = turns
        T[..., 0, 3] = x[:, None, None, None]
        T[..., 1, 3] = y[:, None, None]
        T[..., 2, 3] = z[:, None]
        return T

    def cells_of(self, T: ArrayLike) -> tuple[Indices, ...]:
        """Return the indices of the cells that contain poses, one array (...) per dimension; -1 outside the grid.

        Args:
            T: Poses, (..., 4, 4), lengths in [m].
        """
        poses = np.asarray(T, dtype=float)
        where = (self._index(name, poses[..., k, 3]) for k, name in enumerate(self.names))
        return (*where, self.orientations.nearest(poses[..., :3, :3]))

    @property
    def volume(self) -> float:
        """Volume of the boxes of positions [m³]."""
        return float(np.prod([len(each) for each in self.places]) * np.prod(self.widths))


@dataclass(frozen=True, eq=False)
class Rings(Cells):
    """Rings of poses about the axis of an arm's first joint, times orientations: one plane of cells represents all of them.

    A pose rotated about the first axis needs a change of the first joint only. So a position is given by its distance from
    the axis and its height along it, measured in the frame of the first joint. Orientations are those of the rotated pose in
    the plane of that frame's x and z axes.

    Raises:
        InvalidMap: An invalid range, a negative radius, or more cells than a map can have.
    """

    names: ClassVar[tuple[str, ...]] = ("radius", "height")
    rows: ClassVar[tuple[int, ...]] = (0, 2)
    radius: Range
    """Distance from the first axis: lower end, upper end, and width of a cell [m]."""
    height: Range
    """Height along the first axis, from the origin of the first joint's frame: lower end, upper end, and width of a cell
    [m].
    """
    orientations: Orientations
    """A grid on SO(3), see `kinseek.maps.orientations`."""

    def __post_init__(self) -> None:
        """Validate the ranges."""
        self._check()
        if self.radius[0] < 0.0:
            raise InvalidMap(f"radius begins at {self.radius[0]:g} m; a distance from an axis is at least 0")

    def poses(self, part: Sequence[slice]) -> Array:
        """Return the poses at the centres of some cells in the first joint's frame, (a, b, k, 4, 4), lengths in [m].

        Args:
            part: Range of cells along each dimension.
        """
        radius, height = (each[some] for each, some in zip(self.places, part, strict=False))
        turns = self.orientations.matrices[part[-1]]
        T = np.zeros((len(radius), len(height), len(turns), 4, 4))
        # In the plane of x and z of the first joint: turns about its axis give all other positions of a ring.
        T[..., 3, 3] = 1.0
        T[..., :3, :3] = turns
        T[..., 0, 3] = radius[:, None, None]
        T[..., 2, 3] = height[:, None]
        return T

    def cells_of(self, T: ArrayLike) -> tuple[Indices, ...]:
        """Return the indices of the cells that contain poses, one array (...) per dimension; -1 outside the grid.

        Args:
            T: Poses in the first joint's frame, (..., 4, 4), lengths in [m].
        """
        poses = np.asarray(T, dtype=float)
        back = about_z(-azimuths(poses))
        radius = np.hypot(poses[..., 0, 3], poses[..., 1, 3])
        where = self._index("radius", radius), self._index("height", poses[..., 2, 3])
        return (*where, self.orientations.nearest(back @ poses[..., :3, :3]))

    @property
    def volume(self) -> float:
        """Volume of the rings of positions [m³]."""
        low, high, _ = self.radius
        return float(np.pi * (high**2 - low**2) * (self.height[1] - self.height[0]))


def azimuths(T: Array) -> Array:
    """Return the azimuth of poses in the first joint's frame, (..., 4, 4), from its x axis about its axis, (...) [rad]."""
    return np.asarray(np.arctan2(T[..., 1, 3], T[..., 0, 3]))


def grid_of(description: dict[str, Any]) -> Grid | Rings:
    """Make the grid from `Cells.description`; the last few are cached.

    Raises:
        InvalidMap: The description is not of a grid, or another version made its orientations.
    """
    return _grid_of(json.dumps(description))


@lru_cache(maxsize=8)
def _grid_of(text: str) -> Grid | Rings:
    description = json.loads(text)
    try:
        kind: Any = {"Grid": Grid, "Rings": Rings}[description["kind"]]
        turns = orientations_of(description["orientations"], description["directions"])
        ranges = [tuple(description[name]) for name in kind.names]
    except (KeyError, TypeError) as error:
        raise InvalidMap(f"the description of the map's grid is invalid: {error!r:.200}") from None
    grid: Grid | Rings = kind(*ranges, turns)
    # The description contains a digest of the orientations.
    if json.dumps(grid.description()) != text:
        raise InvalidMap(
            "the map's orientations are not those that this version of kinseek makes of their number"
        )
    return grid


def _range(name: str, given: Any) -> Range:
    try:
        low, high, step = (float(each) for each in given)
    except (TypeError, ValueError, OverflowError):
        raise InvalidMap(f"{name} must be (from, to, step) [m], got {given!r}") from None
    if not np.isfinite([low, high, step]).all() or step <= 0.0 or high <= low:
        raise InvalidMap(f"{name} must have from < to and a positive step, got ({low:g}, {high:g}, {step:g})")
    if max(abs(low), abs(high)) > LARGEST:
        raise InvalidMap(
            f"{name} must lie within {LARGEST:g} m of the origin, got ({low:g}, {high:g}, {step:g})"
        )
    cells = (high - low) / step
    if cells > MOST_PLACES:
        raise InvalidMap(
            f"{name} has {cells:.10g} cells, expected at most {MOST_PLACES:,} along one axis; increase the step"
        )
    if abs(cells - max(1, round(cells))) > _FITS * max(1.0, cells):
        raise InvalidMap(
            f"the step of {name} must divide its range: {high:g} - {low:g} is {cells:.6g} steps of {step:g}; "
            f"take ({low:g}, {low + np.ceil(cells) * step:g}, {step:g})"
        )
    return low, high, step


def _count(low: float, high: float, step: float) -> int:
    return max(1, round((high - low) / step))
