"""Geometry for drawing an arm from its chain: links as rods, joints as barrels and rails, independent of the renderer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import ChainArrays
from kinseek.robots.chain import Frame, SerialChain
from kinseek.support.transforms import square

Array = NDArray[np.float64]

LINK, JOINT, BARREL = 0.014, 0.027, 0.075
"""Radius of a link, radius of a joint's barrel and its length, relative to the arm's reach."""

_NOTHING = 1e-6
"""An invisible length [m]: scaling by 0 would leave no normals."""


class Cylinders(NamedTuple):
    """Cylinders for k poses of an arm, s each: a unit cylinder along z from 0 to 1, rotated, scaled and moved."""

    start: Array
    """Start points, (k, s, 3) [m]."""
    wxyz: Array
    """Rotations as quaternions, (k, s, 4)."""
    scale: Array
    """Radius twice, and length, (k, s, 3) [m]."""


class Figure:
    """The shape of an arm at any joint values."""

    def __init__(self, chain: SerialChain) -> None:
        """Find the positions of its joints."""
        self._before: list[ChainArrays] = []
        self._after: list[ChainArrays] = []
        for k in range(len(chain.leader)):
            self._before.append(chain.arrays_to(Frame(k, square(chain.fixed[k]))))
            self._after.append(chain.arrays_to(Frame(k + 1, np.eye(4))))
        self._tip = chain.arrays
        self._slides = chain.prismatic
        self.size = max(chain.reach, 1e-3)
        """Approximate reach [m]."""
        self.joints = len(chain.leader)
        """Number m of joints that are drawn."""
        self.links = self.joints + 1
        """Number of links that are drawn: one before every joint, and one after the last."""

    def draw(self, q: Array) -> Cylinders:
        """Return the cylinders at joint values: the links first, then the joints.

        Args:
            q: Joint values, (k, n), [rad] or [m].
        """
        q = np.ascontiguousarray(q, dtype=float)
        before = [forward_many(arrays, q) for arrays in self._before]
        after = [
            forward_many(arrays, q) if slides else moved
            for arrays, slides, moved in zip(self._after, self._slides, before, strict=True)
        ]
        tip = forward_many(self._tip, q)[:, :3, 3]
        here = [np.zeros_like(tip), *(T[:, :3, 3] for T in after)]
        there = [*(T[:, :3, 3] for T in before), tip]
        start, end = np.stack(here, axis=1), np.stack(there, axis=1)
        ends = [self._barrel(*each) for each in zip(before, after, self._slides, strict=True)]
        radius = np.full(self.links + self.joints, self.size * LINK)
        radius[self.links :] = self.size * np.where(self._slides, 1.3 * LINK, JOINT)
        return between(
            np.concatenate([start, np.stack([one for one, _ in ends], axis=1)], axis=1),
            np.concatenate([end, np.stack([other for _, other in ends], axis=1)], axis=1),
            radius,
        )

    def _barrel(self, before: Array, after: Array, slides: bool) -> tuple[Array, Array]:
        """Return both ends of a joint: along the axis of a revolute joint, along the slide of a prismatic joint."""
        if slides:
            return before[:, :3, 3], after[:, :3, 3]
        half = self.size * BARREL / 2 * before[:, :3, 2]
        return before[:, :3, 3] - half, before[:, :3, 3] + half


def between(start: Array, end: Array, radius: Array) -> Cylinders:
    """Return cylinders between points.

    Args:
        start: Start points, (k, s, 3) [m].
        end: End points, (k, s, 3) [m].
        radius: Radii, (s,) [m].
    """
    along = end - start
    length = np.linalg.norm(along, axis=-1)
    x, y, z = np.moveaxis(along / np.maximum(length, _NOTHING)[..., None], -1, 0)
    # The shortest rotation of z onto the direction; straight down it is half a turn about x.
    wxyz = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=-1)
    wxyz[(1.0 + z < 1e-9) | (length < _NOTHING)] = [0.0, 1.0, 0.0, 0.0]
    wxyz /= np.linalg.norm(wxyz, axis=-1, keepdims=True)
    wide = np.broadcast_to(radius, length.shape)
    return Cylinders(start, wxyz, np.stack([wide, wide, np.maximum(length, _NOTHING)], axis=-1))
