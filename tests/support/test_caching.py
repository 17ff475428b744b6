"""What is kept with an arm: made once, by one thread, forgotten in turn, dropped with the arm."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek.solvers.atlas.index import SAMPLES
from kinseek.solvers.black_box import coordinates, samples
from kinseek.support.caching import LRUCache, WeakCache

Array = NDArray[np.float64]


class Owner:
    """Something that can be referred to weakly."""


def test_threads_make_a_thing_once() -> None:
    shelf: WeakCache[Owner, int, object] = WeakCache()
    owner, made = Owner(), []
    gate = threading.Barrier(8)

    def make() -> object:
        made.append(threading.get_ident())
        time.sleep(0.05)  # Long enough that the others come meanwhile.
        return object()

    def ask(_: int) -> object:
        gate.wait()
        return shelf.of(owner).get(1, make)

    with ThreadPoolExecutor(8) as pool:
        got = set(map(id, pool.map(ask, range(8))))
    assert len(made) == 1
    assert len(got) == 1


def test_making_one_thing_may_ask_for_another() -> None:
    kept: LRUCache[str, str] = LRUCache()
    assert kept.get("tool", lambda: "of " + kept.get("tip", lambda: "the tip")) == "of the tip"
    assert len(kept) == 2


def test_those_used_last_are_kept_and_some_always() -> None:
    kept: LRUCache[tuple[str, int], list[int]] = LRUCache(2, lambda key: key[0] == "tool")
    own = kept.get(("tip", 0), lambda: [])
    first = kept.get(("tool", 1), lambda: [1])
    kept.get(("tool", 2), lambda: [2])
    assert kept.get(("tool", 1), lambda: [0]) is first
    kept.get(("tool", 3), lambda: [3])  # The second was used before the first: it goes.
    assert len(kept) == 3
    assert kept.get(("tool", 1), lambda: [0]) is first
    assert kept.get(("tip", 0), lambda: [0]) is own
    assert kept.get(("tool", 2), lambda: [22]) == [22]


def test_what_could_not_be_made_is_asked_for_again() -> None:
    kept: LRUCache[int, int] = LRUCache()
    with pytest.raises(ZeroDivisionError):
        kept.get(1, lambda: 1 // 0)
    assert len(kept) == 0
    assert kept.get(1, lambda: 5) == 5


def test_things_go_with_their_owner_and_stay_with_others() -> None:
    shelf: WeakCache[Owner, int, Owner] = WeakCache()
    one, other = Owner(), Owner()
    gone = weakref.ref(shelf.of(one).get(0, Owner))
    stays = shelf.of(other).get(0, Owner)
    assert gone() is not stays
    del one
    gc.collect()
    assert gone() is None
    assert shelf.of(other).get(0, Owner) is stays


def test_nothing_else_is_kept_by_weak_references() -> None:
    package = Path(kinseek.__file__).parent
    files = {path.name for path in package.rglob("*.py") if "weakref" in path.read_text(encoding="utf-8")}
    assert files == {"caching.py"}


def test_branches_and_samples_are_dropped_with_their_arms() -> None:
    arm = kinseek.load("planar2")
    index = weakref.ref(arm._branches)
    arm.branches(kinseek.Goal.position(arm.fk(np.array([0.3, 0.4]))[:3, 3]))
    chain = weakref.ref(arm.chain)

    def fk(q: Array) -> Array:
        poses = np.tile(np.eye(4), (len(q), 1, 1))
        poses[:, :2, 3] = q
        return poses

    function = kinseek.Arm.from_fk(fk, [-1.0, -1.0], [1.0, 1.0])
    function.ik(kinseek.Goal.position([0.2, 0.3, 0.0]))
    function.ik(kinseek.Goal.position([0.2, 0.3, 0.0]), solver=kinseek.CoordinateDescent())
    mechanism = function.mechanism
    box = weakref.ref(mechanism)
    asked = weakref.ref(samples._samples.of(mechanism).get(SAMPLES, lambda: pytest.fail("not kept")))
    assert len(coordinates._forms.of(mechanism)) == 1
    del arm, function, mechanism
    gc.collect()
    assert (index(), chain(), box(), asked()) == (None,) * 4
