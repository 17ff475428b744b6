"""The linear form that bounds the weighted error in a box best to first order: the dual of a shortest step in the box.

To first order the error after a step δ is ``v = f + J δ``. No step in the box reduces the error
``K_P |v_p| + ½ K_A |v_c|²`` below its minimum there. At that step the form ``y = (K_P v_p/|v_p|, K_A v_c)`` bounds the
error from below by the same value (convex duality; Rockafellar 1970, §31). Any other form gives a weaker bound, so the
step need not be exact. It is improved until the bound of its form is close to its error, or until its error is so low
that no form can exclude the box.
"""

from __future__ import annotations

import math

from kinseek.kernels.arm.vectors import Vector, column, cross, dot, norm, plus, row, scaled, write_column
from kinseek.kernels.jit import inlined

from .box import TINY, BoxScratch, Form, ProofGoal, largest_rotation
from .taylor import normal_matrix, slope, solve, squares_of, step_miss, weight_miss

STEPS = 6
"""Largest number of steps. Not examined further."""

CLOSE = 0.02
"""Steps end if the bound is this close to the error of the step, relative to it. Not examined further."""

SOFT = 0.03
"""Fraction of the normal matrix, scaled with the width of the box, that is added to its diagonal. Without it steps
oscillate. Not examined further."""

BLUNT = 1e-3
"""Distance, in units of the ceiling, at which the length of v_p is rounded off, because its direction jumps at zero. Not
examined further."""


@inlined
def support(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, ceiling: float) -> None:
    """Write the form of a nearly optimal step in the box into ``scratch.y``; the norm of its point part is at most K_P.

    It is weighted least squares with the weight ``K_P/|v_p|`` for the point, which follows the step. Newton steps move
    the variables that are not fixed at an end of their range, and are truncated at the ends.
    """
    dof, columns, h, N = len(scratch.c), form.columns, scratch.h, scratch.N
    delta, correction = scratch.delta, scratch.correction
    K_P, K_A = proof_goal.weight_p, proof_goal.weight_a if columns > 0 else 0.0
    for i in range(dof):
        delta[i] = 0.0
    for attempt in range(STEPS):
        step_miss(form, scratch, columns)
        square_p, square_c = squares_of(scratch.y, columns)
        far = math.sqrt(square_p)
        weight_p = K_P / (far + BLUNT * ceiling / K_P + TINY)
        weight_miss(scratch, weight_p, K_A, columns)
        square_c += count_side(proof_goal, scratch)
        slope(form, scratch, columns, scratch.slope)
        reached, short = K_P * far + 0.5 * K_A * square_c, 0.0
        for i in range(dof):
            # The gap between the error of the step and the bound of its form (Frank and Wolfe 1956).
            short += abs(scratch.slope[i]) * h[i] + scratch.slope[i] * delta[i]
        if attempt + 1 == STEPS or (attempt > 0 and (reached < ceiling or short < CLOSE * reached)):
            return
        normal_matrix(form, scratch, weight_p, K_A, columns)
        soft = 0.0
        for i in range(dof):
            soft += N[i, i] * h[i] * h[i]
        soft *= SOFT / dof
        for i in range(dof):
            scratch.D[i] = soft / (h[i] * h[i])
            correction[i] = -scratch.slope[i]
            if abs(delta[i]) >= h[i] and scratch.slope[i] * delta[i] < 0.0:  # Fixed at an end.
                for j in range(dof):
                    N[i, j] = N[j, i] = 0.0
                N[i, i] = 1.0
                correction[i] = 0.0
        solve(N, scratch.D, correction)
        for i in range(dof):
            delta[i] = min(max(delta[i] + correction[i], -h[i]), h[i])


@inlined
def count_side(proof_goal: ProofGoal, scratch: BoxScratch) -> float:
    """Add the part of a second column of the hand, if it counts, to the form; return its contribution to ``|v_c|²``.

    Let x be the last joint's axis, and let the columns x and y of the hand count. The best rotation about x makes y·y_g
    equal to ``√(1 - (x·y_g)²)``. The second column therefore costs at least ``½ K_A (x·y_g)²``, as if v_c counted twice
    along y_g.
    """
    if proof_goal.side_y == 0.0 and proof_goal.side_z == 0.0:
        return 0.0  # K_A may be 0 then.
    beside, y = side(proof_goal, scratch), column(scratch.y, 0)
    along = dot(beside, y)
    write_column(plus(y, scaled(along, beside)), scratch.y, 0)
    added: float = along * along / (proof_goal.weight_a * proof_goal.weight_a)
    return added


@inlined
def side(proof_goal: ProofGoal, scratch: BoxScratch) -> Vector:
    """The goal's second relevant column, or zero if there is none."""
    return plus(
        scaled(proof_goal.side_y, column(scratch.goal, 1)),
        scaled(proof_goal.side_z, column(scratch.goal, 2)),
    )


@inlined
def gain_of_side(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, middle: int) -> float:
    """Contribution of a second relevant column to the bound; returns its value and adds its slope to ``scratch.g``.

    It reduces the conjugate of the form by ``b²/(4 K_A)``, where b is the component of y_c along the goal's column. Seen
    from halfway, that column rotates with the proximal joints: ``b(δ)² ≥ b² + 2 b (b(δ) - b)``, to second order in their
    widths.
    """
    if proof_goal.side_y == 0.0 and proof_goal.side_z == 0.0:
        return 0.0
    beside, y = side(proof_goal, scratch), column(scratch.y, 0)
    b, across = dot(beside, y), cross(beside, y)
    half, turn = 0.5 / proof_goal.weight_a, largest_rotation(form, scratch, middle)
    for k in range(middle):
        if not form.prismatic[k]:
            slope = dot(row(scratch.z, k), across)
            scratch.g[form.leader[k]] -= half * b * form.multiplier[k] * slope
    rest = 0.5 * abs(b) * norm(y) * turn * turn
    gain: float = half * (0.5 * b * b - proof_goal.trust * rest)
    return gain
