"""Errors of maps that take the same time: ours, and those that samples of joint values fill.

Of the literature only the ideas are here, written anew, compiled forward kinematics under all of them. RM4D (Rudorfer 2024,
arXiv:2410.06968): poses that differ by a turn about the first axis and by one about the tool's z axis are one; what is left
are the height, the angle of that axis to the vertical, and the position across after the axis has been turned into one
plane. So it holds for arms whose first joint turns all around and whose last turns all around that very axis, as a UR5e's
do. Reuleaux (Makhal and Goins 2018, arXiv:1710.01328) asks a solver for a pose in each cell of positions and orientations;
others mark the cells that poses of random joint values lie in.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from benchmarks.branches import eaik
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from benchmarks.timing import cpu
from kinseek import maps

from .cells import COUNT, WIDTH, drawn, grid_around, half_of, rings_around, whole, work_of

Flags = NDArray[np.bool_]
Said = Callable[[Array], Flags]
"""Does a map call poses, (k, 4, 4), reached?"""

LADDER = (
    (0.5, 24),
    (0.4, 72),
    (0.3, 144),
    (0.25, 288),
    (0.2, 576),
    (0.15, 1152),
    (0.1, 2304),
    (0.1, 4608),
    (0.05, 12_000),
)
"""Widths [m] and orientations, each finer than the one before: a map that asks cell by cell takes the finest that it can."""

TABLES = ((0.1, 18), (0.05, 36), (0.025, 72))
"""Of RM4D: widths [m], and how many parts the angle has. Its authors take the second."""

SAMPLES = 20_000
"""Joint vectors drawn at a time."""

STARTS, STEPS, DAMPING = 4, 30, 1e-3
"""Of the seeded solver: random starts for a pose, steps from each, and how far singular values are damped."""


@dataclass(frozen=True)
class Table:
    """A table of RM4D's four coordinates, as far as an arm reaches."""

    half: float
    """Half the width of its positions [m]."""
    width: float
    """Of a cell [m]."""
    angles: int
    """Parts of the angle to the vertical."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Height, angle, and two coordinates across."""
        side = round(2 * self.half / self.width)
        return side, self.angles, side, side

    def cells_of(self, T: Array) -> tuple[NDArray[np.int64], ...]:
        """Numbers of the cells of poses, (k, 4, 4), -1 outside."""
        z, p, side = T[:, :3, 2], T[:, :3, 3], self.shape[0]
        away = np.hypot(z[:, 0], z[:, 1])
        c, s = z[:, 0] / np.maximum(away, 1e-300), z[:, 1] / np.maximum(away, 1e-300)
        across, aside = c * p[:, 0] + s * p[:, 1], c * p[:, 1] - s * p[:, 0]
        angle = np.minimum(
            (np.arctan2(away, z[:, 2]) * (self.angles / np.pi)).astype(np.int64), self.angles - 1
        )
        places = [
            np.floor((each + self.half) / self.width).astype(np.int64) for each in (p[:, 2], across, aside)
        ]
        height, first, second = (np.where((at >= 0) & (at < side), at, -1) for at in places)
        return height, angle, first, second


def filled(arm: kinseek.Arm, grid: Table | maps.Grid, seconds: float) -> tuple[Said, int]:
    """Mark cells that poses of random joint values lie in, for so long [s]; how many values that were."""
    marked, vectors, until = np.zeros(grid.shape, dtype=bool), 0, time.process_time() + seconds
    while time.process_time() < until:
        T = arm.fk(arm.sample(SAMPLES, seed=vectors))
        cells = grid.cells_of(T)
        inside = np.min(cells, axis=0) >= 0
        marked[tuple(cell[inside] for cell in cells)] = True
        vectors += SAMPLES
    return reads(grid, marked), vectors


def reads(grid: Table | maps.Grid, marked: Flags) -> Said:
    """How a table is read; nothing outside of it is reached."""

    def said(T: Array) -> Flags:
        cells = grid.cells_of(T)
        return np.asarray(marked[cells] & (np.min(cells, axis=0) >= 0))

    return said


def seeded(arm: kinseek.Arm, T: Array, seed: int = 0) -> Flags:
    """Which poses, (k, 4, 4), damped least squares reach from some random starts within the limits, 1e-4 m and rad."""
    found, rng = np.zeros(len(T), dtype=bool), np.random.default_rng(seed)
    for _ in range(STARTS):
        left = np.flatnonzero(~found)
        q = rng.uniform(arm.lower, arm.upper, (len(left), arm.dof))
        for _ in range(STEPS):
            error = off(arm, q, T[left])
            done = np.abs(error).max(axis=1) < 1e-4
            found[left[done]] = True
            left, q, error = left[~done], q[~done], error[~done]
            if not len(left):
                break
            J = arm.jacobian(q)
            square = J @ J.transpose(0, 2, 1) + DAMPING * np.eye(6)
            step = (J.transpose(0, 2, 1) @ np.linalg.solve(square, error[:, :, None]))[:, :, 0]
            q = np.clip(q + np.clip(step, -1.0, 1.0), arm.lower, arm.upper)
    return found


