"""Lower bound of the error of an arm whose first two joints are replaced by a ball joint, in the other joints alone.

Remove the first two joints, and put a ball joint on the second axis instead. It can make every motion that the arm can
make, so its smallest error is a lower bound. It equals the error of the arm if the arm is redundant and no limit of the
first joints is active: the other joints then compensate for what two joints cannot do. A nearest pose of seven joints
lies on a curve, the self-motion of the arm, along which boxes of joint values accumulate. Here most of that curve is
divided out.

Let p be the tip as seen from the ball, a the relevant column of the hand, and g and b their goals. The rotation of the
ball does not change ``s = |p|²`` and ``u = p·a``, and only these two matter: if the ball moves the tip to z and the
column to α, then ``s = |z|²`` and ``u = z·α``. For any multipliers λ and μ (Lagrange's dual; Rockafellar 1970, §28)::

    E ≥ λ s + μ u + least over z, |α| = 1 of  K_P |z - g| + K_A (1 - α·b) - λ |z|² - μ z·α.

The minimum over α leaves ``-|K_A b + μ z|``, which is at least ``-(|K_A b + μ z|² + m²)/(2 m)`` for any m > 0. All but
the first term is then a polynomial in z with the same curvature in all directions, and its minimum over all z with
``|z - g| ≤ ceiling / K_P`` is known. A bound thus needs a few products. Any multipliers give one, and those that describe
how the error grows with s and u mostly give the error itself.

If the axes do not intersect, the ball is on the first one, and the second joint is one of the others. A rotation about
the first axis, e, then also keeps ``p·e`` and ``a·e``. With multipliers η and θ for these two the bound is that of the
arm itself, except for the limits of its first joint and for its mirror image. If both are 0, it is that of the ball.

All invariants are of first degree in the cosine and the sine of every joint, so their ranges in a box are known
(`kernels.proof.products`). `kernels.proof.multipliers` finds good multipliers.

Without this bound few gaps of arms of seven joints close. A gap of 1 % for goals out of reach, at most two seconds each,
`python -m benchmarks.proof panda gen3 xarm7 iiwa14 rizon4 --goals 60 --gap 0.01 --seconds 2 --seed 7`::

                 panda     gen3    xarm7   iiwa14   rizon4
    with it      100 %    100 %    100 %    100 %     56 %  closed
                  6 ms     8 ms     6 ms    17 ms   169 ms  median
    without       14 %     93 %     95 %      7 %      0 %  closed
               1975 ms   857 ms   581 ms  1616 ms  1188 ms  median
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import array_view, entry, inlined

from .box import rounding
from .heap import Heap, free_row, pop, push
from .multipliers import (
    KINDS,
    Ascent,
    Multipliers,
    Shoulder,
    better,
    combine,
    dual_value,
    goal_at,
    improved,
    make_ascent,
    multipliers_at,
    multipliers_of,
    nearest,
    write_multipliers,
)
from .products import Products, expand, make_products, most_above, widest_product
from .progress import CEILING, COUNT, COUNTS, ENDED, FIGURES, FLOOR, FULL, SEEN, STOPPED, UPPER

AMPLE = 1.1
"""Multipliers are good enough if their single-joint bound is this multiple of the ceiling; products of two joints reduce
it."""

OF_PARTS = 64.0 * 2.0**-53
"""Rounding of the products of multipliers and goal, relative to their parts: some thirty operations."""

NARROW = 1e-7
"""A box is not cut if its most important joint is narrower than this [rad]: bounds do not improve further."""

COARSE = 0.9
"""If the ball reaches a smaller error than the ceiling, its minimum is enclosed to this fraction of the smallest error
found. That costs some hundred boxes and is still a lower bound."""


class BallBoxes(NamedTuple):
    """Boxes of the joints that are distal to the ball, one a row."""

    centre: Annotated[Array, "room", "n", OUT]
    """(room, n) [rad]"""
    half: Annotated[Array, "room", "n", OUT]
    """Half widths, (room, n) [rad]."""
    cut: Annotated[Indices, "room", OUT]
    """The joint to be cut, (room,)."""
    by: Annotated[Array, "room", KINDS + 1, OUT]
    """Good multipliers, see `Multipliers`, or m = 0 for none, (room, 5)."""


class BallScratch(NamedTuple):
    """Scratch memory of one call."""

    c: Array
    """Centre of the current box, (n,) [rad]."""
    h: Array
    """Its half widths, (n,) [rad]."""
    products: Products
    ascent: Ascent
    share: Array
    """Share of each joint in the loss of the bound in the box, (n,)."""
    other: Array
    """The same with other multipliers, (n,)."""


@array_view
def make_ball_scratch(kinds: int, n: int) -> BallScratch:
    """Allocate the memory of one call."""
    return BallScratch(
        np.zeros(n), np.zeros(n), make_products(kinds, n), make_ascent(), np.zeros(n), np.zeros(n)
    )


class Bound(NamedTuple):
    """Result for a box."""

    least: float
    """A lower bound of the weighted error in it, over all rotations of the ball."""
    error: float
    """The error at its middle."""
    by: Multipliers
    """Multipliers that may be good ones for its halves."""


@inlined
def bound_ball(shoulder: Shoulder, ceiling: float, above: Multipliers, scratch: BallScratch) -> Bound:
    """Bound the error in the current box, and write the share of every joint in the loss of the bound.

    Args:
        shoulder: The arm on its ball, and its goal.
        ceiling: Errors above this are equivalent.
        above: Multipliers that may be good ones; m = 0 for none.
        scratch: Scratch memory, with the box.
    """
    products, share, other = scratch.products, scratch.share, scratch.other
    expand(shoulder.invariants, scratch.c, scratch.h, products)
    terms, axis = products.terms, len(shoulder.invariants) > 2
    s, u, reach = max(terms[0, 0], 0.0), terms[1, 0], ceiling / shoulder.weight_p + shoulder.margin
    plane, goal = goal_at(shoulder.plane), goal_at(shoulder.goal)
    ball = upright = nearest(shoulder, plane, s, u, 0.0, 0.0)
    by = first = multipliers_of(shoulder, plane, ball, False)
    if axis:
        upright = nearest(shoulder, goal, s, u, terms[2, 0], terms[3, 0])
        first = multipliers_of(shoulder, goal, upright, True)
        by = better(shoulder, reach, products, by, first)
    bound = settled(shoulder, reach, products, by, share)
    if bound < ceiling:
        if above.m > 0.0:
            by = better(shoulder, reach, products, by, above)
        write_multipliers(by, scratch.ascent.best)
        by = improved(shoulder, reach, products, scratch.ascent, AMPLE * ceiling)
        bound = max(bound, settled(shoulder, reach, products, by, other))
        if axis and ball.error < ceiling:
            # The ball alone would reach the ceiling at the middle, so the joints that matter for the first axis must
            # become narrower.
            settled(shoulder, reach, products, first, share)
        else:
            for i in range(len(share)):
                share[i] += other[i]
    return Bound(bound, upright.error, by)


@inlined
def settled(shoulder: Shoulder, reach: float, products: Products, by: Multipliers, share: Array) -> float:
    """The bound that the multipliers give in the box; `share`, (n,), receives the share of each joint in its loss."""
    bound = dual_value(shoulder, reach, products.terms, by)
    combine(products, by)
    bound -= shoulder.trust * most_above(products, share)
    K_P, K_A, size = shoulder.weight_p, shoulder.weight_a, shoulder.size
    square, along, height, lean = abs(by.square), abs(by.along), abs(by.height), abs(by.lean)
    bound -= K_P * shoulder.margin + 2.0 * K_A * shoulder.margin_a
    parts = K_A + along * size + lean
    lengths = (square * size + 2.0 * along + 2.0 * height + K_P) * size
    bound -= OF_PARTS * (lengths + 2.0 * lean + parts * parts / by.m + by.m)
    # Every factor of a product may have an error; the products are no larger than the widest one.
    sums = square * size * size + (along + height) * size + lean
    left: float = bound - shoulder.rounding * widest_product(products) * sums
    return left


@entry
def enclose_ball(
    shoulder: Shoulder,
    boxes: BallBoxes,
    heap: Heap,
    counts: Annotated[Indices, COUNTS, OUT],
    figures: Annotated[Array, FIGURES, OUT],
    until: int,
) -> int:
    """Bound the smallest weighted error of the arm on its ball; the box with the smallest bound comes first.

    It may be called again to continue where it stopped, with the same result as without the stop.

    Args:
        shoulder: The arm on its ball, and its goal.
        boxes: The first COUNT rows are given.
        heap: Their bounds and order.
        counts: COUNT and the following constants, (COUNTS,).
        figures: CEILING is the upper limit for the bound of relevant boxes, and decreases if the ball does better. FLOOR
            receives the current bound, UPPER the smallest error found. (FIGURES,)
        until: Number of bounded boxes after which this call ends.

    Returns:
        ENDED, STOPPED or FULL.
    """
    n = boxes.centre.shape[1]
    scratch = make_ball_scratch(len(shoulder.invariants), n)
    c, h, share = scratch.c, scratch.h, scratch.share
    while counts[COUNT] > 0:
        row = heap.order[0]
        if heap.bound[row] >= figures[CEILING]:
            break
        if counts[SEEN] >= until:
            return STOPPED
        if counts[COUNT] + 1 >= len(boxes.cut):
            return FULL
        figures[FLOOR] = max(figures[FLOOR], heap.bound[row])
        cut = boxes.cut[row]
        if boxes.half[row, cut] < NARROW:
            return ENDED
        pop(heap, counts)
        below, above = heap.bound[row], multipliers_at(boxes.by[row])
        for i in range(n):
            c[i], h[i] = boxes.centre[row, i], boxes.half[row, i]
        middle, half = c[cut], 0.5 * h[cut]
        h[cut] = half + rounding(middle, half)
        for side in range(2):
            c[cut] = middle - half if side == 0 else middle + half
            found = bound_ball(shoulder, figures[CEILING], above, scratch)
            counts[SEEN] += 1
            if found.error < figures[UPPER]:
                figures[UPPER] = found.error
                if found.error < figures[CEILING]:
                    figures[CEILING] = COARSE * found.error
            bound = max(below, found.least)  # In this order NaN has no effect.
            if bound >= figures[CEILING]:
                continue
            free = free_row(heap, counts)
            cutting = 0
            for i in range(n):
                boxes.centre[free, i], boxes.half[free, i] = c[i], h[i]
                if share[i] > share[cutting]:
                    cutting = i
            boxes.cut[free], heap.bound[free] = cutting, bound
            write_multipliers(found.by, boxes.by[free])
            push(heap, counts)
    figures[FLOOR] = max(figures[FLOOR], figures[CEILING])
    return ENDED
