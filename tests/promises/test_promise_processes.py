"""Promise: arms, scenes and answers work in other processes, forked or started anew, with the same bits."""

from __future__ import annotations

import multiprocessing
import pickle
import sys
import threading
from typing import Any

import numpy as np
import pytest

import kinseek
from verbs import VERBS, arm_of, asked

pytestmark = pytest.mark.slow

NAMES = ("ur5e", "panda")


def answers(name: str, verbs: tuple[str, ...], arm: Any, queue: Any) -> None:
    """What some verbs tell in this process."""
    for verb in verbs:
        queue.put((name, verb, VERBS[verb](arm, asked(arm, seed=3)).q.tobytes()))


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_another_process_gives_the_same_bits(method: str) -> None:
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"this system cannot {method}")
    verbs = ("ik", "ik, a batch", "branches", "follow")
    here = {(n, v): VERBS[v](arm_of(n), asked(arm_of(n), seed=3)).q.tobytes() for n in NAMES for v in verbs}
    context: Any = multiprocessing.get_context(method)
    queue = context.Queue()
    works = [context.Process(target=answers, args=(name, verbs, arm_of(name), queue)) for name in NAMES]
    for work in works:
        work.start()
    told = [queue.get(timeout=120) for _ in here]
    for work in works:
        work.join(60)
        assert work.exitcode == 0
    assert {(name, verb): bits for name, verb, bits in told} == here


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork")
@pytest.mark.skipif(sys.version_info >= (3, 12), reason="Python warns of any fork beside threads")
def test_a_fork_in_the_middle_of_calls_of_other_threads_works() -> None:
    arm = arm_of("panda")
    poses = arm.fk(arm.sample(2000, seed=1))
    over = threading.Event()

    def busy() -> None:
        while not over.is_set():
            arm.ik(poses)

    thread = threading.Thread(target=busy)
    thread.start()
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    try:
        works = [context.Process(target=answers, args=("panda", ("ik",), arm, queue)) for _ in range(4)]
        for work in works:
            work.start()
        told = {queue.get(timeout=60)[2] for _ in works}
        for work in works:
            work.join(60)
    finally:
        over.set()
        thread.join()
    assert told == {VERBS["ik"](arm, asked(arm, seed=3)).q.tobytes()}


@pytest.mark.parametrize("name", NAMES)
def test_arms_and_answers_can_be_pickled(name: str) -> None:
    arm = arm_of(name)
    pose = arm.fk(arm.sample(1, seed=2)[0])
    poses = np.array([pose, pose])
    results: list[Any] = [arm.ik(pose), arm.ik(poses), arm.branches(pose), arm.follow(poses)]
    for one in results:
        again = pickle.loads(pickle.dumps(one))
        assert type(again) is type(one)
        np.testing.assert_array_equal(again.q, one.q)
        np.testing.assert_array_equal(again.problem.goal.target, one.problem.goal.target)
        assert again.problem.chain.name == name
    assert pickle.loads(pickle.dumps(kinseek.Goal.pose(pose))).target.tobytes() == pose.tobytes()
    again = pickle.loads(pickle.dumps(arm))
    assert again.ik(pose).q.tobytes() == arm.ik(pose).q.tobytes()
