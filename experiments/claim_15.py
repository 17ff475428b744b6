"""Claim 15: does the orientation error vary in the same way as the position error?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import ARMS, Array, random_goals, solver_of
from .effort import Effort, Row
from .style import DOTS, NAMES, canvas, lines, save

METHODS = ("CB(1)", "CB(2)", "CB(3)", "DT + BT")
FAR, NEAR = 0.05, 0.005
"""High is above the first, low below the second, in [m] and [rad]: 5 cm and 5 mm, 3° and 0.3°."""


def cases(effort: Effort) -> list[Row]:
    """The heuristics on every arm."""
    del effort
    return [{"dof": dof, "arm": arm, "method": method} for dof, arm in ARMS.items() for method in METHODS]


def measure(case: Row, effort: Effort) -> Row:
    """Compare the two errors point by point."""
    arm = kinseek.load(case["arm"])
    points = effort.pick(1000, 10)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver_of(case["method"], arm.dof))
    position, turn = solution.position_error, solution.orientation_error
    return {
        "points": points,
        "position_mean_mm": float(1e3 * position.mean()),
        "orientation_mean_mrad": float(1e3 * turn.mean()),
        "rank_correlation": _rank_correlation(position, turn),
        "far_but_aligned": int(((position > FAR) & (turn < NEAR)).sum()),
        "near_but_turned": int(((position < NEAR) & (turn > FAR)).sum()),
    }


def _rank_correlation(first: Array, second: Array) -> float:
    """Spearman's coefficient; ties do not occur in measured errors."""
    ranks = [np.argsort(np.argsort(values)).astype(float) for values in (first, second)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean errors against each other, and how the single points correlate."""
    figure, axes = canvas(1, 2, (10, 4.4))
    means = "position_mean_mm", "orientation_mean_mrad"
    lines(axes[0, 0], rows, *means, "dof", ARMS, NAMES, DOTS)
    rows = [{**row, "place": METHODS.index(row["method"])} for row in rows]
    lines(axes[0, 1], rows, "place", "rank_correlation", "dof", ARMS, NAMES)
    axes[0, 0].set(
        xscale="log",
        yscale="log",
        xlabel="mean position error [mm]",
        ylabel="mean orientation error [mrad]",
        title="means of each solver",
    )
    axes[0, 1].set(ylabel="rank correlation over the points", ylim=(-1, 1), title="single points")
    axes[0, 1].set_xticks(range(len(METHODS)), METHODS)
    axes[0, 0].legend()
    figure.suptitle("Claim 15: position error and orientation error")
    save(figure, path)
