"""Slopes of a cubic spline with continuous second derivatives.

The slopes m at the knots solve ``h[i] m[i-1] + 2 (h[i-1] + h[i]) m[i] + h[i-1] m[i+1] = 3 (h[i] D[i-1] + h[i-1] D[i])``,
with the widths h and the divided differences D of the pieces (*de Boor 2001, chapter IV*); m is given at both ends.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry


@entry
def spline_slopes(
    knots: Annotated[Array, "k"], values: Annotated[Array, "k", "n"], slopes: Annotated[Array, "k", "n", OUT]
) -> None:
    """Compute the slopes of a cubic spline at its inner knots.

    Args:
        knots: Increasing, (k,), k >= 2.
        values: At the knots, (k, n).
        slopes: The first and the last row are given; the others are computed, (k, n).
    """
    last = len(knots) - 1
    above = np.empty(len(knots))
    above[0] = 0.0
    for i in range(1, last):
        before, after = knots[i] - knots[i - 1], knots[i + 1] - knots[i]
        # Elimination (Thomas 1949); the system is diagonally dominant.
        pivot = 2.0 * (before + after) - after * above[i - 1]
        above[i] = before / pivot
        for j in range(values.shape[1]):
            right = 3.0 * (
                after * (values[i, j] - values[i - 1, j]) / before
                + before * (values[i + 1, j] - values[i, j]) / after
            )
            slopes[i, j] = (right - after * slopes[i - 1, j]) / pivot
    for back in range(1, last):
        i = last - back
        for j in range(values.shape[1]):
            slopes[i, j] -= above[i] * slopes[i + 1, j]


@entry
def divide_pieces(
    begins: Annotated[Array, "m", "n"],
    slopes: Annotated[Array, "m", "n", 3],
    widths: Annotated[Array, "m"],
    new_begins: Annotated[Array, "m", "p", "n", OUT],
    new_slopes: Annotated[Array, "m", "p", "n", 3, OUT],
) -> None:
    """Divide the pieces of a curve into equal parts.

    The coefficients of a quadratic polynomial on a part from a to b are its blossom at (a, a), (a, b) and (b, b)
    (*Farouki 2012*).

    Args:
        begins: Values at the begins of the pieces, (m, n).
        slopes: Bernstein coefficients of the slopes, (m, n, 3).
        widths: Widths of the pieces, (m,).
        new_begins: Receives the values at the begins of the parts, (m, p, n).
        new_slopes: Receives the coefficients on the parts, (m, p, n, 3).
    """
    parts = new_begins.shape[1]
    for i in range(len(begins)):
        third = widths[i] / (3.0 * parts)
        for j in range(begins.shape[1]):
            d0, d1, d2, value = slopes[i, j, 0], slopes[i, j, 1], slopes[i, j, 2], begins[i, j]
            for part in range(parts):
                a, b = part / parts, (part + 1) / parts
                # Linear functions of one argument of the blossom.
                at_a0, at_a1 = d0 + a * (d1 - d0), d1 + a * (d2 - d1)
                at_b0, at_b1 = d0 + b * (d1 - d0), d1 + b * (d2 - d1)
                c0, c1, c2 = (
                    at_a0 + a * (at_a1 - at_a0),
                    at_a0 + b * (at_a1 - at_a0),
                    at_b0 + b * (at_b1 - at_b0),
                )
                new_begins[i, part, j] = value
                new_slopes[i, part, j, 0], new_slopes[i, part, j, 1], new_slopes[i, part, j, 2] = c0, c1, c2
                value += third * (c0 + c1 + c2)
