"""Prove that a goal is unreachable: nothing in any box is within both tolerances."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import ir_inlined, kernel

from .bounds import first_order, wide
from .box import (
    BELOW,
    BoxScratch,
    Form,
    ProofGoal,
    load_box,
    make_box_scratch,
    place,
    turn_goal,
    widths,
)
from .cone import separate_cone
from .form import separate, underestimate
from .last_joint import LastJoint, cut_twist, roll_fits, twist_cost

OFTEN = 16
"""After this number of cut boxes, steps from the middle of one look for a solution. Tried on goals near the boundary of
the workspaces of four arms: 14 % more boxes with twice the value. Not examined further."""
STEPS = 8
"""Number of these steps. If they do not come close to a solution, it is not in the box. With twice the value there were
0.5 % fewer boxes. Not examined further."""


@ir_inlined
def exclude(form: Form, proof_goal: ProofGoal, roll: LastJoint, scratch: BoxScratch, passes: int) -> bool:
    """Cut off the parts of the current box that miss a tolerance, to second order; return False if nothing is left."""
    kept = separate(form, proof_goal, scratch, passes)
    if kept and wide(form, proof_goal):
        kept = separate_cone(form, proof_goal, scratch, passes)
    if kept and roll.present:
        kept = roll_fits(form, proof_goal, roll, scratch)
    return kept


@kernel
def examine(
    form: Form, proof_goal: ProofGoal, roll: LastJoint, boxes: Array, ceiling: float, passes: int
) -> Array:
    """Test boxes one by one without splitting them, for tests and pictures.

    Args:
        form: The part of the arm that the boxes describe.
        proof_goal: The goal of the hand.
        roll: The last joint, if it is divided out.
        boxes: (k, 2 dof): centres and half widths.
        ceiling: Weighted error to stay below, or negative to test the tolerances.
        passes: Number of forms tried to second order; 0 for first-order tests only.

    Returns:
        For each box, (k, 2 + 2 dof): 1 if anything may be left, else 0; a lower bound of the weighted error; and the
        remaining box.
    """
    dof = boxes.shape[1] // 2
    scratch = make_box_scratch(len(form.leader), dof)
    result = np.empty((len(boxes), 2 + 2 * dof))
    for row in range(len(boxes)):
        load_box(boxes, row, scratch)
        scratch.found[BELOW] = 0.0
        place(form, scratch)
        widths(form, scratch)
        kept = first_order(form, proof_goal, scratch, ceiling)
        if kept and ceiling >= 0.0 and form.tail == 1:
            kept = cut_twist(form, proof_goal, scratch, ceiling)
        if kept and passes > 0:
            extra = 0.0
            if roll.present and ceiling >= 0.0:
                turn_goal(form, proof_goal, scratch)
                widths(form, scratch)
                extra = twist_cost(form, proof_goal, roll, scratch, ceiling)
            if ceiling < 0.0:
                kept = separate(form, proof_goal, scratch, passes)
                if kept and wide(form, proof_goal):
                    kept = separate_cone(form, proof_goal, scratch, passes)
            else:
                kept = not extra > ceiling and underestimate(form, proof_goal, scratch, ceiling - extra)
            scratch.found[BELOW] += extra
            if kept and roll.present and ceiling < 0.0:
                kept = roll_fits(form, proof_goal, roll, scratch)
        result[row, 0] = 1.0 if kept else 0.0
        result[row, 1] = scratch.found[BELOW]
        for i in range(dof):
            result[row, 2 + i] = scratch.c[i]
            result[row, 2 + dof + i] = scratch.h[i]
    return result
