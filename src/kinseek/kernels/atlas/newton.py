"""Newton's method with the full Hessian, for errors on which Gauss-Newton steps converge slowly.

It minimises two errors: that of an unreachable goal, and a squared one along a valley that leads to a solution.

``E = K_P |p - p_g| + Σ K_c (1 - c·c_g)`` has large residuals at an unreachable goal. Gauss-Newton steps ignore their
curvature and converge slowly. The Hessian is complete here. For joints a ≤ b of a serial chain, a revolute,
``∂²p/∂q_a∂q_b = z_a × ∂p/∂q_b``, and likewise for every column c of the rotation (Erleben and Andrews 2019, Sec. 4).
Joints that are at a limit and would move outward are fixed (Bertsekas 1982). The Hessian is damped until it is positive
definite and the step reduces the error.

A singular solution with joints at limits lies at the end of a curved valley. The pose moves by t² only along the valley,
so the remaining error is t⁴. ``E = ½ K_P |p - p_g|² + Σ K_c (1 - c·c_g)`` is smooth there, and its Hessian includes the
curvature, so the steps keep converging where Gauss-Newton steps do not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import advance, forward, identity
from kinseek.kernels.arm.pose_error import chordal_error, weighted_error
from kinseek.kernels.arm.vectors import Vector, column, cross, dot, minus, plus, scaled, vector_at
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays, Limits
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


class Model(NamedTuple):
    """The second-order model of an error at joint values, and the pose there."""

    pose: Array
    """Pose of the tip, (3, 4)."""
    axes: Array
    """Direction of the axis of every physical joint and a point on it, (m, 6)."""
    moves: Array
    """Velocity of the tip by each joint, (m, 3)."""
    gradient: Array
    """(n,)"""
    hessian: Array
    """Its lower triangle, (n, n)."""
    jacobian: Array
    """Velocity of the tip by each variable, 0 for those that are fixed, (n, 3), see `bring_back`."""


class Walk(NamedTuple):
    """Which error a walk minimises, and when it ends."""

    squared: bool
    """True for half the squared position distance, False for the distance."""
    steps: int
    """Largest number of steps."""
    least: float
    """The walk ends where the error is at most this."""


DOWNHILL = Walk(False, WALK_STEPS, 0.0)
"""A walk down the weighted error."""


class Tilt(NamedTuple):
    """Sums over the columns c of a rotation and c_g of its target, with weights K_c."""

    torque: Vector
    """Σ K_c c × c_g."""
    cosine: float
    """Σ K_c c·c_g."""
    row0: Vector
    """Rows of Σ K_c c c_gᵀ."""
    row1: Vector
    row2: Vector


@inlined
def tilt_of(T: Array, goal: GoalArrays) -> Tilt:
    """Compute the sums at a pose, (3, 4)."""
    w, total = Vector(0.0, 0.0, 0.0), 0.0
    row0, row1, row2 = Vector(0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0)
    for c in range(3):
        a, b = scaled(goal.axis_weights[c], column(T, c)), column(goal.target, c)
        w = Vector(w.x + a.y * b.z - a.z * b.y, w.y + a.z * b.x - a.x * b.z, w.z + a.x * b.y - a.y * b.x)
        total += dot(a, b)
        row0, row1, row2 = plus(row0, scaled(a.x, b)), plus(row1, scaled(a.y, b)), plus(row2, scaled(a.z, b))
    return Tilt(w, total, row0, row1, row2)


@inlined
def walk_along(chain: ChainArrays, q: Array, T: Array, axes: Array) -> None:
    """Write the pose of the tip at q, (n,), into T, (3, 4), and the axes of all joints into axes, (m, 6)."""
    joints = len(chain.leader)
    identity(T)
    for k in range(joints):
        value = chain.multiplier[k] * q[chain.leader[k]] + chain.offset[k]
        advance(chain.fixed[k], chain.prismatic[k], value, T)
        for r in range(3):
            axes[k, r], axes[k, 3 + r] = T[r, 2], T[r, 3]
    advance(chain.fixed[joints], True, 0.0, T)


@inlined
def derivatives(chain: ChainArrays, goal: GoalArrays, squared: bool, q: Array, model: Model) -> None:
    """Compute the model of an error at q, (n,), see `Walk.squared`.

    With ``v_b`` the velocity of the tip by joint b and u the direction from the target to the tip, the position part of
    the Hessian is ``(v_a·v_b - (u·v_a)(u·v_b)) / |p - p_g| + u · (z_a × v_b)``, and the orientation part is
    ``Σ K_c ((c·c_g) z_a·z_b - z_a · c (c_g · z_b))``, the derivative of ``-Σ K_c z_b · (c × c_g)``.
    """
    T, axes, moves, g, H = model.pose, model.axes, model.moves, model.gradient, model.hessian
    walk_along(chain, q, T, axes)
    for i in range(len(q)):
        g[i] = 0.0
        for j in range(len(q)):
            H[i, j] = 0.0
    tip = column(T, 3)
    gap = minus(tip, column(goal.target, 3))
    far = 1.0 if squared else math.sqrt(dot(gap, gap) + SMOOTH * SMOOTH)
    kink = 0.0 if squared else 1.0
    u = Vector(gap.x / far, gap.y / far, gap.z / far)
    tilt = tilt_of(T, goal)
    for b in range(len(chain.leader)):
        j, scale = chain.leader[b], chain.multiplier[b]
        axis = vector_at(axes[b], 0)
        slope = 0.0
        if chain.prismatic[b]:
            v = axis
        else:
            v = cross(axis, minus(tip, vector_at(axes[b], 3)))
            slope = -dot(axis, tilt.torque)
        moves[b, 0], moves[b, 1], moves[b, 2] = v
        along = dot(u, v)
        g[j] += scale * (goal.position_weight * along + slope)
        # u · (z_a × v_b) = z_a · (v_b × u).
        projected, across = (
            Vector(dot(tilt.row0, axis), dot(tilt.row1, axis), dot(tilt.row2, axis)),
            cross(v, u),
        )
        for a in range(b + 1):
            i = chain.leader[a]
            before, proximal = vector_at(moves[a], 0), vector_at(axes[a], 0)
            value = (dot(before, v) - kink * dot(u, before) * along) / far
            turn = 0.0
            if not chain.prismatic[a]:
                value += dot(proximal, across)
                if not chain.prismatic[b]:
                    turn = tilt.cosine * dot(proximal, axis)
                    turn -= dot(proximal, projected)
            value = scale * chain.multiplier[a] * (goal.position_weight * value + turn)
            low, high = min(i, j), max(i, j)
            H[high, low] += value
            # Two joints that the same variable moves: the sum over all pairs has (a, b) and (b, a).
            if a != b and i == j:
                H[high, low] += value


@inlined
def damped_step(H: Array, g: Array, fixed: Flags, damping: float, L: Array, step: Array) -> bool:
    """Solve (H + damping · I) step = -g over the free joints; return False if the matrix is not positive definite."""
    n = len(g)
    for i in range(n):
        for j in range(i + 1):
            value = H[i, j] + (damping if i == j else 0.0)
            if fixed[i] or fixed[j]:
                # A fixed joint has no entry beside its diagonal one, and 0 on the right side, so its step is 0.
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
        value = 0.0 if fixed[i] else -g[i]
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
    chain: ChainArrays, goal: GoalArrays, limits: Limits, fixed: Flags, model: Model, trial: Array
) -> None:
    """Correct the position of the tip towards the goal by one Gauss-Newton step.

    If the nearest pose has the right position, the error has its kink there. A straight step leaves the curved surface of
    right positions, and the error grows even though the orientation improves, unless steps are tiny (Maratos 1978).

    Args:
        chain: The arm.
        goal: Target and weights.
        limits: Limits of the joints.
        fixed: True for joints that do not move, (n,).
        model: Pose of the tip at `trial`, and velocities at the start of the step.
        trial: Joint values, (n,), replaced by the corrected ones.
    """
    J = model.jacobian
    for i in range(len(trial)):
        J[i, 0] = J[i, 1] = J[i, 2] = 0.0
    for b in range(len(model.moves)):
        i, scale = chain.leader[b], chain.multiplier[b]
        for c in range(3):
            J[i, c] += 0.0 if fixed[i] else scale * model.moves[b, c]
    xx = xy = xz = yy = yz = zz = 0.0
    for i in range(len(trial)):
        x, y, z = J[i, 0], J[i, 1], J[i, 2]
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    damp = SMALL_DAMPING * (xx + yy + zz) + FLAT
    xx, yy, zz = xx + damp, yy + damp, zz + damp
    gap = minus(column(goal.target, 3), column(model.pose, 3))
    # Invert the symmetric matrix by its minors.
    row0 = Vector(yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    row1 = Vector(row0.y, xx * zz - xz * xz, xy * xz - xx * yz)
    row2 = Vector(row0.z, row1.z, xx * yy - xy * xy)
    rate = 1.0 / (xx * row0.x + xy * row0.y + xz * row0.z)
    force = Vector(rate * dot(row0, gap), rate * dot(row1, gap), rate * dot(row2, gap))
    for i in range(len(trial)):
        step = dot(vector_at(J[i], 0), force)
        trial[i] = min(max(trial[i] + step, limits.lower[i]), limits.upper[i])


@noinline
def minimise(chain: ChainArrays, goal: GoalArrays, limits: Limits, walk: Walk, q: Array) -> int:
    """Walk from q, (n,), to a local minimum of an error within the limits; return FK evaluations.

    Args:
        chain: The arm.
        goal: Target and weights.
        limits: Limits of the joints; open for a joint that turns fully.
        walk: Which error, and when to stop.
        q: The start, replaced by the minimiser; its error never increases.
    """
    n, joints, squared = len(q), len(chain.leader), walk.squared
    lower, upper = limits
    T, g, H = np.empty((3, 4)), np.empty(n), np.empty((n, n))
    model = Model(T, np.empty((joints, 6)), np.empty((joints, 3)), g, H, np.empty((n, 3)))
    L, step, trial, fixed = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(n, dtype=np.bool_)
    first, small = (VALLEY_DAMPING, VALLEY_DAMPING) if squared else (FIRST_DAMPING, SMALL_DAMPING)
    derivatives(chain, goal, squared, q, model)
    error, spent, damping = error_of(T, goal, squared), 1, 0.0
    for _ in range(walk.steps):
        if error <= walk.least:
            break
        largest, steepest = 0.0, 0.0
        for i in range(n):
            fixed[i] = (q[i] <= lower[i] and g[i] > 0.0) or (q[i] >= upper[i] and g[i] < 0.0)
            largest = max(largest, abs(H[i, i]))
            if not fixed[i]:
                steepest = max(steepest, abs(g[i]))
        # g²/H is twice the decrease that Newton's method predicts along one joint.
        if steepest * steepest <= ENOUGH * largest * error:
            break
        if largest < FLAT:
            # Steepest descent, for example a slide towards a distant goal: the Hessian gives no scale.
            largest = steepest
        raised = 0
        while raised < RAISES and damping <= MOST * largest:
            if damped_step(H, g, fixed, damping, L, step):
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
            bring_back(chain, goal, limits, fixed, model, trial)
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
            derivatives(chain, goal, squared, q, model)
            error = now
        else:
            damping = max(HARDER * damping, small * largest)
    return spent
