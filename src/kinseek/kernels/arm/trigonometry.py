"""Sine and cosine together, without branches, so that SIMD lanes and single calls share them."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.jit import inlined

_TWO_OVER_PI = 2.0 / math.pi
_HALF_PI_HIGH = 1.5707963267341256  # π/2 in two parts, the first with trailing zeros (Cody and Waite 1980).
_HALF_PI_LOW = 6.077100506506192e-11


@inlined
def sine_cosine(x: float) -> tuple[float, float]:
    """Sine and cosine without branches, to 1 ulp for |x| < 1e5."""
    k = np.floor(x * _TWO_OVER_PI + 0.5)
    r = (x - k * _HALF_PI_HIGH) - k * _HALF_PI_LOW
    z = r * r
    # Minimax polynomials on [-π/4, π/4] with the coefficients of Cephes (Moshier 1989, sin.c).
    s = -2.50507477628578072866e-8 + z * 1.58962301576546568060e-10
    s = -1.98412698295895385996e-4 + z * (2.75573136213857245213e-6 + z * s)
    s = -1.66666666666666307295e-1 + z * (8.33333333332211858878e-3 + z * s)
    s = r + r * z * s
    c = 2.08757008419747316778e-9 - z * 1.13585365213876817300e-11
    c = 2.48015872888517045348e-5 + z * (-2.75573141792967388112e-7 + z * c)
    c = 4.16666666666665929218e-2 + z * (-1.38888888888730564116e-3 + z * c)
    c = 1.0 - 0.5 * z + z * z * c
    half = 0.5 * k  # The quadrant in floats, because not all processors have vectors of 64-bit integers.
    whole = np.floor(half)
    odd = half - whole > 0.25
    quarter = 0.5 * whole
    sign = 1.0 - 4.0 * (quarter - np.floor(quarter))
    return sign * (c if odd else s), sign * (-s if odd else c)


@inlined
def rough_angle(y: float, x: float) -> float:
    """``atan2(y, x)`` to 2e-4 rad and without branches, accurate enough for starts; 0 at the origin."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay, 1e-300)
    z = t * t
    # The minimax odd polynomial of degree 7, found by Remez exchange; see the test.
    angle = t * (0.99921406 + z * (-0.32117496 + z * (0.14626446 - 0.03898651 * z)))
    angle = 0.5 * math.pi - angle if ay > ax else angle
    angle = math.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle
