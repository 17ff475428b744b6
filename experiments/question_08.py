"""Question 8: which weights and which breadths by hand give the sub-millimetre errors of Figure 8?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import ARMS, BRANCHING_FACTOR, BY_HAND, DIVISIONS, ERRORS, error_columns, random_goals
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, column, save, where

COLUMNS = ("dof", "arm", "method", "breadths", "position_weight", "points", *ERRORS, "nodes_expanded")
BREADTHS: dict[str, dict[int, tuple[int, ...]]] = {
    "CB(1)": {dof: (1,) * dof for dof in ARMS},
    "CB(2)": {dof: (2,) * dof for dof in ARMS},
    "CB(3)": {dof: (3,) * dof for dof in ARMS},
    "BT": BY_HAND,
    "BT, wider": {2: (5, 5), 3: (4, 3, 3), 4: (4, 4, 3, 2), 6: (4, 4, 4, 2, 2, 2)},
}
WEIGHTS = (0.1, 1.0, 10.0, 100.0, 1000.0)


def cases(effort: Effort) -> list[Row]:
    """Every method on every arm for several K_P at K_A = 1."""
    return [
        {
            "dof": dof,
            "arm": arm,
            "method": method,
            "breadths": " ".join(map(str, breadths[dof])),
            "position_weight": weight,
        }
        for dof, arm in ARMS.items()
        for method, breadths in BREADTHS.items()
        for weight in effort.pick(WEIGHTS, (1.0, 100.0))
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    arm = kinseek.load(str(case["arm"]))
    points = effort.pick(1000 if arm.dof < 6 else 500, 3)
    goals = random_goals(arm, points, effort.seed)
    breadths = BREADTHS[str(case["method"])][arm.dof]
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, breadths)
    goal = kinseek.Goal.pose(goals, position_weight=float(case["position_weight"]))
    solution = arm.ik(goal, solver=solver)
    return {
        "points": points,
        **error_columns(solution.position_error, solution.orientation_error),
        "nodes_expanded": int(solution.nodes_expanded.max()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Position error, and orientation error below, against the weight; one panel an arm."""
    figure, axes = canvas(2, 4, (13, 7.6), sharex=True, sharey="row")
    for over, under, dof in zip(axes[0], axes[1], ARMS, strict=True):
        for look, method in zip(LOOKS, BREADTHS, strict=False):
            some = where(rows, dof=dof, method=method)
            for axis, name in ((over, "position_mean_mm"), (under, "orientation_mean_mrad")):
                axis.plot(column(some, "position_weight"), column(some, name), label=method, **look)
        over.set(xscale="log", yscale="log", title=NAMES[dof])
        over.axhline(1, color="#777777", linewidth=1)
        under.set(yscale="log", xlabel="K_P / K_A [1/m]")
    axes[0, 0].set_ylabel("mean position error [mm]")
    axes[1, 0].set_ylabel("mean orientation error [mrad]")
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=len(BREADTHS), title="DaC +")
    figure.suptitle("Question 8: the weights decide which error is small, D = 3, B = 7200")
    save(figure, path)
