"""Figure 5: nodes expanded to solve one point, against the degrees of freedom, B = 60."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import ARMS, BY_HAND, DIVISIONS, divide_and_conquer_nodes, equation_1, random_goals
from .effort import Effort, Row
from .style import canvas, column, lines, save, where

B = 60


def cases(effort: Effort) -> list[Row]:
    """Brute force on all arms but the last, as in the paper, and divide and conquer on all."""
    brute = [dof for dof in ARMS if dof <= effort.pick(4, 3)]
    pairs = [(dof, "brute force") for dof in brute] + [(dof, "DaC + DT + BT") for dof in ARMS]
    return [{"dof": dof, "arm": ARMS[dof], "method": method} for dof, method in pairs]


def measure(case: Row, effort: Effort) -> Row:
    """Solve one point and count."""
    dof = case["dof"]
    arm = kinseek.load(ARMS[dof])
    goal = random_goals(arm, 1, effort.seed)[0]
    if case["method"] == "brute force":
        solver: kinseek.Solver = kinseek.BruteForce(B)
        expected = equation_1(B, dof)
    else:
        solver = kinseek.DivideAndConquer(B, DIVISIONS, BY_HAND[dof], "dynamic")
        expected = divide_and_conquer_nodes(B, DIVISIONS, BY_HAND[dof])
    expanded = arm.ik(goal, solver=solver).nodes_expanded
    return {"nodes_expanded": expanded, "closed_form": expected, "equation_1": equation_1(B, dof)}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Nodes, logarithmic, against DOF."""
    figure, axes = canvas()
    axis = axes[0, 0]
    every = where(rows, method="DaC + DT + BT")
    wide = {"color": "#999999", "linewidth": 5, "alpha": 0.5}
    axis.plot(column(every, "dof"), column(every, "equation_1"), label="Eq. 1", **wide)
    lines(axis, rows, "dof", "nodes_expanded", "method", ("brute force", "DaC + DT + BT"))
    axis.set(yscale="log", xlabel="degrees of freedom", ylabel="nodes expanded, one point", xticks=list(ARMS))
    axis.set_title(f"Fig. 5: nodes expanded, B = {B}")
    axis.legend()
    save(figure, path)