def off(arm: kinseek.Arm, q: Array, T: Array) -> Array:
    """What lacks from the poses of joint values to those wanted, position [m] and turn [rad], (k, 6)."""
    at = arm.fk(q)
    turn = Rotation.from_matrix(T[:, :3, :3] @ at[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([T[:, :3, 3] - at[:, :3, 3], turn], axis=1)


def finest(cells: float, make: Callable[[float, int], Any]) -> Any:
    """The finest grid of the ladder that has no more cells than can be asked."""
    fits = [grid for width, count in LADDER if (grid := make(width, count)).size <= cells]
    return fits[-1] if fits else make(*LADDER[0])


def by_solver(arm: kinseek.Arm, grid: maps.Grid) -> Said:
    """A map that asks the seeded solver for the middle of each cell."""
    T = grid.poses([slice(None)] * 4).reshape(-1, 4, 4)
    parts = [seeded(arm, T[i : i + SAMPLES], i) for i in range(0, len(T), SAMPLES)]
    return reads(grid, np.concatenate(parts).reshape(grid.shape))


def ours(arm: kinseek.Arm, grid: maps.Grid | maps.Rings) -> Said:
    """Our map in memory, made block by block in this process, read by `maps.at`."""
    import xarray

    work = work_of(arm, grid)
    values = whole(work, grid)
    told: dict[str, Any] = {"grid": work.grid, "variables": list(values), "name": arm.name}
    if isinstance(grid, maps.Rings):
        first = maps.first_joint.divided(work.chain)
        told["first_frame"] = first.place.tolist()
        told["first_turns"] = min(1.0, (first.upper - first.lower) / (2 * np.pi))
    made = xarray.Dataset({name: (grid.dims, each) for name, each in values.items()}, attrs={"kinseek": told})

    def said(T: Array) -> Flags:
        read = maps.at(made, T)
        return np.asarray((read["reached"] == 1) & read["inside"])

    return said


def words(grid: maps.Grid | maps.Rings) -> str:
    """What a grid is, for a table."""
    kind = "rings" if isinstance(grid, maps.Rings) else "boxes"
    return f"{grid.widths[0] * 100:g} cm, {np.degrees(grid.orientations.covering_radius):.0f}°, {grid.size:,} {kind}"


def tests_of(arm: kinseek.Arm, number: int) -> Array:
    """Random poses in the ball around the first joint that holds all that an arm reaches, (k, 4, 4)."""
    rng = np.random.default_rng(7)
    T = np.tile(np.eye(4), (number, 1, 1))
    away = rng.normal(size=(number, 3))
    length = arm.chain.reach * np.cbrt(rng.random(number)) / np.linalg.norm(away, axis=1)
    T[:, :3, 3] = arm.chain.fixed[0, :, 3] + away * length[:, None]
    T[:, :3, :3] = Rotation.random(number, random_state=8).as_matrix()
    return T


def measure(page: Page, tests: int, seconds: float) -> None:
    """Write the section: every map is given the same CPU time of one thread."""
    arm = kinseek.load("ur5e")
    half = half_of(arm, 0.1)
    with page.section("Errors of maps that take the same time"):
        T = tests_of(arm, tests)
        judge = eaik(arm)
        truth = np.array([len(judge(pose)) > 0 for pose in T])
        page.say(
            f"{tests:,} random poses in a ball that contains all positions that the UR5e reaches. EAIK has a solution",
            f"inside the limits for {truth.mean():.1%} of them, and decides which results are wrong. Each map has",
            f"{seconds:g} s of one thread. Maps that solve each cell use the finest grid of a list for which a trial",
            "predicts that this is enough. Sampled maps mark the cells of random joint values until the time is over,",
            "with tables of several sizes. The table of RM4D requires that both the first and the last joint turn",
            "fully, as those of a UR5e do. Our rings use the first joint alone, so they support other arms too, and",
            "have more cells.",
        )
        page.rows(_row(name, said, took, T, truth) for name, said, took in _maps(arm, half, seconds))


def _row(name: tuple[str, str, str], said: Said, took: float, T: Array, truth: Flags) -> Row:
    asked, told = cpu(said, T)
    map_of, cells, source = name
    return {
        "map": map_of,
        "cells": cells,
        "made from": source,
        ">CPU time, s": f"{took:.1f}",
        ">wrong": f"{(told != truth).mean():.2%}",
        ">reached ones reported as not reached": f"{(~told[truth]).mean():.2%}",
        ">others reported as reached": f"{told[~truth].mean():.2%}",
        ">µs a look-up": f"{asked / len(T) * 1e6:.2f}",
    }


def _maps(arm: kinseek.Arm, half: float, seconds: float) -> Any:
    """Each map: its name, cells and what it is made of; how it is read; what it took [s]."""

    def rings(width: float, count: int) -> maps.Rings:
        return rings_around(arm, width, count)

    def grid(width: float, count: int) -> maps.Grid:
        return grid_around(arm, width, count)

    trial = grid(WIDTH, COUNT)
    some = trial.middles(drawn(trial, 3000))
    seeded(arm, some[:100])
    for title, make in (("kinseek, `Rings`", rings), ("kinseek, `Grid`", grid)):
        coarse = make(*LADDER[2])
        ours(arm, coarse)
        each = cpu(ours, arm, coarse)[0] / coarse.size
        chosen = finest(seconds / each, make)
        took, said = cpu(ours, arm, chosen)
        yield (title, words(chosen), "a search for each cell"), said, took
    each = cpu(seeded, arm, some)[0] / len(some)
    chosen = finest(seconds / each, grid)
    took, said = cpu(by_solver, arm, chosen)
    yield ("6D, a seeded solver", words(chosen), f"{STARTS} starts for each cell"), said, took
    for width, count in ((0.2, 576), (0.1, 4608)):
        sampled = grid(width, count)
        took, (said, vectors) = cpu(filled, arm, sampled, seconds)
        yield ("6D, sampled", words(sampled), f"{vectors / 1e6:.1f} million joint vectors"), said, took
    for width, angles in TABLES:
        table = Table(half, width, angles)
        took, (said, vectors) = cpu(filled, arm, table, seconds)
        cells = f"{width * 100:g} cm, {180 / angles:g}°, {np.prod(table.shape):,}"
        yield ("RM4D, sampled", cells, f"{vectors / 1e6:.1f} million joint vectors"), said, took
