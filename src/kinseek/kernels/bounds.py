"""What no joint vector of a box can do: bounds on the hand's motion, and the tests that they allow.

A box is a centre c and half widths h of the joint variables. Write the arm as a product of exponentials about its centre:
``T(q) = E_1 E_2 … E_m T(c)``, where E_k turns by δ_k about the axis that joint k has *at the centre* (Brockett 1984).
Going from c to q one joint at a time, base first, every joint that still moves finds the joints after it at the centre.
So all bounds need the radii ``r_k = |z_k x (p - p_k)|`` at the centre alone:

- *first order*: a point moves by at most ``Σ r_k 2 sin(h_k/2)``, a direction likewise with ``s_k = |z_k x a|`` for r_k;
- *third order*: the Taylor polynomial of degree two is off by at most ``Σ r_k ((S_k)³ - (S_{k-1})³)/6``, with
  ``S_k = h_1 + … + h_k`` over the joints that turn. (Of ``E_1 … E_{k-1} v_k(δ_k)`` keep the terms up to degree two; what
  is left over is at most ``r_k (h³/6 + S h²/2 + S² h/2)``. A slide adds ``h S²/2``.)

Every test compares with the goal and adds a margin for rounding: `Wanted.margin`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .arrays import Array, Flags, Indices
from .atlas import SLIDE, TURN
from .forward import advance, identity
from .jit import inner, kernel

TINY = 1e-300
LEAST = 1e-15
"""No half width is ever smaller [rad] or [m]."""


class Form(NamedTuple):
    """The part of the arm that the boxes are about."""

    fixed: Array
    """``A_1 … A_m, A_tip``, (m+1, 3, 4); where the first joint is divided out A_1 is the identity."""
    prismatic: Flags
    """(m,)"""
    leader: Indices
    """(m,)"""
    multiplier: Array
    """(m,)"""
    offset: Array
    """(m,)"""
    head: int
    """The first joint: NONE, TURN or SLIDE are divided out by comparing azimuths or heights."""
    columns: int
    """How many columns of the hand count: 0 none, 1 the x axis, 2 x and y (the paper's error), 3 all."""
    tail: int
    """1 where the last joint, a turn, is part of the chain and can be divided out of first-order tests."""
    foot: float
    """Point on the last axis that these compare, as a distance along it from the joint's origin [m]."""


class Wanted(NamedTuple):
    """What is asked of the hand."""

    target: Array
    """(3, 4), seen from the first joint's frame where that is divided out."""
    last: Array
    """Pose of the last joint's frame at zero that the target asks for, (3, 4), if `Form.tail`."""
    scalars: Array
    """Of the module's constants `POSITION` and following, (9,)."""


# Scalars of `Wanted`.
POSITION = 0  # Tolerance of the point [m].
CHORD = 1  # Tolerance of the columns together, as a Frobenius norm.
MARGIN = 2  # Margin for rounding [m].
TRUST = 3  # 1; tests shrink all bounds by it, and must notice.
WEIGHT_P = 4  # K_P.
WEIGHT_A = 5  # K_A.
OFFSET = 6  # Distance of the tip from the last axis' point [m].
LENGTH = 7  # Length that an angle of one radian counts as when splitting [m].
MARGIN_A = 8  # Margin for rounding of directions.
SCALARS = 9


class Desk(NamedTuple):
    """Memory of one search."""

    T: Array
    """(3, 4)"""
    z: Array
    """Axes at the centre, (m, 3)."""
    p: Array
    """Points on them, (m, 3)."""
    velocity: Array
    """Of the point, by each joint, (m, 3)."""
    along: Array
    """Components of the axes along the columns, (m, 3)."""
    half: Array
    """Half width of each physical joint, (m,)."""
    chord: Array
    """2 sin(h/2) of each physical joint; of a slide h, (m,)."""
    r: Array
    """(m,)"""
    s: Array
    """(m,)"""
    goal: Array
    """The target turned back by the first joint, (3, 4)."""
    c: Array
    """Centre of the box, (n,)."""
    h: Array
    """Its half widths, (n,)."""
    N: Array
    """Normal matrix, (n, n)."""
    H: Array
    """Second derivatives of the form, (n, n)."""
    g: Array
    """First derivatives, (n,)."""
    delta: Array
    """(n,)"""
    D: Array
    """Weights of the box in the normal matrix, (n,)."""
    v: Array
    """(n,)"""
    y: Array
    """The form: columns x, y, z, p as in a pose, (3, 4)."""
    u: Array
    """(3,)"""
    out: Array
    """Error at the centre of the box; lower bound; (2,)."""


@kernel
def make_desk(joints: int, dof: int) -> Desk:
    """Allocate the memory of one search."""
    return Desk(
        np.zeros((3, 4)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3)),
        np.zeros((joints, 3)),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros(joints),
        np.zeros((3, 4)),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((dof, dof)),
        np.zeros((dof, dof)),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((3, 4)),
        np.zeros(3),
        np.zeros(2),
    )


