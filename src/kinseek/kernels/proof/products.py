"""Upper bounds of sums of products of the joints' cosines and sines in a box.

A sum ``Σ_t a_t Π_i f_i`` has one factor f_i of ``1, cos q_i, sin q_i`` for each joint in each product. About the middle c
of a box it is a sum of products of ``1, 1 - cos δ_i, sin δ_i`` with q = c + δ. Products of one joint alone have the exact
maximum of `rise`; those of several joints are bounded by the products of the largest values of their factors.

A quadratic form in the sines of all pairs of joints, made convex, bounds pairs better. It was left out: it closes no more
gaps of 10 %, 1 % or 0.1 % (`python -m benchmarks.proof panda gen3 xarm7 iiwa14 rizon4 --goals 60 --gap 0.01 --seed 7`).
Without it 1.3 to 2 times as many boxes are needed, in 0.9 to 1.4 times the time.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import array_view, inlined

OF_SUMS = 512.0 * 2.0**-53
"""Rounding of a sum of all products, at most 243, relative to the sum of their magnitudes."""


class Ends(NamedTuple):
    """The range |δ| ≤ half of one joint."""

    half: float
    """[rad]"""
    cosine: float
    """Of the half width, as of π if that is smaller."""
    sine: float


class Products(NamedTuple):
    """Memory of the sums of products in one box of n joints; a product's index has the last joint's factor fastest."""

    terms: Array
    """The invariants about the middle of the box, (kinds, 3ⁿ)."""
    total: Array
    """Their sum with negated multipliers, (3ⁿ,)."""
    ranges: Array
    """Largest values of the products of several joints, (3ⁿ,); negative values stand for either sign."""
    half: Array
    """Half widths of the box, at most π, (n,) [rad]."""
    cosine: Array
    """Their cosines, (n,)."""
    sine: Array
    """Their sines, (n,)."""


@array_view
def make_products(kinds: int, n: int) -> Products:
    """Allocate the memory of one search."""
    return Products(
        terms=np.zeros((kinds, 3**n)),
        total=np.zeros(3**n),
        ranges=np.zeros(3**n),
        half=np.zeros(n),
        cosine=np.zeros(n),
        sine=np.zeros(n),
    )


@inlined
def ends_of(products: Products, i: int) -> Ends:
    """The range of joint i."""
    return Ends(products.half[i], products.cosine[i], products.sine[i])


@inlined
def expand(invariants: Array, c: Array, h: Array, products: Products) -> None:
    """Write the invariants, (kinds, 3ⁿ), about the middle c of a box of half widths h, and the ranges of its products."""
    for k in range(len(invariants)):
        recentre(invariants[k], c, products.terms[k])
    for i in range(len(h)):
        products.half[i] = min(h[i], math.pi)
        products.cosine[i], products.sine[i] = math.cos(products.half[i]), math.sin(products.half[i])
    write_ranges(h, products.ranges)


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
def write_ranges(h: Array, ranges: Array) -> None:
    """Write the largest products of ``1, 1 - cos δ, sin δ`` in a box, 0 for those of one joint alone."""
    count = 1
    ranges[0] = 1.0
    for i in range(len(h)):
        even, odd = 1.0 - math.cos(min(h[i], math.pi)), math.sin(min(h[i], 0.5 * math.pi))
        for t in range(count - 1, -1, -1):  # Row t becomes rows 3 t and following.
            value = ranges[t]
            ranges[3 * t + 2] = -abs(value) * odd
            ranges[3 * t + 1] = value * even
            ranges[3 * t] = value
        count *= 3
    stride = len(ranges)
    for _ in range(len(h)):
        stride //= 3
        ranges[stride] = ranges[2 * stride] = 0.0


@inlined
def most_above(products: Products, share: Array) -> float:
    """Upper bound of the increase of ``products.total`` above its middle in the box; `share`, (n,), that of each joint."""
    total, ranges = products.total, products.ranges
    n, alone, stride = len(share), 0.0, len(total)
    for i in range(n):
        stride //= 3
        share[i] = rise(total[stride], abs(total[2 * stride]), ends_of(products, i))
        alone += share[i]
    together = 0.0
    for t in range(1, len(total)):
        value = total[t] * ranges[t]
        if ranges[t] < 0.0:
            value = abs(value)
        if not value <= 0.0:  # NaN has to count.
            together += value
            rest = t
            for i in range(n - 1, -1, -1):
                if rest % 3 != 0:
                    share[i] += value
                rest //= 3
    return alone + (together + OF_SUMS * together)


@inlined
def rise(even: float, odd: float, ends: Ends) -> float:
    """Maximum of ``even (1 - cos δ) + odd sin δ`` in the range of a joint, odd ≥ 0."""
    if ends.half >= math.pi or even * ends.sine + odd * ends.cosine < 0.0:  # The global maximum is inside.
        return even + math.sqrt(even * even + odd * odd)
    return even * (1.0 - ends.cosine) + odd * ends.sine


@inlined
def widest_product(products: Products) -> float:
    """Upper bound of the sum of the magnitudes of all products in the box."""
    widest = 1.0
    for i in range(len(products.half)):
        ends = ends_of(products, i)
        widest *= 2.0 - ends.cosine + (ends.sine if ends.half < 0.5 * math.pi else 1.0)
    return widest
