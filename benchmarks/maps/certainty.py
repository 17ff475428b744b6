"""What certainty costs: whole cells proved, on a part drawn from all of a map, and what the map of them would take."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

import kinseek
from benchmarks.page import Page
from kinseek import maps
from kinseek.maps.block import Desk, answered
from kinseek.maps.cells import EMPTY, REACHED

from .cells import Array, cpu, rings_around, section, work_of

BILLION = (0.05, 12_000)
"""Rings of an arm as long as the UR5e [m, orientations] that stand for a billion cells of a `Grid`."""

SIZES = {"ur5e": ((0.1, 576), (0.05, 4608), BILLION), "panda": (BILLION,)}
"""Of each arm."""

DEPTHS = (0, 2, 4, 12)


class Part(NamedTuple):
    """Rows of cells that were judged."""

    cost: Array
    """CPU time [s] a cell, of each row."""
    reached: Array
    """Share of each row that is reached somewhere."""
    empty: Array
    undecided: Array


def judged(arm: kinseek.Arm, rings: maps.Rings, depth: int, seconds: float) -> Part:
    """Judge rows of cells drawn from all of some rings, for so long.

    A row has all cells of one place and direction, which are judged together, as in a block.
    """
    work = work_of(arm, rings, None, prove=True, depth=depth)
    desk, rng, rows = Desk(work), np.random.default_rng(1), list[tuple[float, ...]]()
    desk.arm.ik(np.eye(4))  # Builds the atlas.
    until, row = time.process_time() + seconds, rings.orientations.arcs
    while len(rows) < 4 or time.process_time() < until:
        place = [int(rng.integers(n)) for n in rings.shape[:-1]]
        first = row * int(rng.integers(rings.shape[-1] // row))
        part = (*(slice(i, i + 1) for i in place), slice(first, first + row))
        took, values = cpu(answered, work, desk, rings.poses(part), part)
        shares = [float((values["cell"] == word).mean()) for word in (REACHED, EMPTY)]
        rows.append((took / row, *shares, 1.0 - sum(shares)))
    return Part(*np.array(rows).T)


def mean(values: Array, digits: str, scale: float = 1.0) -> str:
    """Mean of rows, and two standard errors of it."""
    error = 2 * values.std(ddof=1) / np.sqrt(len(values)) * scale
    return f"{format(values.mean() * scale, digits)} ± {format(error, digits)}"


def measure(page: Page, seconds: float) -> None:
    """Write the section."""
    with section(page, "What certainty costs"):
        page.say(
            "Rings, the first joint divided out. Rows are drawn from all of them, each all cells of one place and",
            f"direction, for {seconds:g} s of one thread for each line. ± is two standard errors of the mean over rows. The",
            "last column is what the same takes for 10⁹ cells of a `Grid`;",
            f"{BILLION[1]:,} orientations at {BILLION[0] * 100:.0f} cm are about as many.",
        )
        rows = []
        for name, sizes in SIZES.items():
            arm = kinseek.load(name)
            for width, count in sizes:
                rings = rings_around(arm, width, count)
                stand = rings.volume / width**3 * len(rings.orientations)
                for depth in DEPTHS:
                    part = judged(arm, rings, depth, seconds)
                    rows.append(
                        [
                            name,
                            f"{width * 100:.0f} cm, {rings.orientations.covering_radius:.2f} rad",
                            f"{depth}",
                            f"{len(part.cost) * rings.orientations.arcs:,}",
                            mean(part.cost, ".2f", 1e3),
                            mean(part.reached, ".1f", 100),
                            mean(part.empty, ".1f", 100),
                            mean(part.undecided, ".1f", 100),
                            f"{rings.size:,}",
                            mean(part.cost, ".2g", rings.size / 3600),
                            mean(part.cost, ".2g", rings.size / stand * 1e9 / 3600),
                        ]
                    )
        page.table(
            "arm | cells | depth | >judged | >ms a ring | >reached somewhere, % | >proved empty, % | >undecided, % | "
            ">rings of all | >core-hours of all | >core-hours of 10⁹ cells",
            rows,
        )


def asked(page: Page, poses: int) -> None:
    """Write the section about questions to a finished map."""
    arm = kinseek.load("ur5e")
    with section(page, "What a question to a finished map costs"):
        rows = []
        for grid in (
            rings_around(arm, 0.1, 576),
            maps.Grid((0, 1, 0.1), (0, 1, 0.1), (0, 1, 0.1), maps.orientations(576)),
        ):
            made = maps.reach(arm, grid, block=grid.size)
            T = arm.fk(arm.sample(poses, seed=6))
            maps.at(made, T[:1])
            many = min(cpu(maps.at, made, T)[0] for _ in range(3))
            single, _ = cpu(lambda made=made, T=T: [maps.at(made, one) for one in T[:200]])
            rows.append([type(grid).__name__, f"{many / poses * 1e6:.2f}", f"{single / 200 * 1e6:.0f}"])
        page.say(
            f"`maps.at` on a map of the UR5e in memory, {poses:,} poses at once (least of three) and one by one, CPU",
            "time of one thread.",
        )
        page.table("map of | >µs a pose, all at once | >µs a pose, one by one", rows)
