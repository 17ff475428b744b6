"""Gauss-Newton steps within the limits from the middle of a box to a solution nearby: ``δ = -(JᵀWJ + d)⁻¹ JᵀWf``."""

from __future__ import annotations

from kinseek.kernels.arm.division import TURN, nearest_copy
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .box import LEAST, BoxScratch, Form, ProofGoal, place, turn_goal
from .last_joint import best_roll
from .progress import Question
from .taylor import differentiate, shrink_miss

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
    for i in range(len(scratch.c)):
        scratch.D[i] = DAMPING
    shrink_miss(form, scratch, scale, weight, form.columns)


@inlined
def complete(question: Question, scratch: BoxScratch, q: Array) -> None:
    """Write the joint values of the box' centre, (n,), within the limits; a last joint that is divided out fits best."""
    chain, roll, form = question.chain, question.roll, question.form
    for i in range(len(q)):
        lower, upper = chain.lower[i], chain.upper[i]
        value = best_roll(roll, scratch) if roll.present and i == len(q) - 1 else scratch.c[i]
        if (i == 0 and form.head == TURN) or (i == len(q) - 1 and form.tail == 1):
            value = nearest_copy(value, lower, upper, 0.5 * (lower + upper))
        q[i] = min(max(value, lower), upper)


@inlined
def approach(question: Question, scratch: BoxScratch, steps: int, q: Array) -> None:
    """Make Gauss-Newton steps from the middle of the box; write the resulting joint values, (n,), within the limits."""
    form, proof_goal, chain = question.form, question.proof_goal, question.chain
    for _ in range(steps):
        step(form, proof_goal, scratch)
        for i in range(len(scratch.c)):
            scratch.c[i] += scratch.delta[i]
            if i > 0 or form.head != TURN:
                scratch.c[i] = min(max(scratch.c[i], chain.lower[i]), chain.upper[i])
    place(form, scratch)
    turn_goal(form, proof_goal, scratch)
    complete(question, scratch, q)
