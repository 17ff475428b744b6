"""Damped Newton steps for eight configurations at once, one in each SIMD lane.

The last index of every array is the lane, and every innermost loop runs over the lanes, so that LLVM turns it into vector
instructions. The trip count is an argument, `w`, always equal to `LANES`: if it were a constant, LLVM would unroll the
loop before it could vectorise it. Lanes do not read each other, so the result of a lane does not depend on the
others, bit by bit.

The step is that of Levenberg and Marquardt with Chan's damping (Chan and Lawrence 1988). The residual e is scaled so that
metres and radians are comparable, ``dq = Jᵀ (J Jᵀ + λ I)⁻¹ e``, and λ is proportional to |e|². The matrix is 6x6 for any
number of joints. At limits the step uses an active set: a joint that is at a limit and would move outward is removed from
J, instead of being clamped after the solution.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arm.links import Link, read_link
from kinseek.kernels.arm.trigonometry import sine_cosine
from kinseek.kernels.arm.vectors import Twist, Vector, cross, dot, minus, plus, scaled, twist_dot
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined

LANES = 8
"""Configurations in parallel: as many as the widest vectors hold doubles."""

LOST = 1e-15
"""Rounding error of the factorisation relative to the trace; the damping must exceed it. Otherwise a row that no joint
moves could lead to a division by zero, next to one that a joint moves far."""

DISTANCE2 = 0
"""Row of `Lanes.error`: squared position error [m²]."""
SINE2 = 1
"""Squared sine of the angle to the target; for a goal with ranges the squared angle."""
COSINE = 2
"""Cosine of that angle, times the number of columns that count."""
RESIDUAL2 = 3
"""|e|²."""

UNLIMITED = 1e300
"""A joint with limits at least this wide counts as unlimited."""


class Lanes(NamedTuple):
    """State of eight configurations, one in each lane."""

    q: Annotated[Array, "dof", LANES]
    """Joint values, (n, LANES)."""
    target: Annotated[Array, 3, 4, LANES]
    """Target poses, (3, 4, LANES)."""
    pose: Annotated[Array, 3, 4, LANES]
    """Tip poses at q, (3, 4, LANES)."""
    axes: Annotated[Array, "joints", 6, LANES]
    """Direction of the axis of every physical joint and a point on it, (m, 6, LANES)."""
    jacobian: Annotated[Array, "dof", 6, LANES]
    """Columns of the scaled Jacobian, (n, 6, LANES)."""
    gram: Annotated[Array, 21, LANES]
    """Lower triangle of J Jᵀ + λ I row by row, (21, LANES)."""
    residual: Annotated[Array, 6, LANES]
    """Scaled residual e, then the solution of the 6x6 system, (6, LANES)."""
    step: Annotated[Array, "dof", LANES]
    """dq, (n, LANES)."""
    share: Annotated[Array, LANES]
    """Fraction of the last step that was taken, (LANES,)."""
    before: Annotated[Array, LANES]
    """An earlier |e|² for comparison, (LANES,)."""
    stubborn: Annotated[Array, LANES]
    """1 for a stubborn lane, see `lanes_hold`, else 0, (LANES,)."""
    error: Annotated[Array, 4, LANES]
    """See `DISTANCE2` to `RESIDUAL2`, (4, LANES)."""
    weight: Annotated[Array, 2, LANES]
    """Scale of the position rows [1/m] and of the orientation rows, (2, LANES)."""


@inlined
def twist_at(rows: Array, l: int) -> Twist:
    """Six rows of a lane, (6, LANES): a residual, or a column of the Jacobian."""
    return Twist(Vector(rows[0, l], rows[1, l], rows[2, l]), Vector(rows[3, l], rows[4, l], rows[5, l]))


@inlined
def set_twist(rows: Array, l: int, value: Twist) -> None:
    """Set six rows of a lane, (6, LANES)."""
    rows[0, l], rows[1, l], rows[2, l] = value.linear
    rows[3, l], rows[4, l], rows[5, l] = value.angular


@inlined
def pose_column(T: Array, c: int, l: int) -> Vector:
    """Column c of the pose of a lane, (3, 4, LANES)."""
    return Vector(T[0, c, l], T[1, c, l], T[2, c, l])


@inlined
def advance_row(row: Array, l: int, link: Link, c: float, s: float, slide: float) -> None:
    """Multiply one row of the pose of a lane, (4, LANES), by a link and a joint at the angle of c and s."""
    x, before, z = row[0, l], row[1, l], row[2, l]
    p = row[3, l] + link.u * x + link.v * before
    y, z = link.cosine * before + link.sine * z, link.cosine * z - link.sine * before
    row[0, l], row[1, l], row[2, l], row[3, l] = x * c + y * s, y * c - x * s, z, p + z * slide


@inlined
def lanes_forward(leader: Indices, links: Array, lanes: Lanes, w: int) -> None:
    """Compute the forward kinematics of every lane and store the axis of every joint.

    Args:
        leader: Variable that moves each physical joint, (m,).
        links: The chain, see `links_of`.
        lanes: Holds q; receives poses and axes.
        w: LANES.
    """
    q, T, axes, joints = lanes.q, lanes.pose, lanes.axes, len(leader)
    for r in range(3):
        for c in range(4):
            for l in range(w):
                T[r, c, l] = links[joints, 4 * r + c]
    for k in range(joints):
        i, link = leader[k], read_link(links[k])
        for l in range(w):
            sine, cosine = sine_cosine(link.turn_rate * q[i, l] + link.turn_offset)
            d = link.slide_rate * q[i, l] + link.slide_offset
            advance_row(T[0], l, link, cosine, sine, d)
            advance_row(T[1], l, link, cosine, sine, d)
            advance_row(T[2], l, link, cosine, sine, d)
            axes[k, 0, l], axes[k, 1, l], axes[k, 2, l] = T[0, 2, l], T[1, 2, l], T[2, 2, l]
            axes[k, 3, l], axes[k, 4, l], axes[k, 5, l] = T[0, 3, l], T[1, 3, l], T[2, 3, l]
    tip = links[joints + 1]
    for r in range(3):
        for l in range(w):
            x, y, z, p = T[r, 0, l], T[r, 1, l], T[r, 2, l], T[r, 3, l]
            T[r, 0, l] = x * tip[0] + y * tip[4] + z * tip[8]
            T[r, 1, l] = x * tip[1] + y * tip[5] + z * tip[9]
            T[r, 2, l] = x * tip[2] + y * tip[6] + z * tip[10]
            T[r, 3, l] = x * tip[3] + y * tip[7] + z * tip[11] + p


@inlined
def lanes_residual(lanes: Lanes, columns: Array, w: int) -> None:
    """Compute the residual and the errors of every lane.

    The orientation part is ``Σ_c columns_c c × c_g``, the downhill direction of ``Σ_c columns_c (1 - c·c_g)``.
    """
    T, G, e, error, weight = lanes.pose, lanes.target, lanes.residual, lanes.error, lanes.weight
    for l in range(w):
        gap = minus(pose_column(G, 3, l), pose_column(T, 3, l))
        error[DISTANCE2, l], error[COSINE, l] = dot(gap, gap), 0.0
        set_twist(e, l, Twist(scaled(weight[0, l], gap), Vector(0.0, 0.0, 0.0)))
    for c in range(3):
        weight_c = columns[c]
        if weight_c == 0.0:
            continue
        for l in range(w):
            axis, goal = pose_column(T, c, l), pose_column(G, c, l)
            turn = cross(axis, goal)
            e[3, l] += weight_c * turn.x
            e[4, l] += weight_c * turn.y
            e[5, l] += weight_c * turn.z
            error[COSINE, l] += weight_c * dot(axis, goal)
    for l in range(w):
        turn = Vector(e[3, l], e[4, l], e[5, l])
        error[SINE2, l] = dot(turn, turn)
        wp, wo = weight[0, l], weight[1, l]
        e[3, l], e[4, l], e[5, l] = scaled(wo, turn)
        error[RESIDUAL2, l] = wp * wp * error[DISTANCE2, l] + wo * wo * error[SINE2, l]


@inlined
def lanes_jacobian(leader: Indices, links: Array, lanes: Lanes, free: float, w: int) -> None:
    """Compute the scaled geometric Jacobian of every lane; `free` = 1 ignores rotation about the tool's x axis."""
    T, J, axes, weight = lanes.pose, lanes.jacobian, lanes.axes, lanes.weight
    for k in range(len(leader)):
        i, link = leader[k], read_link(links[k])
        adds = link.adds > 0.0
        for l in range(w):
            joint, tool = twist_at(axes[k], l), pose_column(T, 0, l)
            axis, lever = joint.linear, minus(pose_column(T, 3, l), joint.angular)
            # The rate of the motion that a joint does not have is 0. Adding both needs no branch in the loop.
            wp, wo = link.turn_rate * weight[0, l], link.turn_rate * weight[1, l]
            ws = link.slide_rate * weight[0, l]
            along = free * dot(axis, tool)
            linear = plus(scaled(wp, cross(axis, lever)), scaled(ws, axis))
            angular = scaled(wo, minus(axis, scaled(along, tool)))
            # Joints that the same variable moves add up in one column; its first joint replaces the values of the last
            # step.
            before = twist_at(J[i], l)
            J[i, 0, l] = linear.x + (before.linear.x if adds else 0.0)
            J[i, 1, l] = linear.y + (before.linear.y if adds else 0.0)
            J[i, 2, l] = linear.z + (before.linear.z if adds else 0.0)
            J[i, 3, l] = angular.x + (before.angular.x if adds else 0.0)
            J[i, 4, l] = angular.y + (before.angular.y if adds else 0.0)
            J[i, 5, l] = angular.z + (before.angular.z if adds else 0.0)


