"""Distribute the targets of a batch to threads; after Ctrl-C, or when the time is up, no further piece is started."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from typing import TypeVar

from kinseek.errors import MissingExtra
from kinseek.support.deadline import Deadline
from kinseek.support.interrupts import SignalSafeThread, next_item

T = TypeVar("T")
R = TypeVar("R")

GoOn = Callable[[], bool]
"""Function that returns whether another piece of work may be started."""


def parallel_for(
    work: Callable[[int, int, GoOn], None],
    count: int,
    chunk: int,
    threads: int | None,
    deadline: Deadline,
    advance: Callable[[int], object] = lambda targets: None,
) -> None:
    """Process all targets in chunks that threads take one after the other.

    Args:
        work: Called as ``work(first, last, go_on)`` with the first target, one past the last, and a function. It has to call
            `go_on()` about every 10 ms and stop on False. Only the waiting thread receives Ctrl-C, so this bounds its
            latency.
        count: Number of targets.
        chunk: Targets that a thread takes at a time.
        threads: Number of threads; None uses every core.
        deadline: No further piece is started after it.
        advance: Called with the number of targets that were completed since the last call.
    """
    chunks = range(0, count, chunk)
    workers = min(threads or os.cpu_count() or 1, len(chunks))
    if workers <= 1:
        for begin in chunks:
            if deadline.passed:
                return
            end = min(begin + chunk, count)
            work(begin, end, lambda: not deadline.passed)
            advance(end - begin)
        return
    # All threads share one iterator: `next` of a range is a single step under the GIL, so each chunk is taken once.
    left, finished, stopped = iter(chunks), SimpleQueue[int](), threading.Event()

    def go_on() -> bool:
        return not (stopped.is_set() or deadline.passed)

    def drain() -> None:
        for begin in left:  # Each thread takes the next free chunk.
            if not go_on():
                return
            end = min(begin + chunk, count)
            work(begin, end, go_on)
            finished.put(end - begin)

    crew = [SignalSafeThread(drain, lambda: finished.put(0)) for _ in range(workers)]
    try:
        for each in crew:
            each.begin()
        # A thread puts 0 at its end; a chunk is never empty.
        ended = 0
        while ended < workers:
            targets = next_item(finished)
            ended += targets == 0
            advance(targets)
    finally:
        # The threads write into arrays of the caller, so none may outlive this call, not even after Ctrl-C.
        stopped.set()
        for each in crew:
            each.wait()
    for each in crew:
        each.outcome()


def in_threads(work: Callable[[T], R], items: Sequence[T], threads: int | None) -> list[R]:
    """Return the results of `work` for all items, in their order; threads take one item after the other.

    Args:
        work: Takes an item; its exceptions are raised here.
        items: All items.
        threads: Number of threads; None uses every core.
    """
    left, results = iter(range(len(items))), dict[int, R]()

    def drain() -> None:
        for i in left:  # Each thread takes the next free item.
            results[i] = work(items[i])

    crew = [SignalSafeThread(drain) for _ in range(min(threads or os.cpu_count() or 1, len(items)))]
    try:
        for each in crew:
            each.begin()
    finally:
        for each in crew:
            each.wait()
    for each in crew:
        each.outcome()
    return [results[i] for i in range(len(items))]


@contextmanager
def progress_bar(show_progress: bool, total: int) -> Iterator[Callable[[int], object]]:
    """Yield a function that is called with the number of targets that were completed since the last call."""
    if not show_progress:
        yield lambda count: None
        return
    try:
        from rich.console import Console
        from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn
    except ImportError:
        raise MissingExtra("A progress bar", "cli") from None
    columns = (*Progress.get_default_columns()[:-1], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("solving", total=total)
        yield lambda count: bar.advance(task, count)


class Watch:
    """Reports to a progress bar how far the search of each target is, one target after the other."""

    def __init__(self, advance: Callable[[int], object], whole: int) -> None:
        """Begin with the first target; `whole` is the most work of a target."""
        self._advance, self._whole, self._seen = advance, whole, 0

    def __call__(self, work: int) -> None:
        """Report the work that is done for this target."""
        work = min(work, self._whole)
        self._advance(work - self._seen)
        self._seen = work

    def end(self) -> None:
        """Report that this target is done, possibly with less work."""
        self(self._whole)
        self._seen = 0


def unwatched(work: int) -> None:
    """Ignore the reported work."""
