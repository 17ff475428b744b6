"""Tables for arms whose solutions are found by searching one joint.

Axes 2 and 3 are parallel. The value of the searched joint determines where joints 1, 2 and 3 have to place a point of the
wrist, and their values follow in closed form (Elias and Wen 2022). So do the values of the two remaining joints, except for
one condition: the angle between their axes. Solutions are the values of the searched joint that meet this condition. Two
kinds of wrists are supported:

- Axes 5 and 6 intersect: the point is their intersection, and joint 4 is searched.
- Joint 5 turns two or more axes so that axis 6 always intersects axis 4. In hollow wrists of painting robots the second axis
  turns back as far as the first. The point is this intersection, and joint 5 is searched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import Matrix, Transform, Vector
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.branches import one_joint_residual as search
from kinseek.kernels.structure import candidates as form
from kinseek.structure.axes import meeting, nearest_on, slant
from kinseek.support.transforms import inverse, rotation, square, transform

NEARLY = 1e-3
"""Largest deviation of an arm from this structure [rad], lengths relative to the arm's size."""


BENT = 0.1
"""Sine of the least angle between axes that must not be parallel."""


BESIDE = 0.12
"""Margin beyond the joint's limits, or beyond half a turn, that is searched [rad], so that the residual is known on both
sides of a solution there. Not examined further."""


DRAWN = 1e-3
"""Weight that draws points of nearly coincident axes to the middle of the wrist, since nothing else determines them."""


class OneJoint(NamedTuple):
    """Arguments of `kernels.branches.one_joint` that depend on the arm."""

    numbers: Array
    """See `kernels.branches.one_joint_residual.BEGIN`, (NUMBERS,)."""
    table: Array
    """See `kernels.branches.one_joint_residual.HEIGHT`, (PLACES, SAMPLES); without samples for an arm of another
    structure."""


NOTHING = OneJoint(np.zeros(search.NUMBERS), np.zeros((search.PLACES, 0)))
"""Value for arms of any other structure."""


class _Turns(NamedTuple):
    """An arm as a product of rotations: the axes of its physical joints at q = 0, (m, 3), and the tip, (4, 4)."""

    direction: Array
    point: Array
    home: Array


def one_joint_of(arrays: ChainArrays, size: float) -> OneJoint:
    """Return the tables of an arm with one joint that can be searched.

    Args:
        arrays: The arm, with its tip where goals refer to.
        size: Length that scales deviations [m].
    """
    leader, joints = arrays.leader, len(arrays.leader)
    fits = len(arrays.lower) == 6 and (leader == np.sort(leader)).all() and not arrays.prismatic.any()
    alone = np.flatnonzero(leader != 4)
    if not fits or len(alone) != 5 or (np.abs(arrays.multiplier[alone]) != 1.0).any():
        return NOTHING
    turns = _turns(arrays)
    h, p = turns.direction, turns.point
    if _bend(h[0], h[1]) < BENT:
        return NOTHING
    coupled = joints > 6
    searched, other = (4, 3) if coupled else (3, 4)
    middle = (arrays.lower[searched] + arrays.upper[searched]) / 2
    half = min((arrays.upper[searched] - arrays.lower[searched]) / 2, np.pi) + BESIDE
    samples = np.linspace(middle - half, middle + half, search.SAMPLES)
    moved = np.array([_moved(arrays, turns, searched, value) for value in samples])
    R = moved[:, :3, :3]
    if coupled:
        far, near, apart = _meetings(turns, moved)
        first, second = np.tile(h[3], (len(R), 1)), np.einsum("kji,j->ki", R, h[3])
    else:
        x, apart = meeting(h[4:], p[4:])
        far, near = R @ x + moved[:, :3, 3], np.tile(x, (len(R), 1))
        first, second = R @ h[4], np.tile(h[4], (len(R), 1))
    off = max(apart / size, slant(h[1:3]))
    # `not <=` also rejects NaN, which degenerate axes give.
    if not off <= NEARLY or (not coupled and _bend(h[4], h[5]) < BENT):
        return NOTHING
    axis = R @ h[-1]
    senses = np.sign(h[1:3] @ h[1])
    parallel = senses @ h[1:3] / np.linalg.norm(senses @ h[1:3])
    # Any direction across the axes will do; the smallest component gives the one that rounds least.
    across = np.cross(parallel, np.eye(3)[np.abs(parallel).argmin()])
    across /= np.linalg.norm(across)
    basis = np.array([parallel, across, np.cross(parallel, across)])
    numbers, home = np.zeros(search.NUMBERS), inverse(turns.home[:3]).T
    # The numbers begin like those of a closed form, which the kernel applies to the other joints.
    numbers[: form.STRUCTURE.size] = form.STRUCTURE.numbers(
        form.Structure(
            deviation=off,
            size=size,
            sense2=senses[0],
            sense3=senses[1],
            home=Transform(Matrix(*(Vector(*each) for each in home[:3])), Vector(*home[3])),
            axis1=Vector(*h[0]),
            parallel=Vector(*parallel),
            across=Vector(*across),
            point1=Vector(*p[0]),
            point2=Vector(*p[1]),
            point3=Vector(*p[2]),
            axis6=Vector(*h[-1]),
        )
    )
    numbers[search.BEGIN], numbers[search.APART] = samples[0], samples[1] - samples[0]
    numbers[search.SEARCHED], numbers[search.OTHER] = searched, other
    height, cosine = (far - p[0]) @ parallel, (first * axis).sum(axis=1)
    columns = [
        height[:, None],
        (far - p[2]) @ basis[1:].T,
        cosine[:, None],
        first @ basis.T,
        near,
        axis,
        second,
    ]
    return OneJoint(numbers, np.concatenate(columns, axis=1).T.copy())


