"""Figure 9: time per point against the degrees of freedom for the paper's heuristics, D = 3, B = 7200."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import heuristics
from .arms import BRANCHING_FACTOR, DIVISIONS, divide_and_conquer_nodes, random_goals, solver_of, timed
from .effort import Effort, Row
from .heuristics import cases

__all__ = ["cases", "draw", "measure"]


def measure(case: Row, effort: Effort) -> Row:
    """Time a batch; the static tree is made once for it, as in the paper."""
    arm = kinseek.load(case["arm"])
    points = effort.pick(100, 5)
    solver = solver_of(case["method"], arm.dof)
    solution, seconds = timed(arm, random_goals(arm, points, effort.seed), solver)
    breadths = solver.breadths(solution.problem)
    return {
        "points": points,
        "breadths": " ".join(map(str, breadths)),
        "ms_per_point": 1e3 * seconds / points,
        "nodes_expanded": int(solution.nodes_expanded.max()),
        "closed_form": divide_and_conquer_nodes(BRANCHING_FACTOR, DIVISIONS, tuple(map(int, breadths))),
        "nodes_created": int(solution.nodes_created.max()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Time and nodes against DOF."""
    heuristics.draw(
        rows,
        path,
        {"ms_per_point": "time per point [ms]", "nodes_expanded": "nodes expanded per point"},
        "Fig. 9: time and work by heuristic, D = 3, B = 7200",
    )
