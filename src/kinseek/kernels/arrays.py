"""Bundles of arrays for kernels: kernels accept a NamedTuple, but not a frozen dataclass."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class ChainArrays(NamedTuple):
    """A serial chain: m physical joints moved by n variables."""

    fixed: Annotated[Array, "m+1", 3, 4]
    """``A_1 … A_m, A_tip``, (m+1, 3, 4), lengths in [m]."""
    prismatic: Annotated[Flags, "m"]
    """(m,)"""
    leader: Annotated[Indices, "m"]
    """Variable that moves each physical joint, (m,)."""
    multiplier: Annotated[Array, "m"]
    """(m,)"""
    offset: Annotated[Array, "m"]
    """[rad] or [m], (m,)"""
    start: Annotated[Indices, "n+1"]
    """Physical joints ``start[d] … start[d+1]-1`` are determined by variables 0 … d, (n+1,)."""
    lower: Annotated[Array, "n"]
    """[rad] or [m], (n,)"""
    upper: Annotated[Array, "n"]
    """[rad] or [m], (n,)"""


def chain_arrays(
    fixed: Array,
    prismatic: Flags,
    leader: Indices,
    multiplier: Array,
    offset: Array,
    limits: tuple[Array, Array],
) -> ChainArrays:
    """Bundle a chain and divide it into the segments that each variable completes."""
    lower, upper = limits
    known_after = np.maximum.accumulate(leader)
    start = np.searchsorted(known_after, np.arange(len(lower) + 1)).astype(np.int64)
    return ChainArrays(
        np.ascontiguousarray(fixed),
        np.ascontiguousarray(prismatic),
        np.ascontiguousarray(leader),
        np.ascontiguousarray(multiplier),
        np.ascontiguousarray(offset),
        start,
        np.ascontiguousarray(lower),
        np.ascontiguousarray(upper),
    )


class Limits(NamedTuple):
    """Limits of the variables [rad] or [m], (n,) each; infinite or very large for a joint that turns fully."""

    lower: Annotated[Array, "n"]
    upper: Annotated[Array, "n"]


class GoalArrays(NamedTuple):
    """Target and weights of the relevant parts of a pose."""

    target: Annotated[Array, 3, 4]
    """Columns x, y, z, p of the target pose, (3, 4), lengths in [m]."""
    position_weight: float
    """K_P of the paper, per [m]."""
    axis_weights: Annotated[Array, 3]
    """K_A for the x, y and z columns, (3,): a pose (1, 1, 0)·K_A, a direction (1, 0, 0)·K_A."""
