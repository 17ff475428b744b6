"""Mesh simplification with a bound on how far any point moves, by merging the vertices in each cell of a grid.

After Rossignac and Borrel (1993). Triangles that collapse to a line or a point stay as slivers, so that the simplified
triangles, made thicker by the bound, contain the original ones. A closed mesh whose triangles are oriented alike stays
closed, because its triangles pass every edge as often in one direction as in the other. Corners that a program has computed
twice, with rounding errors, count as one, as for `closed_surfaces`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .closed_surfaces import SAME
from .geometry import SLIVER

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def simplified(vertices: Array, faces: Indices, tolerance: float) -> tuple[Array, Indices, float, Indices]:
    """Merge the vertices in each cell of a grid.

    Args:
        vertices: Vertices, (k, 3) [m].
        faces: Triangles as indices of vertices, (f, 3).
        tolerance: Maximum motion of any point [m].

    Returns:
        Vertices (m, 3), faces (g, 3), the maximum distance that points have moved [m], and the triangle from which each face
        comes, (g,), -1 for slivers.
    """
    sliver = min(SLIVER, tolerance / 2)  # It is part of the bound.
    # Vertices that are one for `closed_surfaces` must be in one cell, or a closed surface would be cut there.
    same = vertices.round(SAME)
    # Half the diagonal of a cell is the tolerance less a sliver and what rounding changes: no vertex moves farther.
    half = max(tolerance - sliver - 10.0**-SAME, (tolerance - sliver) / 2)
    cells = np.floor((same - same.min(axis=0)) / (2 * half / np.sqrt(3.0)))
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    cell = cell.ravel()
    count = int(cell.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, cell, vertices)
    np.maximum.at(high, cell, vertices)
    middle = (low + high) / 2
    moved = float(np.linalg.norm(vertices - middle[cell], axis=1).max()) + sliver
    corners = cell[faces]
    different = (corners != np.roll(corners, 1, axis=1)).sum(axis=1)
    whole, rest = corners[different == 3], np.sort(corners[different < 3], axis=1)
    edges = np.sort(whole[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    # Triangles that collapse to a line or a point would leave gaps; slivers replace them.
    lines = _missing(rest[:, [0, 2]][rest[:, 0] != rest[:, 2]], edges, count)
    known = np.union1d(whole, lines)
    points = np.setdiff1d(rest[rest[:, 0] == rest[:, 2], 0], known)
    lost = np.concatenate([lines, np.stack([points, points], axis=1)])
    begin, end = middle[lost[:, 0]], middle[lost[:, 1]]
    along_x = np.abs(end - begin)[:, :1] > np.abs(end - begin)[:, 1:2]
    side = begin + sliver * np.where(along_x, [[0, 1, 0]], [[1, 0, 0]])
    up = np.where(lost[:, :1] == lost[:, 1:], sliver / 2, 0.0)
    end = end + up * [0, 0, 1]
    slivers = np.arange(3 * len(lost)).reshape(3, -1).T + count
    # In both orientations, so that they enclose no volume and each of their edges counts twice.
    triangles = np.concatenate([whole, slivers, slivers[:, ::-1]])
    source = np.append(np.flatnonzero(different == 3), np.full(2 * len(slivers), -1))
    return np.concatenate([middle, begin, end, side]), triangles, moved, source


def _missing(lines: Indices, edges: Indices, count: int) -> Indices:
    """Return the lines that are not edges, once each, (k, 2)."""
    numbers = np.setdiff1d(lines @ [count, 1], edges @ [count, 1])
    return np.stack([numbers // count, numbers % count], axis=1).astype(np.int64)