@inlined
def lanes_hold(lower: Array, upper: Array, lanes: Lanes, w: int) -> None:
    """Remove every joint that is at a limit and would move outward from the Jacobian.

    A stubborn lane also removes the joints that the last step would have moved outward. Truncating a step spoils its
    other components, so convergence is slow if many joints are at limits.
    """
    J, q, e, step, stubborn = lanes.jacobian, lanes.q, lanes.residual, lanes.step, lanes.stubborn
    for i in range(len(lower)):
        low, high = lower[i], upper[i]
        if low <= -UNLIMITED:
            continue
        for l in range(w):
            column = twist_at(J[i], l)
            push = twist_dot(column, twist_at(e, l))
            last = stubborn[l] * step[i, l]
            fixed = (q[i, l] >= high and max(push, last) > 0.0) or (q[i, l] <= low and min(push, last) < 0.0)
            move = 0.0 if fixed else 1.0
            set_twist(J[i], l, Twist(scaled(move, column.linear), scaled(move, column.angular)))


@inlined
def lanes_gram(damping: float, floor: Array, lanes: Lanes, w: int) -> None:
    """Compute J Jᵀ + λ I of every lane; λ is damping · |e|² plus a floor, (LANES,), and at least `LOST`.

    The lower bound keeps the factorisation finite. Two joints are processed at a time, because half of the work is to
    load and store the sums; a last odd joint is processed alone.
    """
    A, J, dof = lanes.gram, lanes.jacobian, lanes.jacobian.shape[0]
    for r in range(21):
        for l in range(w):
            A[r, l] = 0.0
    for pair in range((dof + 1) // 2):
        i = 2 * pair
        k = min(i + 1, dof - 1)
        # A last odd joint is its own partner and must count once.
        once = 1.0 if k > i else 0.0
        for l in range(w):
            a0, a1, a2 = J[i, 0, l], J[i, 1, l], J[i, 2, l]
            a3, a4, a5 = J[i, 3, l], J[i, 4, l], J[i, 5, l]
            b0, b1, b2 = once * J[k, 0, l], once * J[k, 1, l], once * J[k, 2, l]
            b3, b4, b5 = once * J[k, 3, l], once * J[k, 4, l], once * J[k, 5, l]
            A[0, l] += a0 * a0 + b0 * b0
            A[1, l] += a1 * a0 + b1 * b0
            A[2, l] += a1 * a1 + b1 * b1
            A[3, l] += a2 * a0 + b2 * b0
            A[4, l] += a2 * a1 + b2 * b1
            A[5, l] += a2 * a2 + b2 * b2
            A[6, l] += a3 * a0 + b3 * b0
            A[7, l] += a3 * a1 + b3 * b1
            A[8, l] += a3 * a2 + b3 * b2
            A[9, l] += a3 * a3 + b3 * b3
            A[10, l] += a4 * a0 + b4 * b0
            A[11, l] += a4 * a1 + b4 * b1
            A[12, l] += a4 * a2 + b4 * b2
            A[13, l] += a4 * a3 + b4 * b3
            A[14, l] += a4 * a4 + b4 * b4
            A[15, l] += a5 * a0 + b5 * b0
            A[16, l] += a5 * a1 + b5 * b1
            A[17, l] += a5 * a2 + b5 * b2
            A[18, l] += a5 * a3 + b5 * b3
            A[19, l] += a5 * a4 + b5 * b4
            A[20, l] += a5 * a5 + b5 * b5
    for l in range(w):
        trace = A[0, l] + A[2, l] + A[5, l] + A[9, l] + A[14, l] + A[20, l]
        damp = damping * lanes.error[RESIDUAL2, l] + max(floor[l], LOST * trace)
        A[0, l] += damp
        A[2, l] += damp
        A[5, l] += damp
        A[9, l] += damp
        A[14, l] += damp
        A[20, l] += damp


@inlined
def lanes_solve(lanes: Lanes, w: int) -> None:
    """Solve the 6x6 systems by the Cholesky factorisation L D Lᵀ; overwrite the residual."""
    A, e = lanes.gram, lanes.residual
    for l in range(w):
        # No pivoting: the damping exceeds the rounding errors, so all pivots are positive, see `LOST`.
        d0 = 1.0 / A[0, l]
        a10, a20, a30, a40, a50 = A[1, l], A[3, l], A[6, l], A[10, l], A[15, l]
        l10, l20, l30, l40, l50 = a10 * d0, a20 * d0, a30 * d0, a40 * d0, a50 * d0
        d1 = 1.0 / (A[2, l] - l10 * a10)
        a21, a31 = A[4, l] - l20 * a10, A[7, l] - l30 * a10
        a41, a51 = A[11, l] - l40 * a10, A[16, l] - l50 * a10
        l21, l31, l41, l51 = a21 * d1, a31 * d1, a41 * d1, a51 * d1
        d2 = 1.0 / (A[5, l] - l20 * a20 - l21 * a21)
        a32 = A[8, l] - l30 * a20 - l31 * a21
        a42 = A[12, l] - l40 * a20 - l41 * a21
        a52 = A[17, l] - l50 * a20 - l51 * a21
        l32, l42, l52 = a32 * d2, a42 * d2, a52 * d2
        d3 = 1.0 / (A[9, l] - l30 * a30 - l31 * a31 - l32 * a32)
        a43 = A[13, l] - l40 * a30 - l41 * a31 - l42 * a32
        a53 = A[18, l] - l50 * a30 - l51 * a31 - l52 * a32
        l43, l53 = a43 * d3, a53 * d3
        d4 = 1.0 / (A[14, l] - l40 * a40 - l41 * a41 - l42 * a42 - l43 * a43)
        a54 = A[19, l] - l50 * a40 - l51 * a41 - l52 * a42 - l53 * a43
        l54 = a54 * d4
        d5 = 1.0 / (A[20, l] - l50 * a50 - l51 * a51 - l52 * a52 - l53 * a53 - l54 * a54)
        y0 = e[0, l]
        y1 = e[1, l] - l10 * y0
        y2 = e[2, l] - l20 * y0 - l21 * y1
        y3 = e[3, l] - l30 * y0 - l31 * y1 - l32 * y2
        y4 = e[4, l] - l40 * y0 - l41 * y1 - l42 * y2 - l43 * y3
        y5 = e[5, l] - l50 * y0 - l51 * y1 - l52 * y2 - l53 * y3 - l54 * y4
        x5 = y5 * d5
        x4 = y4 * d4 - l54 * x5
        x3 = y3 * d3 - l43 * x4 - l53 * x5
        x2 = y2 * d2 - l32 * x3 - l42 * x4 - l52 * x5
        x1 = y1 * d1 - l21 * x2 - l31 * x3 - l41 * x4 - l51 * x5
        x0 = y0 * d0 - l10 * x1 - l20 * x2 - l30 * x3 - l40 * x4 - l50 * x5
        e[0, l], e[1, l], e[2, l], e[3, l], e[4, l], e[5, l] = x0, x1, x2, x3, x4, x5


@inlined
def lanes_move(lower: Array, upper: Array, longest: float, lanes: Lanes, w: int) -> None:
    """Move by dq = Jᵀ x, each joint by at most `longest` and within its limits."""
    J, x, q, step, share, dof = lanes.jacobian, lanes.residual, lanes.q, lanes.step, lanes.share, len(lower)
    for l in range(w):
        share[l] = longest
    for pair in range((dof + 1) // 2):  # Two joints at a time, as in `lanes_gram`.
        i = 2 * pair
        k = min(i + 1, dof - 1)
        for l in range(w):
            solution = twist_at(x, l)
            a, b = twist_dot(twist_at(J[i], l), solution), twist_dot(twist_at(J[k], l), solution)
            step[i, l], step[k, l] = a, b
            share[l] = max(share[l], abs(a), abs(b))
    for l in range(w):
        # One factor for all joints keeps the direction of the step. `share` began at `longest`, so it is at most 1.
        share[l] = longest / share[l]
    for i in range(dof):
        low, high = lower[i], upper[i]
        for l in range(w):
            q[i, l] = min(max(q[i, l] + share[l] * step[i, l], low), high)
