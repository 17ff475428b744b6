"""A fast motion along a curve whose joint speeds, accelerations and jerks stay inside limits, at every point.

The squared speed x is a quadratic spline: on an interval of width h it has the Bernstein coefficients X0, X1, X2, and the
acceleration ``u = x'/2`` those ``(X1 - X0)/h`` and ``(X2 - X1)/h``. The unknowns are the inner coefficients X1, named c;
X0 and X2 follow, as x and u are continuous. The jerk of a joint is ``(q''' x + 3 q'' u + q' u') √x``. As ``1/√x`` is
convex, it lies above its tangent at any M: the limit of the jerk holds where ::

    |q''' x + 3 q'' u + q' u'| <= jerk (3 - x/M) / (2 √M)

This is linear in x, and exact at x = M (*Debrouwere et al. 2013*: a convex part of a set that is not convex).
Its Bernstein coefficients bound it between the knots, as in `fastest`.

The duration ``Σ h/√c`` is minimised under these linear constraints by a barrier method (*Boyd, Vandenberghe 2004, chapter
11*): Newton's method minimises the duration less μ times the logarithms of all slacks, while μ decreases. Every constraint
contains at most three neighbouring unknowns, so that the Hessian has five diagonals. M follows x.

At rest u' is infinite in s. On the first interval the jerk of the motion is constant in time instead: ``x = X (σ/h)^(4/3)``
with the value X at its end, there ``u = 2 X / 3h``, and the jerk is ``2 X^(3/2) / 9h²``. The last one is its mirror image.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .fastest import squared_rate

SPEED, BENDING, JERK = 4, 4, 3
"""Constraints of an interval: coefficients of the squared speed, and for each joint of its acceleration and jerk."""

AHEAD = 0.9
"""Share of the way to the nearest constraint that a step takes at most."""

SHRINK = 0.1
"""Factor of μ from one minimum to the next."""

CENTRED = 100.0
"""Squared Newton decrement, relative to μ, below which μ decreases; the path of minima is followed loosely."""

MOST_STEPS = 100
"""Largest number of Newton's steps."""

MOST_HALVINGS = 200
"""Largest number of times that the first guess is slowed down."""

TINY = 1e-300
"""Prevents division by zero."""


class Neighbours(NamedTuple):
    """The outer coefficients of x, ``X0 = a c[i-1] + b c[i]`` and ``X2 = e c[i] + f c[i+1]``, (k,) each."""

    a: Array
    b: Array
    e: Array
    f: Array


class Lanes(NamedTuple):
    """Numbers of eight neighbouring intervals, the last axis."""

    X: Array
    """Coefficients of x, (3, w)."""
    D: Array
    """Their change in a step, (3, w)."""
    sums: Array
    """Gradient with respect to X, 3 rows, and the upper triangle of the Hessian, by rows, 6 rows, (9, w)."""
    least: Array
    """Smallest slack, or the largest share of a slack that D uses up, (w,)."""
    bound: Array
    """Rooms of constraints at x = 0, for others and for jerks, (2, w)."""
    slope: Array
    """How they shrink with x, (2, w)."""


@inlined
def write_neighbours(widths: Array, near: Neighbours) -> None:
    """Write how x depends on the unknowns, for the widths of all intervals, (k + 2,), or fewer than there are rows."""
    last = len(widths) - 3
    for i in range(last + 1):
        before, h, after = widths[i], widths[i + 1], widths[i + 2]
        near.a[i], near.b[i] = h / (before + h), before / (before + h)
        near.e[i], near.f[i] = after / (h + after), h / (h + after)
    # Beside the intervals at rest, u = 2 X / 3h of these and X1 = X + h u give X.
    near.a[0], near.b[0] = 0.0, 1.0 / (1.0 + 2.0 * widths[1] / (3.0 * widths[0]))
    near.e[last], near.f[last] = 1.0 / (1.0 + 2.0 * widths[last + 1] / (3.0 * widths[last + 2])), 0.0


