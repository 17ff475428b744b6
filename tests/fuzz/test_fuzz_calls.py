"""A short part of the fuzz of calls; the long one is ``python -m tests.fuzz.calls --count 20000``."""

from __future__ import annotations

import pytest

import kinseek
from fuzz.calls import MOST_SECONDS, case

pytestmark = pytest.mark.slow

COUNT = 300


def test_calls_end_in_numbers_that_hold_or_in_an_error_of_ours() -> None:
    arms: dict[int, kinseek.Arm] = {}
    outcomes = [case(1, number, arms) for number in range(COUNT)]
    found = [f"case {each.number}: {each.finding}" for each in outcomes if each.finding]
    assert not found, "\n".join(found)
    # Kernels compile in the first few calls of each kind; of the others none is slow.
    slow = [each for each in outcomes[COUNT // 2 :] if each.seconds > MOST_SECONDS]
    assert not slow, slow
    assert sum(each.refused for each in outcomes) < COUNT / 4
