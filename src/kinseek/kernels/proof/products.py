"""Upper bounds of sums of products of the joints' cosines and sines in a box.

The ranges of all products of ``1 - cos δ`` and ``sin δ`` about the middle of a box are known: exact for each joint alone,
and of second order for pairs of joints. To second order the sum is a quadratic form in the sines. If that is convex, the
increase is known up to terms of third order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import counted, inlined

from .form import OF_SQUARES

STEEP = 1.2
"""A joint with a larger half width [rad] is left out of the quadratic form, because its sine may decrease again."""

SWEEPS = 8
"""Rounds of coordinate descent to the minimum of a quadratic form; any point gives a bound."""

OF_FORMS = 64.0 * 2.0**-53
"""Rounding of a quadratic form of five variables and of its slopes, relative to its parts: four sums of eight products."""

OF_SUMS = 512.0 * 2.0**-53
"""Rounding of a sum of all products, at most 243, relative to the sum of their magnitudes."""


class Sheet(NamedTuple):
    """Scratch memory to bound one box."""

    terms: Array
    """The invariants about the middle of the box, and last their sum with negated multipliers, (kinds + 1, 3ⁿ)."""
    ranges: Array
    """(3ⁿ,)"""
    share: Array
    """Share of each joint in the loss of the bound in the box, (n,)."""
    other: Array
    """The same with other multipliers, (n,)."""
    ends: Array
    """Half width, cosine and sine of every joint's half width, (n, 3)."""
    place: Array
    """Tip and column for the best rotation of the ball, (2, 3)."""
    by: Array
    """Multipliers of the invariants, and m, (5,)."""
    trial: Array
    """Trial multipliers, (5,)."""
    upright: Array
    """Multipliers that include the first axis, (5,)."""
    before: Array
    """Multipliers before the current round, (5,)."""
    steps: Array
    """Step of each multiplier, (5,)."""
    Q: Array
    """A quadratic form, (n, n)."""
    S: Array
    """The remaining part of it, (n, n)."""
    x: Array
    """Remaining joints, slopes, the additions that make the form convex, and a point in the box, (4, n)."""


@counted
def make_sheet(kinds: int, n: int) -> Sheet:
    """Allocate the memory of one search."""
    return Sheet(
        np.zeros((kinds + 1, 3**n)),
        np.zeros(3**n),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, 3)),
        np.zeros((2, 3)),
        np.zeros(5),
        np.zeros(5),
        np.zeros(5),
        np.zeros(5),
        np.zeros(5),
        np.zeros((n, n)),
        np.zeros((n, n)),
        np.zeros((4, n)),
    )


@inlined
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
                # x cos q + y sin q = even cos δ + odd sin δ, and cos δ = 1 - (1 - cos δ).
                even = x * cosine + y * sine
                out[t] += even
                out[t + stride] = -even
                out[t + 2 * stride] = y * cosine - x * sine


@inlined
def product_ranges(h: Array, ranges: Array) -> None:
    """Write the largest products of ``1, 1 - cos δ, sin δ`` in a box, (3ⁿ,); negative values stand for either sign."""
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
    for _ in range(len(h)):  # Products of one joint alone are treated together elsewhere.
        stride //= 3
        ranges[stride] = ranges[2 * stride] = 0.0


@inlined
def most_above(terms: Array, sheet: Sheet, share: Array) -> float:
    """Upper bound of the increase of a sum of products above its middle in the box; writes the share of each joint.

    Args:
        terms: From `recentre`, (3ⁿ,).
        sheet: With the ends of the box and the ranges of products in it.
        share: Receives the shares, (n,).
    """
    n, alone, stride, ends = len(share), 0.0, len(terms), sheet.ends
    for i in range(n):
        stride //= 3
        share[i] = largest_increase(terms[stride], abs(terms[2 * stride]), ends[i, 0], ends[i, 1], ends[i, 2])
        alone += share[i]
    together = 0.0
    for t in range(1, len(terms)):
        value = terms[t] * sheet.ranges[t]
        if sheet.ranges[t] < 0.0:
            value = abs(value)
        if not value <= 0.0:  # NaN has to count.
            together += value
            rest = t
            for i in range(n - 1, -1, -1):
                if rest % 3 != 0:
                    share[i] += value
                rest //= 3
    together += OF_SUMS * together
    return min(alone + together, most_curved(terms, sheet) + together)


