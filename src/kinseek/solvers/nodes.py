"""The paper's search space: B nodes a joint, evenly spread over its range (Sec. 2.1)."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import Array, Indices
from kinseek.robots.chain import SerialChain


class Grid(NamedTuple):
    """Node i of joint d has the value ``lower[d] + i · step[d]``."""

    lower: Array
    """[rad] or [m], (n,)"""
    upper: Array
    """[rad] or [m], (n,)"""
    step: Array
    """[rad] or [m], (n,)"""
    wraps: NDArray[np.bool_]
    """Is node B node 0 again? (n,)"""
    size: int
    """B"""
    table: Array
    """All values made beforehand, (n, B): the static tree; or (n, 0): made when needed, the dynamic tree."""

    def values_of(self, nodes: Indices) -> Array:
        """Joint values of nodes, (n, k) -> (n, k), [rad] or [m]."""
        values = self.lower[:, None] + self.step[:, None] * nodes
        return np.minimum(values, self.upper[:, None])


def joint_grid(chain: SerialChain, count: int, *, static: bool = False, wrap: bool = True) -> Grid:
    """Spread `count` nodes over each joint's range.

    A joint whose ends are the same pose gets ``lower + i · range / B``, as the paper's 360/B · i: its last
    node is one step short of its first. Any other joint gets both of its limits,
    ``lower + i · range / (B - 1)``. Departs from the paper, which uses the first rule for all: a goal at an
    upper limit would lie off the grid.
    """
    wraps = chain.wraps & wrap
    reach = chain.upper - chain.lower
    step = reach / np.where(chain.wraps, count, max(count - 1, 1))
    grid = Grid(chain.lower, chain.upper, step, wraps, count, np.empty((chain.dof, 0)))
    if static:
        require_memory(chain.dof * count, "the static tree makes every node first")
        everything = np.broadcast_to(np.arange(count, dtype=np.int64), (chain.dof, count))
        grid = grid._replace(table=np.ascontiguousarray(grid.values_of(everything)))
    return grid


def require_memory(nodes: int, why: str) -> None:
    """Refuse a tree that would not fit, before any of it is made.

    Raises:
        InvalidSolver: With the number of nodes, the memory they need and the memory there is.
    """
    needed, there = nodes * 24, physical_memory()  # A value, its number and a temporary.
    if needed > there / 2:
        raise InvalidSolver(
            f"{why}: {nodes:,} nodes need {needed / 2**30:,.1f} GiB, "
            f"this machine has {there / 2**30:,.1f} GiB. "
            f"Choose a smaller branching_factor, or tree='dynamic' in DivideAndConquer"
        )


def physical_memory() -> int:
    """Memory of this machine in bytes; 8 GiB where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 * 2**30
