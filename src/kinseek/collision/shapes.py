"""Shapes of bodies, points whose hull contains them, and their conversion for coal.

Every shape lies in the hull of its `corners`, made thicker by its `thickness`. Conservative bounds, such as outer spheres
and the reach of its points, are computed from these two alone.
"""

from __future__ import annotations

import hashlib
import os
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidRobot, InvalidScene, MissingExtra
from kinseek.robots.files import home_path
from kinseek.support.interrupts import uninterrupted
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.validation import as_flag, as_float_array, is_finite_number

from .geometry import library, triangles
from .hulls import convex_hull
from .interior import NOTHING, Interior
from .simplify import simplified

if TYPE_CHECKING:
    from kinseek.meshes.process import MeshReader


Array = NDArray[np.float64]

MOST_TRIANGLES = 1_000_000
"""Maximum number of triangles of one mesh, and of points of one cloud. coal takes about 5 s for its tree of a million, and
nothing interrupts it meanwhile."""

MOST_BYTES = 2**30
"""Maximum size of the file of one mesh: it may have more triangles than allowed, and be simplified."""

MOST_LENGTH, LEAST_LENGTH = 1e6, 1e-9
"""Largest coordinate and size of a shape, and its least size [m]. Distances from boxes, hulls and triangles of the largest
size are right to 1e-9 m, and at ten times that size some are 0 for bodies that are metres apart."""

_LEAST_THICKNESS = 1e-12
"""Least thickness of a mesh that has a hull, relative to its largest coordinate: 5,000 times the rounding of that. coal
loses corners of some hulls thinner than 3e-14, and ends the process for some thinner than 6e-14."""

_SIDES = 16
"""Number of sides of the prism around a cylinder."""


@dataclass(frozen=True, eq=False)
class Shape(Lazy, ABC):
    """A shape in its own frame, lengths in [m]; equal to another one of its kind with the same measures."""

    @lazy
    def _digest(self) -> bytes:
        """A digest of its kind and its measures."""
        sha = hashlib.sha256(type(self).__name__.encode())
        for numbers in measures_of(self):
            sha.update(repr(numbers.shape).encode())
            sha.update(numbers.tobytes())
        return sha.digest()

    def __eq__(self, other: object) -> bool:
        """Return whether the other one is an equal shape."""
        return other is self or (isinstance(other, Shape) and self._digest == other._digest)

    def __hash__(self) -> int:
        """Return equal numbers for equal shapes."""
        return hash(self._digest)

    @property
    def thickness(self) -> float:
        """Bound on how far the shape extends beyond the hull of its corners [m]."""
        return 0.0

    @lazy
    @abstractmethod
    def corners(self) -> Array:
        """Points whose hull, made thicker by `thickness`, contains the shape, (k, 3) [m]."""

    @property
    def is_hull(self) -> bool:
        """Is the shape equal to that thickened hull?"""
        return True

    @property
    def inner_corners(self) -> Array:
        """Points whose hull, made thicker by `thickness`, lies inside the shape, (k, 3) [m]; empty if none are known."""
        return self.corners if self.is_hull else np.zeros((0, 3))

    @abstractmethod
    def geometry(self) -> Any:
        """Return the geometry for coal."""

    @property
    def excess(self) -> float:
        """How much larger the shape is than its geometry for coal [m]."""
        return 0.0


@dataclass(frozen=True, eq=False)
class Box(Shape):
    """A box about the origin.

    Raises:
        InvalidScene: Not three lengths from 1e-9 m to 1e6 m.
    """

    size: ArrayLike
    """Edge lengths along x, y and z [m]."""

    def __post_init__(self) -> None:
        """Validate the size."""
        object.__setattr__(self, "size", lengths("size", self.size, 3))

    @lazy
    def corners(self) -> Array:
        """The eight corners."""
        signs = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)
        return np.asarray(signs * self.size)

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return library("coal").Box(*np.asarray(self.size))


@dataclass(frozen=True, eq=False)
class Sphere(Shape):
    """A sphere about the origin.

    Raises:
        InvalidScene: Not a radius from 1e-9 m to 1e6 m.
    """

    radius: float
    """Radius [m]."""

    def __post_init__(self) -> None:
        """Validate the radius."""
        object.__setattr__(self, "radius", length("radius", self.radius))

    @property
    def thickness(self) -> float:
        """Its radius."""
        return self.radius

    @lazy
    def corners(self) -> Array:
        """Its centre."""
        return np.zeros((1, 3))

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return library("coal").Sphere(self.radius)


