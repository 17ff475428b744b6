"""Is anything reached in a cell that is called proved empty? Poses drawn inside such cells, and joint values of any."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.branches import eaik
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from kinseek import maps
from kinseek.branches.result import BranchesBatch
from kinseek.maps.block import BlockScratch, Work, answered
from kinseek.maps.cells import EMPTY
from kinseek.maps.orientations import about_z
from kinseek.maps.search import reached, ruled_out

from .cells import Index, Numbers, drawn, inside, rings_around, work_of

ARMS = {"ur5e": True, "irb120": True, "panda": False}
"""And whether EAIK knows them."""

EACH = 200
"""Poses drawn in each cell."""

SPARE = 5
"""Of an arm with joints to spare, which takes longest and which EAIK does not know, so many times fewer are asked."""

DEPTH = 1
"""How often a cell is cut in half here."""

SIZES = ((0.1, 576), (0.05, 4608))
"""Widths of cells [m], and orientations."""


def judge(work: Work, scratch: BlockScratch, cell: Index) -> int:
    """What is known of one whole cell."""
    part = tuple(slice(i, i + 1) for i in cell)
    return int(answered(work, scratch, scratch.grid.poses(part), part)["cell"].item())


def empty_cells(work: Work, scratch: BlockScratch, number: int) -> Numbers:
    """Cells that are proved empty, (number, dimensions): half of them such that lengths alone do not tell it."""
    kept: dict[bool, list[Any]] = {True: [], False: []}
    for cells in batches(scratch.grid):
        goal = kinseek.Goal.pose(
            np.concatenate([scratch.grid.poses(one(cell)).reshape(1, 4, 4) for cell in cells])
        )
        for cell, far in zip(cells, ruled_out(scratch.arm, goal), strict=True):
            some = kept[bool(far)]
            if len(some) < number // 2 and judge(work, scratch, tuple(cell)) == EMPTY:
                some.append(cell)
        if all(len(some) >= number // 2 for some in kept.values()):
            break
    return np.array(kept[True] + kept[False])


def batches(grid: maps.Grid | maps.Rings) -> Iterator[Numbers]:
    """Cells drawn from all of a grid, some hundred at a time, at most so many that a search for them ends."""
    for seed in range(500):
        yield drawn(grid, 200, seed)


def one(cell: Numbers) -> tuple[slice, ...]:
    """A cell as a part of its grid."""
    return tuple(slice(int(i), int(i) + 1) for i in cell)


def measure(page: Page, poses: int, vectors: int) -> None:
    """Write the section."""
    with page.section("Is anything reached in cells that are proved empty?"):
        page.say(
            f"{EACH} poses are drawn in each of some rings, of two sizes, that are proved empty (`depth={DEPTH}`).",
            "Each pose is turned by a random angle about the first axis, and one coordinate in five lies at an edge",
            "of the cell. For half of the rings, lengths and angles alone do not exclude the middle. Four methods try",
            "to reach the poses. The last two columns check these methods: they are the share of reachable poses,",
            "made from joint values inside the limits, that a method reaches.",
        )
        parts = 2 * sum(ARMS.values())
        asked = [
            (name, *size, poses // share, vectors // share)
            for name, known in ARMS.items()
            for size in SIZES
            for share in [parts if known else parts * SPARE]
        ]
        with ProcessPoolExecutor(2, get_context("spawn")) as pool:
            rows, landed = zip(*pool.map(_both, asked), strict=True)
        page.rows(rows)
        page.say(
            "The second test begins with joint values inside the limits. The cell in which the hand is then must not be",
            "proved empty. Cells whose middle is reached need no test; the others are tested.",
        )
        page.rows(landed)


def _both(asked: tuple[str, float, int, int, int]) -> tuple[Row, Row]:
    """A row of each table."""
    name, width, count, poses, vectors = asked
    arm = kinseek.load(name)
    return _poses(arm, width, count, poses, ARMS[name]), _vectors(arm, width, count, vectors)


def _work(arm: kinseek.Arm, width: float, count: int) -> tuple[Work, BlockScratch]:
    work = work_of(arm, rings_around(arm, width, count), prove=True, depth=DEPTH)
    return work, BlockScratch(work)


def _poses(arm: kinseek.Arm, width: float, count: int, poses: int, known: bool) -> Row:
    work, scratch = _work(arm, width, count)
    cells, rng = empty_cells(work, scratch, max(poses // EACH, 2)), np.random.default_rng(3)
    turned = np.tile(np.eye(4), (len(cells) * EACH, 1, 1))
    turned[:, :3, :3] = about_z(rng.uniform(-np.pi, np.pi, len(turned)))
    T, reach = turned @ inside(scratch.grid, np.repeat(cells, EACH, axis=0), rng), scratch.arm
    good = reach.fk(reach.sample(max(len(T) // 10, 1), seed=4))
    theirs = _eaik(reach) if known else None
    return {
        "arm": arm.name,
        "cells": f"{width * 100:.0f} cm, {count:,}",
        ">cells proved": f"{len(cells):,}",
        ">poses": f"{len(T):,}",
        ">found by `maps`": f"{reached(reach, kinseek.Goal.pose(T)).sum():,}",
        ">by `ik`": f"{reach.ik(T, threads=1).success.sum():,}",
        ">by `branches`": f"{(cast(BranchesBatch, reach.branches(T, threads=1)).counts > 0).sum():,}",
        ">by EAIK": f"{theirs(T).sum():,}" if theirs else "–",
        ">of reached ones, `maps`": f"{reached(reach, kinseek.Goal.pose(good)).mean():.2%}",
        ">EAIK": f"{theirs(good).mean():.2%}" if theirs else "–",
    }


def _eaik(arm: kinseek.Arm) -> Callable[[Array], NDArray[np.bool_]]:
    """Says of poses, (k, 4, 4), to which of them EAIK has an answer inside the limits."""
    solve = eaik(arm)
    return lambda T: np.array([len(solve(pose)) > 0 for pose in T])


def _vectors(arm: kinseek.Arm, width: float, count: int, vectors: int) -> Row:
    work, scratch = _work(arm, width, count)
    grid, reach = scratch.grid, scratch.arm
    cells = np.stack(grid.cells_of(reach.fk(reach.sample(vectors, seed=5))), axis=1)
    cells = cells[(cells >= 0).all(axis=1)]
    distinct, times = np.unique(cells, axis=0, return_counts=True)
    T = np.concatenate([grid.poses(one(cell)).reshape(1, 4, 4) for cell in distinct])
    unsure = np.flatnonzero(~reached(reach, kinseek.Goal.pose(T)))
    empty = sum(judge(work, scratch, tuple(distinct[i])) == EMPTY for i in unsure)
    return {
        "arm": arm.name,
        "cells": f"{width * 100:.0f} cm, {count:,}",
        ">joint vectors": f"{len(cells):,}",
        ">cells of their poses": f"{len(distinct):,}",
        ">of these tested": f"{len(unsure):,}",
        ">vectors in these": f"{times[unsure].sum():,}",
        ">proved empty": f"{empty:,}",
    }
