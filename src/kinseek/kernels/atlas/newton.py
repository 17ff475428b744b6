"""Newton's method with the full Hessian, for errors on which Gauss-Newton steps converge slowly.

It minimises two errors: that of an unreachable goal, and a squared one along a valley that leads to a solution.

``E = K_P |p - p_g| + Σ K_c (1 - c·c_g)`` has large residuals at an unreachable goal. Gauss-Newton steps ignore their
curvature and converge slowly. The Hessian is complete here. For joints a ≤ b of a serial chain, a revolute,
``∂²p/∂q_a∂q_b = z_a × ∂p/∂q_b``, and likewise for every column c of the rotation (Erleben and Andrews 2019, Sec. 4).
Joints that are at a limit and would move outward are held (Bertsekas 1982). The Hessian is damped until it is positive
definite and the step reduces the error.

A singular solution with joints at limits lies at the end of a curved valley. The pose moves by t² only along the valley,
so the remaining error is t⁴. ``E = ½ K_P |p - p_g|² + Σ K_c (1 - c·c_g)`` is smooth there, and its Hessian includes the
curvature, so the steps keep converging where Gauss-Newton steps do not.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import advance, forward, identity
from kinseek.kernels.arm.pose_error import chordal_error, weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays
from kinseek.kernels.jit import inlined, noinline

WALK_STEPS = 40
"""Largest number of Newton steps of a walk down the weighted error."""

WALK = 2 * WALK_STEPS + 1
"""Largest number of FK evaluations of such a walk: each step may be followed by a position correction."""

ENOUGH = 1e-12
"""Smallest predicted decrease, relative to the error, for which a step is made."""

SMOOTH = 1e-9
"""Distance [m] from the kink of |p - p_g| below which it is rounded off."""

FLAT = 1e-300
"""A Hessian whose diagonal entries are all smaller counts as zero."""

MOST = 1e6
"""Largest damping, as a multiple of the largest entry of the Hessian. If it does not help, only rounding is left."""

RAISES = 24
"""Largest number of times that the damping is raised for one step: 17 times lead from 1e-4 to `MOST` times the largest
entry."""

FIRST_DAMPING, RAISE = 1e-4, 4.0
"""Initial damping of an indefinite Hessian, relative to the largest entry, and the factor of each further try. Not
examined further."""

SMALL_DAMPING, HARDER = 1e-6, 8.0
"""The same if the Hessian is positive definite and the step did not help. The damping is smaller, because the
second-order model was valid."""

VALLEY_STEPS, VALLEY_DAMPING = 300, 1e-10
"""Largest number of steps along a valley, and the initial damping in both cases: the Hessian is nearly singular there."""

EASIER, FORGET = 0.1, 1e-9
"""Factor of the damping after a successful step, and the fraction of the largest entry below which the damping is set to
0."""

POSITIVE = 1e-14
"""A pivot of the factorisation below this fraction of its diagonal is rounding, and the matrix is not positive definite."""

LONGEST = 0.5
"""Largest step of a joint [rad or m]."""


@inlined
def derivatives(
    chain: ChainArrays,
    goal: GoalArrays,
    squared: bool,
    q: Array,
    T: Array,
    axes: Array,
    moves: Array,
    g: Array,
    H: Array,
) -> None:
    """Compute the gradient, (n,), and the lower triangle of the Hessian, (n, n), of an error at q.

    Args:
        chain: The arm.
        goal: Target and weights.
        squared: True for half the squared position distance, False for the distance.
        q: Joint values, (n,).
        T: Receives the pose of the tip, (3, 4).
        axes: Scratch memory for axes and points on them, (m, 6).
        moves: Receives the velocity of the tip by each joint, (m, 3).
        g: Receives the gradient.
        H: Receives the Hessian.
    """
    joints = len(chain.leader)
    identity(T)
    for k in range(joints):
        value = chain.multiplier[k] * q[chain.leader[k]] + chain.offset[k]
        advance(chain.fixed[k], chain.prismatic[k], value, T)
        for r in range(3):
            axes[k, r], axes[k, 3 + r] = T[r, 2], T[r, 3]
    advance(chain.fixed[joints], True, 0.0, T)
    for i in range(len(q)):
        g[i] = 0.0
        for j in range(len(q)):
            H[i, j] = 0.0
    G, weights = goal.target, goal.axis_weights
    dx, dy, dz = T[0, 3] - G[0, 3], T[1, 3] - G[1, 3], T[2, 3] - G[2, 3]
    far = 1.0 if squared else math.sqrt(dx * dx + dy * dy + dz * dz + SMOOTH * SMOOTH)
    kink = 0.0 if squared else 1.0
    ux, uy, uz = dx / far, dy / far, dz / far
    # Σ K_c c × c_g, Σ K_c c·c_g, and Σ K_c c c_gᵀ.
    wx = wy = wz = total = 0.0
    m00 = m01 = m02 = m10 = m11 = m12 = m20 = m21 = m22 = 0.0
    for c in range(3):
        K = weights[c]
        ax, ay, az = K * T[0, c], K * T[1, c], K * T[2, c]
        bx, by, bz = G[0, c], G[1, c], G[2, c]
        wx, wy, wz = wx + ay * bz - az * by, wy + az * bx - ax * bz, wz + ax * by - ay * bx
        total += ax * bx + ay * by + az * bz
        m00, m01, m02 = m00 + ax * bx, m01 + ax * by, m02 + ax * bz
        m10, m11, m12 = m10 + ay * bx, m11 + ay * by, m12 + ay * bz
        m20, m21, m22 = m20 + az * bx, m21 + az * by, m22 + az * bz
    for b in range(joints):
        j, scale = chain.leader[b], chain.multiplier[b]
        zx, zy, zz = axes[b, 0], axes[b, 1], axes[b, 2]
        slope = 0.0
        if chain.prismatic[b]:
            vx, vy, vz = zx, zy, zz
        else:
            px, py, pz = T[0, 3] - axes[b, 3], T[1, 3] - axes[b, 4], T[2, 3] - axes[b, 5]
            vx, vy, vz = zy * pz - zz * py, zz * px - zx * pz, zx * py - zy * px
            slope = -(zx * wx + zy * wy + zz * wz)
        moves[b, 0], moves[b, 1], moves[b, 2] = vx, vy, vz
        along = ux * vx + uy * vy + uz * vz
        g[j] += scale * (goal.position_weight * along + slope)
        # M z_b, and v_b × u, for u · (z_a × v_b) = z_a · (v_b × u).
        ox, oy, oz = (
            m00 * zx + m01 * zy + m02 * zz,
            m10 * zx + m11 * zy + m12 * zz,
            m20 * zx + m21 * zy + m22 * zz,
        )
        cx, cy, cz = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
        for a in range(b + 1):
            i = chain.leader[a]
            before = ux * moves[a, 0] + uy * moves[a, 1] + uz * moves[a, 2]
            value = (moves[a, 0] * vx + moves[a, 1] * vy + moves[a, 2] * vz - kink * before * along) / far
            turn = 0.0
            if not chain.prismatic[a]:
                value += axes[a, 0] * cx + axes[a, 1] * cy + axes[a, 2] * cz
                if not chain.prismatic[b]:
                    turn = total * (axes[a, 0] * zx + axes[a, 1] * zy + axes[a, 2] * zz)
                    turn -= axes[a, 0] * ox + axes[a, 1] * oy + axes[a, 2] * oz
            value = scale * chain.multiplier[a] * (goal.position_weight * value + turn)
            low, high = min(i, j), max(i, j)
            H[high, low] += value
            if a != b and i == j:
                H[high, low] += value


@inlined
def damped_step(H: Array, g: Array, held: Flags, damping: float, L: Array, step: Array) -> bool:
    """Solve (H + damping · I) step = -g over the free joints; return False if the matrix is not positive definite."""
    n = len(g)
    for i in range(n):
        for j in range(i + 1):
            value = H[i, j] + (damping if i == j else 0.0)
            if held[i] or held[j]:
                value = abs(H[i, i]) + damping if i == j else 0.0
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                if value <= POSITIVE * (abs(H[i, i]) + damping):
                    return False
                L[i, i] = math.sqrt(value)
            else:
                L[i, j] = value / L[j, j]
    for i in range(n):
        value = 0.0 if held[i] else -g[i]
        for k in range(i):
            value -= L[i, k] * step[k]
        step[i] = value / L[i, i]
    for back in range(n):
        i = n - 1 - back
        value = step[i]
        for k in range(i + 1, n):
            value -= L[k, i] * step[k]
        step[i] = value / L[i, i]
    return True


@inlined
def error_of(T: Array, goal: GoalArrays, squared: bool) -> float:
    """The error of a pose that is minimised."""
    return 0.5 * chordal_error(T, goal) if squared else weighted_error(T, goal)


@inlined
def bring_back(
    chain: ChainArrays,
    goal: GoalArrays,
    held: Flags,
    moves: Array,
    T: Array,
    J: Array,
    lower: Array,
    upper: Array,
    trial: Array,
) -> None:
    """Correct the position of the tip towards the goal by one Gauss-Newton step.

    If the nearest pose has the right position, the error has its kink there. A straight step leaves the curved surface of
    right positions, and the error grows even though the orientation improves, unless steps are tiny (Maratos 1978).

    Args:
        chain: The arm.
        goal: Target and weights.
        held: True for joints that do not move, (n,).
        moves: Velocity of the tip by each joint at the start of the step, (m, 3).
        T: Pose of the tip, (3, 4).
        J: Scratch memory, (n, at least 3).
        lower: Limits, (n,).
        upper: Same.
        trial: Joint values, (n,), replaced by the corrected ones.
    """
    for i in range(len(trial)):
        J[i, 0] = J[i, 1] = J[i, 2] = 0.0
    for b in range(len(moves)):
        i, scale = chain.leader[b], chain.multiplier[b]
        for c in range(3):
            J[i, c] += 0.0 if held[i] else scale * moves[b, c]
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(len(trial)):
        x, y, z = J[i, 0], J[i, 1], J[i, 2]
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    damp = SMALL_DAMPING * (xx + yy + zz) + FLAT
    xx, yy, zz = xx + damp, yy + damp, zz + damp
    dx, dy, dz = goal.target[0, 3] - T[0, 3], goal.target[1, 3] - T[1, 3], goal.target[2, 3] - T[2, 3]
    # Invert the symmetric matrix by its minors.
    ax, ay, az = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    by, bz, cz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    rate = 1.0 / (xx * ax + xy * ay + xz * az)
    fx, fy, fz = (
        rate * (ax * dx + ay * dy + az * dz),
        rate * (ay * dx + by * dy + bz * dz),
        rate * (az * dx + bz * dy + cz * dz),
    )
    for i in range(len(trial)):
        step = J[i, 0] * fx + J[i, 1] * fy + J[i, 2] * fz
        trial[i] = min(max(trial[i] + step, lower[i]), upper[i])


@noinline
def settle(
    chain: ChainArrays,
    goal: GoalArrays,
    squared: bool,
    steps: int,
    least: float,
    lower: Array,
    upper: Array,
    q: Array,
) -> int:
    """Walk from q, (n,), to a local minimum of an error within the limits; return FK evaluations.

    Args:
        chain: The arm.
        goal: Target and weights.
        squared: Which error, see `derivatives`.
        steps: Largest number of steps.
        least: Stop if the error is at most this.
        lower: Limits, (n,); open for a joint that turns fully.
        upper: Same.
        q: The start, replaced by the minimiser; its error never increases.
    """
    n, joints = len(q), len(chain.leader)
    T, axes, moves = np.empty((3, 4)), np.empty((joints, 6)), np.empty((joints, 3))
    g, step, trial = np.empty(n), np.empty(n), np.empty(n)
    H, L, held = np.empty((n, n)), np.empty((n, n)), np.empty(n, dtype=np.bool_)
    first, small = (VALLEY_DAMPING, VALLEY_DAMPING) if squared else (FIRST_DAMPING, SMALL_DAMPING)
    derivatives(chain, goal, squared, q, T, axes, moves, g, H)
    error, spent, damping = error_of(T, goal, squared), 1, 0.0
    for _ in range(steps):
        if error <= least:
            break
        largest, steepest = 0.0, 0.0
        for i in range(n):
            held[i] = (q[i] <= lower[i] and g[i] > 0.0) or (q[i] >= upper[i] and g[i] < 0.0)
            largest = max(largest, abs(H[i, i]))
            if not held[i]:
                steepest = max(steepest, abs(g[i]))
        if steepest * steepest <= ENOUGH * largest * error:
            break
        if largest < FLAT:
            # Steepest descent, for example a slide towards a distant goal: the Hessian gives no scale.
            largest = steepest
        raised = 0
        while raised < RAISES and damping <= MOST * largest:
            if damped_step(H, g, held, damping, L, step):
                break
            damping = max(RAISE * damping, first * largest)
            raised += 1
        if raised == RAISES or damping > MOST * largest:
            break
        farthest = LONGEST
        for i in range(n):
            farthest = max(farthest, abs(step[i]))
        for i in range(n):
            trial[i] = min(max(q[i] + step[i] * LONGEST / farthest, lower[i]), upper[i])
        forward(chain, trial, T)
        spent += 1
        now = error_of(T, goal, squared)
        if now >= error and n >= 3 and not squared and goal.position_weight > 0.0:
            bring_back(chain, goal, held, moves, T, L, lower, upper, trial)
            forward(chain, trial, T)
            spent += 1
            now = error_of(T, goal, squared)
        if now < error:
            ends = error - now <= ENOUGH * error
            for i in range(n):
                q[i] = trial[i]
            if ends:
                break
            damping *= EASIER
            if damping < FORGET * largest:
                damping = 0.0
            derivatives(chain, goal, squared, q, T, axes, moves, g, H)
            error = now
        else:
            damping = max(HARDER * damping, small * largest)
    return spent
