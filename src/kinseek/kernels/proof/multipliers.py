"""Multipliers of the invariants of a ball joint: any multipliers bound the error, and good ones are found here.

The multipliers that describe how the error grows with the invariants at the middle of a box give the error there. For the
whole box others may be better: if the position error is nearly zero, its gradient has different directions in different
parts of the box. The multipliers are therefore changed to maximise the bound that they would give if each joint moved
alone, which needs no sums of products.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .box import TINY
from .products import Sheet, largest_increase

HALVINGS = 20
"""Number of halvings of the arc that contains the best rotation of the ball; any rotation gives a bound."""

ROUNDS = 16
"""Rounds in which better multipliers are sought, with a step up or down for each."""

FURTHER = 4
"""Number of times that the change of a round is repeated while it improves the bound."""

FIRST_STEP = 0.2
"""The first step, for multipliers of about one. It doubles after a success, and is reversed and halved after a failure."""

FLAT = 1e-6
"""Lower bound of denominators of multipliers, relative to the length of arm and goal. A denominator vanishes if p and a
are parallel, or if the tip is at the ball or at its goal. Any multipliers give a bound, but larger ones would give a
poor one."""


class Shoulder(NamedTuple):
    """An arm on a ball joint, and its goal."""

    invariants: Annotated[Array, "kinds", "terms"]
    """``|p|²``, ``p·a``, and with the first axis ``p·e``, ``a·e``, each as a sum of products. A product has one factor
    for each joint: one, its cosine or its sine; (2 or 4, 3ⁿ), with the last joint's index fastest."""
    goal: Annotated[Array, 2, 3]
    """g and b, (2, 3). They are in their plane, or with the first axis, which is then the third axis, rotated about it."""
    plane: Annotated[Array, 2, 3]
    """g and b in their plane, with g along its first axis, (2, 3)."""
    weight_p: float
    """K_P, per [m]."""
    weight_a: float
    """K_A; 0 if no column counts."""
    size: float
    """Sum of the lengths of arm and goal, plus one [m]."""
    margin: float
    """Margin for rounding [m]."""
    margin_a: float
    """Margin for rounding of directions."""
    trust: float
    """1; the tests of this package reduce it, which shrinks all bounds, and must detect that."""
    rounding: float
    """Error of a factor of a product, relative to the largest value of its sum."""


@inlined
def rotate_onto_goal(
    shoulder: Shoulder, goal: Array, s: float, u: float, height: float, lean: float, place: Array
) -> float:
    """Rotate tip and column about the third axis as near to the goal as possible; write them, and return the error.

    Args:
        shoulder: The arm on its ball, and its goal.
        goal: g and b, (2, 3).
        s: ``|p|²`` [m²].
        u: ``p·a`` [m].
        height: Component of the tip along the axis [m]; 0 if both are rotated in the plane of the goal.
        lean: Component of the column along the axis.
        place: Receives tip and column, (2, 3).
    """
    K_P, K_A = shoulder.weight_p, shoulder.weight_a
    radius, wide = math.sqrt(max(s - height * height, 0.0)), math.sqrt(max(1.0 - lean * lean, 0.0))
    inner, most = u - height * lean, radius * wide
    angle = math.atan2(math.sqrt(max(most * most - inner * inner, 0.0)), inner)
    off, r, z = math.atan2(goal[1, 1], goal[1, 0]) - angle, goal[0, 0], goal[0, 2]
    apart, product = (radius - r) * (radius - r) + (height - z) * (height - z), radius * r
    weight = K_A * wide * math.sqrt(goal[1, 0] * goal[1, 0] + goal[1, 1] * goal[1, 1])
    low, high = 0.0, abs(off)
    for _ in range(HALVINGS):
        turn = 0.5 * (low + high)
        # Bisection for the zero of the derivative of K_P miss + weight (1 - cos(|off| - turn)).
        half = math.sin(0.5 * turn)
        miss = math.sqrt(apart + 4.0 * product * half * half) + TINY
        if K_P * product * math.sin(turn) > weight * math.sin(abs(off) - turn) * miss:
            high = turn
        else:
            low = turn
    turn = 0.5 * (low + high) if off > 0.0 else -0.5 * (low + high)
    place[0, 0], place[0, 1], place[0, 2] = radius * math.cos(turn), radius * math.sin(turn), height
    place[1, 0], place[1, 1], place[1, 2] = wide * math.cos(turn + angle), wide * math.sin(turn + angle), lean
    far = tilt = 0.0
    for i in range(3):
        far += (place[0, i] - goal[0, i]) * (place[0, i] - goal[0, i])
        tilt += (place[1, i] - goal[1, i]) * (place[1, i] - goal[1, i])
    error: float = K_P * math.sqrt(far) + 0.5 * K_A * tilt
    return error