def _meetings(turns: _Turns, moved: Array) -> tuple[Array, Array, float]:
    """Intersect axis 4 with axis 6, which is moved by the joint between them, (k, 4, 4).

    Returns:
        The points in the frames of axis 4 and of axis 6 at q = 0, (k, 3) each; the largest distance between them [m].
    """
    h, p = turns.direction[[3, -1]], turns.point
    middle = (meeting(turns.direction[3:5], p[3:5])[0] + meeting(turns.direction[-2:], p[-2:])[0]) / 2
    a, b = nearest_on(h, p[[3, -1]], middle)
    far, near, apart = [], [], 0.0
    for M in moved:
        ways = np.array([h[0], -M[:3, :3] @ h[1]]).T
        gap = M[:3, :3] @ b + M[:3, 3] - a
        # Damped least squares: axes that nearly coincide meet at many points, and the middle of the wrist is preferred.
        s, t = np.linalg.solve(ways.T @ ways + DRAWN**2 * np.eye(2), ways.T @ gap)
        far.append(a + s * h[0])
        near.append(b + t * h[1])
        apart = max(apart, float(np.linalg.norm(gap - ways @ (s, t))))
    return np.array(far), np.array(near), apart


def _turns(arrays: ChainArrays) -> _Turns:
    """Like `structure.axes.axes_of`, but also for joints that share a variable."""
    frame, directions, points = np.eye(4), [], []
    for k in range(len(arrays.leader)):
        frame = frame @ square(arrays.fixed[k])
        directions.append(frame[:3, 2] * (1.0 if arrays.leader[k] == 4 else arrays.multiplier[k]))
        points.append(frame[:3, 3].copy())
        frame = frame @ _turn(np.array([0.0, 0.0, 1.0]), np.zeros(3), arrays.offset[k])
    return _Turns(np.array(directions), np.array(points), frame @ square(arrays.fixed[-1]))


def _moved(arrays: ChainArrays, turns: _Turns, variable: int, value: float) -> Array:
    """Return the transform that a variable causes through all joints it drives, (4, 4)."""
    T = np.eye(4)
    for k in np.flatnonzero(arrays.leader == variable):
        rate = arrays.multiplier[k] if variable == 4 else 1.0
        T = T @ _turn(turns.direction[k], turns.point[k], rate * value)
    return T


def _turn(axis: Array, point: Array, angle: float) -> Array:
    """Return the rotation about an axis, (4, 4)."""
    R = rotation(axis, angle)
    return transform(R, point - R @ point)


def _bend(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.cross(a, b)))
