"""Neighbourhoods that hold one answer at most, and the search that proves that nothing lies outside of them.

Around a centre c, write ``f(c + δ) = f(c) + J δ + ½ δᵀHδ + rest`` of the hand's point and columns less the goal's, with the
rest of `kernels.bounds`, and let M be about a left inverse of J. Whatever meets the tolerances and lies within half widths
ρ of c then has ``δ = M (f(c + δ) - f(c)) + (1 - MJ) δ - M (½ δᵀHδ + rest)``, so it is no farther from c than

    κ(ρ) = |M f(c)| + |M| (tolerances + |rest(ρ)|) + |1 - MJ| ρ + ½ Σ |M H| ρ ρ        (joint by joint).

Where κ(ρ) < ρ in every joint, all answers within ρ lie within κ(ρ), then within κ(κ(ρ)), and so on down to a distance that
the tolerances allow. (Krawczyk 1969; Moore 1977, who uses interval derivatives in place of the Taylor polynomial.)
A box inside of such a neighbourhood needs no further look.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors
from kinseek.kernels.arrays import Array, ChainArrays, Flags, GoalArrays, Indices
from kinseek.kernels.jit import hidden, kernel, view

from .approach import approach, step
from .bounds import first_order
from .box import (
    CHORD,
    HEAD,
    LEAST,
    LENGTH,
    MARGIN,
    MARGIN_A,
    NARROW,
    NEAR,
    POSITION,
    TRUST,
    Desk,
    Form,
    Wanted,
    halve,
    load_box,
    make_desk,
    place,
    store_box,
    turn_goal,
    turned,
    volume,
    widest,
    widths,
)
from .exclusion import COUNT, ENDED, FULL, KEPT, SEEN, STOPPED
from .form import separate
from .last_joint import Roll, roll_fits
from .taylor import derivatives, differentiate, normal_matrix, rests, solve

LARGEST, SMALLEST = 0.5, 1e-7
"""Half width of the widest joint of a neighbourhood [rad] or [m], tried from the largest down."""

BLIND = 0.05
"""Half widths around an answer that has no neighbourhood, a singular one: not looked at, so that the rest can be."""

MOST = 64
"""Answers that a search may find beside those given; of two in one neighbourhood the second does not count."""

OFTEN, STEPS = 4, 12
"""Every so many boxes that are kept, so many steps from the middle of one look for an answer.

More than in `exclusion`, which wants any one answer and mostly finds that there is none: here an answer that is found early
spares all the boxes in its neighbourhood, and it must be met to the tolerance, not to be in the box.
"""

# What the search counts beside COUNT, SEEN and KEPT.
LEFT = 3  # Boxes that are too narrow to be split, or passed over near an answer without a neighbourhood.
GIVEN = 4  # Answers given that have been looked at.
KNOWN = 5  # Answers that are no others' neighbours.
COUNTS = 6


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


class Places(NamedTuple):
    """Answers and their neighbourhoods; the memory is the caller's."""

    isolated: Flags
    """Has it a neighbourhood? (most,)"""
    number: Indices
    """Which of the given answers it is, or -1, (most,)."""
    q: Array
    """(most, n)"""
    centre: Array
    """Of the neighbourhood, (most, reduced n)."""
    radius: Array
    """Half widths of the neighbourhood, (most, reduced n)."""
    distance: Array
    """Of anything within the tolerances in its neighbourhood from the centre of it, (most, reduced n)."""


@view
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
    )


@hidden
def expand(form: Form, wanted: Wanted, desk: Desk, around: Expansion) -> None:
    """Invert the Jacobian at the centre, and write down what the inverse makes of the hand's polynomial."""
    m, dof, T, goal, columns = len(form.leader), len(desk.c), desk.T, desk.goal, form.columns
    place(form, desk)
    turn_goal(form, wanted, desk)
    middle = m // 2
    differentiate(form, desk, middle, columns)
    scale = 1.0 / (wanted.scalars[LENGTH] * wanted.scalars[LENGTH] + LEAST)
    weight = 1.0 if columns > 0 else 0.0
    for row in range(dof):
        normal_matrix(form, desk, scale, weight, columns)
        trace = 0.0
        for i in range(dof):
            trace += desk.N[i, i]
        for i in range(dof):  # Whatever M is, the inequality holds; this keeps it finite.
            desk.delta[i], desk.D[i] = 0.0, 1e-13 * trace + LEAST
        desk.delta[row] = 1.0
        solve(desk.N, desk.D, desk.delta)
        value = size = length = 0.0
        for i in range(4):
            if 3 > i >= columns:
                continue
            for r in range(3):
                part = 0.0
                for k in range(m):
                    slope = desk.velocity[k, r] if i == 3 else desk.slopes[k, i, r]
                    part += form.multiplier[k] * desk.delta[form.leader[k]] * slope
                part *= scale if i == 3 else weight
                desk.y[r, i] = part
                value += part * (T[r, i] - goal[r, i])
                if i == 3:
                    length += part * part
                else:
                    size += part * part
        derivatives(form, desk, middle, columns)
        around.value[row] = abs(value)
        around.point[row] = math.sqrt(length)
        around.column[row] = math.sqrt(size)
        for i in range(dof):
            around.slope[row, i] = abs(desk.g[i] - (1.0 if i == row else 0.0))
            for j in range(dof):
                around.bend[row, i, j] = abs(desk.H[i, j])