@inlined
def write_constraints(rates: Array, h: float, limits: Array, tool: Array, rows: Array) -> None:
    """Write the coefficients of X0, X1 and X2 in the constraints of an interval, in units of the limits.

    Args:
        rates: Bernstein coefficients of q' on the interval, (n, 3).
        h: Its width.
        limits: Velocities, accelerations and jerks, (3, n).
        tool: Upper bound of the squared speed of the tool, divided by x and by the squared limit, at its ends, (2,).
        rows: Receives the coefficients, (SPEED + (BENDING + JERK) n, 3); they are 0 before.
    """
    begin, end, at = tool[0], tool[1], SPEED
    for j in range(len(rates)):
        d0, d1, d2 = rates[j, 0], rates[j, 1], rates[j, 2]
        square = squared_rate(d0, d1, d2)
        weight = 1.0 / (limits[0, j] * limits[0, j])
        begin, end = max(begin, weight * square.begin), max(end, weight * square.end)
        # q'' x + q' u, of degree 3; the coefficients of q'' are e0 and e1.
        w = 1.0 / limits[1, j]
        e0, e1, g0, g1, g2 = (
            2.0 * w * (d1 - d0) / h,
            2.0 * w * (d2 - d1) / h,
            w * d0 / h,
            w * d1 / h,
            w * d2 / h,
        )
        rows[at, 0], rows[at, 1] = e0 - g0, g0
        rows[at + 1, 0], rows[at + 1, 1] = (e1 - 2.0 * g1) / 3.0, (2.0 * e0 - g0 + 2.0 * g1) / 3.0
        rows[at + 1, 2] = g0 / 3.0
        rows[at + 2, 0], rows[at + 2, 1] = -g2 / 3.0, (2.0 * e1 - 2.0 * g1 + g2) / 3.0
        rows[at + 2, 2] = (e0 + 2.0 * g1) / 3.0
        rows[at + 3, 1], rows[at + 3, 2] = -g2, e1 + g2
        at += BENDING
        # q''' x + 3 q'' u + q' u', of degree 2; the coefficients of 3 q'' are h e0 and h e1.
        w = 1.0 / (limits[2, j] * h * h)
        e0, e1 = 6.0 * w * (d1 - d0), 6.0 * w * (d2 - d1)
        for k in range(JERK):
            turn = w * rates[j, k]
            rows[at + k, 0], rows[at + k, 1], rows[at + k, 2] = turn, -2.0 * turn, turn
            rows[at + k, k] += (e1 - e0) / 3.0
        rows[at, 0], rows[at, 1] = rows[at, 0] - e0, rows[at, 1] + e0
        rows[at + 1, 0], rows[at + 1, 2] = rows[at + 1, 0] - 0.5 * e1, rows[at + 1, 2] + 0.5 * e0
        rows[at + 1, 1] += 0.5 * (e1 - e0)
        rows[at + 2, 1], rows[at + 2, 2] = rows[at + 2, 1] - e1, rows[at + 2, 2] + e1
        at += JERK
    # The squared rate times x, of degree 3.
    rows[0, 0] = begin
    rows[1, 0], rows[1, 1] = end / 3.0, 2.0 * begin / 3.0
    rows[2, 1], rows[2, 2] = 2.0 * end / 3.0, begin / 3.0
    rows[3, 2] = end


@inlined
def largest_at_rest(rates: Array, h: float, limits: Array, tool: Array) -> float:
    """Return the largest X at the end of an interval that begins, or ends, at rest; arguments as `write_constraints`."""
    most: float = 1.0 / max(tool[0], tool[1], TINY)
    for j in range(len(rates)):
        d0, d1, d2 = rates[j, 0], rates[j, 1], rates[j, 2]
        rate = max(abs(d0), abs(d1), abs(d2), TINY)
        bend = 2.0 * max(abs(d1 - d0), abs(d2 - d1)) / h
        third = 2.0 * abs(d2 - 2.0 * d1 + d0) / (h * h)
        jerk = third + 2.0 * bend / h + 2.0 * rate / (9.0 * h * h)
        most = min(most, (limits[0, j] / rate) ** 2, limits[1, j] / (bend + 2.0 * rate / (3.0 * h)))
        most = min(most, float((limits[2, j] / jerk) ** (2.0 / 3.0)))
    return most


class Room(NamedTuple):
    """The room of a constraint, ``bound - slope X[k]``, where k is the number of the coefficient of a jerk."""

    jerk: int
    """1 for a jerk, otherwise 0: a row of `Lanes.bound` and `Lanes.slope`."""
    e0: float
    e1: float
    e2: float
    """1 for the coefficient k, otherwise 0."""


@inlined
def room_of(k: int) -> Room:
    """Return the room of the constraint k."""
    number = (k - SPEED) % (BENDING + JERK) - BENDING if k >= SPEED else -1
    return Room(
        1 if number >= 0 else 0,
        1.0 if number == 0 else 0.0,
        1.0 if number == 1 else 0.0,
        1.0 if number == 2 else 0.0,
    )


@inlined
def tangents(M: Array, lanes: Lanes) -> None:
    """Write the bounds and slopes of the rooms for some M, (w,)."""
    for l in range(len(M)):
        lanes.bound[0, l], lanes.slope[0, l] = 1.0, 0.0
        lanes.bound[1, l] = 1.5 / math.sqrt(M[l])
        lanes.slope[1, l] = lanes.bound[1, l] / (3.0 * M[l])


