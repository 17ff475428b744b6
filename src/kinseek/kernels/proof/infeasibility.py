"""Prove that a goal is unreachable: nothing in any box is within both tolerances."""

from __future__ import annotations

import math

from kinseek.kernels.jit import inlined

from .bounds import wide
from .box import BoxScratch
from .cone import separate_cone
from .form import separate
from .last_joint import roll_fits
from .progress import Question
from .taylor import miss

OFTEN = 16
"""After this number of cut boxes, steps from the middle of one look for a solution. Tried on goals near the boundary of
the workspaces of four arms: 14 % more boxes with twice the value. Not examined further."""
STEPS = 8
"""Number of these steps. If they do not come close to a solution, it is not in the box. With twice the value there were
0.5 % fewer boxes. Not examined further."""


@inlined
def exclude(question: Question, scratch: BoxScratch, passes: int) -> tuple[bool, bool]:
    """Cut off the parts of the current box that miss a tolerance, to second order.

    Returns:
        False if nothing is left; and whether the centre of the box meets the tolerances if only the best rotation by the
        last joint counts.
    """
    form, proof_goal = question.form, question.proof_goal
    kept = separate(form, proof_goal, scratch, passes)
    square_p, square_c = miss(scratch, form.columns)
    near = math.sqrt(square_p) <= proof_goal.position and math.sqrt(square_c) <= proof_goal.chord
    if kept and wide(form, proof_goal):
        kept = separate_cone(form, proof_goal, scratch, passes)
    if kept and question.roll.present:
        kept = roll_fits(form, proof_goal, question.roll, scratch)
    return kept, near
