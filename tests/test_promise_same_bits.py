"""Promise: the same call gives the same bits, the second time, from other threads and beside other calls."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

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
