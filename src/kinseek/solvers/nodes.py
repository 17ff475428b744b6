"""The paper's search space: B nodes a joint, evenly spread over its range (Sec. 2.1)."""

from __future__ import annotations

import os

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.grid.descent import Grid
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism

MOST_NODES = 2 * 10**10
"""Nodes that a search visits unless told otherwise: about a minute."""

NODES_A_SECOND = 3e8
"""What one core visits, by benchmarks/test_searches.py, to tell how long a search would take."""

A_POSE, A_ROW = 300, 3000
"""Nodes that one pose of a function counts as: a microsecond, or ten where Python runs for every row."""


def joint_grid(chain: Mechanism, count: int, *, static: bool = False, wrap: bool = True) -> Grid:
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


def require_patience(problem: Problem, nodes: int, most_nodes: int | None, change: str) -> None:
    """Refuse a search that would take for ever; one with a time limit ends anyway.

    Args:
        problem: One target or a batch: what is counted is the work for one.
        nodes: That the search visits.
        most_nodes: That it may visit; None lifts the guard.
        change: Which parameters make it fewer.

    Raises:
        InvalidSolver: With the number of nodes, and how long they would take.
    """
    if most_nodes is None or problem.time_limit is not None:
        return
    chain = problem.mechanism
    if problem.budget is not None:
        nodes = min(nodes, problem.budget)
    weight = 1
    if chain.axes is None:
        weight = A_POSE if chain.cheap else A_ROW
    if nodes * weight <= most_nodes:
        return
    counted = f", each pose of a function counted as {weight:,}" if weight > 1 else ""
    raise InvalidSolver(
        f"the search would visit {_rounded(nodes)} nodes{counted}, about {_duration(nodes * weight)} a target; "
        f"most_nodes allows {most_nodes:,}. Choose {change}, give a time_limit, or lift the guard by most_nodes=None"
    )


def _rounded(nodes: int) -> str:
    return f"{nodes:,}" if nodes < 10**15 else f"{nodes:.2g}"


def _duration(nodes: int) -> str:
    seconds = nodes / NODES_A_SECOND
    for name, length in (("years", 3.156e7), ("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return (
                f"{seconds / length:,.0f} {name}"
                if seconds < 1e6 * length
                else f"{seconds / length:.1e} {name}"
            )
    return f"{seconds:.0f} seconds"
