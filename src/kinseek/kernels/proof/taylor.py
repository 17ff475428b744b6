"""The error of the hand and its derivatives with respect to the joints, as seen from halfway along the arm.

The norm of the error is the same in any frame. In a frame in the middle the distal joints move the hand, and the proximal
ones move the goal backwards. Every Taylor polynomial then has its remainder in two halves, each about eight times smaller
than the whole.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .box import TINY, BoxScratch, Form, ProofGoal

NOISE = 1e-14
"""Rounding error of a pivot that should be zero, relative to its diagonal element: some fifty last digits, for sums of
ten products and more. Twice the value changes only steps that are nearly noise."""

ABOVE = 1.0 + 1e-12
"""Factor by which the diagonal is raised further than requested, so that rounding never leaves less. Twice the excess
changes a step by a 1e-12th."""


@inlined
def halfway(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> int:
    """Index of the joint that divides the arm halfway.

    It and the distal joints move the hand, and the proximal ones the goal. It minimises the third-order remainders.
    """
    m, T, goal = len(form.leader), scratch.T, scratch.goal
    counts = proof_goal.length if form.columns > 0 else 0.0
    for k in range(m):
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        v0, v1, v2 = T[0, 3] - scratch.p[k, 0], T[1, 3] - scratch.p[k, 1], T[2, 3] - scratch.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        scratch.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + counts
        v0, v1, v2 = goal[0, 3] - scratch.p[k, 0], goal[1, 3] - scratch.p[k, 1], goal[2, 3] - scratch.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        scratch.s[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2) + counts
    least_rest, best = np.inf, 0
    for middle in range(m):
        spread = rest = 0.0
        for k in range(middle, m):
            if not form.prismatic[k]:
                h = scratch.half[k]
                rest += scratch.r[k] * h * (h * h + 3.0 * spread * (h + spread))
                spread += h
        spread = 0.0
        for k in range(middle - 1, -1, -1):
            if not form.prismatic[k]:
                h = scratch.half[k]
                rest += scratch.s[k] * h * (h * h + 3.0 * spread * (h + spread))
                spread += h
        if rest < least_rest:
            least_rest, best = rest, middle
    return best


@inlined
def differentiate(form: Form, scratch: BoxScratch, middle: int, columns: int) -> None:
    """Compute the derivatives of the error as seen from halfway: joints before `middle` move the goal instead."""
    T, goal = scratch.T, scratch.goal
    for k in range(len(form.leader)):
        seen = goal if k < middle else T
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        if form.prismatic[k]:
            scratch.velocity[k, 0], scratch.velocity[k, 1], scratch.velocity[k, 2] = z0, z1, z2
            scratch.r[k], scratch.s[k] = 1.0, 0.0
            for i in range(columns):
                for r in range(3):
                    scratch.slopes[k, i, r] = 0.0
            continue
        v0, v1, v2 = seen[0, 3] - scratch.p[k, 0], seen[1, 3] - scratch.p[k, 1], seen[2, 3] - scratch.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        scratch.velocity[k, 0], scratch.velocity[k, 1], scratch.velocity[k, 2] = x0, x1, x2
        scratch.r[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)
        square = 0.0
        for i in range(columns):
            a0, a1, a2 = seen[0, i], seen[1, i], seen[2, i]
            x0, x1, x2 = z1 * a2 - z2 * a1, z2 * a0 - z0 * a2, z0 * a1 - z1 * a0
            scratch.slopes[k, i, 0], scratch.slopes[k, i, 1], scratch.slopes[k, i, 2] = x0, x1, x2
            square += x0 * x0 + x1 * x1 + x2 * x2
        scratch.s[k] = math.sqrt(square)


@inlined
def radii_behind(form: Form, scratch: BoxScratch, middle: int, back: float) -> None:
    """Write the radii of the point that lies `back` [m] back along the first column."""
    for k in range(len(form.leader)):
        if form.prismatic[k]:
            scratch.back[k] = 1.0
            continue
        seen = scratch.goal if k < middle else scratch.T
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        v0 = seen[0, 3] - back * seen[0, 0] - scratch.p[k, 0]
        v1 = seen[1, 3] - back * seen[1, 0] - scratch.p[k, 1]
        v2 = seen[2, 3] - back * seen[2, 0] - scratch.p[k, 2]
        x0, x1, x2 = z1 * v2 - z2 * v1, z2 * v0 - z0 * v2, z0 * v1 - z1 * v0
        scratch.back[k] = math.sqrt(x0 * x0 + x1 * x1 + x2 * x2)


@inlined
def rests(form: Form, scratch: BoxScratch, radii: Array, middle: int) -> tuple[float, float, float, float]:
    """Remainders of the Taylor polynomials of degrees one and two: of the point, the columns, the point, the columns.

    They are those of the hand from joint `middle` outwards, and of the goal from there back to the base. The radii are
    those of the point.
    """
    m, spread, two_p, two_c, three_p, three_c = len(form.leader), 0.0, 0.0, 0.0, 0.0, 0.0
    for index in range(m):
        k = middle + index
        if k >= m:
            k = m - 1 - index
        if index == m - middle:
            spread = 0.0
        h = scratch.half[k]
        if form.prismatic[k]:
            two_p += h * spread
            three_p += 0.5 * h * spread * spread
            continue
        square = 0.5 * h * (h + 2.0 * spread)
        cube = h * (h * h + 3.0 * spread * (h + spread)) / 6.0
        two_p += square * radii[k]
        two_c += square * scratch.s[k]
        three_p += cube * radii[k]
        three_c += cube * scratch.s[k]
        spread += h
    return two_p, two_c, three_p, three_c


@inlined
def normal_matrix(form: Form, scratch: BoxScratch, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``JᵀWJ`` of the point and the columns into N, lower triangle."""
    m, dof = len(form.leader), len(scratch.c)
    for i in range(dof):
        for j in range(dof):
            scratch.N[i, j] = 0.0
    for k in range(m):
        for l in range(k + 1):
            dot = turn = 0.0
            for r in range(3):
                dot += scratch.velocity[k, r] * scratch.velocity[l, r]
                for i in range(columns):
                    turn += scratch.slopes[k, i, r] * scratch.slopes[l, i, r]
            dot = (weight_p * dot + weight_c * turn) * form.multiplier[k] * form.multiplier[l]
            i, j = form.leader[k], form.leader[l]
            scratch.N[max(i, j), min(i, j)] += dot
            if l != k and i == j:
                scratch.N[i, i] += dot


