"""Bounds on the motion of the hand in a box of joint values, and the tests that they allow.

A box is a centre c and half widths h of the joint variables. Write the arm as a product of exponentials about its centre:
``T(q) = E_1 E_2 … E_m T(c)``, where E_k rotates by δ_k about the axis that joint k has *at the centre* (Brockett 1984).
Move from c to q one joint at a time, from the base on. Each joint that still moves then finds the distal joints at the
centre. All bounds therefore need only the radii ``r_k = |z_k x (p - p_k)|`` at the centre:

- *first order*: a point moves by at most ``Σ r_k 2 sin(h_k/2)``, and a direction likewise with ``s_k = |z_k x a|`` for
  r_k;
- *third order* (`kernels.proof.form`): the error of the Taylor polynomial of degree two is at most
  ``Σ r_k ((S_k)³ - (S_{k-1})³)/6``, with ``S_k = h_1 + … + h_k`` over the revolute joints. (Keep the terms of
  ``E_1 … E_{k-1} v_k(δ_k)`` up to degree two; the remainder is at most ``r_k (h³/6 + S h²/2 + S² h/2)``. A prismatic
  joint adds ``h S²/2``.)

Every test compares with the goal and adds a margin for rounding: `ProofGoal.margin`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.division import NONE, SLIDE, TURN
from kinseek.kernels.arm.vectors import Vector, column, minus, plus, row, scaled
from kinseek.kernels.jit import inlined

from .box import BoxScratch, Form, ProofGoal, motion, rounding, short_way, turning

OF_ANGLES = 64.0 * 2.0**-53
"""Margin for rounding of the results of arc functions [rad]. Two angles within π have errors of 16 unit roundoffs each,
and their difference of 4. An arc sine has an error of 8 and is doubled. The sum is 52 if these functions are accurate
to four units in the last place. `ProofGoal.margin` covers the rounding of their arguments."""

FULL_TURN = 3.14159
"""Half width that counts as a full turn [rad], because limits are often written with this many digits. A box that becomes
an arc may exceed its limits by the difference to π, 2.7e-6 rad; this only enlarges boxes and loses nothing. With half
the value, every joint of more than 180° would count as unlimited."""


WIDE = 0.3
"""Half angle [rad] above which a cone of directions is tested at its edge, and compared by angles. Below it a ball is
hardly larger than the cone. It decides what is tried, not what is proved."""


@inlined
def arc(rc: float, zc: float, rg: float, zg: float, rho: float) -> float:
    """Largest deviation [rad] of a rotation about z that brings a point at rc, zc within `rho` of one at rg, zg.

    Points are given by radius and height. The deviation is measured from the best rotation, and negative if no rotation
    does. By the law of cosines ``4 rc rg sin²(ψ/2) = rho² - (rc - rg)² - (zc - zg)²``.
    """
    left = rho * rho - (rc - rg) * (rc - rg) - (zc - zg) * (zc - zg)
    if left < 0.0:
        return -1.0
    full = 4.0 * rc * rg
    if left >= full:
        return math.pi
    return 2.0 * math.asin(math.sqrt(left / full)) + OF_ANGLES


@inlined
def cut_arc(scratch: BoxScratch, i: int, middle: float, psi: float) -> bool:
    """Cut the range of revolute variable i to the arc middle ± psi [rad]; return False if nothing is left."""
    if psi >= math.pi:
        return True
    c, h = scratch.c[i], scratch.h[i]
    psi += 4.0 * rounding(c, h)
    off = short_way(middle - c)
    if abs(off) > h + psi:
        return False
    # Two pieces are left. A full turn becomes the arc; limits are kept until the arc is smaller.
    if abs(off) > 2.0 * math.pi - h - psi:
        if h > FULL_TURN:
            scratch.c[i], scratch.h[i] = c + off, psi
        return True
    low, high = max(-h, off - psi), min(h, off + psi)
    scratch.c[i], scratch.h[i] = c + 0.5 * (low + high), max(0.5 * (high - low), 0.0) + rounding(c, h)
    return True


@inlined
def least_error(proof_goal: ProofGoal, far: float, tilt: float, b: float) -> float:
    """Smallest weighted error with a point b [m] from the tip `far` away [m] and a last axis off by a chord of `tilt`.

    Let σ = 2 sin(φ/2) ≥ tilt for the hand's total rotation φ. The tip is then no nearer than far - σ b, and the paper's
    orientation error is at least K_A (1 - cos φ) = K_A σ²/2.
    """
    K_P, K_A = proof_goal.weight_p, proof_goal.weight_a
    far, sigma = max(far, 0.0), max(tilt, 0.0)
    if K_A > 0.0 and b > 0.0:
        # The sum is smallest where its derivative is 0, at σ = K_P b / K_A, or where the position error becomes 0.
        sigma = min(max(sigma, min(K_P * b / K_A, far / b)), 2.0)
    error: float = K_P * max(far - b * sigma, 0.0) + 0.5 * K_A * sigma * sigma
    return error


@inlined
def wide(form: Form, proof_goal: ProofGoal) -> bool:
    """Return True if the tolerances allow the hand's only relevant axis to lie in a wide cone about the goal's."""
    return form.columns == 1 and proof_goal.angle > WIDE


@inlined
def lean_beyond(proof_goal: ProofGoal, turn: float) -> float:
    """Largest distance, as a chord, of an axis from the goal's at the centre of a box that rotates it by a chord `turn`.

    Angles add up, but chords do not: with a wide cone their sum is much too large.
    """
    angle = proof_goal.angle + proof_goal.margin_a + 2.0 * math.asin(min(0.5 * turn, 1.0))
    return 2.0 * math.sin(0.5 * min(angle, math.pi)) + proof_goal.margin_a


class Compared(NamedTuple):
    """A point and an axis of the hand, or of the goal."""

    point: Vector
    axis: Vector


@inlined
def compared_of_hand(form: Form, scratch: BoxScratch) -> Compared:
    """The tip and the hand's first column, or, without the last joint, a point on that joint's axis and this axis."""
    if form.tail == 0:
        return Compared(column(scratch.T, 3), column(scratch.T, 0))
    last = len(form.leader) - 1
    axis = row(scratch.z, last)
    return Compared(plus(row(scratch.p, last), scaled(form.foot, axis)), axis)


@inlined
def compared_of_goal(form: Form, proof_goal: ProofGoal) -> Compared:
    """The same of the goal."""
    if form.tail == 0:
        return Compared(column(proof_goal.target, 3), column(proof_goal.target, 0))
    return Compared(column(proof_goal.last, 3), column(proof_goal.last, 2))


@inlined
def behind(compared: Compared, back: float) -> Vector:
    """The point that lies `back` [m] back along the axis."""
    return minus(compared.point, scaled(back, compared.axis))


@inlined
def from_first_axis(v: Vector) -> float:
    """Distance of a point from the first axis; sine of a direction's angle to it."""
    return math.sqrt(v.x * v.x + v.y * v.y)


