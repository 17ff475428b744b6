"""A short part of the fuzz of proofs; the long one is ``python -m tests.fuzz.proofs --count 300000``."""

from __future__ import annotations

import pytest

from fuzz.proofs import wrong_cases

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", [0, 1])
def test_poor_answers_break_no_bound(seed: int) -> None:
    found = [f"case {number}: {', '.join(wrong)}" for number, _, wrong in wrong_cases(1000, seed)]
    assert not found, "\n".join(found)
