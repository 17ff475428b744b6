"""What Dask adds to the work, and what a second worker is worth, beside bare processes that do the same blocks."""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kinseek
from benchmarks.page import Page
from kinseek import maps
from kinseek.maps import make
from kinseek.maps.block import Work, compute, do

from .cells import Index, grid_around, section, work_of


class Took(NamedTuple):
    """What all blocks of a map took."""

    wall: float
    """[s]"""
    cpu: float
    """Of all processes that had a part in it [s]."""


def blocks_by_hand(work: Work, todo: list[Index], barrier: Any, told: Any) -> None:
    """What a bare process does: wait until all are ready, do the blocks, and tell when it began and ended, and CPU time."""
    compute(work, todo[0])  # Builds the atlas.
    barrier.wait()
    began, cpu = time.time(), time.process_time()
    for index in todo:
        do(work, index)
    told.put((began, time.time(), time.process_time() - cpu))


def bare(arm: kinseek.Arm, grid: maps.Grid, folder: Path, processes: int) -> Took:
    """A map by processes without Dask, each with its share of the blocks, to a store."""
    work = work_of(arm, grid, folder / "bare.zarr")
    todo = make.store_of(arm, grid, work).missing()
    spawn = multiprocessing.get_context("spawn")
    barrier, told = spawn.Barrier(processes), spawn.Queue()
    shares = [todo[k::processes] for k in range(processes)]
    running = [spawn.Process(target=blocks_by_hand, args=(work, share, barrier, told)) for share in shares]
    for process in running:
        process.start()
    rows = np.array([told.get() for _ in running])
    for process in running:
        process.join()
    return Took(float(rows[:, 1].max() - rows[:, 0].min()), float(rows[:, 2].sum()))


@contextmanager
def cluster(arm: kinseek.Arm, grid: maps.Grid, count: int) -> Iterator[Any]:
    """A client of so many workers, each a process that has the arm's atlas already."""
    import distributed
    from distributed.deploy.subprocess import SubprocessCluster

    options: dict[str, Any] = {"n_workers": count, "threads_per_worker": 1, "dashboard_address": ":0"}
    connect: Any = distributed.Client
    with SubprocessCluster(**options) as some, connect(some) as client:
        client.wait_for_workers(count)
        client.run(compute, work_of(arm, grid), (0,) * len(grid.shape))
        yield client


def through_dask(arm: kinseek.Arm, grid: maps.Grid, folder: Path, client: Any) -> Took:
    """The same map by `maps.reach` and the workers of a client, to a store."""

    def cpu() -> float:
        workers = sum(client.run(time.process_time).values())
        return float(workers + client.run_on_scheduler(time.process_time) + time.process_time())

    before, began = cpu(), time.perf_counter()
    maps.reach(arm, grid, client=client, store=folder / "dask.zarr")
    wall = time.perf_counter() - began
    return Took(wall, cpu() - before)


def measure(page: Page, rounds: int, width: float) -> None:
    """Write the section: everything in turns, round after round; the least of each counts."""
    arm = kinseek.load("ur5e")
    grid, took = grid_around(arm, width), dict[str, list[Took]]()
    names = {1: "one", 2: "two"}
    with section(page, "Dask, and a second worker"):
        for _ in range(rounds):
            for count, name in names.items():
                with tempfile.TemporaryDirectory() as folder:
                    took.setdefault(f"{name} bare", []).append(bare(arm, grid, Path(folder), count))
                with tempfile.TemporaryDirectory() as folder, cluster(arm, grid, count) as client:
                    took.setdefault(f"{name} of Dask", []).append(
                        through_dask(arm, grid, Path(folder), client)
                    )
        wall = {name: min(each.wall for each in some) for name, some in took.items()}
        cpu = {name: min(each.cpu for each in some) for name, some in took.items()}
        blocks = int(np.prod([-(-n // m) for n, m in zip(grid.shape, grid.chunks(), strict=True)]))
        page.say(
            f"{grid.size:,} poses of the UR5e, {blocks} blocks of the default size, written to a store by processes of",
            f"one thread that have their atlas. Bare: the same blocks in a loop, without Dask. Least of {rounds}",
            f"round{'s' * (rounds > 1)}. CPU time is that of all processes, with Dask those of scheduler and client",
            "too. Two bare processes say what a second core of this machine is worth.",
        )
        page.table(
            "processes | >wall time, s | >CPU time, s | >times as fast as one | >more wall time than bare | "
            ">more CPU time than bare",
            [
                [
                    name,
                    f"{wall[name]:.2f}",
                    f"{cpu[name]:.2f}",
                    f"{wall['one' + name[3:]] / wall[name]:.2f}",
                    f"{wall[name] / wall[name[:3] + ' bare'] - 1:+.0%}",
                    f"{cpu[name] / cpu[name[:3] + ' bare'] - 1:+.0%}",
                ]
                for name in took
            ],
        )
