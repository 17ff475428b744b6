"""Claim 21: does Blind Search work only near its start? With the paper's fixed changes, and with ours that shrink."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

import kinseek

from .arms import ARMS, errors, random_joints
from .effort import Effort, Row
from .style import NAMES, canvas, finish, lines, plain_ticks, where

CHANGES = {
    "shrinking from 0.1": kinseek.BlindSearch(),
    "fixed 0.1": kinseek.BlindSearch(step=0.1, smallest_step=0.1),
    "fixed 0.01": kinseek.BlindSearch(step=0.01, smallest_step=0.01, most_steps=2000),
    "fixed 0.001": kinseek.BlindSearch(step=0.001, smallest_step=0.001, most_steps=20_000),
}
"""The paper: "small, fixed changes". A step that may not become smaller ends when no combination helps."""
STUCK = 0.05
"""Farther than this is stuck [m], for changes of up to 0.1 cannot end much nearer than that."""
ANYWHERE = 10.0


def cases(effort: Effort) -> list[Row]:
    """Starts within a distance of the answer, each joint by itself; the last is anywhere."""
    return [
        {"dof": dof, "arm": arm, "changes": changes, "start_within": within}
        for dof, arm in ARMS.items()
        for changes in effort.pick(tuple(CHANGES), ("shrinking from 0.1", "fixed 0.1"))
        for within in effort.pick((0.03, 0.1, 0.3, 1.0, ANYWHERE), (0.1,))
        if dof < 6 or changes != "fixed 0.001" or within < 1
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors from starts at a distance."""
    arm, within = kinseek.load(case["arm"]), case["start_within"]
    points = effort.pick(300 if arm.dof < 6 else 100, 3)
    q = random_joints(arm, points, effort.seed)
    noise = np.random.default_rng([effort.seed, arm.dof, 21]).uniform(-within, within, q.shape)
    near = random_joints(arm, points, effort.seed + 1) if within == ANYWHERE else q + noise
    solution = arm.ik(arm.fk(q), near=near, solver=CHANGES[case["changes"]])
    return {
        **errors(solution),
        "stuck": float((solution.position_error > STUCK).mean()),
        "evaluations_mean": float(solution.evaluations.mean()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Share that is stuck and mean error against the distance of the start, one column an arm."""
    figure, axes = canvas(2, 4, (13, 6.4), sharex=True, sharey="row")
    for over, under, dof in zip(axes[0], axes[1], ARMS, strict=True):
        some = [{**row, "percent": 100 * row["stuck"]} for row in where(rows, dof=dof)]
        lines(over, some, "start_within", "percent", "changes", CHANGES)
        lines(under, some, "start_within", "position_median_mm", "changes", CHANGES)
        over.set(xscale="log", title=NAMES[dof])
        under.set(yscale="log", xlabel="start within [rad or m]; 10: anywhere")
        plain_ticks(under.xaxis, (0.03, 0.1, 0.3, 1, 10))
    axes[0, 0].set_ylabel(f"ends more than {1e3 * STUCK:g} mm off [%]")
    axes[1, 0].set_ylabel("median position error [mm]")
    finish(figure, axes[0, 0], path, "Claim 21: Blind Search against the distance of its start", 6)
