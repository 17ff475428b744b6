"""Damped Newton steps for eight configurations at once, one in each SIMD lane.

Every array is flat, row after row of `LANES` numbers, and every innermost loop runs over the lanes, so that LLVM turns it
into vector instructions. The trip count is an argument, `w`, always equal to `LANES`: if it were a constant, LLVM would
unroll the loop before it could vectorise it. Lanes do not read each other, so the result of a lane does not depend on the
others, bit by bit.

The step is that of Levenberg and Marquardt with Chan's damping (Chan and Lawrence 1988). The residual e is scaled so that
metres and radians are comparable, ``dq = Jᵀ (J Jᵀ + λ I)⁻¹ e``, and λ is proportional to |e|². The matrix is 6x6 for any
number of joints. At limits the step uses an active set: a joint that is at a limit and would move outward is removed from
J, instead of being clamped after the solution.
"""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arm.links import (
    ADDS,
    SLIDE_OFFSET,
    SLIDE_RATE,
    TURN_OFFSET,
    TURN_RATE,
    TWIST_COSINE,
    TWIST_SINE,
    U,
    V,
)
from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined
from kinseek.kernels.layout import DOF, JOINTS, Layout, floats

LANES = 8
"""Configurations in parallel: as many as the widest vectors hold doubles."""

LOST = 1e-15
"""Rounding error of the factorisation relative to the trace; the damping must exceed it. Otherwise a row that no joint
moves could lead to a division by zero, next to one that a joint moves far."""

SHARE, BEFORE, STUBBORN = 0, LANES, 3 * LANES
"""First rows of `Lanes.work`: the fraction of the last step that was taken; an earlier |e|² for comparison; and 1 for a
stubborn lane, see `lanes_hold`, else 0."""

UNLIMITED = 1e300
"""A joint with limits at least this wide counts as unlimited."""


class Lanes(NamedTuple):
    """State of eight configurations; row r of lane l is element ``r · LANES + l`` of a flat array."""

    q: Array
    """Joint values, (n, LANES)."""
    target: Array
    """Target poses, 12 rows, row-major (3, 4)."""
    pose: Array
    """Tip poses at q, 12 rows."""
    axes: Array
    """Axis direction and a point on it of every physical joint, 6 rows each, (m, 6 · LANES)."""
    jacobian: Array
    """Columns of the scaled Jacobian, 6 rows each, (n, 6 · LANES)."""
    gram: Array
    """Lower triangle of J Jᵀ + λ I, 21 rows, then its factor."""
    residual: Array
    """Scaled residual e, 6 rows, then the solution of the 6x6 system."""
    step: Array
    """dq, (n, LANES)."""
    work: Array
    """Values kept between loops, 4 rows, see `SHARE`, `BEFORE` and `STUBBORN`."""
    error: Array
    """Squared position error [m²], squared sine of the angle, its cosine, and |e|², 4 rows."""
    weight: Array
    """Scale of the position rows [1/m] and of the orientation rows, 2 rows."""


LAYOUT = Layout(
    Lanes,
    q=floats(DOF, LANES),
    jacobian=floats(DOF, 6 * LANES),
    step=floats(DOF, LANES),
    axes=floats(JOINTS, 6 * LANES),
    target=floats(12 * LANES),
    pose=floats(12 * LANES),
    gram=floats(21 * LANES),
    residual=floats(6 * LANES),
    work=floats(4 * LANES),
    error=floats(4 * LANES),
    weight=floats(2 * LANES),
)
"""Layout of the lanes of an arm in memory."""


