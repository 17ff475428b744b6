"""Geometry for drawing an arm from its chain: links as rods, joints as barrels and rails, independent of the renderer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain, joint_frames
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
        """Take the arm."""
        self._chain = chain
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
        chain, slides = self._chain, self._chain.prismatic
        before, after = joint_frames(chain, np.asarray(q, dtype=float))
        base = np.zeros((len(before), 1, 3))
        tip = (after[:, -1] @ square(chain.fixed[-1]))[:, None, :3, 3]
        # A slide is drawn along its way, any other joint as a barrel around its axis.
        half = self.size * BARREL / 2 * before[..., :3, 2]
        here, there = before[..., :3, 3], after[..., :3, 3]
        one = np.where(slides[:, None], here, here - half)
        other = np.where(slides[:, None], there, here + half)
        radius = np.full(self.links + self.joints, self.size * LINK)
        radius[self.links :] = self.size * np.where(slides, 1.3 * LINK, JOINT)
        return between(
            np.concatenate([base, there, one], axis=1), np.concatenate([here, tip, other], axis=1), radius
        )


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
