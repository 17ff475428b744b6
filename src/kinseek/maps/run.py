"""Blocks handed out by Dask: to the workers of a cluster, or to processes of this machine."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
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
"""Blocks for each thread of the cluster that are handed out before any is done: enough that none waits for the client."""


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
        _told_to_all("DASK_LOGGING__DISTRIBUTED", "error"),
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
def _told_to_all(name: str, value: str) -> Iterator[None]:
    """A variable of the environment, which processes that are started hand on; one that is there already stays as it is."""
    here = name in os.environ
    os.environ.setdefault(name, value)
    try:
        yield
    finally:
        if not here:
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
    before, left, futures = blocks - len(todo), iter(todo), dict[Index, Any]()
    done, gone = 0, False

    def submit(index: Index) -> Any:
        futures[index] = client.submit(_numbered, work, index, pure=False)
        return futures[index]

    ahead = AHEAD * max(sum(client.nthreads().values()), 1)
    try:
        running = as_completed([submit(index) for index in islice(left, ahead)])
        for future in running:
            index, values = future.result()
            del futures[index]
            if isinstance(values, OSError):
                raise values
            if values is not None:
                written(index, values)
            done += 1
            advance(1)
            for following in islice(left, 1):
                running.add(submit(following))
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
            client.cancel(list(futures.values()))


def _numbered(work: Work, index: Index) -> tuple[Index, Any]:
    """Do a block, and say which it was; a disk that is full comes back as what came of it."""
    try:
        return index, do(work, index)
    except OSError as error:  # Raised there, it would fill the terminal with pages from each worker's log.
        return index, error


def _interrupted(why: str, done: int, blocks: int) -> MapInterrupted:
    return MapInterrupted(
        f"{why}; {done} of {blocks} blocks are done. What is in a store stays there, and the same call goes on with it",
        done,
        blocks,
    )
