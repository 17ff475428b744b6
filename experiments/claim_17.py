"""Claim 17: 500 points of a seven-joint arm. The paper's program is not available; ours runs on the Panda."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import BRANCHING_FACTOR, random_goals, timed
from .effort import Effort, Row
from .style import canvas, save

SEARCHES: dict[str, kinseek.Solver | None] = {
    "default": None,
    "DaC + CB(1)": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, 1),
    "DaC + CB(2)": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, 2),
    "DaC + tuned": kinseek.DivideAndConquer(BRANCHING_FACTOR, 3, "tuned"),
    "coordinate descent": kinseek.CoordinateDescent(),
}

QUOTED = 10.0
"""What the paper quotes for 500 points of some arm of seven joints [s]."""


def cases(effort: Effort) -> list[Row]:
    """The default search, divide and conquer, and coordinate descent alone."""
    # To tune breadths for seven joints takes longer than all the rest of a quick run.
    chosen = effort.pick(tuple(SEARCHES), tuple(name for name in SEARCHES if name != "DaC + tuned"))
    return [{"search": search, "arm": "panda"} for search in chosen]


def measure(case: Row, effort: Effort) -> Row:
    """Time 500 points."""
    arm, points = kinseek.load("panda"), effort.pick(500, 3)
    goal = kinseek.Goal.pose(random_goals(arm, points, effort.seed))
    solution, seconds = timed(arm, goal, SEARCHES[case["search"]])
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
    axis.barh(places, [row["seconds"] for row in rows], color="#56b4e9", height=0.5)
    axis.axvline(QUOTED, color="#c23b00", linestyle="--")
    axis.set(xscale="log", xlim=(1e-4, 100))
    axis.set_xlabel(f"time for {rows[0]['points']} points of a 7-DOF arm (Panda) [s]")
    axis.set_yticks(places, [f"{row['search']}\n{row['seconds']:.2g} s" for row in rows])
    axis.invert_yaxis()
    above = axis.secondary_xaxis("top")
    above.set_xticks([QUOTED], ["MATLAB, in the paper: 10 s"], color="#c23b00")
    solved = axis.secondary_yaxis("right")
    solved.set_yticks(places, [f"{100 * row['solved']:.3g} %" for row in rows])
    solved.set_ylabel("points within 1 µm and 1 µrad")
    save(figure, path)
