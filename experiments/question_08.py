"""Question 8: which weights and which breadths by hand give the sub-millimetre errors of Figure 8?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import tables
from .arms import ARMS, BRANCHING_FACTOR, BY_HAND, DIVISIONS, errors, random_goals
from .effort import Effort, Row
from .style import NAMES, canvas, finish, lines, where

BREADTHS: dict[str, dict[int, tuple[int, ...]]] = {
    "CB(1)": {dof: (1,) * dof for dof in ARMS},
    "CB(2)": {dof: (2,) * dof for dof in ARMS},
    "CB(3)": {dof: (3,) * dof for dof in ARMS},
    "CB(4)": {dof: (4,) * dof for dof in ARMS},
    "BT": BY_HAND,
    "BT, wrist 2": {6: (3, 3, 3, 2, 2, 2)},
    "BT, wider": {2: (5, 5), 3: (4, 3, 3), 4: (4, 4, 3, 2), 6: (4, 4, 4, 2, 2, 2)},
}
TUNED = "tuned"
"""Breadths that the computer chooses: six joints, K_P = K_A."""
WEIGHTS = (0.1, 1.0, 10.0, 100.0, 1000.0)


def cases(effort: Effort) -> list[Row]:
    """Every method on every arm for several K_P at K_A = 1."""
    rows: list[Row] = []
    for dof, arm in ARMS.items():
        given = {
            method: " ".join(map(str, breadths[dof]))
            for method, breadths in BREADTHS.items()
            if dof in breadths
        }
        rows += [
            {"dof": dof, "arm": arm, "method": method, "breadths": breadths, "position_weight": weight}
            for method, breadths in {**given, **({TUNED: TUNED} if dof == effort.pick(6, 2) else {})}.items()
            for weight in ((1.0,) if method == TUNED else effort.pick(WEIGHTS, (1.0, 100.0)))
        ]
    return rows


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    arm = kinseek.load(case["arm"])
    points, method = effort.pick(1000, 3), case["method"]
    goals = random_goals(arm, points, effort.seed)
    breadths = TUNED if method == TUNED else BREADTHS[method][arm.dof]
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, breadths)
    goal = kinseek.Goal.pose(goals, position_weight=case["position_weight"])
    solution = arm.ik(goal, solver=solver)
    return {
        **errors(solution),
        "nodes_expanded": int(solution.nodes_expanded.max()),
        "evaluations_mean": float(solution.evaluations.mean()),
    }


def table(rows: Sequence[Row]) -> str:
    """Breadths on six joints at K_P = K_A, from few evaluations to many, in Markdown."""
    some = sorted(where(rows, dof=6, position_weight=1.0), key=lambda row: row["evaluations_mean"])
    leaves = {row["method"]: row["evaluations_mean"] - DIVISIONS**6 for row in some}
    cells = []
    for row in some:
        own, error = leaves[row["method"]], 1.96 * row["position_standard_error_mm"]
        cells.append(
            (
                row["method"],
                row["breadths"],
                f"{row['evaluations_mean']:,.0f}",
                f"{own / leaves['CB(1)']:.3g}",
                f"{leaves['CB(3)'] / own:.3g}",
                f"{row['position_mean_mm']:.3g} ± {error:.2g}",
                f"{row['orientation_mean_mrad']:.3g}",
            )
        )
    later = "leaves of later passes, relative to CB(1)", "those of CB(3), relative to this row"
    columns = "method", "breadths", "evaluations", *later, "position [mm]", "orientation [mrad]"
    return tables.table(columns, cells)


def draw(rows: Sequence[Row], path: Path) -> None:
    """Position error, and orientation error below, against the weight; one panel an arm."""
    figure, axes = canvas(2, 4, (13, 7.6), sharex=True, sharey="row")
    for over, under, dof in zip(axes[0], axes[1], ARMS, strict=True):
        for axis, name in ((over, "position_mean_mm"), (under, "orientation_mean_mrad")):
            lines(axis, where(rows, dof=dof), "position_weight", name, "method", BREADTHS)
        over.set(xscale="log", yscale="log", title=NAMES[dof])
        over.axhline(1, color="#777777", linewidth=1)
        under.set(yscale="log", xlabel="K_P / K_A [1/m]")
    axes[0, 0].set_ylabel("mean position error [mm]")
    axes[1, 0].set_ylabel("mean orientation error [mrad]")
    title = "Question 8: the weights decide which error is small, D = 3, B = 7200"
    finish(figure, axes[0, 0], path, title, len(BREADTHS), title="DaC +")
