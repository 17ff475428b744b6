"""Bodies of a scene for pictures: where each is, and its surface as triangles or points.

Padding, the thickness of a simplified mesh and the clearance are not part of a surface.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.robots.chain import Frame, SerialChain
from kinseek.support.transforms import square

from .bodies import Body, Part
from .clouds import Cloud, Points
from .contents import Contents
from .hulls import sides_of_hull
from .scene import Scene
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

Array = NDArray[np.float64]
Faces = NDArray[np.int64]

SIDES = 24
"""Number of sides of a round shape."""

MOST_POINTS = 20_000
"""Maximum number of points of a cloud that are drawn; if there are more, this many spread evenly among them."""

_BOX = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
"""Triangles of a box, by its corners in the order of the bits of a number, x first."""


class DrawnBody(NamedTuple):
    """A body of a scene as pictures show it."""

    name: str
    frame: Frame
    """The joint that carries it, and the pose of its first shape in that joint's frame."""
    parts: tuple[Part, ...]
    """Its shapes, with their poses relative to the first one."""
    is_link: bool
    alone: bool
    """Does it stand by itself, so that it can be moved and removed? Links, attached objects and other arms do not."""
    body: Body
    """The body of the scene."""

    @property
    def is_box(self) -> bool:
        """Is it one box?"""
        return len(self.parts) == 1 and isinstance(self.parts[0].shape, Box)

    def at(self, chain: SerialChain, q: Array) -> Array:
        """Return the pose of its first shape in the base of an arm at joint values q, (n,), as (4, 4)."""
        if not self.frame.joints:
            return self.frame.pose
        return square(forward_many(chain.arrays_to(self.frame), q[None])[0, :3])


class Outlined(NamedTuple):
    """A body of a scene as notebooks show it."""

    name: str
    kind: str
    """What it is: ``"link"``, ``"carried"``, ``"obstacle"`` or ``"other arm"``."""
    shapes: str
    corners: list[Array]
    """Points on each shape, in the base, (k, 3) [m]."""


class Surface(NamedTuple):
    """The surface of a body in the frame of its first shape."""

    vertices: Array
    """Corners of triangles, (k, 3) [m]."""
    faces: Faces
    """Indices of the corners of each triangle, (f, 3)."""
    points: Array
    """Middles of the balls or cubes of clouds, (p, 3) [m]."""
    size: float
    """Width of these [m]."""
    whole: bool
    """False if a mesh with too many triangles is replaced by the box around it."""


def drawn_bodies(scene: Contents, before: Mapping[str, DrawnBody] | None = None) -> list[DrawnBody]:
    """Return all bodies of a scene, in its order.

    Args:
        scene: The scene.
        before: What was returned for it before, by name: bodies that have not changed are returned again.
    """
    of_arms = {name for other in scene._others.values() for name in other.names}
    found, known = [], before or {}
    for body in scene._all():
        same = known.get(body.name)
        if same is not None and same.body is body:
            found.append(same)
            continue
        first = body.parts[0].pose
        back = np.linalg.inv(first)
        parts = [Part(body.parts[0].shape, np.eye(4)), *(Part(s, back @ T) for s, T in body.parts[1:])]
        frame = Frame(body.frame.joints, body.frame.pose @ first)
        alone = not (body.of_arm or body.name in of_arms)
        found.append(DrawnBody(body.name, frame, tuple(parts), body.is_link, alone, body))
    return found


def outlines(scene: Contents, q: Array) -> list[Outlined]:
    """Return the bodies of a scene with the arm at joint values q, (n,)."""
    found = []
    for body in drawn_bodies(scene):
        kinds = {type(part.shape).__name__.lower() for part in body.parts}
        shapes = kinds.pop() if len(body.parts) == 1 else f"{len(body.parts):,} shapes"
        carried = "carried" if body.body.is_attached else "obstacle" if body.alone else "other arm"
        pose = body.at(scene._chain, q)
        surfaces = [surface_of([part], MOST_POINTS) for part in body.parts]
        corners = [moved(np.concatenate([each.vertices, each.points]), pose) for each in surfaces]
        found.append(Outlined(body.name, "link" if body.is_link else carried, shapes, corners))
    return found