@dataclass(frozen=True, eq=False)
class Cylinder(Shape):
    """A cylinder about the z axis, centred at the origin as in URDF.

    Raises:
        InvalidScene: Not a radius and a length from 1e-9 m to 1e6 m.
    """

    radius: float
    """Radius [m]."""
    length: float
    """Length [m]."""

    def __post_init__(self) -> None:
        """Validate radius and length."""
        object.__setattr__(self, "radius", length("radius", self.radius))
        object.__setattr__(self, "length", length("length", self.length))

    @property
    def is_hull(self) -> bool:
        """False: the hull of its corners is a prism around it."""
        return False

    @property
    def inner_corners(self) -> Array:
        """The corners of a prism inside it."""
        return np.asarray(self.corners * [np.cos(np.pi / _SIDES), np.cos(np.pi / _SIDES), 1.0])

    @lazy
    def corners(self) -> Array:
        """The corners of a prism around it."""
        angles = np.arange(_SIDES) * 2 * np.pi / _SIDES
        ring = self.radius / np.cos(np.pi / _SIDES) * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        ends = [np.column_stack([ring, np.full(_SIDES, z)]) for z in (-self.length / 2, self.length / 2)]
        return np.concatenate(ends)

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return library("coal").Cylinder(self.radius, self.length)


@dataclass(frozen=True, eq=False)
class Capsule(Shape):
    """All points within `radius` of a segment of the z axis, centred at the origin.

    Raises:
        InvalidScene: Not a radius and a length from 1e-9 m to 1e6 m.
    """

    radius: float
    """Radius [m]."""
    length: float
    """Length of the segment, without the round ends [m]."""

    def __post_init__(self) -> None:
        """Validate radius and length."""
        object.__setattr__(self, "radius", length("radius", self.radius))
        object.__setattr__(self, "length", length("length", self.length))

    @property
    def thickness(self) -> float:
        """Its radius."""
        return self.radius

    @lazy
    def corners(self) -> Array:
        """Both ends of the segment."""
        return np.array([[0.0, 0.0, -self.length / 2], [0.0, 0.0, self.length / 2]])

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return library("coal").Capsule(self.radius, self.length)


