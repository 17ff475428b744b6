"""Question 10: why do CB(2) and CB(3) fail on the two-link arm? Because its joints did not wrap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import kinseek

from .arms import ARMS, BRANCHING_FACTOR, DIVISIONS, error_columns, random_joints
from .effort import Effort, Row
from .readings import Reading, errors_of, search
from .style import LOOKS, canvas, lines, save, where

READINGS = {
    "wrap": Reading(),
    "no wrap": Reading(ends="clip"),
    "no wrap, window slides": Reading(ends="slide"),
    "wrap, K_P = 10": Reading(position_weight=10.0),
    "no wrap, K_P = 10": Reading(ends="clip", position_weight=10.0),
    "wrap, orientation ignored": Reading(orientation=False),
    "no wrap, orientation ignored": Reading(ends="clip", orientation=False),
    "no wrap, K_P = 100": Reading(ends="clip", position_weight=100.0),
}
SHOWN = ("wrap", "no wrap", "no wrap, window slides")


def cases(effort: Effort) -> list[Row]:
    """Each reading, arm and breadth, and more breadths for two joints, as breadth tuning may have there."""
    return [
        {"dof": dof, "arm": arm, "reading": reading, "breadth": breadth}
        for dof, arm in ARMS.items()
        for reading in READINGS
        for breadth in ((1, 2, 3, 4, 6, 8) if dof == 2 else (1, 2, 3))
        if dof < 6 or (breadth < effort.pick(4, 2) and reading in ("wrap", "no wrap"))
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors; apart for goals of which a turning joint lies in the last sixth of its range.

    With D = 3 a joint is first tried at 0°, 120° and 240°. What lies between 300° and 360° is nearest to 0°,
    and from there it can be reached only downwards, across the end of the range.
    """
    arm = kinseek.load(case["arm"])
    reading: Reading = replace(READINGS[case["reading"]])
    breadth = case["breadth"]
    points = effort.pick({2: 2000, 3: 1000, 4: 300, 6: 300 // breadth**2}[arm.dof], 5)
    joints = random_joints(arm, points, effort.seed)
    goals = arm.fk(joints)
    q = search(arm, goals, reading, BRANCHING_FACTOR, DIVISIONS, breadth)
    position, turned = errors_of(arm, q, goals)
    turning = arm.upper - arm.lower > 6
    near_end = ((joints / arm.upper > 5 / 6) & turning).any(axis=1)
    return {
        "points": points,
        **error_columns(position, np.sqrt(np.maximum(turned, 0))),
        "goals_near_end": float(near_end.mean()),
        "mean_near_end_mm": float(1e3 * position[near_end].mean()) if near_end.any() else 0.0,
        "mean_elsewhere_mm": float(1e3 * position[~near_end].mean()) if (~near_end).any() else 0.0,
        "above_10_mm": float((position > 0.01).mean()),
        "share_of_error_near_end": float(position[near_end].sum() / position.sum()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean error against DOF for each breadth, one panel a reading."""
    figure, axes = canvas(1, 4, (13, 5.2), sharey=True)
    for axis, reading in zip(axes[0], SHOWN, strict=False):
        some = [{**row, "place": list(ARMS).index(row["dof"])} for row in where(rows, reading=reading)]
        lines(axis, some, "place", "position_mean_mm", "breadth", (1, 2, 3), "CB({})")
        axis.set(yscale="log", title=reading, xlabel="degrees of freedom")
        axis.set_xticks(range(len(ARMS)), list(map(str, ARMS)))
        axis.set_xlim(-0.3, len(ARMS) - 0.7)
        for place, dof in enumerate(ARMS):
            if not where(rows, reading=reading, dof=dof):
                axis.text(place, 1.0, "not run", ha="center", va="center", rotation=90, color="#555555")
    axes[0, 1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.15))
    # Other looks than beside it, where a line is a breadth.
    two = where(rows, dof=2)
    lines(axes[0, 3], two, "breadth", "position_mean_mm", "reading", SHOWN, looks=LOOKS[3:])
    axes[0, 3].set(title="two-link arm", xlabel="Br, breadth of both joints")
    axes[0, 3].legend(loc="upper center", bbox_to_anchor=(0.5, -0.15))
    axes[0, 0].set(ylabel="mean position error [mm]", ylim=(0.05, 200))
    figure.suptitle("Question 10: constant breadth, with and without wrapping, D = 3, B = 7200")
    save(figure, path)
