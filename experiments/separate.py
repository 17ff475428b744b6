"""Separate chains (Sec. 5): the joints that move the wrist's centre first, then the others, beside the whole arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import ARMS, BRANCHING_FACTOR, DIVISIONS, errors, random_goals, timed
from .effort import Effort, Row
from .style import NAMES, canvas, finish, lines, where

SEARCHES = ("whole arm", "chains, once", "chains")
"""The last one searches again where an error is left; see `kinseek.SeparateChains`."""
LIMITED = "irb120"
"""An arm whose wrist has limits."""
PANELS = {**{name: NAMES[dof] for dof, name in ARMS.items()}, LIMITED: "6 DOF (IRB 120), limited"}


def cases(effort: Effort) -> list[Row]:
    """Whole arm and chains, for every constant breadth."""
    return [
        {"arm": arm, "search": search, "breadth": breadth}
        for arm in effort.pick(tuple(PANELS), ("planar2", "scara4"))
        for breadth in effort.pick((1, 2, 3, 4), (1, 2))
        for search in SEARCHES
    ]


def solver_of(search: str, breadth: int) -> kinseek.DivideAndConquer:
    """A search by its name."""
    if search == "whole arm":
        return kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, breadth)
    again = math.inf if search == "chains, once" else kinseek.SeparateChains().again
    return kinseek.SeparateChains(BRANCHING_FACTOR, DIVISIONS, breadth, again=again)


def measure(case: Row, effort: Effort) -> Row:
    """Errors and work of a batch, the same goals for all searches of an arm; and how the arm is split."""
    arm, points = kinseek.load(case["arm"]), effort.pick(500, 3)
    goals = random_goals(arm, points, effort.seed)
    solution, seconds = timed(arm, goals, solver_of(case["search"], case["breadth"]))
    split = kinseek.SeparateChains().split(kinseek.Problem(arm.chain, kinseek.Goal.pose(goals)))
    return {
        "dof": arm.dof,
        "first": len(split.first),
        "second": len(split.second),
        **errors(solution),
        "evaluations_mean": float(solution.evaluations.mean()),
        "split_evaluations": split.evaluations,
        "ms_per_point": 1e3 * seconds / points,
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean errors against evaluations, one point a breadth."""
    from matplotlib.ticker import NullFormatter

    figure, axes = canvas(2, len(PANELS), (15, 6.8), sharex="col", sharey="row")
    for place, (arm, title) in enumerate(PANELS.items()):
        for axis, name in zip(axes[:, place], ("position_mean_mm", "orientation_mean_mrad"), strict=True):
            lines(axis, where(rows, arm=arm), "evaluations_mean", name, "search", SEARCHES)
            for row in where(rows, arm=arm, search="whole arm"):
                at = (row["evaluations_mean"], row[name])
                axis.annotate(f" {row['breadth']}", at, va="bottom")
            axis.set(xscale="log", yscale="log")
            axis.margins(x=0.15, y=0.1)
            axis.xaxis.set_minor_formatter(NullFormatter())
        split = where(rows, arm=arm)
        chains = f"{split[0]['first']} + {split[0]['second']} joints" if split else ""
        if split and not split[0]["second"]:
            chains = "no split"
        axes[0, place].set_title(f"{title}\n{chains}")
        axes[1, place].set_xlabel("FK evaluations per point")
    axes[0, 0].set_ylabel("mean position error [mm]")
    axes[1, 0].set_ylabel("mean orientation error [mrad]")
    finish(
        figure,
        axes[0, 0],
        path,
        "Separate chains: D = 3, B = 7200; the numbers are the breadths",
        len(SEARCHES),
    )
