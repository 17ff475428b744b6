"""Promise: memory does not grow with the number of calls. ``python -m tests.soak`` goes on for ten minutes."""

from __future__ import annotations

import sys

import pytest

from soak import growth, soak

pytestmark = pytest.mark.slow


@pytest.mark.skipif(sys.platform != "linux", reason="reads the memory of the process where Linux tells it")
def test_a_hundred_calls_of_each_kind_leave_nothing_behind() -> None:
    held = soak(5.0, told=lambda line: None)
    # A leak of one answer's joint values a call would be seen: some 100 calls a turn.
    assert growth(held) < 1.0, held


def test_growth_is_seen() -> None:
    assert growth([1.0, 1.0, 2.0, 2.0, 3.0, 3.0]) == 1.0
    assert growth([5.0] * 9) == 0.0
