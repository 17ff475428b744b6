"""Damped Newton steps for eight configurations at once, one in each SIMD lane.

Every array is flat, row after row of `LANES` numbers, and every innermost loop runs over the lanes, so that LLVM makes
one vector instruction of it. The trip count is an argument, `w`, always equal to `LANES`: were it a constant, LLVM would
unroll the loop before it could vectorise it. No lane ever looks at another, so a lane's result does not depend on its
neighbours: the same bits come out whatever is solved beside it.

The step is that of Levenberg and Marquardt with Chan's damping (Chan and Lawrence 1988): with the residual e, scaled so
that metres and radians compare, ``dq = Jᵀ (J Jᵀ + λ I)⁻¹ e`` and λ proportional to |e|². The matrix is 6x6 however many
joints there are. At a limit the step follows an active set: a joint that stands at a limit and is pushed outward is taken
out of J; it is never clamped behind the solver's back.
"""

from __future__ import annotations

from typing import NamedTuple

from .arrays import Array, ChainArrays
from .jit import inner, view
from .pointers import part1, part2
from .trigonometry import sine_cosine

LANES = 8


class Lanes(NamedTuple):
    """Eight configurations on their way; row r of lane l is element ``r · LANES + l`` of a flat array."""

    q: Array
    """Joint values, (n, LANES)."""
    target: Array
    """Wanted poses, 12 rows, row-major (3, 4)."""
    pose: Array
    """Tip poses at q, 12 rows."""
    axes: Array
    """Axis direction and a point on it of every physical joint, and of the tip, 6 rows each, (m+1, 6 · LANES)."""
    jacobian: Array
    """Columns of the scaled Jacobian, 6 rows each, (n, 6 · LANES)."""
    gram: Array
    """Lower triangle of J Jᵀ + λ I, 21 rows, then its factor."""
    residual: Array
    """Scaled residual e, 6 rows, then the solution of the 6x6 system."""
    step: Array
    """dq, (n, LANES)."""
    work: Array
    """What a loop carries to the next, 4 rows."""
    error: Array
    """Squared position error [m²], squared sine of the angle, its cosine, and |e|², 4 rows."""
    weight: Array
    """Scale of the position rows [1/m] and of the orientation rows, 2 rows."""


@inner
def lanes_size(dof: int, joints: int) -> int:
    """Numbers that the lanes of an arm take in memory."""
    return (8 * dof + 6 * (joints + 1) + 12 + 12 + 21 + 6 + 4 + 4 + 2) * LANES


@view
def make_lanes(address: int, dof: int, joints: int) -> Lanes:
    """Lay lanes out in a memory."""
    W = LANES
    fixed = (8 * dof + 6 * (joints + 1)) * W
    return Lanes(
        part2(address, 0, dof, W),
        part1(address, fixed, 12 * W),
        part1(address, fixed + 12 * W, 12 * W),
        part2(address, 8 * dof * W, joints + 1, 6 * W),
        part2(address, dof * W, dof, 6 * W),
        part1(address, fixed + 24 * W, 21 * W),
        part1(address, fixed + 45 * W, 6 * W),
        part2(address, 7 * dof * W, dof, W),
        part1(address, fixed + 51 * W, 4 * W),
        part1(address, fixed + 55 * W, 4 * W),
        part1(address, fixed + 59 * W, 2 * W),
    )


