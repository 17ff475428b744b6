"""Exact minimisation of the chordal error along one joint, and along two.

With all other joints fixed, ``K_P |p - p_g|² + Σ K_c |c - c_g|²`` is ``a + b cos δ + c sin δ`` in the rotation δ of a
revolute joint and ``a + b δ + c δ²`` in the translation δ of a prismatic joint. Three FK evaluations therefore give it
exactly, and nine give the bilinear form of two joints.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Flags
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined_with_wrapper, kernel

TURN = 2.0 * math.pi


@inlined_with_wrapper
def coefficients(f0: float, f1: float, f2: float, slide: float) -> tuple[float, float, float]:
    """Fit the error along one joint.

    Args:
        f0: Error at δ = 0.
        f1: Error at δ = +2π/3, or at +`slide`.
        f2: Error at δ = -2π/3, or at -`slide`.
        slide: 0 for a revolute joint, else the distance sampled [m].
    """
    if slide > 0.0:
        return f0, (f1 - f2) / (2.0 * slide), (f1 + f2 - 2.0 * f0) / (2.0 * slide * slide)
    a = (f0 + f1 + f2) / 3.0
    return a, f0 - a, (f1 - f2) / math.sqrt(3.0)


@inlined_with_wrapper
def value_at(a: float, b: float, c: float, delta: float, revolute: bool) -> float:
    """Evaluate the fit."""
    if revolute:
        return a + b * math.cos(delta) + c * math.sin(delta)
    return a + (b + c * delta) * delta


@entry
def minimiser(a: float, b: float, c: float, low: float, high: float, revolute: bool) -> float:
    """Return the δ in [low, high] that minimises the fit; among equal ones the δ nearest to 0."""
    if revolute:
        best = math.atan2(-c, -b) if b != 0.0 or c != 0.0 else 0.0
        best += TURN * math.ceil((low - best) / TURN)  # The first copy above `low`,
        if best < 0.0:
            best += TURN * math.floor((min(high, 0.0) - best) / TURN)  # the last one below 0,
            if best + TURN <= high and best + TURN < -best:
                best += TURN
        if best <= high:
            return best
    elif c > 0.0:
        return min(max(-b / (2.0 * c), low), high)
    if value_at(a, b, c, low, revolute) < value_at(a, b, c, high, revolute):
        return low
    return high


@inlined_with_wrapper
def basis(delta: float, revolute: bool, phi: Array) -> None:
    """Write (1, cos δ, sin δ) or (1, δ, δ²) into phi, (3,)."""
    phi[0] = 1.0
    phi[1] = math.cos(delta) if revolute else delta
    phi[2] = math.sin(delta) if revolute else delta * delta


@entry
def minimise_pair(
    M: Annotated[Array, 3, 3],
    low: Annotated[Array, 2],
    high: Annotated[Array, 2],
    revolute: Annotated[Flags, 2],
    delta: Annotated[Array, 2, OUT],
) -> None:
    """Minimise φ(δ_1)ᵀ M φ(δ_2) over a box; write the minimiser into delta, (2,).

    For every δ_2 the best δ_1 is exact. δ_2 is scanned over its range, and then both are refined alternately.

    Args:
        M: Coefficients in the bases (1, cos, sin) or (1, δ, δ²), (3, 3).
        low: Lower ends of both ranges, (2,).
        high: Upper ends, (2,).
        revolute: True for a revolute joint, (2,).
        delta: Receives the minimiser, (2,).
    """
    scans = 32
    phi = np.empty(3)
    best = np.inf
    span = high[1] - low[1]
    if revolute[1] and span > TURN:
        span = TURN
    # The middles of the cells, the present value, and both ends, because the minimum may be there.
    for k in range(scans + 3):
        second = low[1] + span * (k + 0.5) / scans
        if k >= scans:
            second = 0.0 if k == scans else (low[1] if k == scans + 1 else low[1] + span)
        second = min(max(second, low[1]), high[1])
        first, value = _best_first(M, second, low, high, revolute, phi)
        if value < best:
            best, delta[0], delta[1] = value, first, second
    for _ in range(20):
        before, old = best, delta[1]
        basis(delta[0], revolute[0], phi)
        a = M[0, 0] * phi[0] + M[1, 0] * phi[1] + M[2, 0] * phi[2]
        b = M[0, 1] * phi[0] + M[1, 1] * phi[1] + M[2, 1] * phi[2]
        c = M[0, 2] * phi[0] + M[1, 2] * phi[1] + M[2, 2] * phi[2]
        step = minimiser(a, b, c, low[1], high[1], revolute[1]) - old
        for stretch in range(1, 3):  # Coordinate steps zigzag, so twice the step is tried too.
            second = min(max(old + stretch * step, low[1]), high[1])
            first, value = _best_first(M, second, low, high, revolute, phi)
            if value < best:
                best, delta[0], delta[1] = value, first, second
        if before - best <= 1e-16 * abs(before):
            break


@kernel
def _best_first(
    M: Array, second: float, low: Array, high: Array, revolute: Flags, phi: Array
) -> tuple[float, float]:
    """Return the best δ_1 for a given δ_2, and the value there."""
    basis(second, revolute[1], phi)
    a = M[0, 0] * phi[0] + M[0, 1] * phi[1] + M[0, 2] * phi[2]
    b = M[1, 0] * phi[0] + M[1, 1] * phi[1] + M[1, 2] * phi[2]
    c = M[2, 0] * phi[0] + M[2, 1] * phi[1] + M[2, 2] * phi[2]
    first = minimiser(a, b, c, low[0], high[0], revolute[0])
    return first, value_at(a, b, c, first, revolute[0])
