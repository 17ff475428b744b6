"""Triangles of the polygons in mesh files."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot

from .limits import Size, at_most

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_FLAT = 1e-6
"""Area of a polygon that is a line, for a length of 1."""
_ROUNDING = 1e-4
"""How far triangles may reach out of a polygon, for a length of 1: rounding moves the points of a straight edge."""
_MOST_TURNS = 2**24
"""Most corners, squared for each polygon, of polygons that are not convex: trying their diagonals takes some seconds."""
_AT_ONCE = 2**20
"""Corners of polygons that are examined together, and most corners of one polygon: each takes some 400 bytes then."""


class Body(NamedTuple):
    """Triangles of a mesh file with one look."""

    vertices: Array
    """(n, 3), in the unit of the file."""
    faces: Indices
    """(m, 3), counted from 0."""
    vertex_colours: NDArray[Any] | None = None
    """Colours of the vertices, (n, 3 or 4), or of the corners, (m, 3, 3 or 4)."""
    face_colours: NDArray[Any] | None = None
    material: str = ""
    """Name of the material in OBJ; empty without one."""
    uv: Array | None = None
    """Coordinates in the image of the material: (m, 3, 2) of the corners, or (n, 2) of the vertices."""
    normals: Array | None = None
    """Directions of the surface, for shading: (m, 3, 3) at the corners, or (n, 3) at the vertices, as `uv`."""


Looks = dict[str, dict[str, Any]]
"""Materials of a file by name: arguments of trimesh's `PBRMaterial`. An image is given as its bytes, or as the name of its
file."""


def placed(body: Body, matrix: Array) -> Body:
    """Return a body moved by a matrix, (4, 4).

    A matrix that mirrors it turns its triangles around, too, so that their outer sides stay outside.
    """
    linear, normals, uv = matrix[:3, :3], body.normals, body.uv
    with np.errstate(over="ignore", invalid="ignore"):  # Who reads the file rejects what is not finite then.
        vertices = body.vertices @ linear.T + matrix[:3, 3]
        sign = np.linalg.slogdet(linear)[0]  # The determinant itself may underflow.
        turn = slice(None, None, -1) if sign < 0 else slice(None)
        if normals is not None:
            # The cofactors are the inverse transpose, times the determinant, and exist without an inverse.
            unit = linear / (
                np.abs(linear).max() or 1.0
            )  # Products of its numbers neither overflow nor vanish.
            cofactors = np.stack([np.cross(unit[(i + 1) % 3], unit[(i + 2) % 3]) for i in range(3)])
            normals = normals @ cofactors.T * (sign or 1.0)
            lengths = np.linalg.norm(normals, axis=-1, keepdims=True)
            normals = normals / np.where(lengths > 0, lengths, 1)
    uv, normals, colours = (
        each[:, turn] if each is not None and each.ndim == 3 else each
        for each in (uv, normals, body.vertex_colours)
    )
    return body._replace(
        vertices=vertices, faces=body.faces[:, turn], uv=uv, normals=normals, vertex_colours=colours
    )


def triangulated(
    vertices: Array,
    corners: Indices,
    sizes: Indices,
    place: Callable[[int], str],
    take: Callable[[Size], object],
    first: int = 0,
) -> tuple[Indices, Indices]:
    """Divide polygons into triangles, by the diagonals from one of their corners.

    It is the first corner from which all diagonals lie inside the polygon: the first one of a convex polygon.

    Args:
        vertices: (n, 3).
        corners: Vertices of all polygons, one after the other.
        sizes: Number of corners of each polygon.
        place: Returns where the polygon is in the file, for errors.
        take: Is given the corners of polygons of which another corner is tried, before it is tried.
        first: Number of the first vertex in the file.

    Returns:
        Positions in `corners` of the triangles, (m, 3), in the order of the polygons, which separates surfaces that touch
        each other; and the polygon of each triangle, (m,).

    Raises:
        InvalidRobot: A polygon has fewer than 3 corners, names a vertex that does not exist or is not finite, or has no
            such corner, as polygons that cross themselves.
    """
    if len(few := np.flatnonzero(sizes < 3)):
        raise InvalidRobot(f"{place(few[0])}: a face has {sizes[few[0]]} corners, expected at least 3")
    starts = np.cumsum(sizes) - sizes
    if len(wrong := np.flatnonzero((corners < 0) | (corners >= len(vertices)))):
        face = int(np.searchsorted(starts, wrong[0], side="right")) - 1
        raise InvalidRobot(
            f"{place(face)}: a face has the index {corners[wrong[0]] + first}, expected one from {first} to "
            f"{len(vertices) - 1 + first}: a vertex that does not exist"
        )
    is_finite = np.asarray(np.isfinite(vertices).all(axis=1))
    if len(wrong := np.flatnonzero(~is_finite[corners])):
        face = int(np.searchsorted(starts, wrong[0], side="right")) - 1
        raise InvalidRobot(f"{place(face)}: a vertex is not of three finite numbers")
    turns, triangles, owners = 0, [np.zeros((0, 3), np.int64)], [np.zeros(0, np.int64)]
    order = np.argsort(sizes, kind="stable")
    for same in np.split(order, np.flatnonzero(np.diff(sizes[order])) + 1):
        size = int(sizes[same[0]]) if len(same) else 3
        at_most(size, _AT_ONCE, "corners of one polygon")
        fan = np.stack([np.zeros(size - 2, np.int64), np.arange(1, size - 1), np.arange(2, size)], axis=1)
        for part in np.array_split(same, len(same) * size // _AT_ONCE + 1):
            begin = starts[part][:, None, None]
            places = begin + fan
            left = np.flatnonzero(~_inside(vertices[corners[places]])) if size > 3 else part[:0]
            turns += len(left) * size**2
            at_most(turns, _MOST_TURNS, "corners of polygons that are not convex, squared for each,")
            for turn in range(1, size) if len(left) else ():
                take(Size(0, 0, len(left) * size))
                places[left] = begin[left] + (fan + turn) % size
                left = left[~_inside(vertices[corners[places[left]]])]
            if len(left):
                raise InvalidRobot(
                    f"{place(part[left[0]])}: a polygon of {size} corners crosses itself, or no corner of it sees all "
                    "others; write it as triangles"
                )
            triangles.append(places.reshape(-1, 3))
            owners.append(np.repeat(part, size - 2))
    owner = np.concatenate(owners)
    in_order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[in_order], owner[in_order]


def _inside(points: Array) -> NDArray[np.bool_]:
    """Return which polygons have all their triangles, (k, m, 3, 3), on one side: then none reaches out of the polygon."""
    edges = points[:, :, 1:] / 2 - points[:, :, :1] / 2  # Halves do not overflow.
    largest = np.abs(edges).max(axis=(1, 2, 3), keepdims=True, initial=0)
    edges /= np.where(largest > 0, largest, 1)  # Neither do the squares then, nor do they vanish.
    normals = np.cross(edges[:, :, 0], edges[:, :, 1])
    whole = normals.sum(axis=1)  # The normal of the polygon, by Newell.
    length = np.linalg.norm(whole, axis=1)
    others = np.maximum(-np.einsum("kmi,ki->km", normals, whole), 0)  # Of triangles on the other side.
    sides = np.concatenate([edges, edges[:, :, 1:] - edges[:, :, :1]], axis=2)
    bases = np.linalg.norm(sides, axis=3).max(axis=2)
    beyond = (others / np.where(bases > 0, bases, 1)).sum(axis=1)  # Sum of their heights, times `length`.
    doubled = np.linalg.norm(normals, axis=2)
    areas = doubled.sum(axis=1)
    longest = np.square(edges).sum(axis=3).max(axis=(1, 2), initial=0)
    heights = (doubled / np.where(bases > 0, bases, 1)).sum(axis=1)
    # A small part beside a long line has a small area, too.
    is_flat = (areas <= _FLAT * longest) & (heights <= _ROUNDING * np.sqrt(longest))
    # Triangles that go around their corner more than once cover each other.
    ahead = np.einsum("kmi,kmi->km", edges[:, :, 0], edges[:, :, 1])
    around = np.arctan2(doubled, ahead).sum(axis=1) <= 2 * np.pi + _ROUNDING
    found: NDArray[np.bool_] = is_flat | (around & (beyond <= _ROUNDING * length) & (length > _FLAT * areas))
    return found
