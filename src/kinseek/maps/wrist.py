"""A cheap no: the hand asks for a point of the last axis but one on some circle, and the arm is too short for all of that.

Turns about the last axis leave that circle. And the way from the first axis to that point is no longer than one from axis
to axis, whatever the joints are: turns about an axis leave the distances of its points to those of the next as they are.
The gate of a proof goes on to the last axis by one more such step, as if it could lie along the others; where it lies
across, as a Panda's does, the circle tells more.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.caching import WeakCache
from kinseek.robots import SerialChain
from kinseek.transforms import inverse

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PARALLEL = 1e-4
"""sin² of the angle between two axes up to which they count as parallel: any of their points will do."""

MARGIN = 1e-9
"""For rounding, relative to the lengths that are added."""


class Circle(NamedTuple):
    """Where the hand has a point of the last axis but one, and how far off that can be."""

    centre: Array
    """In the tip's frame [m], (3,)."""
    axis: Array
    """Of the circle, in the tip's frame, (3,)."""
    radius: float
    """[m]"""
    shoulder: Array
    """A point that stands still, in the base [m], (3,)."""
    length: float
    """The point is no farther from there [m]."""

    def beyond(self, T: Array, position: Array | float, orientation: Array | float) -> Flags:
        """Is all of the circle out of reach, for all poses in balls?

        Args:
            T: Middles of the balls, (k, 3 or 4, 4), lengths in [m].
            position: Their radii, (k,) or one for all [m].
            orientation: And by how much poses are turned at most, likewise [rad].
        """
        R, centre = T[:, :3, :3], T[:, :3, :3] @ self.centre + T[:, :3, 3]
        away = self.shoulder - centre
        along = np.einsum("ki,ki->k", away, R @ self.axis)
        across = np.sqrt(np.maximum(np.einsum("ki,ki->k", away, away) - along**2, 0.0))
        near = np.hypot(along, across - self.radius)
        arm = float(np.linalg.norm(self.centre)) + self.radius  # No point of it is farther from the tip.
        near = near - position - 2.0 * np.sin(np.minimum(orientation, np.pi) / 2) * arm
        lengths = self.length + np.linalg.norm(away, axis=1) + np.linalg.norm(T[:, :3, 3], axis=1) + arm
        return np.asarray(near > self.length + MARGIN * lengths)


_kept: WeakCache[SerialChain, None, list[Circle]] = WeakCache()


def circles(chain: SerialChain) -> list[Circle]:
    """What the hand says of points of the last axis but one: nothing of an arm that slides, or has not three joints."""
    return _kept.of(chain).get(None, lambda: _circles(chain))


def _circles(chain: SerialChain) -> list[Circle]:
    joints = len(chain.fixed) - 1
    if joints < 3 or np.any(chain.prismatic):
        return []
    feet = [_feet(fixed) for fixed in chain.fixed[1:joints]]
    start = feet[0][0]
    shoulder = chain.fixed[0, :, 3] + chain.fixed[0, :, 2] * start
    points, lengths = [start], [0.0]
    for i in range(1, joints - 1):
        following = [feet[i - 1][1], feet[i][0]]
        ways = [
            [
                length + float(np.linalg.norm(_on(chain.fixed[i], there) - [0.0, 0.0, here]))
                for here, length in zip(points, lengths, strict=True)
            ]
            for there in following
        ]
        points, lengths = following, [min(each) for each in ways]
    back, tip = inverse(chain.fixed[-2]), inverse(chain.fixed[-1])
    made = []
    for point, length in zip(points, lengths, strict=True):
        x, y, z = back[:, 3] + back[:, 2] * point  # As the frame of the last joint has it.
        made.append(Circle(_on(tip, z), tip[:, 2], float(np.hypot(x, y)), shoulder, length))
    return made


def _feet(fixed: Array) -> tuple[float, float]:
    """Where along an axis the next is nearest, and where along that [m], the next placed by (3, 4)."""
    axis, point = fixed[:, 2], fixed[:, 3]
    c, along = float(axis[2]), float(axis @ point)
    if 1.0 - c * c < PARALLEL:
        return float(point[2]), 0.0
    return float(point[2] - c * along) / (1.0 - c * c), float(c * point[2] - along) / (1.0 - c * c)


def _on(fixed: Array, along: float) -> Array:
    """The point of an axis, placed by (3, 4), so far along it [m], (3,)."""
    return np.asarray(fixed[:, 3] + fixed[:, 2] * along)
