"""The linear form at the edge of a wide cone, for goals that allow the hand's axis in a wide cone about the goal's.

`form.separate` uses a ball about the tip of the goal's axis. This ball contains the cone, but is much larger. For an axis
a and the goal's g the cone is ``a·g ≥ cos τ``, one number that is linear in a. The form combines the hand's point and
this number. It is found as in `form.separate`, by steps that the box limits; the number counts only while the step leaves
it too small. The goal's axis must be constant, so all joints move the hand, and remainders are larger than seen from
halfway. With both forms half as many boxes are needed as with this one alone.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.vectors import column, dot
from kinseek.kernels.jit import inlined

from .box import TINY, BoxScratch, Form, ProofGoal, place, turn_goal, widths
from .form import Expansion, Slacks, cut_box, sizes, touch, weigh
from .taylor import differentiate, downhill, normal_matrix, rests, solve, step_miss


@inlined
def steepness(form: Form, scratch: BoxScratch) -> None:
    """Write the slope of ``-a·g``, which grows as the hand's axis moves away from the goal's, into ``scratch.slope``."""
    goal = scratch.goal
    for i in range(len(scratch.c)):
        scratch.slope[i] = 0.0
    for k in range(len(form.leader)):
        slope = 0.0
        for r in range(3):
            slope += goal[r, 0] * scratch.J[k, r, 0]
        scratch.slope[form.leader[k]] -= form.multiplier[k] * slope


@inlined
def separate_cone(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, passes: int) -> bool:
    """Look for a form that separates the box from the goal's point and cone; cut the box; return False if nothing is left.

    For every w ≥ 0 and every y, ``y·(p - p_g) + w (cos τ - a·g)`` is at most ``|y|`` times the tolerance where both
    tolerances are met.
    """
    place(form, scratch)  # Previous tests may have cut the box.
    turn_goal(form, proof_goal, scratch)
    widths(form, scratch)
    differentiate(form, scratch, 0, 1)
    rest = rests(form, scratch, scratch.r, 0)
    # The point that lies back along the column is the tip: only `gap=` moves it, and it is not for cones.
    seen = Expansion(0, rest, rest.three_p)
    T, goal, dof = scratch.T, scratch.goal, len(scratch.c)
    edge = math.cos(min(proof_goal.angle, math.pi))
    short = edge - dot(column(T, 0), column(goal, 0))
    # As a form of the difference of the axes it is -w g·(a - g), and at most w (1 - cos τ) in the cone.
    slack_p, slack_c = proof_goal.position + proof_goal.margin, 1.0 - edge + proof_goal.margin_a
    weight_p = 1.0 / ((rest.two_p * 0.5 + slack_p) * (rest.two_p * 0.5 + slack_p))
    sharp = 1.0 / ((rest.two_c * 0.5 + proof_goal.margin_a) * (rest.two_c * 0.5 + proof_goal.margin_a))
    weight_c = sharp if short > 0.0 else 0.0
    for i in range(dof):
        scratch.D[i] = 1.0 / (scratch.h[i] * scratch.h[i])
    for attempt in range(passes):
        normal_matrix(form, scratch, weight_p, 0.0, 0)
        downhill(form, scratch, weight_p, 0.0, 0)
        steepness(form, scratch)
        for i in range(dof):
            scratch.delta[i] -= weight_c * short * scratch.slope[i]
            for j in range(i + 1):
                scratch.N[i, j] += weight_c * scratch.slope[i] * scratch.slope[j]
        solve(scratch.N, scratch.D, scratch.delta)
        step_miss(form, scratch, 0)
        beyond = short
        for i in range(dof):
            beyond += scratch.slope[i] * scratch.delta[i]
        size_c = weight_c * max(beyond, 0.0)
        for r in range(3):
            scratch.y[r, 3] *= weight_p
            scratch.y[r, 0] = -size_c * goal[r, 0]
        surplus = weigh(form, proof_goal, scratch, seen, Slacks(slack_p, slack_c))
        if surplus > 0.0:
            return False
        if attempt + 1 == passes:
            cut_box(scratch, -surplus)
            break
        # Weights as in `separate`: they make the ellipsoid touch the box where this form touched it.
        size_p, _ = sizes(form, scratch)
        touch(scratch, TINY + size_p * slack_p)
        weight_p = (size_p + TINY) / (slack_p + rest.three_p)
        weight_c = size_c / (proof_goal.margin_a + rest.three_c)
        if size_c == 0.0 and beyond > 0.0:
            weight_c = sharp
    return True
