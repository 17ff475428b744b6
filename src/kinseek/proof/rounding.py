"""How far rounding takes what a proof computes from what it means: a bound from the joints, their ranges and the lengths.

The standard model is used: ``fl(x ∘ y) = (x ∘ y)(1 + δ)``, |δ| ≤ u = 2⁻⁵³, and a sum of k products is off by at most
``γ_k = k u / (1 - k u)`` of the sum of their magnitudes, in any order and with fused products (Higham 2002, ch. 2 and 3). It
holds where nothing underflows or overflows: lengths and angles are bounded elsewhere, and what underflows is below 1e-300.
docs/proof.md derives what is computed here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from kinseek.kernels.arrays import Array

UNIT = 2.0**-53
"""u: half the distance of 1 from the next double."""

OF_SINES = 4.0 * UNIT
"""What a sine or cosine is off by at most: four units in the last place of numbers from ½ to 1. The C libraries say that
they stay below one (glibc's manual, "Known Maximum Errors in Math Functions"); vectorised ones below four."""

SPREAD = 2.5
"""Boxes that turn the hand by less [rad] are looked at to second order, see `boxes.SPREAD`; neighbourhoods turn it by half a
radian a joint at most."""

PREPARED = 4
"""Transforms that a question multiplies before any box, on the goal's side: as many joints more."""


def gamma(k: float) -> float:
    """γ_k."""
    return k * UNIT / (1.0 - k * UNIT)


class Sizes(NamedTuple):
    """What rounding depends on."""

    joints: int
    """Physical joints."""
    angles: float
    """Largest angles of all of them, added up [rad]."""
    rate: float
    """How many times as fast as their variables the joints that turn do so, added up."""
    reach: float
    """All lengths that are added: links, slides, the goal's, the tool's [m]."""
    defect: float
    """How far the rotations of links and goal are from rotations, added up."""


def defect_of(turn: Array) -> float:
    """How far a rotation, (3, 3), is from one: ``|RᵀR - 1|``. The nearest rotation is no farther away than that."""
    off = (turn.T @ turn).ravel().tolist()
    for i in (0, 4, 8):
        off[i] -= 1.0
    return math.hypot(*off)


def of_axes(sizes: Sizes) -> float:
    """How far all columns of a pose together, as a Frobenius norm, are from what they would be without rounding.

    A joint multiplies two rotations, which takes 3 γ_3, mixes two columns with a cosine and a sine, 2 γ_2 and twice what
    these are off by, and rounds its angle, √2 γ_2 of it.
    """
    count = sizes.joints + PREPARED
    each = 3.0 * gamma(3) + 2.0 * gamma(2) + 2.0 * OF_SINES
    return 1.01 * (count * each + math.sqrt(2.0) * gamma(2) * sizes.angles + sizes.defect)


def of_points(sizes: Sizes) -> float:
    """How far a point is from where it would be without rounding [m].

    The links are turned by what axes are off by, and each of the sums rounds: four terms a link, two a slide.
    """
    count = sizes.joints + PREPARED
    return sizes.reach * (of_axes(sizes) + math.sqrt(3.0) * gamma(4) + count * gamma(6) + gamma(8))


def margins(sizes: Sizes) -> tuple[float, float]:
    """Margins for whatever is compared: of points [m] and of the columns together.

    The larger of what the test of first order takes and the linear form of second order; see "Rounding" in docs/proof.md.
    """
    a, e, R, m = of_axes(sizes), of_points(sizes), sizes.reach, sizes.joints
    S = max(SPREAD, 0.5 * sizes.rate)
    arm = a * R + 2.0 * e + gamma(8) * R  # What a radius, or the way of a point by a joint, is off by.
    first_p = e + 2.0 * m * (arm + gamma(m + 6) * R) + gamma(24) * R
    first_a = a + 2.0 * m * (2.0 * a + gamma(m + 14)) + gamma(24)
    cube = S**3 / 6.0
    second_p = e + gamma(44) * R  # The value, and the size of the form.
    second_p += (
        S * (arm + 3.0 * a * R + gamma(8) * R) + a * R + gamma(4) * R
    )  # The slope; slides against turns.
    second_p += S * S * (2.0 * a * R + 2.0 * e + gamma(16) * R) + cube * arm  # The bend; the rest.
    second_p += (
        gamma(m + 16) * (S + 1.0) + gamma(m + 6) * (cube + S * S / 2) + gamma(2 * m + 16) * (S + 1.0) ** 2
    ) * R
    root = math.sqrt(3.0)
    second_a = a + gamma(81) + S * (2.0 * root * a + gamma(14)) + S * S * (5.2 * a + gamma(18))
    second_a += (
        cube * (2.0 * root * a + gamma(14)) + (6.4 + 8.0 * S) * a + gamma(32) * S
    )  # The last: a column beside.
    second_a += root * (gamma(m + 16) * S + gamma(m + 6) * cube + gamma(2 * m + 16) * (S + S * S))
    return 1.01 * max(first_p, second_p), 1.01 * max(first_a, second_a)
