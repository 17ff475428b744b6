"""Run work in a thread of its own, where no signal handler interrupts it, while the caller waits and can receive Ctrl-C.

Handlers run in the main thread, between any two of its bytecode steps. Python's own conditions, futures and pools run such
steps while they wait: Ctrl-C in the middle of one releases a lock twice, and raises a RuntimeError instead of the
KeyboardInterrupt. So the main thread starts a thread and waits for it by calls into C only, which a handler ends cleanly.

A single call of NumPy or of a kernel is not interrupted. So long arrays are processed in chunks, and a handler runs between
two of them.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

R = TypeVar("R")
Kind = TypeVar("Kind", bound=np.generic)

CHUNK = 2**14
"""Rows that one call of NumPy or of a kernel processes: some tens of milliseconds if a row takes microseconds."""

OFTEN = 0.1
"""Polling interval of a waiting thread [s]: a signal that arrives just before the thread sleeps does not wake it."""


def chunks(count: int, size: int | None = None) -> Iterator[slice]:
    """Yield slices that divide rows into chunks of at most `size`, by default `CHUNK`; of no rows, one empty slice."""
    step = size or CHUNK
    for first in range(0, max(count, 1), step):
        yield slice(first, min(first + step, count))


def in_chunks(work: Callable[..., NDArray[Kind]], *rows: NDArray[Any]) -> NDArray[Kind]:
    """Apply a function that treats rows independently, in chunks, so that Ctrl-C takes effect soon for any number of rows.

    Args:
        work: Takes as many arrays of k rows, and returns an array of k rows, (k, ...).
        rows: Arrays of the same number of rows, (k, ...) each.
    """
    count = len(rows[0])
    if count <= CHUNK:
        return work(*rows)
    some = work(*(each[:CHUNK] for each in rows))
    result = np.empty((count, *some.shape[1:]), dtype=some.dtype)
    result[:CHUNK] = some
    for part in chunks(count - CHUNK):
        there = slice(part.start + CHUNK, part.stop + CHUNK)
        result[there] = work(*(each[there] for each in rows))
    return result


def next_item(queue: SimpleQueue[R]) -> R:
    """Wait for the next item that another thread puts into the queue."""
    while True:
        with suppress(Empty):
            return queue.get(timeout=OFTEN)


class SignalSafeThread(Generic[R]):
    """A function to be run in a thread of its own."""

    def __init__(
        self, work: Callable[[], R], ended: Callable[[], object] = lambda: None, joined: bool = False
    ) -> None:
        """Prepare the thread; `begin` starts it.

        Args:
            work: The function to run.
            ended: Called in the thread at the end.
            joined: Python waits for the thread before it exits. Starting it then takes several times as long.
        """
        self._work, self._on_end, self._joined = work, ended, joined
        self._ended, self._results, self._errors = SimpleQueue[None](), list[R](), list[BaseException]()
        self._begun = self._done = False

    def begin(self) -> None:
        """Start the thread."""
        # Not Thread.start, which waits in Python until the thread runs: a handler could interrupt it there.
        _thread.start_new_thread(self._run_joined if self._joined else self._run, ())
        self._begun = True

    def _run_joined(self) -> None:
        """Start in a `Thread`, which Python joins at exit. Starting one waits in Python, so a thread does it, too."""
        try:
            threading.Thread(target=self._run, name="kinseek").start()
        except BaseException as error:  # There may be no more threads; the waiting caller must get the error.
            self._errors.append(error)
            self._end()

    def _run(self) -> None:
        try:
            self._results.append(self._work())
        except BaseException as error:
            self._errors.append(error)
        finally:
            self._end()

    def _end(self) -> None:
        self._done = True
        self._ended.put(None)
        self._on_end()

    def wait(self) -> None:
        """Wait for the end. If Ctrl-C interrupts the wait, call it again."""
        # An interrupted wait may already have taken the item from the queue, so the flag decides.
        if self._begun and not self._done:
            next_item(self._ended)

    def outcome(self) -> R:
        """Return the result, or raise the error of the work; call it after the end."""
        for error in self._errors:
            raise error
        return self._results[0]


def uninterrupted(work: Callable[[], R], stop: Callable[[], object] | None = None) -> R:
    """Run some work where no signal handler interrupts it.

    Args:
        work: The function to run.
        stop: Called if a signal handler raises, as after Ctrl-C, to make the work end; then its end is awaited. None
            abandons the work.
    """
    if threading.get_ident() != threading.main_thread().ident:
        return work()
    thread = SignalSafeThread(work, joined=stop is None)
    try:
        thread.begin()
        thread.wait()
    except BaseException:  # Raised by a signal handler: the work itself raises nothing here.
        if stop is not None:
            stop()
            thread.wait()
        raise
    return thread.outcome()


def raise_of_handler(error: BaseException) -> None:
    """Raise what a signal handler raised, if that caused an error.

    Code that reports the errors of other code, such as a user's function or a parser, calls this first. A handler may raise
    in the middle of that code, for example a TimeoutError, and its exception is meant for the caller of kinseek.
    """
    # The traceback of an exception that a handler raised contains the frame of the handler.
    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    functions: list[Any] = [getattr(handler, "func", handler) for handler in handlers if callable(handler)]
    codes = {
        getattr(each, "__code__", None) or getattr(type(each).__call__, "__code__", None)
        for each in functions
    }
    cause: BaseException | None = error
    while cause is not None:  # Not its context, which may be an error of the caller that is being handled.
        step = cause.__traceback__
        while step is not None:
            if step.tb_frame.f_code in codes:
                raise cause
            step = step.tb_next
        cause = cause.__cause__
