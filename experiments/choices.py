"""What the paper leaves to the reader: every choice of `kinseek.DivideAndConquer` and `BlindSearch`, and what it gives."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import kinseek

from . import tables
from .arms import ARMS, BRANCHING_FACTOR, errors, random_goals
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, column, finish, lines, where

AS_BUILT, REACH = "as built", "breadth to reach"
ELBOW = {2: (None, 0.5), 4: (None, 0.5, None, None), 6: (None, None, 0.5, None, None, None)}
"""Half a cell on at the elbow alone; the cylindrical arm has none."""
WRIST = {6: (None, None, None, None, 0.5, None)}
CHOICES: dict[str, dict[str, Any]] = {
    AS_BUILT: {},
    "first pass by the formula": {"first": "formula"},
    "first node at the lower limit": {"offset": 0.0},
    "limited joints to the letter": {"limited": "letter"},
    "no wrap": {"wrap": False},
    "no wrap, to the letter": {"wrap": False, "limited": "letter"},
    "no wrap, letter, formula": {"wrap": False, "limited": "letter", "first": "formula"},
    "all lattices half a cell on": {"offset": 0.5},
    "the elbow's half a cell on": {"offset": ELBOW},
    "the wrist's half a cell on": {"offset": WRIST},
    "ties: the first": {"ties": "first"},
    "stop below 0.01": {"stop_below": 0.01},
    "stop below 0.001": {"stop_below": 0.001},
    REACH: {"breadth": "reach"},
}
BLIND: dict[str, dict[str, Any]] = {
    "Blind Search, shrinking": {},
    "Blind Search, fixed 0.1": {"shrink": None},
    "Blind Search, fixed 0.01": {"shrink": None, "step": 0.01, "most_steps": 2000},
}
SPIKE = (AS_BUILT, "all lattices half a cell on", "the elbow's half a cell on", REACH)
HEAVY = 20.0
"""K_P / K_A [1/m] of the spike at D = 4, question 6."""


def cases(effort: Effort) -> list[Row]:
    """Each choice at D = 3 on every arm; over D for the lattices and breadths; and Blind Search from the middle."""
    rows: list[Row] = []
    for dof, arm in ARMS.items():
        same: Row = {"dof": dof, "arm": arm}
        for choice, options in CHOICES.items():
            for breadth in effort.pick((1, 2, 3), (2,)):
                row: Row = {
                    **same,
                    "choice": choice,
                    "divisions": 3,
                    "breadth": breadth,
                    "position_weight": 1.0,
                }
                if fits(options, dof) and choice != REACH:
                    rows.append(row)
        if dof < 6:
            rows += [
                {
                    **same,
                    "choice": choice,
                    "divisions": d,
                    "breadth": breadth_to_reach(arm, d) if choice == REACH else 4,
                    "position_weight": weight,
                }
                for weight in (1.0, HEAVY)
                for choice in SPIKE
                for d in effort.pick((3, 4, 5, 6) if dof < 4 else (3, 4), (3,))
                if fits(CHOICES[choice], dof)
            ]
        rows += [
            {**same, "choice": choice, "divisions": 0, "breadth": 0, "position_weight": 1.0}
            for choice in BLIND
        ]
    return rows


def breadth_to_reach(arm: str, divisions: int) -> float:
    """The breadth of an arm's first joint, which turns fully, with which it can walk back from any first cell."""
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, divisions, "reach")
    return solver.breadths(kinseek.Problem(kinseek.load(arm).chain, kinseek.Goal.pose(np.eye(4))))[0]


def fits(options: dict[str, Any], dof: int) -> bool:
    """Does the arm have the joint that is meant?"""
    return not isinstance(options.get("offset"), dict) or dof in options["offset"]


def solver_of(case: Row) -> kinseek.DivideAndConquer | kinseek.BlindSearch:
    """The search of a case."""
    choice = case["choice"]
    if choice in BLIND:
        return kinseek.BlindSearch(**BLIND[choice])
    options = dict(CHOICES[choice])
    if isinstance(options.get("offset"), dict):
        options["offset"] = options["offset"][case["dof"]]
    return kinseek.DivideAndConquer(
        **{
            "branching_factor": BRANCHING_FACTOR,
            "divisions": case["divisions"],
            "breadth": case["breadth"],
            **options,
        }
    )


