"""Closed-form solutions of arms with intersecting or parallel axes, one candidate in each SIMD lane.

The arm is a product of rotations about the axes as they stand at q = 0, ``T = E₁(q₁) … E₆(q₆) T₀`` (Brockett 1984). The
displacement ``D = T T₀⁻¹`` is the product of these rotations. A joint that a quadratic equation determines has two
solutions. There are three such equations, and the three signs of a lane choose one solution of each. An arm that has the
structure at its distal end is solved backwards: ``D⁻¹ = E₆(-q₆) … E₁(-q₁)``.

Axes 2 and 3 are parallel to h, and the last axes do not move a point x. Let ``c = D x``. Rotations about h keep the
component along h, so E₁⁻¹ c and x have the same component along h. This equation determines q₁. The rest is a triangle in
the plane normal to h.

- A wrist whose three axes intersect in x (Pieper 1968): the triangle determines q₂ and q₃, and the remaining orientation
  determines the wrist.
- Axis 4 is parallel as well, and axes 5 and 6 intersect in x: the orientation of h determines q₅ and q₆, and the triangle
  determines the other joints.

If such a wrist is distal to axes 1 and 2 that intersect, its distance from their intersection determines q₃, and its
direction determines q₂ and q₁. An arm with a seventh, swept joint has these solutions for each value of that joint, see
`swept_joint`.
"""

from __future__ import annotations

import math

from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.jit import inlined

from .subproblems import angle, cross, dot, rotate, solve_trig, unit_angle

NONE, WRIST, PARALLEL, MEETING = range(4)
"""Kinds: no closed form; a spherical wrist distal to two parallel axes; three parallel axes proximal to two that
intersect; and a spherical wrist distal to one axis that follows two intersecting axes."""


KIND, BACKWARD, DEVIATION, SIZE = range(4)
"""Indices into a structure: its kind; 1 for an arm that is solved backwards, else 0; the deviation of the arm from the
structure [rad], with lengths divided by its size; and that size [m]."""


SENSE = 4
"""First of three entries for axes 2, 3 and 4: 1 if the axis has the direction of h, -1 if it has the opposite direction."""


HOME = 7
"""First entry of T₀⁻¹, (3, 4) in row-major order. An arm that is solved backwards has T₀ here."""


H1, P1, H, E, X, H4, H5, H6, A6, P2, P3, P4 = range(HOME + 12, HOME + 12 + 3 * 12, 3)
"""First entries of vectors: the directions of axes 1, 4, 5 and 6, and h, the common direction of parallel axes; E normal
to h and A6 normal to axis 6; the point x; and a point on each of the first axes."""


H2, H3 = H, E
"""Directions of axes 2 and 3 for `MEETING`. P1 is then the intersection of axes 1 and 2."""


SWEPT, SLIDES = P4 + 3, P4 + 4
"""The number of values that are tried of the swept joint, 0 if there is no such joint; and 1 if that joint is prismatic."""


HS, PS, AS = range(P4 + 5, P4 + 5 + 3 * 3, 3)
"""First entries of vectors of the swept joint: its direction, a point on it, and a normal to it."""


SWEPT_VALUES = AS + 3
"""First entry of the offsets that are tried, relative to the direction of the target [rad] or [m], see `swept_joint`."""


VALUES = 8
"""Largest number of offsets."""


NUMBERS = SWEPT_VALUES + VALUES
"""Length of a structure."""


ROUNDING = 1e-9
"""Deviation up to which an arm has its structure exactly: it covers the rounding of doubles in its description only."""


LOOSE = 1e-5
"""Tolerances [m] and [rad] up to which the closed form is complete. With looser ones the solutions form regions, which
the closed form does not describe."""


INFEASIBLE, BESIDE = 0.02, 1e-3
"""A candidate is tried if its infeasibility is at most the first value, and if it lies at most the second beyond a limit
[rad]. Both grow with the deviation of the arm from its structure, and with the tolerances."""


CLEAR = 1e-6
"""The two solutions of the equations are distinct if every discriminant is larger than this, see `ROOTS`."""


FREE = 2e-4
"""Conditioning below which an angle is undetermined. The solutions are then continua, within the tolerances."""


SPREAD = 10.0
"""Factor from the deviation of the arm from its structure to the error of its equations."""


INFEASIBILITY, CONDITIONING, DISCRIMINANT, DUPLICATE = range(6, 10)
"""Rows after the six angles of a lane. The largest infeasibility of its equations, 0 where all have a solution. The
smallest conditioning of its angles, 0 where one is undetermined. The smallest absolute discriminant of its equations,
reduced where an equation is poorly conditioned. And 1 for a duplicate: a lane whose solution coincides with that of
another lane."""


MIDDLE, AXIS = 10, 13
"""Rows of the orientation that remains after the first three joints: the directions of axis 6 and of A6, 3 each."""


ROOTS, LEFT = MIDDLE, 3
"""ROOTS is the first row of the discriminants of the three quadratic equations, once the candidates are complete. A
discriminant is negative where its equation has no solution. Unlike `INFEASIBILITY` it varies smoothly with the target. Until
the wrist is solved, rows from LEFT on hold the discriminants of the first three joints; angles of the wrist replace them
later."""


ROWS = 16
"""Number of rows that the lanes work on."""


GIVEN = AXIS
"""Row of the value of the swept joint, once the candidates are complete."""


SIGNS = ROWS
"""First of the three rows of signs."""


WORK = (SIGNS + 3) * LANES
"""Length of the work array: all these rows."""


@inlined
def set_signs(work: Array) -> None:
    """Set the three signs of each lane."""
    for l in range(LANES):
        for k in range(3):
            work[(SIGNS + k) * LANES + l] = 1.0 - 2.0 * ((l >> k) & 1)


