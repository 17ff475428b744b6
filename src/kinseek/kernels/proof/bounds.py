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

from kinseek.kernels.arm.division import SLIDE, TURN
from kinseek.kernels.jit import inlined

from .box import BELOW, BoxScratch, Form, ProofGoal, motion, rounding, short_way, turning

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


@inlined
def first_order(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> bool:
    """Compare azimuth, radius, height and last axis with the goal's; return False if nothing of the box is left.

    If `ceiling` is negative, the tolerances are tested. Otherwise boxes whose weighted error cannot be below `ceiling`
    are removed. The range of the first joint is cut to what the azimuths allow. ``scratch.found[BELOW]`` receives a lower
    bound of the error.
    """
    T, m = scratch.T, len(form.leader)
    trust, margin, margin_a = proof_goal.trust, proof_goal.margin, proof_goal.margin_a
    begin = 1 if form.head != 0 else 0
    end = m
    w0, w1, w2, a0, a1, a2 = T[0, 3], T[1, 3], T[2, 3], T[0, 0], T[1, 0], T[2, 0]
    goal = proof_goal.target
    column = 0
    if form.tail == 1:
        end, goal, column = m - 1, proof_goal.last, 2
        a0, a1, a2 = scratch.z[end, 0], scratch.z[end, 1], scratch.z[end, 2]
        w0, w1, w2 = (
            scratch.p[end, 0] + form.foot * a0,
            scratch.p[end, 1] + form.foot * a1,
            scratch.p[end, 2] + form.foot * a2,
        )
    g0, g1, g2 = goal[0, 3], goal[1, 3], goal[2, 3]
    b0, b1, b2 = goal[0, column], goal[1, column], goal[2, column]
    behind, back = 0.0, proof_goal.back
    # Smallest distance of the point that lies back along the first column.
    if back != 0.0 and ceiling >= 0.0:
        e0, e1, e2 = w0 - back * a0, w1 - back * a1, w2 - back * a2
        d0, d1, d2 = g0 - back * b0, g1 - back * b1, g2 - back * b2
        if form.head == TURN:
            off = math.sqrt(e0 * e0 + e1 * e1) - math.sqrt(d0 * d0 + d1 * d1)
            behind = math.sqrt(off * off + (e2 - d2) * (e2 - d2))
        else:
            d2 = e2 if form.head == SLIDE else d2
            behind = math.sqrt((e0 - d0) * (e0 - d0) + (e1 - d1) * (e1 - d1) + (e2 - d2) * (e2 - d2))
        behind -= trust * motion(form, scratch, begin, end, e0, e1, e2) + margin
    rho = trust * motion(form, scratch, begin, end, w0, w1, w2) + margin
    if begin == 1:
        scratch.lever[0] = math.sqrt(w0 * w0 + w1 * w1) if form.head == TURN else 1.0
    sigma = 0.0
    if form.columns > 0:
        sigma = trust * turning(form, scratch, begin, end, a0, a1, a2) + margin_a
    if form.head == TURN:
        rw, rg = math.sqrt(w0 * w0 + w1 * w1), math.sqrt(g0 * g0 + g1 * g1)
        ra, rb = math.sqrt(a0 * a0 + a1 * a1), math.sqrt(b0 * b0 + b1 * b1)
        scratch.s[0] = ra  # For `widest`: the previous states of the box must not matter.
        far = math.sqrt((rw - rg) * (rw - rg) + (w2 - g2) * (w2 - g2))
        tilt = math.sqrt((ra - rb) * (ra - rb) + (a2 - b2) * (a2 - b2))
    else:
        d2 = w2 - g2
        if form.head == SLIDE:
            d2 = scratch.s[0] = 0.0
        far = math.sqrt((w0 - g0) * (w0 - g0) + (w1 - g1) * (w1 - g1) + d2 * d2)
        tilt = math.sqrt((a0 - b0) * (a0 - b0) + (a1 - b1) * (a1 - b1) + (a2 - b2) * (a2 - b2))
    if form.columns == 0:
        tilt = 0.0
    if ceiling < 0.0:
        rho += proof_goal.position
        if wide(form, proof_goal):
            sigma = lean_beyond(proof_goal, sigma)
        else:
            sigma += proof_goal.chord if form.columns < 3 else proof_goal.chord / math.sqrt(2.0)
        if far > rho or tilt > sigma:
            return False
    else:
        bound = least_error(proof_goal, far - rho, tilt - sigma, proof_goal.offset)
        if proof_goal.back != 0.0:
            bound = max(bound, least_error(proof_goal, behind, tilt - sigma, abs(proof_goal.back)))
        scratch.found[BELOW] = max(scratch.found[BELOW], bound)
        if bound > ceiling:
            return False
        largest = 2.0
        if proof_goal.weight_a > 0.0:
            largest = min(math.sqrt(2.0 * ceiling / proof_goal.weight_a), 2.0)
        rho += ceiling / proof_goal.weight_p + proof_goal.offset * largest
        sigma += largest
    if form.head == TURN:
        psi = arc(rw, w2, rg, g2, rho)
        if psi < 0.0 or not (
            psi >= math.pi or cut_arc(scratch, 0, math.atan2(g1, g0) - math.atan2(w1, w0), psi)
        ):
            return False
        if form.columns > 0:
            psi = arc(ra, a2, rb, b2, sigma)
            if psi < 0.0 or not (
                psi >= math.pi or cut_arc(scratch, 0, math.atan2(b1, b0) - math.atan2(a1, a0), psi)
            ):
                return False
    elif form.head == SLIDE:
        reach = math.sqrt(max(rho * rho - far * far, 0.0))
        low = max(scratch.c[0] - scratch.h[0], g2 - w2 - reach)
        high = min(scratch.c[0] + scratch.h[0], g2 - w2 + reach)
        if low > high:
            return False
        grown = rounding(scratch.c[0], scratch.h[0])
        scratch.c[0], scratch.h[0] = 0.5 * (low + high), 0.5 * (high - low) + grown
    return True
