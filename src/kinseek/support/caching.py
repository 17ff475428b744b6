"""Caches of what an arm needs once, such as its atlas: made at the first call, and dropped with the arm."""

from __future__ import annotations

import weakref
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Generic, TypeVar

from .forks import Lock

Owner = TypeVar("Owner")
Key = TypeVar("Key", bound=Hashable)
Thing = TypeVar("Thing")


class LRUCache(Generic[Key, Thing]):
    """A cache whose values are made at the first request; the least recently used ones are dropped. Thread-safe."""

    def __init__(self, most: int | None = None, may_go: Callable[[Key], bool] = lambda key: True) -> None:
        """Make an empty cache.

        Args:
            most: Maximum number of droppable values that are kept; None keeps all.
            may_go: Whether the value of a key may be dropped.
        """
        self._most, self._may_go = most, may_go
        self._things: OrderedDict[Key, Thing] = OrderedDict()
        self._making = Lock()
        """Held while a value is made, so that no two threads make the same one. Making one value may request another."""

    def get(self, key: Key, make: Callable[[], Thing]) -> Thing:
        """Return the value of a key; make it if it is not in the cache."""
        with self._making.now:
            if key not in self._things:
                self._things[key] = make()
                self._forget()
            self._things.move_to_end(key)
            return self._things[key]

    def _forget(self) -> None:
        if self._most is None or len(self._things) <= self._most:
            return
        going = [key for key in self._things if self._may_go(key)]
        for oldest in going[: max(len(going) - self._most, 0)]:
            del self._things[oldest]

    def __contains__(self, key: Key) -> bool:
        """Return whether there is a value for a key now."""
        return key in self._things

    def __len__(self) -> int:
        """Number of values."""
        return len(self._things)


class WeakCache(Generic[Owner, Key, Thing]):
    """An `LRUCache` for each owner, dropped with its owner. Cached values must not refer to the owner."""

    def __init__(self, most: int | None = None, may_go: Callable[[Key], bool] = lambda key: True) -> None:
        """Make an empty cache; the arguments are those of `LRUCache` and apply to each owner."""
        self._most, self._may_go = most, may_go
        self._owners: weakref.WeakKeyDictionary[Owner, LRUCache[Key, Thing]] = weakref.WeakKeyDictionary()
        self._adding = Lock()

    def of(self, owner: Owner) -> LRUCache[Key, Thing]:
        """Return the cache of one owner."""
        with self._adding.now:
            mine = self._owners.get(owner)
            if mine is None:
                mine = self._owners[owner] = LRUCache(self._most, self._may_go)
            return mine
