"""One linear form of the hand's pose to second order: boxes that it excludes, and parts that it cuts off a box.

First-order bounds add up the motion of the hand by each joint, regardless of direction. A form y considers one direction,
in which the joints may compensate each other: ``y·f(c + δ) = y·f(c) + g·δ + ½ δᵀHδ + rest`` with the gradient and the
Hessian of `taylor`, and |rest| at most the form's size times the third-order remainder. Its minimum over the box is a
bound; where the polynomial exceeds it by too much, the box is cut.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.jit import inlined, ir_inlined

from .box import TINY, BoxScratch, Form, ProofGoal, rounding, turn_goal, widths
from .dual import gain_of_side, support
from .taylor import (
    Rests,
    derivatives,
    differentiate,
    downhill,
    normal_matrix,
    rests,
    solve,
    squares_of,
    step_miss,
    weight_miss,
)

OF_ROOTS = 64.0 * 2.0**-53
"""Rounding of the last steps to the root of a quadratic polynomial, relative to one plus the half width [rad] or [m].
Rounding of its coefficients has the effect of a shift of the bound that is smaller than `ProofGoal.margin`."""


class Slacks(NamedTuple):
    """Errors that do not count: tolerances and margins."""

    point: float
    """Of the point [m]."""
    columns: float
    """Of the columns together."""


@inlined
def expand(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> Rests:
    """Compute the error of the hand at the centre of the box and its derivatives; return bounds of the remainders.

    As seen from halfway along the arm the proximal joints move the goal and the distal joints the hand, so third-order
    remainders are about four times smaller than if all joints moved the hand. For any form y,
    ``y·f(q) = y·f + g·δ + ½ δᵀHδ + rest``, where |rest| is bounded to third order.
    """
    turn_goal(form, proof_goal, scratch)
    widths(form, scratch)
    middle = len(form.leader) // 2
    differentiate(form, scratch, middle, form.columns)
    return rests(form, scratch, middle)


@ir_inlined
def underestimate(
    form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float
) -> tuple[bool, float]:
    """Bound the weighted error from below by one form; cut the box where it excludes an end.

    ``K_P |f_p| ≥ y_p·f_p`` for |y_p| ≤ K_P and ``½ K_A |f_c|² ≥ y_c·f_c - |y_c|²/(2 K_A)`` make every form a lower bound
    (Fenchel's inequality). The form used is the best one to first order.

    Returns:
        False if nothing is left, and the bound.
    """
    rest = expand(form, proof_goal, scratch)
    support(form, proof_goal, scratch, ceiling)
    bound = weigh(form, proof_goal, scratch, rest, Slacks(proof_goal.margin, proof_goal.margin_a))
    if form.columns > 0:
        _, size_c = sizes(form, scratch)
        bound -= 0.5 * size_c**2 / proof_goal.weight_a
    if bound > ceiling:
        return False, bound
    cut_box(scratch, ceiling - bound)
    return True, bound


@ir_inlined
def separate(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> bool:
    """Look for a form that separates box and tolerances; cut the box where it excludes an end; False if nothing is left.

    A form y excludes every q where y·f(q) is larger than its dual norm times the tolerances. It is the residual of a
    least-squares step that the box, as an ellipsoid, limits: the direction in which the goal lies outside the reach of
    the box. A second form, with the weights of the first one's result, takes 1 to 15 % fewer boxes and 10 % more time.
    """
    rest, columns = expand(form, proof_goal, scratch), form.columns
    slacks = Slacks(proof_goal.position + proof_goal.margin, proof_goal.chord + proof_goal.margin_a)
    reach_p, reach_c = rest.two_p * 0.5 + slacks.point, rest.two_c * 0.5 + slacks.columns
    weight_p, weight_c = 1.0 / (reach_p * reach_p), 1.0 / (reach_c * reach_c)
    for i in range(len(scratch.c)):
        scratch.D[i] = 1.0 / (scratch.h[i] * scratch.h[i])
    normal_matrix(form, scratch, weight_p, weight_c, columns)
    downhill(form, scratch, weight_p, weight_c, columns)
    solve(scratch.N, scratch.D, scratch.delta)
    step_miss(form, scratch, columns)
    weight_miss(scratch, weight_p, weight_c, columns)
    surplus = weigh(form, proof_goal, scratch, rest, slacks)
    if surplus > 0.0:
        return False
    cut_box(scratch, -surplus)
    return True


@inlined
def weigh(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, rest: Rests, slacks: Slacks) -> float:
    """Minimum of the form in ``scratch.y`` over the box, minus the slacks of point and columns.

    A separable polynomial remains in `scratch`, for `cut_box`.
    """
    dof, y, g, H, h = len(scratch.c), scratch.y, scratch.g, scratch.H, scratch.h
    value = 0.0
    for r in range(3):
        value += y[r, 3] * (scratch.T[r, 3] - scratch.goal[r, 3])
        for i in range(form.columns):
            value += y[r, i] * (scratch.T[r, i] - scratch.goal[r, i])
    derivatives(form, scratch, rest.middle, form.columns)
    value += gain_of_side(form, proof_goal, scratch, rest.middle)
    # The minimum of the polynomial in the box, one variable at a time. Completing squares of the others first gives as many
    # boxes, within 1 %, on the arms ur5e, puma560, jaco2_6, wx250s and panda.
    lost = 0.0
    for i in range(dof):
        for j in range(dof):
            if j != i:
                H[i, i] -= abs(H[i, j]) * h[j] / h[i]
        lost += least(g[i], H[i, i], h[i])
    size_p, size_c = sizes(form, scratch)
    over = size_p * rest.three_p + size_c * rest.three_c
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
def least(g: float, H: float, h: float) -> float:
    """Minimum of g δ + ½ H δ² for |δ| ≤ h."""
    if H * h > abs(g):
        return -0.5 * g * g / H
    return -abs(g) * h + 0.5 * H * h * h


@inlined
def cut_box(scratch: BoxScratch, spare: float) -> None:
    """Cut each variable to where the separable polynomial is at most `spare` above its minimum."""
    for i in range(len(scratch.c)):
        g, H, h = abs(scratch.g[i]), scratch.H[i, i], scratch.h[i]
        # Seen from the good end: δ = -h there, the polynomial is g δ + ½ H δ².
        limit = least(g, H, h) + spare
        end = g * h + 0.5 * H * h * h
        if not end > limit:
            continue
        # The far end is excluded: the largest δ with g δ + ½ H δ² ≤ limit, from the root before the far end.
        disc = g * g + 2.0 * H * limit
        if not disc >= 0.0 or g + math.sqrt(disc) < TINY:
            continue
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
