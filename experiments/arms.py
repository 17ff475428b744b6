"""The paper's four arms, its random points and its heuristics (Sec. 4.1), and what the counts should be."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek

from .effort import Row

Array = NDArray[np.float64]

ARMS = {2: "planar2", 3: "cylindrical3", 4: "scara4", 6: "elbow6"}
"""The paper's Figure 4, by degrees of freedom."""

BRANCHING_FACTOR = 7200
DIVISIONS = 3

BY_HAND = {2: (4, 4), 3: (3, 2, 2), 4: (3, 3, 2, 1), 6: (3, 3, 3, 1, 1, 1)}
"""Breadth tuning (Sec. 3.2) is by hand there, and its numbers are not printed. These follow its words, and
were fixed before any result of BT was seen: high on the joints that move the hand, low on the others.
With two joints high on both, above the 2 and 3 that its Figure 8 shows to fail there.
"""

METHODS = ("CB(1)", "CB(2)", "CB(3)", "BT", "DT + BT", "tuned")
"""The solvers of Figures 8 and 9, and ours that chooses the breadths by itself."""


def solver_of(method: str, dof: int, branching_factor: int = BRANCHING_FACTOR) -> kinseek.DivideAndConquer:
    """Build the divide and conquer that a method's name stands for."""
    breadth: Any = {"BT": BY_HAND[dof], "DT + BT": BY_HAND[dof], "tuned": "tuned"}.get(method)
    if breadth is None:
        breadth = int(method[3])
    tree = "dynamic" if method in ("DT + BT", "tuned") else "static"
    return kinseek.DivideAndConquer(branching_factor, DIVISIONS, breadth, tree)


def random_joints(arm: kinseek.Arm, points: int, seed: int) -> Array:
    """Random joint values, (points, n), [rad] or [m]; more points begin with the same ones."""
    unit = np.random.default_rng([seed, arm.dof]).random((points, arm.dof))
    return np.asarray(arm.lower + unit * (arm.upper - arm.lower))


def random_goals(arm: kinseek.Arm, points: int, seed: int) -> Array:
    """Poses of random joint values, (points, 4, 4): reachable by construction, as in the paper."""
    return arm.fk(random_joints(arm, points, seed))


def timed(
    arm: kinseek.Arm, goal: Any, solver: kinseek.Solver | None = None
) -> tuple[kinseek.Solution, float]:
    """Solve a batch; return the answers and the shortest of up to ten CPU times [s] for all of it.

    CPU time, because what else runs on the machine shall not count; and all cores together.
    """
    first = goal.at(goal.target[:2]) if isinstance(goal, kinseek.Goal) else goal[:2]
    arm.ik(first, solver=solver)  # Compiling is not what is timed; a batch has a kernel of its own.
    times: list[float] = []
    while len(times) < 10 and sum(times) < 1.0:
        start = time.process_time()
        solution = arm.ik(goal, solver=solver)
        times.append(time.process_time() - start)
    return solution, min(times)


ERRORS = (
    "position_mean_mm",
    "position_median_mm",
    "position_p95_mm",
    "position_max_mm",
    "position_standard_error_mm",
    "orientation_mean_mrad",
)


def error_columns(position: Array, orientation: Array) -> Row:
    """Mean, median, 95th percentile, maximum and standard error of errors in [m] and [rad], (k,)."""
    millimetres = 1e3 * np.asarray(position)
    spread = millimetres.std(ddof=1) / np.sqrt(len(millimetres)) if len(millimetres) > 1 else 0.0
    values = (
        millimetres.mean(),
        np.median(millimetres),
        np.percentile(millimetres, 95),
        millimetres.max(),
        spread,
        1e3 * np.mean(orientation),
    )
    return dict(zip(ERRORS, map(float, values), strict=True))


def errors(solution: kinseek.Solution) -> Row:
    """How many points a batch has, and what `error_columns` makes of its errors."""
    position, orientation = solution.position_error, solution.orientation_error
    return {"points": len(position), **error_columns(position, orientation)}


def equation_1(branching_factor: int, dof: int) -> int:
    """Nodes that brute force expands (the paper, Eq. 1)."""
    return sum(branching_factor**i for i in range(1, dof + 1))


def spacings(branching_factor: int, divisions: int) -> list[int]:
    """Spacing of every pass, in nodes: B/D, then divided by D and rounded down, until it is one."""
    values = [max(branching_factor // divisions, 1)]
    while values[-1] > 1:
        values.append(max(values[-1] // divisions, 1))
    return values


def divide_and_conquer_nodes(branching_factor: int, divisions: int, breadths: tuple[int, ...]) -> int:
    """Nodes that divide and conquer expands: a tree of D values a joint, then of 2(⌊D/2⌋ + Br) - 1.

    A window never has more values than there are nodes at its spacing.
    """
    total = 0
    for number, spacing in enumerate(spacings(branching_factor, divisions)):
        level = 1
        for breadth in breadths:
            window = min(2 * (divisions // 2 + breadth) - 1, (branching_factor - 1) // spacing + 1)
            level *= window if number else min(divisions, branching_factor)
            total += level
    return total
