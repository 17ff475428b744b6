"""Long paths: time and memory for each pose, in one call and as a stream.

The paths are the random smooth curves of joint values of `benchmarks.paths`; more poses sample a curve more finely. Times
are wall times of one thread, measured without tracing of memory. Memory is the maximum that Python and NumPy hold. For one
call it is the difference between all poses and half of them, for each pose; for a stream it is the total.

    python -m benchmarks.long_paths                 # writes benchmarks/long_paths.md
    python -m benchmarks.long_paths --quick         # few poses, printed and not written
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek

from .command import command, writes
from .page import Page
from .paths import curve

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

ARMS = ("irb120", "ur5e", "panda")
BATCH = 1000
"""Poses that a stream makes at a time."""


@dataclass(frozen=True)
class Row:
    """One way to follow, on one arm."""

    arm: str
    how: str
    poses: int
    broken: int
    cost: float
    """[µs] a pose"""
    memory: float
    """[bytes] a pose; of a stream [MB] in all"""


def whole(arm: kinseek.Arm, poses: int) -> Row:
    """Follow poses that are all there."""
    T = arm.fk(curve(arm, poses, 0))
    began = time.perf_counter()
    path = arm.follow(T, threads=1)
    cost = (time.perf_counter() - began) / poses * 1e6
    peaks = []
    for count in (poses // 2, poses):
        T = arm.fk(curve(arm, count, 0))
        tracemalloc.start()
        arm.follow(T, threads=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    return Row(
        arm.name, "at once", poses, len(path.breaks), cost, (peaks[1] - peaks[0]) / (poses - poses // 2)
    )


def poses_of(arm: kinseek.Arm, count: int) -> Iterator[Array]:
    """A curve of so many poses, made as they are taken."""
    coarse, at = curve(arm, 1000, 0), np.linspace(0, 999, count)
    for first in range(0, count, BATCH):
        some = at[first : first + BATCH]
        q = np.stack([np.interp(some, np.arange(1000), column) for column in coarse.T], axis=1)
        yield from arm.fk(q)


def stream(arm: kinseek.Arm, poses: int) -> Row:
    """Follow poses that come one after the other."""
    began, broken = time.perf_counter(), 0
    for piece in arm.follow_stream(poses_of(arm, poses), threads=1):
        broken += len(piece.breaks)
    cost = (time.perf_counter() - began) / poses * 1e6
    tracemalloc.start()
    for _ in arm.follow_stream(poses_of(arm, min(poses, 20_000)), threads=1):
        pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return Row(arm.name, "a stream", poses, broken, cost, peak / 1e6)


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--quick", action="store_true", help="few poses; nothing is written")
    writes(parser, "--output", HERE / "long_paths.md", "page to write")
    options = parser.parse_args()
    share = 10 if options.quick else 1
    rows: list[Row] = []
    for name in ARMS:
        arm = kinseek.load(name)
        arm.follow(arm.fk(curve(arm, 40, 1)), threads=1)  # What the arm needs once.
        spare = arm.dof > 6
        rows.append(whole(arm, (20_000 if spare else 100_000) // share))
        print(rows[-1], flush=True)
        rows.append(stream(arm, (100_000 if spare else 1_000_000) // share // share))
        print(rows[-1], flush=True)
    if options.quick:
        return
    page = Page("Long paths", "benchmarks.long_paths")
    page.say(
        "`arm.follow` at once, and `arm.follow_stream` of poses that an iterator makes. Of a stream, memory",
        "is what it takes in all; of `follow` what a pose adds, beside the poses themselves.",
    )
    page.table(
        "arm | how | >poses | >breaks | >µs a pose | >memory",
        [
            (
                row.arm,
                row.how,
                f"{row.poses:,}",
                row.broken,
                f"{row.cost:.0f}",
                f"{row.memory:.0f} MB in all" if row.how == "a stream" else f"{row.memory:.0f} bytes a pose",
            )
            for row in rows
        ],
    )
    page.write(options.output)


if __name__ == "__main__":
    main()
