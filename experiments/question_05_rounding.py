"""Question 5, the grid's part: the sawtooth with Br = 1, the fall above D = 17, and the bump at D = 16."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import kinseek

from .arms import BRANCHING_FACTOR, error_columns, random_goals, spacings
from .effort import Effort, Row
from .style import NAMES, canvas, finish, lines, plain_ticks, where
from .sweep import ARMS

GRIDS = ("B = 7200", "B = 10^7", "B = D^k")
"""The last one is the power of D nearest to 7200 from above: its spacings are whole, nothing is rounded."""


def cases(effort: Effort) -> list[Row]:
    """Every D on three grids, for the arms with two and three joints."""
    return [
        {"dof": dof, "grid": grid, "breadth": breadth, "divisions": d}
        for dof in effort.pick((2, 3), (2,))
        for grid in GRIDS
        for breadth in effort.pick((1, 3), (3,))
        for d in effort.pick(range(3, 33), range(16, 18))
    ]


def branching_factor(grid: str, divisions: int) -> int:
    """The B of a grid."""
    power: int = divisions ** math.ceil(math.log(BRANCHING_FACTOR, divisions) - 1e-9)
    return {"B = 7200": BRANCHING_FACTOR, "B = 10^7": 10**7}.get(grid, power)


def least_reach(size: int, divisions: int, breadth: int) -> float:
    """The least that any later pass reaches to a side, in cells of the pass before."""
    side = divisions // 2 + breadth - 1
    return min(side * now / before for before, now in pairwise(spacings(size, divisions)))


def measure(case: Row, effort: Effort) -> Row:
    """Errors, and how far the passes reach."""
    arm, divisions, breadth = (
        kinseek.load(ARMS[case["dof"]]),
        case["divisions"],
        case["breadth"],
    )
    size, points = branching_factor(case["grid"], divisions), effort.pick(1000, 10)
    solver = kinseek.DivideAndConquer(size, divisions, breadth)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver)
    return {
        "branching_factor": size,
        "points": points,
        "passes": len(spacings(size, divisions)),
        "reach_in_cells": (divisions // 2 + breadth - 1) / divisions,
        "least_reach_in_cells": least_reach(size, divisions, breadth),
        **error_columns(solution.position_error, solution.orientation_error),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Errors on the three grids, and the least reach of any pass below."""
    figure, axes = canvas(2, 3, (13, 6.6), sharex=True, sharey="row", height_ratios=(2, 1))
    panels = ((2, 1), (2, 3), (3, 3))
    for over, under, (dof, breadth) in zip(axes[0], axes[1], panels, strict=True):
        some = where(rows, dof=dof, breadth=breadth)
        lines(over, some, "divisions", "position_mean_mm", "grid", GRIDS)
        lines(under, some, "divisions", "least_reach_in_cells", "grid", GRIDS)
        over.set(xscale="log", yscale="log", title=f"{NAMES[dof]}, Br = {breadth}")
        plain_ticks(under.xaxis, (3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32))
        under.set(xlabel="D", ylim=(0, 1.1))
    axes[0, 0].set_ylabel("mean position error [mm]")
    axes[1, 0].set_ylabel("least reach of a pass\n[cells of the one before]")
    finish(figure, axes[0, 0], path, "Question 5, the grid's part: what rounding the spacing does", 6)
