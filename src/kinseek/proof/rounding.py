"""Bounds of the rounding errors in proofs, from the joints, their ranges and the lengths.

The standard model is used: ``fl(x ∘ y) = (x ∘ y)(1 + δ)``, |δ| ≤ u = 2⁻⁵³. A sum of k products has an error of at most ``γ_k
= k u / (1 - k u)`` times the sum of their magnitudes, in any order and with fused products (Higham 2002, ch. 2 and 3). The
model holds if nothing underflows or overflows: lengths and angles are bounded elsewhere, and what underflows is below
1e-300. docs/proof_explained.md derives the formulas.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

from kinseek.kernels.arrays import Array

UNIT = 2.0**-53
"""u: half the distance from 1 to the next double."""

OF_SINES = 4.0 * UNIT
"""Largest error of a sine or cosine: four units in the last place of numbers from ½ to 1. The C libraries document errors
below one unit (glibc's manual, "Known Maximum Errors in Math Functions"), vectorised ones below four."""

SECOND_ORDER = 2.5
"""Boxes whose rotation of the hand is less than this [rad] are tested to second order, see `boxes.SECOND_ORDER`.
Neighbourhoods rotate it by at most half a radian per joint."""

PREPARED = 4
"""Transforms that are multiplied on the goal's side before any box is tested; they count as as many additional joints."""


@cache
def gamma(k: float) -> float:
    """Return γ_k."""
    return k * UNIT / (1.0 - k * UNIT)


class Sizes(NamedTuple):
    """Quantities that rounding errors depend on."""

    joints: int
    """Number of physical joints."""
    angles: float
    """Sum of the largest angles of all joints [rad]."""
    rate: float
    """Sum of the factors between revolute joints and their variables."""
    reach: float
    """Sum of all lengths that are added: links, slides, goal and tool [m]."""
    defect: float
    """Sum of the deviations of the rotation matrices of links and goal from exact rotations."""


def defect_of(turn: Array) -> float:
    """Deviation of a matrix, (3, 3), from a rotation: ``|RᵀR - 1|``. The nearest rotation is no farther away than that."""
    off = (turn.T @ turn).ravel().tolist()
    for i in (0, 4, 8):
        off[i] -= 1.0
    return math.hypot(*off)


def of_axes(sizes: Sizes) -> float:
    """Rounding error of all columns of a pose together, as a Frobenius norm.

    Each joint multiplies two rotations, with an error of 3 γ_3. It mixes two columns with a cosine and a sine, with an error
    of 2 γ_2 plus twice that of the sine. It rounds its angle, with an error of √2 γ_2 times the angle.
    """
    count = sizes.joints + PREPARED
    each = 3.0 * gamma(3) + 2.0 * gamma(2) + 2.0 * OF_SINES
    return 1.01 * (count * each + math.sqrt(2.0) * gamma(2) * sizes.angles + sizes.defect)


def of_points(sizes: Sizes) -> float:
    """Rounding error of a point [m].

    The links are rotated by the error of the axes, and each sum is rounded: four terms per link, two per slide.
    """
    count = sizes.joints + PREPARED
    return sizes.reach * (of_axes(sizes) + math.sqrt(3.0) * gamma(4) + count * gamma(6) + gamma(8))


def margins(sizes: Sizes) -> tuple[float, float]:
    """Return the margins for comparisons: of points [m] and of all columns together.

    Each is the larger of the margins of the first-order test and of the second-order linear form; see "Rounding" in
    docs/proof_explained.md.
    """
    a, e, R, m = of_axes(sizes), of_points(sizes), sizes.reach, sizes.joints
    S = max(SECOND_ORDER, 0.5 * sizes.rate)
    arm = a * R + 2.0 * e + gamma(8) * R  # Error of a radius, or of the distance that a joint moves a point.
    first_p = e + 2.0 * m * (arm + gamma(m + 6) * R) + gamma(24) * R
    first_a = a + 2.0 * m * (2.0 * a + gamma(m + 14)) + gamma(24)
    cube = S**3 / 6.0
    second_p = e + gamma(44) * R  # The value, and the size of the form.
    second_p += (
        S * (arm + 3.0 * a * R + gamma(8) * R) + a * R + gamma(4) * R
    )  # The slope: slides against rotations.
    second_p += S * S * (2.0 * a * R + 2.0 * e + gamma(16) * R) + cube * arm  # The second order; the rest.
    second_p += (
        gamma(m + 16) * (S + 1.0) + gamma(m + 6) * (cube + S * S / 2) + gamma(2 * m + 16) * (S + 1.0) ** 2
    ) * R
    root = math.sqrt(3.0)
    second_a = a + gamma(81) + S * (2.0 * root * a + gamma(14)) + S * S * (5.2 * a + gamma(18))
    second_a += (
        cube * (2.0 * root * a + gamma(14)) + (6.4 + 8.0 * S) * a + gamma(32) * S
    )  # The last one: a column beside.
    second_a += root * (gamma(m + 16) * S + gamma(m + 6) * cube + gamma(2 * m + 16) * (S + S * S))
    return 1.01 * max(first_p, second_p), 1.01 * max(first_a, second_a)
