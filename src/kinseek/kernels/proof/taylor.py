"""The error of the hand and its derivatives with respect to the joints, as seen from halfway along the arm.

Let f be the hand's point and columns minus the goal's. A joint with the axis z through the point o moves the point p by
``∂p = z x (p - o)`` and a column c by ``∂c = z x c``; a prismatic joint moves the point by z. To second order
``f(c + δ) = f + Σ J_k δ_k + ½ Σ H_kl δ_k δ_l + rest``, see `derivatives` for H and `kernels.proof.bounds` for the rest.

The norm of the error is the same in any frame. In a frame in the middle the distal joints move the hand, and the proximal
ones move the goal backwards. Every Taylor polynomial then has its remainder in two halves, each about eight times smaller
than the whole.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import (
    Vector,
    column,
    cross,
    dot,
    minus,
    norm,
    plus,
    row,
    scaled,
    write_column,
)
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .box import TINY, BoxScratch, Form, ProofGoal, radius

NOISE = 1e-14
"""Rounding error of a pivot that should be zero, relative to its diagonal element: some fifty last digits, for sums of
ten products and more. Twice the value changes only steps that are nearly noise."""

ABOVE = 1.0 + 1e-12
"""Factor by which the diagonal is raised further than requested, so that rounding never leaves less. Twice the excess
changes a step by a 1e-12th."""


class Rests(NamedTuple):
    """Upper bounds of the remainders of the Taylor polynomials of a box, by the terms that they leave out."""

    two_p: float
    """Of the point, after the first-order terms [m]."""
    two_c: float
    """Of the columns, after the first-order terms."""
    three_p: float
    """Of the point, after the second-order terms [m]."""
    three_c: float
    """Of the columns, after the second-order terms."""


@inlined
def halfway(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> int:
    """Index of the joint that divides the arm halfway.

    It and the distal joints move the hand, and the proximal ones the goal. It minimises the third-order remainders.
    """
    m = len(form.leader)
    counts = proof_goal.length if form.columns > 0 else 0.0
    hand, goal = column(scratch.T, 3), column(scratch.goal, 3)
    for k in range(m):
        scratch.radii[0, k] = radius(scratch, k, hand) + counts
        scratch.radii[1, k] = radius(scratch, k, goal) + counts
    least_rest, best = np.inf, 0
    # The sums are six times the remainders of `rests`.
    for middle in range(m):
        total_width = rest = 0.0
        for k in range(middle, m):
            if not form.prismatic[k]:
                h = scratch.half[k]
                rest += scratch.radii[0, k] * h * (h * h + 3.0 * total_width * (h + total_width))
                total_width += h
        total_width = 0.0
        for k in range(middle - 1, -1, -1):
            if not form.prismatic[k]:
                h = scratch.half[k]
                rest += scratch.radii[1, k] * h * (h * h + 3.0 * total_width * (h + total_width))
                total_width += h
        if rest < least_rest:
            least_rest, best = rest, middle
    return best


@inlined
def differentiate(form: Form, scratch: BoxScratch, middle: int, columns: int) -> None:
    """Compute the derivatives of the error as seen from halfway: joints before `middle` move the goal instead."""
    for k in range(len(form.leader)):
        seen = scratch.goal if k < middle else scratch.T
        axis, J = row(scratch.z, k), scratch.J[k]
        if form.prismatic[k]:
            write_column(axis, J, 3)
            scratch.r[k], scratch.s[k] = 1.0, 0.0
            for i in range(columns):
                write_column(Vector(0.0, 0.0, 0.0), J, i)
            continue
        velocity = cross(axis, minus(column(seen, 3), row(scratch.p, k)))
        write_column(velocity, J, 3)
        scratch.r[k] = norm(velocity)
        square = 0.0
        for i in range(columns):
            velocity = cross(axis, column(seen, i))
            write_column(velocity, J, i)
            square += dot(velocity, velocity)
        scratch.s[k] = math.sqrt(square)


@inlined
def radii_behind(form: Form, scratch: BoxScratch, middle: int, back: float) -> None:
    """Write the radii of the point that lies `back` [m] back along the first column."""
    for k in range(len(form.leader)):
        seen = scratch.goal if k < middle else scratch.T
        behind = minus(column(seen, 3), scaled(back, column(seen, 0)))
        scratch.back[k] = 1.0 if form.prismatic[k] else radius(scratch, k, behind)


@inlined
def rests(form: Form, scratch: BoxScratch, radii: Array, middle: int) -> Rests:
    """Remainders of the Taylor polynomials of degrees one and two.

    They are those of the hand from joint `middle` outwards, and of the goal from there back to the base. The radii are
    those of the point.
    """
    m, total_width, two_p, two_c, three_p, three_c = len(form.leader), 0.0, 0.0, 0.0, 0.0, 0.0
    for index in range(m):
        k = middle + index
        if k >= m:
            k = m - 1 - index
        # The proximal joints come last, in order from the middle to the base; their sum begins again at 0.
        if index == m - middle:
            total_width = 0.0
        h = scratch.half[k]
        if form.prismatic[k]:
            two_p += h * total_width
            three_p += 0.5 * h * total_width * total_width
            continue
        square = 0.5 * h * (h + 2.0 * total_width)
        # (S_k³ - S_{k-1}³)/6 with S_k = S_{k-1} + h, without cancellation.
        cube = h * (h * h + 3.0 * total_width * (h + total_width)) / 6.0
        two_p += square * radii[k]
        two_c += square * scratch.s[k]
        three_p += cube * radii[k]
        three_c += cube * scratch.s[k]
        total_width += h
    return Rests(two_p, two_c, three_p, three_c)


@inlined
def normal_matrix(form: Form, scratch: BoxScratch, weight_p: float, weight_c: float, columns: int) -> None:
    """Write ``JᵀWJ`` of the point and the columns into N, lower triangle."""
    m, dof, J = len(form.leader), len(scratch.c), scratch.J
    for i in range(dof):
        for j in range(dof):
            scratch.N[i, j] = 0.0
    for k in range(m):
        for l in range(k + 1):
            product_p = product_c = 0.0
            for r in range(3):
                product_p += J[k, r, 3] * J[l, r, 3]
                for i in range(columns):
                    product_c += J[k, r, i] * J[l, r, i]
            product = (weight_p * product_p + weight_c * product_c) * form.multiplier[k] * form.multiplier[l]
            i, j = form.leader[k], form.leader[l]
            scratch.N[max(i, j), min(i, j)] += product
            # Two joints that the same variable moves: the sum over all pairs has (k, l) and (l, k).
            if l != k and i == j:
                scratch.N[i, i] += product


@inlined
def step_miss(form: Form, scratch: BoxScratch, columns: int) -> None:
    """Write the error of the hand after the step in ``scratch.delta``, to first order, into ``scratch.y``."""
    y, J = scratch.y, scratch.J
    for r in range(3):
        y[r, 3] = scratch.T[r, 3] - scratch.goal[r, 3]
        for i in range(columns):
            y[r, i] = scratch.T[r, i] - scratch.goal[r, i]
    for k in range(len(form.leader)):
        step = form.multiplier[k] * scratch.delta[form.leader[k]]
        for r in range(3):
            y[r, 3] += step * J[k, r, 3]
            for i in range(columns):
                y[r, i] += step * J[k, r, i]


@inlined
def miss(scratch: BoxScratch, columns: int) -> tuple[float, float]:
    """Squared errors of the hand at the centre of the box: of its point [m²], and of its columns together."""
    T, goal, square_p, square_c = scratch.T, scratch.goal, 0.0, 0.0
    for r in range(3):
        square_p += (T[r, 3] - goal[r, 3]) * (T[r, 3] - goal[r, 3])
        for i in range(columns):
            square_c += (T[r, i] - goal[r, i]) * (T[r, i] - goal[r, i])
    return square_p, square_c


@inlined
def squares_of(y: Array, columns: int) -> tuple[float, float]:
    """Squared norms of the point and of the columns of a form or of an error, laid out as a pose, (3, 4)."""
    square_p = square_c = 0.0
    for r in range(3):
        square_p += y[r, 3] * y[r, 3]
        for i in range(columns):
            square_c += y[r, i] * y[r, i]
    return square_p, square_c


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
    y, J = scratch.y, scratch.J
    for i in range(len(out)):
        out[i] = 0.0
    for k in range(len(form.leader)):
        total = 0.0
        for r in range(3):
            total += J[k, r, 3] * y[r, 3]
            for i in range(columns):
                total += J[k, r, i] * y[r, i]
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
def shrink_miss(form: Form, scratch: BoxScratch, weight_p: float, weight_c: float, columns: int) -> None:
    """Write the step ``-(JᵀWJ + diag D)⁻¹ JᵀWf`` of weighted least squares into ``scratch.delta``."""
    normal_matrix(form, scratch, weight_p, weight_c, columns)
    downhill(form, scratch, weight_p, weight_c, columns)
    solve(scratch.N, scratch.D, scratch.delta)


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
    force = column(y, 3)
    for k in range(m):
        seen = scratch.goal if k < middle else scratch.T
        axis, a = row(scratch.z, k), form.leader[k]
        slope = dot(column(scratch.J[k], 3), force)
        if form.prismatic[k]:
            u = cross(axis, force)
        else:
            arm = minus(column(seen, 3), row(scratch.p, k))
            u, diagonal = scaled(dot(force, axis), arm), dot(arm, force)
            for i in range(columns):
                along = 0.0
                for r in range(3):
                    slope += y[r, i] * scratch.J[k, r, i]
                    along += y[r, i] * scratch.z[k, r]
                    diagonal += y[r, i] * seen[r, i]
                u = plus(u, scaled(along, column(seen, i)))
            u = minus(u, scaled(diagonal, axis))
        scratch.g[a] += form.multiplier[k] * slope
        begin, end, sign = (k, middle, -1.0) if k < middle else (middle, k + 1, 1.0)
        for l in range(begin, end):
            if form.prismatic[l]:
                continue
            b = form.leader[l]
            second = dot(row(scratch.z, l), u) * (sign * form.multiplier[k] * form.multiplier[l])
            scratch.H[a, b] += second
            if l != k:
                scratch.H[b, a] += second
