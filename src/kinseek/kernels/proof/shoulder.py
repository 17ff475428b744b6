"""The nearest pose of an arm whose first two joints could turn it anyhow: a lower bound, in the other joints alone.

Take the first two joints away, and let a ball joint stand on the second axis instead. Whatever the arm does, that does as
well, so its least error is a lower bound. It is the error itself where an arm has a joint to spare and no limit of the first
joints is in the way: then the others make up for what two joints cannot. A nearest pose of seven joints lies on a curve,
the arm's self-motion, along which boxes of joint values line up; here most of that curve is divided out.

Let p be the tip as seen from the ball, a the column of the hand that counts, g and b what is wanted. How the ball turns
does not matter to ``s = |p|²`` and ``u = p·a``, and these two are all that counts: wherever the ball brings the tip, to z,
and the column, to α, ``s = |z|²`` and ``u = z·α``. So for any multipliers λ and μ (Lagrange's dual; Rockafellar 1970, §28)::

    E ≥ λ s + μ u + least over z, |α| = 1 of  K_P |z - g| + K_A (1 - α·b) - λ |z|² - μ z·α.

The least over α leaves ``-|K_A b + μ z|``, which is at least ``-(|K_A b + μ z|² + m²)/(2 m)`` for any m > 0. Then all but
the first term is a polynomial in z, as bent one way as another, and the least over all z with ``|z - g| ≤ ceiling / K_P`` is
known. So a bound is a few products; any multipliers give one, and those that say how the error grows with s and u mostly
give the error itself.

Both s and u are of first degree in the cosine and the sine of every joint. So with ``1 - cos δ`` and ``sin δ`` about the
middle of a box they are sums of products whose ranges are known: exact along each joint alone, of second order where two
joints meet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import F64, I64, Bundle
from kinseek.kernels.jit import entry, hidden

from .box import TINY, rounding
from .enclosure import HEAP, Heap, sift_down, sift_up
from .progress import CEILING, COUNT, COUNTS, ENDED, FIGURES, FLOOR, FULL, SEEN, STOPPED, UPPER, USED

HALVINGS = 20
"""Halvings of the arc in which the best turn of the ball lies; any turn gives a bound."""

ROUNDS = 16
"""Rounds in which better multipliers are looked for, a step up and a step down each."""

FIRST_STEP = 0.2
"""The first such step, of multipliers that are about one."""

CLOSE = 0.995
"""Multipliers that tell such a part of the error at the middle of a box are good enough."""

AMPLE = 1.1
"""And so are those that tell so many times what is asked for. By trial: with 1 some goals take a hundred times the boxes."""

FLAT = 1e-6
"""Part of the length of arm and goal that no denominator of a multiplier falls below: where p and a are parallel, the tip is
at the ball or at its goal. Any multipliers give a bound; larger ones would give a poor one."""

OF_PRODUCTS = 1e-13
"""Rounding of s, u and what is made of them, relative to the terms that are added: a thousand last digits, for sums of some
hundred products. Twice as much takes a 1e-13th of the length from a bound."""

NARROW = 1e-7
"""A box whose joint that counts most is narrower is not cut [rad]: bounds are as good there as they get."""

COARSE = 0.9
"""Where the ball does better than is asked, its least error is enclosed to such a part of what was seen of it: that costs
some hundred boxes, and is a lower bound still."""


class Shoulder(NamedTuple):
    """An arm on a ball joint, and what is asked of it."""

    square: Array
    """``|p|²`` as a sum of products, a factor a joint: one, its cosine or its sine; (3ⁿ,), the last joint's fastest [m²]."""
    along: Array
    """``p·a`` likewise [m]."""
    far: float
    """|g| [m]"""
    ahead: float
    """b in the plane of g and b: its part along g."""
    aside: float
    """And across, ≥ 0."""
    weight_p: float
    """K_P, per [m]."""
    weight_a: float
    """K_A; 0 where no column counts."""
    size: float
    """Lengths of arm and goal, added up, plus one [m]."""
    margin: float
    """For rounding [m]."""
    margin_a: float
    """For rounding of directions."""
    trust: float
    """1; tests shrink all bounds by it, and must notice."""


