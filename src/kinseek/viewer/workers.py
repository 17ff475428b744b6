"""Background work of a page: threads that process the newest request, so that outdated ones are skipped, or all in order."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

AT_ONCE = 2
"""Number of pages that do one kind of work at the same time. If all did, their threads would take Python from the server's
loop: with 16 pages that prove, a request waited for 6 s, and with four that change their goals without a pause for 2 s."""

OFTEN = 0.1
"""Time after which a thread that waits for its turn looks whether its page was closed [s]."""

_log = logging.getLogger("kinseek.viewer")


class Turns:
    """Lets a few threads work at once, in the order in which they came: who asks without a pause waits as others do."""

    def __init__(self, count: int = AT_ONCE) -> None:
        """Let so many threads work at once."""
        self._free, self._waiting, self._changed = count, deque[object](), threading.Condition()

    def begin(self, gone: Callable[[], bool]) -> bool:
        """Wait for a turn; return False without one if `gone` returns True first."""
        ticket = object()
        with self._changed:
            self._waiting.append(ticket)
            try:
                while not gone():
                    if self._free and self._waiting[0] is ticket:
                        self._free -= 1
                        return True
                    self._changed.wait(OFTEN)
                return False
            finally:
                self._waiting.remove(ticket)
                self._changed.notify_all()

    def end(self) -> None:
        """End a turn."""
        with self._changed:
            self._free += 1
            self._changed.notify_all()


class Newest(Generic[Item]):
    """A thread that processes the newest item it is given, and skips older ones."""

    def __init__(
        self,
        work: Callable[[Item], None],
        name: str,
        quiet: float = 0.0,
        turn: Callable[[], Turns | None] = lambda: None,
        period: float = 0.0,
    ) -> None:
        """Start the thread.

        Args:
            work: Called with an item; it may call `stale` to check whether to continue.
            name: Name of the thread.
            quiet: Time without a new item before the work begins [s].
            turn: Returns what the work must wait for, which lets a few threads of all pages go on at once; None: nothing.
            period: Least time from the begin of one work to that of the next [s].
        """
        self._work, self._quiet, self._turn, self._period = work, quiet, turn, period
        self._changed = threading.Condition()
        self._waiting: list[Item] = []
        self._given = 0.0
        """When the newest item was given."""
        self._closed = False
        self._busy = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, item: Item) -> None:
        """Process this item next; a waiting item is skipped.

        The thread is woken only for the first item that waits: a page may give hundreds in a second.
        """
        with self._changed:
            is_first, self._waiting, self._given = not self._waiting, [item], time.monotonic()
            if is_first:
                self._changed.notify_all()

    def stale(self) -> bool:
        """Return whether a newer item is waiting, or the thread must end."""
        return bool(self._waiting) or self._closed

    def follows(self, item: Item) -> bool:
        """Return whether this item is processed next."""
        return item in self._waiting[-1:]

    def wait(self, seconds: float) -> None:
        """Wait [s], less if a newer item arrives."""
        with self._changed:
            if not self.stale():
                self._changed.wait(seconds)

    @property
    def idle(self) -> bool:
        """Return whether there is nothing to do."""
        with self._changed:
            return not (self._busy or self._waiting)

    def end(self) -> None:
        """End after the current item, which can check `stale`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def close(self) -> None:
        """End, and wait for it; called from the thread itself, it does not wait."""
        self.end()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while taken := self._next():
            for item in taken:
                begin, turn = time.monotonic(), self._turn()
                if turn is None:
                    self._do(item)
                elif turn.begin(lambda: self._closed):
                    try:
                        self._do(self._newest(item))
                    finally:
                        turn.end()
                while not self._closed and (left := begin + self._period - time.monotonic()) > 0.0:
                    with self._changed:
                        self._changed.wait(left)
                if self._closed:
                    return

    def _do(self, item: Item) -> None:
        try:
            self._work(item)
        except Exception:  # After an error in a page, it must continue with the next goal.
            if not self._closed:
                _log.exception("a page could not show its options")

    def _newest(self, item: Item) -> Item:
        """Return the item that came while this one waited for its turn, if there is one."""
        with self._changed:
            waiting, self._waiting = self._waiting, []
            return waiting[-1] if waiting else item

    def _next(self) -> list[Item]:
        """Return a list with the next item; empty at the end."""
        with self._changed:
            self._busy = False
            while not self._closed and not self._waiting:
                self._changed.wait()
            while not self._closed and (left := self._given + self._quiet - time.monotonic()) > 0.0:
                self._changed.wait(left)
            if self._closed:
                return []
            self._busy, taken = True, self._waiting
            self._waiting = []
            return taken


MOST_WAITING = 20
"""Number of requests that may wait in a `Queue`; a person is not that fast."""


class Queue(Newest[tuple[str, Item]]):
    """A thread that processes named items in order; the newest replaces the last that waits if it has the same name."""

    def give(self, item: tuple[str, Item]) -> None:
        """Process this item after those that wait; if too many do, it is dropped."""
        with self._changed:
            if self._waiting and self._waiting[-1][0] == item[0] != "":
                self._waiting = [*self._waiting[:-1], item]
            elif len(self._waiting) < MOST_WAITING:
                self._waiting = [*self._waiting, item]
            self._changed.notify_all()