def bodies_hit(scene: Scene, q: Array, clearance: float = 0.0) -> set[str]:
    """Return the names of the bodies that touch another one, or come too near, at some of several joint values, (k, n)."""
    blocked = q[~np.asarray(scene.free(q, clearance), dtype=np.bool_)]
    return {name for row in blocked for one in scene.hits(row, clearance) for name in (one.a, one.b)}


def surface_of(parts: Sequence[Part], most: int) -> Surface:
    """Return the surface of the shapes of a body.

    Args:
        parts: The shapes with their poses.
        most: Maximum number of triangles of all meshes together.
    """
    vertices, faces, points = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], [np.zeros((0, 3))]
    size, count, whole = 0.0, 0, True
    for shape, pose in parts:
        if isinstance(shape, Cloud):
            step = -(-len(shape.places) // MOST_POINTS)
            points.append(moved(shape.places[::step], pose))
            size = 2.0 * (shape.radius if isinstance(shape, Points) else shape.half)
            continue
        corners, sides = _triangles(shape)
        if isinstance(shape, Mesh) and sum(map(len, faces)) + len(sides) > most:
            low, high = corners.min(axis=0), corners.max(axis=0)
            corners, sides, whole = low + (_bits() + 0.5) * (high - low), _BOX, False
        vertices.append(moved(corners, pose))
        faces.append(sides + count)
        count += len(corners)
    return Surface(np.concatenate(vertices), np.concatenate(faces), np.concatenate(points), size, whole)


def moved(points: Array, pose: Array) -> Array:
    """Return points, (k, 3), moved by a pose, (4, 4)."""
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def _bits() -> Array:
    """Return the corners of a cube of edge length 1 about the origin, (8, 3)."""
    return np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)]) - 0.5


def _triangles(shape: Shape) -> tuple[Array, Faces]:
    """Return the triangles of a shape that is no cloud."""
    if isinstance(shape, Box):
        return _bits() * np.asarray(shape.size), _BOX
    if isinstance(shape, Mesh):
        return (shape.corners, sides_of_hull(shape.corners)) if shape.hull else (shape.vertices, shape.faces)
    if isinstance(shape, Cylinder):
        half = shape.length / 2
        return _turned([(0.0, -half), (shape.radius, -half), (shape.radius, half), (0.0, half)])
    assert isinstance(shape, Sphere | Capsule)
    half = shape.length / 2 if isinstance(shape, Capsule) else 0.0
    angles = np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1)
    angles = np.sort(np.append(angles, 0.0)) if half else angles  # The equator is at both ends of a capsule.
    ends = np.where(np.arange(len(angles)) < len(angles) / 2, -half, half)
    return _turned(np.column_stack([shape.radius * np.cos(angles), shape.radius * np.sin(angles) + ends]))


def _turned(profile: Collection[Sequence[float]] | Array) -> tuple[Array, Faces]:
    """Return the surface of a profile of radii and heights, (k, 2) [m], that turns about the z axis."""
    rings = np.array(list(profile))
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    flat = rings[:, None, :1] * around
    heights = np.broadcast_to(rings[:, None, 1:], (len(rings), SIDES, 1))
    # All corners of a ring without a radius are its first one, and triangles without area are left out.
    wide = rings[:, :1] > 1e-9 * rings[:, 0].max()
    number = np.where(wide, np.arange(SIDES), 0) + SIDES * np.arange(len(rings))[:, None]
    beside = np.roll(number, -1, axis=1)
    quads = np.stack([number[:-1], beside[:-1], beside[1:], number[1:]], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    solid = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return np.concatenate([flat, heights], axis=-1).reshape(-1, 3), faces[solid].astype(np.int64)
