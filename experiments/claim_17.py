"""Claim 17: 500 points of a seven-joint arm. The paper's program is not to be had; ours runs on the Panda."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import BRANCHING_FACTOR, random_goals, timed
from .effort import Effort, Row
from .style import canvas, save

COLUMNS = ("search", "arm", "points", "seconds", "solved", "position_median_mm", "position_mean_mm")
SEARCHES: dict[str, kinseek.Solver | None] = {
    "default": None,
    "DaC + CB(1)": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, 1),
    "DaC + CB(2)": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, 2),
    "DaC + tuned": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, "tuned"),
    "coordinate descent": kinseek.CoordinateDescent(),
}


def cases(effort: Effort) -> list[Row]:
    """The default search, divide and conquer, and coordinate descent alone."""
    del effort
    return [{"search": search, "arm": "panda"} for search in SEARCHES]


def measure(case: Row, effort: Effort) -> Row:
    """Time 500 points."""
    arm, points = kinseek.load("panda"), effort.pick(500, 3)
    goal = kinseek.Goal.pose(random_goals(arm, points, effort.seed))
    solution, seconds = timed(arm, goal, SEARCHES[str(case["search"])])
    return {
        "points": points,
        "seconds": seconds,
        "solved": float(solution.success.mean()),
        "position_median_mm": float(1e3 * sorted(solution.position_error)[points // 2]),
        "position_mean_mm": float(1e3 * solution.position_error.mean()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Seconds for all points, against the ten that the paper quotes."""
    figure, axes = canvas(size=(8.5, 3.6))
    axis, places = axes[0, 0], range(len(rows))
    axis.barh(places, [float(row["seconds"]) for row in rows], color="#56b4e9", height=0.5)
    for place, row in zip(places, rows, strict=True):
        text = f" {row['seconds']:.2g} s; {100 * float(row['solved']):.3g} % within 1 µm and 1 µrad"
        axis.text(float(row["seconds"]), place, text, va="center", backgroundcolor="#ffffffc0")
    axis.axvline(10, color="#c23b00", linestyle="--", zorder=0, label="MATLAB, in the paper")
    axis.set(xscale="log", xlim=(1e-4, 3000))
    axis.set_xlabel(f"time for {rows[0]['points']} points of a 7-DOF arm (Panda) [s]")
    axis.set_yticks(places, [str(row["search"]) for row in rows])
    axis.invert_yaxis()
    axis.legend(loc="center right")
    save(figure, path)
