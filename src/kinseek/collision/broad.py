"""Free for sure, by outer spheres: bounds from below on the distance of every pair, for many joint values at once.

Every shape is covered by a few spheres along its longest axis. What moves against what moves is bounded by the distance of
their spheres, what moves against what stands by the distance of its spheres from a box around the other, which is exact
where that is a box.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.robots.chain import Frame, SerialChain

from .shapes import Shape

Array = NDArray[np.float64]

_ROUNDING = 1e-9
"""Taken off every bound, for the rounding of what it is worked out from [m]."""

_MOST_SPHERES = 6
"""Of one shape."""

_ROWS = 256
"""Joint values at a time: their distances fit into the cache of a core."""


def spheres_of(shape: Shape, pose: Array) -> tuple[Array, Array]:
    """Cover a shape by spheres: centres in the frame of its pose, (k, 3), and radii, (k,), in [m].

    The shape lies in a cylinder about its longest axis; every sphere holds one slice of that.
    """
    corners = shape.corners
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    off = corners - middle
    axis = np.linalg.eigh(off.T @ off)[1][:, -1]
    along = off @ axis
    thick = shape.thickness
    radius = float(np.linalg.norm(off - np.outer(along, axis), axis=1).max()) + thick
    low, high = float(along.min()) - thick, float(along.max()) + thick
    count = int(np.clip(np.ceil((high - low) / (1.5 * radius)), 1, _MOST_SPHERES))
    ends = np.linspace(low, high, count + 1)
    centres = middle + np.outer((ends[:-1] + ends[1:]) / 2, axis)
    radii = np.full(count, np.hypot((high - low) / count / 2, radius))
    one = float(np.linalg.norm(off, axis=1).max()) + thick
    if count == 1 and one < radii[0]:
        centres, radii = middle[None], np.array([one])
    return centres @ pose[:3, :3].T + pose[:3, 3], radii


class Broad:
    """Bounds for the pairs of a scene.

    Args:
        chain: The arm.
        parts: Of each part the joint that carries it, its shape, and its pose in the frame of that joint, (4, 4).
        pairs: Numbers of the two parts of each pair; at most one of them stands in the base.
    """

    def __init__(
        self,
        chain: SerialChain,
        parts: Sequence[tuple[int, Shape, Array]],
        pairs: Sequence[tuple[int, int]],
    ) -> None:
        """Fit the spheres and boxes."""
        self.count = len(pairs)
        movers = sorted({i for pair in pairs for i in pair if parts[i][0] > 0})
        covers = {i: spheres_of(parts[i][1], parts[i][2]) for i in movers}
        starts = dict(zip(movers, np.cumsum([0, *(len(covers[i][1]) for i in movers)]), strict=False))
        self._carried = sorted({parts[i][0] for i in movers})
        self._arrays = [chain.arrays_to(Frame(k, np.eye(4))) for k in self._carried]
        self._of_joint = [
            [(int(starts[i]), covers[i][0]) for i in movers if parts[i][0] == k] for k in self._carried
        ]
        self._radii = np.concatenate([covers[i][1] for i in movers]) if movers else np.zeros(0)

        left, right, firsts, self._moving = [], [], [0], []
        for number, (i, j) in enumerate(pairs):
            if parts[i][0] == 0 or parts[j][0] == 0:
                continue
            self._moving.append(number)
            one, other = len(covers[i][1]), len(covers[j][1])
            left.append(np.repeat(starts[i] + np.arange(one), other))
            right.append(np.tile(starts[j] + np.arange(other), one))
            firsts.append(firsts[-1] + one * other)
        self._left = np.concatenate(left) if left else np.zeros(0, dtype=np.int64)
        self._right = np.concatenate(right) if right else np.zeros(0, dtype=np.int64)
        self._firsts = np.array(firsts[:-1], dtype=np.int64)
        self._both = self._radii[self._left] + self._radii[self._right]

        # What stands: of each such part the box in its own frame, and the spheres of all that may touch it.
        self._standing = []
        for still in sorted({i for pair in pairs for i in pair if parts[i][0] == 0}):
            numbers = [n for n, pair in enumerate(pairs) if still in pair]
            others = [pairs[n][0] if pairs[n][1] == still else pairs[n][1] for n in numbers]
            spheres = np.concatenate([starts[i] + np.arange(len(covers[i][1])) for i in others])
            slices = np.cumsum([0, *(len(covers[i][1]) for i in others[:-1])])
            _, shape, pose = parts[still]
            low = shape.corners.min(axis=0)
            high = shape.corners.max(axis=0)
            turn, middle = pose[:3, :3], pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3]
            self._standing.append(
                (np.array(numbers), spheres, slices, turn, middle, (high - low) / 2, shape.thickness)
            )

    def bounds(self, q: Array) -> Array:
        """No pair is closer than this, (k, n) -> (k, pairs) [m]; where it is negative it says nothing."""
        out = np.empty((len(q), self.count))
        for begin in range(0, len(q), _ROWS):
            self._fill(np.ascontiguousarray(q[begin : begin + _ROWS]), out[begin : begin + _ROWS])
        return out

    def _fill(self, q: Array, out: Array) -> None:
        centres = np.empty((len(q), len(self._radii), 3))
        for arrays, covers in zip(self._arrays, self._of_joint, strict=True):
            poses = forward_many(arrays, q)
            turns, places = poses[:, :3, :3].transpose(0, 2, 1), poses[:, None, :3, 3]
            for start, points in covers:
                centres[:, start : start + len(points)] = points @ turns + places
        if self._moving:
            apart = _norms(centres[:, self._left] - centres[:, self._right]) - self._both
            out[:, self._moving] = np.minimum.reduceat(apart, self._firsts, axis=1)
        for numbers, spheres, slices, turn, middle, half, thick in self._standing:
            beyond = np.abs((centres[:, spheres] - middle) @ turn) - half
            np.maximum(beyond, 0.0, out=beyond)
            apart = _norms(beyond) - (self._radii[spheres] + thick)
            out[:, numbers] = np.minimum.reduceat(apart, slices, axis=1)
        out -= _ROUNDING


def _norms(vectors: Array) -> Array:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