@inlined
def step_miss(form: Form, scratch: BoxScratch, columns: int) -> None:
    """Write the error of the hand after the step in ``scratch.delta``, to first order, into ``scratch.y``."""
    for r in range(3):
        scratch.y[r, 3] = scratch.T[r, 3] - scratch.goal[r, 3]
        for i in range(columns):
            scratch.y[r, i] = scratch.T[r, i] - scratch.goal[r, i]
    for k in range(len(form.leader)):
        step = form.multiplier[k] * scratch.delta[form.leader[k]]
        for r in range(3):
            scratch.y[r, 3] += step * scratch.velocity[k, r]
            for i in range(columns):
                scratch.y[r, i] += step * scratch.slopes[k, i, r]


@inlined
def weight_miss(scratch: BoxScratch, weight_p: float, weight_c: float, columns: int) -> None:
    """Multiply point and columns of ``scratch.y`` by their weights."""
    for r in range(3):
        scratch.y[r, 3] *= weight_p
        for i in range(columns):
            scratch.y[r, i] *= weight_c


@inlined
def slope(form: Form, scratch: BoxScratch, columns: int, out: Array) -> None:
    """Write ``Jᵀ y`` of the form in ``scratch.y`` into `out`, (n,)."""
    for i in range(len(out)):
        out[i] = 0.0
    for k in range(len(form.leader)):
        total = 0.0
        for r in range(3):
            total += scratch.velocity[k, r] * scratch.y[r, 3]
            for i in range(columns):
                total += scratch.slopes[k, i, r] * scratch.y[r, i]
        out[form.leader[k]] += form.multiplier[k] * total