@inlined
def most_curved(terms: Array, sheet: Sheet) -> float:
    """Alternative to the bound of each joint alone, with pairs of joints to second order.

    With ``x = sin δ`` the products of two sines are a quadratic form, and ``x²/2 ≤ 1 - cos δ ≤ x²/(1 + cos h)``. The
    decrease is therefore at least ``b·x + ½ xᵀQx``. If this is convex, the slope at any point gives its minimum in the
    box. What is added to make it convex is subtracted again at its largest value.
    """
    n, ends, Q, b, y = len(sheet.ends), sheet.ends, sheet.Q, sheet.x[1], sheet.x[3]
    total, size, stride = 0.0, 0.0, len(terms)
    for i in range(n):
        stride //= 3
        even, odd, half = -terms[stride], terms[2 * stride], ends[i, 0]
        if half > STEEP:
            total += largest_increase(-even, abs(odd), half, ends[i, 1], ends[i, 2])
            b[i] = Q[i, i] = 0.0
        else:
            b[i] = -odd * ends[i, 2]
            Q[i, i] = even * ends[i, 2] * ends[i, 2]
            if even < 0.0:
                Q[i, i] *= 2.0 / (1.0 + ends[i, 1])
        size += abs(b[i]) + abs(Q[i, i])
        beyond = len(terms)
        for j in range(i):
            beyond //= 3
            Q[i, j] = Q[j, i] = 0.0
            if half <= STEEP and ends[j, 0] <= STEEP:
                Q[i, j] = Q[j, i] = -terms[2 * (stride + beyond)] * ends[i, 2] * ends[j, 2]
                total -= abs(Q[i, j])  # It is included in the products.
                size += abs(Q[i, j])
    for i in range(n):
        y[i] = 0.0
    total += bend(sheet)
    for _ in range(SWEEPS):
        for i in range(n):
            slope = b[i]
            for j in range(n):
                slope += Q[i, j] * y[j]
            if Q[i, i] > 0.0:
                y[i] = min(max(y[i] - slope / Q[i, i], -1.0), 1.0)
            else:
                y[i] = -1.0 if slope > 0.0 else 1.0
    for i in range(n):
        slope, value = b[i], b[i]
        for j in range(n):
            slope += Q[i, j] * y[j]
            value += 0.5 * Q[i, j] * y[j]
        # A convex f lies above its tangent at y: for |x_i| ≤ 1 it is at least f(y) - f'(y)·y - Σ |f'(y)_i|.
        total += abs(slope) + (slope - value) * y[i]
    return total + OF_FORMS * size


@inlined
def bend(sheet: Sheet) -> float:
    """Make a quadratic form convex by additions to its diagonal; return their largest effect for |x| ≤ 1.

    Squares are completed, and at the best point to stop the rest is made diagonally dominant.
    """
    Q, S, added, left = sheet.Q, sheet.S, sheet.x[2], sheet.x[0]
    n, least, noise, before = len(Q), np.inf, 0.0, 0.0
    for i in range(n):
        left[i], added[i] = 1.0, 0.0
        for j in range(n):
            S[i, j] = Q[i, j]
    for _ in range(n + 1):
        total, pivot, top, mass = 0.0, -1, 0.0, 0.0
        for i in range(n):
            if left[i] == 0.0:
                continue
            if S[i, i] > top:
                top, pivot = S[i, i], i
            total += dominance_deficit(S, left, i)
            for j in range(n):
                mass += abs(S[i, j]) if left[j] != 0.0 else 0.0
        noise += OF_SQUARES * (before + mass)
        before = mass
        if total + noise < least:
            least = total + noise
            for i in range(n):
                added[i] = dominance_deficit(S, left, i) if left[i] != 0.0 else 0.0
        if pivot < 0 or total == 0.0:
            break
        left[pivot] = 0.0
        for i in range(n):
            if left[i] != 0.0:
                factor = S[i, pivot] / top
                for j in range(n):
                    if left[j] != 0.0:
                        S[i, j] -= factor * S[pivot, j]
    for i in range(n):
        Q[i, i] += added[i]
    return 0.5 * least


@inlined
def dominance_deficit(S: Array, left: Array, i: int) -> float:
    """Amount by which a row of a quadratic form falls short of diagonal dominance."""
    total = -S[i, i]
    for j in range(len(S)):
        if j != i and left[j] != 0.0:
            total += abs(S[i, j])
    return max(float(total), 0.0)


@inlined
def largest_increase(even: float, odd: float, wide: float, cosine: float, sine: float) -> float:
    """Maximum of ``even (1 - cos δ) + odd sin δ`` for |δ| ≤ wide, odd ≥ 0."""
    if wide >= math.pi or even * sine + odd * cosine < 0.0:  # The global maximum is inside.
        return even + math.sqrt(even * even + odd * odd)
    return even * (1.0 - cosine) + odd * sine
