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

from . import candidates as form


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
    swaying: bool
    """Whether joint 1 of an arm that nearly has a spherical wrist is too uncertain for its candidates, see `SWAYING`."""
    folded: float
    """Absolute discriminant of the equation that is solved first, see `candidates.ROOTS`."""


SWAYING = 3.5
"""A candidate of an arm with nearly a spherical wrist says little if the conditioning of joint 1 is below this multiple of
the error of its equation: that joint may be a third of a radian away, and the wrist with it. The discriminant is then small
too, unlike for a straight wrist. Tried on one arm and 36,000 poses, half of them near singularities: solutions of 22 were
missed, and of 3 with this rule and `refine_all.VALLEY`. Three parallel axes have rules of their own, see
`branches.search`."""

ASKEW = 5.0
"""Infeasibility that is allowed for an equation of the nearby arm, as a multiple of the error of its angles. It is larger
than 1 because skewed axes of a wrist magnify that error. Not examined further."""


@inlined
def serves(task: Task, structure: Array) -> bool:
    """Return True if the arm has a closed form of all its joints and the tolerances are tight enough.

    With looser tolerances the closed form is not complete, see `LOOSE`.
    """
    s = form.read_structure(structure)
    tight = max(task.position_tolerance, task.orientation_tolerance) <= form.LOOSE
    has: bool = s.kind != form.NONE and s.swept == 0.0 and tight
    return has


@inlined
def closed_starts(
    task: Task, structure: Array, target: Array, scratch: Scratch, seeds: Array, w: int
) -> Closed:
    """Write the candidates within the limits, or close to them, into seeds.

    Args:
        task: The task.
        structure: See `candidates.STRUCTURE`, (NUMBERS,).
        target: (4, 4), lengths in [m].
        scratch: Its `displacement` and `candidates` are overwritten.
        seeds: Receives joint values, (at least LANES, n).
        w: LANES.
    """
    s, D, work = form.read_structure(structure), scratch.displacement, scratch.candidates
    off, exact = form.ERROR_PER_DEVIATION * s.deviation, s.deviation <= form.ROUNDING
    far, beside = form.INFEASIBLE + ASKEW * off, form.BESIDE + off
    slack = off + max(task.position_tolerance / s.size, task.orientation_tolerance)
    many, sure, unsure, lost, swaying = 0, 0, False, False, False
    form.displacement(structure, target, D)
    form.candidates(structure, D, far, work, w)
    for l in range(LANES):
        infeasibility, conditioning, discriminant = (
            work[form.INFEASIBILITY, l],
            work[form.CONDITIONING, l],
            work[form.DISCRIMINANT, l],
        )
        duplicate = work[form.DUPLICATE, l] > 0.0
        if conditioning < form.FREE + off or (
            not exact and (discriminant < off or (not duplicate and 0.0 < infeasibility <= beside))
        ):
            unsure = True
            lost = lost or infeasibility > 0.0
        swaying = swaying or max(conditioning, discriminant) < SWAYING * off
        if duplicate or infeasibility > far:
            continue
        # Possible error of an angle: larger where it is poorly conditioned.
        wide = slack / max(conditioning * math.sqrt(discriminant), form.FREE)
        inside, fits = True, True
        for i in range(len(task.lower)):
            value = work[form.row_of(structure, i, len(task.lower)), l]
            if not turns_fully(task, i):
                low, high = task.chain.lower[i], task.chain.upper[i]
                value = nearest_copy(value, low, high, 0.5 * (low + high))
                fits = fits and low - form.BESIDE - wide <= value <= high + form.BESIDE + wide
                inside = inside and low + wide < value < high - wide
                value = min(max(value, low), high)
            seeds[many, i] = value
        if fits:
            many += 1
            if inside and infeasibility <= 0.0 and discriminant > form.CLEAR + off:
                sure += 1
    swaying = swaying and not exact and s.kind != form.PARALLEL
    return Closed(many, sure, unsure, lost, swaying, abs(work[form.ROOTS, 0]))
