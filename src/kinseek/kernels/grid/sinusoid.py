"""Exact minimisation of the chordal error along one joint, and along two.

With all other joints fixed, ``K_P |p - p_g|² + Σ K_c |c - c_g|²`` is ``a + b cos δ + c sin δ`` in the rotation δ of a
revolute joint and ``a + b δ + c δ²`` in the translation δ of a prismatic joint: a product of coefficients (a, b, c) with a
basis φ(δ). Three FK evaluations therefore give it exactly, and nine give the bilinear form of two joints.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.vectors import Vector, rotated, rotated_back
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import entry, inlined, inlined_with_wrapper, kernel

TURN = 2.0 * math.pi

SCANS, ROUNDS = 32, 20
"""Values of the second joint that are scanned, and most rounds of the refinement after them. Not examined further."""


class Motion(NamedTuple):
    """The motion δ that a joint can make from its present value."""

    low: float
    """[rad] or [m]"""
    high: float
    """[rad] or [m]"""
    revolute: bool


class Pair(NamedTuple):
    """A motion of two joints, and the error there."""

    first: float
    second: float
    value: float


@inlined_with_wrapper
def fit_of(f0: float, f1: float, f2: float, slide: float) -> Vector:
    """Return the coefficients of the error along one joint.

    Args:
        f0: Error at δ = 0.
        f1: Error at δ = +2π/3, or at +`slide`.
        f2: Error at δ = -2π/3, or at -`slide`.
        slide: 0 for a revolute joint, else the distance sampled [m].
    """
    if slide > 0.0:
        return Vector(f0, (f1 - f2) / (2.0 * slide), (f1 + f2 - 2.0 * f0) / (2.0 * slide * slide))
    # Cosine and sine add up to 0 over three angles that are 2π/3 apart.
    a = (f0 + f1 + f2) / 3.0
    return Vector(a, f0 - a, (f1 - f2) / math.sqrt(3.0))


@inlined
def basis(delta: float, revolute: bool) -> Vector:
    """Return (1, cos δ, sin δ) or (1, δ, δ²)."""
    return Vector(1.0, math.cos(delta), math.sin(delta)) if revolute else Vector(1.0, delta, delta * delta)


@inlined_with_wrapper
def value_at(fit: Vector, delta: float, revolute: bool) -> float:
    """Evaluate the fit."""
    if revolute:
        return fit.x + fit.y * math.cos(delta) + fit.z * math.sin(delta)
    return fit.x + (fit.y + fit.z * delta) * delta


@entry
def minimiser(fit: Vector, joint: Motion) -> float:
    """Return the δ in the range of a joint that minimises the fit; among equal ones the δ nearest to 0."""
    low, high = joint.low, joint.high
    if joint.revolute:
        best = math.atan2(-fit.z, -fit.y) if fit.y != 0.0 or fit.z != 0.0 else 0.0
        best += TURN * math.ceil((low - best) / TURN)  # The first copy above `low`,
        if best < 0.0:
            best += TURN * math.floor((min(high, 0.0) - best) / TURN)  # the last one below 0,
            if best + TURN <= high and best + TURN < -best:
                best += TURN
        if best <= high:
            return best
    elif fit.z > 0.0:
        return min(max(-fit.y / (2.0 * fit.z), low), high)
    return low if value_at(fit, low, joint.revolute) < value_at(fit, high, joint.revolute) else high


@entry
def minimise_pair(M: Annotated[Array, 3, 3], first: Motion, second: Motion) -> tuple[float, float]:
    """Minimise φ(δ_1)ᵀ M φ(δ_2) over the ranges of two joints; return δ_1 and δ_2.

    For every δ_2 the best δ_1 is exact. δ_2 is scanned over its range, and then both are refined alternately.

    Args:
        M: Coefficients in the bases (1, cos, sin) or (1, δ, δ²), (3, 3).
        first: The first joint.
        second: The second joint.
    """
    best = Pair(0.0, 0.0, np.inf)
    span = second.high - second.low
    if second.revolute and span > TURN:
        span = TURN
    # The middles of the cells, the present value, and both ends, because the minimum may be there.
    for k in range(SCANS + 3):
        delta = second.low + span * (k + 0.5) / SCANS
        if k >= SCANS:
            delta = 0.0 if k == SCANS else (second.low if k == SCANS + 1 else second.low + span)
        best = better_of(M, first, second, delta, best)
    for _ in range(ROUNDS):
        before = best
        fit = rotated_back(M, basis(before.first, first.revolute))
        step = minimiser(fit, second) - before.second
        for stretch in range(1, 3):  # Coordinate steps zigzag, so twice the step is tried too.
            best = better_of(M, first, second, before.second + stretch * step, best)
        if before.value - best.value <= 1e-16 * abs(before.value):
            break
    return best.first, best.second


@kernel
def better_of(M: Array, first: Motion, second: Motion, delta: float, best: Pair) -> Pair:
    """Return the best motion of the first joint for a motion δ of the second, clipped to its range, if it is better."""
    delta = min(max(delta, second.low), second.high)
    fit = rotated(M, basis(delta, second.revolute))
    other = minimiser(fit, first)
    value = value_at(fit, other, first.revolute)
    return Pair(other, delta, value) if value < best.value else best
