"""The swept joint of a closed form: the values that are tried, and the displacement that remains for the other joints.

If the value of the swept joint is given, the other joints form an arm with a closed form. Which values leave a solution
within the limits depends mostly on the direction of the hand about the axis of the joint, or on its position along the
axis of a prismatic joint. At a fixed offset from that direction the other joints have nearly the same task wherever the
hand is. `swept_values` tries which offsets serve best when an arm is loaded. If the last joint is the swept one, the arm
is solved backwards, and the shoulder as seen from the hand takes the place of the hand.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.task import Task
from kinseek.kernels.jit import inlined

from .candidates import AS, BACKWARD, HS, PS, SLIDES, SWEPT, X
from .subproblems import angle, cross, dot


@inlined
def swept_joint(structure: Array, dof: int) -> int:
    """Index of the swept joint of an arm."""
    return dof - 1 if structure[BACKWARD] > 0.0 else 0


@inlined
def direction(structure: Array, D: Array) -> float:
    """Direction of the point x, seen from the swept joint: an angle [rad], or a position [m] along its axis.

    The last axes do not move x, see `candidates`.
    """
    S = structure
    hx, hy, hz, ax, ay, az = S[HS], S[HS + 1], S[HS + 2], S[AS], S[AS + 1], S[AS + 2]
    ux = dot(D[0, 0], D[0, 1], D[0, 2], S[X], S[X + 1], S[X + 2]) + D[0, 3] - S[PS]
    uy = dot(D[1, 0], D[1, 1], D[1, 2], S[X], S[X + 1], S[X + 2]) + D[1, 3] - S[PS + 1]
    uz = dot(D[2, 0], D[2, 1], D[2, 2], S[X], S[X + 1], S[X + 2]) + D[2, 3] - S[PS + 2]
    if S[SLIDES] > 0.0:
        return dot(hx, hy, hz, ux, uy, uz)
    bx, by, bz = cross(hx, hy, hz, ax, ay, az)
    return angle(dot(bx, by, bz, ux, uy, uz), dot(ax, ay, az, ux, uy, uz))


@inlined
def taken_off(structure: Array, D: Array, value: float, rest: Array) -> None:
    """Write the displacement, (3, 4), of the other joints for a value of the swept joint; all of D if there is none."""
    S = structure
    if S[SWEPT] == 0.0:
        for r in range(3):
            for c in range(4):
                rest[r, c] = D[r, c]
        return
    hx, hy, hz, px, py, pz = S[HS], S[HS + 1], S[HS + 2], S[PS], S[PS + 1], S[PS + 2]
    if S[SLIDES] > 0.0:
        for r in range(3):
            for c in range(3):
                rest[r, c] = D[r, c]
            rest[r, 3] = D[r, 3] - value * S[HS + r]
        return
    sine, cosine = sine_cosine(-value)
    for c in range(4):
        x, y, z = D[0, c], D[1, c], D[2, c]
        if c == 3:
            x, y, z = x - px, y - py, z - pz
        along = dot(hx, hy, hz, x, y, z) * (1.0 - cosine)
        nx, ny, nz = cross(hx, hy, hz, x, y, z)
        x, y, z = (
            cosine * x + sine * nx + along * hx,
            cosine * y + sine * ny + along * hy,
            cosine * z + sine * nz + along * hz,
        )
        if c == 3:
            x, y, z = x + px, y + py, z + pz
        rest[0, c], rest[1, c], rest[2, c] = x, y, z


@inlined
def given_value(task: Task, value: float, near: Array) -> tuple[float, bool]:
    """Move a value of the swept joint into its limits by full turns, close to `near`; return it and whether it is inside."""
    i = swept_joint(task.structure, len(task.lower))
    low, high = task.chain.lower[i], task.chain.upper[i]
    if task.structure[SLIDES] == 0.0:
        if math.isinf(task.lower[i]):
            low, high = near[i] - math.pi, near[i] + math.pi
        value = nearest_copy(value, low, high, near[i])
    return value, low <= value <= high


@inlined
def end_value(task: Task, which: int) -> tuple[float, bool]:
    """Lower or upper end (0 or 1) of the range of the swept joint, and whether that end is finite."""
    i = swept_joint(task.structure, len(task.lower))
    value = task.lower[i] if which == 0 else task.upper[i]
    return value, not math.isinf(value)
