"""Multipliers of the invariants of a ball joint: any multipliers bound the error, and good ones are found here.

See `shoulder` for the bound. The multipliers that describe how the error grows with the invariants at the middle of a box
give the error there: they satisfy ``K_P y = 2 λ z + μ α + η e``, where y is the direction of the position error of the tip
z, and make ``K_A b + μ z + θ e`` parallel to the column α. For the whole box others may be better: if the position error is
nearly zero, its gradient has different directions in different parts of the box. The multipliers are therefore changed to
maximise the bound that they would give if each joint moved alone, which needs no sums of products.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import Vector, dot, minus, norm, plus, row, scaled
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import array_view, inlined

from .box import TINY
from .products import Products, ends_of, rise

HALVINGS = 20
"""Number of halvings of the arc that contains the best rotation of the ball; any rotation gives a bound."""

ROUNDS = 16
"""Rounds in which better multipliers are sought, with a step up or down for each. Without any, 1.5 to 3.4 times as many
boxes are needed, and 2 of 27 goals of gen3 and of iiwa14 stay open after a second, none with them
(`python -m benchmarks.proof gen3 iiwa14 --goals 60 --gap 0.01 --seconds 1 --seed 7`)."""

FURTHER = 4
"""Number of times that the change of a round is repeated while it improves the bound. Without it up to 1.5 times as many
boxes are needed."""

FIRST_STEP = 0.2
"""The first step, for multipliers of about one. It doubles after a success, and is reversed and halved after a failure."""

FLAT = 1e-6
"""Lower bound of denominators of multipliers, relative to the length of arm and goal. A denominator vanishes if p and a
are parallel, or if the tip is at the ball or at its goal. Any multipliers give a bound, but larger ones would give a
poor one."""

KINDS = 4
"""Largest number of invariants; `Multipliers` has one more entry."""


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


class Multipliers(NamedTuple):
    """Multipliers of the invariants, and m > 0; those of the first axis are 0 without it."""

    square: float
    """λ, of ``|p|²``."""
    along: float
    """μ, of ``p·a``."""
    height: float
    """η, of ``p·e``."""
    lean: float
    """θ, of ``a·e``."""
    m: float


class BallGoal(NamedTuple):
    """The goal of an arm on a ball."""

    tip: Vector
    """g"""
    column: Vector
    """b"""


class Nearest(NamedTuple):
    """Tip and column after the best rotation of the ball, and their error."""

    tip: Vector
    column: Vector
    error: float


class Ascent(NamedTuple):
    """Memory of the search for multipliers; each has `KINDS` entries and m."""

    best: Array
    trial: Array
    before: Array
    """Multipliers before the current round."""
    steps: Array


@array_view
def make_ascent() -> Ascent:
    """Allocate the memory of one search."""
    return Ascent(np.zeros(KINDS + 1), np.zeros(KINDS + 1), np.zeros(KINDS + 1), np.zeros(KINDS + 1))


@inlined
def goal_at(goal: Array) -> BallGoal:
    """Read a goal, (2, 3)."""
    return BallGoal(row(goal, 0), row(goal, 1))


@inlined
def multipliers_at(values: Array) -> Multipliers:
    """Read multipliers, (KINDS + 1,)."""
    return Multipliers(values[0], values[1], values[2], values[3], values[4])


@inlined
def write_multipliers(by: Multipliers, values: Array) -> None:
    """Write multipliers, (KINDS + 1,)."""
    values[0], values[1], values[2], values[3], values[4] = by.square, by.along, by.height, by.lean, by.m


@inlined
def nearest(shoulder: Shoulder, goal: BallGoal, s: float, u: float, height: float, lean: float) -> Nearest:
    """Rotate tip and column about the third axis as near to the goal as possible.

    Args:
        shoulder: The arm on its ball, and its goal.
        goal: The goal, in its plane or with the first axis.
        s: ``|p|²`` [m²].
        u: ``p·a`` [m].
        height: Component of the tip along the axis [m]; 0 if both are rotated in the plane of the goal.
        lean: Component of the column along the axis.
    """
    K_P, K_A, g, b = shoulder.weight_p, shoulder.weight_a, goal.tip, goal.column
    radius, wide = math.sqrt(max(s - height * height, 0.0)), math.sqrt(max(1.0 - lean * lean, 0.0))
    inner, most = u - height * lean, radius * wide
    angle = math.atan2(math.sqrt(max(most * most - inner * inner, 0.0)), inner)
    off = math.atan2(b.y, b.x) - angle
    apart = (radius - g.x) * (radius - g.x) + (height - g.z) * (height - g.z)
    product, weight = radius * g.x, K_A * wide * math.sqrt(b.x * b.x + b.y * b.y)
    low, high = 0.0, abs(off)
    for _ in range(HALVINGS):
        turn = 0.5 * (low + high)
        half = math.sin(0.5 * turn)
        miss = math.sqrt(apart + 4.0 * product * half * half) + TINY
        if K_P * product * math.sin(turn) > weight * math.sin(abs(off) - turn) * miss:
            high = turn
        else:
            low = turn
    turn = 0.5 * (low + high) if off > 0.0 else -0.5 * (low + high)
    tip = Vector(radius * math.cos(turn), radius * math.sin(turn), height)
    column = Vector(wide * math.cos(turn + angle), wide * math.sin(turn + angle), lean)
    far, tilted = minus(tip, g), minus(column, b)
    error: float = K_P * norm(far) + 0.5 * K_A * dot(tilted, tilted)
    return Nearest(tip, column, error)


@inlined
def multipliers_of(shoulder: Shoulder, goal: BallGoal, near: Nearest, upright: bool) -> Multipliers:
    """Multipliers that describe how the error grows with the invariants at the given tip and column, as nearly as possible.

    Without the first axis (`upright` False) η and θ are 0.
    """
    K_P, K_A, small = shoulder.weight_p, shoulder.weight_a, FLAT * shoulder.size
    z, a, b = near.tip, near.column, scaled(K_A, goal.column)
    za, ba = dot(z, a), dot(b, a)
    s = dot(z, z) + small * small
    zz, ze, ee = s - za * za, z.z - za * a.z, 1.0 - a.z * a.z + FLAT
    zb, eb = dot(z, b) - za * ba, b.z - ba * a.z
    mu, theta = -zb / max(zz, small * small), 0.0
    if upright:
        det = max(zz * ee - ze * ze, FLAT * small * small)
        mu, theta = (ze * eb - ee * zb) / det, (ze * zb - zz * eb) / det
    y = minus(z, goal.tip)
    v = minus(scaled(K_P / max(norm(y), small), y), scaled(mu, a))
    zv = dot(z, v)
    twice, eta = zv / s, 0.0
    if upright:
        det = max(s - z.z * z.z, small * small)
        twice, eta = (zv - z.z * v.z) / det, (s * v.z - z.z * zv) / det
    alpha = plus(plus(b, scaled(mu, z)), Vector(0.0, 0.0, theta))
    m = max(norm(alpha), FLAT * (K_A + K_P * shoulder.size))
    return Multipliers(0.5 * twice, mu, eta, theta, m)


@inlined
def combined(by: Multipliers, terms: Array, t: int) -> float:
    """Term t of the sum of the invariants with negated multipliers."""
    value: float = -by.square * terms[0, t] - by.along * terms[1, t]
    if len(terms) > 2:
        value = value - by.height * terms[2, t] - by.lean * terms[3, t]
    return value


@inlined
def combine(products: Products, by: Multipliers) -> None:
    """Write the sum of the invariants with negated multipliers."""
    for t in range(len(products.total)):
        products.total[t] = combined(by, products.terms, t)


@inlined
def dual_value(shoulder: Shoulder, reach: float, terms: Array, by: Multipliers) -> float:
    """A lower bound of the error if the invariants equal their first terms and the tip is within `reach` [m].

    Any multipliers give a bound, and so does any m > 0.
    """
    K_P, K_A, goal = shoulder.weight_p, shoulder.weight_a, goal_at(shoulder.goal)
    g, axis, mu, m = goal.tip, Vector(0.0, 0.0, 1.0), by.along, by.m
    c = plus(plus(scaled(K_A, goal.column), scaled(mu, g)), scaled(by.lean, axis))
    bent = by.square + 0.5 * mu * mu / m
    n = plus(plus(scaled(mu / m, c), scaled(2.0 * by.square, g)), scaled(by.height, axis))
    climb = K_P - norm(n)
    least = min((climb - bent * reach) * reach, 0.0)
    if bent < 0.0 and climb < 0.0 and climb > 2.0 * bent * reach:
        least = 0.25 * climb * climb / bent
    value: float = K_A - (dot(c, c) + m * m) / (2.0 * m) + least
    value -= by.square * dot(g, g) + by.height * g.z
    return value - combined(by, terms, 0)


@inlined
def promised(shoulder: Shoulder, reach: float, products: Products, by: Multipliers) -> float:
    """The bound in the box that multipliers would give if each joint moved alone."""
    terms = products.terms
    value, stride = dual_value(shoulder, reach, terms, by), terms.shape[1]
    for i in range(len(products.half)):
        stride //= 3
        odd = combined(by, terms, 2 * stride)
        value -= rise(combined(by, terms, stride), abs(odd), ends_of(products, i))
    return value


@inlined
def better(
    shoulder: Shoulder, reach: float, products: Products, a: Multipliers, b: Multipliers
) -> Multipliers:
    """Those of two multipliers that promise the larger bound."""
    if promised(shoulder, reach, products, b) > promised(shoulder, reach, products, a):
        return b
    return a


@inlined
def improved(
    shoulder: Shoulder, reach: float, products: Products, ascent: Ascent, enough: float
) -> Multipliers:
    """Look for multipliers with a larger such bound from ``ascent.best``, one after the other, until it is `enough`."""
    by, trial, before, steps = ascent.best, ascent.trial, ascent.before, ascent.steps
    kinds, K_P, K_A = len(products.terms), shoulder.weight_p, shoulder.weight_a
    best = promised(shoulder, reach, products, multipliers_at(by))
    steps[0], steps[1], steps[2], steps[3], steps[4] = K_P / shoulder.size, K_P, K_P, K_A, 1.0
    for k in range(KINDS + 1):
        trial[k] = by[k]
        steps[k] *= FIRST_STEP
    for _ in range(ROUNDS):
        if best >= enough:
            break
        for k in range(KINDS + 1):
            before[k] = by[k]
        for k in range(KINDS + 1):
            if kinds <= k < KINDS:
                continue
            for _side in range(2):
                if k < KINDS:
                    trial[k] = by[k] + steps[k]
                else:  # Up and down by a factor; exp would require a newer glibc.
                    trial[k] = by[k] * (1.0 + steps[k]) if steps[k] > 0.0 else by[k] / (1.0 - steps[k])
                value = promised(shoulder, reach, products, multipliers_at(trial))
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
            for k in range(KINDS + 1):
                trial[k] = by[k] + along * (by[k] - before[k])
            trial[KINDS] = max(trial[KINDS], 0.5 * by[KINDS])
            value = promised(shoulder, reach, products, multipliers_at(trial))
            if value <= best:
                break
            best = value
            for k in range(KINDS + 1):
                before[k], by[k] = by[k], trial[k]
            along = 2.0
        for k in range(KINDS + 1):
            trial[k] = by[k]
    return multipliers_at(by)
