"""Grids around an arm, and cells and poses drawn from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import Array
from kinseek import maps
from kinseek.maps import make
from kinseek.maps.block import Work, compute
from kinseek.maps.orientations import about_z, direction, shortest_turn

Numbers = NDArray[np.int64]
Index = tuple[int, ...]

WIDTH, COUNT = 0.1, 576
"""Of cells [m], and orientations, where nothing else is said."""


def half_of(arm: kinseek.Arm, width: float) -> float:
    """Half a cube of whole cells that holds all that an arm reaches [m]."""
    return float(np.ceil(arm.chain.reach / width - 1e-9) * width)


def grid_around(arm: kinseek.Arm, width: float = WIDTH, count: int = COUNT) -> maps.Grid:
    """A cube of cells as far as the arm reaches."""
    ends = (-(half := half_of(arm, width)), half, width)
    return maps.Grid(ends, ends, ends, maps.orientations(count))


def rings_around(arm: kinseek.Arm, width: float = WIDTH, count: int = COUNT) -> maps.Rings:
    """Rings as far as the arm reaches: they stand for a cylinder, which a cube of the same width holds 4/π times."""
    half = half_of(arm, width)
    return maps.Rings((0.0, half, width), (-half, half, width), maps.orientations(count))


def drawn(grid: maps.Grid | maps.Rings, number: int, seed: int = 0) -> Numbers:
    """Cells drawn from all of a grid, (number, dimensions)."""
    return np.random.default_rng(seed).integers(grid.shape, size=(number, len(grid.shape)))


def inside(grid: maps.Grid | maps.Rings, cells: Numbers, rng: np.random.Generator) -> Array:
    """A pose anywhere in each of these cells, (k, 4, 4); one coordinate in five lies at an end of its range."""
    turns, k = grid.orientations, len(cells)
    at = rng.uniform(-0.5, 0.5, (k, len(grid.places) + 3))
    at = np.where(rng.random(at.shape) < 0.2, np.sign(at) * (0.5 - 1e-6), at)
    region, arc = np.divmod(cells[:, -1], turns.arcs)
    low, high, begin, end = turns.regions[region].T
    z, azimuth = 0.5 + at[:, -3], begin + (0.5 + at[:, -2]) * (end - begin)
    d = direction(np.arccos(np.cos(low) + z * (np.cos(high) - np.cos(low))), azimuth)
    spin = about_z((2 * (arc + at[:, -1]) + 1) * turns.half_arc - np.pi)
    T = np.tile(np.eye(4), (k, 1, 1))
    T[:, :3, :3] = np.stack(
        [
            shortest_turn(turns.directions[i], d[n]) @ turns.frames[i] @ spin[n]
            for n, i in enumerate(region.tolist())
        ]
    )
    for number, row in enumerate(grid.rows):
        T[:, row, 3] = grid.places[number][cells[:, number]] + at[:, number] * grid.widths[number]
    return T


def work_of(
    arm: kinseek.Arm, grid: maps.Grid | maps.Rings, store: Path | None = None, **options: Any
) -> Work:
    """What workers are told of a map of what is reached."""
    place = None if store is None else str(store)
    return make.work_of(arm, grid, ("reached",), **make.options_of(options), store=place)


def blocks_of(work: Work, shape: Index) -> list[Index]:
    """Numbers of all blocks."""
    return [
        tuple(map(int, each))
        for each in np.ndindex(*(-(-n // m) for n, m in zip(shape, work.chunks, strict=True)))
    ]


def whole(work: Work, grid: maps.Grid | maps.Rings) -> dict[str, Array]:
    """All values of a map, block after block in this process, without Dask and without a store."""
    made: dict[str, Array] = {}
    for index in blocks_of(work, grid.shape):
        for name, values in compute(work, index).items():
            made.setdefault(name, np.empty(grid.shape, values.dtype))[work.part(index)] = values
    return made
