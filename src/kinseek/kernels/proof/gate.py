"""Tests before any box: goals that the lengths and angles of the arm exclude for all joint values.

A rotation about an axis keeps the distance from any point of that axis, and the angle to the axis. The distance of the
hand from a point of each axis therefore lies in an interval. From the tip to the base this interval grows by the distance
between consecutive points (triangle inequality); at the base it is the annulus that the arm reaches. The angle between
each axis and a direction of the hand likewise lies in an interval, by the inequality of spherical triangles.
"""

from __future__ import annotations

import math

from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.jit import entry, inlined

from .box import Form, ProofGoal

CROSSED = 1e-4
"""sin² of the angle between two axes above which their common normal is used. Its foot is then at most a hundred lengths
away, so that rounding of its position stays within the margin."""


@inlined
def gate(form: Form, proof_goal: ProofGoal, chain: ChainArrays) -> tuple[bool, float]:
    """Return False if lengths and angles exclude both tolerances, and a lower bound of the weighted error."""
    far = max(
        out_of_annulus(form, proof_goal, chain, False), out_of_annulus(form, proof_goal, chain, True), 0.0
    )
    open_, error, chord = (  # Not excluded if a number is NaN.
        not far > proof_goal.position,
        proof_goal.weight_p * far,
        proof_goal.chord,
    )
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
    last = len(form.leader) - 1
    x, y, z = form.fixed[last + 1, 0, 3], form.fixed[last + 1, 1, 3], form.fixed[last + 1, 2, 3]
    low = high = 0.0
    for index in range(last + 1):
        k = last - index
        along, travel = z, 0.0
        if form.prismatic[k]:
            lower, upper = chain.lower[form.leader[k]], chain.upper[form.leader[k]]
            travel = 0.5 * abs(form.multiplier[k]) * (upper - lower)
            along += 0.5 * form.multiplier[k] * (lower + upper) + form.offset[k]
        elif normals and k < last:
            d0, d1, d2 = form.fixed[k + 1, 0, 2], form.fixed[k + 1, 1, 2], form.fixed[k + 1, 2, 2]
            apart = 1.0 - d2 * d2
            if apart > CROSSED:
                along = (z - d2 * (d0 * x + d1 * y + d2 * z)) / apart
        shift = 0.0 if form.prismatic[k] else z - along
        near = math.sqrt(x * x + y * y + shift * shift)
        wide = math.sqrt(near * near + travel * travel)
        low, high = max(low - wide, near - high, 0.0), high + wide
        F = form.fixed
        x = F[k, 0, 2] * along + F[k, 0, 3]
        y = F[k, 1, 2] * along + F[k, 1, 3]
        z = F[k, 2, 2] * along + F[k, 2, 3]
    goal = proof_goal.target
    d0, d1, d2 = goal[0, 3] - x, goal[1, 3] - y, goal[2, 3] - z
    far = math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    beyond: float = outside(far, low, high, proof_goal.trust) - proof_goal.margin
    return beyond


@inlined
def out_of_tilt(form: Form, proof_goal: ProofGoal, column: int) -> float:
    """Angle of a column of the goal outside the range that the angles between the axes allow [rad], negative inside."""
    last = len(form.leader) - 1
    F = form.fixed
    x, y, z = F[last + 1, 0, column], F[last + 1, 1, column], F[last + 1, 2, column]
    low = high = 0.0
    for index in range(last + 1):
        k = last - index
        if not form.prismatic[k]:
            angle = math.atan2(math.sqrt(x * x + y * y), z)
            least = max(angle - high, low - angle, 0.0)
            if high < math.pi - angle:
                high = angle + high
            else:
                high = math.pi if low <= math.pi - angle else 2.0 * math.pi - angle - low
            low, x, y, z = least, 0.0, 0.0, 1.0
        x, y, z = (
            F[k, 0, 0] * x + F[k, 0, 1] * y + F[k, 0, 2] * z,
            F[k, 1, 0] * x + F[k, 1, 1] * y + F[k, 1, 2] * z,
            F[k, 2, 0] * x + F[k, 2, 1] * y + F[k, 2, 2] * z,
        )
    g0, g1, g2 = proof_goal.target[0, column], proof_goal.target[1, column], proof_goal.target[2, column]
    c0, c1, c2 = y * g2 - z * g1, z * g0 - x * g2, x * g1 - y * g0
    angle = math.atan2(math.sqrt(c0 * c0 + c1 * c1 + c2 * c2), x * g0 + y * g1 + z * g2)
    beyond: float = outside(angle, low, high, proof_goal.trust) - proof_goal.margin_a
    return beyond


@inlined
def outside(value: float, low: float, high: float, trust: float) -> float:
    """Distance of a value outside an interval, negative inside; tests shrink the interval by `trust`."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low) * trust
    return abs(value - middle) - half
