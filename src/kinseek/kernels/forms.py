"""One linear form of the hand's pose, to second order: what it excludes, and what it cuts off a box.

Bounds of first order add up how far each joint can carry the hand, whichever way. A form looks at one direction, in which
the joints may work against each other, and its gradient and Hessian are written down from the axes alone.
"""

from __future__ import annotations

import math

import numpy as np

from .arrays import Array
from .boxes import (
    CHORD,
    LEAST,
    MARGIN,
    MARGIN_A,
    POSITION,
    TINY,
    TRUST,
    WEIGHT_A,
    WEIGHT_P,
    Desk,
    Form,
    Wanted,
    motion,
    turn_goal,
    turning,
    widths,
)
from .jit import inner


@inner
def second_order(form: Form, wanted: Wanted, desk: Desk, ceiling: float, passes: int) -> bool:
    """Test the box by one linear form of the hand's pose, to second order; cut it where that excludes an end.

    Let f be the hand's point and columns less the goal's. For any form y, ``y·f(q) = y·f + g·δ + ½ δᵀHδ + rest`` with
    |rest| bounded to third order. With tolerances, y·f(q) larger than the dual norm of y times the tolerances excludes q.
    With the weighted error, ``K_P |f_p| ≥ y_p·f_p`` for |y_p| ≤ K_P and ``½ K_A |f_c|² ≥ y_c·f_c - |y_c|²/(2 K_A)`` make
    every form a lower bound (Fenchel's inequality). The form is the residual of a least-squares step that the box holds
    back: the direction in which the goal lies outside of what the box reaches.
    """
    m, dof = len(form.leader), len(desk.c)
    T, goal, columns = desk.T, desk.goal, form.columns
    tolerances = ceiling < 0.0
    trust = wanted.scalars[TRUST]
    K_P, K_A = wanted.scalars[WEIGHT_P], wanted.scalars[WEIGHT_A]
    turn_goal(form, wanted, desk)
    widths(form, desk)
    w0, w1, w2 = T[0, 3], T[1, 3], T[2, 3]
    motion(form, desk, 0, m, w0, w1, w2)
    if columns == 1:
        turning(form, desk, 0, m, T[0, 0], T[1, 0], T[2, 0])
    # Rests of the Taylor polynomials of the point and of the columns (as a Frobenius norm), degrees two and three.
    spread, two_p, two_c, three_p, three_c = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(m):
        h = desk.half[k]
        if form.prismatic[k]:
            two_p += h * spread
            three_p += 0.5 * h * spread * spread
            continue
        square = h * (h + 2.0 * spread)
        cube = h * (h * h + 3.0 * spread * (h + spread))
        s = desk.s[k] if columns == 1 else 1.4142135623730952
        two_p += 0.5 * square * desk.r[k]
        two_c += 0.5 * square * s
        three_p += cube * desk.r[k] / 6.0
        three_c += cube * s / 6.0
        spread += h
    f0, f1, f2 = w0 - goal[0, 3], w1 - goal[1, 3], w2 - goal[2, 3]
    far = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    t0 = t1 = t2 = 0.0  # Sum of c x c_g: the torque that turns the hand to the goal, negative.
    turned = 0.0
    for i in range(columns):
        t0 += T[1, i] * goal[2, i] - T[2, i] * goal[1, i]
        t1 += T[2, i] * goal[0, i] - T[0, i] * goal[2, i]
        t2 += T[0, i] * goal[1, i] - T[1, i] * goal[0, i]
        for r in range(3):
            turned += (T[r, i] - goal[r, i]) * (T[r, i] - goal[r, i])
    desk.out[0] = K_P * far + 0.5 * K_A * turned
    desk.u[0], desk.u[1] = far, math.sqrt(turned)
    if tolerances:
        slack_p = wanted.scalars[POSITION] + wanted.scalars[MARGIN]
        slack_c = wanted.scalars[CHORD] + wanted.scalars[MARGIN_A]
        weight_p = 1.0 / ((two_p * 0.5 + slack_p) * (two_p * 0.5 + slack_p))
        weight_c = 1.0 / ((two_c * 0.5 + slack_c) * (two_c * 0.5 + slack_c))
        for i in range(dof):
            desk.D[i] = 1.0 / (desk.h[i] * desk.h[i])
    else:
        slack_p, slack_c = wanted.scalars[MARGIN], wanted.scalars[MARGIN_A]
        weight_p = K_P / (far + two_p + slack_p)
        weight_c = K_A
        for i in range(dof):
            desk.D[i] = 0.0
        for k in range(m):
            desk.D[form.leader[k]] += abs(form.multiplier[k]) * (K_P * desk.r[k] + K_A) / 2.0
        for i in range(dof):
            desk.D[i] /= desk.h[i]
    turn_weight = weight_c if columns > 0 else 0.0
    for attempt in range(passes):
        normal_matrix(form, desk, weight_p, turn_weight, columns)
        for i in range(dof):
            desk.delta[i] = 0.0
        for k in range(m):
            rhs = weight_p * (desk.velocity[k, 0] * f0 + desk.velocity[k, 1] * f1 + desk.velocity[k, 2] * f2)
            if not form.prismatic[k]:
                rhs -= turn_weight * (desk.z[k, 0] * t0 + desk.z[k, 1] * t1 + desk.z[k, 2] * t2)
            desk.delta[form.leader[k]] -= form.multiplier[k] * rhs
        solve(desk.N, desk.D, desk.delta)
        # The form: the residual of the step, in the metric of the weights.
        o0 = o1 = o2 = 0.0
        y0, y1, y2 = f0, f1, f2
        for k in range(m):
            step = form.multiplier[k] * desk.delta[form.leader[k]]
            y0 += step * desk.velocity[k, 0]
            y1 += step * desk.velocity[k, 1]
            y2 += step * desk.velocity[k, 2]
            if not form.prismatic[k]:
                o0 += step * desk.z[k, 0]
                o1 += step * desk.z[k, 1]
                o2 += step * desk.z[k, 2]
        y0, y1, y2 = weight_p * y0, weight_p * y1, weight_p * y2
        size_p = math.sqrt(y0 * y0 + y1 * y1 + y2 * y2)
        if not tolerances and size_p > K_P:
            shrink = K_P / size_p * (1.0 - 1e-15)
            y0, y1, y2, size_p = y0 * shrink, y1 * shrink, y2 * shrink, K_P
        desk.y[0, 3], desk.y[1, 3], desk.y[2, 3] = y0, y1, y2
        size_c = 0.0
        value = y0 * f0 + y1 * f1 + y2 * f2
        m0 = m1 = m2 = trace = 0.0
        for i in range(columns):
            x0, x1, x2 = T[0, i], T[1, i], T[2, i]
            e0, e1, e2 = x0 - goal[0, i], x1 - goal[1, i], x2 - goal[2, i]
            c0 = turn_weight * (e0 + o1 * x2 - o2 * x1)
            c1 = turn_weight * (e1 + o2 * x0 - o0 * x2)
            c2 = turn_weight * (e2 + o0 * x1 - o1 * x0)
            desk.y[0, i], desk.y[1, i], desk.y[2, i] = c0, c1, c2
            size_c += c0 * c0 + c1 * c1 + c2 * c2
            value += c0 * e0 + c1 * e1 + c2 * e2
            trace += c0 * x0 + c1 * x1 + c2 * x2
            m0 += x1 * c2 - x2 * c1
            m1 += x2 * c0 - x0 * c2
            m2 += x0 * c1 - x1 * c0
        derivatives(form, desk, m0, m1, m2, trace, columns)
        # The least value of the polynomial in the box, one variable at a time.
        bent = curvature(desk)
        straight = 0.0
        for i in range(dof):
            straight -= abs(desk.g[i]) * desk.h[i]
        lost = 0.0
        for i in range(dof):
            for j in range(dof):
                if j != i:
                    desk.H[i, i] -= abs(desk.H[i, j]) * desk.h[j] / desk.h[i]
            lost += least(desk.g[i], desk.H[i, i], desk.h[i])
        if straight + bent > lost:
            lost = straight + bent
            for i in range(dof):
                desk.H[i, i] = 0.0
        length_c = math.sqrt(size_c)
        rest = trust * (size_p * three_p + length_c * three_c)
        rest += size_p * slack_p + length_c * slack_c + 1e-14 * (abs(value) - lost)
        if tolerances:
            surplus = value + lost - rest
        else:
            bound = value + lost - rest
            if columns > 0:
                bound -= 0.5 * size_c / K_A
            desk.out[1] = max(desk.out[1], bound)
            surplus = bound - ceiling
        if surplus > 0.0:
            return False
        if attempt + 1 == passes:
            cut_box(desk, -surplus)
        else:
            # Weights that make the ellipsoid touch the box and the balls where this form touched them.
            total = TINY
            for i in range(dof):
                total += abs(desk.g[i]) * desk.h[i]
            total += size_p * slack_p + length_c * slack_c
            for i in range(dof):
                desk.D[i] = (abs(desk.g[i]) + 0.05 * total / desk.h[i]) / desk.h[i]
            if tolerances:
                weight_p = (size_p + TINY) / (slack_p + three_p)
                weight_c = (length_c + TINY) / (slack_c + three_c)
                turn_weight = weight_c if columns > 0 else 0.0
    return True