@inlined
def apart(head: int, a: Vector, b: Vector) -> float:
    """Smallest distance of two points, or directions, that the first joint allows; it moves one of them."""
    off, height = from_first_axis(a) - from_first_axis(b), a.z - b.z
    if head == TURN:
        return math.sqrt(off * off + height * height)
    if head == SLIDE:
        height = 0.0
    return math.sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) + height * height)


@inlined
def turn_fits(scratch: BoxScratch, a: Vector, b: Vector, rho: float) -> bool:
    """Cut the first joint to rotations that bring a within `rho` of b; return False if nothing of its range is left."""
    psi = arc(from_first_axis(a), a.z, from_first_axis(b), b.z, rho)
    if psi < 0.0 or psi >= math.pi:
        return not psi < 0.0
    return cut_arc(scratch, 0, math.atan2(b.y, b.x) - math.atan2(a.y, a.x), psi)


@inlined
def slide_fits(scratch: BoxScratch, off: float, reach: float) -> bool:
    """Cut the first joint to slides within `reach` of `off` [m]; return False if nothing of its range is left."""
    low = max(scratch.c[0] - scratch.h[0], off - reach)
    high = min(scratch.c[0] + scratch.h[0], off + reach)
    if low > high:
        return False
    grown = rounding(scratch.c[0], scratch.h[0])
    scratch.c[0], scratch.h[0] = 0.5 * (low + high), 0.5 * (high - low) + grown
    return True