@inner
def lanes_forward(chain: ChainArrays, lanes: Lanes, w: int) -> None:
    """Forward kinematics of every lane, keeping every joint's axis."""
    W, A, q, T, axes, joints = LANES, chain.fixed, lanes.q, lanes.pose, lanes.axes, len(chain.leader)
    for i in range(12 * LANES):
        T[i] = 0.0
    for l in range(w):
        T[l] = 1.0
        T[5 * W + l] = 1.0
        T[10 * W + l] = 1.0
    for k in range(joints + 1):
        i, scale, shift, turn, slide = 0, 0.0, 0.0, 0.0, 0.0
        if k < joints:
            i, scale, shift = chain.leader[k], chain.multiplier[k], chain.offset[k]
            turn, slide = (0.0, 1.0) if chain.prismatic[k] else (1.0, 0.0)
        a00, a01, a02, a03 = A[k, 0, 0], A[k, 0, 1], A[k, 0, 2], A[k, 0, 3]
        a10, a11, a12, a13 = A[k, 1, 0], A[k, 1, 1], A[k, 1, 2], A[k, 1, 3]
        a20, a21, a22, a23 = A[k, 2, 0], A[k, 2, 1], A[k, 2, 2], A[k, 2, 3]
        for l in range(w):
            value = scale * q[i, l] + shift
            s, c = sine_cosine(turn * value)
            d = slide * value
            t0, t1, t2, t3 = T[l], T[W + l], T[2 * W + l], T[3 * W + l]
            x, y = t0 * a00 + t1 * a10 + t2 * a20, t0 * a01 + t1 * a11 + t2 * a21
            z = t0 * a02 + t1 * a12 + t2 * a22
            p = t0 * a03 + t1 * a13 + t2 * a23 + t3 + z * d
            T[l], T[W + l], T[2 * W + l], T[3 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, l], axes[k, 3 * W + l] = z, p
            t0, t1, t2, t3 = T[4 * W + l], T[5 * W + l], T[6 * W + l], T[7 * W + l]
            x, y = t0 * a00 + t1 * a10 + t2 * a20, t0 * a01 + t1 * a11 + t2 * a21
            z = t0 * a02 + t1 * a12 + t2 * a22
            p = t0 * a03 + t1 * a13 + t2 * a23 + t3 + z * d
            T[4 * W + l], T[5 * W + l], T[6 * W + l], T[7 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, W + l], axes[k, 4 * W + l] = z, p
            t0, t1, t2, t3 = T[8 * W + l], T[9 * W + l], T[10 * W + l], T[11 * W + l]
            x, y = t0 * a00 + t1 * a10 + t2 * a20, t0 * a01 + t1 * a11 + t2 * a21
            z = t0 * a02 + t1 * a12 + t2 * a22
            p = t0 * a03 + t1 * a13 + t2 * a23 + t3 + z * d
            T[8 * W + l], T[9 * W + l], T[10 * W + l], T[11 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, 2 * W + l], axes[k, 5 * W + l] = z, p


@inner
def lanes_residual(lanes: Lanes, columns: Array, w: int) -> None:
    """Residual and errors of every lane.

    The orientation part is ``Σ_c columns_c c × c_g``, the downhill direction of ``Σ_c columns_c (1 - c·c_g)``.
    """
    T, G, e, error, weight = lanes.pose, lanes.target, lanes.residual, lanes.error, lanes.weight
    W = LANES
    for l in range(w):
        dx, dy, dz = G[3 * W + l] - T[3 * W + l], G[7 * W + l] - T[7 * W + l], G[11 * W + l] - T[11 * W + l]
        error[l] = dx * dx + dy * dy + dz * dz
        wp = weight[l]
        e[l], e[W + l], e[2 * W + l] = wp * dx, wp * dy, wp * dz
        e[3 * W + l] = e[4 * W + l] = e[5 * W + l] = 0.0
        error[2 * W + l] = 0.0
    for c in range(3):
        col, o = columns[c], c * W
        if col == 0.0:
            continue
        for l in range(w):
            ax, ay, az = T[o + l], T[o + 4 * W + l], T[o + 8 * W + l]
            bx, by, bz = G[o + l], G[o + 4 * W + l], G[o + 8 * W + l]
            e[3 * W + l] += col * (ay * bz - az * by)
            e[4 * W + l] += col * (az * bx - ax * bz)
            e[5 * W + l] += col * (ax * by - ay * bx)
            error[2 * W + l] += col * (ax * bx + ay * by + az * bz)
    for l in range(w):
        ex, ey, ez = e[3 * W + l], e[4 * W + l], e[5 * W + l]
        error[W + l] = ex * ex + ey * ey + ez * ez
        wo = weight[W + l]
        e[3 * W + l], e[4 * W + l], e[5 * W + l] = wo * ex, wo * ey, wo * ez
        error[3 * W + l] = weight[l] * weight[l] * error[l] + wo * wo * error[W + l]


