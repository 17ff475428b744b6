"""Figure 11: time per point against B, with and without the dynamically-created tree, 6 DOF."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import BY_HAND, DIVISIONS, random_goals, timed
from .effort import Effort, Row
from .style import canvas, lines, save

LABELS = {"static": "DaC + BT", "dynamic": "DaC + DT + BT"}


def cases(effort: Effort) -> list[Row]:
    """Powers of three; without the dynamic tree only what fits into memory."""
    last = {"static": effort.pick(14, 8), "dynamic": effort.pick(26, 12)}
    return [
        {"tree": tree, "branching_factor": 3**power}
        for power in range(2, last["dynamic"] + 1)
        for tree in LABELS
        if power <= last[tree]
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Time per point once everything is prepared, and the preparation apart.

    The static tree is made once per batch. Two batch sizes separate the two shares.
    """
    arm = kinseek.load("elbow6")
    points = effort.pick(100, 5)
    goals = random_goals(arm, points + 1, effort.seed)
    solver = kinseek.DivideAndConquer(case["branching_factor"], DIVISIONS, BY_HAND[6], case["tree"])
    arm.ik(goals[:1], solver=solver)
    starts = []
    for _ in range(5):
        start = time.process_time()
        arm.ik(goals[:1], solver=solver)
        starts.append(time.process_time() - start)
    solution, seconds = timed(arm, goals, solver)
    each = (seconds - min(starts)) / points
    return {
        "points": points,
        "ms_per_point": 1e3 * each,
        "preparation_ms": max(0.0, 1e3 * (min(starts) - each)),
        "nodes_expanded": int(solution.nodes_expanded.max()),
        "position_mean_mm": float(1e3 * solution.position_error.mean()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Time against B."""
    figure, axes = canvas(1, 3, (13, 4.2))
    rows = [{**row, "total": row["ms_per_point"] + row["preparation_ms"]} for row in rows]
    for axis, name in zip(axes[0], ("ms_per_point", "total", "nodes_expanded"), strict=True):
        lines(axis, rows, "branching_factor", name, "tree", LABELS, LABELS)
    axes[0, 0].set(xscale="log", ylim=(0, None), ylabel="time per point [ms]", title="tree ready")
    axes[0, 1].set(xscale="log", yscale="log", ylabel="time for the first point [ms]", title="tree included")
    axes[0, 2].set(
        xscale="log", ylim=(0, None), ylabel="nodes expanded per point", title="the work, the same for both"
    )
    for axis in axes[0]:
        axis.set_xlabel("B, branching factor")
    axes[0, 0].legend()
    figure.suptitle("Fig. 11: time against B, 6 DOF, D = 3; without DT up to B = $3^{14}$")
    save(figure, path)
