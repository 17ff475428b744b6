"""Poses in a row that have something in common, and how they are named: by their number in the path, from 0 on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def intervals(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Where flags, (N,), are set in a row: the first and the last of each stretch."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))


def these(first: int, last: int) -> str:
    """The poses of a stretch, and the verb of what is said of them."""
    return f"pose {first} is" if first == last else f"poses {first} to {last} are"