@inner
def lanes_jacobian(chain: ChainArrays, lanes: Lanes, free: float, w: int) -> None:
    """Scaled geometric Jacobian of every lane; with `free` 1 a turn about the tool's x axis does not count."""
    W, T, J, axes, weight = LANES, lanes.pose, lanes.jacobian, lanes.axes, lanes.weight
    for i in range(len(chain.lower)):
        for l in range(6 * w):
            J[i, l] = 0.0
    for k in range(len(chain.leader)):
        i, scale = chain.leader[k], chain.multiplier[k]
        if chain.prismatic[k]:
            for l in range(w):
                wp = scale * weight[l]
                J[i, l] += wp * axes[k, l]
                J[i, W + l] += wp * axes[k, W + l]
                J[i, 2 * W + l] += wp * axes[k, 2 * W + l]
            continue
        for l in range(w):
            zx, zy, zz = axes[k, l], axes[k, W + l], axes[k, 2 * W + l]
            px = T[3 * W + l] - axes[k, 3 * W + l]
            py = T[7 * W + l] - axes[k, 4 * W + l]
            pz = T[11 * W + l] - axes[k, 5 * W + l]
            wp, wo = scale * weight[l], scale * weight[W + l]
            tx, ty, tz = T[l], T[4 * W + l], T[8 * W + l]
            along = free * (zx * tx + zy * ty + zz * tz)
            J[i, l] += wp * (zy * pz - zz * py)
            J[i, W + l] += wp * (zz * px - zx * pz)
            J[i, 2 * W + l] += wp * (zx * py - zy * px)
            J[i, 3 * W + l] += wo * (zx - along * tx)
            J[i, 4 * W + l] += wo * (zy - along * ty)
            J[i, 5 * W + l] += wo * (zz - along * tz)


@inner
def lanes_gram(lower: Array, upper: Array, damping: float, floor: Array, lanes: Lanes, w: int) -> None:
    """J Jᵀ + λ I of every lane over the joints that may move.

    A joint that stands at a limit and is pushed outward is taken out of J. λ is damping · |e|² and a
    floor, (LANES,), that keeps the factor finite.
    """
    W, A, J, q, e = LANES, lanes.gram, lanes.jacobian, lanes.q, lanes.residual
    for i in range(21 * W):
        A[i] = 0.0
    for i in range(len(lower)):
        low, high = lower[i], upper[i]
        for l in range(w):
            j0, j1, j2 = J[i, l], J[i, W + l], J[i, 2 * W + l]
            j3, j4, j5 = J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l]
            push = j0 * e[l] + j1 * e[W + l] + j2 * e[2 * W + l]
            push += j3 * e[3 * W + l] + j4 * e[4 * W + l] + j5 * e[5 * W + l]
            held = (q[i, l] >= high and push > 0.0) or (q[i, l] <= low and push < 0.0)
            move = 0.0 if held else 1.0
            j0, j1, j2, j3, j4, j5 = move * j0, move * j1, move * j2, move * j3, move * j4, move * j5
            J[i, l], J[i, W + l], J[i, 2 * W + l] = j0, j1, j2
            J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l] = j3, j4, j5
            A[l] += j0 * j0
            A[W + l] += j1 * j0
            A[2 * W + l] += j1 * j1
            A[3 * W + l] += j2 * j0
            A[4 * W + l] += j2 * j1
            A[5 * W + l] += j2 * j2
            A[6 * W + l] += j3 * j0
            A[7 * W + l] += j3 * j1
            A[8 * W + l] += j3 * j2
            A[9 * W + l] += j3 * j3
            A[10 * W + l] += j4 * j0
            A[11 * W + l] += j4 * j1
            A[12 * W + l] += j4 * j2
            A[13 * W + l] += j4 * j3
            A[14 * W + l] += j4 * j4
            A[15 * W + l] += j5 * j0
            A[16 * W + l] += j5 * j1
            A[17 * W + l] += j5 * j2
            A[18 * W + l] += j5 * j3
            A[19 * W + l] += j5 * j4
            A[20 * W + l] += j5 * j5
    for l in range(w):
        damp = damping * lanes.error[3 * W + l] + floor[l]
        A[l] += damp
        A[2 * W + l] += damp
        A[5 * W + l] += damp
        A[9 * W + l] += damp
        A[14 * W + l] += damp
        A[20 * W + l] += damp


