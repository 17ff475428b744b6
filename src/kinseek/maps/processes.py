"""Blocks of a map, computed by processes of this machine."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from queue import SimpleQueue
from typing import Any

from kinseek.support.interrupts import SignalSafeThread, next_item
from kinseek.support.workers import Worker, WorkerDied

from .block import Index, Work, do

ATTEMPTS = 3
"""Number of processes that may end in a row before the map is interrupted."""


def compute_all(work: Work, todo: Sequence[Index], done: Callable[[Index, Any], object]) -> None:
    """Compute blocks, in a process for each core.

    Args:
        work: The work that the blocks belong to.
        todo: Their indices.
        done: Called in this thread with the index of each computed block and the result of `do`.

    Raises:
        WorkerDied: Several processes ended in a row, or none can be started.
        OSError: A block cannot be written.
        InvalidMap: As `do`.
    """
    left, results, stopped = deque(todo), SimpleQueue[tuple[Index, Any] | BaseException](), threading.Event()
    started = list[Worker]()

    def next_block() -> Index | None:
        try:
            return left.popleft()
        except IndexError:
            return None

    def drain() -> None:
        try:
            index, deaths = next_block(), 0
            while index is not None and not stopped.is_set():
                try:
                    with Worker() as worker:
                        started.append(worker)
                        worker.begin(partial(do, work))
                        while index is not None and not stopped.is_set():
                            when = f"at block {index}, perhaps because memory ran out"
                            results.put((index, worker.compute(index, when)))
                            index, deaths = next_block(), 0
                # The block is computed again by a new process: the old one may have ended for a reason outside of it.
                except WorkerDied as error:
                    deaths += 1
                    if deaths == ATTEMPTS:
                        raise WorkerDied(f"{ATTEMPTS} processes ended in turn, the last {error}") from error
        except BaseException as error:
            results.put(error)

    crew = [SignalSafeThread(drain) for _ in range(min(os.cpu_count() or 1, len(todo)))]
    try:
        for each in crew:
            each.begin()
        for _ in todo:
            result = next_item(results)
            if isinstance(result, BaseException):
                raise result
            done(*result)
    finally:
        stopped.set()
        # The threads wait for results; they end when the pipes of the processes do.
        for worker in list(started):
            worker.kill()
        for each in crew:
            each.wait()
