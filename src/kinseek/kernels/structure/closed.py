"""Closed-form solutions of an arm: eight candidates to refine, and whether they are complete."""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Scratch
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


class Closed(NamedTuple):
    """What is known of the candidates of an arm."""

    tried: int
    """Number of candidates that are tried."""
    sure: int
    """How many of these must be solutions."""
    unsure: bool
    """Whether there may be solutions that no candidate leads to."""
    lost: bool
    """Whether an arm that only nearly has its structure may have solutions that the nearby arm has lost."""
    folded: float
    """Absolute discriminant of the equation that is solved first, see `candidates.ROOTS`."""


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
    task: Task, structure: Array, target: Array, scratch: Scratch, seeds: Array, w: int
) -> Closed:
    """Write the candidates within the limits, or close to them, into seeds.

    Args:
        task: The task.
        structure: See `candidates.KIND`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        scratch: Its `spare` and `candidates` are overwritten.
        seeds: Receives joint values, (at least LANES, n).
        w: LANES.
    """
    D, work = scratch.spare, scratch.candidates
    off = SPREAD * structure[DEVIATION]
    exact = structure[DEVIATION] <= ROUNDING
    far, beside = INFEASIBLE + ASKEW * off, BESIDE + off
    slack = off + max(task.position_tolerance / structure[SIZE], task.orientation_tolerance)
    many, sure, unsure, lost = 0, 0, False, False
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
            unsure = True
            lost = lost or infeasibility > 0.0
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
    return Closed(many, sure, unsure, lost, abs(work[ROOTS, 0]))
