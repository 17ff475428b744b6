"""Work beside a page: one thread that always takes the newest wish, so that what is no longer wanted is never waited for."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

_log = logging.getLogger("kinseek.viewer")


class Newest(Generic[Item]):
    """A thread that works on the newest of what it is given, and leaves out what came between."""

    def __init__(self, work: Callable[[Item], None], name: str, quiet: float = 0.0) -> None:
        """Begin to wait.

        Args:
            work: What to do; it may ask `stale` whether to go on.
            name: Of the thread.
            quiet: [s] that nothing new must come before the work begins.
        """
        self._work, self._quiet = work, quiet
        self._changed = threading.Condition()
        self._waiting: list[Item] = []
        self._closed = False
        self._busy = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, item: Item) -> None:
        """Work on this next; what waits already is left out."""
        with self._changed:
            self._waiting = [item]
            self._changed.notify_all()

    def stale(self) -> bool:
        """Is something newer waiting, or the end come?"""
        return bool(self._waiting) or self._closed

    def wait(self, seconds: float) -> None:
        """Wait [s], shorter if something newer comes."""
        with self._changed:
            if not self.stale():
                self._changed.wait(seconds)

    @property
    def idle(self) -> bool:
        """Is there nothing to do?"""
        with self._changed:
            return not (self._busy or self._waiting)

    def close(self) -> None:
        """End after what is being done, which hears of it by `stale`; from the thread itself it only says so."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while taken := self._next():
            try:
                self._work(taken[0])
            except Exception:  # A page that has a fault shall go on with the next goal.
                if not self._closed:
                    _log.exception("a page could not show what was asked of it")

    def _next(self) -> list[Item]:
        """What to do next, alone in a list; nothing at the end."""
        with self._changed:
            self._busy = False
            while not self._closed and not self._waiting:
                self._changed.wait()
            while not self._closed and self._quiet:
                newest = self._waiting  # The list, a new one at every call: wishes may be the same.
                self._changed.wait(self._quiet)
                if self._waiting is newest:
                    break
            if self._closed:
                return []
            self._busy, taken = True, self._waiting
            self._waiting = []
            return taken
