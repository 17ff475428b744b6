"""The paper's search space: B nodes a joint, evenly spread over its range (Sec. 2.1)."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arrays import Indices
from kinseek.kernels.grid.descent import CLIPS, SLIDES, WRAPS, Grid, nodes_around
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import Deadline
from kinseek.support.notices import notice
from kinseek.support.validation import is_finite_number

from .base import Found

MOST_NODES = 2 * 10**10
"""Default limit of the nodes that a search visits: about a minute."""

A_POSE, A_ROW, A_TARGET = 300, 3000, 30_000
"""Nodes that one pose of a function counts as: a microsecond, or ten if every row runs Python code; and the additional nodes
of a target."""

TIES = ("rounding", "first")
"""Rules that choose between equally good leaves."""

LONG = 60.0
"""Estimated time after which a search is announced as a long one before it begins [s]."""

_WORTH_MEASURING = 2 * 10**9
"""Nodes below which the time of a search is not estimated. A core visits some 3e8 nodes a second
(benchmarks/test_searches.py), so fewer nodes take less than a minute on a core ten times slower."""
PROBE_OF_A_FUNCTION = 512
_PROBE, _PROBE_TIME = 1 << 23, 0.05
"""Size of the piece of a search from which the whole is estimated: poses of a function or leaves of a grid, and seconds."""


def joint_grid(
    chain: Mechanism, count: int, *, static: bool = False, wrap: bool = True, letter: bool = False
) -> Grid:
    """Spread `count` nodes over each joint's range.

    A joint whose ends are the same pose gets ``lower + i · range / B``, like the paper's 360/B · i: its last node is one
    step short of its first. Any other joint gets both of its limits, ``lower + i · range / (B - 1)``. This departs from the
    paper, which uses the first rule for all joints, so that a goal at an upper limit would lie off the grid; `letter`
    follows the paper there.
    """
    wraps = chain.wraps & wrap
    reach = chain.upper - chain.lower
    step = reach / np.where(chain.wraps | letter, count, max(count - 1, 1))
    grid = Grid(chain.lower, chain.upper, step, wraps, count, np.empty((chain.dof, 0)))
    if static:
        require_memory(chain.dof * count, "the static tree makes every node first")
        everything = np.broadcast_to(np.arange(count, dtype=np.int64), (chain.dof, count))
        grid = grid._replace(table=np.ascontiguousarray(grid.values_of(everything)))
    return grid


def require_memory(nodes: int, why: str) -> None:
    """Reject a tree that would not fit into memory, before any of it is built.

    Raises:
        InvalidSolver: The tree does not fit; the message has the number of nodes, the memory they need and the memory
            available.
    """
    needed, there = nodes * 24, physical_memory()  # A value, its number and a temporary.
    if needed > there / 2:
        raise InvalidSolver(
            f"{why}: {nodes:,} nodes need {needed / 2**30:,.1f} GiB, "
            f"this machine has {there / 2**30:,.1f} GiB. "
            f"Choose a smaller branching_factor, or tree='dynamic' in DivideAndConquer"
        )


def physical_memory() -> int:
    """Return the memory of this machine in bytes; 8 GiB if the system does not report it."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 * 2**30


