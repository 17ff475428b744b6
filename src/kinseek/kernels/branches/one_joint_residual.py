"""Residual of an arm with one searched joint, and its other joints for a given value of that joint.

The arm is a product of rotations about its axes as they stand at q = 0, see `structure.candidates`. The searched joint
determines a point and the position to which joints 1, 2 and 3 have to move it. They have up to four ways to do so, which
two signs distinguish. Each way gives the required direction of the last axis in the frame of the wrist. The residual
compares its angle to the other axis of the wrist with the angle that the wrist has.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.vectors import rotated, vector_at
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.jit import inlined
from kinseek.kernels.structure import candidates
from kinseek.kernels.structure.candidates import H1, H6, P1, P2, P3, SENSE, SIZE, E, H
from kinseek.kernels.structure.subproblems import angle, cross, dot, rotate, solve_trig, unit_angle

SAMPLES = 128
"""Number of samples of the joint."""


BEGIN, APART, SEARCHED, OTHER = range(candidates.NUMBERS, candidates.NUMBERS + 4)
"""Indices after those of a structure, of which vectors, home and size are used: the first sample and the distance of
samples [rad]; the index of the searched joint; and the index of the other joint of the wrist beside the last."""


NUMBERS = OTHER + 1
"""Length of these numbers."""


HEIGHT, LINK, COSINE, FIRST, NEAR, AXIS, SECOND = 0, 1, 3, 4, 7, 10, 13
"""First rows of parts of the table, which has a column for each sample. For the point that joints 1 to 3 move: its height
along the parallel axes, and its position normal to them, relative to axis 3. The cosine of the angle between the other
axis of the wrist and the last one. The other axis, along the parallel axes and normal to them. And in the frame of the
base: the point as the last axis has it at q = 0; the last axis after the searched joint; and the direction onto which
the last joint has to rotate the other axis."""


PLACES = SECOND + 3
"""Number of rows of the table."""


VALUE, ROOM = 16, 20
"""Rows of the lanes after those of the table: the residuals of four ways; and the room of the equations, see
`write_residuals`, four rows."""


LANE_ROWS = ROOM + 4
"""Number of rows that the lanes work on."""


@inlined
def seen_by(
    D: Array, x: float, y: float, z: float, tx: float, ty: float, tz: float
) -> tuple[float, float, float, float]:
    """Coefficients of the scalar product of (x, y, z) with D v + t as a function of v: three factors and a constant."""
    return (
        D[0, 0] * x + D[1, 0] * y + D[2, 0] * z,
        D[0, 1] * x + D[1, 1] * y + D[2, 1] * z,
        D[0, 2] * x + D[1, 2] * y + D[2, 2] * z,
        dot(x, y, z, tx, ty, tz),
    )


@inlined
def triangle(
    g0: float, g1: float, m0: float, m1: float, u0: float, u1: float, square: float, per: float, least: float
) -> tuple[float, float, float]:
    """``u₀ cos + u₁ sin`` of the angle by which a triangle rotates its second side, for both triangles.

    Args:
        g0: Third side.
        g1: Third side.
        m0: Second side before the rotation.
        m1: Second side before the rotation.
        u0: Weight of the cosine.
        u1: Weight of the sine.
        square: Squared length of the first side.
        per: One over the squared length of the second side.
        least: Lower bound of the squared length of the third side.

    Returns:
        Mean of both values, half their difference, and the square of the sine of the angle between the first sides, which
        is negative if there is no triangle.
    """
    gg = max(g0 * g0 + g1 * g1, least)
    part = gg + square - m0 * m0 - m1 * m1
    rest, half = 4.0 * gg * square - part * part, 0.5 / gg
    # Components of the second side along the third and normal to it.
    part, across = (1.0 - part * half) * per, math.sqrt(max(rest, 0.0)) * half * per
    along, beside = m0 * g0 + m1 * g1, m0 * g1 - m1 * g0
    return part * (u0 * along + u1 * beside), across * (u1 * along - u0 * beside), 0.25 * rest * per / square


@inlined
def write_residuals(S: Array, D: Array, table: Array, many: int, seen: Array, work: Array, w: int) -> None:
    """Write the residual, and the room of its equations, into seen, (8, many).

    If an equation has no solution, the residual is continued and has no meaning.

    Args:
        S: Numbers of the arm, see `BEGIN`.
        D: See `candidates.displacement`, (3, 4).
        table: See `HEIGHT`, (PLACES, many).
        many: Number of columns, a multiple of LANES.
        seen: Receives the residuals of four ways, ordered by the solution of joint 1 and then by that of joint 3. Then
            the distance of the equation of joint 1 from a double root, and that of joint 3 for both solutions of joint 1;
            it is negative if no solution exists. Then the squared distance of the point from axis 1, relative to the
            arm's size.
        work: Scratch memory, (LANE_ROWS * LANES,).
        w: LANES.
    """
    W, scale, least = LANES, 1.0 / (S[SIZE] * S[SIZE]), 1e-12 * S[SIZE] * S[SIZE]
    ax, ay, az, hx, hy, hz = S[H1], S[H1 + 1], S[H1 + 2], S[H], S[H + 1], S[H + 2]
    ex, ey, ez, px, py, pz = S[E], S[E + 1], S[E + 2], S[P1], S[P1 + 1], S[P1 + 2]
    fx, fy, fz = cross(hx, hy, hz, ex, ey, ez)
    tx, ty, tz = D[0, 3] - px, D[1, 3] - py, D[2, 3] - pz
    # Components of E₁⁻¹ u along h, e and f: a constant part, and factors of the cosine and of the sine.
    ah, ae, af = dot(ax, ay, az, hx, hy, hz), dot(ax, ay, az, ex, ey, ez), dot(ax, ay, az, fx, fy, fz)
    hsx, hsy, hsz = cross(ax, ay, az, hx, hy, hz)
    esx, esy, esz = cross(ax, ay, az, ex, ey, ez)
    fsx, fsy, fsz = cross(ax, ay, az, fx, fy, fz)
    a0, a1, a2, a3 = seen_by(D, ax, ay, az, tx, ty, tz)
    h0, h1, h2, h3 = seen_by(D, hx - ah * ax, hy - ah * ay, hz - ah * az, tx, ty, tz)
    e0, e1, e2, e3 = seen_by(D, ex - ae * ax, ey - ae * ay, ez - ae * az, tx, ty, tz)
    f0, f1, f2, f3 = seen_by(D, fx - af * ax, fy - af * ay, fz - af * az, tx, ty, tz)
    i0, i1, i2, i3 = seen_by(D, hsx, hsy, hsz, tx, ty, tz)
    j0, j1, j2, j3 = seen_by(D, esx, esy, esz, tx, ty, tz)
    k0, k1, k2, k3 = seen_by(D, fsx, fsy, fsz, tx, ty, tz)
    zx, zy, zz = S[H6], S[H6 + 1], S[H6 + 2]
    va = dot(a0, a1, a2, zx, zy, zz)
    vh, ve, vf = dot(h0, h1, h2, zx, zy, zz), dot(e0, e1, e2, zx, zy, zz), dot(f0, f1, f2, zx, zy, zz)
    wh, we, wf = dot(i0, i1, i2, zx, zy, zz), dot(j0, j1, j2, zx, zy, zz), dot(k0, k1, k2, zx, zy, zz)
    nh, ne, nf = va * ah, va * ae, va * af
    l0, l1 = link(S)
    square = l0 * l0 + l1 * l1
    ox, oy, oz = px - S[P2], py - S[P2 + 1], pz - S[P2 + 2]
    oe, of = dot(ox, oy, oz, ex, ey, ez), dot(ox, oy, oz, fx, fy, fz)
    for begin in range(0, many, LANES):
        for r in range(AXIS):
            for l in range(w):
                work[r * W + l] = table[r, begin + l]
        for l in range(w):
            x, y, z = work[NEAR * W + l], work[(NEAR + 1) * W + l], work[(NEAR + 2) * W + l]
            m0, m1 = work[LINK * W + l], work[(LINK + 1) * W + l]
            o0, o1, o2 = work[FIRST * W + l], work[(FIRST + 1) * W + l], work[(FIRST + 2) * W + l]
            still = a0 * x + a1 * y + a2 * z + a3
            p, q = h0 * x + h1 * y + h2 * z + h3, i0 * x + i1 * y + i2 * z + i3
            r = work[HEIGHT * W + l] - ah * still
            e_c, e_s = e0 * x + e1 * y + e2 * z + e3, j0 * x + j1 * y + j2 * z + j3
            f_c, f_s = f0 * x + f1 * y + f2 * z + f3, k0 * x + k1 * y + k2 * z + k3
            e_n, f_n = ae * still + oe, af * still + of
            length = p * p + q * q
            rest = length - r * r
            side = math.sqrt(max(rest, 0.0))
            share = 1.0 / max(length, least)
            work[ROOM * W + l], work[(ROOM + 3) * W + l] = rest * scale, length * scale
            mm = m0 * m0 + m1 * m1
            per = 1.0 / max(mm, least)
            # p cos + q sin = r, in the order of `subproblems.solve_trig`.
            c, s = (p * r - q * side) * share, (q * r + p * side) * share
            high = o0 * (nh + c * vh + s * wh) - work[COSINE * W + l]
            g0, g1, q0, q1 = (
                e_n + c * e_c + s * e_s,
                f_n + c * f_c + s * f_s,
                ne + c * ve + s * we,
                nf + c * vf + s * wf,
            )
            mean, swing, rest = triangle(
                g0, g1, m0, m1, o1 * q0 + o2 * q1, o1 * q1 - o2 * q0, square, per, least
            )
            work[VALUE * W + l], work[(VALUE + 1) * W + l] = high + mean + swing, high + mean - swing
            work[(ROOM + 1) * W + l] = rest
            c, s = (p * r + q * side) * share, (q * r - p * side) * share
            high = o0 * (nh + c * vh + s * wh) - work[COSINE * W + l]
            g0, g1, q0, q1 = (
                e_n + c * e_c + s * e_s,
                f_n + c * f_c + s * f_s,
                ne + c * ve + s * we,
                nf + c * vf + s * wf,
            )
            mean, swing, rest = triangle(
                g0, g1, m0, m1, o1 * q0 + o2 * q1, o1 * q1 - o2 * q0, square, per, least
            )
            work[(VALUE + 2) * W + l], work[(VALUE + 3) * W + l] = high + mean + swing, high + mean - swing
            work[(ROOM + 2) * W + l] = rest
        for r in range(8):
            for l in range(w):
                seen[r, begin + l] = work[(VALUE + r) * W + l]


@inlined
def link(S: Array) -> tuple[float, float]:
    """Vector from axis 2 to axis 3, normal to them."""
    sx, sy, sz = S[P3] - S[P2], S[P3 + 1] - S[P2 + 1], S[P3 + 2] - S[P2 + 2]
    fx, fy, fz = cross(S[H], S[H + 1], S[H + 2], S[E], S[E + 1], S[E + 2])
    return dot(S[E], S[E + 1], S[E + 2], sx, sy, sz), dot(fx, fy, fz, sx, sy, sz)


@inlined
def complete(S: Array, D: Array, table: Array, begin: int, roots: Array, work: Array, w: int) -> None:
    """Write six joint values of every lane into work, six rows, in the order 1, 2, 3, searched, other, last.

    Args:
        S: Numbers of the arm, see `BEGIN`.
        D: See `candidates.displacement`, (3, 4).
        table: The table at the roots, (PLACES, ROOTS).
        begin: The first of the roots.
        roots: See `find_roots`, (3, ROOTS).
        work: Scratch memory, (LANE_ROWS * LANES,).
        w: LANES.
    """
    W = LANES
    ax, ay, az, px, py, pz = S[H1], S[H1 + 1], S[H1 + 2], S[P1], S[P1 + 1], S[P1 + 2]
    hx, hy, hz, ex, ey, ez = S[H], S[H + 1], S[H + 2], S[E], S[E + 1], S[E + 2]
    zx, zy, zz = S[H6], S[H6 + 1], S[H6 + 2]
    fx, fy, fz = cross(hx, hy, hz, ex, ey, ez)
    d00, d01, d02, d10, d11, d12 = D[0, 0], D[0, 1], D[0, 2], D[1, 0], D[1, 1], D[1, 2]
    d20, d21, d22 = D[2, 0], D[2, 1], D[2, 2]
    tx, ty, tz = D[0, 3] - px, D[1, 3] - py, D[2, 3] - pz
    along = dot(ax, ay, az, hx, hy, hz)
    nx, ny, nz = cross(ax, ay, az, hx, hy, hz)
    l0, l1 = link(S)
    square = l0 * l0 + l1 * l1
    ox, oy, oz = px - S[P2], py - S[P2 + 1], pz - S[P2 + 2]
    vx, vy, vz = rotated(D, vector_at(S, H6))
    sense2, sense3 = S[SENSE], S[SENSE + 1]
    for r in range(PLACES):
        for l in range(w):
            work[r * W + l] = table[r, begin + l]
    for r in range(3):
        for l in range(w):
            work[(PLACES + r) * W + l] = roots[r, begin + l]
    for l in range(w):
        value, one, two = work[PLACES * W + l], work[(PLACES + 1) * W + l], work[(PLACES + 2) * W + l]
        yx, yy, yz = work[NEAR * W + l], work[(NEAR + 1) * W + l], work[(NEAR + 2) * W + l]
        ux, uy, uz = (
            dot(d00, d01, d02, yx, yy, yz) + tx,
            dot(d10, d11, d12, yx, yy, yz) + ty,
            dot(d20, d21, d22, yx, yy, yz) + tz,
        )
        height = dot(ax, ay, az, ux, uy, uz)
        p, q = dot(hx, hy, hz, ux, uy, uz) - along * height, dot(nx, ny, nz, ux, uy, uz)
        c1, s1, _, _ = solve_trig(p, q, work[HEIGHT * W + l] - along * height, one)
        gx, gy, gz = rotate(ax, ay, az, c1, -s1, ux, uy, uz)
        gx, gy, gz = gx + ox, gy + oy, gz + oz
        g0, g1 = dot(ex, ey, ez, gx, gy, gz), dot(fx, fy, fz, gx, gy, gz)
        m0, m1 = work[LINK * W + l], work[(LINK + 1) * W + l]
        ta, tb, sides = l0 * m0 + l1 * m1, l1 * m0 - l0 * m1, square + m0 * m0 + m1 * m1
        c3, s3, _, _ = solve_trig(ta, tb, 0.5 * (g0 * g0 + g1 * g1 - sides), two)
        v0, v1 = l0 + c3 * m0 - s3 * m1, l1 + c3 * m1 + s3 * m0
        c2, s2, _ = unit_angle(v0 * g0 + v1 * g1, v0 * g1 - v1 * g0)
        c, s = c2 * c3 - s2 * s3, s2 * c3 + c2 * s3
        # The other axis rotates the last axis, as it stands after the searched joint, onto its required direction.
        qx, qy, qz = rotate(ax, ay, az, c1, -s1, vx, vy, vz)
        qx, qy, qz = rotate(hx, hy, hz, c, -s, qx, qy, qz)
        o0, o1, o2 = work[FIRST * W + l], work[(FIRST + 1) * W + l], work[(FIRST + 2) * W + l]
        bx, by, bz = o0 * hx + o1 * ex + o2 * fx, o0 * hy + o1 * ey + o2 * fy, o0 * hz + o1 * ez + o2 * fz
        nnx, nny, nnz = work[AXIS * W + l], work[(AXIS + 1) * W + l], work[(AXIS + 2) * W + l]
        kx, ky, kz = cross(nnx, nny, nnz, qx, qy, qz)
        flat = dot(nnx, nny, nnz, qx, qy, qz) - dot(bx, by, bz, nnx, nny, nnz) * dot(bx, by, bz, qx, qy, qz)
        other = angle(dot(bx, by, bz, kx, ky, kz), flat)
        # The other axis in the frame of the tip; the last joint has to rotate it onto SECOND.
        bx, by, bz = rotate(hx, hy, hz, c, s, bx, by, bz)
        bx, by, bz = rotate(ax, ay, az, c1, s1, bx, by, bz)
        rx, ry, rz = (
            d00 * bx + d10 * by + d20 * bz,
            d01 * bx + d11 * by + d21 * bz,
            d02 * bx + d12 * by + d22 * bz,
        )
        mx, my, mz = work[SECOND * W + l], work[(SECOND + 1) * W + l], work[(SECOND + 2) * W + l]
        kx, ky, kz = cross(rx, ry, rz, mx, my, mz)
        flat = dot(rx, ry, rz, mx, my, mz) - dot(zx, zy, zz, rx, ry, rz) * dot(zx, zy, zz, mx, my, mz)
        last = angle(dot(zx, zy, zz, kx, ky, kz), flat)
        work[l] = angle(s1, c1)
        work[W + l], work[2 * W + l] = sense2 * angle(s2, c2), sense3 * angle(s3, c3)
        work[3 * W + l], work[4 * W + l], work[5 * W + l] = value, other, last


@inlined
def between(S: Array, table: Array, value: float, rows: int, into: Array, place: int) -> None:
    """Interpolate rows of the table at a value of the joint by cubics through four samples; write a column of another."""
    x = (value - S[BEGIN]) / S[APART]
    k = min(max(int(x) - 1, 0), table.shape[1] - 4)
    x -= k
    a, b, c, d = x, x - 1.0, x - 2.0, x - 3.0
    w0, w1, w2, w3 = -b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0
    for r in range(rows):
        y0, y1, y2, y3 = table[r, k], table[r, k + 1], table[r, k + 2], table[r, k + 3]
        into[r, place] = w0 * y0 + w1 * y1 + w2 * y2 + w3 * y3
