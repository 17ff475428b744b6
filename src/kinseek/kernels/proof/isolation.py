"""Neighbourhoods that hold one answer at most, and the search that proves that nothing lies outside of them.

Around a centre c, write ``f(c + δ) = f(c) + J δ + ½ δᵀHδ + rest`` of the hand's point and columns less the goal's, with the
rest of `kernels.proof.bounds`, and let M be about a left inverse of J. Whatever meets the tolerances and lies within half
widths ρ of c then has ``δ = M (f(c + δ) - f(c)) + (1 - MJ) δ - M (½ δᵀHδ + rest)``, so it is no farther from c than

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
from kinseek.kernels.jit import hidden, kernel

from .approach import approach, step
from .bounds import first_order
from .box import (
    HEAD,
    NARROW,
    NEAR,
    Desk,
    Form,
    Wanted,
    halve,
    load_box,
    make_desk,
    place,
    store_box,
    turned,
    volume,
    widest,
    widths,
)
from .exclusion import COUNT, ENDED, FULL, KEPT, SEEN, STOPPED
from .form import separate
from .last_joint import Roll, roll_fits
from .neighbourhood import make_expansion, neighbourhood

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
