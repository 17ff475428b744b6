"""Promise: the same call gives the same bits, the second time, from other threads and beside other calls."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import kinseek
from verbs import ARMS, VERBS, arm_of, asked

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("verb", VERBS)
def test_two_runs_and_four_threads_agree_to_the_last_bit(verb: str) -> None:
    call = VERBS[verb]
    questions = [(arm_of(name), asked(arm_of(name), seed=7)) for name in ARMS]
    first = [call(arm, poses) for arm, poses in questions]
    assert all(len(one.q) for one in first), "nothing is compared"
    with ThreadPoolExecutor(4) as pool:
        rounds = [[pool.submit(call, arm, poses) for arm, poses in questions] for _ in range(2)]
        others = [[future.result() for future in futures] for futures in rounds]
    for other in [*others, [call(arm, poses) for arm, poses in reversed(questions)][::-1]]:
        for one, again in zip(first, other, strict=True):
            assert one.q.tobytes() == again.q.tobytes()
            np.testing.assert_array_equal(one.success, again.success)


def strided(a: Any) -> Any:
    wide = np.zeros([2 * size for size in a.shape])
    wide[tuple(slice(None, None, 2) for _ in a.shape)] = a
    return wide[tuple(slice(None, None, 2) for _ in a.shape)]


def unaligned(a: Any) -> Any:
    """As a field of a packed record, or a part of a message, lies."""
    record = np.zeros(1, dtype=[("flag", "u1"), ("numbers", "f8", a.shape)])
    record["numbers"][0] = a
    return record["numbers"][0]


@pytest.mark.parametrize(
    "other", [lambda a: pickle.loads(pickle.dumps(a)), np.asfortranarray, strided, unaligned]
)
def test_however_a_pose_lies_in_memory_it_takes_the_short_way(
    other: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.5, 0.2, 0.9, -0.4])
    T = arm.fk(q)
    expected = arm.ik(T).q, arm.ik(T, near=q).q, arm.branches(T).q, arm.track(q).step(T).q
    given, near = other(T), other(q)
    assert given.dtype is not T.dtype or not given.flags.c_contiguous or not given.flags.aligned

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("the long way")

    monkeypatch.setattr(kinseek.Goal, "pose", refuse)
    monkeypatch.setattr("kinseek.paths.tracked_goal.one_pose", refuse)
    tracker = arm.track(q)
    found = arm.ik(given).q, arm.ik(given, near=near).q, arm.branches(given).q, tracker.step(given).q
    for one, another in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, another)
