"""Answers of an arm with a closed form: eight candidates, polished, and whether they are all there is."""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.seeds import turns_fully
from kinseek.kernels.atlas.task import Task
from kinseek.kernels.jit import inlined

from .candidates import (
    BESIDE,
    CLEAR,
    CONDITIONING,
    DEVIATION,
    DISCRIMINANT,
    DUPLICATE,
    FREE,
    INFEASIBILITY,
    INFEASIBLE,
    KIND,
    LOOSE,
    NONE,
    ROOTS,
    ROUNDING,
    SIZE,
    SPREAD,
    SWEPT,
    candidates,
    displacement,
    row_of,
)

TRIED, SURE, UNSURE, LOST, FOLDED = range(5)
"""Places in what is told of candidates: how many are tried, how many of these must be answers, 1 where there may be others
than they lead to, 1 where an arm nearly so may have such as the nearby arm has lost, and how far the equation that is solved
first is from having one answer, see `candidates.ROOTS`."""

REPORT = FOLDED + 1
"""Numbers that are told."""

ASKEW = 5.0
"""What an equation of the nearby arm may lack, in parts of what its angles are off by: where axes of a wrist lean towards
each other it magnifies that."""


@inlined
def serves(task: Task, structure: Array) -> bool:
    """Has the arm a closed form of all its joints, and are the tolerances such that it tells all?"""
    tight = max(task.position_tolerance, task.orientation_tolerance) <= LOOSE
    has: bool = structure[KIND] != NONE and structure[SWEPT] == 0.0 and tight
    return has


@inlined
def closed_starts(
    task: Task, structure: Array, target: Array, D: Array, work: Array, seeds: Array, report: Array, w: int
) -> None:
    """Write the candidates that lie inside the limits, or beside them, into seeds, and tell of them.

    Args:
        task: The task.
        structure: See `candidates.KIND`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        D: Memory, (3, 4).
        work: Memory, (WORK,).
        seeds: Receives joint values, (at least LANES, n).
        report: See `TRIED`, (REPORT,).
        w: LANES.
    """
    off = SPREAD * structure[DEVIATION]
    exact = structure[DEVIATION] <= ROUNDING
    far, beside = INFEASIBLE + ASKEW * off, BESIDE + off
    slack = off + max(task.position_tolerance / structure[SIZE], task.orientation_tolerance)
    many, sure, unsure, lost = 0, 0, 0.0, 0.0
    displacement(structure, target, D)
    candidates(structure, D, far, work, w)
    for l in range(LANES):
        infeasibility, conditioning, discriminant = (
            work[INFEASIBILITY * LANES + l],
            work[CONDITIONING * LANES + l],
            work[DISCRIMINANT * LANES + l],
        )
        duplicate = work[DUPLICATE * LANES + l] > 0.0
        if conditioning < FREE + off or (
            not exact and (discriminant < off or (not duplicate and 0.0 < infeasibility <= beside))
        ):
            unsure = 1.0
            lost = 1.0 if infeasibility > 0.0 else lost
        if duplicate or infeasibility > far:
            continue
        # What an angle may be off by: more where little decides it.
        wide = slack / max(conditioning * math.sqrt(discriminant), FREE)
        inside, fits = True, True
        for i in range(len(task.lower)):
            value = work[row_of(structure, i, len(task.lower)) * LANES + l]
            if not turns_fully(task, i):
                low, high = task.chain.lower[i], task.chain.upper[i]
                value = nearest_copy(value, low, high, 0.5 * (low + high))
                fits = fits and low - BESIDE - wide <= value <= high + BESIDE + wide
                inside = inside and low + wide < value < high - wide
                value = min(max(value, low), high)
            seeds[many, i] = value
        if fits:
            many += 1
            if inside and infeasibility <= 0.0 and discriminant > CLEAR + off:
                sure += 1
    report[TRIED], report[SURE], report[UNSURE], report[LOST] = many, sure, unsure, lost
    report[FOLDED] = abs(work[ROOTS * LANES])
