"""Every box of joint values, one after another, until none is left: then the goal is out of reach.

All memory is the caller's: a kernel that hands a bundle of arrays to Python has Python build it, and where that is
interrupted there is nothing to hand back.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.jit import kernel

from .approach import approach
from .bounds import first_order
from .box import (
    BELOW,
    HEAD,
    MISS_COLUMNS,
    MISS_POINT,
    NARROW,
    NEAR,
    Form,
    Wanted,
    halve,
    load_box,
    make_desk,
    place,
    store_box,
    turn_goal,
    turned,
    volume,
    widest,
    widths,
)
from .form import separate, underestimate
from .gate import gate
from .last_joint import Roll, cut_twist, roll_fits, twist_cost

ENDED, FOUND, STOPPED, FULL = 0, 1, 2, 3
"""No box is left; an answer was found; as many boxes as were asked for have been examined; there is no room for more."""

TRIAL = 16
"""Every so many boxes that are kept, steps from the middle of one look for an answer."""
STEPS = 8
"""So many: an answer that they do not come close to is not in the box."""

# What a search counts, and what it knows; `enclosure` and `isolation` go on from here.
COUNT = 0  # Boxes that are left.
SEEN = 1  # Boxes examined.
KEPT = 2  # Boxes cut in half.
UPPER = 0  # Weighted error of the best joint values seen.
STUCK = 1  # Widest box that was given up as too narrow, [rad] or [m].


@kernel
def exclude(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    stack: Array,
    q: Array,
    tuning: Array,
    counts: Indices,
    figures: Array,
    until: int,
) -> int:
    """Look for any q within both tolerances, box after box, the last one first; none, if the gate is shut.

    It may be called again to go on where it stopped, and finds the same as if it had not stopped.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm, for the witness.
        goal: The goal as it was asked.
        stack: The boxes that are left, (room, 2 dof): centres and half widths.
        q: The best joint values seen are written here, the answer if one is found, (n,).
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look, tolerances.
        counts: COUNT, SEEN and KEPT, (3,).
        figures: UPPER and STUCK, (2,).
        until: Boxes that may have been examined by the end of this call.

    Returns:
        ENDED, FOUND, STOPPED or FULL.
    """
    dof, count, seen, kept = stack.shape[1] // 2, counts[COUNT], counts[SEEN], counts[KEPT]
    best, stuck, outcome = figures[UPPER], figures[STUCK], ENDED
    desk, T, trial = make_desk(len(form.leader), dof), np.empty((3, 4)), np.zeros(len(q))
    if not gate(form, wanted, chain)[0]:
        count = 0
    while count > 0:
        if seen >= until or count == len(stack):
            outcome = STOPPED if seen >= until else FULL
            break
        count -= 1
        load_box(stack, count, desk)
        seen += 1
        place(form, desk)
        widths(form, desk)
        if not first_order(form, wanted, desk, -1.0):
            continue
        spread, near_p, near_c = turned(form, desk, len(form.leader)), np.inf, np.inf
        before = volume(desk)
        if spread < tuning[0]:
            if not separate(form, wanted, desk, int(tuning[1])):
                continue
            near_p, near_c = desk.found[MISS_POINT], desk.found[MISS_COLUMNS]
            if roll.present and not roll_fits(form, wanted, roll, desk):
                continue
            if volume(desk) < tuning[2] * before:
                store_box(stack, count, desk)
                count += 1
                continue
        i = widest(form, wanted, desk, HEAD)
        if desk.h[i] < NARROW * (1.0 + abs(desk.c[i])):
            stuck = max(stuck, desk.h[i])
            continue
        halve(desk, i, stack, count, count + 1)
        count += 2
        kept += 1
        # Now and then, steps look for an answer. Wide tolerances may allow one in the middle, though no descent ends there.
        steps = STEPS if spread < NEAR and kept % TRIAL == 0 else 0
        if steps == 0 and (near_p > wanted.position or near_c > wanted.chord):
            continue
        approach(form, wanted, roll, chain, steps, desk, trial)
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        error = weighted_error(T, goal)
        met = position <= tuning[3] and orientation <= tuning[4]
        if met or error < best:
            best = error
            for j in range(len(q)):
                q[j] = trial[j]
        if met:
            outcome = FOUND
            break
    counts[COUNT], counts[SEEN], counts[KEPT] = count, seen, kept
    figures[UPPER], figures[STUCK] = best, stuck
    return outcome


@kernel
def examine(form: Form, wanted: Wanted, roll: Roll, boxes: Array, ceiling: float, passes: int) -> Array:
    """Test boxes one by one, without cutting them in half; for tests and pictures.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        boxes: (k, 2 dof): centres and half widths.
        ceiling: Weighted error to stay below, or negative: the tolerances decide.
        passes: Forms tried to second order; 0 leaves it at first order.

    Returns:
        Of each: 1 if anything may be left, else 0; lower bound of the weighted error; the box that is left, (k, 2 + 2 dof).
    """
    dof = boxes.shape[1] // 2
    desk = make_desk(len(form.leader), dof)
    result = np.empty((len(boxes), 2 + 2 * dof))
    for row in range(len(boxes)):
        load_box(boxes, row, desk)
        desk.found[BELOW] = 0.0
        place(form, desk)
        widths(form, desk)
        kept = first_order(form, wanted, desk, ceiling)
        if kept and ceiling >= 0.0 and form.tail == 1:
            kept = cut_twist(form, wanted, desk, ceiling)
        if kept and passes > 0:
            extra = 0.0
            if roll.present and ceiling >= 0.0:
                turn_goal(form, wanted, desk)
                widths(form, desk)
                extra = twist_cost(form, wanted, roll, desk, ceiling)
            if ceiling < 0.0:
                kept = separate(form, wanted, desk, passes)
            else:
                kept = extra <= ceiling and underestimate(form, wanted, desk, ceiling - extra)
            desk.found[BELOW] += extra
            if kept and roll.present and ceiling < 0.0:
                kept = roll_fits(form, wanted, roll, desk)
        result[row, 0] = 1.0 if kept else 0.0
        result[row, 1] = desk.found[BELOW]
        for i in range(dof):
            result[row, 2 + i] = desk.c[i]
            result[row, 2 + dof + i] = desk.h[i]
    return result
