"""Branch-free subproblems of closed forms, so that they run in parallel in SIMD lanes.

Rotations are kept as cosine and sine, and only the final six angles are computed from them.
"""

from __future__ import annotations

import math

from kinseek.kernels.jit import inlined

TINY = 1e-30
"""Prevents division by zero for vectors of no length; the result is then reported as poorly conditioned."""


@inlined
def solve_trig(a: float, b: float, c: float, sign: float) -> tuple[float, float, float, float]:
    """Solve ``a cos θ + b sin θ = c``: subproblems 3 and 4 of Paden and Kahan, and of Elias and Wen (2022).

    There are two solutions, one for each sign. If there is none, both are the θ that minimizes the residual, as in Elias
    and Wen.

    Returns:
        Cosine and sine of θ; the square of the sine of half the angle between both solutions, which is negative if there
        is none; and the length of (a, b). If that length is zero, θ is undetermined.
    """
    square = a * a + b * b
    length = math.sqrt(square)
    rest = square - c * c
    root = sign * math.sqrt(max(rest, 0.0))
    lost = length < TINY
    # If |c| exceeds the length, root is 0, and (a c, b c)/(length |c|) is the unit vector with the smallest residual.
    share = 1.0 / max(length * max(length, abs(c)), TINY)
    cosine = 1.0 if lost else (a * c - b * root) * share
    sine = 0.0 if lost else (b * c + a * root) * share
    return cosine, sine, rest / max(square, TINY), length


@inlined
def unit_angle(x: float, y: float) -> tuple[float, float, float]:
    """Cosine and sine of the direction (x, y), and its length: subproblem 1 of Paden and Kahan, in the plane."""
    length = math.sqrt(x * x + y * y)
    lost = length < TINY
    share = 1.0 / max(length, TINY)
    return 1.0 if lost else x * share, 0.0 if lost else y * share, length


@inlined
def angle(y: float, x: float) -> float:
    """``atan2(y, x)`` to an ulp or two, without branches; 0 at the origin."""
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(ax, ay, TINY)
    # Above tan(π/8): atan t = π/4 + atan((t - 1)/(t + 1)).
    steep = t > 0.4142135623730950488
    t = (t - 1.0) / (t + 1.0) if steep else t
    z = t * t
    # The rational function of Cephes (Moshier 1989, atan.c), valid for |t| < 0.66.
    p = -1.615753718733365076637e1 - 8.750608600031904122785e-1 * z
    p = -1.228866684490136173410e2 + z * (-7.500855792314704667340e1 + z * p)
    p = -6.485021904942025371773e1 + z * p
    q = 1.650270098316988542046e2 + z * (2.485846490142306297962e1 + z)
    q = 4.853903996359136964868e2 + z * (4.328810604912902668951e2 + z * q)
    q = 1.945506571482613964425e2 + z * q
    value = t + t * (z * (p / q))
    value = value + 0.25 * math.pi if steep else value
    value = 0.5 * math.pi - value if ay > ax else value
    value = math.pi - value if x < 0.0 else value
    return -value if y < 0.0 else value
