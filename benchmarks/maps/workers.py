"""What Dask adds to the work, and what a second worker is worth, beside bare processes that do the same blocks."""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

import kinseek
from benchmarks.page import Page, Row
from kinseek import maps
from kinseek.maps import make
from kinseek.maps.block import Work, compute, do
from kinseek.support.workers import MEMORY

from .cells import Index, blocks_of, grid_around, work_of

NAMES = {1: "one", 2: "two"}

CALM = MEMORY | {
    "DASK_LOGGING__DISTRIBUTED": "error",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "200ms",
}
"""Environment variables of all processes that are started here, as docs/maps.md recommends them for a cluster."""


class Took(NamedTuple):
    """What all blocks of a map took, with the making of the store and the opening of what is in it."""

    wall: float
    """[s]"""
    cpu: float
    """Of all processes that had a part in it [s]."""


def ready(work: Work, small: Work) -> None:
    """Build the atlas, and import what writes a block."""
    compute(work, (0,) * len(work.chunks))
    do(small, (0,) * len(small.chunks))


def blocks_by_hand(work: Work, small: Work, todo: list[Index], barrier: Any, told: Any) -> None:
    """What a bare process does: get ready, wait for the others and for the store, do the blocks, and tell its CPU time."""
    ready(work, small)
    barrier.wait()
    barrier.wait()
    cpu = time.process_time()
    for index in todo:
        do(work, index)
    told.put(time.process_time() - cpu)


def bare(arm: kinseek.Arm, grid: maps.Grid, work: Work, small: Work, processes: int) -> Took:
    """A map by processes without Dask, each with its share of the blocks, to a store."""
    todo, spawn = blocks_of(work, grid.shape), multiprocessing.get_context("spawn")
    barrier, told = spawn.Barrier(processes + 1), spawn.Queue()
    with calm():  # As Dask's processes have it: of memory alone a fifth of the time.
        running = [
            spawn.Process(target=blocks_by_hand, args=(work, small, todo[k::processes], barrier, told))
            for k in range(processes)
        ]
        for process in running:
            process.start()
    barrier.wait()
    began, cpu = time.perf_counter(), time.process_time()
    store = make.store_of(arm, grid, work)
    barrier.wait()
    theirs = sum(told.get() for _ in running)
    store.dataset()
    took = Took(time.perf_counter() - began, time.process_time() - cpu + theirs)
    for process in running:
        process.join()
    return took


def calm() -> Any:
    """Set the variables of `CALM` for processes that are started meanwhile; one that is set already stays as it is."""
    return patch.dict(os.environ, {name: value for name, value in CALM.items() if name not in os.environ})


@contextmanager
def cluster(work: Work, small: Work, count: int) -> Iterator[Any]:
    """A client of a cluster on this machine, of so many workers that are ready; the scheduler has had a task, too."""
    import distributed
    from dask import config
    from distributed.deploy.subprocess import SubprocessCluster

    connect: Any = distributed.Client
    with (
        config.set({"logging.distributed": "error"}),
        calm(),
        SubprocessCluster(n_workers=count, threads_per_worker=1, dashboard_address="127.0.0.1:0") as at,
        connect(at) as client,
    ):
        client.wait_for_workers(count)
        client.run(ready, work, small)
        client.submit(do, small, (0,) * len(small.chunks)).result()
        yield client


def through_dask(arm: kinseek.Arm, grid: maps.Grid, work: Work, small: Work, count: int) -> Took:
    """The same map by `maps.reach` and so many workers, to a store."""
    with cluster(work, small, count) as client:

        def cpu() -> float:
            workers = sum(client.run(time.process_time).values())
            nannies = sum(client.run(time.process_time, nanny=True).values())
            return float(workers + nannies + client.run_on_scheduler(time.process_time) + time.process_time())

        before, began = cpu(), time.perf_counter()
        maps.reach(arm, grid, client=client, store=work.store)
        wall = time.perf_counter() - began
        return Took(wall, cpu() - before)


def measure(page: Page, rounds: int, width: float) -> None:
    """Write the section: everything in turns, round after round; ratios are those of one round, and their median counts."""
    arm = kinseek.load("ur5e")
    grid, tiny = grid_around(arm, width), grid_around(arm, 0.5, 12)
    ways: dict[str, Callable[..., Took]] = {"bare": bare, "of Dask": through_dask}
    took: dict[str, list[Took]] = {f"{name} {way}": [] for name in NAMES.values() for way in ways}
    with page.section("Dask, and a second worker"):
        for _ in range(rounds):
            for count, name in NAMES.items():
                for way, made in ways.items():
                    with tempfile.TemporaryDirectory() as folder:
                        small = work_of(arm, tiny, Path(folder) / "small.zarr")
                        make.store_of(arm, tiny, small).dataset()
                        work = work_of(arm, grid, Path(folder) / "map.zarr")
                        took[f"{name} {way}"].append(made(arm, grid, work, small, count))
        page.say(
            f"{grid.size:,} poses of the UR5e, in {len(blocks_of(work, grid.shape))} blocks of the default size.",
            "Processes of one thread, which have built their atlas before, write them to a store. *Bare* processes",
            "compute the same blocks in a loop, without Dask; two of them show how much a second core of this machine",
            "adds. CPU time is that of all processes; with Dask it includes the scheduler, the nannies and the",
            f"client. The rows are measured alternately; the table has medians of {rounds} round{'s' * (rounds > 1)},",
            "and each ratio is computed within a round.",
        )
        page.rows(_row(name, took) for name in took)


def _row(name: str, took: dict[str, list[Took]]) -> Row:
    number, way = name.split(" ", 1)
    wall, cpu = np.array(took[name]).T
    one, (bare_wall, bare_cpu) = np.array(took[f"one {way}"])[:, 0], np.array(took[f"{number} bare"]).T
    return {
        "processes": name,
        ">wall time, s": f"{np.median(wall):.2f}",
        ">CPU time, s": f"{np.median(cpu):.2f}",
        ">times as fast as one": f"{np.median(one / wall):.2f}",
        ">more wall time than bare": f"{np.median(wall / bare_wall) - 1:+.0%}",
        ">more CPU time than bare": f"{np.median(cpu / bare_cpu) - 1:+.0%}",
    }
