"""Intervals of consecutive poses with a common property, and their wording; poses are counted from 0."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def intervals(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of set flags, (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))


def these(first: int, last: int) -> str:
    """Return the poses of an interval as the subject of a sentence, with its verb."""
    return f"pose {first} is" if first == last else f"poses {first} to {last} are"
