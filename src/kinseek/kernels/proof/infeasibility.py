"""Prove that a goal is unreachable: nothing in any box is within both tolerances."""

from __future__ import annotations

from kinseek.kernels.jit import ir_inlined

from .bounds import wide
from .box import (
    BoxScratch,
    Form,
    ProofGoal,
)
from .cone import separate_cone
from .form import separate
from .last_joint import LastJoint, roll_fits

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