@inlined
def downhill(form: Form, scratch: BoxScratch, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``-JᵀWf`` for the error of the hand into ``scratch.delta``."""
    for i in range(len(scratch.delta)):
        scratch.delta[i] = 0.0
    step_miss(form, scratch, columns)
    weight_miss(scratch, -weight_p, -weight_c, columns)
    slope(form, scratch, columns, scratch.delta)


@inlined
def solve(N: Array, D: Array, x: Array) -> None:
    """Solve ``(N + diag D) x = b`` in place by LDLᵀ, with N given by its lower triangle.

    A pivot below rounding is noise of either sign. It is raised to the rounding level; otherwise a step along it would be
    unbounded.
    """
    dof = len(x)
    for j in range(dof):
        pivot = N[j, j] + D[j] * ABOVE
        noise = NOISE * pivot + TINY
        for k in range(j):
            pivot -= N[j, k] * N[j, k] * N[k, k]
        pivot = max(pivot, noise)
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


@inlined
def derivatives(form: Form, scratch: BoxScratch, middle: int, columns: int) -> None:
    """First and second derivatives of ``y·f`` with respect to the variables at the centre, as seen from halfway.

    For joints l ≤ k distal to `middle` ``∂²/∂q_l∂q_k = z_l·u_k``, with
    ``u_k = (Σ c y_cᵀ + v_k y_pᵀ) z_k - (Σ c·y_c + v_k·y_p) z_k`` and v_k from axis k to the point. Proximal to it the
    goal moves backwards: the same holds for the goal's point and columns, with a minus and k ≤ l. Mixed derivatives of
    one proximal and one distal joint are zero.
    """
    m, dof, y = len(form.leader), len(scratch.c), scratch.y
    for i in range(dof):
        scratch.g[i] = 0.0
        for j in range(dof):
            scratch.H[i, j] = 0.0
    y0, y1, y2 = y[0, 3], y[1, 3], y[2, 3]
    for k in range(m):
        seen = scratch.goal if k < middle else scratch.T
        z0, z1, z2 = scratch.z[k, 0], scratch.z[k, 1], scratch.z[k, 2]
        a = form.leader[k]
        slope = scratch.velocity[k, 0] * y0 + scratch.velocity[k, 1] * y1 + scratch.velocity[k, 2] * y2
        if form.prismatic[k]:
            u0, u1, u2 = z1 * y2 - z2 * y1, z2 * y0 - z0 * y2, z0 * y1 - z1 * y0
        else:
            v0, v1, v2 = (
                seen[0, 3] - scratch.p[k, 0],
                seen[1, 3] - scratch.p[k, 1],
                seen[2, 3] - scratch.p[k, 2],
            )
            force, diagonal = y0 * z0 + y1 * z1 + y2 * z2, v0 * y0 + v1 * y1 + v2 * y2
            u0, u1, u2 = force * v0, force * v1, force * v2
            for i in range(columns):
                c = 0.0
                for r in range(3):
                    slope += y[r, i] * scratch.slopes[k, i, r]
                    c += y[r, i] * scratch.z[k, r]
                    diagonal += y[r, i] * seen[r, i]
                u0 += c * seen[0, i]
                u1 += c * seen[1, i]
                u2 += c * seen[2, i]
            u0, u1, u2 = u0 - diagonal * z0, u1 - diagonal * z1, u2 - diagonal * z2
        scratch.g[a] += form.multiplier[k] * slope
        begin, end, sign = (k, middle, -1.0) if k < middle else (middle, k + 1, 1.0)
        for l in range(begin, end):
            if form.prismatic[l]:
                continue
            second = scratch.z[l, 0] * u0 + scratch.z[l, 1] * u1 + scratch.z[l, 2] * u2
            second *= sign * form.multiplier[k] * form.multiplier[l]
            b = form.leader[l]
            scratch.H[a, b] += second
            if l != k:
                scratch.H[b, a] += second