@dataclass(frozen=True, eq=False)
class Mesh(Shape):
    """Triangles, or their convex hull. `Mesh.read` reads them from a file.

    Raises:
        InvalidScene: No triangles, NaN, a vertex farther than 1e6 m off, no size of at least 1e-9 m, more than a million
            triangles that are no hull. When its hull is first needed: more than 18,000 points that may be corners of it.
    """

    vertices: Array
    """Vertices, (k, 3) [m]."""
    faces: NDArray[np.int64]
    """Indices of the vertices of each triangle, (f, 3)."""
    hull: bool = True
    """Is its convex hull used? The hull contains the mesh, so free of the hull implies free of the mesh."""
    name: str = "the mesh"
    """Name for messages."""
    thicker: float = 0.0
    """Added to it on every side to make up for simplification [m]."""
    boxed: bool = False
    """Do first checks take the bounding box of its triangles, which costs less than their hull? Results are the same."""
    bounds: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    """Of a mesh that was simplified: what its triangles bounded before, (f, 2), see `Interior.bounds`."""
    times: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Of a mesh that was simplified: how often its triangles count in their surfaces, (f,), see `Interior.times`."""

    def __post_init__(self) -> None:
        """Validate the mesh."""
        try:
            vertices, faces = as_float_array(self.vertices), as_float_array(self.faces)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidScene(f"{self.name}: expected vertices (k, 3) and faces (f, 3): {error}") from None
        if any(each.shape != (0,) and (each.ndim != 2 or each.shape[1] != 3) for each in (vertices, faces)):
            raise InvalidScene(
                f"{self.name}: expected vertices (k, 3) and faces (f, 3), got {vertices.shape} and {faces.shape}"
            )
        if not len(faces) or not len(vertices):
            raise InvalidScene(f"{self.name} is empty: it has no triangles")
        if len(faces) > MOST_TRIANGLES and not self.hull:
            raise InvalidScene(
                f"{self.name} holds {len(faces):,} triangles, expected at most {MOST_TRIANGLES:,}: use its hull, "
                "hull=True, or simplify it by at most a length in metres, simplify=0.001"
            )
        _require_measure(vertices, self.name)
        if not ((faces >= 0) & (faces < len(vertices)) & (faces == np.floor(faces))).all():
            raise InvalidScene(f"{self.name}: a face refers to a vertex that does not exist")
        object.__setattr__(self, "hull", as_flag(f"{self.name}: hull", self.hull, InvalidScene))
        object.__setattr__(self, "thicker", length_or_zero(f"{self.name}: thicker", self.thicker))
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces.astype(np.int64))

    @classmethod
    def read(
        cls,
        path: str | Path,
        scale: ArrayLike = 1.0,
        hull: bool = True,
        simplify: float | None = None,
        *,
        reader: MeshReader | None = None,
    ) -> Mesh:
        """Read an STL, OBJ, PLY, GLB or DAE (COLLADA) file, with all bodies in it merged.

        Args:
            path: The file.
            scale: One factor, or one along each axis.
            hull: See the field.
            simplify: Merge vertices such that no point moves farther than this [m]. The mesh is then made thicker by the
                distance that points have moved, so that free of it implies free of the original mesh.
            reader: The reader of all meshes of a file, which share its limits.

        Raises:
            InvalidScene: The file is missing, of another kind, cannot be read, would take more memory or time than a mesh or
                the reader allows, or has no triangles; or `simplify` is not a length.
            MissingExtra: trimesh is not installed.
        """
        if reader is None:
            with reader_of_shapes() as alone:
                return cls.read(path, scale, hull, simplify, reader=alone)
        try:
            parts = reader.read(file_path(path), MOST_BYTES)
        except ImportError:
            raise MissingExtra("A scene with collisions", "collision") from None
        except InvalidRobot as error:
            raise InvalidScene(str(error)) from error
        try:
            factors = np.broadcast_to(as_float_array(scale), (3,))
        except (TypeError, ValueError, OverflowError):
            factors = np.zeros(3)
        if not np.isfinite(factors).all() or not factors.all():
            raise InvalidScene(f"scale must be one number or three, other than 0, got {scale!r:.80}")
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        with np.errstate(over="ignore"):  # Infinity is refused below.
            vertices = np.concatenate([part.vertices for part in parts]) * factors
        faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
        vertices, faces = _merged(vertices, faces)
        if simplify is None:
            return cls(vertices, faces, hull, repr(str(path)))
        whole, tolerance = cls(vertices, faces, True, repr(str(path))), length("simplify", simplify)
        vertices, faces, moved, source = uninterrupted(
            lambda: simplified(whole.vertices, whole.faces if hull else whole.interior.faces, tolerance)
        )
        if hull:
            return cls(vertices, faces, hull, repr(str(path)), moved)
        # No point that is farther from the simplified surface than `moved` changes sides when the vertices move.
        bounds = np.where(source[:, None] < 0, NOTHING, whole.interior.bounds[source])
        times = whole.interior.times[source]
        return cls(vertices, faces, hull, repr(str(path)), moved, bounds=bounds, times=times)

    @property
    def thickness(self) -> float:
        """The bound on motion by simplification."""
        return self.thicker

    @property
    def excess(self) -> float:
        """The bound on motion by simplification, which coal does not include."""
        return self.thicker

    @property
    def is_hull(self) -> bool:
        """Is its hull used?"""
        return self.hull

    @property
    def corners(self) -> Array:
        """The corners of its hull; or of its bounding box if it is `boxed`, or if it is no hull and none can be made."""
        return self._corners[0]

    @property
    def cost(self) -> int:
        """Number of corners of the hull that was made for it, or of points from which none could be made."""
        return self._corners[1]

    @lazy
    def _corners(self) -> tuple[Array, int]:
        """The corners and the cost."""
        if not self._is_solid:
            return self.vertices, len(self.vertices)
        if self.boxed:
            return box_corners(self.vertices), 0
        try:
            points = np.array(self._hull.points())
        except InvalidScene:
            if self.hull:
                raise
            return box_corners(self.vertices), len(self.vertices)
        return points, len(points)

    @property
    def closed(self) -> bool:
        """Is every surface of it closed, so that it has an inside?"""
        return self.interior.closed

    @lazy
    def interior(self) -> Interior:
        """Its closed surfaces, which are solid or cavities.

        Raises:
            InvalidScene: To find its cavities takes too long.
        """
        try:
            known = (self.bounds, self.times) if len(self.bounds) else None
            return Interior(self.vertices, self.faces, known)
        except InvalidScene as error:
            raise InvalidScene(f"{self.name}: {error}") from None

    def holds(self, point: Array) -> bool:
        """Return whether a point (3,) lies inside of a closed surface of it, and in no cavity of that surface."""
        if (point < self._least).any() or (point > self._most).any():
            return False
        return self.interior.holds(point)

    def geometry(self) -> Any:
        """Return the geometry for coal."""
        return self._hull if self.hull else self._triangles

    @lazy
    def _triangles(self) -> Any:
        """The tree of triangles for coal, shared by all bodies that have this mesh."""
        return triangles(self.vertices, self.faces)

    @lazy
    def _least(self) -> Array:
        return np.asarray(self.vertices.min(axis=0))

    @lazy
    def _most(self) -> Array:
        return np.asarray(self.vertices.max(axis=0))

    @lazy
    def _is_solid(self) -> bool:
        """Do the vertices span all three directions, so that they have a hull?"""
        off = self.vertices - self.vertices.mean(axis=0)
        spread = np.linalg.svd(off.T @ off, compute_uv=False)
        rounding = len(off) * (_LEAST_THICKNESS * np.abs(self.vertices).max()) ** 2
        return bool(spread[2] > max(1e-12 * max(spread[0], 1e-30), rounding))

    @lazy
    def _hull(self) -> Any:
        if not self._is_solid:
            raise InvalidScene(
                f"{self.name} is flat, or too thin for its distance from its origin: it has no convex hull; use its "
                "triangles, hull=False"
            )
        return convex_hull(self.vertices, self.name)


def measures_of(shape: Shape) -> list[NDArray[Any]]:
    """Return all numbers of a shape: what two shapes of one kind differ by, other than a name and random factors."""
    names = [item.name for item in fields(shape) if item.name not in ("name", "times")]
    return [np.ascontiguousarray(getattr(shape, name)) for name in names]


def digest_of(shape: Shape) -> bytes:
    """Return a digest that is the same for equal shapes only."""
    return shape._digest


def file_path(path: Any) -> Path:
    """Read the path of a file, with ``~`` for the home folder.

    Raises:
        InvalidScene: It is no path.
    """
    if not isinstance(path, str | os.PathLike):
        raise InvalidScene(f"expected the path of a file, got {path!r:.80}")
    return home_path(path)


def box_corners(points: Array) -> Array:
    """Return the corners of the bounding box of points, (k, 3) -> (8, 3)."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)


