"""One linear form of the hand's pose, to second order: what it excludes, and what it cuts off a box.

Bounds of first order add up how far each joint can carry the hand, whichever way. A form looks at one direction, in which
the joints may work against each other, and its gradient and Hessian are written down from the axes alone.
"""

from __future__ import annotations

import math

import numpy as np

from .arrays import Array
from .boxes import (
    BACK,
    CHORD,
    LEAST,
    LENGTH,
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
    turn_goal,
    widths,
)
from .jit import inner


@inner
def second_order(form: Form, wanted: Wanted, desk: Desk, ceiling: float, passes: int) -> bool:
    """Test the box by one linear form of the hand's pose, to second order; cut it where that excludes an end.

    Let f be the hand's point and columns less the goal's, as seen from halfway along the arm: so it is as long as seen from
    the base, but the joints before move the goal, those behind the hand, and rests of third order are some four times
    smaller than if all of them moved the hand. For any form y, ``y·f(q) = y·f + g·δ + ½ δᵀHδ + rest`` with
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
    middle = halfway(form, wanted, desk)
    differentiate(form, desk, middle, columns)
    two_p, two_c, three_p, three_c = rests(form, desk, desk.r, middle)
    back, three_b = wanted.scalars[BACK], three_p
    if back != 0.0:
        radii_behind(form, desk, middle, back)
        _, _, three_b, _ = rests(form, desk, desk.back, middle)
    f0, f1, f2 = T[0, 3] - goal[0, 3], T[1, 3] - goal[1, 3], T[2, 3] - goal[2, 3]
    far = math.sqrt(f0 * f0 + f1 * f1 + f2 * f2)
    turned = 0.0
    for i in range(columns):
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
        downhill(form, desk, weight_p, turn_weight, columns)
        solve(desk.N, desk.D, desk.delta)
        # The form: the residual of the step, in the metric of the weights.
        y0, y1, y2 = f0, f1, f2
        for k in range(m):
            step = form.multiplier[k] * desk.delta[form.leader[k]]
            y0 += step * desk.velocity[k, 0]
            y1 += step * desk.velocity[k, 1]
            y2 += step * desk.velocity[k, 2]
        y0, y1, y2 = weight_p * y0, weight_p * y1, weight_p * y2
        size_p = math.sqrt(y0 * y0 + y1 * y1 + y2 * y2)
        if not tolerances and size_p > K_P:
            shrink = K_P / size_p * (1.0 - 1e-15)
            y0, y1, y2, size_p = y0 * shrink, y1 * shrink, y2 * shrink, K_P
        desk.y[0, 3], desk.y[1, 3], desk.y[2, 3] = y0, y1, y2
        size_c = 0.0
        value = y0 * f0 + y1 * f1 + y2 * f2
        for i in range(columns):
            for r in range(3):
                miss = T[r, i] - goal[r, i]
                part = miss
                for k in range(m):
                    part += form.multiplier[k] * desk.delta[form.leader[k]] * desk.slopes[k, i, r]
                part *= turn_weight
                desk.y[r, i] = part
                size_c += part * part
                value += part * miss
        derivatives(form, desk, middle, columns)
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
        rest = size_p * three_p + length_c * three_c
        if back != 0.0:
            # The form is as well one of a point further back, which moves less, and of the first column.
            b0, b1, b2 = desk.y[0, 0] + back * y0, desk.y[1, 0] + back * y1, desk.y[2, 0] + back * y2
            rest = min(rest, size_p * three_b + math.sqrt(b0 * b0 + b1 * b1 + b2 * b2) * three_c)
        rest *= trust
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
def halfway(form: Form, wanted: Wanted, desk: Desk) -> int:
    """The joint from which on the hand is moved, and before which the goal: where the rests of third order are least."""
    m, T, goal = len(form.leader), desk.T, desk.goal
    for k in range(m):
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        v0, v1, v2 = T[0, 3] - desk.p[k, 0], T[1, 3] - desk.p[k, 1], T[2, 3] - desk.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        desk.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + wanted.scalars[LENGTH]
        v0, v1, v2 = goal[0, 3] - desk.p[k, 0], goal[1, 3] - desk.p[k, 1], goal[2, 3] - desk.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        desk.s[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + wanted.scalars[LENGTH]
    least_rest, best = np.inf, 0
    for middle in range(m):
        spread = rest = 0.0
        for k in range(middle, m):
            if not form.prismatic[k]:
                h = desk.half[k]
                rest += desk.r[k] * h * (h * h + 3.0 * spread * (h + spread))
                spread += h
        spread = 0.0
        for k in range(middle - 1, -1, -1):
            if not form.prismatic[k]:
                h = desk.half[k]
                rest += desk.s[k] * h * (h * h + 3.0 * spread * (h + spread))
                spread += h
        if rest < least_rest:
            least_rest, best = rest, middle
    return best


@inner
def differentiate(form: Form, desk: Desk, middle: int, columns: int) -> None:
    """Write down how the joints move what the hand misses, as seen halfway: those before `middle` move the goal instead."""
    T, goal = desk.T, desk.goal
    for k in range(len(form.leader)):
        seen = goal if k < middle else T
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        if form.prismatic[k]:
            desk.velocity[k, 0], desk.velocity[k, 1], desk.velocity[k, 2] = z0, z1, z2
            desk.r[k], desk.s[k] = 1.0, 0.0
            for i in range(columns):
                for r in range(3):
                    desk.slopes[k, i, r] = 0.0
            continue
        v0, v1, v2 = seen[0, 3] - desk.p[k, 0], seen[1, 3] - desk.p[k, 1], seen[2, 3] - desk.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        desk.velocity[k, 0], desk.velocity[k, 1], desk.velocity[k, 2] = x0, x1, x2
        desk.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        square = 0.0
        for i in range(columns):
            a0, a1, a2 = seen[0, i], seen[1, i], seen[2, i]
            x0, x1, x2 = z1 * a2 - z2 * a1, z2 * a0 - z0 * a2, z0 * a1 - z1 * a0
            desk.slopes[k, i, 0], desk.slopes[k, i, 1], desk.slopes[k, i, 2] = x0, x1, x2
            square += x0 * x0 + x1 * x1 + x2 * x2
        desk.s[k] = math.sqrt(square)


@inner
def radii_behind(form: Form, desk: Desk, middle: int, back: float) -> None:
    """Write the radii of the point that lies `back` [m] back along the first column."""
    for k in range(len(form.leader)):
        if form.prismatic[k]:
            desk.back[k] = 1.0
            continue
        seen = desk.goal if k < middle else desk.T
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        v0 = seen[0, 3] - back * seen[0, 0] - desk.p[k, 0]
        v1 = seen[1, 3] - back * seen[1, 0] - desk.p[k, 1]
        v2 = seen[2, 3] - back * seen[2, 0] - desk.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        desk.back[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)


@inner
def rests(form: Form, desk: Desk, radii: Array, middle: int) -> tuple[float, float, float, float]:
    """Rests of the Taylor polynomials of degrees one and two: of the point, the columns, the point, the columns.

    Of the hand from joint `middle` on outwards, of the goal from there back to the base. The radii are those of the point.
    """
    m, spread, two_p, two_c, three_p, three_c = len(form.leader), 0.0, 0.0, 0.0, 0.0, 0.0
    for index in range(m):
        k = middle + index
        if k >= m:
            k = m - 1 - index
        if index == m - middle:
            spread = 0.0
        h = desk.half[k]
        if form.prismatic[k]:
            two_p += h * spread
            three_p += 0.5 * h * spread * spread
            continue
        square = 0.5 * h * (h + 2.0 * spread)
        cube = h * (h * h + 3.0 * spread * (h + spread)) / 6.0
        two_p += square * radii[k]
        two_c += square * desk.s[k]
        three_p += cube * radii[k]
        three_c += cube * desk.s[k]
        spread += h
    return two_p, two_c, three_p, three_c


@inner
def normal_matrix(form: Form, desk: Desk, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``JᵀWJ`` of the point and the columns into N, lower half."""
    m, dof = len(form.leader), len(desk.c)
    for i in range(dof):
        for j in range(dof):
            desk.N[i, j] = 0.0
    for k in range(m):
        for l in range(k + 1):
            dot = turn = 0.0
            for r in range(3):
                dot += desk.velocity[k, r] * desk.velocity[l, r]
                for i in range(columns):
                    turn += desk.slopes[k, i, r] * desk.slopes[l, i, r]
            dot = (weight_p * dot + weight_c * turn) * form.multiplier[k] * form.multiplier[l]
            i, j = form.leader[k], form.leader[l]
            desk.N[max(i, j), min(i, j)] += dot
            if l != k and i == j:
                desk.N[i, i] += dot


