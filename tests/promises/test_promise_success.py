"""Promise: `success` is what plain forward kinematics says of q, and never what a search believes of itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from reference import errors, fk
from verbs import ARMS, VERBS, arm_of, asked

ROUNDING = 1e-12
"""Of the two forward kinematics, [m] and [rad]."""
MOST = 200
"""Answers of one call that are looked at, evenly taken out of all."""


@pytest.mark.slow
@pytest.mark.parametrize("verb", VERBS)
@settings(max_examples=10)
@given(name=st.sampled_from(ARMS), seed=st.integers(0, 10**6))
def test_success_is_what_forward_kinematics_says(verb: str, name: str, seed: int) -> None:
    arm = arm_of(name)
    told = VERBS[verb](arm, asked(arm, seed))
    some = np.linspace(0, len(told.q) - 1, min(len(told.q), MOST)).astype(int)
    for q, success, pose in zip(told.q[some], told.success[some], told.poses[some], strict=True):
        goal = kinseek.Goal.pose(pose)
        place, turn = errors(fk(arm.chain, q), goal)
        allowed = goal.position_tolerance, goal.orientation_tolerance
        if success:
            assert place <= allowed[0] + ROUNDING, (q, place)
            assert turn <= allowed[1] + ROUNDING, (q, turn)
        elif verb not in (
            "track",
            "ik in a scene",
            "plan in a scene",
        ):  # Which may be there and still lag, or hit something.
            assert place > allowed[0] - ROUNDING or turn > allowed[1] - ROUNDING, "a success that is denied"


def test_an_answer_that_misses_cannot_say_that_it_is_one() -> None:
    arm = arm_of("ur5e")
    far = arm.fk(np.zeros(6))
    far[:3, 3] *= 5
    solution = arm.ik(far)
    assert not solution.success
    with pytest.raises(kinseek.NotReached):
        solution.require()
    with pytest.raises(AttributeError):
        solution.success = True  # type: ignore[misc]
