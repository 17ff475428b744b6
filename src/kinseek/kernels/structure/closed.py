"""Closed-form solutions of an arm: eight candidates to refine, and whether they are complete."""

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
"""Indices into the report on candidates. How many are tried. How many of these must be solutions. 1 if there may be
solutions that no candidate leads to. 1 if an arm that only nearly has its structure may have solutions that the nearby
arm has lost. And the absolute discriminant of the equation that is solved first, see `candidates.ROOTS`."""

REPORT = FOLDED + 1
"""Length of the report."""

ASKEW = 5.0
"""Infeasibility that is allowed for an equation of the nearby arm, as a multiple of the error of its angles. It is larger
than 1 because skewed axes of a wrist magnify that error. Not examined further."""


@inlined
def serves(task: Task, structure: Array) -> bool:
    """Return True if the arm has a closed form of all its joints and the tolerances are tight enough.

    With looser tolerances the closed form is not complete, see `LOOSE`.
    """
    tight = max(task.position_tolerance, task.orientation_tolerance) <= LOOSE
    has: bool = structure[KIND] != NONE and structure[SWEPT] == 0.0 and tight
    return has


@inlined
def closed_starts(
    task: Task, structure: Array, target: Array, D: Array, work: Array, seeds: Array, report: Array, w: int
) -> None:
    """Write the candidates within the limits, or close to them, into seeds, and report on them.

    Args:
        task: The task.
        structure: See `candidates.KIND`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        D: Scratch memory, (3, 4).
        work: Scratch memory, `candidates.WORK`.
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
            work[INFEASIBILITY, l],
            work[CONDITIONING, l],
            work[DISCRIMINANT, l],
        )
        duplicate = work[DUPLICATE, l] > 0.0
        if conditioning < FREE + off or (
            not exact and (discriminant < off or (not duplicate and 0.0 < infeasibility <= beside))
        ):
            unsure = 1.0
            lost = 1.0 if infeasibility > 0.0 else lost
        if duplicate or infeasibility > far:
            continue
        # Possible error of an angle: larger where it is poorly conditioned.
        wide = slack / max(conditioning * math.sqrt(discriminant), FREE)
        inside, fits = True, True
        for i in range(len(task.lower)):
            value = work[row_of(structure, i, len(task.lower)), l]
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
    report[FOLDED] = abs(work[ROOTS, 0])
