"""All answers of an arm whose axes meet or run parallel, in closed form: one in each SIMD lane.

The arm is a product of turns about the axes as they stand at q = 0, ``T = E₁(q₁) … E₆(q₆) T₀`` (Brockett 1984), so that
``D = T T₀⁻¹`` is what they make together. A joint that is decided by a quadratic equation has two answers, and three of
them decide everything: a lane takes the one or the other of each by its three signs. An arm that has the structure at its
other end is taken backwards: ``D⁻¹ = E₆(-q₆) … E₁(-q₁)``.

Axes 2 and 3 run parallel to h, and a point x is moved by neither of the last axes: with ``c = D x`` what E₁⁻¹ c has along h
is what x has, for turns about h leave it, and that decides q₁. Then there is a triangle in the plane across h.

- A wrist whose three axes meet in x (Pieper 1968): the triangle decides q₂ and q₃, and the orientation that is left
  decides the wrist.
- Axis 4 parallel as well, axes 5 and 6 meet in x: the orientation of h decides q₅ and q₆, the triangle the rest.

Where such a wrist stands behind axes 1 and 2 that meet, its distance from where they do decides q₃, and the direction q₂
and q₁. An arm with a seventh joint in front has all this for each value of that joint, see `swept_joint`.
"""

from __future__ import annotations

import math

from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.jit import inlined

from .subproblems import angle, cross, dot, rotate, solve_trig, unit_angle

NONE, WRIST, PARALLEL, MEETING = range(4)
"""Kinds: no closed form, a spherical wrist behind two parallel axes, three parallel axes before two that meet, a spherical
wrist behind an axis behind two that meet."""


KIND, BACKWARD, DEVIATION, SIZE = range(4)
"""Places in the numbers of a structure: its kind; 1 for an arm that is taken backwards, else 0; how far the arm is from
having it [rad], lengths in parts of its size; that size [m]."""


SENSE = 4
"""From here on 1 or -1 for axes 2, 3 and 4: do they turn the way of h?"""


HOME = 7
"""From here on T₀⁻¹, (3, 4) row by row; of an arm taken backwards T₀."""


H1, P1, H, E, X, H4, H5, H6, A6, P2, P3, P4 = range(HOME + 12, HOME + 12 + 3 * 12, 3)
"""Where vectors begin: directions of axes 1, 4, 5 and 6, and h of those that are parallel; E and A6, across h and axis 6;
the point x; and a point on each of the first axes."""


H2, H3 = H, E
"""Of `MEETING`, directions of axes 2 and 3; P1 is then where axes 1 and 2 meet."""


SWEPT, SLIDES = P4 + 3, P4 + 4
"""How many values are tried of a joint in front of the structure, 0 if there is none; and 1 if that joint slides."""


HS, PS, AS = range(P4 + 5, P4 + 5 + 3 * 3, 3)
"""Where vectors of that joint begin: its direction, a point on it, and one across it."""


SWEPT_VALUES = AS + 3
"""From here on what is tried of it, see `swept_joint`: how far it leads [rad] or [m]."""


VALUES = 8
"""How many these are at most."""


NUMBERS = SWEPT_VALUES + VALUES
"""Numbers of a structure."""


ROUNDING = 1e-9
"""Deviation up to which an arm has its structure exactly: rounding of doubles in its description, and no more."""


LOOSE = 1e-5
"""Tolerances [m] and [rad] up to which the closed form tells all: with looser ones answers are regions, of which it knows
nothing."""


INFEASIBLE, BESIDE = 0.02, 1e-3
"""A candidate is tried if no equation lacks more, and if it lies no farther beyond a limit [rad]; farther where the arm is
off its structure, and where the tolerances reach farther."""


CLEAR = 1e-6
"""Where every equation is farther from having one answer, its two answers are told apart."""


FREE = 2e-4
"""An angle is left to choose where less than this decides it: there answers are continua, within the tolerances."""


SPREAD = 10.0
"""An arm that is off its structure by so much has equations that are off by so many times as much."""


INFEASIBILITY, CONDITIONING, DISCRIMINANT, DUPLICATE = range(6, 10)
"""Rows behind the six angles of a lane: by how much the worst of its equations has no answer, 0 where all have; how close
any angle is to being left to choose, 0 where it is; how close any equation is to having one answer, less where it decides
little; and 1 for a lane that is another once more, for they differ where both answers are one."""