@inner
def lanes_solve(lanes: Lanes, w: int) -> None:
    """Solve the 6x6 systems by Cholesky's factorisation L D Lᵀ, in place of the residual."""
    W, A, e = LANES, lanes.gram, lanes.residual
    for l in range(w):
        d0 = 1.0 / A[l]
        a10, a20, a30, a40, a50 = A[W + l], A[3 * W + l], A[6 * W + l], A[10 * W + l], A[15 * W + l]
        l10, l20, l30, l40, l50 = a10 * d0, a20 * d0, a30 * d0, a40 * d0, a50 * d0
        d1 = 1.0 / (A[2 * W + l] - l10 * a10)
        a21, a31 = A[4 * W + l] - l20 * a10, A[7 * W + l] - l30 * a10
        a41, a51 = A[11 * W + l] - l40 * a10, A[16 * W + l] - l50 * a10
        l21, l31, l41, l51 = a21 * d1, a31 * d1, a41 * d1, a51 * d1
        d2 = 1.0 / (A[5 * W + l] - l20 * a20 - l21 * a21)
        a32 = A[8 * W + l] - l30 * a20 - l31 * a21
        a42 = A[12 * W + l] - l40 * a20 - l41 * a21
        a52 = A[17 * W + l] - l50 * a20 - l51 * a21
        l32, l42, l52 = a32 * d2, a42 * d2, a52 * d2
        d3 = 1.0 / (A[9 * W + l] - l30 * a30 - l31 * a31 - l32 * a32)
        a43 = A[13 * W + l] - l40 * a30 - l41 * a31 - l42 * a32
        a53 = A[18 * W + l] - l50 * a30 - l51 * a31 - l52 * a32
        l43, l53 = a43 * d3, a53 * d3
        d4 = 1.0 / (A[14 * W + l] - l40 * a40 - l41 * a41 - l42 * a42 - l43 * a43)
        a54 = A[19 * W + l] - l50 * a40 - l51 * a41 - l52 * a42 - l53 * a43
        l54 = a54 * d4
        d5 = 1.0 / (A[20 * W + l] - l50 * a50 - l51 * a51 - l52 * a52 - l53 * a53 - l54 * a54)
        y0 = e[l]
        y1 = e[W + l] - l10 * y0
        y2 = e[2 * W + l] - l20 * y0 - l21 * y1
        y3 = e[3 * W + l] - l30 * y0 - l31 * y1 - l32 * y2
        y4 = e[4 * W + l] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
        y5 = e[5 * W + l] - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4
        x5 = y5 * d5
        x4 = y4 * d4 - l54 * x5
        x3 = y3 * d3 - l43 * x4 - l53 * x5
        x2 = y2 * d2 - l32 * x3 - l42 * x4 - l52 * x5
        x1 = y1 * d1 - l21 * x2 - l31 * x3 - l41 * x4 - l51 * x5
        x0 = y0 * d0 - l10 * x1 - l20 * x2 - l30 * x3 - l40 * x4 - l50 * x5
        e[l], e[W + l], e[2 * W + l], e[3 * W + l], e[4 * W + l], e[5 * W + l] = x0, x1, x2, x3, x4, x5


@inner
def lanes_move(lower: Array, upper: Array, longest: float, lanes: Lanes, w: int) -> None:
    """Take the step dq = Jᵀ x, no joint farther than `longest`, every joint inside its limits."""
    W, J, x, q, step, work = LANES, lanes.jacobian, lanes.residual, lanes.q, lanes.step, lanes.work
    for l in range(w):
        work[l] = longest
    for i in range(len(lower)):
        for l in range(w):
            d = J[i, l] * x[l] + J[i, W + l] * x[W + l] + J[i, 2 * W + l] * x[2 * W + l]
            d += (
                J[i, 3 * W + l] * x[3 * W + l]
                + J[i, 4 * W + l] * x[4 * W + l]
                + J[i, 5 * W + l] * x[5 * W + l]
            )
            step[i, l] = d
            work[l] = max(work[l], abs(d))
    for l in range(w):
        work[l] = longest / work[l]
    for i in range(len(lower)):
        low, high = lower[i], upper[i]
        for l in range(w):
            q[i, l] = min(max(q[i, l] + work[l] * step[i, l], low), high)
