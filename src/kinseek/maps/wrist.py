"""Fast rejection of poses: a pose requires a point of the second-last axis on a circle that the arm is too short to reach.

Rotations about the last axis preserve that circle. The distance from the first axis to that point is at most the length of a
path from axis to axis, for all joint values: rotations about an axis preserve the distances of its points to those of the
next axis. The first test of a proof extends this path to the last axis by one more step, as if that step could be aligned
with the others. If it is perpendicular to them, as in a Panda, the circle gives a stronger bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots import SerialChain
from kinseek.support.caching import WeakCache
from kinseek.support.transforms import inverse

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

PARALLEL = 1e-4
"""sin² of the angle between two axes up to which they count as parallel, so that any pair of their points is a nearest one.
"""

MARGIN = 1e-9
"""Margin for rounding, relative to the lengths that are added."""


class Circle(NamedTuple):
    """Circle on which a pose requires a point of the second-last axis, and the largest distance of that point."""

    centre: Array
    """Centre in the tip's frame [m], (3,)."""
    axis: Array
    """Axis of the circle in the tip's frame, (3,)."""
    radius: float
    """Radius [m]."""
    shoulder: Array
    """A fixed point in the base [m], (3,)."""
    length: float
    """Upper bound on the distance of the point from `shoulder` [m]."""

    def beyond(self, T: Array, position: Array | float, orientation: Array | float) -> Flags:
        """Return whether the whole circle is out of reach, for all poses in balls.

        Args:
            T: Centres of the balls, (k, 3 or 4, 4), lengths in [m].
            position: Their radii, (k,) or one for all [m].
            orientation: Their largest rotations, (k,) or one for all [rad].
        """
        R, centre = T[:, :3, :3], T[:, :3, :3] @ self.centre + T[:, :3, 3]
        away = self.shoulder - centre
        along = np.einsum("ki,ki->k", away, R @ self.axis)
        across = np.sqrt(np.maximum(np.einsum("ki,ki->k", away, away) - along**2, 0.0))
        near = np.hypot(along, across - self.radius)
        arm = float(np.linalg.norm(self.centre)) + self.radius  # Bounds the distance of its points.
        near = near - position - 2.0 * np.sin(np.minimum(orientation, np.pi) / 2) * arm
        lengths = self.length + np.linalg.norm(away, axis=1) + np.linalg.norm(T[:, :3, 3], axis=1) + arm
        return np.asarray(near > self.length + MARGIN * lengths)


_cache: WeakCache[SerialChain, None, list[Circle]] = WeakCache()


def circles(chain: SerialChain) -> list[Circle]:
    """Return the circles of an arm: none if it has a prismatic joint or fewer than three joints."""
    return _cache.of(chain).get(None, lambda: _circles(chain))


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
        x, y, z = back[:, 3] + back[:, 2] * point  # In the frame of the last joint.
        made.append(Circle(_on(tip, z), tip[:, 2], float(np.hypot(x, y)), shoulder, length))
    return made


def _feet(fixed: Array) -> tuple[float, float]:
    """Return where along an axis and along the next, placed by (3, 4), they are nearest to each other [m]."""
    axis, point = fixed[:, 2], fixed[:, 3]
    c, along = float(axis[2]), float(axis @ point)
    if 1.0 - c * c < PARALLEL:
        return float(point[2]), 0.0
    return float(point[2] - c * along) / (1.0 - c * c), float(c * point[2] - along) / (1.0 - c * c)


def _on(fixed: Array, along: float) -> Array:
    """Return the point at a coordinate along an axis, placed by (3, 4), [m], (3,)."""
    return np.asarray(fixed[:, 3] + fixed[:, 2] * along)
