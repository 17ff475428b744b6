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
