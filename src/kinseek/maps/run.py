"""Distribution of blocks to the workers of a Dask cluster, or to processes of this machine."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from kinseek.errors import InvalidMap, MapInterrupted
from kinseek.solvers.threads import progress_bar
from kinseek.support.workers import WorkerDied

from .block import Index, Work, compute, do
from .processes import compute_all

if TYPE_CHECKING:
    from distributed import Client

Written = Callable[[Index, Mapping[str, Any]], None]

QUEUED = 4
"""Number of tasks submitted ahead for each thread of the cluster, enough that no thread waits for the client."""

ENOUGH, MOST = 1.0, 16
"""Minimum duration of a task [s], and maximum number of its blocks. The overhead of Dask is some twenty milliseconds per
task, a fifth of the time of a fast block.
"""


def run(
    work: Work, todo: Sequence[Index], blocks: int, client: Client | None, progress: bool, written: Written
) -> None:
    """Compute some blocks.

    Args:
        work: The work that the blocks belong to.
        todo: Their indices.
        blocks: Total number of blocks, for messages.
        client: Client of a cluster; None starts a process for each core, or none if there is only one block.
        progress: Show a progress bar.
        written: Called with the values of a block if the work has no store.

    Raises:
        InvalidMap: A worker has another version of kinseek or none, or does not see the store.
        MapInterrupted: The scheduler is gone, several workers ended in a row, or the disk is full.
    """
    if not todo:
        return
    with progress_bar(progress, len(todo)) as advance:
        if client is not None:
            _require_same(client, work)
            _distribute(work, list(todo), blocks, client, advance, written)
        elif len(todo) == 1:
            _in_this_process(work, todo[0], blocks - 1, blocks, written)
            advance(1)
        else:
            _in_processes(work, todo, blocks, advance, written)


def _in_this_process(work: Work, index: Index, before: int, blocks: int, written: Written) -> None:
    if work.store is None:
        written(index, compute(work, index))
        return
    try:
        do(work, index)
    except OSError as error:
        raise _interrupted(f"a block cannot be written: {error}", before, blocks) from error


def _in_processes(
    work: Work, todo: Sequence[Index], blocks: int, advance: Callable[[int], object], written: Written
) -> None:
    done = blocks - len(todo)

    def take(index: Index, values: Any) -> None:
        nonlocal done
        if values is not None:
            written(index, values)
        done += 1
        advance(1)

    try:
        compute_all(work, todo, take)
    except WorkerDied as error:
        raise _interrupted(str(error), done, blocks) from error
    except OSError as error:
        raise _interrupted(f"a block cannot be written: {error}", done, blocks) from error


def _require_same(client: Client, work: Work) -> None:
    """Check that all workers compute the same bits as this process.

    Raises:
        InvalidMap: A worker does not, or has no kinseek; the message names it.
    """

    def worker_version() -> str:
        # A nested function is sent as it is; a function of a module would need that module on the worker.
        try:
            from kinseek.maps.block import version
        except ImportError as error:
            return f"none ({error})"
        return version()

    if client.status != "running":
        raise InvalidMap(f"the client is {client.status}; give one that is connected to its scheduler")
    others = {at: it for at, it in client.run(worker_version).items() if it != work.version}
    if others:
        report = ", ".join(f"{at} has {it}" for at, it in others.items())
        raise InvalidMap(
            f"this map is made with kinseek {work.version}, and not all workers have this version: {report}; install "
            "it there"
        )


def _distribute(
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
    before, done, disconnected = blocks - len(todo), 0, False
    left, futures = deque(todo), set[Any]()
    threads = max(sum(client.nthreads().values()), 1)

    def submit() -> Any:
        """Submit half an even share of the remaining blocks: fewer and fewer, so that all threads end together."""
        # Few large tasks have little overhead, many small ones end together: the size shrinks with what is left.
        some = [left.popleft() for _ in range(min(MOST, -(-len(left) // (2 * threads))))]
        futures.add(future := client.submit(_in_turn, work, some, pure=False))
        return future

    try:
        running = as_completed()
        while left and len(futures) < QUEUED * threads:
            running.add(submit())
        for future in running:
            # An error is returned and not raised by the task, see `_in_turn`.
            made, rest, error = future.result()
            futures.remove(future)
            for index, values in made:
                if values is not None:
                    written(index, values)
            done += len(made)
            advance(len(made))
            if error is not None:
                raise error
            # Blocks that a task did not get to come first again, in their order.
            left.extendleft(reversed(rest))
            while left and len(futures) < QUEUED * threads:
                running.add(submit())
    except KilledWorker as error:
        raise _interrupted(
            f"a block ended several workers, perhaps because memory ran out: {error}", before + done, blocks
        ) from error
    except (CancelledError, CommClosedError, ConnectionError, TimeoutError) as error:
        disconnected = True
        raise _interrupted(
            "the connection to the scheduler or the client was lost", before + done, blocks
        ) from error
    except OSError as error:
        raise _interrupted(f"a block cannot be written: {error}", before + done, blocks) from error
    finally:
        if futures and not disconnected:  # Others may use the cluster: leave no tasks on it.
            client.cancel(list(futures))


def _in_turn(work: Work, some: list[Index]) -> tuple[list[tuple[Index, Any]], list[Index], OSError | None]:
    """Compute blocks until `ENOUGH` seconds are over.

    Returns:
        The finished blocks, with their values if there is no store; the others; and the error of a full disk. If it were
        raised here, each worker's log would fill the terminal.
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
