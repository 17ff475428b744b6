"""The fastest motion along a curve whose joint speeds and accelerations stay inside limits, at every point.

The curve q(s) is divided into intervals of width h. On each, q'(s) is a quadratic polynomial, and the squared speed
``x = ds²/dt²`` is linear, from x0 at its begin to x1 at its end, so that the acceleration ``u = d²s/dt² = (x1 - x0) / 2h``
is constant. The acceleration of a joint, ``q'' x + q' u`` (*Bobrow, Dubowsky, Gibson 1985*), is then a quadratic
polynomial in s. It stays between its smallest and its largest Bernstein coefficient (*Farouki 2012*), and the
coefficients are linear in x0 and x1. So are those of the bound ``r² x`` of the squared speeds, where the squared rate r² is
bounded by a linear polynomial. Limits of the coefficients, the rows of an interval, therefore hold on all of it.

As every row admits rest (x0 = x1 = 0), one pass from the end finds the largest x from which the arm can still keep all
limits, and one pass from the start takes the largest x that this permits (*Pham, Pham 2018*). To take the largest x at once
is best if a larger x0 never reduces the largest x1. So a row with two positive coefficients is replaced by limits of x0 and
of x1 alone, which imply it; they differ from it by the change of x on an interval.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

RATES = 2
"""Rows of an interval that limit its rate, at its begin and at its end: the joint speeds and the speed of the tool."""

PER_JOINT = 6
"""Rows of an interval for each joint: three coefficients of the acceleration, each with two signs."""

PARALLEL = 1e-13
"""Smallest slope of a row along a direction, relative to its coefficients: less is rounding."""

CLOSE = 1.1
"""Mean of the quotients of two numbers up to which they count as close."""

SLIGHT = 1e-11
"""A row whose left side changes by less over all x1 does not limit x1."""


@inlined
def largest_before(rows: Array, after: float, steps: Array) -> float:
    """Return the largest x0 for which some x1 in [0, after] satisfies all rows, (2, k): a linear program.

    The vertices of the feasible polygon are visited from rest, with increasing x0, as in the simplex method. It ends at a
    row along which x0 does not increase. `steps` is memory, (k,).
    """
    x0, x1, slope = 0.0, 0.0, 0.0
    while True:
        # The point moves in the direction (1, slope) until the first row is reached.
        for k in range(len(steps)):
            rate = rows[0, k] + slope * rows[1, k]
            left = max(1.0 - rows[0, k] * x0 - rows[1, k] * x1, 0.0)
            # Rows parallel to the direction, up to rounding, do not block: the point moves along such a row.
            steps[k] = left / rate if rate > PARALLEL * abs(rows[0, k]) else np.inf
        step = smallest(steps)
        if x1 + slope * step >= after:
            return x0 + (after - x1) / slope if slope > 0.0 else x0 + step
        x0, x1 = x0 + step, x1 + slope * step
        blocking = 0
        while steps[blocking] > step:
            blocking += 1
        first, second = rows[0, blocking], rows[1, blocking]
        if second >= 0.0 or first <= 0.0 or -first / second <= slope:
            return x0
        slope = -first / second


@inlined
def smallest(values: Array) -> float:
    """Return the smallest of some values, (k,)."""
    least = np.inf
    for k in range(len(values)):
        least = min(least, values[k])
    return least


@inlined
def largest_after(rows: Array, before: float, most: float, steps: Array) -> float:
    """Return the largest x1, at most `most`, that satisfies all rows, (2, k), together with x0; `steps` is memory."""
    for k in range(len(steps)):
        left = max(1.0 - rows[0, k] * before, 0.0)
        # A row that hardly depends on x1 holds up to rounding, as it did when `most` was found.
        steps[k] = left / rows[1, k] if rows[1, k] * most > SLIGHT else np.inf
    return min(most, smallest(steps))


class Line(NamedTuple):
    """A linear function on an interval: its values at both ends."""

    begin: float
    end: float


@inlined
def squared_rate(d0: float, d1: float, d2: float) -> Line:
    """Bound the square of a quadratic polynomial, given by its Bernstein coefficients, by a linear function."""
    c0, c1, c2, c3, c4 = d0 * d0, d0 * d1, (2.0 * d1 * d1 + d0 * d2) / 3.0, d1 * d2, d2 * d2
    # The line between the ends of the square, lifted by the largest difference of coefficients.
    over = max(0.0, c1 - 0.75 * c0 - 0.25 * c4, c2 - 0.5 * (c0 + c4), c3 - 0.25 * c0 - 0.75 * c4)
    return Line(c0 + over, c4 + over)


@inlined
def write_rows(
    rates: Array, width: float, velocity: Array, acceleration: Array, tool: Array, rows: Array
) -> None:
    """Write the rows of an interval, (2, RATES + PER_JOINT n).

    Args:
        rates: Bernstein coefficients of q' on the interval, (n, 3).
        width: h.
        velocity: Limits of the joints, (n,), infinite for none.
        acceleration: Limits of the joints, (n,).
        tool: See `fastest_profile`, (2,).
        rows: Receives the rows.
    """
    begin, end = tool[0], tool[1]
    for j in range(len(velocity)):
        d0, d1, d2 = rates[j, 0], rates[j, 1], rates[j, 2]
        square = squared_rate(d0, d1, d2)
        weight = 1.0 / (velocity[j] * velocity[j])
        begin, end = max(begin, weight * square.begin), max(end, weight * square.end)
        # q'' = 2 (d1 - d0) / h, ... and u = (x1 - x0) / 2h.
        share = 1.0 / (2.0 * width * acceleration[j])
        at = RATES + PER_JOINT * j
        rows[0, at], rows[1, at] = share * (4.0 * d1 - 5.0 * d0), share * d0
        rows[0, at + 1], rows[1, at + 1] = share * (2.0 * d2 - 3.0 * d1), share * (3.0 * d1 - 2.0 * d0)
        rows[0, at + 2], rows[1, at + 2] = -share * d2, share * (5.0 * d2 - 4.0 * d1)
        for k in range(at, at + 3):
            first, second = rows[0, k], rows[1, k]
            opposite = first * second < 0.0
            # A sum of both is limited by limits of each: only with these it is best to be fast early.
            rows[0, k], rows[1, k] = first if opposite else abs(first + second), second if opposite else 0.0
            rows[0, k + 3], rows[1, k + 3] = (
                -first if opposite else 0.0,
                -second if opposite else abs(first + second),
            )
    # r² x <= 1, where r² is at most linear, from `begin` to `end`. The middle coefficient of the product is at most 1 if x0
    # and x1 are at most 1 / (c begin) and 1 / (c end), where c is the mean of both quotients, or at most the inverse mean.
    low, high = min(begin, end), max(begin, end)
    scale = 0.5 * (low / high + high / low) if low > 0.0 else np.inf
    mean = 0.5 * (begin + end)
    near = scale < CLOSE
    rows[0, 0], rows[1, 0] = scale * begin if near else max(begin, mean), 0.0
    rows[0, 1], rows[1, 1] = 0.0, scale * end if near else max(end, mean)


@entry
def fastest_profile(
    rates: Annotated[Array, "m", "n", 3],
    widths: Annotated[Array, "m"],
    velocity: Annotated[Array, "n"],
    acceleration: Annotated[Array, "n"],
    tool: Annotated[Array, "m", 2],
    reachable: Annotated[Array, "m+1", OUT],
    x: Annotated[Array, "m+1", OUT],
) -> None:
    """Compute the squared speed of the fastest motion along a curve.

    Args:
        rates: Bernstein coefficients of q' on each interval, (m, n, 3).
        widths: Widths of the intervals, (m,).
        velocity: Limits of the joints, (n,), infinite for none.
        acceleration: Limits of the joints, (n,).
        tool: Upper bound of the squared speed of the tool, divided by x and by the squared limit, at the begin and at the
            end of each interval, linear in between, (m, 2).
        reachable: Its last element is the largest squared speed at the end. Receives the largest squared speeds from which
            all limits can be kept, (m + 1,).
        x: Its first element is the squared speed at the begin. Receives the squared speeds, (m + 1,).
    """
    count, dof = rates.shape[0], rates.shape[1]
    rows = np.empty((count, 2, RATES + PER_JOINT * dof))
    steps = np.empty(rows.shape[2])
    for back in range(count):
        i = count - 1 - back
        write_rows(rates[i], widths[i], velocity, acceleration, tool[i], rows[i])
        reachable[i] = largest_before(rows[i], reachable[i + 1], steps)
    x[0] = min(x[0], reachable[0])
    for i in range(count):
        x[i + 1] = largest_after(rows[i], x[i], reachable[i + 1], steps)
