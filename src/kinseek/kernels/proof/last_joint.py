"""The last joint, where it is divided out of the boxes: do its limits allow what is left of the rotation?"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.division import TURN, nearest_copy
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import F64, FLAG, Bundle
from kinseek.kernels.jit import inlined

from .bounds import OF_ANGLES, cut_arc
from .box import BEST_ROLL, BoxScratch, Form, ProofGoal, place, short_way, turn_goal, turned, widths


class LastJoint(NamedTuple):
    """The last joint, where it is divided out."""

    present: bool
    lower: float
    upper: float
    """Limits [rad]; at least a full turn apart where they do not matter."""
    weight: float
    """K_A where the joint's axis is the z axis of the tip, so that a twist costs ``K_A (1 + cos τ)(1 - cos β)``, else 0."""


ROLL = Bundle(LastJoint, present=FLAG, lower=F64, upper=F64, weight=F64)


@inlined
def best_twist(scratch: BoxScratch) -> tuple[float, float]:
    """The turn of the last joint that brings the other columns nearest to the goal's [rad]; cosine of the axis' tilt.

    It is the direction of a vector ``1 + cos τ`` long, τ the tilt: any direction where the axis points backwards.
    """
    T, goal = scratch.T, scratch.goal
    m00 = m01 = m10 = m11 = dot = 0.0
    for r in range(3):
        m00 += T[r, 1] * goal[r, 1]
        m01 += T[r, 1] * goal[r, 2]
        m10 += T[r, 2] * goal[r, 1]
        m11 += T[r, 2] * goal[r, 2]
        dot += T[r, 0] * goal[r, 0]
    return math.atan2(m10 - m01, m00 + m11), dot


@inlined
def twist_noise(proof_goal: ProofGoal, dot: float) -> float:
    """How far rounding may turn the best twist where the axis leans by acos(dot) [rad]; π: anything.

    Every entry of the rotation may be off by the margin, and so the vector whose direction the best twist is by 2√2 margins.
    """
    margin: float = proof_goal.margin_a
    length = 1.0 + dot - 2.0 * margin
    # Of a vector that is longer the bound below holds: asin(2√2/8) is less than 4/8.
    if not length > 8.0 * margin:
        return math.pi
    return 4.0 * margin / length + OF_ANGLES


@inlined
def twist_slack(proof_goal: ProofGoal, omega: float, dot: float) -> float:
    """How far the best twist may be off where the others turn by omega and the axis leans by acos(dot) [rad]; π: anything.

    The twist part of a unit quaternion is cos(τ/2) long, τ the tilt, and moves by no more than the quaternion does,
    2 sin(Ω/4).
    """
    moved = 2.0 * math.sin(0.25 * min(omega, math.pi)) * proof_goal.trust
    # Not its root: near zero that is off by the root of the margin.
    square = 0.5 * (1.0 + dot) - proof_goal.margin_a
    if not (omega < math.pi and moved * moved < square):
        return math.pi
    return min(2.0 * math.asin(moved / math.sqrt(square)) + twist_noise(proof_goal, dot), math.pi)


@inlined
def roll_fits(form: Form, proof_goal: ProofGoal, roll: LastJoint, scratch: BoxScratch) -> bool:
    """Can the last joint, within its limits, make up for what is left of the rotation? Its best value goes to BEST_ROLL.

    The hand without its last turn is off by a rotation of at most Ω. Write the turn that is asked for as a quaternion: its
    part about the last axis is cos(τ/2) long, τ the tilt. So the last joint is within ``2 acos(cos(Ω/2)/cos(τ/2))``.
    """
    best, dot = best_twist(scratch)
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    scratch.found[BEST_ROLL] = nearest_copy(best, roll.lower, roll.upper, middle)
    if half >= math.pi:
        return True
    omega, margin = proof_goal.angle + proof_goal.margin_a, proof_goal.margin_a
    omega += turned(form, scratch, len(form.leader))
    noise = twist_noise(proof_goal, dot)
    if not (omega < math.pi and noise < math.pi):
        return True
    # Margins on either side: near one, the angle is off by the root of what the ratio is off by.
    ratio = (math.cos(0.5 * omega) - margin) / math.sqrt(0.5 * (1.0 + dot) + margin)
    miss = 2.0 * math.acos(min(ratio, 1.0)) + noise
    return not abs(short_way(best - middle)) > half + miss


