"""What the judges have in common: polygons, numbers, triangles of strips and fans."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Polygons = list[Array]
"""The corners of each polygon in turn [m], (corners, 3)."""
UNIT = 1e-4
"""How much the length of an axis or of a quaternion may differ from 1; docs/security.md allows as much."""

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
WHOLE = re.compile(r"[+-]?\d+", re.ASCII)


class Unknown(Exception):
    """The specification does not say what this is, or this judge does not know it."""


def floats(words: Sequence[str]) -> Array:
    """Numbers from words."""
    for word in words:
        if not NUMBER.fullmatch(word):
            raise Unknown("number")
    return np.array([float(word) for word in words])


def integers(words: Sequence[str]) -> list[int]:
    """Integers from words."""
    for word in words:
        if not WHOLE.fullmatch(word):
            raise Unknown("integer")
    return [int(word) for word in words]


def strip(corners: Sequence[int]) -> list[list[int]]:
    """The triangles of a strip, all with the orientation of the first."""
    return [
        [corners[k], *((corners[k + 2], corners[k + 1]) if k % 2 else (corners[k + 1], corners[k + 2]))]
        for k in range(len(corners) - 2)
    ]


def fan(corners: Sequence[int]) -> list[list[int]]:
    """The triangles of a fan."""
    return [[corners[0], corners[k], corners[k + 1]] for k in range(1, len(corners) - 1)]


def placed(points: Array, polygons: Sequence[Sequence[int]]) -> Polygons:
    """Polygons from the indices of their corners; those with fewer than three have no surface."""
    if any(not 0 <= each < len(points) for polygon in polygons for each in polygon):
        raise Unknown("index out of range")
    found = [points[list(polygon)] for polygon in polygons if len(polygon) > 2]
    if not all(np.isfinite(each).all() for each in found):
        raise Unknown("not finite")
    return found


def without_overflow(read: Callable[[], Polygons]) -> Polygons:
    """What is read, if all its coordinates are finite."""
    with np.errstate(all="ignore"):
        found = read()
    if not all(np.isfinite(each).all() for each in found):
        raise Unknown("overflow")
    return found
