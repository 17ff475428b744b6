"""Background work of a page: threads that process the newest request, so that outdated ones are skipped, or all in order."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Item = TypeVar("Item")

_log = logging.getLogger("kinseek.viewer")


class Newest(Generic[Item]):
    """A thread that processes the newest item it is given, and skips older ones."""

    def __init__(self, work: Callable[[Item], None], name: str, quiet: float = 0.0) -> None:
        """Start the thread.

        Args:
            work: Called with an item; it may call `stale` to check whether to continue.
            name: Name of the thread.
            quiet: Time without a new item before the work begins [s].
        """
        self._work, self._quiet = work, quiet
        self._changed = threading.Condition()
        self._waiting: list[Item] = []
        self._closed = False
        self._busy = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def give(self, item: Item) -> None:
        """Process this item next; a waiting item is skipped."""
        with self._changed:
            self._waiting = [item]
            self._changed.notify_all()

    def stale(self) -> bool:
        """Return whether a newer item is waiting, or the thread must end."""
        return bool(self._waiting) or self._closed

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
                if self._closed:
                    return
                try:
                    self._work(item)
                except Exception:  # After an error in a page, it must continue with the next goal.
                    if not self._closed:
                        _log.exception("a page could not show its options")

    def _next(self) -> list[Item]:
        """Return a list with the next item; empty at the end."""
        with self._changed:
            self._busy = False
            while not self._closed and not self._waiting:
                self._changed.wait()
            while not self._closed and self._quiet:
                newest = self._waiting  # A new list at every call, because items may be equal.
                self._changed.wait(self._quiet)
                if self._waiting is newest:
                    break
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
