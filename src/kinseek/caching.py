"""What an arm needs once, such as its atlas: made at the first call, kept with the arm and dropped with it."""

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
    """Things under their keys, each made once; of those that may go, the ones used last are kept. Shared by threads."""

    def __init__(self, most: int | None = None, may_go: Callable[[Key], bool] = lambda key: True) -> None:
        """Keep nothing yet.

        Args:
            most: How many of those that may go are kept; None keeps all.
            may_go: Whether what has this key may be forgotten.
        """
        self._most, self._may_go = most, may_go
        self._things: OrderedDict[Key, Thing] = OrderedDict()
        self._making = Lock()
        """Held while something is made, so that no two threads make the same; making one thing may ask for another."""

    def get(self, key: Key, make: Callable[[], Thing]) -> Thing:
        """What has this key; made now if it is asked for the first time, or was forgotten."""
        with self._making.now:
            if key not in self._things:
                self._things[key] = make()
                self._forget()
            self._things.move_to_end(key)
            return self._things[key]

    def _forget(self) -> None:
        if self._most is None:
            return
        going = [key for key in self._things if self._may_go(key)]
        for oldest in going[: max(len(going) - self._most, 0)]:
            del self._things[oldest]

    def __len__(self) -> int:
        """How many things there are."""
        return len(self._things)


class WeakCache(Generic[Owner, Key, Thing]):
    """A `LRUCache` for each owner, that goes when its owner goes. What is kept must not hold its owner itself."""

    def __init__(self, most: int | None = None, may_go: Callable[[Key], bool] = lambda key: True) -> None:
        """Keep nothing yet; see `LRUCache`, whose arguments hold for each owner."""
        self._most, self._may_go = most, may_go
        self._owners: weakref.WeakKeyDictionary[Owner, LRUCache[Key, Thing]] = weakref.WeakKeyDictionary()
        self._adding = Lock()

    def of(self, owner: Owner) -> LRUCache[Key, Thing]:
        """What is kept for one owner."""
        with self._adding.now:
            mine = self._owners.get(owner)
            if mine is None:
                mine = self._owners[owner] = LRUCache(self._most, self._may_go)
            return mine