@inlined
def lanes_forward(leader: Indices, links: Array, lanes: Lanes, w: int) -> None:
    """Compute the forward kinematics of every lane and store the axis of every joint.

    Args:
        leader: Variable that moves each physical joint, (m,).
        links: The chain, see `links.links_of`.
        lanes: Holds q; receives poses and axes.
        w: LANES.
    """
    W, q, T, axes, joints = LANES, lanes.q, lanes.pose, lanes.axes, len(leader)
    for r in range(12):
        value = links[joints, r]
        for l in range(w):
            T[r * W + l] = value
    for k in range(joints):
        i, sa, ca, u, v = leader[k], links[k, TWIST_SINE], links[k, TWIST_COSINE], links[k, U], links[k, V]
        turn, turned = links[k, TURN_RATE], links[k, TURN_OFFSET]
        slide, slid = links[k, SLIDE_RATE], links[k, SLIDE_OFFSET]
        for l in range(w):
            s, c = sine_cosine(turn * q[i, l] + turned)
            d = slide * q[i, l] + slid
            x, b, z = T[l], T[W + l], T[2 * W + l]
            p = T[3 * W + l] + u * x + v * b
            y, z = ca * b + sa * z, ca * z - sa * b
            p += z * d
            T[l], T[W + l], T[2 * W + l], T[3 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, l], axes[k, 3 * W + l] = z, p
            x, b, z = T[4 * W + l], T[5 * W + l], T[6 * W + l]
            p = T[7 * W + l] + u * x + v * b
            y, z = ca * b + sa * z, ca * z - sa * b
            p += z * d
            T[4 * W + l], T[5 * W + l], T[6 * W + l], T[7 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, W + l], axes[k, 4 * W + l] = z, p
            x, b, z = T[8 * W + l], T[9 * W + l], T[10 * W + l]
            p = T[11 * W + l] + u * x + v * b
            y, z = ca * b + sa * z, ca * z - sa * b
            p += z * d
            T[8 * W + l], T[9 * W + l], T[10 * W + l], T[11 * W + l] = x * c + y * s, y * c - x * s, z, p
            axes[k, 2 * W + l], axes[k, 5 * W + l] = z, p
    A = links[joints + 1]
    for r in range(3):
        o = 4 * r * W
        for l in range(w):
            x, y, z, p = T[o + l], T[o + W + l], T[o + 2 * W + l], T[o + 3 * W + l]
            T[o + l] = x * A[0] + y * A[4] + z * A[8]
            T[o + W + l] = x * A[1] + y * A[5] + z * A[9]
            T[o + 2 * W + l] = x * A[2] + y * A[6] + z * A[10]
            T[o + 3 * W + l] = x * A[3] + y * A[7] + z * A[11] + p


@inlined
def lanes_residual(lanes: Lanes, columns: Array, w: int) -> None:
    """Compute the residual and the errors of every lane.

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


@inlined
def lanes_jacobian(leader: Indices, links: Array, lanes: Lanes, free: float, w: int) -> None:
    """Compute the scaled geometric Jacobian of every lane; `free` = 1 ignores rotation about the tool's x axis."""
    W, T, J, axes, weight = LANES, lanes.pose, lanes.jacobian, lanes.axes, lanes.weight
    for k in range(len(leader)):
        i, turn, slide = leader[k], links[k, TURN_RATE], links[k, SLIDE_RATE]
        adds = links[k, ADDS] > 0.0
        for l in range(w):
            zx, zy, zz = axes[k, l], axes[k, W + l], axes[k, 2 * W + l]
            px = T[3 * W + l] - axes[k, 3 * W + l]
            py = T[7 * W + l] - axes[k, 4 * W + l]
            pz = T[11 * W + l] - axes[k, 5 * W + l]
            wp, wo = turn * weight[l], turn * weight[W + l]
            ws = slide * weight[l]
            tx, ty, tz = T[l], T[4 * W + l], T[8 * W + l]
            along = free * (zx * tx + zy * ty + zz * tz)
            j0 = wp * (zy * pz - zz * py) + ws * zx
            j1 = wp * (zz * px - zx * pz) + ws * zy
            j2 = wp * (zx * py - zy * px) + ws * zz
            j3, j4, j5 = wo * (zx - along * tx), wo * (zy - along * ty), wo * (zz - along * tz)
            j0 += J[i, l] if adds else 0.0
            j1 += J[i, W + l] if adds else 0.0
            j2 += J[i, 2 * W + l] if adds else 0.0
            j3 += J[i, 3 * W + l] if adds else 0.0
            j4 += J[i, 4 * W + l] if adds else 0.0
            j5 += J[i, 5 * W + l] if adds else 0.0
            J[i, l], J[i, W + l], J[i, 2 * W + l] = j0, j1, j2
            J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l] = j3, j4, j5


@inlined
def lanes_hold(lower: Array, upper: Array, lanes: Lanes, w: int) -> None:
    """Remove every joint that is at a limit and would move outward from the Jacobian.

    A stubborn lane also removes the joints that the last step would have moved outward. Truncating a step spoils its
    other components, so convergence is slow if many joints are at limits.
    """
    W, J, q, e, step, work = LANES, lanes.jacobian, lanes.q, lanes.residual, lanes.step, lanes.work
    for i in range(len(lower)):
        low, high = lower[i], upper[i]
        if low <= -UNLIMITED:
            continue
        for l in range(w):
            j0, j1, j2 = J[i, l], J[i, W + l], J[i, 2 * W + l]
            j3, j4, j5 = J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l]
            push = j0 * e[l] + j1 * e[W + l] + j2 * e[2 * W + l]
            push += j3 * e[3 * W + l] + j4 * e[4 * W + l] + j5 * e[5 * W + l]
            last = work[STUBBORN + l] * step[i, l]
            held = (q[i, l] >= high and max(push, last) > 0.0) or (q[i, l] <= low and min(push, last) < 0.0)
            move = 0.0 if held else 1.0
            J[i, l], J[i, W + l], J[i, 2 * W + l] = move * j0, move * j1, move * j2
            J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l] = move * j3, move * j4, move * j5


