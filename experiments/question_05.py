"""Question 5: why does the error rise with D in 3 … 32, and does it under every reading of the paper?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import kinseek

from .arms import BRANCHING_FACTOR, error_columns, random_goals
from .effort import Effort, Row
from .readings import Reading, errors_of, search
from .style import LOOKS, canvas, lines, plain_ticks, save, where

LETTER = Reading()
READINGS = {
    "as built": LETTER,
    "Algorithm 2 to the letter": replace(LETTER, last="below one"),
    "spacing divided by B": replace(LETTER, divisor="B", last="below one"),
    "spacing divided by B, then 1": replace(LETTER, divisor="B"),
    "round up": replace(LETTER, rounding="up"),
    "fractions kept": replace(LETTER, rounding="exact"),
    "fractions kept, Algorithm 2": replace(LETTER, rounding="exact", last="below one"),
    "no wrap": replace(LETTER, ends="clip"),
    "no wrap, window slides": replace(LETTER, ends="slide"),
    "no wrap, Algorithm 2": replace(LETTER, ends="clip", last="below one"),
    "orientation ignored": replace(LETTER, orientation=False),
    "K_P = 0.1": replace(LETTER, position_weight=0.1),
    "K_P = 10": replace(LETTER, position_weight=10.0),
    "K_P = 100": replace(LETTER, position_weight=100.0),
    "window of one old cell": LETTER,
}
"""Under the last one Br grows with D, so that a window always reaches one old spacing to either side."""
RANGES = {
    "0..360": (0.0, 2 * np.pi),
    "-180..180": (-np.pi, np.pi),
    "-150..150": (-5 * np.pi / 6, 5 * np.pi / 6),
}

SHOWN = "divisions", "position_mean_mm"


def cases(effort: Effort) -> list[Row]:
    """All readings on the full turn; the other joint ranges for the readings that they can touch."""
    divisions = effort.pick([3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 28, 32, 180, 360], [3, 8])
    listed: list[Row] = []
    for reading in READINGS:
        for name in RANGES:
            touched = reading in ("as built", "no wrap", "Algorithm 2 to the letter")
            # A limited joint cannot wrap.
            if (name != "0..360" and not touched) or (name == "-150..150" and reading != "no wrap"):
                continue
            breadths = (1, 2, 3) if reading != "window of one old cell" else (0,)
            listed += [
                {"reading": reading, "range_deg": name, "breadth": breadth, "divisions": d}
                for breadth in breadths
                for d in divisions
                if d < 100 or breadth == 3
            ]
    return listed


def measure(case: Row, effort: Effort) -> Row:
    """Errors of the two-link arm under one reading."""
    reading, divisions = READINGS[case["reading"]], case["divisions"]
    breadth = case["breadth"] or divisions - divisions // 2 + 1
    low, high = RANGES[case["range_deg"]]
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.25, 0, 0, 0]], [low, low], [high, high])
    points = effort.pick(1000 if divisions < 16 else 300 if divisions < 100 else 20, 10)
    goals = random_goals(arm, points, effort.seed)
    q = search(arm, goals, reading, BRANCHING_FACTOR, divisions, breadth)
    spacings = reading.spacings(BRANCHING_FACTOR, divisions)
    position, turned = errors_of(arm, q, goals)
    return {
        "points": points,
        "passes": len(spacings),
        "last_spacing": float(spacings[-1]),
        "reach_in_cells": (divisions // 2 + breadth - 1) / divisions,
        # Both axes of a planar hand turn by the same angle: E_A = 2 (1 - cos φ).
        **error_columns(position, np.arccos(np.clip(1 - turned / 2, -1, 1))),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Error against D: the breadths, the readings, and the cure."""
    figure, axes = canvas(1, 3, (13, 6.6), sharey=True)
    for look, breadth in zip(LOOKS, (1, 2, 3, 0), strict=False):
        reading = "as built" if breadth else "window of one old cell"
        label = f"Br = {breadth}" if breadth else "Br grows with D:\nreach = one old cell"
        some = where(rows, reading=reading, range_deg="0..360", breadth=breadth)
        lines(axes[0, 0], some, *SHOWN, "breadth", (breadth,), label, (look,))
    three = where(rows, range_deg="0..360", breadth=3)
    one: tuple[str, ...] = (
        "as built",
        "Algorithm 2 to the letter",
        "round up",
        "fractions kept",
        "fractions kept, Algorithm 2",
    )
    one += ("spacing divided by B", "orientation ignored")
    lines(axes[0, 1], three, *SHOWN, "reading", one)
    two = ("as built", "no wrap", "no wrap, window slides", "K_P = 0.1", "K_P = 10", "K_P = 100")
    names = {each: f"{each.replace('K_P', 'K_P / K_A')} /m" if "=" in each else each for each in two}
    lines(axes[0, 2], three, *SHOWN, "reading", two, names)
    limited = where(rows, range_deg="-150..150", breadth=3)
    lines(axes[0, 2], limited, *SHOWN, "reading", ("no wrap",), "limits ±150°", LOOKS[7:])
    titles = (
        "as built: the breadth decides\n(D above 32 for Br = 3 alone)",
        "readings of the passes, Br = 3",
        "ends and weights, Br = 3",
    )
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set(xscale="log", yscale="log", xlabel="D, joint space divisions per pass", title=title)
        plain_ticks(axis.xaxis, (3, 4, 6, 10, 16, 32, 100, 360))
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13))
    axes[0, 0].set_ylabel("mean position error [mm]")
    figure.suptitle("Question 5: error of the two-link arm against D, B = 7200")
    save(figure, path)
