"""Least squares over a whole path at once: a block-tridiagonal system with one block per pose.

With the blocks B and the diagonal coupling c, elimination gives ``S[i] = B[i] - c[i-1] S[i-1]⁻¹ c[i-1]`` and substitution
``x[i] = S[i]⁻¹ (b'[i] + c[i] x[i+1])`` (Thomas 1949).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry

from .tube import invert


@entry
def solve_band(
    blocks: Annotated[Array, "k", "n", "n", OUT],
    coupling: Annotated[Array, "k", "n"],
    x: Annotated[Array, "k", "n", OUT],
) -> None:
    """Solve ``-c[i-1] x[i-1] + B[i] x[i] - c[i] x[i+1] = b[i]`` for all rows of x, block by block (Thomas 1949).

    Args:
        blocks: Symmetric blocks on the diagonal, (k, n, n); overwritten.
        coupling: c, the diagonals of the off-diagonal blocks, (k, n); the last row is ignored.
        x: b, (k, n), replaced by the solution.
    """
    n = x.shape[1]
    for i in range(len(x)):
        if i > 0:
            for r in range(n):
                for c in range(n):
                    blocks[i, r, c] -= coupling[i - 1, r] * blocks[i - 1, r, c] * coupling[i - 1, c]
                total = 0.0
                for c in range(n):
                    total += blocks[i - 1, r, c] * x[i - 1, c]
                x[i, r] += coupling[i - 1, r] * total
        invert(blocks[i], 0.0)
    y, last = np.empty(n), len(x) - 1
    for back in range(len(x)):
        i = last - back
        for r in range(n):
            y[r] = x[i, r] + (coupling[i, r] * x[i + 1, r] if i < last else 0.0)
        for r in range(n):
            total = 0.0
            for c in range(n):
                total += blocks[i, r, c] * y[c]
            x[i, r] = total