SHOULDER = Bundle(
    Shoulder,
    square=F64["terms"],
    along=F64["terms"],
    far=F64,
    ahead=F64,
    aside=F64,
    weight_p=F64,
    weight_a=F64,
    size=F64,
    margin=F64,
    margin_a=F64,
    trust=F64,
)


@hidden
def recentre(given: Array, c: Array, out: Array) -> None:
    """Write a sum of products of ``1, cos q, sin q`` as one of ``1, 1 - cos δ, sin δ`` with q = c + δ."""
    for t in range(len(given)):
        out[t] = given[t]
    stride = len(given)
    for i in range(len(c)):
        stride //= 3
        cosine, sine = math.cos(c[i]), math.sin(c[i])
        for block in range(0, len(given), 3 * stride):
            for t in range(block, block + stride):
                x, y = out[t + stride], out[t + 2 * stride]
                even = x * cosine + y * sine
                out[t] += even
                out[t + stride] = -even
                out[t + 2 * stride] = y * cosine - x * sine


@hidden
def spread_of(h: Array, ranges: Array) -> None:
    """Write what the products of ``1, 1 - cos δ, sin δ`` are in a box at most, (3ⁿ,); below zero stands for either sign."""
    count = 1
    ranges[0] = 1.0
    for i in range(len(h)):
        bend, lean = 1.0 - math.cos(min(h[i], math.pi)), math.sin(min(h[i], 0.5 * math.pi))
        for t in range(count - 1, -1, -1):  # Row t becomes rows 3 t and following.
            value = ranges[t]
            ranges[3 * t + 2] = -abs(value) * lean
            ranges[3 * t + 1] = value * bend
            ranges[3 * t] = value
        count *= 3
    stride = len(ranges)
    for _ in range(len(h)):  # Those of one joint alone are looked at together.
        stride //= 3
        ranges[stride] = ranges[2 * stride] = 0.0


@hidden
def most_above(terms: Array, h: Array, ranges: Array, share: Array) -> float:
    """How far a sum of products rises above its middle in the box, at most; and how much of that every joint has a share in.

    Args:
        terms: From `recentre`, (3ⁿ,).
        h: Half widths, (n,) [rad].
        ranges: From `spread_of`, (3ⁿ,).
        share: (n,), written.
    """
    n, total, stride = len(h), 0.0, len(terms)
    for i in range(n):
        stride //= 3
        even, odd = terms[stride], abs(terms[2 * stride])
        wide = min(h[i], math.pi)
        cosine, sine = math.cos(wide), math.sin(wide)
        alone = even * (1.0 - cosine) + odd * sine
        if wide >= math.pi or even * sine + odd * cosine < 0.0:  # The highest place of all lies inside.
            alone = even + math.sqrt(even * even + odd * odd)
        total += alone
        share[i] = alone
    for t in range(1, len(terms)):
        value = terms[t] * ranges[t]
        if ranges[t] < 0.0:
            value = abs(value)
        if value > 0.0:
            total += value
            rest = t
            for i in range(n - 1, -1, -1):
                if rest % 3 != 0:
                    share[i] += value
                rest //= 3
    return total


@hidden
def best_turn(shoulder: Shoulder, far: float, angle: float) -> float:
    """The turn of the ball in the plane of g and b that brings a tip `far` away [m], a column at `angle` to it, nearest."""
    K_P, K_A, apart = shoulder.weight_p, shoulder.weight_a, far - shoulder.far
    off = angle - math.atan2(shoulder.aside, shoulder.ahead)
    low, high, product = 0.0, abs(off), far * shoulder.far
    for _ in range(HALVINGS):
        turn = 0.5 * (low + high)
        half = math.sin(0.5 * turn)
        miss = math.sqrt(apart * apart + 4.0 * product * half * half) + TINY
        if K_P * product * math.sin(turn) > K_A * math.sin(abs(off) - turn) * miss:
            high = turn
        else:
            low = turn
    return -0.5 * (low + high) if off > 0.0 else 0.5 * (low + high)