@inlined
def fill(c: Array, first: int, near: Neighbours, X: Array, w: int) -> None:
    """Write the coefficients of x, or of a change of it, on the intervals from `first` on, (3, w)."""
    for l in range(w):
        i = first + l
        X[0, l] = near.a[i] * c[i] + near.b[i] * c[i + 1]
        X[1, l] = c[i + 1]
        X[2, l] = near.e[i] * c[i + 1] + near.f[i] * c[i + 2]


@inlined
def add_logarithms(rows: Array, mu: float, lanes: Lanes, w: int) -> None:
    """Write the derivatives of -μ times the logarithms of all slacks, and the smallest slacks.

    Args:
        rows: The constraints, as `write_constraints` writes them, (r, 3, w).
        mu: μ.
        lanes: Holds X, and receives the sums and the smallest slacks.
        w: `LANES`.
    """
    X, sums, least = lanes.X, lanes.sums, lanes.least
    sums[:] = 0.0
    least[:] = np.inf
    for k in range(len(rows)):
        jerk, e0, e1, e2 = room_of(k)
        for l in range(w):
            r0, r1, r2, slope = rows[k, 0, l], rows[k, 1, l], rows[k, 2, l], lanes.slope[jerk, l]
            k0, k1, k2 = slope * e0, slope * e1, slope * e2
            y = r0 * X[0, l] + r1 * X[1, l] + r2 * X[2, l]
            room = lanes.bound[jerk, l] - k0 * X[0, l] - k1 * X[1, l] - k2 * X[2, l]
            least[l] = min(least[l], room - abs(y))
            # The slacks room - y and room + y.
            inverse = 1.0 / ((room - y) * (room + y))
            above, below = (room + y) * inverse, (room - y) * inverse
            pull, push = mu * (above - below), mu * (above + below)
            curve, twist = mu * (above * above + below * below), pull * (above + below)
            sums[0, l] += pull * r0 + push * k0
            sums[1, l] += pull * r1 + push * k1
            sums[2, l] += pull * r2 + push * k2
            sums[3, l] += curve * (r0 * r0 + k0 * k0) + 2.0 * twist * r0 * k0
            sums[4, l] += curve * (r0 * r1 + k0 * k1) + twist * (r0 * k1 + k0 * r1)
            sums[5, l] += curve * (r0 * r2 + k0 * k2) + twist * (r0 * k2 + k0 * r2)
            sums[6, l] += curve * (r1 * r1 + k1 * k1) + 2.0 * twist * r1 * k1
            sums[7, l] += curve * (r1 * r2 + k1 * k2) + twist * (r1 * k2 + k1 * r2)
            sums[8, l] += curve * (r2 * r2 + k2 * k2) + 2.0 * twist * r2 * k2


@inlined
def smallest_slack(rows: Array, lanes: Lanes, w: int) -> None:
    """Write the smallest slacks into `lanes`; arguments as `add_logarithms`."""
    X, least = lanes.X, lanes.least
    least[:] = np.inf
    for k in range(len(rows)):
        jerk, e0, e1, e2 = room_of(k)
        for l in range(w):
            slope = lanes.slope[jerk, l]
            y = rows[k, 0, l] * X[0, l] + rows[k, 1, l] * X[1, l] + rows[k, 2, l] * X[2, l]
            room = lanes.bound[jerk, l] - slope * (e0 * X[0, l] + e1 * X[1, l] + e2 * X[2, l])
            least[l] = min(least[l], room - abs(y))


@inlined
def nearest_constraint(rows: Array, lanes: Lanes, w: int) -> None:
    """Write the largest share of a slack that D uses up, at least 0, into `lanes`; arguments as `add_logarithms`."""
    X, D, most = lanes.X, lanes.D, lanes.least
    most[:] = 0.0
    for k in range(len(rows)):
        jerk, e0, e1, e2 = room_of(k)
        for l in range(w):
            slope = lanes.slope[jerk, l]
            y = rows[k, 0, l] * X[0, l] + rows[k, 1, l] * X[1, l] + rows[k, 2, l] * X[2, l]
            moved = rows[k, 0, l] * D[0, l] + rows[k, 1, l] * D[1, l] + rows[k, 2, l] * D[2, l]
            room = lanes.bound[jerk, l] - slope * (e0 * X[0, l] + e1 * X[1, l] + e2 * X[2, l])
            shrinks = slope * (e0 * D[0, l] + e1 * D[1, l] + e2 * D[2, l])
            inverse = 1.0 / ((room - y) * (room + y))
            most[l] = max(
                most[l], (shrinks + moved) * (room + y) * inverse, (shrinks - moved) * (room - y) * inverse
            )


