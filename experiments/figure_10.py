"""Figure 10: nodes created for one point against B, with and without the dynamically-created tree."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import ARMS, BY_HAND, DIVISIONS, divide_and_conquer_nodes, random_goals
from .effort import Effort, Row
from .style import NAMES, canvas, lines, save, where

TREES = {"static": "DaC + BT", "dynamic": "DaC + DT + BT"}


def cases(effort: Effort) -> list[Row]:
    """Powers of three: the paper's factor of 4.7 million is 3^14."""
    last = {"static": effort.pick(14, 8), "dynamic": effort.pick(24, 12)}
    return [
        {"dof": dof, "arm": arm, "tree": tree, "branching_factor": 3**power}
        for dof, arm in ARMS.items()
        for tree in TREES
        for power in range(2, last[tree] + 1)
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Solve one point and count."""
    dof, branching_factor = case["dof"], case["branching_factor"]
    arm = kinseek.load(ARMS[dof])
    solver = kinseek.DivideAndConquer(branching_factor, DIVISIONS, BY_HAND[dof], case["tree"])
    expected = divide_and_conquer_nodes(branching_factor, DIVISIONS, BY_HAND[dof])
    if case["tree"] == "static":
        expected = dof * branching_factor
    solution = arm.ik(random_goals(arm, 1, effort.seed)[0], solver=solver)
    return {"nodes_created": solution.nodes_created, "closed_form": expected}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Nodes created against B, both logarithmic, one panel an arm."""
    figure, axes = canvas(2, 2, (9, 6.6), sharex=True, sharey=True)
    for axis, dof in zip(axes.flat, ARMS, strict=True):
        lines(axis, where(rows, dof=dof), "branching_factor", "nodes_created", "tree", TREES, TREES)
        axis.axvline(1e4, color="#999999", linewidth=1)
        axis.set(xscale="log", yscale="log", title=NAMES[dof])
    axes[0, 0].text(1.4e4, 30, "B = 10,000", color="#555555")
    axes[0, 0].legend()
    for axis in axes[1]:
        axis.set_xlabel("B, branching factor")
    for axis in axes[:, 0]:
        axis.set_ylabel("nodes created, one point")
    figure.suptitle("Fig. 10: nodes created against B, D = 3; without DT up to B = $3^{14}$")
    save(figure, path)
