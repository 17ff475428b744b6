"""Question 6: under which weights K_P and K_A has the two-link arm, and no other, a spike at D = 4?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import BRANCHING_FACTOR, errors, random_joints
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, lines, plain_ticks, save, where
from .sweep import ARMS

WEIGHTS = (0.1, 1.0, 2.0, 5.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0, 50.0, 100.0, 1000.0)
BREADTHS = (1, 2, 3, 4)
"""Up to four, which is what breadth tuning gives the two-link arm here."""


def cases(effort: Effort) -> list[Row]:
    """The D around the spike, for several K_P at K_A = 1: only their ratio matters."""
    weights = effort.pick(WEIGHTS, (1.0, 20.0))
    return [
        {"dof": dof, "arm": arm, "breadth": breadth, "position_weight": weight, "divisions": d}
        for dof, arm in ARMS.items()
        for breadth in BREADTHS
        for weight in weights
        for d in effort.pick((3, 4, 5, 6, 7, 8) if dof == 2 else (3, 4, 5), (3, 4, 5))
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors; and of the answers farther than 1 mm two shares.

    Those that bend the elbow the other way, and those whose true first joint lies in the middle third between
    two values of the first pass: a third, if that did not matter.
    """
    arm = kinseek.load(case["arm"])
    points = effort.pick({2: 2000, 3: 1000, 4: 500}[arm.dof], 5)
    q = random_joints(arm, points, effort.seed)
    goal = kinseek.Goal.pose(arm.fk(q), position_weight=case["position_weight"])
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, case["divisions"], case["breadth"])
    solution = arm.ik(goal, solver=solver)
    bad = solution.position_error > 1e-3
    between = np.abs(q[:, 0] * case["divisions"] / (2 * np.pi) % 1 - 0.5) < 1 / 6
    mirrored = np.sin(solution.q[:, 1]) * np.sin(q[:, 1]) < 0
    return {
        **errors(solution),
        "above_1_mm": float(bad.mean()),
        "other_elbow": float(mirrored[bad].mean()) if bad.any() and arm.dof == 2 else 0.0,
        "first_joint_between": float(between[bad].mean()) if bad.any() else 0.0,
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """The spike at one weight, and its height over its neighbours against the weight."""
    figure, axes = canvas(1, 3, (13, 5.6))
    chosen = [
        weight for weight in (1.0, 5.0, 10.0, 20.0, 50.0, 1000.0) if where(rows, position_weight=weight)
    ]
    shown = "divisions", "position_mean_mm"
    two = where(rows, dof=2, breadth=4)
    lines(axes[0, 0], two, *shown, "position_weight", chosen, "K_P / K_A = {:g} /m")
    axes[0, 0].set(
        yscale="log",
        xlabel="D, joint space divisions per pass",
        ylabel="mean position error [mm]",
        title="two-link arm, Br = 4",
    )
    heavy = 20.0
    some = where(rows, breadth=4, position_weight=heavy)
    lines(axes[0, 1], some, *shown, "dof", ARMS, NAMES)
    axes[0, 1].set(
        yscale="log",
        xlabel="D, joint space divisions per pass",
        ylabel="mean position error [mm]",
        title=f"Br = 4, K_P / K_A = {heavy:g} /m\n(3 and 4 DOF: D up to 5 alone)",
    )
    for look, breadth in zip(LOOKS, BREADTHS, strict=False):
        weights = sorted({row["position_weight"] for row in rows})
        heights = [spike(rows, 2, breadth, weight) for weight in weights]
        axes[0, 2].plot(weights, heights, label=f"Br = {breadth}", **look)
    axes[0, 2].axhline(1, color="#777777", linewidth=1)
    axes[0, 2].set(
        xscale="log",
        yscale="log",
        xlabel="K_P / K_A [1/m]",
        ylabel="error at D = 4 / larger one of D = 3 and 5",
        title="two-link arm: a spike is above 1",
    )
    plain_ticks(axes[0, 2].yaxis, (0.1, 0.2, 0.5, 1, 2))
    for axis in axes[0]:
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
    figure.suptitle("Question 6: the spike at D = 4, B = 7200")
    save(figure, path)


def spike(rows: Sequence[Row], dof: int, breadth: int, weight: float) -> float:
    """Mean error at D = 4 over the larger one of its neighbours."""
    some = where(rows, dof=dof, breadth=breadth, position_weight=weight)
    errors = {row["divisions"]: row["position_mean_mm"] for row in some}
    return float(errors[4] / max(errors[3], errors[5]))
