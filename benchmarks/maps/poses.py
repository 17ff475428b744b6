"""What a pose costs, plain and with the first joint divided out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from benchmarks.timing import cpu
from kinseek import maps
from kinseek.maps.grid import BLOCK
from kinseek.maps.search import reached, ruled_out

from .cells import COUNT, WIDTH, drawn, grid_around, rings_around, whole, work_of

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
    with page.section("Time of a pose in a `Grid`"):
        page.say(
            f"{poses:,} cells of each arm, drawn from a cube as wide as its reach, with cells of {WIDTH * 100:.0f} cm",
            f"and {COUNT} orientations. One thread computes them in blocks of the default size. Times are CPU times",
            "for a pose. `arm.ik` solves a hundredth of the poses; it looks for the nearest pose if it finds no",
            "solution. *Missed* counts the poses that only `arm.ik` reaches. The gate is the first check of a proof:",
            "lengths and angles alone. All poses, those that are reached and the others are timed in separate runs, between",
            "which the clock of the machine can change.",
        )
        costs: dict[str, float] = {}
        page.rows(_plain(name, poses, costs) for name in ARMS)
    with page.section("Time of a pose in `Rings`"):
        page.say(
            "In `Rings` the first joint is divided out, so a ring stands for many cells of a `Grid`. One thread",
            "computes every ring, without Dask. The time for a cell of a `Grid` follows from the table above. If the",
            "first joint has limits, all solutions of each reached pose are computed, because they decide over which",
            "arc of the ring the pose is reached.",
        )
        sizes = [(name, WIDTH, COUNT) for name in ARMS] + [(name, *FINE) for name in ARMS[:2] if rings]
        page.rows(_rings(name, costs[name], width, count) for name, width, count in sizes)


def _plain(name: str, poses: int, costs: dict[str, float]) -> Row:
    """A row; what a pose costs [s] is noted."""
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
    costs[name] = mixed / poses
    return {
        "arm": name,
        ">reached": f"{found.mean():.1%}",
        ">reached ones, µs": f"{alone / max(found.sum(), 1) * 1e6:.2f}",
        ">the others, µs": f"{others / no * 1e6:.2f}",
        ">all, µs": f"{mixed / poses * 1e6:.2f}",
        ">the gate alone, µs": f"{gate / poses * 1e6:.2f}",
        ">of the others by the gate": f"{closed.sum() / no:.1%}",
        ">`arm.ik`, µs": f"{full / len(few) * 1e6:.0f}",
        ">missed": f"{int((by_ik & ~found[: len(few)]).sum())} of {by_ik.sum()}",
    }


def _rings(name: str, plain: float, width: float, count: int) -> Row:
    arm = kinseek.load(name)
    rings = rings_around(arm, width, count)
    work = work_of(arm, rings)
    maps.reach(arm, rings_around(arm, 0.5, 12), block=10**6)  # Builds what the next line needs, the atlas.
    took, _ = cpu(whole, work, rings)
    stand = rings.volume / width**3 * len(rings.orientations)
    return {
        "arm": name,
        "cells": f"{width * 100:.0f} cm, {len(rings.orientations):,}",
        ">rings": f"{rings.size:,}",
        ">cells of a `Grid`": f"{stand:,.0f}",
        ">cells a ring": f"{stand / rings.size:.0f}",
        ">µs a ring": f"{took / rings.size * 1e6:.2f}",
        ">µs a cell of a `Grid`": f"{took / stand * 1e6:.3f}",
        ">`Grid`, µs a cell": f"{plain * 1e6:.2f}",
        ">`Grid` / `Rings`": f"{plain * stand / took:.0f}",
    }
