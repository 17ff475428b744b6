"""Claim 18: is a solution with a larger branching factor more precise? On the grid yes; in the search, up to a point."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import ARMS, BY_HAND, DIVISIONS, errors, random_goals
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, finish, lines, where

BRUTE: dict[int, tuple[int, ...]] = {
    2: (15, 30, 60, 120, 240, 480, 960),
    3: (15, 30, 60, 120),
    4: (15, 30, 45),
}
"""What brute force can walk."""
METHODS = ("CB(1)", "CB(2)", "CB(3)", "BT")
SIZES = (30, 90, 270, 810, 2430, 7290, 65_610, 1_000_000)


def cases(effort: Effort) -> list[Row]:
    """Brute force where it can, divide and conquer from coarse to very fine."""
    few: dict[int, tuple[int, ...]] = {2: (15, 30)}
    brute = effort.pick(BRUTE, few)
    sizes = effort.pick(SIZES, (30, 810))
    listed: list[Row] = [
        {"dof": dof, "arm": ARMS[dof], "method": "brute force", "branching_factor": size}
        for dof, some in brute.items()
        for size in some
    ]
    return listed + [
        {"dof": dof, "arm": arm, "method": method, "branching_factor": size}
        for dof, arm in ARMS.items()
        for method in METHODS
        for size in sizes
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    arm, method, size = kinseek.load(case["arm"]), case["method"], case["branching_factor"]
    points = effort.pick(300 if arm.dof < 6 else 200, 3)
    solver: kinseek.Solver = kinseek.BruteForce(size)
    if method != "brute force":
        breadth = BY_HAND[arm.dof] if method == "BT" else int(method[3])
        solver = kinseek.DivideAndConquer(size, DIVISIONS, breadth)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver)
    return {**errors(solution)}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean error against B, one panel an arm, the median thin below it."""
    figure, axes = canvas(1, 4, (13, 4.2), sharey=True)
    for axis, dof in zip(axes[0], ARMS, strict=True):
        some = where(rows, dof=dof), "branching_factor"
        lines(axis, *some, "position_mean_mm", "method", ("brute force", *METHODS))
        thin = [{**look, "marker": "", "linewidth": 0.8, "alpha": 0.6} for look in LOOKS]
        lines(axis, *some, "position_median_mm", "method", ("brute force", *METHODS), "_{}", thin)
        axis.set(xscale="log", yscale="log", xlabel="B, branching factor", title=NAMES[dof])
    axes[0, 0].set_ylabel("position error [mm]; thin: median")
    finish(figure, axes[0, 0], path, "Claim 18: mean error against B, D = 3", 6)
