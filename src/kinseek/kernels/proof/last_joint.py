"""The last joint, if it is divided out of the boxes: whether its limits allow the remaining rotation."""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arm.vectors import column, dot
from kinseek.kernels.jit import inlined

from .bounds import OF_ANGLES, cut_arc
from .box import BoxScratch, Form, ProofGoal, largest_rotation, place, short_way, turn_goal, widths


class LastJoint(NamedTuple):
    """The last joint, if it is divided out."""

    present: bool
    lower: float
    upper: float
    """Limits [rad]; at least a full turn apart if they are irrelevant."""
    weight: float
    """K_A if the joint's axis is the z axis of the tip, so that a twist costs ``K_A (1 + cos τ)(1 - cos β)``, else 0."""


@inlined
def best_twist(scratch: BoxScratch) -> tuple[float, float]:
    """Angle of the last joint that brings the other columns nearest to the goal's [rad], and cosine of the axis' tilt.

    It is the direction of a vector of length ``1 + cos τ`` with the tilt τ, and arbitrary if the axis points backwards.
    """
    T, goal = scratch.T, scratch.goal
    y, z, goal_y, goal_z = column(T, 1), column(T, 2), column(goal, 1), column(goal, 2)
    angle = math.atan2(dot(z, goal_y) - dot(y, goal_z), dot(y, goal_y) + dot(z, goal_z))
    return angle, dot(column(T, 0), column(goal, 0))


@inlined
def best_roll(roll: LastJoint, scratch: BoxScratch) -> float:
    """Value of the last joint at the best twist, without full turns beyond its limits [rad]."""
    best, _ = best_twist(scratch)
    value: float = nearest_copy(best, roll.lower, roll.upper, 0.5 * (roll.lower + roll.upper))
    return value


@inlined
def twist_noise(proof_goal: ProofGoal, tilt: float) -> float:
    """Largest error of the best twist by rounding, for an axis tilted by acos(tilt) [rad]; π if it is arbitrary.

    Every entry of the rotation may have an error of the margin. The vector whose direction is the best twist then has an
    error of 2√2 margins.
    """
    margin: float = proof_goal.margin_a
    length = 1.0 + tilt - 2.0 * margin
    # For longer vectors the bound below holds: asin(2√2/8) is less than 4/8.
    if not length > 8.0 * margin:
        return math.pi
    return 4.0 * margin / length + OF_ANGLES


@inlined
def twist_slack(proof_goal: ProofGoal, omega: float, tilt: float) -> float:
    """Largest change of the best twist if the others rotate by omega, for a tilt of acos(tilt) [rad]; π if arbitrary.

    The twist part of a unit quaternion has the length cos(τ/2) with the tilt τ. It changes by at most the change of the
    quaternion, 2 sin(Ω/4).
    """
    moved = 2.0 * math.sin(0.25 * min(omega, math.pi)) * proof_goal.trust
    # Not its root: near zero the error of the root is the root of the margin.
    square = 0.5 * (1.0 + tilt) - proof_goal.margin_a
    if not (omega < math.pi and moved * moved < square):
        return math.pi
    return min(2.0 * math.asin(moved / math.sqrt(square)) + twist_noise(proof_goal, tilt), math.pi)


@inlined
def roll_fits(form: Form, proof_goal: ProofGoal, roll: LastJoint, scratch: BoxScratch) -> bool:
    """Return False if no value of the last joint within its limits gives the remaining rotation.

    The hand without its last rotation is off by a rotation of at most Ω. Write the required rotation as a quaternion: its
    part about the last axis has the length cos(τ/2) with the tilt τ. The last joint is therefore within
    ``2 acos(cos(Ω/2)/cos(τ/2))``.
    """
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    if half >= math.pi:
        return True
    best, tilt = best_twist(scratch)
    omega, margin = proof_goal.angle + proof_goal.margin_a, proof_goal.margin_a
    omega += largest_rotation(form, scratch, len(form.leader))
    noise = twist_noise(proof_goal, tilt)
    if not (omega < math.pi and noise < math.pi):
        return True
    # Margins on both sides: near one, the error of the angle is the root of the error of the ratio.
    ratio = (math.cos(0.5 * omega) - margin) / math.sqrt(0.5 * (1.0 + tilt) + margin)
    miss = 2.0 * math.acos(min(ratio, 1.0)) + noise
    return not abs(short_way(best - middle)) > half + miss


@inlined
def twist_cost(
    form: Form, proof_goal: ProofGoal, roll: LastJoint, scratch: BoxScratch, ceiling: float
) -> float:
    """Smallest increase of the weighted error by the limits of the last joint; errors above `ceiling` are equivalent.

    With tilt τ and a twist β short of the best one the columns cost ``K_A [(1 - cos τ) + (1 + cos τ)(1 - cos β)]``.
    """
    middle, half = 0.5 * (roll.lower + roll.upper), 0.5 * (roll.upper - roll.lower)
    if half >= math.pi or roll.weight == 0.0:
        return 0.0
    best, tilt = best_twist(scratch)
    slack = twist_slack(proof_goal, largest_rotation(form, scratch, len(form.leader)), tilt)
    beta = abs(short_way(best - middle)) - half - slack
    if not beta > 0.0:
        return 0.0
    return max(2.0 * roll.weight - ceiling, 0.0) * 2.0 * math.sin(0.5 * beta) ** 2


@inlined
def cut_twist(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> bool:
    """Cut the range of a last joint that is part of the box to what the ceiling allows; return False if nothing is left.

    The arm is placed again at the centre of the remaining box. A twist β short of the best one rotates the hand by at
    least β, which costs at least ``K_A (1 - cos β)``.

    The best twist is computed as in `best_twist`, from the part of the rotation normal to the axis. The quaternion's real
    part and its part along the axis would give it as well. But if the hand is half a turn away from the goal, both are
    noise when computed from traces: the twist may then be arbitrary although the axis is not tilted.
    """
    T, goal, last, K_A = scratch.T, scratch.goal, len(form.leader) - 1, proof_goal.weight_a
    axis = scratch.z[last]
    turn_goal(form, proof_goal, scratch)
    widths(form, scratch)
    if ceiling >= 2.0 * K_A:
        return True
    trace = normal = along = (
        0.0  # Of the rotation T goalᵀ: its trace, and its parts normal to the axis and along it.
    )
    for r in range(3):
        after, behind = (r + 1) % 3, (r + 2) % 3
        for s in range(3):
            entry = T[r, 0] * goal[s, 0] + T[r, 1] * goal[s, 1] + T[r, 2] * goal[s, 2]
            trace += entry if r == s else 0.0
            along += axis[r] * entry * axis[s]
        for i in range(3):
            normal += axis[r] * (T[behind, i] * goal[after, i] - T[after, i] * goal[behind, i])
    # acos(1 - x) loses what is below the rounding of one; the half-angle form with a margin does not.
    beta = 2.0 * math.asin(math.sqrt(min(0.5 * ceiling / K_A + proof_goal.margin_a, 1.0)))
    beta += twist_slack(proof_goal, largest_rotation(form, scratch, last), along)
    # For a rotation β about the axis itself these two are 2 sin β and 2 cos β.
    ahead = math.atan2(normal, trace - along)
    left = cut_arc(scratch, form.leader[last], scratch.c[form.leader[last]] - ahead, beta)
    place(form, scratch)
    widths(form, scratch)
    return left