MIDDLE, AXIS = 10, 13
"""Rows of what is left of the orientation behind the first three joints: where axis 6 and A6 point, 3 each."""


ROOTS, LEFT = MIDDLE, 3
"""When the candidates are there, what each of their three equations has under its root stands from row ROOTS on: unlike
what is told as lack it is smooth in what is given, and less than 0 where there is no answer. Before that, of the equations
of the first three joints it stands from row LEFT on, where angles of the wrist come to stand."""


ROWS = 16
"""Rows of numbers that the lanes work on."""


GIVEN = AXIS
"""Row of the value of a joint in front, when the candidates are there."""


SIGNS = ROWS
"""From this row on the signs of the lanes, three rows."""


WORK = (SIGNS + 3) * LANES
"""Numbers of all these."""


@inlined
def set_signs(work: Array) -> None:
    """Give the lanes their signs."""
    for l in range(LANES):
        for k in range(3):
            work[(SIGNS + k) * LANES + l] = 1.0 - 2.0 * ((l >> k) & 1)


@inlined
def displacement(structure: Array, target: Array, D: Array) -> None:
    """Write what the axes make together, or its inverse for an arm that is taken backwards, into D, (3, 4)."""
    if structure[BACKWARD] > 0.0:
        for r in range(3):
            p = structure[HOME + 4 * r + 3]
            for c in range(3):
                # T₀ times the inverse of the target.
                D[r, c] = 0.0
                for k in range(3):
                    D[r, c] += structure[HOME + 4 * r + k] * target[c, k]
            for c in range(3):
                p -= D[r, c] * target[c, 3]
            D[r, 3] = p
        return
    for r in range(3):
        for c in range(4):
            D[r, c] = target[r, 3] if c == 3 else 0.0
            for k in range(3):
                D[r, c] += target[r, k] * structure[HOME + 4 * k + c]


@inlined
def row_of(structure: Array, i: int, dof: int) -> int:
    """Row of joint i among the candidates of an arm with so many."""
    place = dof - 1 - i if structure[BACKWARD] > 0.0 else i
    if structure[SWEPT] > 0.0:
        place = place - 1 if place > 0 else GIVEN
    return place


@inlined
def joint_of(structure: Array, row: int, dof: int) -> int:
    """Joint whose angles stand in a row, see `row_of`."""
    place = row + 1 if structure[SWEPT] > 0.0 else row
    return dof - 1 - place if structure[BACKWARD] > 0.0 else place


