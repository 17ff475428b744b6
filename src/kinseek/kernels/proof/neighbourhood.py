"""Radius around a solution without another solution: Krawczyk's operator with Taylor polynomials, see `root_isolation`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import counted, inlined, kernel

from .box import LEAST, BoxScratch, Form, ProofGoal, load_box, make_box_scratch, place, turn_goal
from .taylor import derivatives, differentiate, miss, normal_matrix, rests, solve

LARGEST, SMALLEST = 0.5, 1e-7
"""Half width of the widest joint of a neighbourhood [rad] or [m]; sizes are tried from the largest down.

More than half of 76 solutions of six arms have one as wide as the largest, and the narrowest is 0.007. Margins are valid
up to the largest, see `contract`. Much below the smallest no boxes are left to examine. Not examined further.
"""

SHRINK, ROUNDS = 0.7, 4
"""Ratio of consecutive sizes, and number of shapes tried for each size. Each shape is the geometric mean of the last one
and its κ. They are tried once per solution, next to thousands of boxes. Not examined further."""

HOLDS = 0.999
"""κ(ρ) < ρ must hold with a margin of a thousandth: far more than rounding, and small enough to lose no neighbourhood."""

REPEATS = 60
"""Number of times that κ is applied to its own result, which is a bound after any number. More make it no smaller. Not
examined further."""

REGULAR = 1e-13
"""Added to the diagonal of the normal matrix, as a fraction of its trace. The inverse stays finite at singularities, and
elsewhere keeps twelve digits. The inequality holds for any inverse; twice the value changes the thirteenth digit of κ."""


ASKEW, MOST_ROTATION = 0.1, 1.4
"""Largest error of all columns of a solution at the centre, and largest rotation of hand and goal by the joints from
there [rad]. Together they stay below 90°, see `kernels.paths.tube`."""

REGULARLY, OFF = 1e-5, 1e-12
"""M is computed from the Jacobian as seen from halfway. It differs from the hand's own Jacobian by the error at the
centre, and by rounding, at most OFF. REGULARLY bounds this difference, times the inverse of the normal matrix and its
trace, times the ratio of the widths of two joints of the neighbourhood. The error of MJ is then less than a
thousandth, which `HOLDS` allows."""


class Expansion(NamedTuple):
    """``M f`` at a centre, one row for each joint variable."""

    value: Array
    """``|M f(c)|``, (n,)."""
    point: Array
    """Norm of the part of M for the point, (n,)."""
    column: Array
    """Norm of the part of M for the columns, (n,)."""
    slope: Array
    """``|1 - MJ|``, (n, n)."""
    bend: Array
    """``|M H|``, (n, n, n)."""
    half: Array
    """ρ, (n,)."""
    reach: Array
    """κ(ρ), (n,)."""
    rows: Array
    """M for the columns and the point, laid out as a pose, (n, 3, 4)."""
    gain: Array
    """Largest entry of the inverse of the normal matrix, times its trace; and the error of the hand at the centre, (2,)."""


@counted
def make_expansion(dof: int) -> Expansion:
    """Allocate the memory of one search."""
    return Expansion(
        np.zeros(dof),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((dof, dof)),
        np.zeros((dof, dof, dof)),
        np.zeros(dof),
        np.zeros(dof),
        np.zeros((dof, 3, 4)),
        np.zeros(2),
    )


@inlined
def expand(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, around: Expansion) -> None:
    """Invert the Jacobian at the centre, and write the products of the inverse with the hand's polynomial."""
    m, dof, T, goal, columns = len(form.leader), len(scratch.c), scratch.T, scratch.goal, form.columns
    place(form, scratch)
    turn_goal(form, proof_goal, scratch)
    scale = 1.0 / (proof_goal.length * proof_goal.length + LEAST)
    weight = 1.0 if columns > 0 else 0.0
    middle = m // 2
    differentiate(form, scratch, middle, columns)
    around.gain[0] = 0.0
    for row in range(dof):
        # `solve` overwrites the matrix.
        normal_matrix(form, scratch, scale, weight, columns)
        trace = 0.0
        for i in range(dof):
            trace += scratch.N[i, i]
        for i in range(dof):  # The inequality holds for any M; this keeps it finite.
            scratch.delta[i], scratch.D[i] = 0.0, REGULAR * trace + LEAST
        scratch.delta[row] = 1.0
        solve(scratch.N, scratch.D, scratch.delta)
        for i in range(dof):
            around.gain[0] = max(abs(scratch.delta[i]) * trace, around.gain[0])
        for i in range(4):
            for r in range(3):
                part = 0.0
                if i < columns or i == 3:
                    for k in range(m):
                        part += form.multiplier[k] * scratch.delta[form.leader[k]] * scratch.J[k, r, i]
                    part *= scale if i == 3 else weight
                around.rows[row, r, i] = part
    far, askew = miss(scratch, columns)
    around.gain[1] = math.sqrt(askew + far * scale)
    for row in range(dof):
        value = size = length = 0.0
        for i in range(4):
            for r in range(3):
                part = around.rows[row, r, i]
                scratch.y[r, i] = part
                if i < columns or i == 3:
                    value += part * (T[r, i] - goal[r, i])
                if i == 3:
                    length += part * part
                else:
                    size += part * part
        derivatives(form, scratch, middle, columns)
        around.value[row] = abs(value)
        around.point[row] = math.sqrt(length)
        around.column[row] = math.sqrt(size)
        for i in range(dof):
            around.slope[row, i] = abs(scratch.g[i] - (1.0 if i == row else 0.0))
            for j in range(dof):
                around.bend[row, i, j] = abs(scratch.H[i, j])