@inner
def place(form: Form, desk: Desk) -> None:
    """Axes and hand at the centre of the box, seen from the frame that the first joint moves where it is divided out."""
    T, m = desk.T, len(form.leader)
    identity(T)
    begin = 0
    if form.head != 0:
        for i in range(3):
            desk.z[0, i], desk.p[0, i] = 0.0, 0.0
        desk.z[0, 2] = 1.0
        begin = 1
    for k in range(begin, m):
        advance(form.fixed[k], True, 0.0, T)
        for i in range(3):
            desk.z[k, i], desk.p[k, i] = T[i, 2], T[i, 3]
        value = form.multiplier[k] * desk.c[form.leader[k]] + form.offset[k]
        if form.prismatic[k]:
            for i in range(3):
                T[i, 3] += value * T[i, 2]
        else:
            cosine, sine = math.cos(value), math.sin(value)
            for i in range(3):
                x, y = T[i, 0], T[i, 1]
                T[i, 0] = x * cosine + y * sine
                T[i, 1] = y * cosine - x * sine
    advance(form.fixed[m], True, 0.0, T)


@inner
def chord_of(angle: float) -> float:
    """An upper bound of 2 sin(angle/2) for angle ≥ 0, and 2 beyond π: its Taylor polynomial ends on a positive term."""
    if angle > 3.0:
        return 2.0
    square = angle * angle
    return min(angle * (1.0 - square * (1.0 / 24.0 - square / 1920.0)), 2.0)


@inner
def widths(form: Form, desk: Desk) -> None:
    """Half widths and chords of the physical joints."""
    for k in range(len(form.leader)):
        desk.half[k] = abs(form.multiplier[k]) * desk.h[form.leader[k]]
        desk.chord[k] = desk.half[k] if form.prismatic[k] else chord_of(desk.half[k])


@inner
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
    return 2.0 * math.asin(math.sqrt(left / full)) + 1e-12


@inner
def cut_arc(desk: Desk, middle: float, psi: float) -> bool:
    """Cut the first joint's range to the arc middle ± psi [rad]; say whether anything is left."""
    if psi >= math.pi:
        return True
    c, h = desk.c[0], desk.h[0]
    turn = 2.0 * math.pi
    off = middle - c
    off -= turn * math.floor(off / turn + 0.5)
    if abs(off) > h + psi:
        return False
    if (
        abs(off) > turn - h - psi
    ):  # Two pieces. A full turn becomes the arc; limits stay until the arc is smaller.
        if h > 3.14159:
            desk.c[0], desk.h[0] = c + off, psi
        return True
    low, high = max(-h, off - psi), min(h, off + psi)
    desk.c[0], desk.h[0] = c + 0.5 * (low + high), max(0.5 * (high - low), 0.0) + LEAST
    return True


@inner
def turn_goal(form: Form, wanted: Wanted, desk: Desk) -> None:
    """The target as the frame after the first joint sees it, with that joint at the centre of its range."""
    goal, target = desk.goal, wanted.target
    if form.head == TURN:
        cosine, sine = math.cos(desk.c[0]), math.sin(desk.c[0])
        for i in range(4):
            x, y = target[0, i], target[1, i]
            goal[0, i] = cosine * x + sine * y
            goal[1, i] = cosine * y - sine * x
            goal[2, i] = target[2, i]
        return
    for r in range(3):
        for i in range(4):
            goal[r, i] = target[r, i]
    if form.head == SLIDE:
        goal[2, 3] -= desk.c[0]


@inner
def motion(form: Form, desk: Desk, begin: int, end: int, wx: float, wy: float, wz: float) -> float:
    """Largest motion of the point w by joints begin … end-1 within the box [m]; leaves their radii in the desk."""
    total = 0.0
    for k in range(begin, end):
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        if form.prismatic[k]:
            desk.velocity[k, 0], desk.velocity[k, 1], desk.velocity[k, 2] = z0, z1, z2
            desk.r[k] = 1.0
        else:
            v0, v1, v2 = wx - desk.p[k, 0], wy - desk.p[k, 1], wz - desk.p[k, 2]
            x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
            desk.velocity[k, 0], desk.velocity[k, 1], desk.velocity[k, 2] = x0, x1, x2
            desk.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        total += desk.r[k] * desk.chord[k]
    return total


