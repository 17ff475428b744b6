"""What no joint vector of a box can do: bounds on the hand's motion, and the tests that they allow.

A box is a centre c and half widths h of the joint variables. Write the arm as a product of exponentials about its centre:
``T(q) = E_1 E_2 … E_m T(c)``, where E_k turns by δ_k about the axis that joint k has *at the centre* (Brockett 1984).
Going from c to q one joint at a time, base first, every joint that still moves finds the joints after it at the centre.
So all bounds need the radii ``r_k = |z_k x (p - p_k)|`` at the centre alone:

- *first order*: a point moves by at most ``Σ r_k 2 sin(h_k/2)``, a direction likewise with ``s_k = |z_k x a|`` for r_k;
- *third order* (`kernels.proof.form`): the Taylor polynomial of degree two is off by at most
  ``Σ r_k ((S_k)³ - (S_{k-1})³)/6``, with ``S_k = h_1 + … + h_k`` over the joints that turn. (Of
  ``E_1 … E_{k-1} v_k(δ_k)`` keep the terms up to degree two; what is left over is at most
  ``r_k (h³/6 + S h²/2 + S² h/2)``. A slide adds ``h S²/2``.)

Every test compares with the goal and adds a margin for rounding: `ProofGoal.margin`.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import SLIDE, TURN
from kinseek.kernels.jit import inlined

from .box import BELOW, BoxScratch, Form, ProofGoal, motion, rounding, short_way, turning

OF_ANGLES = 64.0 * 2.0**-53
"""Margin for rounding of the angles that arc functions give [rad]. Two angles within π are off by 16 unit roundoffs each,
and their difference by 4; an arc sine is off by 8, taken twice: 52 in all, where these functions are good to four units in
the last place. What rounding does to their arguments is covered by `ProofGoal.margin`."""

FULL_TURN = 3.14159
"""Half width that counts as a whole turn [rad]: limits are often written with so many digits. A box that becomes an arc may
reach past its limits by what is lacking to π, 2.7e-6 rad; that lets more in, and loses nothing. Half of it would do so to
every joint of more than 180°, which then has no limits."""


WIDE = 0.3
"""Half angle [rad] from which on a cone of directions is looked at by its edge, and compared by angles: below it a ball is
hardly larger than the cone. It decides what is tried, not what is proved."""


@inlined
def arc(rc: float, zc: float, rg: float, zg: float, rho: float) -> float:
    """How far a turn about z may miss, [rad], to bring a point at radius rc, height zc within `rho` of one at rg, zg.

    Negative where no turn does. By the law of cosines ``4 rc rg sin²(ψ/2) = rho² - (rc - rg)² - (zc - zg)²``.
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
    """Cut the range of variable i, which turns one joint, to the arc middle ± psi [rad]; say whether anything is left."""
    if psi >= math.pi:
        return True
    c, h = scratch.c[i], scratch.h[i]
    psi += 4.0 * rounding(c, h)
    off = short_way(middle - c)
    if abs(off) > h + psi:
        return False
    # Two pieces are left. A full turn becomes the arc; limits stay until the arc is smaller.
    if abs(off) > 2.0 * math.pi - h - psi:
        if h > FULL_TURN:
            scratch.c[i], scratch.h[i] = c + off, psi
        return True
    low, high = max(-h, off - psi), min(h, off + psi)
    scratch.c[i], scratch.h[i] = c + 0.5 * (low + high), max(0.5 * (high - low), 0.0) + rounding(c, h)
    return True


@inlined
def least_error(proof_goal: ProofGoal, far: float, tilt: float, b: float) -> float:
    """Least weighted error with a point b [m] from the tip `far` away [m] and the last axis off by a chord of `tilt`.

    With σ = 2 sin(φ/2) ≥ tilt of the hand's whole turn φ the tip is no nearer than far - σ b, and the paper's
    error of the orientation is at least K_A (1 - cos φ) = K_A σ²/2.
    """
    K_P, K_A = proof_goal.weight_p, proof_goal.weight_a
    far, sigma = max(far, 0.0), max(tilt, 0.0)
    if K_A > 0.0 and b > 0.0:
        sigma = min(max(sigma, min(K_P * b / K_A, far / b)), 2.0)
    error: float = K_P * max(far - b * sigma, 0.0) + 0.5 * K_A * sigma * sigma
    return error


@inlined
def wide(form: Form, proof_goal: ProofGoal) -> bool:
    """Do the tolerances let the hand's one axis that counts lie in a wide cone about the goal's?"""
    return form.columns == 1 and proof_goal.angle > WIDE


@inlined
def lean_beyond(proof_goal: ProofGoal, turn: float) -> float:
    """How far an axis that a box turns by a chord of `turn` may be from the goal's at its centre, as a chord.

    Angles add up, chords do not: with a wide cone they add up to much less.
    """
    angle = proof_goal.angle + proof_goal.margin_a + 2.0 * math.asin(min(0.5 * turn, 1.0))
    return 2.0 * math.sin(0.5 * min(angle, math.pi)) + proof_goal.margin_a


@inlined
def first_order(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> bool:
    """Compare azimuth, radius, height and last axis with the goal's; say whether anything of the box is left.

    With `ceiling` negative the tolerances decide, else the weighted error: what cannot stay below `ceiling` is gone. The
    first joint's range is cut to what the azimuths leave. ``scratch.found[BELOW]`` becomes a lower bound of the error.
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
    if back != 0.0 and ceiling >= 0.0:  # How far away the point that lies back along the first column stays.
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
        scratch.s[0] = ra  # For `widest`: what became of the box before must not matter.
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