@inlined
def lanes_gram(damping: float, floor: Array, lanes: Lanes, w: int) -> None:
    """Compute J Jᵀ + λ I of every lane; λ is damping · |e|² plus a floor, (LANES,), and at least `LOST`.

    The lower bound keeps the factorisation finite. Two joints are processed at a time, because half of the work is to
    load and store the sums; a last odd joint is processed alone.
    """
    W, A, J, dof = LANES, lanes.gram, lanes.jacobian, lanes.jacobian.shape[0]
    for i in range(21 * W):
        A[i] = 0.0
    for pair in range((dof + 1) // 2):
        i = 2 * pair
        k = min(i + 1, dof - 1)
        once = 1.0 if k > i else 0.0
        for l in range(w):
            a0, a1, a2 = J[i, l], J[i, W + l], J[i, 2 * W + l]
            a3, a4, a5 = J[i, 3 * W + l], J[i, 4 * W + l], J[i, 5 * W + l]
            b0, b1, b2 = once * J[k, l], once * J[k, W + l], once * J[k, 2 * W + l]
            b3, b4, b5 = once * J[k, 3 * W + l], once * J[k, 4 * W + l], once * J[k, 5 * W + l]
            A[l] += a0 * a0 + b0 * b0
            A[W + l] += a1 * a0 + b1 * b0
            A[2 * W + l] += a1 * a1 + b1 * b1
            A[3 * W + l] += a2 * a0 + b2 * b0
            A[4 * W + l] += a2 * a1 + b2 * b1
            A[5 * W + l] += a2 * a2 + b2 * b2
            A[6 * W + l] += a3 * a0 + b3 * b0
            A[7 * W + l] += a3 * a1 + b3 * b1
            A[8 * W + l] += a3 * a2 + b3 * b2
            A[9 * W + l] += a3 * a3 + b3 * b3
            A[10 * W + l] += a4 * a0 + b4 * b0
            A[11 * W + l] += a4 * a1 + b4 * b1
            A[12 * W + l] += a4 * a2 + b4 * b2
            A[13 * W + l] += a4 * a3 + b4 * b3
            A[14 * W + l] += a4 * a4 + b4 * b4
            A[15 * W + l] += a5 * a0 + b5 * b0
            A[16 * W + l] += a5 * a1 + b5 * b1
            A[17 * W + l] += a5 * a2 + b5 * b2
            A[18 * W + l] += a5 * a3 + b5 * b3
            A[19 * W + l] += a5 * a4 + b5 * b4
            A[20 * W + l] += a5 * a5 + b5 * b5
    for l in range(w):
        trace = A[l] + A[2 * W + l] + A[5 * W + l] + A[9 * W + l] + A[14 * W + l] + A[20 * W + l]
        damp = damping * lanes.error[3 * W + l] + max(floor[l], LOST * trace)
        A[l] += damp
        A[2 * W + l] += damp
        A[5 * W + l] += damp
        A[9 * W + l] += damp
        A[14 * W + l] += damp
        A[20 * W + l] += damp


@inlined
def lanes_solve(lanes: Lanes, w: int) -> None:
    """Solve the 6x6 systems by the Cholesky factorisation L D Lᵀ; overwrite the residual."""
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


@inlined
def lanes_move(lower: Array, upper: Array, longest: float, lanes: Lanes, w: int) -> None:
    """Move by dq = Jᵀ x, each joint by at most `longest` and within its limits."""
    W, J, x, q = LANES, lanes.jacobian, lanes.residual, lanes.q
    step, work, dof = lanes.step, lanes.work, len(lower)
    for l in range(w):
        work[l] = longest
    for pair in range((dof + 1) // 2):
        i = 2 * pair
        k = min(i + 1, dof - 1)
        for l in range(w):
            x0, x1, x2, x3, x4, x5 = x[l], x[W + l], x[2 * W + l], x[3 * W + l], x[4 * W + l], x[5 * W + l]
            a = J[i, l] * x0 + J[i, W + l] * x1 + J[i, 2 * W + l] * x2
            b = J[k, l] * x0 + J[k, W + l] * x1 + J[k, 2 * W + l] * x2
            a += J[i, 3 * W + l] * x3 + J[i, 4 * W + l] * x4 + J[i, 5 * W + l] * x5
            b += J[k, 3 * W + l] * x3 + J[k, 4 * W + l] * x4 + J[k, 5 * W + l] * x5
            step[i, l], step[k, l] = a, b
            work[l] = max(work[l], abs(a), abs(b))
    for l in range(w):
        work[l] = longest / work[l]
    for i in range(dof):
        low, high = lower[i], upper[i]
        for l in range(w):
            q[i, l] = min(max(q[i, l] + work[l] * step[i, l], low), high)