@inner
def turning(form: Form, desk: Desk, begin: int, end: int, ax: float, ay: float, az: float) -> float:
    """Largest motion of the unit vector a by joints begin … end-1 within the box; leaves the sines in the desk."""
    total = 0.0
    for k in range(begin, end):
        if form.prismatic[k]:
            desk.s[k] = 0.0
            continue
        z0, z1, z2 = desk.z[k, 0], desk.z[k, 1], desk.z[k, 2]
        x0, x1, x2 = z1 * az - z2 * ay, z2 * ax - z0 * az, z0 * ay - z1 * ax
        desk.s[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        total += desk.s[k] * desk.chord[k]
    return total


@inner
def least_error(wanted: Wanted, far: float, tilt: float) -> float:
    """Least weighted error with the last axis' point `far` away [m] and the last axis off by a chord of `tilt`.

    With σ = 2 sin(φ/2) ≥ tilt of the hand's whole turn φ the tip is no nearer than far - σ·OFFSET, and the paper's
    error of the orientation is at least K_A (1 - cos φ) = K_A σ²/2.
    """
    K_P, K_A, b = wanted.scalars[WEIGHT_P], wanted.scalars[WEIGHT_A], wanted.scalars[OFFSET]
    far, sigma = max(far, 0.0), max(tilt, 0.0)
    if K_A > 0.0 and b > 0.0:
        sigma = min(max(sigma, min(K_P * b / K_A, far / b)), 2.0)
    error: float = K_P * max(far - b * sigma, 0.0) + 0.5 * K_A * sigma * sigma
    return error


@inner
def first_order(form: Form, wanted: Wanted, desk: Desk, ceiling: float) -> bool:
    """Compare azimuth, radius, height and last axis with the goal's; say whether anything of the box is left.

    With `ceiling` negative the tolerances decide, else the weighted error: what cannot stay below `ceiling` is gone. The
    first joint's range is cut to what the azimuths leave. ``desk.out[1]`` becomes a lower bound of the weighted error.
    """
    T, m = desk.T, len(form.leader)
    trust, margin, margin_a = wanted.scalars[TRUST], wanted.scalars[MARGIN], wanted.scalars[MARGIN_A]
    begin = 1 if form.head != 0 else 0
    end = m
    w0, w1, w2, a0, a1, a2 = T[0, 3], T[1, 3], T[2, 3], T[0, 0], T[1, 0], T[2, 0]
    goal = wanted.target
    column = 0
    if form.tail == 1:
        end, goal, column = m - 1, wanted.last, 2
        a0, a1, a2 = desk.z[end, 0], desk.z[end, 1], desk.z[end, 2]
        w0, w1, w2 = (
            desk.p[end, 0] + form.foot * a0,
            desk.p[end, 1] + form.foot * a1,
            desk.p[end, 2] + form.foot * a2,
        )
    rho = trust * motion(form, desk, begin, end, w0, w1, w2) + margin
    sigma = 0.0
    if form.columns > 0:
        sigma = trust * turning(form, desk, begin, end, a0, a1, a2) + margin_a
    g0, g1, g2 = goal[0, 3], goal[1, 3], goal[2, 3]
    b0, b1, b2 = goal[0, column], goal[1, column], goal[2, column]
    if form.head == TURN:
        rw, rg = math.sqrt(w0 * w0 + w1 * w1), math.sqrt(g0 * g0 + g1 * g1)
        ra, rb = math.sqrt(a0 * a0 + a1 * a1), math.sqrt(b0 * b0 + b1 * b1)
        far = math.sqrt((rw - rg) * (rw - rg) + (w2 - g2) * (w2 - g2))
        tilt = math.sqrt((ra - rb) * (ra - rb) + (a2 - b2) * (a2 - b2))
    else:
        d2 = 0.0 if form.head == SLIDE else w2 - g2
        far = math.sqrt((w0 - g0) * (w0 - g0) + (w1 - g1) * (w1 - g1) + d2 * d2)
        tilt = math.sqrt((a0 - b0) * (a0 - b0) + (a1 - b1) * (a1 - b1) + (a2 - b2) * (a2 - b2))
    if form.columns == 0:
        tilt = 0.0
    if ceiling < 0.0:
        rho += wanted.scalars[POSITION]
        sigma += wanted.scalars[CHORD] if form.columns < 3 else wanted.scalars[CHORD] / math.sqrt(2.0)
        if far > rho or tilt > sigma:
            return False
    else:
        bound = least_error(wanted, far - rho, tilt - sigma)
        desk.out[1] = max(desk.out[1], bound)
        if bound > ceiling:
            return False
        largest = 2.0
        if wanted.scalars[WEIGHT_A] > 0.0:
            largest = min(math.sqrt(2.0 * ceiling / wanted.scalars[WEIGHT_A]), 2.0)
        rho += ceiling / wanted.scalars[WEIGHT_P] + wanted.scalars[OFFSET] * largest
        sigma += largest
    if form.head == TURN:
        psi = arc(rw, w2, rg, g2, rho)
        if psi < 0.0 or not (psi >= math.pi or cut_arc(desk, math.atan2(g1, g0) - math.atan2(w1, w0), psi)):
            return False
        if form.columns > 0:
            psi = arc(ra, a2, rb, b2, sigma)
            if psi < 0.0 or not (
                psi >= math.pi or cut_arc(desk, math.atan2(b1, b0) - math.atan2(a1, a0), psi)
            ):
                return False
    elif form.head == SLIDE:
        reach = math.sqrt(max(rho * rho - far * far, 0.0))
        low = max(desk.c[0] - desk.h[0], g2 - w2 - reach)
        high = min(desk.c[0] + desk.h[0], g2 - w2 + reach)
        if low > high:
            return False
        desk.c[0], desk.h[0] = 0.5 * (low + high), 0.5 * (high - low) + LEAST
    return True


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
