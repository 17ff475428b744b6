"""Work that no signal handler may break into, in a thread of its own, while the caller waits where Ctrl-C is heard.

Handlers run in the main thread, between any two of its steps. Python's own conditions, futures and pools take steps in it
while they wait: Ctrl-C in the midst of one leaves a lock released twice, and a RuntimeError in the place of the
KeyboardInterrupt. So the main thread starts a thread and waits for it by calls into C only, which a handler ends cleanly.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

R = TypeVar("R")

OFTEN = 0.1
"""So often a thread that waits looks up [s]: a signal that comes just before it falls asleep does not wake it."""


def next_item(queue: SimpleQueue[R]) -> R:
    """Wait for the next thing that another thread puts there."""
    while True:
        with suppress(Empty):
            return queue.get(timeout=OFTEN)


class SignalSafeThread(Generic[R]):
    """Something to be done in a thread of its own."""

    def __init__(
        self, work: Callable[[], R], ended: Callable[[], object] = lambda: None, kept: bool = False
    ) -> None:
        """Begin nothing yet.

        Args:
            work: What to do.
            ended: Called there at the end.
            kept: Python waits for it before it ends itself. To begin takes several times as long.
        """
        self._work, self._on_end, self._kept = work, ended, kept
        self._ended, self._results, self._errors = SimpleQueue[None](), list[R](), list[BaseException]()
        self._begun = self._done = False

    def begin(self) -> None:
        """Begin."""
        _thread.start_new_thread(self._keep if self._kept else self._run, ())
        self._begun = True

    def _keep(self) -> None:
        """Begin in a `Thread`, which Python waits for: to start one is to wait in steps, so that is done aside, too."""
        try:
            threading.Thread(target=self._run, name="kinseek").start()
        except BaseException as error:  # There may be no more threads: who waits shall hear of it.
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
        """Wait for the end. After a wait that Ctrl-C broke off, wait again."""
        if self._begun and not self._done:
            next_item(self._ended)

    def outcome(self) -> R:
        """What came of it: ask after the end."""
        for error in self._errors:
            raise error
        return self._results[0]


def uninterrupted(work: Callable[[], R], stop: Callable[[], object] | None = None) -> R:
    """Do some work where no signal handler runs.

    Args:
        work: What to do.
        stop: Called where a handler raises, as after Ctrl-C, to make the work come to its end, which is then waited for;
            None leaves it behind.
    """
    if threading.get_ident() != threading.main_thread().ident:
        return work()
    aside = SignalSafeThread(work, kept=stop is None)
    try:
        aside.begin()
        aside.wait()
    except BaseException:  # A handler's: the work itself raises nothing here.
        if stop is not None:
            stop()
            aside.wait()
        raise
    return aside.outcome()


def raise_of_handler(error: BaseException) -> None:
    """Raise what a signal handler raised, if that is what led to an error.

    Code that reports the errors of other code, a user's function or a parser, calls this first: a handler may raise in the
    midst of that code, such as a TimeoutError, and its exception is meant for the caller of kinseek.
    """
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