@entry
def smooth_profile(
    rates: Annotated[Array, "m", "n", 3],
    widths: Annotated[Array, "m"],
    limits: Annotated[Array, 3, "n"],
    tool: Annotated[Array, "m", 2],
    gap: float,
    w: int,
    x: Annotated[Array, "m", OUT],
    report: Annotated[Array, 2, OUT],
) -> None:
    """Compute the squared speed of a fast motion along a curve from rest to rest.

    Args:
        rates: Bernstein coefficients of q' on each interval, (m, n, 3), m >= 3.
        widths: Widths of the intervals, (m,).
        limits: Velocities, accelerations and jerks, (3, n).
        tool: Upper bound of the squared speed of the tool, divided by x and by the squared limit, at the begin and at the
            end of each interval, linear in between, (m, 2).
        gap: The duration is longer by at most about this share than the shortest one for the last M.
        w: `LANES`.
        x: Its inner numbers are a first guess up to a factor, above 0. Receives the coefficients X1 of x on each interval,
            (m,); for the first and the last one x at their inner ends.
        report: Receives the number of steps, 0 if no motion was found, and the squared Newton decrement relative to μ.
    """
    count, dof = len(widths) - 2, rates.shape[1]
    blocks, size = (count + w - 1) // w, SPEED + (BENDING + JERK) * dof
    padded = blocks * w
    rows, M = np.zeros((blocks, size, 3, w)), np.ones((blocks, w))
    near = Neighbours(np.zeros(padded), np.zeros(padded), np.zeros(padded), np.zeros(padded))
    # Unknown i is at i + 1, so that each has a place before and after it; x is 1 where there is no interval.
    c, step, bands, weights = (
        np.ones(padded + 2),
        np.zeros(padded + 2),
        np.zeros((3, padded + 2)),
        np.zeros(padded),
    )
    lanes = Lanes(
        np.ones((3, w)), np.zeros((3, w)), np.zeros((9, w)), np.zeros(w), np.zeros((2, w)), np.zeros((2, w))
    )
    near.b[:] = 1.0
    near.e[:] = 1.0
    write_neighbours(widths, near)
    for i in range(count):
        write_constraints(rates[i + 1], widths[i + 1], limits, tool[i + 1], rows[i // w, :, :, i % w])
        c[i + 1], weights[i] = x[i + 1], widths[i + 1]
    first = largest_at_rest(rates[0], widths[0], limits, tool[0]) / near.b[0]
    last = largest_at_rest(rates[count + 1], widths[count + 1], limits, tool[count + 1]) / near.e[count - 1]
    # The first and the last interval take 3 h / √X.
    weights[0] += 3.0 * widths[0] / math.sqrt(near.b[0])
    weights[count - 1] += 3.0 * widths[count + 1] / math.sqrt(near.e[count - 1])

    # Every motion is possible if it is slowed down enough.
    inside, halvings, duration = False, 0, 0.0
    while not inside and halvings < MOST_HALVINGS:
        for i in range(count):
            c[i + 1] *= 0.5
        halvings += 1
        inside = c[1] < 0.5 * first and c[count] < 0.5 * last
        for b in range(blocks):
            fill(c, b * w, near, lanes.X, w)
            for l in range(w):
                M[b, l] = max(lanes.X[0, l], lanes.X[1, l], lanes.X[2, l])
            tangents(M[b], lanes)
            smallest_slack(rows[b], lanes, w)
            for l in range(w):
                inside = inside and lanes.least[l] > 0.3
    report[0], report[1] = 0.0, 0.0
    for i in range(count):
        duration += weights[i] / math.sqrt(c[i + 1])
    slacks = 2.0 * size * count
    mu, steps, done = duration / slacks, 0, not inside
    while not done and steps < MOST_STEPS:
        bands[:] = 0.0
        step[:] = 0.0
        duration = 0.0
        for b in range(blocks):
            fill(c, b * w, near, lanes.X, w)
            tangents(M[b], lanes)
            add_logarithms(rows[b], mu, lanes, w)
            for l in range(min(w, count - b * w)):
                i = b * w + l
                add_interval(i, near, lanes.sums[:, l], bands, step)
                # The duration h c^(-1/2) and its derivatives.
                time = weights[i] / math.sqrt(c[i + 1])
                duration += time
                step[i + 1] -= 0.5 * time / c[i + 1]
                bands[0, i + 1] += 0.75 * time / (c[i + 1] * c[i + 1])
        add_bound(c, 1, first, mu, bands, step)
        add_bound(c, count, last, mu, bands, step)
        decrement = newton_step(bands, step, count) / mu
        way = 1.0 / AHEAD
        for i, most in ((1, first), (count, last)):
            way = min(way, (most - c[i]) / max(step[i], TINY))
        for b in range(blocks):
            fill(c, b * w, near, lanes.X, w)
            fill(step, b * w, near, lanes.D, w)
            tangents(M[b], lanes)
            nearest_constraint(rows[b], lanes, w)
            for l in range(w):
                way = min(way, 1.0 / max(lanes.least[l], TINY))
        for i in range(1, count + 1):
            way = min(way, c[i] / max(-step[i], TINY))
        for i in range(1, count + 1):
            c[i] += AHEAD * way * step[i]
        for b in range(blocks):
            follow(c, b * w, near, rows[b], M[b], lanes, w)
        steps += 1
        if decrement <= CENTRED:
            done = mu * slacks <= gap * duration
            mu = mu if done else SHRINK * mu
        report[0], report[1] = float(steps), decrement
    for i in range(1, count + 1):
        x[i] = c[i]
    x[0], x[count + 1] = near.b[0] * c[1], near.e[count - 1] * c[count]


@inlined
def add_interval(i: int, near: Neighbours, sums: Array, bands: Array, g: Array) -> None:
    """Add the derivatives with respect to X on interval i, (9,), as derivatives with respect to three unknowns."""
    a, b, e, f = near.a[i], near.b[i], near.e[i], near.f[i]
    h00, h01, h02, h11, h12, h22 = sums[3], sums[4], sums[5], sums[6], sums[7], sums[8]
    g[i] += a * sums[0]
    g[i + 1] += b * sums[0] + sums[1] + e * sums[2]
    g[i + 2] += f * sums[2]
    bands[0, i] += a * a * h00
    bands[1, i] += a * (b * h00 + h01 + e * h02)
    bands[2, i] += a * f * h02
    bands[0, i + 1] += b * (b * h00 + 2.0 * h01 + 2.0 * e * h02) + h11 + e * (2.0 * h12 + e * h22)
    bands[1, i + 1] += f * (b * h02 + h12 + e * h22)
    bands[0, i + 2] += f * f * h22


@inlined
def add_bound(c: Array, i: int, most: float, mu: float, bands: Array, g: Array) -> None:
    """Add the derivatives of the logarithm that keeps one unknown below a bound."""
    slack = most - c[i]
    g[i] += mu / slack
    bands[0, i] += mu / (slack * slack)


@inlined
def newton_step(bands: Array, g: Array, count: int) -> float:
    """Replace the gradient by Newton's step: solve a positive definite system with five diagonals, by LDLᵀ.

    Args:
        bands: ``bands[k, i]`` is the Hessian in row i and column i + k, (3, count + 2), in places 1 to `count`; overwritten.
        g: The gradient, (count + 2,).
        count: Number of unknowns.

    Returns:
        The squared Newton decrement: the gradient times the inverse of the Hessian times the gradient.
    """
    decrement = 0.0
    g[0], g[count + 1] = 0.0, 0.0
    for i in range(1, count + 1):
        one, two = bands[1, i] / bands[0, i], bands[2, i] / bands[0, i]
        decrement += g[i] * g[i] / bands[0, i]
        if i < count:
            bands[0, i + 1] -= one * bands[1, i]
            bands[1, i + 1] -= one * bands[2, i]
            g[i + 1] -= one * g[i]
        if i + 1 < count:
            bands[0, i + 2] -= two * bands[2, i]
            g[i + 2] -= two * g[i]
        g[i] /= -bands[0, i]
        bands[1, i], bands[2, i] = one, two
    for back in range(1, count):
        i = count - back
        g[i] -= bands[1, i] * g[i + 1] + (bands[2, i] * g[i + 2] if i + 1 < count else 0.0)
    return decrement


@inlined
def follow(c: Array, begin: int, near: Neighbours, rows: Array, M: Array, lanes: Lanes, w: int) -> None:
    """Move M to the largest coefficient of x, where the jerks leave it some slack there."""
    fill(c, begin, near, lanes.X, w)
    X = lanes.X
    for l in range(len(M)):
        lanes.D[0, l] = M[l]
        M[l] = max(X[0, l], X[1, l], X[2, l])
    tangents(M, lanes)
    smallest_slack(rows, lanes, w)
    for l in range(len(M)):
        M[l] = M[l] if lanes.least[l] > 0.0 else lanes.D[0, l]
