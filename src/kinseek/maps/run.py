"""Blocks handed out by Dask: to the workers of a cluster, or to processes of this machine."""

from __future__ import annotations

import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from kinseek.errors import InvalidMap, MapInterrupted
from kinseek.solvers.threads import progress_bar

from .block import Work, compute, do

if TYPE_CHECKING:
    from distributed import Client

Index = tuple[int, ...]
Written = Callable[[Index, Mapping[str, Any]], None]

AHEAD = 4
"""Tasks for each thread of the cluster that are handed out before any is done: enough that none waits for the client."""

ENOUGH, MOST = 1.0, 16
"""A task takes blocks until so many seconds are over, and so many blocks at most: Dask takes some twenty milliseconds for
it, a fifth of what a block may take."""

CALM = {
    "DASK_LOGGING__DISTRIBUTED": "error",
    "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
    "DASK_DISTRIBUTED__ADMIN__TICK__INTERVAL": "200ms",
    "MALLOC_TRIM_THRESHOLD_": str(64 << 20),
    "MALLOC_MMAP_THRESHOLD_": str(32 << 20),
}
"""Variables of the environment of processes that are started here. Left to themselves they look a hundred times a second
where each thread stands, and give all memory back at once, which the system then has to clear for the next array."""


WATCH = """
import os, threading, time

def watch():
    try:
        while os.getppid() == {parent}:
            os.utime({place!r})
            time.sleep(0.2)
    finally:
        os._exit(1)

threading.Thread(target=watch, daemon=True).start()
"""
"""What a scheduler or a nanny runs first: it ends when the process that has started it does, even by ``kill -9``, and when
that folder is gone, so that Ctrl-C ends what nothing knows of yet. A worker ends with its nanny. To touch the folder keeps
it from those who clean up what is old."""


def run(
    work: Work, todo: Sequence[Index], blocks: int, client: Client | None, progress: bool, written: Written
) -> None:
    """Do some blocks.

    Args:
        work: What they are blocks of.
        todo: Their numbers.
        blocks: How many there are in all, for messages.
        client: Of a cluster; None starts a process for each core, or none where there is one block only.
        progress: Show a progress bar.
        written: Takes what comes back of a block where the work has no store.

    Raises:
        InvalidMap: A worker has another version of kinseek, or none, or does not see the store.
        MapInterrupted: The scheduler is gone, a block ended several workers, or the disk is full.
    """
    if not todo:
        return
    with progress_bar(progress, len(todo)) as advance:
        if client is None and len(todo) == 1:
            _here(work, todo[0], blocks - 1, blocks, written)
            advance(1)
            return
        with _local_client(len(todo)) if client is None else _given(client) as at:
            _require_same(at, work)
            _spread(work, list(todo), blocks, at, advance, written)


def _here(work: Work, index: Index, before: int, blocks: int, written: Written) -> None:
    if work.store is None:
        written(index, compute(work, index))
        return
    try:
        do(work, index)
    except OSError as error:
        raise _interrupted(f"a block cannot be written: {error}", before, blocks) from error


@contextmanager
def _given(client: Client) -> Iterator[Client]:
    yield client


@contextmanager
def _local_client(blocks: int) -> Iterator[Client]:
    """A client of processes on this machine, one a core, with one thread each.

    They are started as programs, so that a script needs no ``if __name__ == "__main__"``.
    """
    import distributed
    from dask import config

    connect: Any = distributed.Client
    options: dict[str, Any] = {"n_workers": min(os.cpu_count() or 1, blocks), "threads_per_worker": 1}
    options["dashboard_address"] = ":0"  # Any free port: another cluster may have the usual one.
    with (
        config.set({"logging.distributed": "error"}),
        _told_to_all(CALM),
        TemporaryDirectory(prefix="kinseek-") as place,
    ):
        if sys.platform == "win32":
            from distributed import LocalCluster as Cluster
        else:
            from distributed.deploy.subprocess import SubprocessCluster as Cluster

            watch = WATCH.format(parent=os.getpid(), place=place)
            options |= {"scheduler_kwargs": {"preload": [watch]}, "worker_kwargs": {"preload_nanny": [watch]}}
        with Cluster(**options) as cluster, connect(cluster) as client:
            yield client