@inner
def downhill(form: Form, desk: Desk, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``-JᵀWf`` of what the hand misses into ``desk.delta``."""
    T, goal = desk.T, desk.goal
    for i in range(len(desk.delta)):
        desk.delta[i] = 0.0
    for k in range(len(form.leader)):
        point = turn = 0.0
        for r in range(3):
            point += desk.velocity[k, r] * (T[r, 3] - goal[r, 3])
            for i in range(columns):
                turn += desk.slopes[k, i, r] * (T[r, i] - goal[r, i])
        desk.delta[form.leader[k]] -= form.multiplier[k] * (weight_p * point + weight_c * turn)


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
def derivatives(form: Form, desk: Desk, middle: int, columns: int) -> None:
    """First and second derivatives of ``y·f`` by the variables, at the centre, as seen halfway.

    For joints l ≤ k behind `middle` ``∂²/∂q_l∂q_k = z_l·u_k``, with ``u_k = (Σ c y_cᵀ + v_k y_pᵀ) z_k - (Σ c·y_c + v_k·y_p)
    z_k`` and v_k from axis k to the point. Before it the goal moves, backwards: the same of the goal's point and columns,
    with a minus and k ≤ l. One joint before and one behind do not meet.
    """
    m, dof, y = len(form.leader), len(desk.c), desk.y
    for i in range(dof):
        desk.g[i] = 0.0
        for j in range(dof):
            desk.H[i, j] = 0.0
    y0, y1, y2 = y[0, 3], y[1, 3], y[2, 3]
    for k in range(m):
        seen = desk.goal if k < middle else desk.T
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        a = form.leader[k]
        slope = desk.velocity[k, 0] * y0 + desk.velocity[k, 1] * y1 + desk.velocity[k, 2] * y2
        if form.prismatic[k]:
            u0, u1, u2 = z1 * y2 - z2 * y1, z2 * y0 - z0 * y2, z0 * y1 - z1 * y0
        else:
            v0, v1, v2 = seen[0, 3] - desk.p[k, 0], seen[1, 3] - desk.p[k, 1], seen[2, 3] - desk.p[k, 2]
            force, diagonal = y0 * z0 + y1 * z1 + y2 * z2, v0 * y0 + v1 * y1 + v2 * y2
            u0, u1, u2 = force * v0, force * v1, force * v2
            for i in range(columns):
                c = 0.0
                for r in range(3):
                    slope += y[r, i] * desk.slopes[k, i, r]
                    c += y[r, i] * desk.z[k, r]
                    diagonal += y[r, i] * seen[r, i]
                u0 += c * seen[0, i]
                u1 += c * seen[1, i]
                u2 += c * seen[2, i]
            u0, u1, u2 = u0 - diagonal * z0, u1 - diagonal * z1, u2 - diagonal * z2
        desk.g[a] += form.multiplier[k] * slope
        begin, end, sign = (k, middle, -1.0) if k < middle else (middle, k + 1, 1.0)
        for l in range(begin, end):
            if form.prismatic[l]:
                continue
            second = desk.z[l, 0] * u0 + desk.z[l, 1] * u1 + desk.z[l, 2] * u2
            second *= sign * form.multiplier[k] * form.multiplier[l]
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
