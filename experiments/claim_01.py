"""Claim 1: does divide and conquer find the best solution of the search space, and in logarithmic time?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import BY_HAND, DIVISIONS, random_goals
from .effort import Effort, Row
from .style import LOOKS, canvas, save, where
from .sweep import ARMS

METHODS = ("CB(1)", "CB(2)", "CB(3)", "BT", "tuned", "CB(3), beam 64")


def cases(effort: Effort) -> list[Row]:
    """Grids that brute force can walk."""
    full: dict[int, tuple[int, ...]] = {2: (60, 240, 960), 3: (60, 120), 4: (30, 60)}
    quick: dict[int, tuple[int, ...]] = {2: (60,), 3: (30,)}
    grids = effort.pick(full, quick)
    return [
        {"dof": dof, "arm": ARMS[dof], "branching_factor": grid, "method": method}
        for dof, all_grids in grids.items()
        for grid in all_grids
        for method in METHODS
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Compare with the best node of the same grid."""
    arm, grid, method = kinseek.load(case["arm"]), case["branching_factor"], case["method"]
    points = effort.pick(300 if arm.dof < 4 else 60, 3)
    goals = random_goals(arm, points, effort.seed)
    breadth: int | tuple[int, ...] | str = "tuned"
    if method == "BT":
        breadth = BY_HAND[arm.dof]
    elif method != "tuned":
        breadth = int(method[3])
    solver = kinseek.DivideAndConquer(grid, DIVISIONS, breadth, beam=64 if method.endswith("64") else 1)
    best = arm.ik(goals, solver=kinseek.BruteForce(grid))
    found = arm.ik(goals, solver=solver)
    ratio = found.weighted_error / best.weighted_error
    return {
        "points": points,
        "best_found": float((ratio < 1 + 1e-9).mean()),
        "error_over_best_median": float(np.median(ratio)),
        "error_over_best_p95": float(np.percentile(ratio, 95)),
        "nodes_expanded": int(found.nodes_expanded.max()),
        "nodes_brute_force": int(best.nodes_expanded.max()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Share of points where the best node was found."""
    grids = sorted({(row["dof"], row["branching_factor"]) for row in rows})
    figure, axes = canvas(size=(8, 4.2))
    for number, (look, method) in enumerate(zip(LOOKS, METHODS, strict=False)):
        some = [where(rows, dof=dof, branching_factor=grid, method=method)[0] for dof, grid in grids]
        places = [place + 0.08 * (number - 2.5) for place in range(len(grids))]
        points_only = {**look, "linestyle": "none"}
        axes[0, 0].plot(places, [100 * row["best_found"] for row in some], label=method, **points_only)
    axes[0, 0].set(ylabel="points with the best node found [%]", ylim=(-3, 103))
    axes[0, 0].set_xticks(range(len(grids)), [f"{dof} DOF\nB = {grid}" for dof, grid in grids])
    axes[0, 0].legend(loc="center left", bbox_to_anchor=(1, 0.5), title="DaC +")
    axes[0, 0].set_title("Claim 1: how often divide and conquer finds the best node")
    save(figure, path)
