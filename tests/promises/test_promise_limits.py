"""Promise: no answer lies outside the limits, whatever was asked and whatever came of it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from verbs import ARMS, VERBS, arm_of, asked


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
@settings(max_examples=10)
@given(name=st.sampled_from(ARMS), seed=st.integers(0, 10**6))
def test_joint_values_lie_inside_the_limits(verb: str, name: str, seed: int) -> None:
    arm = arm_of(name)
    told = VERBS[verb](arm, asked(arm, seed))
    assert np.isfinite(told.q).all()
    bounded = ~arm.chain.endless
    assert (told.q >= arm.lower)[:, bounded].all(), told.q
    assert (told.q <= arm.upper)[:, bounded].all(), told.q
