"""What a pose costs, plain and with the first joint divided out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.page import Page
from kinseek import maps
from kinseek.maps.grid import BLOCK
from kinseek.maps.search import reached, ruled_out

from .cells import (
    COUNT,
    WIDTH,
    Array,
    cpu,
    drawn,
    grid_around,
    rings_around,
    section,
    whole,
    work_of,
)

ARMS = ("ur5e", "irb120", "panda")

FINE = (0.05, 4608)
"""Cells of the second size at which the first joint is divided out [m], and orientations."""


def in_blocks(arm: kinseek.Arm, T: Array) -> NDArray[np.bool_]:
    """Which of many poses, (k, 4, 4), are reached, asked block by block as a worker does."""
    parts = [reached(arm, kinseek.Goal.pose(T[i : i + BLOCK])) for i in range(0, len(T), BLOCK)]
    return np.concatenate(parts)


def by_gate(arm: kinseek.Arm, T: Array) -> NDArray[np.bool_]:
    """Which of many poses, (k, 4, 4), lengths and angles rule out."""
    return np.concatenate(
        [ruled_out(arm, kinseek.Goal.pose(T[i : i + BLOCK])) for i in range(0, len(T), BLOCK)]
    )


def measure(page: Page, poses: int, rings: bool) -> None:
    """Write both sections; `rings` also measures the finer ones."""
    with section(page, "Time of a pose in a `Grid`"):
        page.say(
            f"{poses:,} cells of each arm, drawn from a cube as wide as its reach, with cells of {WIDTH * 100:.0f} cm",
            f"and {COUNT} orientations. One thread computes them in blocks of the default size. Times are CPU times",
            "for a pose. `arm.ik` solves a hundredth of the poses; it looks for the nearest pose if it finds no",
            "solution. *Missed* counts the poses that only `arm.ik` reaches. The gate is the first check of a proof:",
            "lengths and angles alone. All poses, those that are reached and the others are timed in separate runs, between",
            "which the clock of the machine can change.",
        )
        mixed = {name: _plain(name, poses) for name in ARMS}
        page.table(
            "arm | >reached | >reached ones, µs | >the others, µs | >all, µs | >the gate alone, µs | "
            ">of the others by the gate | >`arm.ik`, µs | >missed",
            [row for row, _ in mixed.values()],
        )
    with section(page, "Time of a pose in `Rings`"):
        page.say(
            "In `Rings` the first joint is divided out, so a ring stands for many cells of a `Grid`. One thread",
            "computes every ring, without Dask. The time for a cell of a `Grid` follows from the table above. If the",
            "first joint has limits, all solutions of each reached pose are computed, because they decide over which",
            "arc of the ring the pose is reached.",
        )
        rows = [_rings(name, mixed[name][1], WIDTH, COUNT) for name in ARMS]
        rows += [_rings(name, mixed[name][1], *FINE) for name in ARMS[:2] if rings]
        page.table(
            "arm | cells | >rings | >cells of a `Grid` | >cells a ring | >µs a ring | >µs a cell of a `Grid` | "
            ">`Grid`, µs a cell | >`Grid` / `Rings`",
            rows,
        )


def _plain(name: str, poses: int) -> tuple[list[str], float]:
    """A row, and what a pose costs [s]."""
    arm = kinseek.load(name)
    grid = grid_around(arm)
    T = grid.middles(drawn(grid, poses))
    in_blocks(arm, T[:2000])  # Builds the atlas.
    gate, closed = cpu(by_gate, arm, T)
    mixed, found = cpu(in_blocks, arm, T)
    alone, _ = cpu(in_blocks, arm, T[found])
    others, _ = cpu(in_blocks, arm, T[~found])
    few = T[: max(poses // 100, 100)]
    full, by_ik = cpu(lambda: arm.ik(few, threads=1).success)
    no = max(int((~found).sum()), 1)
    row = [
        name,
        f"{found.mean():.1%}",
        f"{alone / max(found.sum(), 1) * 1e6:.2f}",
        f"{others / no * 1e6:.2f}",
        f"{mixed / poses * 1e6:.2f}",
        f"{gate / poses * 1e6:.2f}",
        f"{closed.sum() / no:.1%}",
        f"{full / len(few) * 1e6:.0f}",
        f"{int((by_ik & ~found[: len(few)]).sum())} of {by_ik.sum()}",
    ]
    return row, mixed / poses


def _rings(name: str, plain: float, width: float, count: int) -> list[str]:
    arm = kinseek.load(name)
    rings = rings_around(arm, width, count)
    work = work_of(arm, rings)
    maps.reach(
        arm, rings_around(arm, 0.5, 12), block=10**6
    )  # Builds nothing that the next line lacks but the atlas.
    took, _ = cpu(whole, work, rings)
    stand = rings.volume / width**3 * len(rings.orientations)
    each = took / rings.size
    return [
        name,
        f"{width * 100:.0f} cm, {len(rings.orientations):,}",
        f"{rings.size:,}",
        f"{stand:,.0f}",
        f"{stand / rings.size:.0f}",
        f"{each * 1e6:.2f}",
        f"{took / stand * 1e6:.3f}",
        f"{plain * 1e6:.2f}",
        f"{plain * stand / took:.0f}",
    ]