@inlined
def first_order(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> tuple[bool, float]:
    """Compare azimuth, radius, height and last axis with the goal's, and cut the range of the first joint accordingly.

    If `ceiling` is negative, the tolerances are tested. Otherwise boxes whose weighted error cannot be below `ceiling`
    are removed.

    Returns:
        False if nothing of the box is left, and a lower bound of the error in it.
    """
    begin, end = 1 if form.head != 0 else 0, len(form.leader) - form.tail
    trust, margin, back, bound = proof_goal.trust, proof_goal.margin, proof_goal.back, 0.0
    hand, goal = compared_of_hand(form, scratch), compared_of_goal(form, proof_goal)
    from_behind = 0.0  # Smallest distance of the point that lies back along the first column.
    if back != 0.0 and ceiling >= 0.0:
        point = behind(hand, back)
        from_behind = apart(form.head, point, behind(goal, back))
        from_behind -= trust * motion(form, scratch, begin, end, point) + margin
    rho = trust * motion(form, scratch, begin, end, hand.point) + margin
    far, tilt, sigma = apart(form.head, hand.point, goal.point), 0.0, 0.0
    if form.columns > 0:
        tilt = apart(TURN if form.head == TURN else NONE, hand.axis, goal.axis)
        sigma = trust * turning(form, scratch, begin, end, hand.axis) + proof_goal.margin_a
    if form.head == TURN:  # For `widest`: the previous states of the box must not matter.
        scratch.lever[0], scratch.s[0] = from_first_axis(hand.point), from_first_axis(hand.axis)
    elif form.head == SLIDE:
        scratch.lever[0], scratch.s[0] = 1.0, 0.0
    if ceiling < 0.0:
        rho += proof_goal.position
        if wide(form, proof_goal):
            sigma = lean_beyond(proof_goal, sigma)
        else:
            # A rotation φ changes three columns together by √2 · 2 sin(φ/2), and one direction by at most 2 sin(φ/2).
            sigma += proof_goal.chord if form.columns < 3 else proof_goal.chord / math.sqrt(2.0)
        if far > rho or tilt > sigma:
            return False, 0.0
    else:
        bound = max(0.0, least_error(proof_goal, far - rho, tilt - sigma, proof_goal.offset))
        if back != 0.0:
            bound = max(bound, least_error(proof_goal, from_behind, tilt - sigma, abs(back)))
        if bound > ceiling:
            return False, bound
        # ½ K_A σ² is at most the ceiling wherever the error counts.
        largest = 2.0
        if proof_goal.weight_a > 0.0:
            largest = min(math.sqrt(2.0 * ceiling / proof_goal.weight_a), 2.0)
        rho += ceiling / proof_goal.weight_p + proof_goal.offset * largest
        sigma += largest
    left = True
    if form.head == TURN:
        left = turn_fits(scratch, hand.point, goal.point, rho)
        if left and form.columns > 0:
            left = turn_fits(scratch, hand.axis, goal.axis, sigma)
    elif form.head == SLIDE:
        reach = math.sqrt(max(rho * rho - far * far, 0.0))
        left = slide_fits(scratch, goal.point.z - hand.point.z, reach)
    return left, bound
