"""Figure 6: time per point against D, B = 7200, two to four degrees of freedom."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import sweep
from .arms import BRANCHING_FACTOR, divide_and_conquer_nodes, random_goals, timed
from .effort import Effort, Row
from .sweep import cases

__all__ = ["cases", "draw", "measure"]


def measure(case: Row, effort: Effort) -> Row:
    """Time a batch; the nodes are the same for every point."""
    dof, divisions, breadth = case["dof"], case["divisions"], case["breadth"]
    arm = kinseek.load(case["arm"])
    points = effort.pick(100 if dof < 4 else 20, 3)
    solution, seconds = timed(arm, random_goals(arm, points, effort.seed), sweep.solver(case))
    return {
        "points": points,
        "ms_per_point": 1e3 * seconds / points,
        "nodes_expanded": int(solution.nodes_expanded.max()),
        "closed_form": divide_and_conquer_nodes(BRANCHING_FACTOR, divisions, (breadth,) * dof),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Time against D."""
    sweep.draw(
        rows,
        path,
        {"ms_per_point": "time per point [ms]", "nodes_expanded": "nodes expanded per point"},
        "Fig. 6: time per point against D, and the work that takes it, B = 7200",
    )
