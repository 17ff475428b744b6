"""One linear form of the hand's pose, to second order: what it excludes, and what it cuts off a box.

Bounds of first order add up how far each joint can carry the hand, whichever way. A form looks at one direction, in which
the joints may work against each other, and its gradient and Hessian are written down from the axes alone.
"""

from __future__ import annotations

import math

import numpy as np

from .boxes import (
    BACK,
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
    turn_goal,
    widths,
)
from .halfway import derivatives, differentiate, downhill, halfway, normal_matrix, radii_behind, rests, solve
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
