"""Question 6, the map: which goals of the two-link arm are lost, over the first cell of the base and all of the elbow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from .effort import Effort, Row
from .mirror import arm_with_lattice, walk
from .question_06_walk import WEIGHT
from .style import canvas, save, where

BREADTH = 4


def cases(effort: Effort) -> list[Row]:
    """Tiles: the first joint modulo the first pass's cell, for turning the base by a cell changes nothing."""
    across, along = effort.pick((12, 36), (2, 4))
    return [
        {"divisions": d, "first_of_cell": (i + 0.5) / across, "second_deg": 360 * (j + 0.5) / along}
        for d in effort.pick((3, 4, 5), (4,))
        for i in range(across)
        for j in range(along)
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Goals spread over one tile."""
    across, along = effort.pick((12, 36), (2, 4))
    side, divisions = effort.pick(8, 2), case["divisions"]
    inside = (np.arange(side) + 0.5) / side - 0.5
    first, second = np.meshgrid(inside / across, 360 * inside / along)
    first = (case["first_of_cell"] + first.ravel()) * 2 * np.pi / divisions
    second = np.radians(case["second_deg"] + second.ravel())
    q = np.stack([first, second], axis=1)
    done = walk(arm_with_lattice(0.0), q, divisions, BREADTH, WEIGHT)
    return {
        "points": len(q),
        "lost": float(done.lost.mean()),
        "mirrored_first": float(done.mirrored_first.mean()),
        "out_of_reach": float(done.out_of_reach.mean()),
        "settled": float(done.settled.mean()),
    }


def draw(rows: Sequence[Row], path: Path) -> None:
    """One row of panels a D: the first pass, the reach, the lost and the settled."""
    every = sorted({row["divisions"] for row in rows})
    names = {
        "mirrored_first": "first pass mirrored",
        "out_of_reach": "answer out of reach",
        "lost": "lost (> 10 mm)",
        "settled": "place right, turn wrong",
    }
    figure, axes = canvas(len(every), 4, (11, 1 + 3 * len(every)), sharex=True, sharey=True)
    for line, d in zip(axes, every, strict=True):
        some = where(rows, divisions=d)
        across = sorted({row["first_of_cell"] for row in some})
        along = sorted({row["second_deg"] for row in some})
        for axis, (name, label) in zip(line, names.items(), strict=True):
            tiles = np.array([row[name] for row in some]).reshape(len(across), len(along)).T
            axis.grid(False)
            shown = axis.imshow(
                tiles, origin="lower", aspect="auto", extent=(0, 1, 0, 360), cmap="Greys", vmin=0, vmax=1
            )
            for k in range(d):
                axis.axhline(360 * k / d, color="#c23b00", linewidth=1)
            axis.set_title(f"D = {d}: {label}, {100 * tiles.mean():.1f} %", fontsize=9)
        line[0].set_ylabel("elbow, q2 [°]; lines: samples")
        line[0].set_yticks([0, 90, 180, 270, 360])
    for axis in axes[-1]:
        axis.set_xlabel("base, q1, of a first cell")
    figure.colorbar(shown, ax=axes, label="share of goals", shrink=0.5)
    figure.suptitle(f"Question 6, the map: two-link arm, Br = {BREADTH}, K_P / K_A = {WEIGHT:g} /m")
    save(figure, path)
