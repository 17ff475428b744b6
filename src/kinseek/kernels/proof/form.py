"""One linear form of the hand's pose to second order: boxes that it excludes, and parts that it cuts off a box.

First-order bounds add up the motion of the hand by each joint, regardless of direction. A form y considers one direction,
in which the joints may compensate each other: ``y·f(c + δ) = y·f(c) + g·δ + ½ δᵀHδ + rest`` with the gradient and the
Hessian of `taylor`, and |rest| at most the form's size times the third-order remainder. Its minimum over the box is a
bound; where the polynomial exceeds it by too much, the box is cut.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import column, norm, plus, scaled
from kinseek.kernels.jit import inlined

from .box import TINY, BoxScratch, Form, ProofGoal, rounding, turn_goal, widths
from .dual import gain_of_side, support
from .taylor import (
    Rests,
    derivatives,
    differentiate,
    halfway,
    radii_behind,
    rests,
    shrink_miss,
    squares_of,
    step_miss,
    weight_miss,
)

ROUND = 0.05
"""Roundness of the ellipsoid of a second form, which touches the box where the first form touched it. This fraction of
the form's size counts for every variable, so that a variable without influence on the form stays inside its range. Not
examined further."""

OF_ROOTS = 64.0 * 2.0**-53
"""Rounding of the last steps to the root of a quadratic polynomial, relative to one plus the half width [rad] or [m].
Rounding of its coefficients has the effect of a shift of the bound that is smaller than `ProofGoal.margin`."""

OF_SQUARES = 32.0 * 2.0**-53
"""Rounding of one completed square, relative to the magnitudes of all entries before and after it. It covers three
operations per entry, on twice the entry before and the one after, and the sums of their magnitudes over some twenty
variables."""


class Expansion(NamedTuple):
    """The Taylor polynomial of the error in a box, whose terms are in the scratch memory."""

    middle: int
    """The joint from which the hand is seen."""
    rests: Rests
    """Its remainders."""
    three_b: float
    """That of the point that lies back along the first column, after the second-order terms [m]."""


class Slacks(NamedTuple):
    """Errors that do not count: tolerances and margins."""

    point: float
    """Of the point [m]."""
    columns: float
    """Of the columns together."""


@inlined
def expand(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> Expansion:
    """Compute the error of the hand at the centre of the box and its derivatives; return bounds of the remainders.

    As seen from halfway along the arm the proximal joints move the goal and the distal joints the hand, so third-order
    remainders are about four times smaller than if all joints moved the hand. For any form y,
    ``y·f(q) = y·f + g·δ + ½ δᵀHδ + rest``, where |rest| is bounded to third order.
    """
    turn_goal(form, proof_goal, scratch)
    widths(form, scratch)
    middle = halfway(form, proof_goal, scratch)
    differentiate(form, scratch, middle, form.columns)
    seen = rests(form, scratch, scratch.r, middle)
    three_b = seen.three_p
    if proof_goal.back != 0.0:
        radii_behind(form, scratch, middle, proof_goal.back)
        three_b = rests(form, scratch, scratch.back, middle).three_p
    return Expansion(middle, seen, three_b)


@inlined
def underestimate(
    form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float
) -> tuple[bool, float]:
    """Bound the weighted error from below by one form; cut the box where it excludes an end.

    ``K_P |f_p| ≥ y_p·f_p`` for |y_p| ≤ K_P and ``½ K_A |f_c|² ≥ y_c·f_c - |y_c|²/(2 K_A)`` make every form a lower bound
    (Fenchel's inequality). The form used is the best one to first order.

    Returns:
        False if nothing is left, and the bound.
    """
    seen = expand(form, proof_goal, scratch)
    support(form, proof_goal, scratch, ceiling)
    bound = weigh(form, proof_goal, scratch, seen, Slacks(proof_goal.margin, proof_goal.margin_a))
    if form.columns > 0:
        _, size_c = sizes(form, scratch)
        bound -= 0.5 * size_c**2 / proof_goal.weight_a
    if bound > ceiling:
        return False, bound
    cut_box(scratch, ceiling - bound)
    return True, bound


@inlined
def separate(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, passes: int) -> bool:
    """Look for a form that separates box and tolerances; cut the box where it excludes an end; False if nothing is left.

    A form y excludes every q where y·f(q) is larger than its dual norm times the tolerances. It is the residual of a
    least-squares step that the box, as an ellipsoid, limits: the direction in which the goal lies outside the reach of
    the box. `passes` forms are tried, each based on the result of the previous one.
    """
    seen, columns = expand(form, proof_goal, scratch), form.columns
    rest = seen.rests
    slack_p = proof_goal.position + proof_goal.margin
    slack_c = proof_goal.chord + proof_goal.margin_a
    weight_p = 1.0 / ((rest.two_p * 0.5 + slack_p) * (rest.two_p * 0.5 + slack_p))
    weight_c = 1.0 / ((rest.two_c * 0.5 + slack_c) * (rest.two_c * 0.5 + slack_c))
    for i in range(len(scratch.c)):
        scratch.D[i] = 1.0 / (scratch.h[i] * scratch.h[i])
    for attempt in range(passes):
        shrink_miss(form, scratch, weight_p, weight_c, columns)
        step_miss(form, scratch, columns)
        weight_miss(scratch, weight_p, weight_c, columns)
        surplus = weigh(form, proof_goal, scratch, seen, Slacks(slack_p, slack_c))
        if surplus > 0.0:
            return False
        if attempt + 1 == passes:
            cut_box(scratch, -surplus)
            break
        # Weights that make the ellipsoid touch the box and the balls where this form touched them.
        size_p, size_c = sizes(form, scratch)
        touch(scratch, TINY + size_p * slack_p + size_c * slack_c)
        weight_p = (size_p + TINY) / (slack_p + rest.three_p)
        weight_c = (size_c + TINY) / (slack_c + rest.three_c)
    return True


@inlined
def touch(scratch: BoxScratch, total: float) -> None:
    """Write weights that make an ellipsoid touch the box where the form does, whose size is `total` without the box."""
    g, h = scratch.g, scratch.h
    for i in range(len(h)):
        total += abs(g[i]) * h[i]
    for i in range(len(h)):
        scratch.D[i] = (abs(g[i]) + ROUND * total / h[i]) / h[i]


@inlined
def weigh(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, seen: Expansion, slacks: Slacks) -> float:
    """Minimum of the form in ``scratch.y`` over the box, minus the slacks of point and columns.

    A separable polynomial remains in `scratch`, for `cut_box`.
    """
    dof, y, g, H, h = len(scratch.c), scratch.y, scratch.g, scratch.H, scratch.h
    value = 0.0
    for r in range(3):
        value += y[r, 3] * (scratch.T[r, 3] - scratch.goal[r, 3])
        for i in range(form.columns):
            value += y[r, i] * (scratch.T[r, i] - scratch.goal[r, i])
    derivatives(form, scratch, seen.middle, form.columns)
    value += gain_of_side(form, proof_goal, scratch, seen.middle)
    # The minimum of the polynomial in the box, one variable at a time.
    bent = curvature(scratch)
    straight = 0.0
    for i in range(dof):
        straight -= abs(g[i]) * h[i]
    lost = 0.0
    for i in range(dof):
        for j in range(dof):
            if j != i:
                # |δ_i δ_j| ≤ ½ (h_j/h_i δ_i² + h_i/h_j δ_j²): mixed terms become squares of one variable each.
                H[i, i] -= abs(H[i, j]) * h[j] / h[i]
        lost += least(g[i], H[i, i], h[i])
    # Both bounds hold. This one has minimised the linear and the quadratic terms separately, so only the linear ones
    # remain for a cut.
    if straight + bent > lost:
        lost = straight + bent
        for i in range(dof):
            H[i, i] = 0.0
    size_p, size_c = sizes(form, scratch)
    over = size_p * seen.rests.three_p + size_c * seen.rests.three_c
    if proof_goal.back != 0.0:
        # The form is also a form of a point further back, which moves less, and of the first column.
        form_c = plus(column(y, 0), scaled(proof_goal.back, column(y, 3)))
        over = min(over, size_p * seen.three_b + norm(form_c) * seen.rests.three_c)
    over *= proof_goal.trust
    over += size_p * slacks.point + size_c * slacks.columns
    least_value: float = value + lost - over
    return least_value


@inlined
def sizes(form: Form, scratch: BoxScratch) -> tuple[float, float]:
    """Norms of the form's parts for the point and for the columns."""
    point, columns = squares_of(scratch.y, form.columns)
    return math.sqrt(point), math.sqrt(columns)


@inlined
def curvature(scratch: BoxScratch) -> float:
    """A lower bound of ½ δᵀHδ in the box by completing squares; squares with a positive weight are dropped.

    After each square the rest is a form in the remaining variables, bounded by the magnitudes of its entries. The change
    of an entry is at most as large as the entry before and after, so the magnitudes of all of them bound the rounding.
    """
    dof, S, completed, noise, before = len(scratch.h), scratch.S, scratch.completed, 0.0, 0.0
    for i in range(dof):
        for j in range(dof):
            S[i, j] = scratch.H[i, j] * scratch.h[i] * scratch.h[j]
        completed[i] = False
    best = -np.inf
    for _ in range(dof + 1):
        total, pivot, top, mass = 0.0, -1, 0.0, 0.0
        for i in range(dof):
            if completed[i]:
                continue
            if S[i, i] > top:
                top, pivot = S[i, i], i
            beside = 0.0
            for j in range(dof):
                if j != i and not completed[j]:
                    beside += abs(S[i, j])
            mass += abs(S[i, i]) + beside
            total += min(S[i, i] - beside, 0.0)
        noise += OF_SQUARES * (before + mass)
        before = mass
        best = max(best, total - noise)
        if pivot < 0 or total == 0.0:
            break
        inverse = 1.0 / top
        completed[pivot] = True
        for i in range(dof):
            if not completed[i]:
                factor = S[i, pivot] * inverse
                for j in range(dof):
                    if not completed[j]:
                        S[i, j] -= factor * S[pivot, j]
    return 0.5 * best


@inlined
def least(g: float, H: float, h: float) -> float:
    """Minimum of g δ + ½ H δ² for |δ| ≤ h."""
    if H * h > abs(g):
        return -0.5 * g * g / H
    return -abs(g) * h + 0.5 * H * h * h


@inlined
def cut_box(scratch: BoxScratch, allowance: float) -> None:
    """Cut each variable to where the separable polynomial is at most `allowance` above its minimum."""
    for i in range(len(scratch.c)):
        g, H, h = abs(scratch.g[i]), scratch.H[i, i], scratch.h[i]
        # Seen from the good end: δ = -h there, the polynomial is g δ + ½ H δ².
        limit = least(g, H, h) + allowance
        end = g * h + 0.5 * H * h * h
        if not end > limit:
            continue
        # The far end is excluded: the largest δ with g δ + ½ H δ² ≤ limit, from the root before the far end.
        disc = g * g + 2.0 * H * limit
        if not disc >= 0.0 or g + math.sqrt(disc) < TINY:
            continue
        # This form of (√disc - g)/H has no cancellation, and it holds for H = 0 too.
        root = 2.0 * limit / (g + math.sqrt(disc))
        low = -h
        if H > 0.0:
            low = max(low, (-g - math.sqrt(disc)) / H)
        high = min(root + OF_ROOTS * (1.0 + h), h)
        low = max(low - OF_ROOTS * (1.0 + h), -h)
        if high <= low:
            continue
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        scratch.c[i] += -middle if scratch.g[i] < 0.0 else middle
        scratch.h[i] = half + rounding(scratch.c[i], h)
