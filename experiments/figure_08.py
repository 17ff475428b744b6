"""Figure 8: mean position error against DOF for the paper's heuristics, D = 3, B = 7200."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import heuristics
from .arms import error_columns, random_goals, solver_of
from .effort import Effort, Row
from .heuristics import cases

__all__ = ["cases", "draw", "measure"]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch, and a digest of the answers, to see which methods give the same ones."""
    import hashlib

    arm = kinseek.load(case["arm"])
    points = effort.pick(100, 5)
    solver = solver_of(case["method"], arm.dof)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver)
    return {
        "points": points,
        "breadths": " ".join(map(str, solver.breadths(solution.problem))),
        **error_columns(solution.position_error, solution.orientation_error),
        "q_digest": "q" + hashlib.sha256(solution.q.tobytes()).hexdigest()[:12],
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean position error against DOF."""
    heuristics.draw(
        rows,
        path,
        {
            "position_mean_mm": "mean position error [mm], bars: 95 %",
            "position_median_mm": "median position error [mm]",
        },
        "Fig. 8: position error by heuristic, D = 3, B = 7200, the same 100 points for all",
    )
