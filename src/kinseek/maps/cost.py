"""Estimate of the cost of a map, from computing a sample of its cells."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidMap
from kinseek.support.validation import as_integer, as_number
from kinseek.support.workers import Worker

from .block import BlockScratch, answered
from .cells import SHARES
from .grid import Grid, Rings
from .make import options_of, require_extra, work_of
from .measures import MEASURES, REACHED

Array = NDArray[np.float64]

_ROW = 64
"""Maximum number of cells computed at a time with proofs: neighbours, as in a block. Without proofs the least number, at
random."""

_MANY = 4096
"""Maximum number of cells computed at a time without proofs; so many that the overhead of a call is small."""

_PIECES = 8
"""Least number of times, if they take no longer than `_OVERTIME`; otherwise two."""

_OVERTIME = 4.0
"""Time that an estimate may take beyond the given one, relative to that: one proof in a deep map takes seconds."""


@dataclass(frozen=True)
class Estimate:
    """The estimated cost of a map."""

    cells: int
    seconds: float
    """Time per cell on one core, the mean of the sample [s]."""
    error: float
    """Two standard errors of that mean, relative to it."""
    tried: int
    """Number of cells in the sample."""
    cores: int
    """Number of cores that work at once."""
    start: float
    """Time until they do [s]: processes are started, and each builds the arm's atlas."""
    memory: int
    """Size of all values before compression [bytes]; a store takes much less."""

    @property
    def core_hours(self) -> float:
        """Core hours in total."""
        return self.cells * self.seconds / 3600

    @property
    def duration(self) -> float:
        """Duration if all cores are free, including the start [s]."""
        return self.start + self.cells * self.seconds / self.cores

    def __str__(self) -> str:
        """A one-sentence summary."""
        cores = f"{self.cores} core{'s' * (self.cores > 1)}"
        each = f"{self.seconds * 1e6:.3g} µs" if self.seconds < 1e-3 else f"{self.seconds * 1e3:.3g} ms"
        return (
            f"{self.cells:,} cells at {each} ±{self.error:.0%} ({self.tried} tried): about "
            f"{_time(self.duration)} on {cores}, {_time(self.start)} of it to start; "
            f"{_size(self.memory)} before compression"
        )


def estimate(
    arm: Arm,
    grid: Grid | Rings,
    what: Sequence[str] = (REACHED,),
    *,
    seconds: float = 1.0,
    cores: int | None = None,
    **options: Any,
) -> Estimate:
    """Estimate the cost of a map by computing random cells of it on one core of this machine.

    Args:
        arm: As in `reach`.
        grid: As in `reach`.
        what: As in `reach`.
        seconds: Duration of the sample.
        cores: Number of cores of an existing cluster; by default processes are started on those of this machine, and one
            such start is measured.
        options: The options of `reach` that define the result: ``prove``, ``depth``, ``budget``, ``patience``, ``scene``,
            ``clearance`` and tolerances.

    Raises:
        InvalidMap: As `reach`, or `seconds` is no duration.
        MissingExtra: Processes would be started, and a required package is not installed.
    """
    if cores is not None:
        cores = as_integer("cores", cores, 1, error=InvalidMap)
    seconds = as_number("seconds", seconds, 0.0, 1e9, InvalidMap)
    work = work_of(arm, grid, what, **options_of(options), store=None)
    scratch, rng, cost = BlockScratch(work), np.random.default_rng(0), list[float]()
    number = 1 if work.prove else _ROW

    def some() -> tuple[Array, tuple[slice, ...]]:
        if not work.prove:  # Their positions do not matter then.
            return grid.middles(rng.integers(grid.shape, size=(number, len(grid.shape)))), ()
        place = [int(rng.integers(n)) for n in grid.shape[:-1]]
        first = int(rng.integers(grid.shape[-1] - number + 1))
        part = (*(slice(i, i + 1) for i in place), slice(first, first + number))
        return grid.poses(part), part

    began = time.perf_counter()
    answered(work, scratch, *some())  # Builds the atlas.
    start = time.perf_counter() - began
    if cores is None and math.prod(-(-n // m) for n, m in zip(grid.shape, work.chunks, strict=True)) > 1:
        start += _processes()
    until = time.perf_counter() + seconds
    began = time.perf_counter()
    answered(work, scratch, *some())
    each_cell = (time.perf_counter() - began) / number
    least, most = (1, min(_ROW, grid.shape[-1])) if work.prove else (_ROW, _MANY)
    number = int(np.clip(seconds / _PIECES / each_cell, least, most))
    latest = until + _OVERTIME * seconds
    # Two are needed for an estimate of its error.
    while (now := time.perf_counter()) < until or len(cost) < (_PIECES if now < latest else 2):
        poses, part = some()
        began = time.perf_counter()
        answered(work, scratch, poses, part)
        cost.append((time.perf_counter() - began) / number)
    mean = float(np.mean(cost))
    each = sum(np.dtype(MEASURES[name].dtype).itemsize for name in work.what)
    each += 1 + 4 * len(SHARES) if work.prove else 0
    each += 16 if isinstance(grid, Rings) else 0
    return Estimate(
        cells=grid.size,
        seconds=mean,
        error=2 * float(np.std(cost)) / np.sqrt(len(cost)) / mean,
        tried=len(cost) * number,
        cores=cores or os.cpu_count() or 1,
        start=start,
        memory=grid.size * each,
    )


@lru_cache(maxsize=1)
def _processes() -> float:
    """Return the time to start a process of `processes.compute_all` [s]; each core starts one."""
    require_extra()
    began = time.perf_counter()
    with Worker() as worker:
        worker.begin()
    return time.perf_counter() - began


def _time(seconds: float) -> str:
    for unit, length in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.2g} s"


def _size(count: int) -> str:
    for unit, length in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= length:
            return f"{count / length:.3g} {unit}"
    return f"{count} bytes"
