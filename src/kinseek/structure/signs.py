"""Three signs that distinguish the eight solutions of an arm with a closed form: of its shoulder, its elbow and its wrist.

Each of the three quadratic equations of a closed form (see `kernels.structure.candidates`) has two solutions, at which the
derivative of its left-hand side has opposite signs. These derivatives are the three factors of the determinant of the
Jacobian. So the signs of different solutions of a pose differ, and a motion without singularities keeps all three.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.structure import candidates as form

from .axes import Axes, axes_of, displaced
from .structure import DECIDED, Structure

FAR = 0.1
"""Distance of the wrist from axis 1 at q = 0, relative to the arm's size, from which on it defines where the front is."""

LEVEL = 0.1
"""Least cosine of the angle between axis 1 and the z axis of the base at which this axis defines where up is."""


class Signs(NamedTuple):
    """An arm with six joints whose closed form is seen from base to tip; points and directions at q = 0, lengths in [m]."""

    axes: Axes
    size: float
    up: Array
    """Direction of axis 1 away from the base, (3,)."""
    front: float
    """1 if the front is in the direction ``up x axis 2``, else -1."""
    sense: float
    """1 if axis 3 has the direction of axis 2, -1 if it has the opposite direction."""
    base: Array
    """A point on axis 1, (3,)."""
    shoulder: Array
    """A point on axis 2, (3,)."""
    elbow: Array
    """A point on axis 3, (3,)."""
    wrist: Array
    """The point where the last axes intersect, (3,)."""
    end: Array
    """End of the forearm, (3,): the wrist, or a point on axis 4 if axes 2, 3 and 4 are parallel."""
    parallel: bool
    """Whether axes 2, 3 and 4 are parallel."""
    straight: float
    """The angle of joint 5 nearest to 0 at which axes 4, 5 and 6 are in one plane [rad]."""

    def values(self, q: Array) -> Array:
        """Return three numbers, of which the signs matter, for joint values, (k, 6) -> (k, 3).

        They are the distance of the wrist from axis 1 towards the front, relative to the arm's size; the sine of the
        elbow's angle, times the lengths of its links relative to the arm's size, positive if the elbow is up; and the
        sine of the wrist's angle.
        """
        motions, h = displaced(self.axes, q[:, :4]), self.axes.direction
        upper, fore, last = motions[1], motions[2], motions[3 if self.parallel else 2]
        axis2, axis3 = motions[0].turned(h[1]), upper.turned(h[2])
        reach = _volume(self.up, axis2, last.moved(self.wrist) - self.base) / self.size
        link1 = upper.moved(self.elbow) - motions[0].moved(self.shoulder)
        link2 = fore.moved(self.end) - upper.moved(self.elbow)
        bend = _volume(axis3, link1, link2) / self.size**2
        above = -self.sense * bend * np.where(reach >= -UNDECIDED, 1.0, -1.0)
        return np.stack([self.front * reach, above, np.sin(q[:, 4] - self.straight)], axis=1)


UNDECIDED = 1e-6
"""Largest absolute value of a number of `Signs.values` that counts as 0."""


def signs_of(arrays: ChainArrays, structure: Structure) -> Signs | None:
    """Return the signs of an arm; None if its closed form does not begin at the base, or does not decide all joints."""
    axes, s = axes_of(arrays), form.STRUCTURE.value(structure.numbers)
    if axes is None or s.kind == form.NONE or s.backward > 0.0 or len(axes.direction) != DECIDED:
        return None
    h, size = axes.direction, s.size
    base, wrist, points = np.array(s.point1), np.array(s.centre), np.array([s.point2, s.point3, s.point4])
    up = h[0] if abs(h[0, 2]) < LEVEL or h[0, 2] > 0.0 else -h[0]
    at_zero = float(_volume(up, h[1], wrist - base)) / size
    # The common direction of axes 4 and 6, and axis 5, at q = 0: axis 4 · (axis 5 x axis 6) = b cos q₅ - a sin q₅.
    b, a = float(_volume(h[3], h[4], h[5])), float(h[3] @ h[5] - (h[3] @ h[4]) * (h[4] @ h[5]))
    straight = math.atan2(b * math.copysign(1.0, a), abs(a))
    return Signs(
        axes=axes,
        size=size,
        up=up,
        front=math.copysign(1.0, at_zero) if abs(at_zero) > FAR else -1.0,
        sense=math.copysign(1.0, float(h[1] @ h[2])),
        base=base,
        shoulder=base if s.kind == form.MEETING else points[0],
        elbow=points[1],
        wrist=wrist,
        end=points[2] if s.kind == form.PARALLEL else wrist,
        parallel=s.kind == form.PARALLEL,
        straight=straight,
    )


def _volume(a: Array, b: Array, c: Array) -> Array:
    """Return a · (b x c), the signed volume that three vectors, (..., 3), span."""
    return np.asarray((a * np.cross(b, c)).sum(axis=-1))
