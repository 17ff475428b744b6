"""Every box of joint values, one after another, until none is left: then the goal is out of reach."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arrays import Array, ChainArrays, GoalArrays
from .bounds import first_order
from .boxes import (
    CHORD,
    HEAD,
    POSITION,
    Form,
    Wanted,
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
from .descent import approach
from .forms import separate, underestimate
from .forward import forward
from .gate import gate
from .jit import kernel
from .pose_error import errors, weighted_error
from .roll import Roll, cut_twist, roll_fits, twist_cost

ENDED, FOUND, STOPPED = 0, 1, 2

TRIAL = 16
"""Every so many boxes that are kept, steps from the middle of one look for an answer."""


class Search(NamedTuple):
    """How a search went."""

    outcome: int
    """ENDED: no box left; FOUND: `q` is within the tolerances; STOPPED: by the budget or by rounding."""
    boxes: int
    largest: float
    """Widest box that is left, the half width of its widest variable [rad] or [m]; 0 if none."""
    q: Array
    """(n,), the best joint values seen."""
    lower: float
    """Lower bound on the weighted error."""
    upper: float
    """Weighted error of `q`."""
    left: Array
    """Boxes that are left where the budget ended the search, (k, 2 dof), or with their bounds, (k, 2 dof + 1)."""
    stuck: float
    """Widest box that is left because it is as small as numbers allow, [rad] or [m]; 0 if none."""
    floor: float
    """Lower bound on the weighted error in such boxes; inf if none."""


@kernel
def exclude(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    boxes: Array,
    tuning: Array,
    budget: int,
) -> Search:
    """Look for any q within both tolerances, box after box, the last one first; none, if the gate is shut.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm, for the witness.
        goal: The goal as it was asked.
        boxes: Boxes to start with, (k, 2 dof): centres and half widths.
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look.
        budget: Boxes to examine.
    """
    dof, count, seen = boxes.shape[1] // 2, len(boxes), 0
    desk = make_desk(len(form.leader), dof)
    stack = np.empty((count + 64 * dof + 64, 2 * dof))
    for i in range(count):
        for j in range(2 * dof):
            stack[i, j] = boxes[i, j]
    q, T, best = np.zeros(len(chain.lower)), np.empty((3, 4)), np.inf
    trial = np.zeros(len(chain.lower))
    stuck, kept = 0.0, 0
    if not gate(form, wanted, chain)[0]:
        count = 0
    while count > 0 and seen < budget:
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
            near_p, near_c, desk.u[2] = desk.u[0], desk.u[1], 0.0
            if roll.present and not roll_fits(form, wanted, roll, desk):
                continue
            if volume(desk) < tuning[2] * before:
                store_box(stack, count, desk)
                count += 1
                continue
        i = widest(form, wanted, desk, HEAD)
        if desk.h[i] < 1e-10 * (1.0 + abs(desk.c[i])):
            stuck = max(stuck, desk.h[i])
            continue
        half = 0.5 * desk.h[i]
        centre = desk.c[i]
        desk.h[i] = half + 1e-15
        desk.c[i] = centre - half
        store_box(stack, count, desk)
        desk.c[i] = centre + half
        store_box(stack, count + 1, desk)
        count += 2
        kept += 1
        # Now and then, steps look for an answer. Wide tolerances may allow one in the middle, though no descent ends there.
        steps = 8 if spread < 1.5 and kept % TRIAL == 0 else 0
        if steps == 0 and (near_p > wanted.scalars[POSITION] or near_c > wanted.scalars[CHORD]):
            continue
        desk.c[i] = centre
        approach(form, wanted, roll, chain, steps, desk, trial)
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        error = weighted_error(T, goal)
        if error < best:
            best = error
            for j in range(len(q)):
                q[j] = trial[j]
        if position <= tuning[3] and orientation <= tuning[4]:
            return Search(FOUND, seen, 0.0, trial, 0.0, error, stack[:0].copy(), stuck, np.inf)
    largest = stuck
    for k in range(count):
        for i in range(dof):
            largest = max(largest, stack[k, dof + i])
    ended = count == 0 and stuck == 0.0
    floor = 0.0 if stuck > 0.0 else np.inf
    return Search(
        ENDED if ended else STOPPED, seen, largest, q, 0.0, best, stack[:count].copy(), stuck, floor
    )


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
        desk.out[1] = 0.0
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
            desk.out[1] += extra
            if kept and roll.present and ceiling < 0.0:
                kept = roll_fits(form, wanted, roll, desk)
        result[row, 0] = 1.0 if kept else 0.0
        result[row, 1] = desk.out[1]
        for i in range(dof):
            result[row, 2 + i] = desk.c[i]
            result[row, 2 + dof + i] = desk.h[i]
    return result