def _merged(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Make one of vertices with equal coordinates, in the order in which they come first."""
    rows = (
        np.ascontiguousarray(vertices + 0.0).view("V24").ravel()
    )  # Without minus zeros, whose bits are others.
    _, first, same = np.unique(rows, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return vertices[first[order]], rank[same.ravel()][faces]


def reader_of_shapes() -> MeshReader:
    """Return a reader for the meshes of one file, without their colours and images."""
    from kinseek.meshes.limits import Budget
    from kinseek.meshes.process import MeshReader

    return MeshReader(Budget(2 * MOST_BYTES), looks=False)


def length(name: str, value: Any, least: float = LEAST_LENGTH) -> float:
    """Read a length above 0, from `least` to `MOST_LENGTH` [m].

    Raises:
        InvalidScene: It is invalid.
    """
    return float(lengths(name, [value], 1, least)[0])


def length_or_zero(name: str, value: Any) -> float:
    """Read a length from 0 to `MOST_LENGTH` [m].

    Raises:
        InvalidScene: It is invalid.
    """
    if is_finite_number(value) and value == 0:
        return 0.0
    try:
        return length(name, value, 0.0)
    except InvalidScene:
        raise InvalidScene(
            f"{name} must be a length of at least 0 m, and at most {MOST_LENGTH:g} m, got {value!r:.200}"
        ) from None


def lengths(name: str, values: Any, count: int, least: float = LEAST_LENGTH) -> Array:
    """Read so many lengths above 0, from `least` to `MOST_LENGTH` [m].

    Raises:
        InvalidScene: They are invalid.
    """
    try:
        found = as_float_array(values)
    except (TypeError, ValueError, OverflowError):
        found = np.array([np.nan])
    what = "a length" if count == 1 else f"{count} lengths"
    got = values[0] if count == 1 else values
    if found.shape != (count,) or not np.isfinite(found).all() or not (found > 0).all():
        raise InvalidScene(f"{name} must be {what} above 0 m, got {got!r:.200}")
    if found.min() < least or found.max() > MOST_LENGTH:
        raise InvalidScene(f"{name} must be {what} from {least:g} m to {MOST_LENGTH:g} m, got {got!r:.200}")
    return found


def _require_measure(vertices: Array, name: str) -> None:
    """Make sure that the vertices of a mesh are near enough to its origin, and that it is no point.

    Raises:
        InvalidScene: They are not.
    """
    if not np.isfinite(vertices).all():
        raise InvalidScene(f"{name}: a vertex holds NaN or infinity")
    if (farthest := float(np.abs(vertices).max())) > MOST_LENGTH:
        raise InvalidScene(
            f"{name}: vertices must lie within {MOST_LENGTH:g} m of its origin along each axis, got {farthest:g} m; "
            "if they are not in metres, give scale="
        )
    if (largest := float(np.ptp(vertices, axis=0).max())) < LEAST_LENGTH:
        raise InvalidScene(
            f"{name}: a mesh must be at least {LEAST_LENGTH:g} m long along one axis, got {largest:g} m"
        )
