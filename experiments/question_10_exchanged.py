"""Question 10, another way: with its two lengths exchanged, the two-link arm fails as printed, wrapping and all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import BRANCHING_FACTOR, error_columns, random_goals
from .effort import Effort, Row
from .mirror import travel
from .style import canvas, lines, plain_ticks, save, where

LENGTHS = {"0.5, 0.25": (0.5, 0.25), "0.375, 0.375": (0.375, 0.375), "0.25, 0.5": (0.25, 0.5)}
"""First and second link [m]. The paper prints the first pair."""
EXCHANGED = "0.25, 0.5"


def cases(effort: Effort) -> list[Row]:
    """The breadths of Figure 8 and of breadth tuning on two joints, against D."""
    return [
        {"lengths": lengths, "position_weight": weight, "breadth": breadth, "divisions": d}
        for lengths in LENGTHS
        for weight in effort.pick((1.0, 20.0), (1.0,))
        for breadth in effort.pick((1, 2, 3, 4), (2,))
        for d in effort.pick((3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 32), (3, 4))
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    rows = [[length, 0, 0, 0] for length in LENGTHS[case["lengths"]]]
    arm = kinseek.Arm.from_dh(rows, [0.0, 0.0], [2 * np.pi, 2 * np.pi])
    points, divisions, breadth = effort.pick(1000, 10), case["divisions"], case["breadth"]
    goals = random_goals(arm, points, effort.seed)
    goal = kinseek.Goal.pose(goals, position_weight=case["position_weight"])
    solution = arm.ik(goal, solver=kinseek.DivideAndConquer(BRANCHING_FACTOR, divisions, breadth))
    return {
        "points": points,
        "travel_deg": float(np.degrees(travel(divisions, breadth))),
        **error_columns(solution.position_error, solution.orientation_error),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Error against D for each pair of lengths; and against the breadth at D = 3."""
    figure, axes = canvas(1, 4, (13, 4.2), sharey=True)
    for axis, lengths in zip(axes[0], LENGTHS, strict=False):
        some = where(rows, lengths=lengths, position_weight=1.0)
        lines(axis, some, "divisions", "position_mean_mm", "breadth", (1, 2, 3, 4), "Br = {}")
        axis.set(xscale="log", yscale="log", xlabel="D", title=f"links of {lengths} m")
        plain_ticks(axis.xaxis, (3, 4, 5, 6, 8, 12, 16, 32))
    some = where(rows, divisions=3, position_weight=1.0)
    lines(axes[0, 3], some, "breadth", "position_mean_mm", "lengths", LENGTHS, "{} m")
    axes[0, 3].set(xlabel="Br, breadth of both joints", title="D = 3")
    axes[0, 3].set_xticks([1, 2, 3, 4])
    axes[0, 0].set_ylabel("mean position error [mm]")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower left", ncols=4)
    figure.legend(*axes[0, 3].get_legend_handles_labels(), loc="outside lower right", ncols=len(LENGTHS))
    figure.suptitle(
        "Question 10, another way: two links in another order, joints that wrap, K_P = K_A, B = 7200"
    )
    save(figure, path)
