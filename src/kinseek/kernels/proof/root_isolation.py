"""Neighbourhoods with at most one solution, and the proof that no solution lies outside them.

Around a centre c, write ``f(c + δ) = f(c) + J δ + ½ δᵀHδ + rest`` for the hand's point and columns minus the goal's, with
the remainder of `kernels.proof.bounds`. Let M approximate a left inverse of J. Anything that meets the tolerances and
lies within half widths ρ of c satisfies ``δ = M (f(c + δ) - f(c)) + (1 - MJ) δ - M (½ δᵀHδ + rest)``. Its distance from c
is therefore at most

    κ(ρ) = |M f(c)| + |M| (tolerances + |rest(ρ)|) + |1 - MJ| ρ + ½ Σ |M H| ρ ρ        (joint by joint).

If κ(ρ) < ρ in every joint, all solutions within ρ lie within κ(ρ), then within κ(κ(ρ)), and so on down to a distance that
the tolerances allow. (Krawczyk 1969; Moore 1977, who uses interval derivatives in place of the Taylor polynomial.) At
most one joint vector within ρ reaches the goal exactly, by the theorem of Collatz and Wielandt: docs/proof_explained.md
has the proof. If `exists` is True there is one, by the argument of `kernels.paths.tube`. A box inside such a
neighbourhood needs no further examination.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.jit import inlined

from .approach import step
from .box import BoxScratch, rounding, short_way
from .memory import Memory, Places, SearchScratch
from .neighbourhood import neighbourhood
from .progress import GIVEN, KNOWN, SEEN, Question

BLIND = 0.05
"""Half widths around a solution without a neighbourhood, that is, a singular one. Boxes there are skipped, so that the
rest can be examined. Not examined further."""

MOST = 64
"""Largest number of solutions that a search may find besides those given; a second one in a neighbourhood does not count."""

OFTEN, STEPS = 4, 12
"""After OFTEN cut boxes, STEPS steps from the middle of one look for a solution.

These are more than in `infeasibility`, which looks for any one solution and mostly finds none. Here a solution that is
found early saves all boxes in its neighbourhood, and it must meet the tolerances, not only lie in the box. Twice or half
of either value changed the number of boxes by at most 0.2 %. Not examined further.
"""

CENTRING = 3
"""Steps from a solution to the centre of its neighbourhood. A solution has an error of a tolerance, mostly 1e-6, and each
step squares it. A better centre makes the neighbourhood no larger."""


@inlined
def inside(scratch: BoxScratch, places: Places, begin: int, end: int, width: float) -> int:
    """Index of the first neighbourhood from `begin` to `end` that contains the current box, or -1.

    Its half widths are multiplied by `width`; 0 tests its centre alone.
    """
    for k in range(begin, end):
        contained = True
        for i in range(len(scratch.c)):
            off = scratch.c[i] - places.centre[k, i]
            if places.periodic[i]:
                off = short_way(off)
            slack = 4.0 * rounding(scratch.c[i], scratch.h[i])
            if not abs(off) + width * scratch.h[i] <= places.radius[k, i] - slack:
                contained = False
                break
        if contained:
            return k
    return -1


@inlined
def admit(question: Question, memory: Memory, work: SearchScratch) -> None:
    """Create a neighbourhood around the solution in ``work.trial`` unless the solution is in another one."""
    form, proof_goal, places, counts = question.form, question.proof_goal, memory.places, memory.counts
    scratch, trial = work.scratch, work.trial
    dof, known = len(scratch.c), counts[KNOWN]
    for i in range(dof):
        scratch.c[i] = trial[i]
    if inside(scratch, places, 0, known, 0.0) >= 0:
        return
    for i in range(len(trial)):
        places.q[known, i] = trial[i]
    places.number[known] = counts[GIVEN] - 1 if counts[SEEN] == 0 else -1
    for _ in range(CENTRING):  # The centre may be beyond a limit by what the tolerances allow.
        step(form, proof_goal, scratch)
        for i in range(dof):
            scratch.c[i] += scratch.delta[i]
    radius, distance = places.radius[known], places.distance[known]
    holds, exists = neighbourhood(form, proof_goal, scratch, work.around, radius, distance)
    if holds:  # The solution itself must lie in its neighbourhood: the steps may have led to another one.
        for i in range(dof):
            places.centre[known, i] = scratch.c[i]
            scratch.c[i] = trial[i]
        holds = inside(scratch, places, known, known + 1, 0.0) >= 0
    places.isolated[known], places.exists[known] = holds, holds and exists
    if not holds:
        for i in range(dof):
            places.centre[known, i], radius[i], distance[i] = trial[i], BLIND, np.inf
    counts[KNOWN] += 1
