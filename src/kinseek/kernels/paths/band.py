"""Least squares over a whole path at once: a block-tridiagonal system with one block per pose."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined


@inlined
def invert(A: Array) -> None:
    """Invert a symmetric positive definite matrix, (n, n), in place (Gauss-Jordan without pivoting)."""
    n = A.shape[0]
    for k in range(n):
        pivot = 1.0 / A[k, k]
        A[k, k] = 1.0
        for j in range(n):
            A[k, j] *= pivot
        for i in range(n):
            if i == k:
                continue
            factor = A[i, k]
            A[i, k] = 0.0
            for j in range(n):
                A[i, j] -= factor * A[k, j]


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
        invert(blocks[i])
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
