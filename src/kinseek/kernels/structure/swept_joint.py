"""A joint in front of a closed form: which of its values are tried, and what each leaves to the other joints.

With the joint in front given, the others are an arm with a closed form. Which values leave an answer inside the limits
depends on where the hand is, and mostly on its direction about the joint's axis, or its place along it if it slides: at a
fixed angle ahead of that direction the joint leaves the other joints much the same work wherever the hand is. Which angles
serve best is found by trial when an arm is loaded, see `swept_values`. Of an arm whose last joint is in front, taken
backwards, the same holds of the shoulder as the hand sees it.
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
    """Which joint of an arm stands in front."""
    return dof - 1 if structure[BACKWARD] > 0.0 else 0


@inlined
def direction(structure: Array, D: Array) -> float:
    """Where the point that the last axes leave alone is seen from the joint in front: an angle, or a place along it."""
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
    """Write what the other joints have to make, (3, 4), where the joint in front has a value; all if there is none."""
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
    """Bring a value of the joint in front inside its limits by full turns, near the middle; say whether it is inside."""
    i = swept_joint(task.structure, len(task.lower))
    low, high = task.chain.lower[i], task.chain.upper[i]
    if task.structure[SLIDES] == 0.0:
        if math.isinf(task.lower[i]):
            low, high = near[i] - math.pi, near[i] + math.pi
        value = nearest_copy(value, low, high, near[i])
    return value, low <= value <= high


@inlined
def end_value(task: Task, which: int) -> tuple[float, bool]:
    """The lower end of the range of the joint in front, or the upper (0 or 1); say whether it has one."""
    i = swept_joint(task.structure, len(task.lower))
    value = task.lower[i] if which == 0 else task.upper[i]
    return value, not math.isinf(value)
