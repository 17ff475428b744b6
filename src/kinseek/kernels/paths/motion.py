"""The straight motion of the hand from a pose to the next, undone by two additional joints; and memory for a tube."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import copy_pose
from kinseek.kernels.arm.vectors import (
    Matrix,
    Transform,
    Vector,
    column,
    cross,
    norm,
    relative,
    scaled,
    transform_at,
    transposed_product,
    transposed_times,
    write_transform,
)
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.jit import counted, inlined
from kinseek.kernels.proof.box import BoxScratch, Form, make_box_scratch


class Tube(NamedTuple):
    """Memory of one tube around the centre of the scratch memory, and bounds for it; rows are joints."""

    c: Array
    """Centre, (n+1,)."""
    t: Array
    """Derivative of the branch with respect to s, with last entry 1, (n+1,)."""
    u: Array
    """Second derivative, with last entry 0, (n+1,)."""
    rows: Array
    """M for the columns and the point, laid out as a pose, (n, 3, 4)."""
    across: Array
    """M for the deviation of the joints in the held directions, (n, k)."""
    point: Array
    """Norm of the part of M for the point, (n,)."""
    column: Array
    """Norm of the part of M for the columns, (n,)."""
    value: Array
    """M f(c), (n,)."""
    slope: Array
    """M f', (n, n+1)."""
    bend: Array
    """M H, (n, n+1, n+1)."""
    D: Array
    """Inverse of the normal matrix, (n, n)."""
    start: Array
    """a, (n,)."""
    wide: Array
    """v, (n+1,)."""
    half: Array
    """ρ, (n,)."""
    reach: Array
    """κ(ρ), (n,)."""
    away: Array
    """ε, (n,)."""
    gain_point: Array
    """∂rest/∂δ of the point for each physical joint, (m+2,)."""
    gain_column: Array
    """∂rest/∂δ of the columns, (m+2,)."""
    spread: Array
    """Sum of the half widths of the revolute joints from the middle of the arm up to each joint, (m+2,)."""
    known: Array
    """Joint values near the branch at the beginning of a part of a step, (n,)."""
    following: Array
    """The same at its end, (n,)."""


class Margins(NamedTuple):
    """What scales a radian, and allowances for rounding."""

    length: float
    """The length of a radian [m]."""
    point: float
    """Rounding of the hand's point [m]."""
    columns: float
    """Rounding of its columns."""


class Motion(NamedTuple):
    """The motion of the hand from a pose to the next, undone by two additional joints of the arm."""

    form: Form
    """The arm with these two joints."""
    scratch: BoxScratch
    """Scratch memory; the last entry of its centre is s."""
    tube: Tube
    hold: Array
    """Directions in which the joints are held to linear interpolation, (k, n); empty if solutions are isolated."""
    begin: Array
    """Joint values at s = 0, (n,)."""
    end: Array
    """Joint values at s = 1, (n,)."""
    margins: Margins


@counted
def make_motion(chain: ChainArrays, columns: int, begin: Array, hold: Array, margins: Margins) -> Motion:
    """Allocate the memory for the steps of one path; `lead` sets the first two joints."""
    m, n = len(chain.leader), len(chain.lower)
    fixed, prismatic = np.zeros((m + 3, 3, 4)), np.zeros(m + 2, dtype=np.bool_)
    leader, multiplier, offset = np.full(m + 2, n), np.zeros(m + 2), np.zeros(m + 2)
    prismatic[1] = True
    for k in range(m):
        prismatic[k + 2], leader[k + 2] = chain.prismatic[k], chain.leader[k]
        multiplier[k + 2], offset[k + 2] = chain.multiplier[k], chain.offset[k]
    for k in range(m + 1):
        for r in range(3):
            for c in range(4):
                fixed[k + 2, r, c] = chain.fixed[k, r, c]
    branch = np.zeros(n + 1), np.ones(n + 1), np.zeros(n + 1)
    M = np.zeros((n, 3, 4)), np.zeros((n, hold.shape[0])), np.zeros(n), np.zeros(n)
    products = np.zeros(n), np.zeros((n, n + 1)), np.zeros((n, n + 1, n + 1)), np.zeros((n, n))
    widths = np.zeros(n), np.zeros(n + 1), np.zeros(n), np.zeros(n), np.zeros(n)
    gains = np.zeros(m + 2), np.zeros(m + 2), np.zeros(m + 2)
    everything = branch + M + products + widths + gains + (np.zeros(n), np.zeros(n))
    tube = Tube(*everything)
    form = Form(fixed, prismatic, leader, multiplier, offset, 0, columns, 0, 0.0)
    scratch = make_box_scratch(m + 2, n + 1)
    return Motion(form, scratch, tube, hold.copy(), begin.copy(), begin.copy(), margins)


@inlined
def frame_along(v: Vector, size: float) -> Matrix:
    """A rotation whose third axis has the direction of a vector of length `size`."""
    z = Vector(v.x / size, v.y / size, v.z / size) if size > 0.0 else Vector(0.0, 0.0, 1.0)
    # Normal to the vector and to the coordinate axis that is farthest from it.
    if abs(z.x) <= abs(z.y) and abs(z.x) <= abs(z.z):
        x = Vector(0.0, z.z, -z.y)
    elif abs(z.y) <= abs(z.z):
        x = Vector(-z.z, 0.0, z.x)
    else:
        x = Vector(z.y, -z.x, 0.0)
    length = norm(x)
    x = Vector(x.x / length, x.y / length, x.z / length)
    return Matrix(x, cross(z, x), z)


@inlined
def lead(motion: Motion, chain: ChainArrays, target: Array, slide: Vector, turn: Vector) -> None:
    """Set the two joints that undo the motion of the hand from a target, (3, 4), by d [m] and w [rad] in the base.

    The arm becomes ``A_w Rz(-|w| s) A_w⁻¹ A_d Tz(-|d| s) A_d⁻¹ A_1 …``: A_w is at the target with its third axis along w,
    and that of A_d, at the origin, is along d.
    """
    fixed, angle, way = motion.form.fixed, norm(turn), norm(slide)
    motion.form.multiplier[0], motion.form.multiplier[1] = -angle, -way
    about = Transform(frame_along(turn, angle), column(target, 3))
    along = Transform(frame_along(slide, way), Vector(0.0, 0.0, 0.0))
    write_transform(about, fixed[0])
    back = scaled(-1.0, transposed_times(about.R, about.p))
    write_transform(Transform(transposed_product(about.R, along.R), back), fixed[1])
    write_transform(relative(along, transform_at(chain.fixed[0])), fixed[2])
    copy_pose(target, motion.scratch.goal)


@inlined
def across_by(motion: Motion, a: int, q: Array, s: float) -> float:
    """Deviation of joint values in held direction `a` from the interpolated values at s."""
    off = 0.0
    for j in range(motion.hold.shape[1]):
        off += motion.hold[a, j] * (q[j] - motion.begin[j] - s * (motion.end[j] - motion.begin[j]))
    return off
