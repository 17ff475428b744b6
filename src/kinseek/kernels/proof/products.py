"""Sums of products of the joints' cosines and sines: how far they rise in a box.

With ``1 - cos δ`` and ``sin δ`` about the middle of a box the ranges of all products are known: exact along each joint
alone, of second order where two joints meet. To second order they are a quadratic form in the sines, and where that is
convex, what it rises by is known but for terms of third order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import array_view, inlined

from .form import OF_SQUARES

STEEP = 1.2
"""A joint of a box that is wider [rad] has no part in the quadratic form: its sine may fall again."""

SWEEPS = 8
"""Rounds in which the least place of a quadratic form is looked for, one joint after the other; any place gives a bound."""

OF_FORMS = 64.0 * 2.0**-53
"""Rounding of a quadratic form of five variables and of its slopes, relative to its parts: four sums of eight products."""

OF_SUMS = 512.0 * 2.0**-53
"""Rounding of a sum of all products, 243 at most, relative to the sum of their magnitudes."""


class Sheet(NamedTuple):
    """Memory to bound one box."""

    terms: Array
    """The invariants about the middle of the box, and at last their sum with multipliers, turned over, (kinds + 1, 3ⁿ)."""
    ranges: Array
    """(3ⁿ,)"""
    share: Array
    """What every joint has to do with what the bound loses in the box, (n,)."""
    other: Array
    """The same with other multipliers, (n,)."""
    ends: Array
    """Half width, cosine and sine of every joint's half width, (n, 3)."""
    place: Array
    """Tip and column where the ball turns them best, (2, 3)."""
    by: Array
    """Multipliers of the invariants, and m, (5,)."""
    trial: Array
    """Others, (5,)."""
    upright: Array
    """Those that tell of the first axis, too, (5,)."""
    before: Array
    """What they were a round ago, (5,)."""
    steps: Array
    """How far each of them is changed, (5,)."""
    Q: Array
    """A quadratic form, (n, n)."""
    S: Array
    """What is left of it, (n, n)."""
    x: Array
    """Joints left, slopes, what makes the form convex, and a place in the box, (4, n)."""


@array_view
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
                even = x * cosine + y * sine
                out[t] += even
                out[t + stride] = -even
                out[t + 2 * stride] = y * cosine - x * sine


@inlined
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


@inlined
def most_above(terms: Array, sheet: Sheet, share: Array) -> float:
    """How far a sum of products rises above its middle in the box, at most; and how much of that every joint has a share in.

    Args:
        terms: From `recentre`, (3ⁿ,).
        sheet: With the ends of the box and the ranges of products in it.
        share: (n,), written.
    """
    n, alone, stride, ends = len(share), 0.0, len(terms), sheet.ends
    for i in range(n):
        stride //= 3
        share[i] = rise(terms[stride], abs(terms[2 * stride]), ends[i, 0], ends[i, 1], ends[i, 2])
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
    """What may stand in the place of the joints alone where they are taken in pairs, to second order.

    With ``x = sin δ`` the products of two sines are a quadratic form, and ``x²/2 ≤ 1 - cos δ ≤ x²/(1 + cos h)``. So what
    falls is at least ``b·x + ½ xᵀQx``, and where that is convex its least value in the box is known from its slope at any
    place in it. What makes it convex is added and, at its largest, taken off again.
    """
    n, ends, Q, b, y = len(sheet.ends), sheet.ends, sheet.Q, sheet.x[1], sheet.x[3]
    total, size, stride = 0.0, 0.0, len(terms)
    for i in range(n):
        stride //= 3
        even, odd, half = -terms[stride], terms[2 * stride], ends[i, 0]
        if half > STEEP:
            total += rise(-even, abs(odd), half, ends[i, 1], ends[i, 2])
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
                total -= abs(Q[i, j])  # It is counted among the products.
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
        total += abs(slope) + (slope - value) * y[i]
    return total + OF_FORMS * size


@inlined
def bend(sheet: Sheet) -> float:
    """Make a quadratic form convex, by what is added to its diagonal; how much that is at most where no |x| is above 1.

    Squares are completed, and at the best place to stop what is left is made diagonally dominant.
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
            total += lacking(S, left, i)
            for j in range(n):
                mass += abs(S[i, j]) if left[j] != 0.0 else 0.0
        noise += OF_SQUARES * (before + mass)
        before = mass
        if total + noise < least:
            least = total + noise
            for i in range(n):
                added[i] = lacking(S, left, i) if left[i] != 0.0 else 0.0
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
def lacking(S: Array, left: Array, i: int) -> float:
    """What a row of a quadratic form lacks to be dominated by its diagonal."""
    total = -S[i, i]
    for j in range(len(S)):
        if j != i and left[j] != 0.0:
            total += abs(S[i, j])
    return max(float(total), 0.0)


@inlined
def rise(even: float, odd: float, wide: float, cosine: float, sine: float) -> float:
    """The most that ``even (1 - cos δ) + odd sin δ`` is for |δ| ≤ wide, odd ≥ 0."""
    if wide >= math.pi or even * sine + odd * cosine < 0.0:  # The highest place of all lies inside.
        return even + math.sqrt(even * even + odd * odd)
    return even * (1.0 - cosine) + odd * sine