@hidden
def dual_value(
    shoulder: Shoulder, reach: float, s: float, u: float, by_s: float, by_u: float, m: float
) -> float:
    """A lower bound of the error where ``|p|²`` is s and ``p·a`` is u, if the tip is within `reach` [m] of its goal.

    Any multipliers give one, and any m > 0.
    """
    K_P, K_A, g, ahead = shoulder.weight_p, shoulder.weight_a, shoulder.far, shoulder.ahead
    bent = by_s + 0.5 * by_u * by_u / m
    pull = K_A * by_u / m
    n0, n1 = pull * ahead + 2.0 * bent * g, pull * shoulder.aside
    climb = K_P - math.sqrt(n0 * n0 + n1 * n1)
    least = min((climb - bent * reach) * reach, 0.0)
    if bent < 0.0 and climb < 0.0 and climb > 2.0 * bent * reach:
        least = 0.25 * climb * climb / bent
    known = K_A * (K_A + 2.0 * by_u * ahead * g) + by_u * by_u * g * g
    value: float = K_A - (known + m * m) / (2.0 * m) + by_s * (s - g * g) + by_u * u + least
    return value


@hidden
def bound_ball(
    shoulder: Shoulder, ceiling: float, c: Array, h: Array, terms: Array, ranges: Array, share: Array
) -> tuple[float, float]:
    """A lower bound of the weighted error in a box, and the error at its middle, with the ball wherever it may be.

    Args:
        shoulder: The arm on its ball, and what is asked.
        ceiling: Errors from here on are all the same.
        c: Centre of the box, (n,) [rad].
        h: Its half widths, (n,) [rad].
        terms: Memory, (3, 3ⁿ).
        ranges: Memory, (3ⁿ,).
        share: (n,), what every joint has to do with what the bound loses in the box.
    """
    K_P, K_A, size, g = shoulder.weight_p, shoulder.weight_a, shoulder.size, shoulder.far
    recentre(shoulder.square, c, terms[0])
    recentre(shoulder.along, c, terms[1])
    spread_of(h, ranges)
    s, u = max(terms[0, 0], 0.0), terms[1, 0]
    far, flat = math.sqrt(s), math.sqrt(max(s - u * u, 0.0))
    angle = math.atan2(flat, u)
    turn = best_turn(shoulder, far, angle)
    # Where the tip is then, and by how much it and the hand miss, in the plane of g and b.
    z0, z1 = far * math.cos(turn), far * math.sin(turn)
    miss = math.sqrt((z0 - g) * (z0 - g) + z1 * z1)
    tilt = angle + turn - math.atan2(shoulder.aside, shoulder.ahead)
    error = K_P * miss + K_A * (1.0 - math.cos(tilt))
    # Multipliers: how the error grows with s and u; then better ones, where these leave much open.
    reach = ceiling / K_P + shoulder.margin
    torque, small = K_A * math.sin(tilt), FLAT * size
    by_u = -torque / max(flat, small)
    by_s = torque * u / (2.0 * max(flat, small) * max(s, small * small))
    by_s += K_P * (far - g * math.cos(turn)) / (max(miss, small) * max(far + min(far, g), small))
    w0, w1 = K_A * shoulder.ahead + by_u * z0, K_A * shoulder.aside + by_u * z1
    m = max(math.sqrt(w0 * w0 + w1 * w1), FLAT * (K_A + K_P * size))
    bound = dual_value(shoulder, reach, s, u, by_s, by_u, m)
    step = FIRST_STEP
    for _ in range(ROUNDS):
        if bound >= min(AMPLE * ceiling, CLOSE * error):
            break
        before = bound
        for which in range(6):
            sign = step if which % 2 == 0 else -step
            s1 = by_s + (sign if which // 2 == 0 else 0.0) * K_P / size
            u1 = by_u + (sign if which // 2 == 1 else 0.0) * K_P
            m1 = m * (1.0 + sign) if which // 2 == 2 else m
            value = dual_value(shoulder, reach, s, u, s1, u1, m1)
            if value > bound:
                bound, by_s, by_u, m = value, s1, u1, m1
        if bound == before:
            step *= 0.5
    for t in range(len(ranges)):
        terms[2, t] = -by_s * terms[0, t] - by_u * terms[1, t]
    bound -= shoulder.trust * most_above(terms[2], h, ranges, share)
    bound -= K_P * shoulder.margin + 2.0 * K_A * shoulder.margin_a
    parts = K_A + abs(by_u) * size
    bound -= OF_PRODUCTS * ((abs(by_s) * size + 2.0 * abs(by_u) + K_P) * size + parts * parts / m + m)
    return bound, error


@entry(
    returns=I64,
    shoulder=SHOULDER,
    boxes=F64["room", "*"].out,
    heap=HEAP,
    counts=I64[COUNTS].out,
    figures=F64[FIGURES].out,
    until=I64,
)
def enclose_ball(
    shoulder: Shoulder, boxes: Array, heap: Heap, counts: Indices, figures: Array, until: int
) -> int:
    """Bound the least weighted error of the arm on its ball, the box with the least bound first.

    It may be called again to go on where it stopped, and finds the same as if it had not stopped.

    Args:
        shoulder: The arm on its ball, and what is asked.
        boxes: Centres, half widths, and the joint to be cut, (room, 2 n + 1); the first COUNT rows are there.
        heap: Their bounds and order.
        counts: COUNT and following, (COUNTS,).
        figures: CEILING is what a box must stay below to count, and falls where the ball does better; FLOOR becomes the
            bound that holds by now; UPPER the least error seen. (FIGURES,)
        until: Boxes that may have been bounded by the end of this call.

    Returns:
        ENDED, STOPPED or FULL.
    """
    n = boxes.shape[1] // 2
    c, h, share = np.empty(n), np.empty(n), np.empty(n)
    terms, ranges = np.empty((3, len(shoulder.square))), np.empty(len(shoulder.square))
    order = heap.order
    while counts[COUNT] > 0:
        row = order[0]
        if heap.bound[row] >= figures[CEILING]:
            break
        if counts[SEEN] >= until:
            return STOPPED
        if counts[COUNT] + 1 >= len(boxes):
            return FULL
        figures[FLOOR] = max(figures[FLOOR], heap.bound[row])
        cut = int(boxes[row, 2 * n])
        if boxes[row, n + cut] < NARROW:
            return ENDED
        counts[COUNT] -= 1
        last = counts[COUNT]
        order[0], order[last] = order[last], row
        sift_down(heap.bound, order, last)
        below, middle, half = heap.bound[row], boxes[row, cut], 0.5 * boxes[row, n + cut]
        for i in range(n):
            c[i], h[i] = boxes[row, i], boxes[row, n + i]
        h[cut] = half + rounding(middle, half)
        for side in range(2):
            c[cut] = middle - half if side == 0 else middle + half
            bound, error = bound_ball(shoulder, figures[CEILING], c, h, terms, ranges, share)
            counts[SEEN] += 1
            if error < figures[UPPER]:
                figures[UPPER] = error
                if error < figures[CEILING]:
                    figures[CEILING] = COARSE * error
            bound = max(bound, below)
            if bound >= figures[CEILING]:
                continue
            count = counts[COUNT]
            if count == counts[USED]:
                order[count] = count
                counts[USED] += 1
            free = order[count]
            cutting = 0
            for i in range(n):
                boxes[free, i], boxes[free, n + i] = c[i], h[i]
                if share[i] > share[cutting]:
                    cutting = i
            boxes[free, 2 * n], heap.bound[free] = cutting, bound
            sift_up(heap.bound, order, count)
            counts[COUNT] += 1
    figures[FLOOR] = max(figures[FLOOR], figures[CEILING])
    return ENDED
