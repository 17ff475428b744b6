"""Question 6, the cylindrical arm: its bump at D = 4 is a slide that cannot walk back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import BRANCHING_FACTOR, errors, random_goals, random_joints, spacings
from .effort import Effort, Row
from .style import canvas, finish, lines

ARM, PLAIN = "cylindrical3", "3 3 3"
BREADTHS = {
    PLAIN: "3 on all joints",
    "6 3 3": "6 on the turn",
    "3 6 3": "6 on the lift",
    "3 3 6": "6 on the reach",
}
"""Of turn, lift and reach."""
LOST = 1e-3
"""[m]"""


def cases(effort: Effort) -> list[Row]:
    """CB(3), and twice the breadth on one joint at a time, for small D."""
    divisions = effort.pick((3, 4, 5, 6), (4,))
    return [{"divisions": d, "breadths": each} for d in divisions for each in BREADTHS]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch; and did the first pass take the reach's nearest sample?"""
    arm, points, divisions = kinseek.load(ARM), effort.pick(1000, 20), case["divisions"]
    goals, q = random_goals(arm, points, effort.seed), random_joints(arm, points, effort.seed)
    breadths = tuple(map(int, str(case["breadths"]).split()))
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, divisions, breadths)
    solution = arm.ik(goals, solver=solver)
    first = solver.solve(kinseek.Problem(arm.chain, kinseek.Goal.pose(goals), budget=divisions**arm.dof))
    off = np.abs(first.q - q)[:, 2] / (arm.upper - arm.lower)[2]
    # Half a cell, and a node for the rounding of samples to nodes.
    wrong = off > 0.5 / divisions + 1 / BRANCHING_FACTOR
    lost = solution.position_error > LOST
    return {
        **errors(solution),
        "lost": float(lost.mean()),
        "wrong_cell": float(wrong.mean()),
        "wrong_cell_of_lost": float(wrong[lost].mean()) if lost.any() else 0.0,
        "comes_up_to": comes_up_to(divisions, breadths[2]),
    }


def comes_up_to(divisions: int, breadth: int) -> float:
    """Where in its range the reach can come to from the lowest first sample; the window after it is slid inside."""
    later, side = spacings(BRANCHING_FACTOR, divisions)[1:], divisions // 2 + breadth - 1
    slid = BRANCHING_FACTOR // (2 * divisions) % later[0] + side * later[0]
    return min((side * sum(later) + slid) / BRANCHING_FACTOR, 1.0)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean error and the share that is lost, against D."""
    figure, axes = canvas(1, 2, (10, 4.2))
    some = [{**row, "percent": 100 * row["lost"]} for row in rows]
    for axis, name in zip(axes[0], ("position_mean_mm", "percent"), strict=True):
        lines(axis, some, "divisions", name, "breadths", BREADTHS, BREADTHS)
    axes[0, 0].set(yscale="log", xlabel="D", ylabel="mean position error [mm]")
    axes[0, 1].set(xlabel="D", ylabel="more than 1 mm off [% of goals]")
    for axis in axes[0]:
        axis.set_xticks(sorted({row["divisions"] for row in rows}))
    finish(
        figure,
        axes[0, 0],
        path,
        "Question 6: the bump of the cylindrical arm comes from its reach",
        len(BREADTHS),
    )