@inlined
def contract(form: Form, proof_goal: ProofGoal, scratch: BoxScratch, around: Expansion) -> None:
    """Write κ(ρ) for ρ = ``around.half``; margins beside the tolerances cover rounding for ρ up to `LARGEST`."""
    dof = len(scratch.c)
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * around.half[form.leader[k]]
    rest = rests(form, scratch, scratch.r, len(form.leader) // 2)
    trust = proof_goal.trust
    off_p = proof_goal.position + proof_goal.margin + trust * rest.three_p
    off_c = proof_goal.chord + proof_goal.margin_a + trust * rest.three_c
    for row in range(dof):
        total = around.value[row] + around.point[row] * off_p + around.column[row] * off_c
        for i in range(dof):
            part = 0.0
            for j in range(dof):
                part += around.bend[row, i, j] * around.half[j]
            total += around.half[i] * (around.slope[row, i] + 0.5 * trust * part)
        around.reach[row] = total


@kernel
def contractions(form: Form, proof_goal: ProofGoal, boxes: Array) -> Array:
    """κ of boxes around their centres, (k, dof); for tests.

    Args:
        form: The part of the arm that the boxes describe.
        proof_goal: The goal of the hand.
        boxes: (k, 2 dof): centres and half widths.
    """
    dof = boxes.shape[1] // 2
    scratch, around, result = (
        make_box_scratch(len(form.leader), dof),
        make_expansion(dof),
        np.empty((len(boxes), dof)),
    )
    for row in range(len(boxes)):
        load_box(boxes, row, scratch)
        expand(form, proof_goal, scratch, around)
        for i in range(dof):
            around.half[i] = scratch.h[i]
        contract(form, proof_goal, scratch, around)
        for i in range(dof):
            result[row, i] = around.reach[i]
    return result


@inlined
def has_solution(form: Form, scratch: BoxScratch, around: Expansion, radius: Array, distance: Array) -> bool:
    """Return True if a fixed point of N in a neighbourhood is a solution.

    The arm must have as many joints as the goal has constraints. M f = 0 at a fixed point. M is nearly the product of the
    inverse of a regular matrix and the transposed Jacobian of the hand. The inequality also holds for the exact product,
    see `REGULARLY`, and a fixed point of that has M f = 0. Force and torque are therefore zero. Hand and goal, rotated by
    less than 90° from the hand at the centre, are then equal. See `kernels.paths.tube`.
    """
    dof, columns = len(scratch.c), form.columns
    rotation = 0.0
    for k in range(len(form.leader)):
        if not form.prismatic[k]:
            rotation += abs(form.multiplier[k]) * distance[form.leader[k]]
    least = most = radius[0]
    for i in range(dof):
        least, most = min(least, radius[i]), max(most, radius[i])
    square = dof == 3 if columns == 0 else dof == 5 if columns == 1 else dof == 6 and columns == 3
    regular = around.gain[0] * (around.gain[1] + OFF) * most <= REGULARLY * least
    result: bool = square and regular and around.gain[1] <= ASKEW and rotation <= MOST_ROTATION
    return result


@inlined
def neighbourhood(
    form: Form, proof_goal: ProofGoal, scratch: BoxScratch, around: Expansion, radius: Array, distance: Array
) -> tuple[bool, bool]:
    """Look for a large ρ with κ(ρ) < ρ around the scratch memory's centre.

    Args:
        form: The part of the arm that the boxes describe.
        proof_goal: The goal of the hand.
        scratch: Scratch memory, with the centre.
        around: Scratch memory.
        radius: Receives ρ, (n,).
        distance: Receives the bound after repeated application of κ, (n,).

    Returns:
        True if there is one; and True if exactly one joint vector in it reaches the goal exactly.
    """
    dof = len(scratch.c)
    expand(form, proof_goal, scratch, around)
    for i in range(dof):
        around.half[i] = 1.0
    best, size = 0.0, LARGEST
    while size > SMALLEST and best == 0.0:
        # Wide where the polynomial has large second derivatives: all joints then shrink evenly.
        for _ in range(ROUNDS):
            top = LEAST
            for i in range(dof):
                top = max(top, around.half[i])
            for i in range(dof):
                around.half[i] *= size / top
            contract(form, proof_goal, scratch, around)
            holds, product = True, 1.0
            for i in range(dof):
                holds = holds and around.reach[i] < HOLDS * around.half[i]
                product *= around.half[i]
            if holds and product > best:
                best = product
                for i in range(dof):
                    radius[i] = around.half[i]
            for i in range(dof):
                around.half[i] = math.sqrt(around.half[i] * around.reach[i])
        size *= SHRINK
    if best == 0.0:
        return False, False
    for i in range(dof):
        around.half[i] = radius[i]
    for _ in range(REPEATS):
        contract(form, proof_goal, scratch, around)
        for i in range(dof):
            around.half[i] = min(around.half[i], around.reach[i])
    for i in range(dof):
        distance[i] = around.half[i]
    return True, has_solution(form, scratch, around, radius, distance)
