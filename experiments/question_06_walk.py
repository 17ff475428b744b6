"""Question 6, the mechanism: a first pass that picks the mirrored elbow, and a search that can or cannot walk back."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .arms import error_columns, random_joints
from .effort import Effort, Row
from .mirror import arm_with_lattice, share, travel, walk
from .style import LOOKS, canvas, column, lines, save, where

WEIGHT = 20.0
"""K_P / K_A at which the spike of question 6 is highest [1/m]."""
WIDE = {4: (7, 8), 5: (7, 8, 9, 10), 6: (8, 10, 12, 13), 8: (16, 24, 25)}
"""Breadths past which the travel is half a turn."""


def cases(effort: Effort) -> list[Row]:
    """D and Br around the spike; wider ones up to half a turn of travel; turned lattices; and another weight."""
    divisions = effort.pick((3, 4, 5, 6, 7, 8), (3, 4))
    asked = [(WEIGHT, 0, breadth, d) for d in divisions for breadth in effort.pick((1, 2, 3, 4, 5, 6), (4,))]
    asked += effort.pick([(WEIGHT, 0, breadth, d) for d in WIDE for breadth in WIDE[d]], [])
    asked += [
        (WEIGHT, turn, 4, d)
        for turn in effort.pick((15, 30, 45, 60, 75), (45,))
        for d in effort.pick((3, 4, 5, 6), (4,))
    ]
    asked += effort.pick([(1.0, 0, 4, d) for d in divisions], [])
    return [
        {"position_weight": weight, "lattice_deg": turn, "breadth": breadth, "divisions": d}
        for weight, turn, breadth, d in asked
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Errors; which first passes went to the mirrored elbow; and who was lost."""
    divisions, breadth = case["divisions"], case["breadth"]
    points = effort.pick(4000, 20)
    arm = arm_with_lattice(np.radians(case["lattice_deg"]))
    # The same goals for every lattice.
    q = random_joints(arm_with_lattice(0.0), points, effort.seed)
    done = walk(arm, q, divisions, breadth, case["position_weight"])
    return {
        "points": points,
        "travel_deg": float(np.degrees(travel(divisions, breadth))),
        **error_columns(done.position, done.turn),
        "lost": float(done.lost.mean()),
        "mirrored_first": float(done.mirrored_first.mean()),
        "mirrored_of_lost": share(done.mirrored_first, done.lost),
        "out_of_reach": float(done.out_of_reach.mean()),
        "lost_of_out": share(done.lost, done.out_of_reach),
        "lost_of_in": share(done.lost, ~done.out_of_reach),
        "settled": float(done.settled.mean()),
        "settled_of_mirrored": share(done.settled, done.mirrored_first),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """Errors against the travel, the fate of goals with a mirrored first pass, and turned lattices."""
    figure, axes = canvas(1, 3, (13, 4.4))
    plain = where(rows, position_weight=WEIGHT, lattice_deg=0)
    divisions = sorted({row["divisions"] for row in plain})
    some = sorted(plain, key=lambda row: row["travel_deg"])
    lines(axes[0, 0], some, "travel_deg", "position_mean_mm", "divisions", divisions, "D = {}")
    axes[0, 0].axvline(180, color="#777777", linewidth=1)
    axes[0, 0].set(
        xscale="log",
        yscale="log",
        xlabel="travel left after the first pass [°]",
        ylabel="mean position error [mm]",
        title="Br from 1 up: it takes half a turn",
    )
    axes[0, 0].set_xticks([20, 45, 90, 180, 360], ["20", "45", "90", "180", "360"])
    axes[0, 0].minorticks_off()
    four = where(plain, breadth=4)
    names = {
        "mirrored_first": "first pass mirrored",
        "out_of_reach": "answer out of reach then",
        "lost": "lost (> 10 mm)",
        "settled": "settled: place right, turn wrong",
    }
    for look, (name, label) in zip(LOOKS, names.items(), strict=False):
        values = [100 * row[name] for row in four]
        axes[0, 1].plot(column(four, "divisions"), values, label=label, **look)
    axes[0, 1].set(
        xlabel="D", ylabel="share of goals [%]", title="Br = 4: who is lost, who settles", ylim=(0, 50)
    )
    some = where(rows, position_weight=WEIGHT, breadth=4)
    some = sorted(some, key=lambda row: row["lattice_deg"])
    lines(axes[0, 2], some, "lattice_deg", "position_mean_mm", "divisions", (3, 4, 5, 6), "D = {}")
    axes[0, 2].set(
        yscale="log",
        xlabel="lattice of the elbow turned by [°]",
        ylabel="mean position error [mm]",
        title="Br = 4: other samples, other spike",
    )
    for axis in axes[0]:
        axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=1 if axis is axes[0, 1] else 2)
    figure.suptitle(f"Question 6, the mechanism: two-link arm, K_P / K_A = {WEIGHT:g} /m, B = 7200")
    save(figure, path)