@hidden
def contract(form: Form, wanted: Wanted, desk: Desk, around: Expansion) -> None:
    """Write κ(ρ) of ρ = ``around.half``. Margins stand beside the tolerances: they cover rounding for ρ up to 1."""
    dof = len(desk.c)
    for k in range(len(form.leader)):
        desk.half[k] = abs(form.multiplier[k]) * around.half[form.leader[k]]
    _, _, three_p, three_c = rests(form, desk, desk.r, len(form.leader) // 2)
    trust = wanted.scalars[TRUST]
    off_p = wanted.scalars[POSITION] + wanted.scalars[MARGIN] + trust * three_p
    off_c = wanted.scalars[CHORD] + wanted.scalars[MARGIN_A] + trust * three_c
    for row in range(dof):
        total = around.value[row] + around.point[row] * off_p + around.column[row] * off_c
        for i in range(dof):
            part = 0.0
            for j in range(dof):
                part += around.bend[row, i, j] * around.half[j]
            total += around.half[i] * (around.slope[row, i] + 0.5 * trust * part)
        around.reach[row] = total


@kernel
def contractions(form: Form, wanted: Wanted, boxes: Array) -> Array:
    """κ of boxes around their centres, (k, dof); for tests.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        boxes: (k, 2 dof): centres and half widths.
    """
    dof = boxes.shape[1] // 2
    desk, around, result = make_desk(len(form.leader), dof), make_expansion(dof), np.empty((len(boxes), dof))
    for row in range(len(boxes)):
        load_box(boxes, row, desk)
        expand(form, wanted, desk, around)
        for i in range(dof):
            around.half[i] = desk.h[i]
        contract(form, wanted, desk, around)
        for i in range(dof):
            result[row, i] = around.reach[i]
    return result


@hidden
def neighbourhood(
    form: Form, wanted: Wanted, desk: Desk, around: Expansion, radius: Array, distance: Array
) -> bool:
    """Look for a large ρ with κ(ρ) < ρ around the desk's centre; say whether there is one.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        desk: Memory; its centre counts.
        around: Memory.
        radius: ρ, (n,), is written here.
        distance: What remains of ρ when κ has been applied again and again, (n,), is written here.
    """
    dof = len(desk.c)
    expand(form, wanted, desk, around)
    for i in range(dof):
        around.half[i] = 1.0
    best, size = 0.0, LARGEST
    while size > SMALLEST and best == 0.0:
        for _ in range(4):  # Wide where the polynomial bends much: then the whole shrinks evenly.
            top = LEAST
            for i in range(dof):
                top = max(top, around.half[i])
            for i in range(dof):
                around.half[i] *= size / top
            contract(form, wanted, desk, around)
            holds, product = True, 1.0
            for i in range(dof):
                holds = holds and around.reach[i] < 0.999 * around.half[i]
                product *= around.half[i]
            if holds and product > best:
                best = product
                for i in range(dof):
                    radius[i] = around.half[i]
            for i in range(dof):
                around.half[i] = math.sqrt(around.half[i] * around.reach[i])
        size *= 0.7
    if best == 0.0:
        return False
    for i in range(dof):
        around.half[i] = radius[i]
    for _ in range(60):
        contract(form, wanted, desk, around)
        for i in range(dof):
            around.half[i] = min(around.half[i], around.reach[i])
    for i in range(dof):
        distance[i] = around.half[i]
    return True


@hidden
def inside(desk: Desk, periodic: Flags, centre: Array, radius: Array, count: int, width: float) -> int:
    """Number of the first of `count` neighbourhoods that holds the box, its half widths times `width`, or -1."""
    turn = 2.0 * math.pi
    for k in range(count):
        held = True
        for i in range(len(desk.c)):
            off = desk.c[i] - centre[k, i]
            if periodic[i]:
                off -= turn * math.floor(off / turn + 0.5)
            if abs(off) + width * desk.h[i] > radius[k, i] * (1.0 - 1e-12) - 1e-13:
                held = False
                break
        if held:
            return k
    return -1


@kernel
def isolate_boxes(
    form: Form,
    wanted: Wanted,
    roll: Roll,
    chain: ChainArrays,
    goal: GoalArrays,
    stack: Array,
    periodic: Flags,
    answers: Array,
    places: Places,
    tuning: Array,
    counts: Indices,
    until: int,
) -> int:
    """Put a neighbourhood around every answer, and look in all boxes outside of them for others.

    It may be called again to go on where it stopped, and finds the same as if it had not stopped.

    Args:
        form: The part of the arm that the boxes are about.
        wanted: What is asked of it.
        roll: The last joint, where it is divided out.
        chain: The whole arm.
        goal: The goal as it was asked.
        stack: The boxes that are left, (room, 2 dof): centres and half widths.
        periodic: Is a whole turn of the variable as good as none? (dof,)
        answers: Joint values that are known to meet the tolerances, (k, n); none are needed.
        places: What is found is written here, the first KNOWN of each.
        tuning: Largest spread for the second order [rad], passes, shrink that earns another look, tolerances.
        counts: COUNT, SEEN, KEPT, LEFT, GIVEN and KNOWN, (6,).
        until: Boxes that may have been examined by the end of this call.

    Returns:
        ENDED, STOPPED or FULL; ENDED too where there is room for no more answers.
    """
    dof, n, most = stack.shape[1] // 2, len(chain.lower), len(places.q)
    desk, around = make_desk(len(form.leader), dof), make_expansion(dof)
    T, trial, outcome = np.empty((3, 4)), np.zeros(n), ENDED
    centre, radius, distance = places.centre, places.radius, places.distance
    count, seen, kept = counts[COUNT], counts[SEEN], counts[KEPT]
    left, given, known = counts[LEFT], counts[GIVEN], counts[KNOWN]
    while known < most:
        if given < len(answers):
            for i in range(n):
                trial[i] = answers[given, i]
            given += 1
        elif count > 0:
            if seen >= until or count == len(stack):
                outcome = STOPPED if seen >= until else FULL
                break
            count -= 1
            load_box(stack, count, desk)
            seen += 1
            held = inside(desk, periodic, centre, radius, known, 1.0)
            if held >= 0:
                left += 0 if places.isolated[held] else 1
                continue
            place(form, desk)
            widths(form, desk)
            if not first_order(form, wanted, desk, -1.0):
                continue
            spread = turned(form, desk, len(form.leader))
            before = volume(desk)
            if spread < tuning[0]:
                if not separate(form, wanted, desk, int(tuning[1])):
                    continue
                if roll.present and not roll_fits(form, wanted, roll, desk):
                    continue
                if volume(desk) < tuning[2] * before:
                    store_box(stack, count, desk)
                    count += 1
                    continue
            i = widest(form, wanted, desk, HEAD)
            if desk.h[i] < NARROW * (1.0 + abs(desk.c[i])):
                left += 1
                continue
            halve(desk, i, stack, count, count + 1)
            count += 2
            kept += 1
            if spread >= NEAR or kept % OFTEN != 0:
                continue
            approach(form, wanted, roll, chain, STEPS, desk, trial)
        else:
            break
        forward(chain, trial, T)
        position, orientation = errors(T, goal)
        if position > tuning[3] or orientation > tuning[4]:
            continue
        for i in range(dof):
            desk.c[i] = trial[i]
        if inside(desk, periodic, centre, radius, known, 0.0) >= 0:
            continue
        for i in range(n):
            places.q[known, i] = trial[i]
        places.number[known] = given - 1 if seen == 0 else -1
        for _ in range(3):  # The centre may lie beyond a limit by what the tolerances allow.
            step(form, wanted, desk)
            for i in range(dof):
                desk.c[i] += desk.delta[i]
        isolated = neighbourhood(form, wanted, desk, around, radius[known], distance[known])
        held = -1
        if isolated:
            for i in range(dof):
                centre[known, i] = desk.c[i]
                desk.c[i] = trial[i]
            # The answer itself must lie in its neighbourhood: the steps may have led to another one.
            for i in range(dof):
                desk.h[i] = 0.0
            held = inside(desk, periodic, centre[known : known + 1], radius[known : known + 1], 1, 0.0)
        places.isolated[known] = held >= 0
        if held < 0:
            for i in range(dof):
                centre[known, i], radius[known, i], distance[known, i] = trial[i], BLIND, np.inf
        known += 1
    counts[COUNT], counts[SEEN], counts[KEPT] = count, seen, kept
    counts[LEFT], counts[GIVEN], counts[KNOWN] = left, given, known
    return outcome