@inlined
def multiply(shoulder: Shoulder, goal: Array, place: Array, upright: bool, by: Array) -> None:
    """Write the multipliers that describe how the error grows with the invariants at the given tip and column.

    They satisfy ``K_P y = 2 λ z + μ α + η e``, where y is the direction of the position error, and make
    ``K_A b + μ z + θ e`` parallel to α, both as nearly as possible. Without the first axis (`upright` False) η and θ are
    0.
    """
    K_P, K_A, small = shoulder.weight_p, shoulder.weight_a, FLAT * shoulder.size
    z0, z1, z2 = place[0, 0], place[0, 1], place[0, 2]
    a0, a1, a2 = place[1, 0], place[1, 1], place[1, 2]
    b0, b1, b2 = K_A * goal[1, 0], K_A * goal[1, 1], K_A * goal[1, 2]
    za, ba = z0 * a0 + z1 * a1 + z2 * a2, b0 * a0 + b1 * a1 + b2 * a2
    s = z0 * z0 + z1 * z1 + z2 * z2 + small * small
    zz, ze, ee = s - za * za, z2 - za * a2, 1.0 - a2 * a2 + FLAT
    zb, eb = z0 * b0 + z1 * b1 + z2 * b2 - za * ba, b2 - ba * a2
    mu, theta = -zb / max(zz, small * small), 0.0
    if upright:
        det = max(zz * ee - ze * ze, FLAT * small * small)
        mu, theta = (ze * eb - ee * zb) / det, (ze * zb - zz * eb) / det
    y0, y1, y2 = z0 - goal[0, 0], z1 - goal[0, 1], z2 - goal[0, 2]
    pull = K_P / max(math.sqrt(y0 * y0 + y1 * y1 + y2 * y2), small)
    v0, v1, v2 = pull * y0 - mu * a0, pull * y1 - mu * a1, pull * y2 - mu * a2
    zv = z0 * v0 + z1 * v1 + z2 * v2
    twice, eta = zv / s, 0.0
    if upright:
        det = max(s - z2 * z2, small * small)
        twice, eta = (zv - z2 * v2) / det, (s * v2 - z2 * zv) / det
    m0, m1, m2 = b0 + mu * z0, b1 + mu * z1, b2 + mu * z2 + theta
    m = max(math.sqrt(m0 * m0 + m1 * m1 + m2 * m2), FLAT * (K_A + K_P * shoulder.size))
    by[0], by[1], by[2], by[3], by[4] = 0.5 * twice, mu, eta, theta, m


