"""How far around an answer there is no other: Krawczyk's operator with the Taylor polynomial, see `isolation`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import array_view, inlined, kernel

from .box import LEAST, BoxScratch, Form, ProofGoal, load_box, make_box_scratch, place, turn_goal
from .taylor import derivatives, differentiate, normal_matrix, rests, solve

LARGEST, SMALLEST = 0.5, 1e-7
"""Half width of the widest joint of a neighbourhood [rad] or [m], tried from the largest down.

Of 76 answers of six arms more than half have one as wide as the largest, and the narrowest is 0.007. Margins hold up to the
largest, see `contract`; much below the smallest no box has to be looked at. By trial.
"""

SHRINK, ROUNDS = 0.7, 4
"""Each size is such a part of the one before, and so many shapes of it are tried, each the geometric mean of the last one
and of what κ makes of it. By trial: they are tried once an answer, beside thousands of boxes."""

HOLDS = 0.999
"""κ(ρ) < ρ counts where it holds by a thousandth: far more than rounding, and little enough to lose no neighbourhood."""

REPEATS = 60
"""How often κ is applied to its own result. What comes of it is a bound after any number; by trial, more make it no
smaller."""

REGULAR = 1e-13
"""Added to the diagonal of the normal matrix, as a part of its trace: the inverse stays finite where the arm is singular,
and elsewhere keeps twelve digits. The inequality holds whatever the inverse is; twice as much moves κ's thirteenth
digit."""


ASKEW, TURNED = 0.1, 1.4
"""An answer may miss the goal's columns by so much at the centre, together, and the joints may turn hand and goal by so much
[rad] from there on: that leaves less than 90°, see `kernels.paths.tube`."""

REGULARLY, OFF = 1e-5, 1e-12
"""M is made of the Jacobian as seen from halfway, which is off the hand's own by what the centre misses, and by rounding,
OFF at most. That, times the inverse of the normal matrix and its trace, times how much wider one joint of the neighbourhood
is than another, may be so much: then MJ is off by less than a thousandth, which `HOLDS` leaves."""


class Expansion(NamedTuple):
    """``M f`` at a centre, row by row, one a joint variable."""

    value: Array
    """``|M f(c)|``, (n,)."""
    point: Array
    """Length of M's part for the point, (n,)."""
    column: Array
    """Length of M's part for the columns, (n,)."""
    slope: Array
    """``|1 - MJ|``, (n, n)."""
    bend: Array
    """``|M H|``, (n, n, n)."""
    half: Array
    """ρ, (n,)."""
    reach: Array
    """κ(ρ), (n,)."""
    rows: Array
    """M of the columns and of the point, as in a pose, (n, 3, 4)."""
    gain: Array
    """Largest entry of the inverse of the normal matrix, times its trace; how far the centre misses the goal, (2,)."""


@array_view
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
    """Invert the Jacobian at the centre, and write down what the inverse makes of the hand's polynomial."""
    m, dof, T, goal, columns = len(form.leader), len(scratch.c), scratch.T, scratch.goal, form.columns
    place(form, scratch)
    turn_goal(form, proof_goal, scratch)
    scale = 1.0 / (proof_goal.length * proof_goal.length + LEAST)
    weight = 1.0 if columns > 0 else 0.0
    middle = m // 2
    differentiate(form, scratch, middle, columns)
    around.gain[0] = askew = far = 0.0
    for row in range(dof):
        normal_matrix(form, scratch, scale, weight, columns)
        trace = 0.0
        for i in range(dof):
            trace += scratch.N[i, i]
        for i in range(dof):  # Whatever M is, the inequality holds; this keeps it finite.
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
                        slope = scratch.velocity[k, r] if i == 3 else scratch.slopes[k, i, r]
                        part += form.multiplier[k] * scratch.delta[form.leader[k]] * slope
                    part *= scale if i == 3 else weight
                around.rows[row, r, i] = part
    for r in range(3):
        far += (T[r, 3] - goal[r, 3]) * (T[r, 3] - goal[r, 3])
        for i in range(columns):
            askew += (T[r, i] - goal[r, i]) * (T[r, i] - goal[r, i])
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
    """Write κ(ρ) of ρ = ``around.half``. Margins stand beside the tolerances: they cover rounding for ρ up to `LARGEST`."""
    dof = len(scratch.c)
    for k in range(len(form.leader)):
        scratch.half[k] = abs(form.multiplier[k]) * around.half[form.leader[k]]
    _, _, three_p, three_c = rests(form, scratch, scratch.r, len(form.leader) // 2)
    trust = proof_goal.trust
    off_p = proof_goal.position + proof_goal.margin + trust * three_p
    off_c = proof_goal.chord + proof_goal.margin_a + trust * three_c
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
        form: The part of the arm that the boxes are about.
        proof_goal: What is asked of it.
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
    """Has a neighbourhood, beside a fixed point of N, a solution there? With as many joints as the goal has constraints.

    M f = 0 there. M is all but the inverse of a regular matrix times the hand's Jacobian, turned over. With the very product
    the inequality holds as well, see `REGULARLY`, and a fixed point of that has M f = 0. So no force is left, nor a torque;
    and hand and goal, turned by less than 90° from the hand at the centre, are the same. See `kernels.paths.tube`.
    """
    dof, columns = len(scratch.c), form.columns
    turned = 0.0
    for k in range(len(form.leader)):
        if not form.prismatic[k]:
            turned += abs(form.multiplier[k]) * distance[form.leader[k]]
    least = most = radius[0]
    for i in range(dof):
        least, most = min(least, radius[i]), max(most, radius[i])
    square = dof == 3 if columns == 0 else dof == 5 if columns == 1 else dof == 6 and columns == 3
    regular = around.gain[0] * (around.gain[1] + OFF) * most <= REGULARLY * least
    result: bool = square and regular and around.gain[1] <= ASKEW and turned <= TURNED
    return result


@inlined
def neighbourhood(
    form: Form, proof_goal: ProofGoal, scratch: BoxScratch, around: Expansion, radius: Array, distance: Array
) -> tuple[bool, bool]:
    """Look for a large ρ with κ(ρ) < ρ around the scratch memory's centre.

    Args:
        form: The part of the arm that the boxes are about.
        proof_goal: What is asked of it.
        scratch: Memory; its centre counts.
        around: Memory.
        radius: ρ, (n,), is written here.
        distance: What remains of ρ when κ has been applied again and again, (n,), is written here.

    Returns:
        Is there one? And does exactly one joint vector in it reach the goal exactly?
    """
    dof = len(scratch.c)
    expand(form, proof_goal, scratch, around)
    for i in range(dof):
        around.half[i] = 1.0
    best, size = 0.0, LARGEST
    while size > SMALLEST and best == 0.0:
        for _ in range(ROUNDS):  # Wide where the polynomial bends much: then the whole shrinks evenly.
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
