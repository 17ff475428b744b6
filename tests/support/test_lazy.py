"""Lazy attributes: one object for all threads, no lock, and no part of pickles and copies."""

from __future__ import annotations

import copy
import functools
import pickle
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.collision.shapes import Box, Mesh
from kinseek.maps.orientations import orientations
from kinseek.problem import Problem
from kinseek.support.lazy import Lazy, Made, lazy


class Thing(Lazy):
    """Something with a lazy attribute."""

    def __init__(self, computed: Any = lambda: None) -> None:
        self.computed = computed

    @lazy
    def value(self) -> object:
        """What is computed."""
        self.computed()
        return object()


class Narrow(Thing):
    """Inherits it, and has slots of its own."""

    __slots__ = ("more",)
    more: list[int]


def test_threads_that_compute_it_at_the_same_time_get_one_object() -> None:
    # Neither thread waits for the other to end: a lock around the computation would never let both come here.
    thing = Thing(threading.Barrier(2, timeout=10.0).wait)
    with ThreadPoolExecutor(2) as pool:
        first, second = pool.map(lambda _: thing.value, range(2))
    assert first is second is thing.value


def test_a_class_that_would_pickle_it_is_refused() -> None:
    with pytest.raises((TypeError, RuntimeError)) as caught:  # Python 3.11 wraps what `__set_name__` raises.

        class Wrong:
            value = lazy(lambda self: 1)

    assert "must derive from Lazy" in str(caught.value.__cause__ or caught.value)


def test_copies_leave_it_out() -> None:
    thing: Any = Narrow()
    thing.more, value = [1], thing.value
    for again in (copy.copy(thing), copy.deepcopy(thing)):
        assert "value" not in vars(again)
        assert again.more == [1]
        assert again.value is not value


def test_nothing_in_the_package_holds_a_lock_of_its_class() -> None:
    package = Path(kinseek.__file__).parent
    files = {path.name for path in package.rglob("*.py") if "cached_property" in path.read_text("utf-8")}
    assert files == {"lazy.py"}
    assert not any(isinstance(value, functools.cached_property) for value in vars(kinseek.Goal).values())


def arm_and_poses() -> tuple[kinseek.Arm, Any]:
    """An arm, and three poses that it reaches."""
    arm = kinseek.load("ur5e")
    return arm, arm.fk(arm.sample(3, seed=2))


def ask(call: Callable[[kinseek.Arm, Any], Any]) -> Callable[[], Any]:
    """Make a result anew."""
    return lambda: call(*arm_and_poses())


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
SIDES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
THINGS: dict[str, Callable[[], Any]] = {
    "arm": lambda: kinseek.load("panda"),
    "chain": lambda: kinseek.load("panda").chain,
    "goal": ask(lambda arm, T: kinseek.Goal.pose(T[0], free="rz")),
    "problem": ask(lambda arm, T: Problem(arm.mechanism, kinseek.Goal.pose(T[0]))),
    "quick solution": ask(lambda arm, T: arm.ik(T[0])),
    "solutions": ask(lambda arm, T: arm.ik(T)),
    "branches": ask(lambda arm, T: arm.branches(T[0])),
    "batch of branches": ask(lambda arm, T: arm.branches(T)),
    "path": ask(lambda arm, T: arm.follow(T[[0, 0]])),
    "box": lambda: Box([1.0, 2.0, 3.0]),
    "mesh": lambda: Mesh(CORNERS, SIDES),
    "orientations": lambda: orientations(20),
}
"""One of every class that has lazy attributes and that a user can pickle, of which nothing was read."""


def read_all(thing: Any) -> int:
    """Read every lazy attribute of a thing, and of what it is made of; say how many there were."""
    count = 0
    if isinstance(thing, kinseek.Arm):
        return read_all(thing.chain)
    if isinstance(thing, kinseek.BranchesBatch):
        return sum(read_all(one) for one in thing)
    for name, value in getattr(type(thing), "_lazy", {}).items():
        assert isinstance(value, Made)
        try:
            getattr(thing, name)
        except (ValueError, TypeError, IndexError, kinseek.KinseekError):  # Those of another kind of goal.
            continue
        count += 1
    return count


@pytest.mark.slow
@pytest.mark.parametrize("name", THINGS)
def test_pickles_do_not_depend_on_what_was_read(name: str) -> None:
    thing = THINGS[name]()
    before = pickle.dumps(thing)
    assert read_all(thing) > 0
    assert pickle.dumps(thing) == before
    for again in (pickle.loads(before), copy.deepcopy(thing)):
        copied = pickle.dumps(again)
        assert read_all(again) > 0
        assert pickle.dumps(again) == copied


def test_what_an_object_was_given_itself_stays() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk(arm.sample(1, seed=3)[0])
    solution = arm.ik(T, solver=kinseek.Polished())
    again = pickle.loads(pickle.dumps(solution))
    for field in fields(solution):
        if field.name not in ("problem", "_trace", "_contacts"):
            assert np.array_equal(getattr(again, field.name), getattr(solution, field.name)), field.name
    assert np.array_equal(again.problem.goal.target, T)


@pytest.mark.slow
def test_an_arm_can_be_pickled_while_another_thread_uses_it_for_the_first_time() -> None:
    T = kinseek.load("ur5e").fk(np.array([0.3, -1, 1.2, 0.4, 0.8, 0.2]))
    arms = [kinseek.load("ur5e") for _ in range(25)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # Makes the race frequent.
    try:
        for arm in arms:
            both = threading.Barrier(2)

            def use(arm: kinseek.Arm = arm, both: threading.Barrier = both) -> None:
                both.wait()
                arm.branches(T)
                arm.ik(kinseek.Goal.pose(T, free="rz"))

            user = threading.Thread(target=use)
            user.start()
            both.wait()
            for _ in range(30):
                pickle.dumps(arm)
            copy.deepcopy(arm)
            user.join()
    finally:
        sys.setswitchinterval(interval)