@inner
def normal_matrix(form: Form, desk: Desk, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``JᵀWJ`` of the point and the columns into N, lower half."""
    m, dof, T = len(form.leader), len(desk.c), desk.T
    for i in range(dof):
        for j in range(dof):
            desk.N[i, j] = 0.0
    for k in range(m):
        for i in range(columns):
            desk.along[k, i] = desk.z[k, 0] * T[0, i] + desk.z[k, 1] * T[1, i] + desk.z[k, 2] * T[2, i]
        for l in range(k + 1):
            dot = weight_p * (
                desk.velocity[k, 0] * desk.velocity[l, 0]
                + desk.velocity[k, 1] * desk.velocity[l, 1]
                + desk.velocity[k, 2] * desk.velocity[l, 2]
            )
            if not (form.prismatic[k] or form.prismatic[l]):
                turn = columns * (
                    desk.z[k, 0] * desk.z[l, 0] + desk.z[k, 1] * desk.z[l, 1] + desk.z[k, 2] * desk.z[l, 2]
                )
                for i in range(columns):
                    turn -= desk.along[k, i] * desk.along[l, i]
                dot += weight_c * turn
            dot *= form.multiplier[k] * form.multiplier[l]
            i, j = form.leader[k], form.leader[l]
            desk.N[max(i, j), min(i, j)] += dot
            if l != k and i == j:
                desk.N[i, i] += dot


@inner
def solve(N: Array, D: Array, x: Array) -> None:
    """Solve ``(N + diag D) x = b`` in place by LDLᵀ, N given by its lower half."""
    dof = len(x)
    for j in range(dof):
        pivot = N[j, j] + D[j] * (1.0 + 1e-12)
        for k in range(j):
            pivot -= N[j, k] * N[j, k] * N[k, k]
        pivot = max(pivot, TINY)
        N[j, j] = pivot
        inverse = 1.0 / pivot
        for i in range(j + 1, dof):
            value = N[i, j]
            for k in range(j):
                value -= N[i, k] * N[j, k] * N[k, k]
            N[i, j] = value * inverse
    for i in range(dof):
        for k in range(i):
            x[i] -= N[i, k] * x[k]
    for i in range(dof):
        x[i] /= N[i, i]
    for i in range(dof - 1, -1, -1):
        for k in range(i + 1, dof):
            x[i] -= N[k, i] * x[k]


@inner
def derivatives(form: Form, desk: Desk, m0: float, m1: float, m2: float, trace: float, columns: int) -> None:
    """First and second derivatives of ``y·f`` by the variables, at the centre.

    As a wrench at the point: force y_p, torque Σ c x y_c. For i ≤ j, ``∂²/∂q_i∂q_j = z_i·u_j`` with
    ``u_j = (Σ c y_cᵀ + v_j y_pᵀ) z_j - (Σ c·y_c + v_j·y_p) z_j`` and v_j from axis j to the point.
    """
    m, dof, T, y = len(form.leader), len(desk.c), desk.T, desk.y
    for i in range(dof):
        desk.g[i] = 0.0
        for j in range(dof):
            desk.H[i, j] = 0.0
    y0, y1, y2 = y[0, 3], y[1, 3], y[2, 3]
    for k in range(m):
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        a = form.leader[k]
        slope = desk.velocity[k, 0] * y0 + desk.velocity[k, 1] * y1 + desk.velocity[k, 2] * y2
        if form.prismatic[k]:
            u0, u1, u2 = z1 * y2 - z2 * y1, z2 * y0 - z0 * y2, z0 * y1 - z1 * y0
        else:
            slope += z0 * m0 + z1 * m1 + z2 * m2
            v0, v1, v2 = T[0, 3] - desk.p[k, 0], T[1, 3] - desk.p[k, 1], T[2, 3] - desk.p[k, 2]
            force = y0 * z0 + y1 * z1 + y2 * z2
            diagonal = trace + v0 * y0 + v1 * y1 + v2 * y2
            u0, u1, u2 = force * v0 - diagonal * z0, force * v1 - diagonal * z1, force * v2 - diagonal * z2
            for i in range(columns):
                c = y[0, i] * z0 + y[1, i] * z1 + y[2, i] * z2
                u0 += c * T[0, i]
                u1 += c * T[1, i]
                u2 += c * T[2, i]
        desk.g[a] += form.multiplier[k] * slope
        for l in range(k + 1):
            if form.prismatic[l]:
                continue
            second = desk.z[l, 0] * u0 + desk.z[l, 1] * u1 + desk.z[l, 2] * u2
            second *= form.multiplier[k] * form.multiplier[l]
            b = form.leader[l]
            desk.H[a, b] += second
            if l != k:
                desk.H[b, a] += second


@inner
def curvature(desk: Desk) -> float:
    """A lower bound of ½ δᵀHδ in the box, by completing squares: those with a positive weight are dropped.

    After each square what remains is a form in the remaining variables, bounded by its entries' magnitudes.
    """
    dof, S = len(desk.h), desk.N
    for i in range(dof):
        for j in range(dof):
            S[i, j] = desk.H[i, j] * desk.h[i] * desk.h[j]
        desk.v[i] = 1.0
    best = -np.inf
    for _ in range(dof + 1):
        total, pivot, top = 0.0, -1, 0.0
        for i in range(dof):
            if desk.v[i] == 0.0:
                continue
            row = S[i, i]
            if row > top:
                top, pivot = row, i
            for j in range(dof):
                if j != i and desk.v[j] != 0.0:
                    row -= abs(S[i, j])
            total += min(row, 0.0)
        best = max(best, total)
        if pivot < 0 or total == 0.0:
            break
        inverse = 1.0 / top
        desk.v[pivot] = 0.0
        for i in range(dof):
            if desk.v[i] != 0.0:
                factor = S[i, pivot] * inverse
                for j in range(dof):
                    if desk.v[j] != 0.0:
                        S[i, j] -= factor * S[pivot, j]
    return 0.5 * best


@inner
def least(g: float, H: float, h: float) -> float:
    """Least value of g δ + ½ H δ² for |δ| ≤ h."""
    if H * h > abs(g):
        return -0.5 * g * g / H
    return -abs(g) * h + 0.5 * H * h * h


@inner
def cut_box(desk: Desk, spare: float) -> None:
    """Keep of every variable what can stay within `spare` above the least value of the separable polynomial."""
    dof = len(desk.c)
    for i in range(dof):
        g, H, h = abs(desk.g[i]), desk.H[i, i], desk.h[i]
        # Seen from the good end: δ = -h there, the polynomial g δ + ½ H δ².
        limit = least(g, H, h) + spare
        end = g * h + 0.5 * H * h * h
        if end <= limit:
            continue
        # The far end is out: the largest δ with g δ + ½ H δ² ≤ limit, by the root that the far end falls beyond.
        disc = g * g + 2.0 * H * limit
        if disc < 0.0 or g + math.sqrt(disc) < TINY:
            continue
        root = 2.0 * limit / (g + math.sqrt(disc))
        low = -h
        if H > 0.0:
            low = max(low, (-g - math.sqrt(disc)) / H)
        high = min(root + 1e-12 * (1.0 + h), h)
        low = max(low - 1e-12 * (1.0 + h), -h)
        if high <= low:
            continue
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        desk.c[i] += -middle if desk.g[i] < 0.0 else middle
        desk.h[i] = half + LEAST
