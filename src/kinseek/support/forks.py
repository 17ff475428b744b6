"""Fork safety: a forked child must not inherit a lock held by a parent's thread, or anything half done.

After `os.fork` the child has only the thread that forked. A lock that another thread held is never released in the child,
and work that another thread had begun is never finished. There are two remedies:

- A `Lock` guards one object and may be held for long. The child replaces it by a new one. The state that it guards must be
  valid at every moment, or be rebuilt.
- A lock of the whole process, or a module that is being imported, cannot be replaced. The fork waits until the other threads
  are done with it (`finish_first`, `importing`).
"""

from __future__ import annotations

import logging  # noqa: F401  # See `_before`.
import os
import pkgutil
import sys
from contextlib import suppress
from importlib import import_module
from threading import RLock
from typing import Any, Protocol

_ROOMS = ("branches", "collision", "notebook", "paths", "proof", "robots", "solvers", "structure")
"""Packages that functions of kinseek import when they are first called."""


class Lock:
    """A reentrant lock of one object, acquired by ``with lock.now:``; a forked child has a new one.

    Pickles and copies leave it out.
    """

    def __init__(self) -> None:
        """Make a free lock."""
        self._after: dict[int, Any] = {}

    @property
    def now(self) -> Any:
        """The lock of this process, the same for all of its threads."""
        lock = self._after.get(_forks)
        return self._after.setdefault(_forks, RLock()) if lock is None else lock


class _ReentrantLock(Protocol):
    def acquire(self) -> Any: ...
    def release(self) -> Any: ...


def finish_first(lock: _ReentrantLock) -> None:
    """Make forks wait until no other thread holds a reentrant lock, and hold it during the fork.

    If a thread may hold two such locks at once, register the lock that it acquires first last, because forks acquire them in
    that order.
    """
    _waited_for.append(lock)


_waited_for: list[_ReentrantLock] = []

importing = RLock()
"""Held while a function imports a package. A child could never finish an import that another thread had begun."""
finish_first(importing)

_forks = 0
"""Number of forks that led to this process."""

_acquired: list[_ReentrantLock] = []
"""Locks that the forking thread holds during the fork."""


def _before() -> None:
    """Wait for what other threads are doing, and hold their locks during the fork.

    Python calls last what was registered first. `logging`, which locks its own names during a fork, is imported above: it
    would otherwise lock them before other threads could finish imports that ask for a logger.
    """
    _load()
    for lock in reversed(_waited_for):
        lock.acquire()
        _acquired.append(lock)


def _after() -> None:
    acquired = list(_acquired)
    _acquired.clear()  # The next thread that forks may start as soon as the last lock is released.
    for lock in reversed(acquired):
        lock.release()


def _after_in_child() -> None:
    global _forks  # noqa: PLW0603  # There is one process.
    _forks += 1
    _after()


_loaded = False


def _load() -> None:
    """Import the modules that functions of kinseek import later, after waiting for threads that are importing them.

    Only the first fork of a process with several threads does so. None of these modules may itself register functions to be
    called before and after forks, as `logging` and `concurrent.futures` do: for this fork Python would call only the second
    one.
    """
    global _loaded  # noqa: PLW0603  # There is one process.
    if _loaded or len(sys._current_frames()) == 1:
        return
    for room in _ROOMS:
        package = import_module(f"kinseek.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            with suppress(ImportError):  # The module belongs to an extra that is not installed.
                import_module(module.name)
    _loaded = True


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before, after_in_parent=_after, after_in_child=_after_in_child)