@contextmanager
def _told_to_all(variables: Mapping[str, str]) -> Iterator[None]:
    """Variables of the environment, which processes that are started hand on; one that is there already stays as it is."""
    new = {name: value for name, value in variables.items() if name not in os.environ}
    os.environ.update(new)
    try:
        yield
    finally:
        for name in new:
            os.environ.pop(name, None)


def _require_same(client: Client, work: Work) -> None:
    """Refuse workers that would give other bits, or none.

    Raises:
        InvalidMap: There is one; the message names it.
    """

    def ask() -> str:
        # A function in a function travels as it is; one of a module would need that module there.
        try:
            from kinseek.maps.block import version
        except ImportError as error:
            return f"none ({error})"
        return version()

    if client.status != "running":
        raise InvalidMap(f"the client is {client.status}; give one that is connected to its scheduler")
    others = {at: it for at, it in client.run(ask).items() if it != work.version}
    if others:
        told = ", ".join(f"{at} has {it}" for at, it in others.items())
        raise InvalidMap(
            f"this map is made with kinseek {work.version}, and not all workers have it: {told}; install the same there"
        )


def _spread(
    work: Work,
    todo: list[Index],
    blocks: int,
    client: Any,
    advance: Callable[[int], object],
    written: Written,
) -> None:
    from concurrent.futures import CancelledError

    import distributed
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    as_completed: Any = distributed.as_completed
    before, done, gone = blocks - len(todo), 0, False
    left, futures = deque(todo), set[Any]()
    threads = max(sum(client.nthreads().values()), 1)

    def submit() -> Any:
        """Hand out half an even share of what is left: fewer and fewer blocks, so that all threads end together."""
        some = [left.popleft() for _ in range(min(MOST, -(-len(left) // (2 * threads))))]
        futures.add(future := client.submit(_in_turn, work, some, pure=False))
        return future

    try:
        running = as_completed()
        while left and len(futures) < AHEAD * threads:
            running.add(submit())
        for future in running:
            made, rest, error = future.result()
            futures.remove(future)
            for index, values in made:
                if values is not None:
                    written(index, values)
            done += len(made)
            advance(len(made))
            if error is not None:
                raise error
            left.extendleft(reversed(rest))
            while left and len(futures) < AHEAD * threads:
                running.add(submit())
    except KilledWorker as error:
        raise _interrupted(
            f"a block ended several workers, perhaps for want of memory: {error}", before + done, blocks
        ) from error
    except (CancelledError, CommClosedError, ConnectionError, TimeoutError) as error:
        gone = True
        raise _interrupted("the scheduler, or the client, is gone", before + done, blocks) from error
    except OSError as error:
        raise _interrupted(f"a block cannot be written: {error}", before + done, blocks) from error
    finally:
        if futures and not gone:  # The cluster may be somebody else's: leave it no work.
            client.cancel(list(futures))


def _in_turn(work: Work, some: list[Index]) -> tuple[list[tuple[Index, Any]], list[Index], OSError | None]:
    """Do blocks until that has taken long enough.

    Returns:
        Those that are done, with their values where there is no store; the others; and what came of a disk that is full:
        raised here, it would fill the terminal with pages from each worker's log.
    """
    until, made = time.monotonic() + ENOUGH, list[tuple[Index, Any]]()
    for index in some:
        try:
            made.append((index, do(work, index)))
        except OSError as error:
            return made, some[len(made) :], error
        if time.monotonic() > until:
            break
    return made, some[len(made) :], None


def _interrupted(why: str, done: int, blocks: int) -> MapInterrupted:
    return MapInterrupted(
        f"{why}; {done} of {blocks} blocks are done. What is in a store stays there, and the same call goes on with it",
        done,
        blocks,
    )
