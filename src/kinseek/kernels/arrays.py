"""Bundles of arrays for kernels: kernels accept a NamedTuple, but not a frozen dataclass."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .entry import F64, FLAG, I64, Bundle
from .layout import Rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class ChainArrays(NamedTuple):
    """A serial chain: m physical joints moved by n variables."""

    fixed: Array
    """``A_1 … A_m, A_tip``, (m+1, 3, 4), lengths in [m]."""
    prismatic: Flags
    """(m,)"""
    leader: Indices
    """Variable that moves each physical joint, (m,)."""
    multiplier: Array
    """(m,)"""
    offset: Array
    """[rad] or [m], (m,)"""
    start: Indices
    """Physical joints ``start[d] … start[d+1]-1`` are determined by variables 0 … d, (n+1,)."""
    lower: Array
    """[rad] or [m], (n,)"""
    upper: Array
    """[rad] or [m], (n,)"""


CHAIN = Bundle(
    ChainArrays,
    fixed=F64["m+1", 3, 4],
    prismatic=FLAG["m"],
    leader=I64["m"],
    multiplier=F64["m"],
    offset=F64["m"],
    start=I64["n+1"],
    lower=F64["n"],
    upper=F64["n"],
)
"""Declaration of a chain that Python passes to a kernel."""

CHAIN_ROWS = Rows(
    ChainArrays,
    fixed="floats3",
    prismatic="flags",
    leader="integers",
    multiplier="floats1",
    offset="floats1",
    start="integers",
    lower="floats1",
    upper="floats1",
)
"""Declaration of a chain in the handle of another bundle."""


def chain_arrays(
    fixed: Array,
    prismatic: Flags,
    leader: Indices,
    multiplier: Array,
    offset: Array,
    lower: Array,
    upper: Array,
) -> ChainArrays:
    """Bundle a chain and divide it into the segments that each variable completes."""
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

    lower: Array
    upper: Array


class GoalArrays(NamedTuple):
    """Target and weights of the relevant parts of a pose."""

    target: Array
    """Columns x, y, z, p of the target pose, (3, 4), lengths in [m]."""
    position_weight: float
    """K_P of the paper, per [m]."""
    axis_weights: Array
    """K_A for the x, y and z columns, (3,): a pose (1, 1, 0)·K_A, a direction (1, 0, 0)·K_A."""


GOAL = Bundle(GoalArrays, target=F64[3, 4], position_weight=F64, axis_weights=F64[3])
