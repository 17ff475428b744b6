"""What a forked child needs: no lock that a thread of its parent holds, and nothing that was left half done.

Of the threads of a process, `os.fork` gives the child only the one that forked. A lock that another thread held is never
released there, and what that thread had begun is never finished. There are two remedies:

- A `Lock` guards one object, and may be held for long. In the child it is replaced by a new one. What it guards must
  hold at every moment, or be made again.
- A lock of the whole process, and a module that is being imported, cannot be replaced. The fork waits until the other
  threads are done with it (`finish_first`, `importing`).
"""

from __future__ import annotations

import os
import pkgutil
import sys
from contextlib import suppress
from importlib import import_module
from threading import RLock
from typing import Any, Protocol

_ROOMS = ("branches", "collision", "notebook", "paths", "proof", "robots", "solvers", "structure")
"""Packages from which functions import when they are first called."""


class Lock:
    """A reentrant lock of one object, taken by ``with lock.now:``; a forked child has a new one.

    It takes part in neither pickles nor copies.
    """

    def __init__(self) -> None:
        """Make it free."""
        self._after: dict[int, Any] = {}

    @property
    def now(self) -> Any:
        """The lock of this process, the same for all of its threads."""
        lock = self._after.get(_forks)
        return self._after.setdefault(_forks, RLock()) if lock is None else lock


class _Held(Protocol):
    def acquire(self) -> Any: ...
    def release(self) -> Any: ...


def finish_first(lock: _Held) -> None:
    """Let forks wait until no other thread holds a lock, which has to be reentrant, and hold it meanwhile.

    Of two such locks that a thread may hold together, the one that it takes first must be given last: forks take them in
    that order.
    """
    _waited_for.append(lock)


_waited_for: list[_Held] = []

importing = RLock()
"""Held while a function imports a package of others: a child could never import what a lost thread had begun to import."""
finish_first(importing)

_forks = 0
"""How many forks led to this process."""

_held: list[_Held] = []
"""What the thread that forks holds meanwhile."""


def _before() -> None:
    _load()
    for lock in reversed(_waited_for):
        lock.acquire()
        _held.append(lock)


def _after() -> None:
    held = list(_held)
    _held.clear()  # The next thread that forks begins as soon as the last lock is free.
    for lock in reversed(held):
        lock.release()


def _after_in_child() -> None:
    global _forks  # noqa: PLW0603  # There is one process.
    _forks += 1
    _after()


_loaded = False


def _load() -> None:
    """Import what functions of kinseek import later, which waits for the threads that are importing it.

    Only the first fork beside other threads does so. None of these modules may itself register a pair of functions before
    and after forks, as `logging` and `concurrent.futures` do: of this fork, Python would call the second one alone.
    """
    global _loaded  # noqa: PLW0603  # There is one process.
    if _loaded or len(sys._current_frames()) == 1:
        return
    for room in _ROOMS:
        package = import_module(f"{__package__}.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            with suppress(ImportError):  # Of an extra that is not installed.
                import_module(module.name)
    _loaded = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_after, after_in_child=_after_in_child)
