"""What certainty costs: whole cells proved, on a part drawn from all of a map, and what the map of them would take."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

import kinseek
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from benchmarks.timing import cpu
from kinseek import maps
from kinseek.maps.block import BlockScratch, Work, answered
from kinseek.maps.cells import EMPTY, REACHED, UNDECIDED

from .cells import Numbers, half_of, rings_around, work_of

BILLION = (0.05, 12_000)
"""Rings of an arm as long as the UR5e [m, orientations] that stand for a billion cells of a `Grid`."""

SIZES = {"ur5e": ((0.1, 576), (0.05, 4608), BILLION), "panda": (BILLION,)}
"""Of each arm."""

DEPTHS = (2, 4, 12)
"""How often a cell is cut, after none."""

LONG = {("ur5e", 4608): 12.0, ("ur5e", 12_000): 12.0}
"""How many times as long as others the deepest of these are judged: a billion cells are to take twenty core-hours."""

SHUT = 0.1
"""Of the time, for rows that no deeper cut can change: what these cost then."""


Cells = tuple[slice, ...]
"""Of each dimension of a grid, which."""


class Judged(NamedTuple):
    """All cells of one place and direction, as they were judged."""

    cost: float
    """CPU time [s] a cell."""
    reached: float
    """Share of the row that is reached somewhere."""
    empty: float
    undecided: float


class Told(NamedTuple):
    """A mean over all rows."""

    mean: float
    error: float
    """Two standard errors."""

    def text(self, digits: str, scale: float = 1.0) -> str:
        """Both, in another unit."""
        return f"{format(self.mean * scale, digits)} ± {format(self.error * scale, digits)}"


def a_row(rings: maps.Rings, rng: np.random.Generator) -> Cells:
    """The cells of a row drawn from all of some rings."""
    row = rings.orientations.arcs
    place = [int(rng.integers(n)) for n in rings.shape[:-1]]
    first = row * int(rng.integers(rings.shape[-1] // row))
    return (*(slice(i, i + 1) for i in place), slice(first, first + row))


def judge_of(arm: kinseek.Arm, rings: maps.Rings, depth: int) -> Callable[[Cells], Judged]:
    """What judges a row, so deep."""
    work = work_of(arm, rings, None, prove=True, depth=depth)
    scratch = BlockScratch(work)
    scratch.arm.ik(np.eye(4))  # Builds the atlas.

    def judged(part: Cells) -> Judged:
        took, values = cpu(answered, work, scratch, rings.poses(part), part)
        shares = (float((values["cell"] == word).mean()) for word in (REACHED, EMPTY, UNDECIDED))
        return Judged(took / rings.orientations.arcs, *shares)

    return judged


def in_turn(judge: Callable[[Cells], Judged], parts: Iterable[Cells], seconds: float) -> Array:
    """Judge one row after the other for so long [s] of CPU time, four at least, (k, 4)."""
    until, rows = time.process_time() + seconds, list[Judged]()
    for part in parts:
        rows.append(judge(part))
        if len(rows) >= 4 and time.process_time() > until:
            break
    return np.array(rows).reshape(-1, len(Judged._fields))


def two_phases(shallow: Array, groups: Sequence[tuple[Numbers, Array]]) -> Told:
    """The mean of what deep looks give, where all that was drawn had a shallow look, and a part of each group a deep one.

    Double sampling for stratification (Neyman 1938): groups are known of all that was drawn; what a deep look changes is
    added by its mean over those of the group that had one.

    Args:
        shallow: Values of all that was drawn, (n,).
        groups: Of each, the numbers of its members, (k,), and the values that a deep look gave the first m of them, (m,),
            m >= 2 unless the group is empty.
    """
    parts = [(members, deep) for members, deep in groups if len(members)]
    weights = [len(members) / len(shallow) for members, _ in parts]
    changes = [deep - shallow[members[: len(deep)]] for members, deep in parts]
    means = [
        float(shallow[members].mean() + change.mean())
        for (members, _), change in zip(parts, changes, strict=True)
    ]
    mean, error = float(np.dot(weights, means)), 0.0
    for weight, each, (members, deep), change in zip(weights, means, parts, changes, strict=True):
        spread = deep.var(ddof=1) if len(deep) > 1 else 0.0
        error += weight * (spread + (each - mean) ** 2) / len(shallow)
        if len(deep) < len(members):
            error += weight**2 * change.var(ddof=1) * (1 / len(deep) - 1 / len(members))
    return Told(mean, 2 * float(np.sqrt(error)))


def looked_at(
    arm: kinseek.Arm, rings: maps.Rings, seconds: float, long: float
) -> Iterator[tuple[int, int, int, list[Told]]]:
    """Of each depth how many rows were drawn, how many had a deep look, and the means of all that a `Judged` has.

    A row that is decided without a cut stays as it is: the others, one in twenty, make nearly all that differs.
    """
    rng, parts = np.random.default_rng(1), list[Cells]()

    def draw() -> Iterator[Cells]:
        while True:
            parts.append(a_row(rings, rng))
            yield parts[-1]

    shallow = in_turn(judge_of(arm, rings, 0), draw(), 2 * seconds)
    undecided = shallow[:, Judged._fields.index("undecided")] > 0.0
    every, groups = np.arange(len(parts)), [np.flatnonzero(undecided), np.flatnonzero(~undecided)]
    yield 0, len(parts), len(parts), [two_phases(each, [(every, each)]) for each in shallow.T]
    for depth in DEPTHS:
        judge, most = judge_of(arm, rings, depth), seconds * (long if depth == DEPTHS[-1] else 1.0)
        deep = [
            in_turn(judge, (parts[i] for i in members.tolist()), most * share)
            for members, share in zip(groups, (1.0 - SHUT, SHUT), strict=True)
        ]
        told = [
            two_phases(each, [(members, made[:, k]) for members, made in zip(groups, deep, strict=True)])
            for k, each in enumerate(shallow.T)
        ]
        yield depth, len(parts), len(deep[0]), told


def measure(page: Page, seconds: float) -> None:
    """Write the section."""
    with page.section("Time of proofs about whole cells"):
        page.say(
            "Maps of `Rings` with `prove=True`. A row of a map is all cells of one position and direction. For each arm",
            f"and size, random rows are classified with depth 0 for {2 * seconds:g} s of one thread. Some of the rows",
            f"with undecided cells are then classified with a larger depth, for {seconds:g} s for each line of the",
            "table, and for longer at the largest depth of the finest maps. Their results are weighted by their share",
            "of all rows. A tenth of this time is spent on the other rows, whose results do not change, to measure",
            "their cost. ± gives two standard errors of the mean over rows, for both samples together. The last column",
            f"is the time for 10⁹ cells of a `Grid`, which has about that many with {BILLION[1]:,} orientations at",
            f"{BILLION[0] * 100:.0f} cm.",
        )
        page.rows(
            row
            for name, sizes in SIZES.items()
            for width, count in sizes
            for row in _looked_at(kinseek.load(name), width, count, seconds)
        )


def _looked_at(arm: kinseek.Arm, width: float, count: int, seconds: float) -> Iterator[Row]:
    rings = rings_around(arm, width, count)
    stand, long = rings.volume / width**3 * len(rings.orientations), LONG.get((arm.name, count), 1.0)
    for depth, drawn, deep, (cost, reached, empty, undecided) in looked_at(arm, rings, seconds, long):
        yield {
            "arm": arm.name,
            "cells": f"{width * 100:.0f} cm, {rings.orientations.covering_radius:.2f} rad",
            "depth": depth,
            ">rows": f"{drawn:,}",
            ">of these with larger depth": f"{deep:,}" if depth else "–",
            ">ms a ring": cost.text(".2f", 1e3),
            ">reached somewhere, %": reached.text(".1f", 100),
            ">proved empty, %": empty.text(".1f", 100),
            ">undecided, %": undecided.text(".2f", 100),
            ">rings of the map": f"{rings.size:,}",
            ">core-hours of the map": cost.text(".2g", rings.size / 3600),
            ">core-hours of 10⁹ cells": cost.text(".2g", rings.size / stand * 1e9 / 3600),
        }


WHOLE = ((0.1, 576), (0.05, 4608), (0.05, 12_000), (0.03, 40_000), (0.02, 170_000))
"""Cells of which it is proved how much is reached as a whole [m, orientations]."""

WHOLE_DEPTHS = (2, 4, 8)
"""How often they are cut: as a map does unless told otherwise, and as often as `kinseek.maps.whole` cuts at most."""


def slab(arm: kinseek.Arm, width: float, count: int) -> maps.Grid:
    """Cells in front of an arm, as far as it reaches: a `Grid` of small cells all around is too large."""
    half = half_of(arm, width)
    return maps.Grid((0.0, half, width), (0.0, width, width), (-half, half, width), maps.orientations(count))


def touched(arm: kinseek.Arm, grid: maps.Grid | maps.Rings, number: int) -> Iterator[Cells]:
    """Cells drawn from all of a grid whose middle is reached."""
    rng = np.random.default_rng(2)
    while number:
        cell = tuple(slice(i, i + 1) for i in (int(rng.integers(n)) for n in grid.shape))
        if arm.ik(grid.poses(cell).reshape(4, 4)).success:
            number -= 1
            yield cell


def wholes(page: Page, number: int) -> None:
    """Write the section about cells that are reached as a whole."""
    arm = kinseek.load("ur5e")
    with page.section("How much of a cell is proved to be reached as a whole"):
        page.say(
            f"{number} cells of a UR5e for each line, drawn at random from those whose middle is reached. *Above 0* counts",
            "the cells of which some part is proved to be reached as a whole; ± gives two standard errors of the mean.",
        )
        page.rows(
            row
            for width, count in WHOLE
            for make in (slab, rings_around)
            for row in _wholes(arm, make(arm, width, count), number)
        )


def _wholes(arm: kinseek.Arm, grid: maps.Grid | maps.Rings, number: int) -> Iterator[Row]:
    cells = list(touched(arm, grid, number))
    for depth in WHOLE_DEPTHS:
        work = work_of(arm, grid, None, prove=True, depth=depth)
        scratch = BlockScratch(work)
        scratch.arm.ik(np.eye(4))  # Builds the atlas.

        def share(cell: Cells, work: Work = work, scratch: BlockScratch = scratch) -> float:
            return float(answered(work, scratch, grid.poses(cell), cell)["whole_share"].item())

        took, found = cpu(lambda share=share: np.array([share(cell) for cell in cells]))
        yield {
            "map": type(grid).__name__,
            "size of a cell": f"{grid.widths[0] * 100:.0f} cm, {grid.orientations.covering_radius:.2f} rad",
            "depth": depth,
            ">above 0": f"{np.count_nonzero(found)} of {number}",
            ">mean `whole_share`": Told(found.mean(), 2 * found.std(ddof=1) / np.sqrt(number)).text(".2f"),
            ">ms a cell": f"{took / number * 1e3:.0f}",
        }


def asked(page: Page, poses: int) -> None:
    """Write the section about questions to a finished map."""
    arm = kinseek.load("ur5e")
    T, ends = arm.fk(arm.sample(poses, seed=6)), (0, 1, 0.1)
    with page.section("Time to look up poses in a finished map"):
        page.say(
            f"`maps.at` on a map of the UR5e in memory: {poses:,} poses in one call (the least of three), and one by one.",
            "CPU time of one thread.",
        )
        grids = rings_around(arm, 0.1, 576), maps.Grid(ends, ends, ends, maps.orientations(576))
        page.rows(_asked(arm, grid, T) for grid in grids)


def _asked(arm: kinseek.Arm, grid: maps.Grid | maps.Rings, T: Array) -> Row:
    made = maps.reach(arm, grid, block=grid.size)
    maps.at(made, T[:1])
    many = min(cpu(maps.at, made, T)[0] for _ in range(3))
    single, _ = cpu(lambda: [maps.at(made, one) for one in T[:200]])
    return {
        "map of": type(grid).__name__,
        ">µs a pose, all at once": f"{many / len(T) * 1e6:.2f}",
        ">µs a pose, one by one": f"{single / 200 * 1e6:.0f}",
    }