@inlined
def dual_value(shoulder: Shoulder, reach: float, terms: Array, by: Array) -> float:
    """A lower bound of the error if the invariants equal their first terms and the tip is within `reach` [m].

    Any multipliers give a bound, and so does any m > 0, their last entry.
    """
    K_P, K_A, goal = shoulder.weight_p, shoulder.weight_a, shoulder.goal
    mu, m = by[1], by[4]
    g0, g1, g2 = goal[0, 0], goal[0, 1], goal[0, 2]
    c0, c1, c2 = K_A * goal[1, 0] + mu * g0, K_A * goal[1, 1] + mu * g1, K_A * goal[1, 2] + by[3] + mu * g2
    bent = by[0] + 0.5 * mu * mu / m
    n0, n1, n2 = (
        mu / m * c0 + 2.0 * by[0] * g0,
        mu / m * c1 + 2.0 * by[0] * g1,
        mu / m * c2 + 2.0 * by[0] * g2,
    )
    n2 += by[2]
    climb = K_P - math.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    # The minimum of climb r - bent r² for 0 ≤ r ≤ reach: at an end, or where the derivative is 0.
    least = min((climb - bent * reach) * reach, 0.0)
    if bent < 0.0 and climb < 0.0 and climb > 2.0 * bent * reach:
        least = 0.25 * climb * climb / bent
    value: float = K_A - (c0 * c0 + c1 * c1 + c2 * c2 + m * m) / (2.0 * m) + least
    value -= by[0] * (g0 * g0 + g1 * g1 + g2 * g2) + by[2] * g2
    for k in range(len(terms) - 1):
        value += by[k] * terms[k, 0]
    return value


@inlined
def bound_by_single_joints(shoulder: Shoulder, reach: float, sheet: Sheet, by: Array) -> float:
    """The bound in the box that multipliers would give if each joint moved alone."""
    terms, ends = sheet.terms, sheet.ends
    kinds, stride = len(terms) - 1, terms.shape[1]
    value = dual_value(shoulder, reach, terms, by)
    for i in range(len(ends)):
        stride //= 3
        even = odd = 0.0
        for k in range(kinds):
            even -= by[k] * terms[k, stride]
            odd -= by[k] * terms[k, 2 * stride]
        value -= largest_increase(even, abs(odd), ends[i, 0], ends[i, 1], ends[i, 2])
    return value


@inlined
def improve_multipliers(shoulder: Shoulder, reach: float, enough: float, sheet: Sheet) -> None:
    """Look for multipliers with a larger such bound, one after the other, up and down."""
    by, trial, before, steps = sheet.by, sheet.trial, sheet.before, sheet.steps
    kinds, size, K_P, K_A = len(sheet.terms) - 1, shoulder.size, shoulder.weight_p, shoulder.weight_a
    best = bound_by_single_joints(shoulder, reach, sheet, by)
    for k in range(5):
        trial[k] = by[k]
    steps[0], steps[1], steps[2], steps[3] = K_P / size, K_P, K_P, K_A
    for k in range(4):
        steps[k] *= FIRST_STEP
    steps[4] = FIRST_STEP
    for _ in range(ROUNDS):
        if best >= enough:
            break
        for k in range(5):
            before[k] = by[k]
        for k in range(5):
            if kinds <= k < 4:
                continue
            for _side in range(2):
                if k < 4:
                    trial[k] = by[k] + steps[k]
                else:  # Up and down by a factor; exp would require a newer glibc.
                    trial[k] = by[k] * (1.0 + steps[k]) if steps[k] > 0.0 else by[k] / (1.0 - steps[k])
                value = bound_by_single_joints(shoulder, reach, sheet, trial)
                if value > best:
                    best, by[k] = value, trial[k]
                    steps[k] *= 2.0
                    break
                steps[k] = -steps[k]
            else:
                trial[k] = by[k]
                steps[k] *= 0.5
        along = 1.0
        for _further in range(FURTHER):
            for k in range(5):
                trial[k] = by[k] + along * (by[k] - before[k])
            trial[4] = max(trial[4], 0.5 * by[4])
            value = bound_by_single_joints(shoulder, reach, sheet, trial)
            if value <= best:
                break
            best = value
            for k in range(5):
                before[k], by[k] = by[k], trial[k]
            along = 2.0
        for k in range(5):
            trial[k] = by[k]


@inlined
def take_better(shoulder: Shoulder, reach: float, sheet: Sheet, given: Array, best: float) -> float:
    """Use other multipliers if their bound exceeds the best so far."""
    value: float = bound_by_single_joints(shoulder, reach, sheet, given)
    if value <= best:
        return best
    for k in range(5):
        sheet.by[k] = given[k]
    return value