@inlined
def twist_cost(
    form: Form, proof_goal: ProofGoal, roll: LastJoint, scratch: BoxScratch, ceiling: float
) -> float:
    """What the limits of the last joint add to the weighted error at least, where nothing above `ceiling` matters.

    With tilt τ and a twist β short of the best one the columns cost ``K_A [(1 - cos τ) + (1 + cos τ)(1 - cos β)]``.
    """
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    if half >= math.pi or roll.weight == 0.0:
        return 0.0
    best, dot = best_twist(scratch)
    beta = (
        abs(short_way(best - middle))
        - half
        - twist_slack(proof_goal, turned(form, scratch, len(form.leader)), dot)
    )
    if not beta > 0.0:
        return 0.0
    return max(2.0 * roll.weight - ceiling, 0.0) * 2.0 * math.sin(0.5 * beta) ** 2


@inlined
def cut_twist(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> bool:
    """Cut the range of a last joint that is part of the box to what the ceiling leaves; say whether anything is left.

    The arm is placed anew, at the centre of what is left. A twist β short of the best one turns the hand by β at least,
    which costs ``K_A (1 - cos β)`` at least.

    The best twist is worked out as in `best_twist`, from what of the rotation lies across the axis. Of the quaternion's real
    part and its part along the axis it could be had as well, were these not both noise, as traces tell them, where the hand
    is half a turn away from the goal: then the twist may be anything though the axis does not lean at all.
    """
    T, goal, last, K_A = scratch.T, scratch.goal, len(form.leader) - 1, proof_goal.weight_a
    turn_goal(form, proof_goal, scratch)
    widths(form, scratch)
    if ceiling >= 2.0 * K_A:
        return True
    trace = dot = along = 0.0
    for r in range(3):
        after, behind = (r + 1) % 3, (r + 2) % 3
        for s in range(3):
            entry = T[r, 0] * goal[s, 0] + T[r, 1] * goal[s, 1] + T[r, 2] * goal[s, 2]
            trace += entry if r == s else 0.0
            along += scratch.z[last, r] * entry * scratch.z[last, s]
        for i in range(3):
            dot += scratch.z[last, r] * (T[behind, i] * goal[after, i] - T[after, i] * goal[behind, i])
    # acos(1 - x) loses what is below rounding of one: its half-angle form, and a margin, do not.
    beta = 2.0 * math.asin(math.sqrt(min(0.5 * ceiling / K_A + proof_goal.margin_a, 1.0)))
    beta += twist_slack(proof_goal, turned(form, scratch, last), along)
    ahead = math.atan2(dot, trace - along)
    left = cut_arc(scratch, form.leader[last], scratch.c[form.leader[last]] - ahead, beta)
    place(form, scratch)
    widths(form, scratch)
    return left


@inlined
def complete(form: Form, roll: LastJoint, chain: ChainArrays, scratch: BoxScratch, q: Array) -> None:
    """Joint values of the box' centre, (n,), inside the limits."""
    for i in range(len(q)):
        value = scratch.found[BEST_ROLL] if roll.present and i == len(q) - 1 else scratch.c[i]
        if (i == 0 and form.head == TURN) or (i == len(q) - 1 and form.tail == 1):
            middle = 0.5 * (chain.lower[i] + chain.upper[i])
            value = nearest_copy(value, chain.lower[i], chain.upper[i], middle)
        q[i] = min(max(value, chain.lower[i]), chain.upper[i])
