"""Gauss-Newton steps within the limits from the middle of a box to a solution nearby."""

from __future__ import annotations

from kinseek.kernels.arm.division import TURN
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.jit import inlined, ir_inlined

from .box import LEAST, BoxScratch, Form, ProofGoal, place, turn_goal
from .last_joint import LastJoint, complete, roll_fits
from .taylor import differentiate, downhill, normal_matrix, solve

DAMPING = 1e-9
"""Added to the diagonal of the normal matrix, whose entries are about one if a joint moves the hand by `ProofGoal.length`.

It keeps steps finite in directions in which no joint moves the hand. It is too small to slow down other steps: the error
falls to a fraction of about 1e-9 per step at best, and three steps meet every tolerance. Twice the value changes that to
2e-9.
"""


@inlined
def step(form: Form, proof_goal: ProofGoal, scratch: BoxScratch) -> None:
    """Write the Gauss-Newton step from the middle of the box to the goal into ``scratch.delta``."""
    scale = 1.0 / (proof_goal.length * proof_goal.length + LEAST)
    weight = 1.0 if form.columns > 0 else 0.0
    place(form, scratch)
    turn_goal(form, proof_goal, scratch)
    differentiate(form, scratch, 0, form.columns)
    normal_matrix(form, scratch, scale, weight, form.columns)
    downhill(form, scratch, scale, weight, form.columns)
    for i in range(len(scratch.c)):
        scratch.D[i] = DAMPING
    solve(scratch.N, scratch.D, scratch.delta)


@ir_inlined
def approach(
    form: Form,
    proof_goal: ProofGoal,
    roll: LastJoint,
    chain: ChainArrays,
    steps: int,
    scratch: BoxScratch,
    q: Array,
) -> None:
    """Make Gauss-Newton steps from the middle of the box; write the resulting joint values, (n,), within the limits."""
    for _ in range(steps):
        step(form, proof_goal, scratch)
        for i in range(len(scratch.c)):
            scratch.c[i] += scratch.delta[i]
            if i > 0 or form.head != TURN:
                scratch.c[i] = min(max(scratch.c[i], chain.lower[i]), chain.upper[i])
    place(form, scratch)
    turn_goal(form, proof_goal, scratch)
    if roll.present:
        roll_fits(form, proof_goal, roll, scratch)
    complete(form, roll, chain, scratch, q)
