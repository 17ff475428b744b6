"""Tests before any box: goals that the lengths and angles of the arm exclude for all joint values.

A rotation about an axis keeps the distance from any point of that axis, and the angle to the axis. The distance of the
hand from a point of each axis therefore lies in an interval. From the tip to the base this interval grows by the distance
between consecutive points (triangle inequality); at the base it is the annulus that the arm reaches. The angle between
each axis and a direction of the hand likewise lies in an interval, by the inequality of spherical triangles.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.vectors import Vector, column, cross, dot, minus, norm, plus, rotated, scaled
from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.jit import entry, inlined

from .box import Form, ProofGoal

CROSSED = 1e-4
"""sin² of the angle between two axes above which their common normal is used. Its foot is then at most a hundred lengths
away, so that rounding of its position stays within the margin."""


@inlined
def gate(form: Form, proof_goal: ProofGoal, chain: ChainArrays) -> tuple[bool, float]:
    """Return False if lengths and angles exclude both tolerances, and a lower bound of the weighted error."""
    nearest = out_of_annulus(form, proof_goal, chain, False)
    far = max(nearest, out_of_annulus(form, proof_goal, chain, True), 0.0)
    open_ = not far > proof_goal.position  # Not excluded if a number is NaN.
    error, chord = proof_goal.weight_p * far, proof_goal.chord
    # For all columns together: the error of at least one column is no larger than this.
    if form.columns == 3:
        chord /= math.sqrt(2.0)
    for i in range(form.columns):
        tilt = 2.0 * math.sin(0.5 * max(out_of_tilt(form, proof_goal, i), 0.0))
        open_ = open_ and not tilt > chord
        error += 0.5 * proof_goal.weight_a * tilt * tilt
    return open_, error


@entry
def least_by_gate(form: Form, proof_goal: ProofGoal, chain: ChainArrays) -> float:
    """Lower bound of the weighted error from lengths and angles."""
    return gate(form, proof_goal, chain)[1]


@inlined
def out_of_annulus(form: Form, proof_goal: ProofGoal, chain: ChainArrays, normals: bool) -> float:
    """Distance of the goal's point outside the range that the lengths allow [m], negative inside.

    The point on each axis is the nearest to the next one, or the foot of the common normal.
    """
    last, fixed = len(form.leader) - 1, form.fixed
    point, low, high = column(fixed[last + 1], 3), 0.0, 0.0
    for index in range(last + 1):
        k = last - index
        along, shift, travel = point.z, 0.0, 0.0
        if form.prismatic[k]:
            lower, upper = chain.lower[form.leader[k]], chain.upper[form.leader[k]]
            travel = 0.5 * abs(form.multiplier[k]) * (upper - lower)
            along += 0.5 * form.multiplier[k] * (lower + upper) + form.offset[k]
        elif normals and k < last:
            axis = column(fixed[k + 1], 2)
            crossed = 1.0 - axis.z * axis.z
            if crossed > CROSSED:
                along = (point.z - axis.z * dot(axis, point)) / crossed
            shift = point.z - along
        near = norm(Vector(point.x, point.y, shift))
        wide = math.sqrt(near * near + travel * travel)
        # The triangle inequality for two distances, in [near, wide] and in [low, high].
        low, high = max(low - wide, near - high, 0.0), high + wide
        point = plus(scaled(along, column(fixed[k], 2)), column(fixed[k], 3))
    far = norm(minus(column(proof_goal.target, 3), point))
    beyond: float = outside(far, low, high, proof_goal.trust) - proof_goal.margin
    return beyond


@inlined
def out_of_tilt(form: Form, proof_goal: ProofGoal, c: int) -> float:
    """Angle of column c of the goal outside the range that the angles between the axes allow [rad], negative inside."""
    last, fixed = len(form.leader) - 1, form.fixed
    direction, low, high = column(fixed[last + 1], c), 0.0, 0.0
    for index in range(last + 1):
        k = last - index
        if not form.prismatic[k]:
            angle = math.atan2(math.sqrt(direction.x * direction.x + direction.y * direction.y), direction.z)
            least = max(angle - high, low - angle, 0.0)
            # Two directions enclose at most π: a sum of angles beyond that decreases again.
            if high < math.pi - angle:
                high = angle + high
            else:
                high = math.pi if low <= math.pi - angle else 2.0 * math.pi - angle - low
            low, direction = least, Vector(0.0, 0.0, 1.0)
        direction = rotated(fixed[k], direction)
    goal = column(proof_goal.target, c)
    angle = math.atan2(norm(cross(direction, goal)), dot(direction, goal))
    beyond: float = outside(angle, low, high, proof_goal.trust) - proof_goal.margin_a
    return beyond


@inlined
def outside(value: float, low: float, high: float, trust: float) -> float:
    """Distance of a value outside an interval, negative inside; tests shrink the interval by `trust`."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * trust
    return abs(value - middle) - half
