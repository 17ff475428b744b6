"""Fractional breadth (Sec. 3.2): what lies between two whole breadths, and over which passes or joints to mix them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import kinseek
from kinseek.kernels.arrays import Indices

from . import tables
from .arms import ARMS, BRANCHING_FACTOR, DIVISIONS, errors, random_goals
from .effort import Effort, Row
from .style import DOTS, LOOKS, NAMES, canvas, column, finish, lines, where

BUILT = "passes, wide first"
MIXTURES = (BUILT, "passes, wide last", "passes, alternating", "joints, wide first", "joints, wide last")
"""The first one is what ``DivideAndConquer(breadth=2.5)`` does."""
WHOLE = (1.0, 2.0, 3.0)


@dataclass(frozen=True)
class Mixed(kinseek.DivideAndConquer):
    """Divide and conquer whose later passes have their breadths in another order."""

    mixture: str = BUILT

    def _sides(self, breadths: tuple[float, ...]) -> Indices:
        rows = super()._sides(breadths)
        if self.mixture == "passes, wide last":
            return rows[::-1]
        if self.mixture == "passes, alternating":
            # As evenly as the two kinds of rows can be spread, the wide ones not before the others.
            wide = int((rows != rows[-1]).any(axis=1).sum())
            steps = np.floor(np.arange(len(rows) + 1) * wide / len(rows))
            return np.asarray(np.where(np.diff(steps)[:, None] > 0, rows[0], rows[-1]))
        return rows


def cases(effort: Effort) -> list[Row]:
    """Quarters of a breadth as built, and the halves by every mixture, on every arm."""
    return [
        {"dof": dof, "arm": arm, "mixture": mixture, "breadth": breadth}
        for dof, arm in ARMS.items()
        for mixture in MIXTURES
        for breadth in (
            effort.pick(tuple(np.arange(1, 3.25, 0.25).tolist()), (1.0, 1.5, 2.0))
            if mixture == BUILT
            else (1.5, 2.5)
        )
    ]


def solver_of(mixture: str, breadth: float, dof: int) -> kinseek.DivideAndConquer:
    """A search with a mean breadth."""
    if mixture.startswith("passes"):
        return Mixed(BRANCHING_FACTOR, DIVISIONS, breadth, mixture=mixture)
    wide = np.arange(dof) < round(breadth % 1 * dof)
    each = int(breadth) + (wide if mixture == "joints, wide first" else wide[::-1])
    return kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, tuple(each.tolist()))


def measure(case: Row, effort: Effort) -> Row:
    """Errors and work of a batch."""
    arm = kinseek.load(case["arm"])
    points = effort.pick(1000 if arm.dof < 6 else 500, 3)
    solver = solver_of(case["mixture"], case["breadth"], arm.dof)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver)
    return {
        **errors(solution),
        "evaluations_mean": float(solution.evaluations.mean()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean position error against evaluations, one panel an arm."""
    from matplotlib.ticker import NullFormatter

    figure, axes = canvas(1, 4, (14, 4.6))
    for axis, dof in zip(axes[0], ARMS, strict=True):
        some = where(rows, dof=dof)
        lines(
            axis,
            some,
            "evaluations_mean",
            "position_mean_mm",
            "mixture",
            MIXTURES,
            looks=(LOOKS[0], *DOTS[1:]),
        )
        whole = [row for row in where(rows, dof=dof, mixture=BUILT) if row["breadth"] in WHOLE]
        names = ", ".join(f"CB({row['breadth']:.0f})" for row in whole)
        star = {"marker": "*", "markersize": 13, "linestyle": "none", "color": "black"}
        axis.plot(column(whole, "evaluations_mean"), column(whole, "position_mean_mm"), label=names, **star)
        axis.set(xscale="log", yscale="log", title=NAMES[dof], xlabel="FK evaluations per point")
        axis.margins(x=0.2, y=0.1)
        axis.xaxis.set_minor_formatter(NullFormatter())
    axes[0, 0].set_ylabel("mean position error [mm]")
    finish(
        figure,
        axes[0, 0],
        path,
        "Fractional breadth: D = 3, B = 7200, K_P = K_A; quarters as built, halves in other mixtures",
        len(MIXTURES) + 1,
    )


def table(rows: Sequence[Row]) -> str:
    """Errors and work of each breadth as built, in Markdown."""
    built = where(rows, mixture=BUILT)
    breadths = sorted({row["breadth"] for row in built})
    return tables.table(
        ("breadth", *(f"{dof} DOF" for dof in ARMS)),
        ((f"{breadth:g}", *_cells(where(built, breadth=breadth))) for breadth in breadths),
    )


def mixtures_table(rows: Sequence[Row]) -> str:
    """The halves in every mixture, in Markdown."""
    return tables.table(
        ("breadth", "mixture", *(f"{dof} DOF" for dof in ARMS)),
        (
            (f"{breadth:g}", mixture, *_cells(where(rows, mixture=mixture, breadth=breadth)))
            for breadth in (1.5, 2.5)
            for mixture in MIXTURES
        ),
    )


def _cells(rows: Sequence[Row]) -> list[str]:
    """Error and work on each arm."""
    each = (where(rows, dof=dof)[0] for dof in ARMS)
    return [f"{row['position_mean_mm']:.2g} mm, {row['evaluations_mean']:,.0f}" for row in each]
