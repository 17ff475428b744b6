"""Claim 16: does an unreachable goal make the arm point towards it?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import ARMS, Array, solver_of
from .effort import Effort, Row
from .style import NAMES, canvas, lines, save, where

CENTRES = {2: (0, 0, 0), 3: (0, 0, 0.25), 4: (0, 0, -0.125), 6: (0, 0, 0.25)}
"""Where the arm's direction is measured from: its first joint, at the height of the goals [m]."""
REACH = 0.75
"""Of all four arms, from there [m]."""


def cases(effort: Effort) -> list[Row]:
    """Goals just beyond and far beyond the reach, as positions and as whole poses."""
    factors = effort.pick((1.05, 1.2, 1.5, 2.0, 4.0, 10.0), (1.5, 4.0))
    return [
        {"dof": dof, "arm": arm, "goal": goal, "distance_over_reach": factor}
        for dof, arm in ARMS.items()
        for goal in ("position", "pose")
        for factor in factors
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Angle between the tip's direction and the goal's; and how far beyond the least possible the error is.

    Only the elbow arm can point up or down; the others get goals in the plane of their reach. A pose asks for
    a random turn of the hand as well: about the vertical, where the arm can turn about nothing else.
    """
    dof, arm = case["dof"], kinseek.load(case["arm"])
    points = effort.pick(500 if dof < 6 else 200, 5)
    rng = np.random.default_rng([effort.seed, dof, 16])
    direction = rng.normal(size=(points, 3))
    turn = rng.normal(size=(points, 4))
    if dof < 6:
        direction[:, 2] = 0.0
        turn[:, 1:3] = 0.0
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    centre = np.array(CENTRES[dof], dtype=float)
    position = centre + REACH * case["distance_over_reach"] * direction
    goal = kinseek.Goal.position(position)
    if case["goal"] == "pose":
        goal = kinseek.Goal.pose(kinseek.pose(position, quat_wxyz=turn))
    solution = arm.ik(goal, solver=solver_of("CB(3)", dof))
    tip = arm.fk(solution.q)[:, :3, 3] - centre
    angle = np.degrees(_angle(tip, direction))
    least = REACH * (case["distance_over_reach"] - 1)
    return {
        "points": points,
        "angle_mean_deg": float(angle.mean()),
        "angle_p95_deg": float(np.percentile(angle, 95)),
        "angle_max_deg": float(angle.max()),
        "stretch_mean": float(np.linalg.norm(tip, axis=1).mean() / REACH),
        "excess_mean_mm": float(1e3 * (solution.position_error - least).mean()),
    }


def _angle(first: Array, second: Array) -> Array:
    sine = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.arctan2(sine, np.sum(first * second, axis=1)))


def draw(rows: Sequence[Row], path: Path) -> None:
    """Angle against distance."""
    figure, axes = canvas(1, 2, (10, 4.2), sharey=True)
    for axis, goal in zip(axes[0], ("position", "pose"), strict=True):
        lines(axis, where(rows, goal=goal), "distance_over_reach", "angle_mean_deg", "dof", ARMS, NAMES)
        axis.set(
            xscale="log",
            yscale="log",
            xlabel="distance of the goal / reach of the arm",
            title=f"{goal} goals",
        )
        axis.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
        axis.minorticks_off()
    axes[0, 0].set_ylabel("mean angle from arm to goal [°]")
    axes[0, 0].legend()
    figure.suptitle("Claim 16: an arm in front of a goal beyond its reach")
    save(figure, path)
