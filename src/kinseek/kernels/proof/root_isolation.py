"""Neighbourhoods that hold one solution at most, and the search that proves that no answer lies outside of them.

Around a centre c, write ``f(c + δ) = f(c) + J δ + ½ δᵀHδ + rest`` of the hand's point and columns less the goal's, with the
rest of `kernels.proof.bounds`, and let M be about a left inverse of J. Whatever meets the tolerances and lies within half
widths ρ of c then has ``δ = M (f(c + δ) - f(c)) + (1 - MJ) δ - M (½ δᵀHδ + rest)``, so it is no farther from c than

    κ(ρ) = |M f(c)| + |M| (tolerances + |rest(ρ)|) + |1 - MJ| ρ + ½ Σ |M H| ρ ρ        (joint by joint).

Where κ(ρ) < ρ in every joint, all answers within ρ lie within κ(ρ), then within κ(κ(ρ)), and so on down to a distance that
the tolerances allow. (Krawczyk 1969; Moore 1977, who uses interval derivatives in place of the Taylor polynomial.)
At most one joint vector within ρ reaches the goal exactly, by the theorem of Collatz and Wielandt: docs/proof.md has the
proof. Where `exists` says so there is one, by the argument of `kernels.paths.tube`.
A box inside of such a neighbourhood needs no further look.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined, ir_inlined

from .approach import step
from .box import BoxScratch, Form, ProofGoal, rounding, short_way
from .memory import Places
from .neighbourhood import Expansion, neighbourhood
from .progress import GIVEN, KNOWN, SEEN

BLIND = 0.05
"""Half widths around an answer that has no neighbourhood, a singular one: not looked at, so that the rest can be.
By trial."""

MOST = 64
"""Answers that a search may find beside those given; of two in one neighbourhood the second does not count."""

OFTEN, STEPS = 4, 12
"""Every so many boxes that are cut, so many steps from the middle of one look for an answer.

More than in `exclusion`, which wants any one answer and mostly finds that there is none: here an answer that is found early
spares all the boxes in its neighbourhood, and it must be met to the tolerance, not to be in the box.
By trial twice or half of either changes the count of boxes by 0.2 % at most.
"""

CENTRING = 3
"""Steps from an answer to the centre of its neighbourhood: an answer is off by a tolerance, mostly 1e-6, and each step
squares that. A better centre makes the neighbourhood no larger."""


@inlined
def inside(scratch: BoxScratch, places: Places, begin: int, end: int, width: float) -> int:
    """Number of the first neighbourhood, of those from `begin` to `end`, that holds the box in hand, or -1.

    Its half widths are taken times `width`: 0 asks for its centre alone.
    """
    for k in range(begin, end):
        held = True
        for i in range(len(scratch.c)):
            off = scratch.c[i] - places.centre[k, i]
            if places.periodic[i]:
                off = short_way(off)
            if not abs(off) + width * scratch.h[i] <= places.radius[k, i] - 4.0 * rounding(
                scratch.c[i], scratch.h[i]
            ):
                held = False
                break
        if held:
            return k
    return -1


@ir_inlined
def admit(
    form: Form,
    proof_goal: ProofGoal,
    scratch: BoxScratch,
    around: Expansion,
    places: Places,
    trial: Array,
    counts: Indices,
) -> None:
    """Put a neighbourhood around an answer, (n,), unless it is in another's."""
    dof, known = len(scratch.c), counts[KNOWN]
    for i in range(dof):
        scratch.c[i] = trial[i]
    if inside(scratch, places, 0, known, 0.0) >= 0:
        return
    for i in range(len(trial)):
        places.q[known, i] = trial[i]
    places.number[known] = counts[GIVEN] - 1 if counts[SEEN] == 0 else -1
    for _ in range(CENTRING):  # The centre may lie beyond a limit by what the tolerances allow.
        step(form, proof_goal, scratch)
        for i in range(dof):
            scratch.c[i] += scratch.delta[i]
    holds, exists = neighbourhood(
        form, proof_goal, scratch, around, places.radius[known], places.distance[known]
    )
    if holds:  # The answer itself must lie in its neighbourhood: the steps may have led to another one.
        for i in range(dof):
            places.centre[known, i] = scratch.c[i]
            scratch.c[i] = trial[i]
        holds = inside(scratch, places, known, known + 1, 0.0) >= 0
    places.isolated[known], places.exists[known] = holds, holds and exists
    if not holds:
        for i in range(dof):
            places.centre[known, i], places.radius[known, i] = trial[i], BLIND
            places.distance[known, i] = np.inf
    counts[KNOWN] += 1
