"""Questions 6 and 10, the rivals: other readings that spike at D = 4, what they do elsewhere, and limited joints."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import BRANCHING_FACTOR, error_columns, random_joints
from .effort import Effort, Row
from .readings import Reading, errors_of, search
from .style import NAMES, canvas, finish, lines, where
from .sweep import ARMS

AS_BUILT = "as built"
RIVAL = "±180°, no wrap, formula"
LETTER = "limited joints to the letter"
READINGS: dict[str, tuple[float, Reading]] = {
    "0-360°, wrap": (0.0, Reading(ends="turns wrap")),
    "±180°, no wrap": (-np.pi, Reading(ends="clip")),
    "±180°, wrap, formula": (-np.pi, Reading(ends="turns wrap", first="formula")),
    RIVAL: (-np.pi, Reading(ends="clip", first="formula")),
    "±180°, slides, formula": (-np.pi, Reading(ends="slide", first="formula")),
}
"""Where a full turn begins, and the reading. The first is also what the paper says of joints that do not turn."""


def cases(effort: Effort) -> list[Row]:
    """D around the spike; and `kinseek.DivideAndConquer` itself beside the readings."""
    return [
        {"dof": dof, "arm": arm, "reading": reading, "breadth": breadth, "divisions": d}
        for dof, arm in ARMS.items()
        for reading in (AS_BUILT, *READINGS)
        for breadth in effort.pick((1, 2, 3), (2,))
        for d in effort.pick({2: (3, 4, 5, 6, 7, 8), 3: (3, 4, 5, 6), 4: (3, 4, 5)}[dof], (3, 4))
        if dof < 4 or breadth < 3 or d == 3
    ]


def turned(arm: kinseek.Arm, low: float) -> kinseek.Arm:
    """The arm with full turns counted from `low` [rad]."""
    full = arm.upper - arm.lower > 6.28
    lower = np.where(full, low, arm.lower)
    upper = np.where(full, low + 2 * np.pi, arm.upper)
    return kinseek.Arm.from_fk(arm.fk, lower, upper)


def measure(case: Row, effort: Effort) -> Row:
    """Errors for the same goals under each reading."""
    arm, breadth, divisions = kinseek.load(case["arm"]), case["breadth"], case["divisions"]
    points = effort.pick({2: 600, 3: 400, 4: 60}[arm.dof], 5)
    goals = arm.fk(random_joints(arm, points, effort.seed))
    if case["reading"] == AS_BUILT:
        q = arm.ik(goals, solver=kinseek.DivideAndConquer(BRANCHING_FACTOR, divisions, breadth)).q
    else:
        low, reading = READINGS[case["reading"]]
        q = search(turned(arm, low), goals, reading, BRANCHING_FACTOR, divisions, breadth)
    position, turn = errors_of(arm, q, goals)
    return {"points": points, **error_columns(position, np.sqrt(np.maximum(turn, 0)))}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Error against D, one panel an arm."""
    figure, axes = canvas(1, 3, (13, 4.6), sharey=True)
    breadth = 2
    for axis, dof in zip(axes[0], ARMS, strict=True):
        some = where(rows, dof=dof, breadth=breadth)
        lines(axis, some, "divisions", "position_mean_mm", "reading", (AS_BUILT, *READINGS))
        axis.set(yscale="log", xlabel="D", title=f"{NAMES[dof]}, Br = {breadth}")
        axis.set_xticks(sorted({row["divisions"] for row in where(rows, dof=dof)}))
    axes[0, 0].set_ylabel("mean position error [mm]")
    finish(
        figure,
        axes[0, 0],
        path,
        "Questions 6 and 10, the rivals: readings that need no special weights, K_P = K_A",
        3,
    )
