"""What Figures 6 and 7 share: divide and conquer against D."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import kinseek

from .arms import BRANCHING_FACTOR
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, column, finish, lines, mean_bars, plain_ticks, where

ARMS = {2: "planar2", 3: "cylindrical3", 4: "scara4"}
BREADTHS = (1, 2, 3)
"""The paper does not say which breadth these two figures have, so all three run."""


def cases(effort: Effort) -> list[Row]:
    """Every D from 3 to 32 for every arm, and 180 and 360 for the two-link arm."""
    divisions = effort.pick(list(range(3, 33)), [3, 4, 8])
    far = effort.pick([180, 360], [180])
    return [
        {"dof": dof, "arm": arm, "breadth": breadth, "divisions": d}
        for dof, arm in ARMS.items()
        for breadth in BREADTHS
        for d in (divisions + far if dof == 2 else divisions)
    ]


def solver(case: Row) -> kinseek.DivideAndConquer:
    """Divide and conquer with constant breadth."""
    return kinseek.DivideAndConquer(BRANCHING_FACTOR, case["divisions"], case["breadth"], "dynamic")


def draw(rows: Sequence[Row], path: Path, quantities: dict[str, str], title: str) -> None:
    """One row of panels a quantity, one panel a breadth, one line an arm."""
    figure, axes = canvas(len(quantities), 3, (11, 1.1 + 3.4 * len(quantities)), sharex=True, sharey="row")
    for line, (quantity, label) in zip(axes, quantities.items(), strict=True):
        line[0].set_ylabel(label)
        for axis, breadth in zip(line, BREADTHS, strict=True):
            some = where(rows, breadth=breadth)
            lines(axis, some, "divisions", quantity, "dof", ARMS, NAMES)
            if quantity == "position_mean_mm":
                for look, dof in zip(LOOKS, ARMS, strict=False):
                    mean_bars(axis, column(where(some, dof=dof), "divisions"), where(some, dof=dof), look)
                axis.set_ylim(0.05, 100)
            axis.set(xscale="log", yscale="log")
            plain_ticks(axis.xaxis, (3, 4, 6, 10, 16, 32, 100, 360))
    for axis, breadth in zip(axes[0], BREADTHS, strict=True):
        axis.set_title(f"CB({breadth})")
    for axis in axes[-1]:
        axis.set_xlabel("D, joint space divisions per pass")
    finish(figure, axes[0, 0], path, title, len(ARMS))