@inlined
def candidates(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Write the angles of eight candidates and what is told of them into work.

    The angles of an arm that is taken backwards come from its last joint to its first.

    Args:
        structure: See `KIND`, (NUMBERS,).
        D: See `displacement`, (3, 4).
        far: Where an equation lacks more than that, those behind it tell nothing.
        work: See `INFEASIBILITY`, (WORK,).
        w: LANES.
    """
    set_signs(work)
    if structure[KIND] == WRIST:
        parallel_pair(structure, D, far, work, w)
        wrist(structure, far, work, w)
    elif structure[KIND] == MEETING:
        meeting_pair(structure, D, far, work, w)
        wrist(structure, far, work, w)
    else:
        parallel_three(structure, D, far, work, w)


@inlined
def parallel_pair(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Decide the first three joints of which the last two are parallel, by where the wrist is."""
    W, S, size = LANES, structure, 1.0 / structure[SIZE]
    ax, ay, az, px, py, pz = S[H1], S[H1 + 1], S[H1 + 2], S[P1], S[P1 + 1], S[P1 + 2]
    hx, hy, hz, ex, ey, ez = S[H], S[H + 1], S[H + 2], S[E], S[E + 1], S[E + 2]
    fx, fy, fz = cross(hx, hy, hz, ex, ey, ez)
    xx, xy, xz = S[X], S[X + 1], S[X + 2]
    ux = dot(D[0, 0], D[0, 1], D[0, 2], xx, xy, xz) + D[0, 3] - px
    uy = dot(D[1, 0], D[1, 1], D[1, 2], xx, xy, xz) + D[1, 3] - py
    uz = dot(D[2, 0], D[2, 1], D[2, 2], xx, xy, xz) + D[2, 3] - pz
    # h · E₁⁻¹ u, as a cos + b sin + rest.
    along = dot(ax, ay, az, hx, hy, hz)
    nx, ny, nz = cross(ax, ay, az, hx, hy, hz)
    height = dot(ax, ay, az, ux, uy, uz)
    a = dot(hx, hy, hz, ux, uy, uz) - along * height
    b = dot(nx, ny, nz, ux, uy, uz)
    c = dot(hx, hy, hz, xx - px, xy - py, xz - pz) - along * height
    # Sides of the triangle, in the plane across h.
    sx, sy, sz = S[P3] - S[P2], S[P3 + 1] - S[P2 + 1], S[P3 + 2] - S[P2 + 2]
    mx, my, mz = xx - S[P3], xy - S[P3 + 1], xz - S[P3 + 2]
    l0, l1 = dot(ex, ey, ez, sx, sy, sz), dot(fx, fy, fz, sx, sy, sz)
    m0, m1 = dot(ex, ey, ez, mx, my, mz), dot(fx, fy, fz, mx, my, mz)
    sides = l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1
    ta, tb = l0 * m0 + l1 * m1, l1 * m0 - l0 * m1
    ox, oy, oz = px - S[P2], py - S[P2 + 1], pz - S[P2 + 2]
    # What is to be turned back for the wrist: where the last axis and one across it point.
    zx, zy, zz = rotated(D, S, H6)
    vx, vy, vz = rotated(D, S, A6)
    sense2, sense3 = S[SENSE], S[SENSE + 1]
    for l in range(w):
        one, two = work[SIGNS * W + l], work[(SIGNS + 1) * W + l]
        c1, s1, rest1, length1 = solve_trig(a, b, c, one)
        gx, gy, gz = rotate(ax, ay, az, c1, -s1, ux, uy, uz)
        gx, gy, gz = gx + ox, gy + oy, gz + oz
        g0, g1 = dot(ex, ey, ez, gx, gy, gz), dot(fx, fy, fz, gx, gy, gz)
        c3, s3, rest3, _ = solve_trig(ta, tb, 0.5 * (g0 * g0 + g1 * g1 - sides), two)
        v0, v1 = l0 + c3 * m0 - s3 * m1, l1 + c3 * m1 + s3 * m0
        c2, s2, length2 = unit_angle(v0 * g0 + v1 * g1, v0 * g1 - v1 * g0)
        cosine, sine = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        work[l] = angle(s1, c1)
        work[W + l], work[2 * W + l] = sense2 * angle(s2, c2), sense3 * angle(s3, c3)
        qx, qy, qz = rotate(ax, ay, az, c1, -s1, zx, zy, zz)
        qx, qy, qz = rotate(hx, hy, hz, cosine, -sine, qx, qy, qz)
        work[MIDDLE * W + l], work[(MIDDLE + 1) * W + l], work[(MIDDLE + 2) * W + l] = qx, qy, qz
        qx, qy, qz = rotate(ax, ay, az, c1, -s1, vx, vy, vz)
        qx, qy, qz = rotate(hx, hy, hz, cosine, -sine, qx, qy, qz)
        work[AXIS * W + l], work[(AXIS + 1) * W + l], work[(AXIS + 2) * W + l] = qx, qy, qz
        weak1, weak2, fold1, fold3 = length1 * size, math.sqrt(length2) * size, abs(rest1), abs(rest3)
        fold3 = fold3 if rest1 > -far else 1.0
        weak2 = weak2 if min(rest1, rest3) > -far else 1.0
        work[INFEASIBILITY * W + l] = max(-rest1, -rest3, 0.0)
        work[LEFT * W + l], work[(LEFT + 1) * W + l] = rest1 * weak1 * weak1, rest3
        work[CONDITIONING * W + l], work[DISCRIMINANT * W + l] = (
            min(weak1, weak2),
            min(fold1 * min(weak1, 1.0), fold3),
        )
        again1 = rest1 <= 0.0 and one < 0.0
        again3 = rest3 <= 0.0 and two < 0.0
        work[DUPLICATE * W + l] = 1.0 if again1 or again3 else 0.0


@inlined
def meeting_pair(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Decide the first three joints of which the first two meet, by where the wrist is."""
    W, S, size = LANES, structure, 1.0 / structure[SIZE]
    ax, ay, az, bx, by, bz = S[H1], S[H1 + 1], S[H1 + 2], S[H2], S[H2 + 1], S[H2 + 2]
    hx, hy, hz, px, py, pz = S[H3], S[H3 + 1], S[H3 + 2], S[P1], S[P1 + 1], S[P1 + 2]
    xx, xy, xz = S[X], S[X + 1], S[X + 2]
    ux = dot(D[0, 0], D[0, 1], D[0, 2], xx, xy, xz) + D[0, 3] - px
    uy = dot(D[1, 0], D[1, 1], D[1, 2], xx, xy, xz) + D[1, 3] - py
    uz = dot(D[2, 0], D[2, 1], D[2, 2], xx, xy, xz) + D[2, 3] - pz
    # |m + E₃ r| = |u|, as a cos + b sin + rest: from where axes 1 and 2 meet to axis 3, and from there to x.
    mx, my, mz = S[P3] - px, S[P3 + 1] - py, S[P3 + 2] - pz
    rx, ry, rz = xx - S[P3], xy - S[P3 + 1], xz - S[P3 + 2]
    along = dot(hx, hy, hz, mx, my, mz) * dot(hx, hy, hz, rx, ry, rz)
    a = dot(mx, my, mz, rx, ry, rz) - along
    nx, ny, nz = cross(hx, hy, hz, rx, ry, rz)
    b = dot(mx, my, mz, nx, ny, nz)
    square = dot(ux, uy, uz, ux, uy, uz)
    c = 0.5 * (square - dot(mx, my, mz, mx, my, mz) - dot(rx, ry, rz, rx, ry, rz)) - along
    # axis 1 · E₂ v is what u has along axis 1.
    between = dot(ax, ay, az, bx, by, bz)
    kx, ky, kz = cross(ax, ay, az, bx, by, bz)
    height = dot(ax, ay, az, ux, uy, uz)
    zx, zy, zz = rotated(D, S, H6)
    ex, ey, ez = rotated(D, S, A6)
    for l in range(w):
        one, two = work[SIGNS * W + l], work[(SIGNS + 1) * W + l]
        c3, s3, rest3, _ = solve_trig(a, b, c, two)
        vx, vy, vz = rotate(hx, hy, hz, c3, s3, rx, ry, rz)
        vx, vy, vz = vx + mx, vy + my, vz + mz
        level = dot(bx, by, bz, vx, vy, vz) * between
        c2, s2, rest2, length2 = solve_trig(
            dot(ax, ay, az, vx, vy, vz) - level, dot(kx, ky, kz, vx, vy, vz), height - level, one
        )
        vx, vy, vz = rotate(bx, by, bz, c2, s2, vx, vy, vz)
        nx, ny, nz = cross(vx, vy, vz, ux, uy, uz)
        flat = dot(vx, vy, vz, ux, uy, uz) - dot(ax, ay, az, vx, vy, vz) * height
        c1, s1, length1 = unit_angle(flat, dot(ax, ay, az, nx, ny, nz))
        work[l], work[W + l], work[2 * W + l] = angle(s1, c1), angle(s2, c2), angle(s3, c3)
        qx, qy, qz = rotate(ax, ay, az, c1, -s1, zx, zy, zz)
        qx, qy, qz = rotate(bx, by, bz, c2, -s2, qx, qy, qz)
        qx, qy, qz = rotate(hx, hy, hz, c3, -s3, qx, qy, qz)
        work[MIDDLE * W + l], work[(MIDDLE + 1) * W + l], work[(MIDDLE + 2) * W + l] = qx, qy, qz
        qx, qy, qz = rotate(ax, ay, az, c1, -s1, ex, ey, ez)
        qx, qy, qz = rotate(bx, by, bz, c2, -s2, qx, qy, qz)
        qx, qy, qz = rotate(hx, hy, hz, c3, -s3, qx, qy, qz)
        work[AXIS * W + l], work[(AXIS + 1) * W + l], work[(AXIS + 2) * W + l] = qx, qy, qz
        weak1, weak2, fold2, fold3 = math.sqrt(length1) * size, length2 * size, abs(rest2), abs(rest3)
        work[LEFT * W + l], work[(LEFT + 1) * W + l] = rest2 * weak2 * weak2, rest3
        fold2 = fold2 if rest3 > -far else 1.0
        weak2 = weak2 if rest3 > -far else 1.0
        weak1 = weak1 if min(rest2, rest3) > -far else 1.0
        work[INFEASIBILITY * W + l] = max(-rest2, -rest3, 0.0)
        work[CONDITIONING * W + l], work[DISCRIMINANT * W + l] = (
            min(weak1, weak2),
            min(fold2 * min(weak2, 1.0), fold3),
        )
        again2 = rest2 <= 0.0 and one < 0.0
        again3 = rest3 <= 0.0 and two < 0.0
        work[DUPLICATE * W + l] = 1.0 if again2 or again3 else 0.0


@inlined
def rotated(D: Array, S: Array, first: int) -> tuple[float, float, float]:
    """Turn a vector of a structure by D."""
    x, y, z = S[first], S[first + 1], S[first + 2]
    return (
        D[0, 0] * x + D[0, 1] * y + D[0, 2] * z,
        D[1, 0] * x + D[1, 1] * y + D[1, 2] * z,
        D[2, 0] * x + D[2, 1] * y + D[2, 2] * z,
    )


@inlined
def wrist(structure: Array, far: float, work: Array, w: int) -> None:
    """Decide the last three joints by what is left of the orientation."""
    W, S = LANES, structure
    ax, ay, az, bx, by, bz = S[H4], S[H4 + 1], S[H4 + 2], S[H5], S[H5 + 1], S[H5 + 2]
    zx, zy, zz, ex, ey, ez = S[H6], S[H6 + 1], S[H6 + 2], S[A6], S[A6 + 1], S[A6 + 2]
    fx, fy, fz = cross(zx, zy, zz, ex, ey, ez)
    # axis 4 · E₅ axis 6, as a cos + b sin + along.
    along = dot(ax, ay, az, bx, by, bz) * dot(zx, zy, zz, bx, by, bz)
    a = dot(ax, ay, az, zx, zy, zz) - along
    nx, ny, nz = cross(bx, by, bz, zx, zy, zz)
    b = dot(ax, ay, az, nx, ny, nz)
    for l in range(w):
        three = work[(SIGNS + 2) * W + l]
        qx, qy, qz = work[MIDDLE * W + l], work[(MIDDLE + 1) * W + l], work[(MIDDLE + 2) * W + l]
        vx, vy, vz = work[AXIS * W + l], work[(AXIS + 1) * W + l], work[(AXIS + 2) * W + l]
        height = dot(ax, ay, az, qx, qy, qz)
        c5, s5, rest5, _ = solve_trig(a, b, height - along, three)
        rx, ry, rz = rotate(bx, by, bz, c5, s5, zx, zy, zz)
        # E₄ takes r to q: both have the same height along axis 4.
        nx, ny, nz = cross(rx, ry, rz, qx, qy, qz)
        flat = dot(rx, ry, rz, qx, qy, qz) - dot(ax, ay, az, rx, ry, rz) * height
        c4, s4, length4 = unit_angle(flat, dot(ax, ay, az, nx, ny, nz))
        vx, vy, vz = rotate(ax, ay, az, c4, -s4, vx, vy, vz)
        vx, vy, vz = rotate(bx, by, bz, c5, -s5, vx, vy, vz)
        work[ROOTS * W + l], work[(ROOTS + 1) * W + l] = work[LEFT * W + l], work[(LEFT + 1) * W + l]
        work[(ROOTS + 2) * W + l] = rest5
        work[3 * W + l], work[4 * W + l] = angle(s4, c4), angle(s5, c5)
        work[5 * W + l] = angle(dot(fx, fy, fz, vx, vy, vz), dot(ex, ey, ez, vx, vy, vz))
        infeasibility, conditioning, discriminant = (
            work[INFEASIBILITY * W + l],
            work[CONDITIONING * W + l],
            work[DISCRIMINANT * W + l],
        )
        weak4, fold5 = math.sqrt(length4), abs(rest5)
        work[INFEASIBILITY * W + l] = max(infeasibility, -rest5)
        work[CONDITIONING * W + l] = (
            min(conditioning, weak4) if max(infeasibility, -rest5) < far else conditioning
        )
        work[DISCRIMINANT * W + l] = min(discriminant, fold5) if infeasibility < far else discriminant
        duplicate = rest5 <= 0.0 and three < 0.0
        work[DUPLICATE * W + l] = 1.0 if duplicate else work[DUPLICATE * W + l]


@inlined
def parallel_three(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Decide all joints of an arm whose axes 2, 3 and 4 are parallel, and whose axes 5 and 6 meet."""
    W, S, size = LANES, structure, 1.0 / structure[SIZE]
    ax, ay, az, px, py, pz = S[H1], S[H1 + 1], S[H1 + 2], S[P1], S[P1 + 1], S[P1 + 2]
    hx, hy, hz, ex, ey, ez = S[H], S[H + 1], S[H + 2], S[E], S[E + 1], S[E + 2]
    bx, by, bz, zx, zy, zz = S[H5], S[H5 + 1], S[H5 + 2], S[H6], S[H6 + 1], S[H6 + 2]
    fx, fy, fz = cross(hx, hy, hz, ex, ey, ez)
    xx, xy, xz = S[X], S[X + 1], S[X + 2]
    d00, d01, d02, d10, d11, d12 = D[0, 0], D[0, 1], D[0, 2], D[1, 0], D[1, 1], D[1, 2]
    d20, d21, d22 = D[2, 0], D[2, 1], D[2, 2]
    ux = dot(d00, d01, d02, xx, xy, xz) + D[0, 3] - px
    uy = dot(d10, d11, d12, xx, xy, xz) + D[1, 3] - py
    uz = dot(d20, d21, d22, xx, xy, xz) + D[2, 3] - pz
    along = dot(ax, ay, az, hx, hy, hz)
    nx, ny, nz = cross(ax, ay, az, hx, hy, hz)
    height = dot(ax, ay, az, ux, uy, uz)
    a = dot(hx, hy, hz, ux, uy, uz) - along * height
    b = dot(nx, ny, nz, ux, uy, uz)
    c = dot(hx, hy, hz, xx - px, xy - py, xz - pz) - along * height
    # h · E₅ axis 6, as a cos + b sin + rest.
    along5 = dot(hx, hy, hz, bx, by, bz) * dot(zx, zy, zz, bx, by, bz)
    a5 = dot(hx, hy, hz, zx, zy, zz) - along5
    kx, ky, kz = cross(bx, by, bz, zx, zy, zz)
    b5 = dot(hx, hy, hz, kx, ky, kz)
    wx, wy, wz = rotated(D, S, H6)
    sx, sy, sz = S[P3] - S[P2], S[P3 + 1] - S[P2 + 1], S[P3 + 2] - S[P2 + 2]
    mx, my, mz = S[P4] - S[P3], S[P4 + 1] - S[P3 + 1], S[P4 + 2] - S[P3 + 2]
    l0, l1 = dot(ex, ey, ez, sx, sy, sz), dot(fx, fy, fz, sx, sy, sz)
    m0, m1 = dot(ex, ey, ez, mx, my, mz), dot(fx, fy, fz, mx, my, mz)
    sides = l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1
    ta, tb = l0 * m0 + l1 * m1, l1 * m0 - l0 * m1
    ox, oy, oz = px - S[P2], py - S[P2 + 1], pz - S[P2 + 2]
    tx, ty, tz = S[P4] - xx, S[P4 + 1] - xy, S[P4 + 2] - xz
    sense2, sense3, sense4 = S[SENSE], S[SENSE + 1], S[SENSE + 2]
    for l in range(w):
        one, two, three = work[SIGNS * W + l], work[(SIGNS + 1) * W + l], work[(SIGNS + 2) * W + l]
        c1, s1, rest1, length1 = solve_trig(a, b, c, one)
        # h as E₁ leaves it, and what of it D and E₆ have to make h turned back by E₅.
        rx, ry, rz = rotate(ax, ay, az, c1, s1, hx, hy, hz)
        c5, s5, rest5, _ = solve_trig(a5, b5, dot(rx, ry, rz, wx, wy, wz) - along5, three)
        gx, gy, gz = (
            d00 * rx + d10 * ry + d20 * rz,
            d01 * rx + d11 * ry + d21 * rz,
            d02 * rx + d12 * ry + d22 * rz,
        )
        vx, vy, vz = rotate(bx, by, bz, c5, -s5, hx, hy, hz)
        nx, ny, nz = cross(gx, gy, gz, vx, vy, vz)
        flat = dot(gx, gy, gz, vx, vy, vz) - dot(zx, zy, zz, gx, gy, gz) * dot(zx, zy, zz, vx, vy, vz)
        c6, s6, length6 = unit_angle(flat, dot(zx, zy, zz, nx, ny, nz))
        # What E₂ E₃ E₄ make of e.
        vx, vy, vz = rotate(bx, by, bz, c5, -s5, ex, ey, ez)
        gx, gy, gz = rotate(zx, zy, zz, c6, -s6, vx, vy, vz)
        vx, vy, vz = (
            dot(d00, d01, d02, gx, gy, gz),
            dot(d10, d11, d12, gx, gy, gz),
            dot(d20, d21, d22, gx, gy, gz),
        )
        gx, gy, gz = rotate(ax, ay, az, c1, -s1, vx, vy, vz)
        all0, all1 = dot(ex, ey, ez, gx, gy, gz), dot(fx, fy, fz, gx, gy, gz)
        # Where E₂ E₃ take the point on axis 4.
        vx, vy, vz = rotate(bx, by, bz, c5, -s5, tx, ty, tz)
        gx, gy, gz = rotate(zx, zy, zz, c6, -s6, vx, vy, vz)
        vx, vy, vz = (
            dot(d00, d01, d02, gx, gy, gz),
            dot(d10, d11, d12, gx, gy, gz),
            dot(d20, d21, d22, gx, gy, gz),
        )
        gx, gy, gz = rotate(ax, ay, az, c1, -s1, vx + ux, vy + uy, vz + uz)
        gx, gy, gz = gx + ox, gy + oy, gz + oz
        g0, g1 = dot(ex, ey, ez, gx, gy, gz), dot(fx, fy, fz, gx, gy, gz)
        c3, s3, rest3, _ = solve_trig(ta, tb, 0.5 * (g0 * g0 + g1 * g1 - sides), two)
        v0, v1 = l0 + c3 * m0 - s3 * m1, l1 + c3 * m1 + s3 * m0
        c2, s2, length2 = unit_angle(v0 * g0 + v1 * g1, v0 * g1 - v1 * g0)
        cosine, sine = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        work[l], work[4 * W + l], work[5 * W + l] = angle(s1, c1), angle(s5, c5), angle(s6, c6)
        work[W + l], work[2 * W + l] = sense2 * angle(s2, c2), sense3 * angle(s3, c3)
        work[3 * W + l] = sense4 * angle(all1 * cosine - all0 * sine, all0 * cosine + all1 * sine)
        weak1, weak2, weak6 = length1 * size, math.sqrt(length2) * size, math.sqrt(length6)
        fold1, fold3, fold5 = abs(rest1), abs(rest3), abs(rest5)
        fold5 = fold5 if rest1 > -far else 1.0
        weak6 = weak6 if min(rest1, rest5) > -far else 1.0
        fold3 = fold3 if min(rest1, rest5) > -far else 1.0
        weak2 = weak2 if min(rest1, rest3, rest5) > -far else 1.0
        work[INFEASIBILITY * W + l] = max(-rest1, -rest3, -rest5, 0.0)
        work[ROOTS * W + l], work[(ROOTS + 1) * W + l] = rest1 * weak1 * weak1, rest3
        work[(ROOTS + 2) * W + l] = rest5
        work[CONDITIONING * W + l] = min(weak1, weak2, weak6)
        work[DISCRIMINANT * W + l] = min(fold1 * min(weak1, 1.0), fold3, fold5)
        again1, again3 = rest1 <= 0.0 and one < 0.0, rest3 <= 0.0 and two < 0.0
        again5 = rest5 <= 0.0 and three < 0.0
        work[DUPLICATE * W + l] = 1.0 if again1 or again3 or again5 else 0.0
