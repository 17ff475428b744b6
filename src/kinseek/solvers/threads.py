"""Share the targets of a batch out to threads; after Ctrl-C, or when the time is up, nobody begins another piece."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from queue import SimpleQueue
from typing import TypeVar

from kinseek.deadline import Deadline
from kinseek.errors import MissingExtra
from kinseek.interrupts import SignalSafeThread, next_item

T = TypeVar("T")
R = TypeVar("R")

GoOn = Callable[[], bool]
"""May another piece of work be begun?"""


def parallel_for(
    work: Callable[[int, int, GoOn], None],
    count: int,
    chunk: int,
    threads: int | None,
    deadline: Deadline,
    advance: Callable[[int], object] = lambda targets: None,
) -> None:
    """Do some work for every target, in chunks that threads take one after the other.

    Args:
        work: Takes the first target, one past the last, and what it has to ask between pieces of some ten milliseconds:
            so long takes Ctrl-C, which only the thread that waits can hear.
        count: Number of targets.
        chunk: Targets that a thread takes at a time.
        threads: None takes every core.
        deadline: After it no further piece is begun.
        advance: Told how many more targets are done.
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
    left, finished, stopped = iter(chunks), SimpleQueue[int](), threading.Event()

    def go_on() -> bool:
        return not (stopped.is_set() or deadline.passed)

    def drain() -> None:
        for begin in left:  # Each thread takes the next chunk that nobody has.
            if not go_on():
                return
            end = min(begin + chunk, count)
            work(begin, end, go_on)
            finished.put(end - begin)

    crew = [SignalSafeThread(drain, lambda: finished.put(0)) for _ in range(workers)]
    try:
        for each in crew:
            each.begin()
        ended = 0
        while ended < workers:
            targets = next_item(finished)
            ended += targets == 0
            advance(targets)
    finally:
        stopped.set()
        for each in crew:
            each.wait()
    for each in crew:
        each.outcome()


def in_threads(work: Callable[[T], R], items: Sequence[T], threads: int | None) -> list[R]:
    """Return what some work gives for each item, in the order of the items; threads take one item after the other.

    Args:
        work: Takes an item; what it raises is raised here.
        items: All items.
        threads: None takes every core.
    """
    left, results = iter(range(len(items))), dict[int, R]()

    def drain() -> None:
        for i in left:  # Each thread takes the next item that nobody has.
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
def progress_bar(wanted: bool, total: int) -> Iterator[Callable[[int], object]]:
    """Give a function that is told how many more targets are done."""
    if not wanted:
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
    """Tells a progress bar how far the search of each target is, one target after the other."""

    def __init__(self, advance: Callable[[int], object], whole: int) -> None:
        """Begin with the first target; `whole` is what a target takes at most."""
        self._advance, self._whole, self._seen = advance, whole, 0

    def __call__(self, work: int) -> None:
        """So much is done for this target."""
        work = min(work, self._whole)
        self._advance(work - self._seen)
        self._seen = work

    def end(self) -> None:
        """This target is done, with less work perhaps."""
        self(self._whole)
        self._seen = 0


def unwatched(work: int) -> None:
    """Watch nothing."""