def evenly_spaced_nodes(size: int, count: int, offset: Fraction) -> Indices:
    """Return indices of `count` nodes, one in each of `count` equal cells, at a fraction of the cell, (count,)."""
    over, under = offset.numerator, offset.denominator
    # B may be a billion and a fraction's denominator is any number: products beyond int64 need Python's integers.
    if (count * under + over) * size < 2**62:
        return np.asarray((np.arange(count, dtype=np.int64) * under + over) * size // (under * count))
    return np.array([(i * under + over) * size // (under * count) for i in range(count)], dtype=np.int64)


def zero_nodes(grid: Grid) -> list[int]:
    """Return for each joint the node nearest to the zero configuration, where Algorithm 2 begins."""
    steps = np.where(grid.step > 0, grid.step, 1.0)
    return [int(node) for node in np.rint(-grid.lower / steps).clip(0, grid.size - 1)]


def window_around(
    wraps: Sequence[bool], size: int, centre: Sequence[int], spacing: int, counts: Indices, clips: bool
) -> list[Indices]:
    """Return the nodes around a centre, for each joint; see `kernels.grid.descent.nodes_around`."""
    result = []
    for wrap, middle, count in zip(wraps, centre, counts.tolist(), strict=True):
        nodes = np.empty(count, dtype=np.int64)
        end = WRAPS if wrap else CLIPS if clips else SLIDES
        result.append(nodes[: nodes_around(int(middle), spacing, count, size, end, nodes)])
    return result


def tie_of(problem: Problem, ties: str) -> float:
    """Return the difference up to which errors count as equal, in the unit of the weighted error.

    With ``ties="first"`` it is 1e-12 of the largest terms of an error, some thousand times the rounding error of their sum.
    """
    if ties != "first":
        return 0.0
    axes, goal = problem.axes, problem.goal.arrays
    reach = 0.0 if axes is None else axes.reach
    far = float(np.linalg.norm(problem.goal.targets[0][:3, 3]))
    return 1e-12 * float(goal.position_weight * (far + reach) + np.sum(goal.axis_weights))


def require_ties(ties: str) -> None:
    """Check a rule for ties.

    Raises:
        InvalidSolver: The rule is unknown.
    """
    if ties not in TIES:
        raise InvalidSolver(f"ties must be one of {', '.join(map(repr, TIES))}; got {ties!r}")


def require_error(stop_below: Any) -> None:
    """Check the weighted error below which a search stops.

    Raises:
        InvalidSolver: The value is not a weighted error.
    """
    if (
        not (is_finite_number(stop_below) or (isinstance(stop_below, float) and stop_below == math.inf))
        or stop_below < 0
    ):
        raise InvalidSolver(f"stop_below must be a number >= 0, got {stop_below!r:.200}")


def require_patience(
    problem: Problem,
    nodes: int,
    most_nodes: int | None,
    change: str,
    search: Callable[[Problem, Deadline], Found],
    *,
    at_most: bool = False,
) -> None:
    """Reject a search that would take too long, and announce the time of a long one before it begins.

    A search with a time limit is never rejected, since it ends anyway.

    Args:
        problem: One target or a batch; it is rejected if one target is too much work.
        nodes: Nodes that the search of one target visits.
        most_nodes: Limit of these nodes; None removes the limit.
        change: Parameters that reduce the number of nodes.
        search: Solves one target. A piece of it is run and timed to estimate the time of the search on this machine.
        at_most: Whether `nodes` is only an upper bound.

    Raises:
        InvalidSolver: The search would take too long; the message has the number of nodes and the estimated time.
    """
    chain, targets = problem.mechanism, len(problem.goal.targets)
    if problem.budget is not None:
        nodes = min(nodes, problem.budget)
    weight = 1
    if chain.axes is None:
        weight = A_POSE if chain.cheap else A_ROW
    refused = most_nodes is not None and problem.time_limit is None and nodes * weight > most_nodes
    long = (nodes * weight + A_TARGET) * targets > _WORTH_MEASURING and (
        problem.time_limit or math.inf
    ) > LONG
    if targets == 0 or not (refused or long):
        return
    seconds = seconds_a_target(problem, nodes, search)
    would = f"the search {'may' if at_most else 'would'} visit {_rounded(nodes)} nodes"
    if refused:
        counted = f", each pose of a function counted as {weight:,}" if weight > 1 else ""
        raise InvalidSolver(
            f"{would}{counted}, about {_duration(seconds)} per target as measured on this machine; most_nodes allows "
            f"{most_nodes:,}. Choose {change}, give a time_limit, or disable this check with most_nodes=None"
        )
    total = min(seconds * targets, problem.time_limit or math.inf)
    if total > LONG:
        for_all = "" if targets == 1 else f" for each of {targets:,} targets"
        end = "; its time_limit ends it then" if total < seconds * targets else ""
        notice(
            f"{would}{for_all}, {'up to' if at_most else 'about'} {_duration(total)} as measured here{end}"
        )


def seconds_a_target(problem: Problem, nodes: int, search: Callable[[Problem, Deadline], Found]) -> float:
    """Estimate the time of the search of one target from a piece of it on this machine [s]."""
    one = next(iter(problem.each()))
    least = PROBE_OF_A_FUNCTION if problem.axes is None else _PROBE
    probe = replace(one, budget=min(least, one.budget or least), time_limit=None)
    search(replace(probe, budget=1), Deadline())  # Compilation happens once and is not part of the time.
    begun = time.perf_counter()
    found = search(probe, Deadline(_PROBE_TIME))
    seconds = time.perf_counter() - begun
    if found.evaluations <= least / 2 and not found.out_of_time:
        return seconds  # The piece was the whole search.
    return seconds * max(1.0, nodes / max(found.nodes_expanded, found.evaluations, 1))


def _rounded(nodes: int) -> str:
    return f"{nodes:,}" if nodes < 10**15 else f"{nodes:.2g}"


def _duration(seconds: float) -> str:
    for name, length in (("years", 3.156e7), ("days", 86_400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * length:
            return (
                f"{seconds / length:,.0f} {name}"
                if seconds < 1e6 * length
                else f"{seconds / length:.1e} {name}"
            )
    return f"{seconds:.0f} seconds"