def measure(case: Row, effort: Effort) -> Row:
    """Errors and work, and of how many joints the breadth is too small to walk back from every first cell."""
    arm, solver = kinseek.load(case["arm"]), solver_of(case)
    points = effort.pick({2: 1000, 3: 1000, 4: 300, 6: 100}[arm.dof], 3)
    goals = random_goals(arm, points, effort.seed)
    solution = arm.ik(kinseek.Goal.pose(goals, position_weight=case["position_weight"]), solver=solver)
    # Blind Search has no windows: it moves from its start.
    short = () if isinstance(solver, kinseek.BlindSearch) else solver.reach_notes(solution.problem)
    return {
        **errors(solution),
        "evaluations_mean": float(solution.evaluations.mean()),
        "joints_short": len(short),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean error of each choice, one panel an arm; and the spike over D."""
    figure, axes = canvas(2, 3, (14, 9))
    names = [*(name for name in CHOICES if name != REACH), *BLIND]
    for axis, dof in zip((*axes[0], axes[1, 0]), ARMS, strict=True):
        for look, breadth in zip(LOOKS, (1, 2, 3, 0), strict=False):
            some = [
                row
                for row in where(rows, dof=dof, breadth=breadth, position_weight=1.0)
                if row["choice"] in names and row["divisions"] in (0, 3)
            ]
            axis.plot(
                column(some, "position_mean_mm"),
                [names.index(row["choice"]) for row in some],
                label=f"CB({breadth})" if breadth else "Blind Search",
                **{**look, "linestyle": "none"},
            )
        axis.set(xscale="log", xlabel="mean position error [mm]", title=NAMES[dof])
        axis.set_yticks(range(len(names)), names if axis in (axes[0, 0], axes[1, 0]) else [""] * len(names))
        axis.invert_yaxis()
    for axis, weight in zip(axes[1, 1:], (HEAVY, 1.0), strict=True):
        some = where(rows, dof=2, position_weight=weight)
        some = [row for row in some if row["choice"] == REACH or row["breadth"] == 4]
        lines(axis, some, "divisions", "position_mean_mm", "choice", SPIKE)
        axis.set(yscale="log", ylim=(0.05, 10), xlabel="D", title=f"2 DOF, Br = 4, K_P = {weight:g} K_A")
        axis.set_xticks(
            sorted({row["divisions"] for row in where(rows, dof=2, position_weight=weight)} - {0})
        )
    axes[1, 2].legend(loc="upper right")
    axes[1, 1].set_ylabel("mean position error [mm]")
    finish(
        figure,
        axes[0, 0],
        path,
        "What the paper leaves to the reader: D = 3, B = 7200, K_P = K_A unless said",
        4,
    )


MEANS = {
    AS_BUILT: ("`DivideAndConquer()`", "what kinseek chose"),
    "first pass by the formula": (
        '`first="formula"`',
        "as many values as later passes, around the zero configuration (Sec. 3.2); with wrapping they are the same D",
    ),
    "first node at the lower limit": (
        "`offset=0.0`",
        "as the paper's Figure 2; ours: the middles of D cells",
    ),
    "limited joints to the letter": (
        '`limited="letter"`',
        "360/B · i for them too, and a window ends at a limit; ours: both limits are nodes, and it slides",
    ),
    "no wrap": ("`wrap=False`", "a full turn is a range with two ends"),
    "no wrap, to the letter": ('`wrap=False, limited="letter"`', "both"),
    "no wrap, letter, formula": ('`wrap=False, limited="letter", first="formula"`', "all three"),
    "all lattices half a cell on": (
        "`offset=0.5`",
        "other samples in the first pass, at each joint that turns",
    ),
    "the elbow's half a cell on": ("`offset=(None, 0.5)` and so on", "at the elbow alone"),
    "the wrist's half a cell on": (
        "`offset=(None, None, None, None, 0.5, None)`",
        "at joint 5 alone, whose first sample is singular",
    ),
    "ties: the first": ('`ties="first"`', "of equal leaves the first, not the one that rounding favours"),
    "stop below 0.01": ("`stop_below=0.01`", "the first leaf with a smaller weighted error ends the search"),
    "stop below 0.001": ("`stop_below=0.001`", "the same"),
    "Blind Search, shrinking": ("`BlindSearch()`", "ours: the changes are halved where none helps"),
    "Blind Search, fixed 0.1": ("`BlindSearch(shrink=None)`", "the paper's fixed changes"),
    "Blind Search, fixed 0.01": ("`BlindSearch(0.01, shrink=None, most_steps=2000)`", "smaller ones"),
}
"""How each is chosen, and what it is."""


def millimetres(row: Row) -> str:
    """The mean error of a row to two digits."""
    mean = row["position_mean_mm"]
    return f"{mean:.2g}" if mean < 99.5 else f"{mean:.0f}"


def table(rows: Sequence[Row]) -> str:
    """Mean position errors [mm] of all choices, in Markdown."""
    lines = []
    for choice, told in MEANS.items():
        some = where(rows, choice=choice, position_weight=1.0)
        some = [row for row in some if row["divisions"] in (0, 3) and row["breadth"] < 4]
        lines.append(
            (choice, *told, *(" / ".join(map(millimetres, where(some, dof=d))) or "–" for d in ARMS))
        )
    return tables.table(("choice", "how", "what it is", *(f"{dof} DOF" for dof in ARMS)), lines)


def walks_table(rows: Sequence[Row]) -> str:
    """Mean position errors [mm] over D of the lattices and of the breadth that reaches, in Markdown."""
    found = where(rows, dof=2, position_weight=HEAVY)
    divisions = sorted({row["divisions"] for row in found})
    lines = []
    for choice in SPIKE:
        cells = [f"{choice}{', Br = 4' if choice != REACH else ''}"]
        for d in divisions:
            (row,) = where(found, choice=choice, divisions=d)
            breadth = f"Br = {row['breadth']}: " if choice == REACH else ""
            cells.append(f"{breadth}{millimetres(row)}{', out of reach' if row['joints_short'] else ''}")
        lines.append(cells)
    return tables.table((f"two-link arm, K_P = {HEAVY:g} K_A", *(f"D = {d}" for d in divisions)), lines)