@inlined
def displacement(structure: Array, target: Array, D: Array) -> None:
    """Write the displacement D, (3, 4), or its inverse for an arm that is solved backwards."""
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
    """Row of joint i among the candidates of an arm with `dof` joints."""
    place = dof - 1 - i if structure[BACKWARD] > 0.0 else i
    if structure[SWEPT] > 0.0:
        place = place - 1 if place > 0 else GIVEN
    return place


@inlined
def joint_of(structure: Array, row: int, dof: int) -> int:
    """Joint whose angles are in a row, see `row_of`."""
    place = row + 1 if structure[SWEPT] > 0.0 else row
    return dof - 1 - place if structure[BACKWARD] > 0.0 else place


@inlined
def candidates(structure: Array, D: Array, far: float, work: Array, w: int) -> None:
    """Write the angles of eight candidates and their diagnostics into work.

    The angles of an arm that is solved backwards are in order from its last joint to its first.

    Args:
        structure: See `KIND`, (NUMBERS,).
        D: See `displacement`, (3, 4).
        far: Infeasibility beyond which the equations that depend on the infeasible one are ignored in the diagnostics.
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
    """Solve the first three joints, the last two of them parallel, from the position of the wrist."""
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
    # Sides of the triangle, in the plane normal to h.
    sx, sy, sz = S[P3] - S[P2], S[P3 + 1] - S[P2 + 1], S[P3 + 2] - S[P2 + 2]
    mx, my, mz = xx - S[P3], xy - S[P3 + 1], xz - S[P3 + 2]
    l0, l1 = dot(ex, ey, ez, sx, sy, sz), dot(fx, fy, fz, sx, sy, sz)
    m0, m1 = dot(ex, ey, ez, mx, my, mz), dot(fx, fy, fz, mx, my, mz)
    sides = l0 * l0 + l1 * l1 + m0 * m0 + m1 * m1
    ta, tb = l0 * m0 + l1 * m1, l1 * m0 - l0 * m1
    ox, oy, oz = px - S[P2], py - S[P2 + 1], pz - S[P2 + 2]
    # Directions of the last axis and of its normal, from which the rotations of the first joints are removed for the
    # wrist.
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
    """Solve the first three joints, the first two of them intersecting, from the position of the wrist."""
    W, S, size = LANES, structure, 1.0 / structure[SIZE]
    ax, ay, az, bx, by, bz = S[H1], S[H1 + 1], S[H1 + 2], S[H2], S[H2 + 1], S[H2 + 2]
    hx, hy, hz, px, py, pz = S[H3], S[H3 + 1], S[H3 + 2], S[P1], S[P1 + 1], S[P1 + 2]
    xx, xy, xz = S[X], S[X + 1], S[X + 2]
    ux = dot(D[0, 0], D[0, 1], D[0, 2], xx, xy, xz) + D[0, 3] - px
    uy = dot(D[1, 0], D[1, 1], D[1, 2], xx, xy, xz) + D[1, 3] - py
    uz = dot(D[2, 0], D[2, 1], D[2, 2], xx, xy, xz) + D[2, 3] - pz
    # |m + E₃ r| = |u|, as a cos + b sin + rest. m leads from the intersection of axes 1 and 2 to axis 3, r from there to
    # x.
    mx, my, mz = S[P3] - px, S[P3 + 1] - py, S[P3 + 2] - pz
    rx, ry, rz = xx - S[P3], xy - S[P3 + 1], xz - S[P3 + 2]
    along = dot(hx, hy, hz, mx, my, mz) * dot(hx, hy, hz, rx, ry, rz)
    a = dot(mx, my, mz, rx, ry, rz) - along
    nx, ny, nz = cross(hx, hy, hz, rx, ry, rz)
    b = dot(mx, my, mz, nx, ny, nz)
    square = dot(ux, uy, uz, ux, uy, uz)
    c = 0.5 * (square - dot(mx, my, mz, mx, my, mz) - dot(rx, ry, rz, rx, ry, rz)) - along
    # axis 1 · E₂ v equals the component of u along axis 1.
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
    """Rotate a vector of a structure by D."""
    x, y, z = S[first], S[first + 1], S[first + 2]
    return (
        D[0, 0] * x + D[0, 1] * y + D[0, 2] * z,
        D[1, 0] * x + D[1, 1] * y + D[1, 2] * z,
        D[2, 0] * x + D[2, 1] * y + D[2, 2] * z,
    )


@inlined
def wrist(structure: Array, far: float, work: Array, w: int) -> None:
    """Solve the last three joints from the remaining orientation."""
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
        # E₄ takes r to q: both have the same component along axis 4.
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
    """Solve all joints of an arm whose axes 2, 3 and 4 are parallel and whose axes 5 and 6 intersect."""
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
        # r is h rotated by E₁. E₅ is solved from the component along axis 6, and E₆ from the directions across it.
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
        # The vector e rotated by E₂ E₃ E₄.
        vx, vy, vz = rotate(bx, by, bz, c5, -s5, ex, ey, ez)
        gx, gy, gz = rotate(zx, zy, zz, c6, -s6, vx, vy, vz)
        vx, vy, vz = (
            dot(d00, d01, d02, gx, gy, gz),
            dot(d10, d11, d12, gx, gy, gz),
            dot(d20, d21, d22, gx, gy, gz),
        )
        gx, gy, gz = rotate(ax, ay, az, c1, -s1, vx, vy, vz)
        all0, all1 = dot(ex, ey, ez, gx, gy, gz), dot(fx, fy, fz, gx, gy, gz)
        # The point on axis 4, as E₂ E₃ move it.
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
