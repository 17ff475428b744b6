"""Figure 7: mean position error against D, B = 7200, two to four degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import sweep
from .arms import errors, random_goals
from .effort import Effort, Row
from .sweep import cases

__all__ = ["cases", "draw", "measure"]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    arm = kinseek.load(case["arm"])
    points = effort.pick(1000 if arm.dof < 4 else 100, 5)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=sweep.solver(case))
    return {**errors(solution)}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean position error against D."""
    labels = {"position_mean_mm": "mean position error [mm], bars: 95 %"}
    sweep.draw(rows, path, labels, "Fig. 7: mean position error against D, B = 7200")
