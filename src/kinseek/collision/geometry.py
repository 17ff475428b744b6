"""What coal takes: the package itself, and triangles."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import MissingExtra
from kinseek.support.forks import importing

Array = NDArray[np.float64]

SLIVER = 1e-7
"""Width of triangles that replace a line or a point [m]."""

_FLAT = 1e-9
"""Height of a triangle up to which it counts as a line [m]."""


def library(name: str) -> Any:
    """Import a package of the extra.

    Raises:
        MissingExtra: It is not installed.
    """
    try:
        with importing:
            _settle_boxes(import_module("coal"))
            return import_module(name)
    except ImportError:
        raise MissingExtra("A scene with collisions", "collision") from None


@cache
def _settle_boxes(coal: Any) -> None:
    """Let results about boxes not depend on the first check in the process.

    coal makes boxes larger by 1e-10 of their size on one side where a direction of its search has a zero. It keeps what it
    decided for the first direction in the process for all later ones (`getShapeSupport` of a box, a static variable). The
    first one here has no zero, so that boxes keep their size.
    """
    place = coal.Transform3s(np.array([[1, -2, 2], [2, -1, -2], [2, 2, 1]]) / 3.0, np.array([3.0, 0.2, 0.1]))
    box, capsule = coal.Box(1.0, 1.0, 1.0), coal.Capsule(0.1, 0.3)
    coal.distance(capsule, coal.Transform3s(), box, place, coal.DistanceRequest(), coal.DistanceResult())


def triangles(vertices: Array, faces: NDArray[np.int64]) -> Any:
    """Convert triangles to coal's tree of boxes; those without area become `SLIVER` wide."""
    vertices, faces = _with_area(vertices, faces)
    model = library("coal").BVHModelOBBRSS()
    model.beginModel(len(faces), len(vertices))
    model.addVertices(np.ascontiguousarray(vertices))
    model.addTriangles(np.ascontiguousarray(faces))
    model.endModel()
    return model


def _with_area(vertices: Array, faces: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
    """Replace triangles without area, but for rounding, by slivers that contain their longest side.

    coal measures the distance between a sphere and a triangle along the normal of the triangle, and a line has none.
    """
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    sides = np.stack([b - a, c - b, a - c])
    long = np.linalg.norm(sides, axis=2)
    doubled = np.linalg.norm(np.cross(sides[0], sides[2]), axis=1)
    flat = np.flatnonzero(doubled <= _FLAT * long.max(axis=0))
    if not len(flat):
        return vertices, faces
    sides, longest = sides[:, flat], long[:, flat].argmax(axis=0)
    begin, way = faces[flat, longest], sides[longest, np.arange(len(flat))]
    # Across the side, along the axis to which it is least parallel; for a point along two axes.
    across = SLIVER * np.eye(3)[np.abs(way).argmin(axis=1)]
    point = np.linalg.norm(way, axis=1) < SLIVER
    end = vertices[begin] + np.where(point[:, None], np.roll(across, 1, axis=1), way)
    faces, added = faces.copy(), len(vertices) + np.arange(2 * len(flat)).reshape(2, -1)
    faces[flat] = np.stack([begin, *added], axis=1)
    return np.concatenate([vertices, end, vertices[begin] + across]), faces
