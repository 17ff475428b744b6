"""Lower bound of the error of an arm whose first two joints are replaced by a ball joint, in the other joints alone.

Remove the first two joints, and put a ball joint on the second axis instead. It can make every motion that the arm can
make, so its smallest error is a lower bound. It equals the error of the arm if the first three axes meet in a point and
no limit of these joints is active. On other arms it may be smaller. A nearest pose of seven joints lies on a curve, the
self-motion of the arm, along which boxes of joint values accumulate. Here most of that curve is divided out.

Let p be the tip as seen from the ball, a the relevant column of the hand, and g and b their goals. The rotation of the
ball does not change ``s = |p|²`` and ``u = p·a``, and only these two matter: if the ball moves the tip to z and the
column to α, then ``s = |z|²`` and ``u = z·α``. For any multipliers λ and μ (Lagrange's dual; Rockafellar 1970, §28)::

    E ≥ λ s + μ u + least over z, |α| = 1 of  K_P |z - g| + K_A (1 - α·b) - λ |z|² - μ z·α.

The minimum over α leaves ``-|K_A b + μ z|``, which is at least ``-(|K_A b + μ z|² + m²)/(2 m)`` for any m > 0. All but
the first term is then a polynomial in z with the same curvature in all directions, and its minimum over all z with
``|z - g| ≤ ceiling / K_P`` is known; without this condition a positive λ gives minus infinity. A bound thus needs a few
products. Any multipliers give one, and those that describe how the error grows with s and u mostly give the error itself.

If the axes do not intersect, the ball is on the first one, and the second joint is one of the others. A rotation about
the first axis, e, then also keeps ``p·e`` and ``a·e``. With multipliers η and θ for these two the bound is that of the
arm itself, except for the limits of its first joint and for its mirror image. If both are 0, it is that of the ball.

All invariants are of first degree in the cosine and the sine of every joint, so their ranges in a box are known
(`kernels.proof.products`). `kernels.proof.multipliers` finds good multipliers.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .box import rounding
from .branch_and_bound import pop, push
from .memory import Heap
from .multipliers import (
    Shoulder,
    bound_by_single_joints,
    dual_value,
    improve_multipliers,
    multiply,
    rotate_onto_goal,
    take_better,
)
from .products import Sheet, make_sheet, most_above, product_ranges, recentre
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


@inlined
def bound_ball(
    shoulder: Shoulder, ceiling: float, c: Array, h: Array, above: Array, sheet: Sheet
) -> tuple[float, float]:
    """A lower bound of the weighted error in a box, and the error at its middle, over all rotations of the ball.

    Args:
        shoulder: The arm on its ball, and its goal.
        ceiling: Errors above this are equivalent.
        c: Centre of the box, (n,) [rad].
        h: Its half widths, (n,) [rad].
        above: Multipliers that may be good ones, (5,); m = 0 for none.
        sheet: Scratch memory. It keeps the multipliers, and the share of every joint in the loss of the bound in the box.
    """
    terms, by, ends, kinds = sheet.terms, sheet.by, sheet.ends, len(shoulder.invariants)
    for k in range(kinds):
        recentre(shoulder.invariants[k], c, terms[k])
    product_ranges(h, sheet.ranges)
    for i in range(len(h)):
        wide = min(h[i], math.pi)
        ends[i, 0], ends[i, 1], ends[i, 2] = wide, math.cos(wide), math.sin(wide)
    # K_P times a larger distance from the goal would exceed the ceiling.
    s, u, reach = max(terms[0, 0], 0.0), terms[1, 0], ceiling / shoulder.weight_p + shoulder.margin
    error = ball = rotate_onto_goal(shoulder, shoulder.plane, s, u, 0.0, 0.0, sheet.place)
    multiply(shoulder, shoulder.plane, sheet.place, False, by)
    best = bound_by_single_joints(shoulder, reach, sheet, by)
    if kinds > 2:
        error = rotate_onto_goal(shoulder, shoulder.goal, s, u, terms[2, 0], terms[3, 0], sheet.place)
        multiply(shoulder, shoulder.goal, sheet.place, True, sheet.upright)
        best = take_better(shoulder, reach, sheet, sheet.upright, best)
    bound = settled_bound(shoulder, reach, sheet, sheet.share)
    if bound < ceiling:
        if above[4] > 0.0:
            take_better(shoulder, reach, sheet, above, best)
        improve_multipliers(shoulder, reach, AMPLE * ceiling, sheet)
        bound = max(bound, settled_bound(shoulder, reach, sheet, sheet.other))
        if ball < ceiling and kinds > 2:
            # The ball alone would reach the ceiling at the middle, so the joints that matter for the first axis must
            # become narrower.
            for k in range(5):
                sheet.trial[k], by[k] = by[k], sheet.upright[k]
            settled_bound(shoulder, reach, sheet, sheet.share)
            for k in range(5):
                by[k] = sheet.trial[k]
        else:
            for i in range(len(h)):
                sheet.share[i] += sheet.other[i]
    return bound, error


@inlined
def settled_bound(shoulder: Shoulder, reach: float, sheet: Sheet, share: Array) -> float:
    """The bound that the multipliers give in the box; `share`, (n,), receives the share of each joint in its loss."""
    terms, by, kinds = sheet.terms, sheet.by, len(shoulder.invariants)
    bound = dual_value(shoulder, reach, terms, by)
    for t in range(terms.shape[1]):
        value = 0.0
        for k in range(kinds):
            value -= by[k] * terms[k, t]
        terms[kinds, t] = value
    bound -= shoulder.trust * most_above(terms[kinds], sheet, share)
    K_P, K_A, size, m = shoulder.weight_p, shoulder.weight_a, shoulder.size, by[4]
    bound -= K_P * shoulder.margin + 2.0 * K_A * shoulder.margin_a
    parts = K_A + abs(by[1]) * size + abs(by[3])
    lengths = (abs(by[0]) * size + 2.0 * abs(by[1]) + 2.0 * abs(by[2]) + K_P) * size
    # Every factor of a product may have an error; the products are no larger than this product.
    widest = 1.0
    for i in range(len(share)):
        wide, cosine, sine = sheet.ends[i, 0], sheet.ends[i, 1], sheet.ends[i, 2]
        widest *= 2.0 - cosine + (sine if wide < 0.5 * math.pi else 1.0)
    sums = abs(by[0]) * size * size + (abs(by[1]) + abs(by[2])) * size + abs(by[3])
    bound -= OF_PARTS * (lengths + 2.0 * abs(by[3]) + parts * parts / m + m)
    settled: float = bound - shoulder.rounding * widest * sums
    return settled


@entry
def enclose_ball(
    shoulder: Shoulder,
    boxes: Annotated[Array, "room", "*", OUT],
    heap: Heap,
    counts: Annotated[Indices, COUNTS, OUT],
    figures: Annotated[Array, FIGURES, OUT],
    until: int,
) -> int:
    """Bound the smallest weighted error of the arm on its ball; the box with the smallest bound comes first.

    It may be called again to continue where it stopped, with the same result as without the stop.

    Args:
        shoulder: The arm on its ball, and its goal.
        boxes: Centres, half widths, the joint to be cut and multipliers, (room, 2 n + 6); the first COUNT rows are given.
        heap: Their bounds and order.
        counts: COUNT and the following constants, (COUNTS,).
        figures: CEILING is the upper limit for the bound of relevant boxes, and decreases if the ball does better. FLOOR
            receives the current bound, UPPER the smallest error found. (FIGURES,)
        until: Number of bounded boxes after which this call ends.

    Returns:
        ENDED, STOPPED or FULL.
    """
    n = (boxes.shape[1] - 6) // 2
    c, h, above, sheet = np.empty(n), np.empty(n), np.empty(5), make_sheet(len(shoulder.invariants), n)
    while counts[COUNT] > 0:
        row = heap.order[0]
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
        pop(heap, counts)
        below, middle, half = heap.bound[row], boxes[row, cut], 0.5 * boxes[row, n + cut]
        for i in range(n):
            c[i], h[i] = boxes[row, i], boxes[row, n + i]
        for k in range(5):
            above[k] = boxes[row, 2 * n + 1 + k]
        h[cut] = half + rounding(middle, half)
        for side in range(2):
            c[cut] = middle - half if side == 0 else middle + half
            bound, error = bound_ball(shoulder, figures[CEILING], c, h, above, sheet)
            counts[SEEN] += 1
            if error < figures[UPPER]:
                figures[UPPER] = error
                if error < figures[CEILING]:
                    figures[CEILING] = COARSE * error
            bound = max(below, bound)  # In this order NaN has no effect.
            if bound >= figures[CEILING]:
                continue
            free, cutting = push(heap, counts, bound), 0
            for i in range(n):
                boxes[free, i], boxes[free, n + i] = c[i], h[i]
                if sheet.share[i] > sheet.share[cutting]:
                    cutting = i
            for k in range(5):
                boxes[free, 2 * n + 1 + k] = sheet.by[k]
            boxes[free, 2 * n] = cutting
    figures[FLOOR] = max(figures[FLOOR], figures[CEILING])
    return ENDED
