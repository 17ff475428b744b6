"""A batch with targets that are no poses: refused and named, or all others answered with the same bits."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import kinseek
from kinseek import InvalidGoal, InvalidProblem, Status

ARM = kinseek.load("ur5e")
Q = ARM.sample(40, seed=3)
TARGETS = ARM.fk(Q)
BAD = [3, 7, 8, 11, 39]


def spoilt() -> np.ndarray[tuple[int, int, int], np.dtype[np.float64]]:
    poses = TARGETS.copy()
    poses[3, 0, 3] = np.nan
    poses[7, :3, :3] *= 2.0
    poses[8, 1, 1] = np.inf
    poses[11, :3, :3] *= -1.0
    poses[39, 0, 3] = 1e9
    return poses


def test_by_default_the_first_bad_pose_is_named() -> None:
    with pytest.raises(InvalidGoal, match="NaN or infinity at index 3 of the batch"):
        ARM.ik(spoilt())
    with pytest.raises(InvalidGoal, match="not a rigid transform at index 7 of the batch"):
        ARM.ik(np.where(np.isfinite(spoilt()).all(axis=(1, 2), keepdims=True), spoilt(), np.eye(4))[:30])


@pytest.mark.parametrize("near", [False, True])
def test_the_others_are_answered_with_the_same_bits(near: bool) -> None:
    good = np.ones(40, dtype=bool)
    good[BAD] = False
    whole = ARM.ik(TARGETS, near=Q if near else None)
    solution = ARM.ik(spoilt(), near=Q if near else None, bad="skip")
    np.testing.assert_array_equal(solution.invalid, ~good)
    assert [status is Status.INVALID for status in solution.status] == (~good).tolist()
    for name in ("q", "success", "position_error", "orientation_error", "weighted_error", "evaluations"):
        np.testing.assert_array_equal(getattr(solution, name)[good], getattr(whole, name)[good])
    assert np.isnan(solution.q[BAD]).all()
    assert np.isnan(solution.position_error[BAD]).all()
    assert not solution.success[BAD].any()
    assert not solution.evaluations[BAD].any()
    assert repr(solution) == "Solution(35 of 40 solved, 5 invalid, q(40, 6))"
    with pytest.raises(kinseek.NotReached, match=r"5 of 40 targets not reached; 5 targets are not poses$"):
        solution.require()


def test_one_of_a_marked_batch() -> None:
    solution = ARM.ik(spoilt().reshape(4, 10, 4, 4), near=Q.reshape(4, 10, 6), bad="skip")
    assert solution.q.shape == (4, 10, 6)
    assert solution[0, 3].status is Status.INVALID
    assert solution[0, 2].status is Status.SOLVED
    assert solution[0].invalid.sum() == 3
    assert solution[~solution.invalid].success.all()
    np.testing.assert_array_equal(solution.problem.goal.target[0, 3], np.eye(4))
    np.testing.assert_array_equal(solution.problem.goal.target[0, 2], TARGETS[2])
    assert pickle.loads(pickle.dumps(solution)).invalid.sum() == 5


def test_batches_of_none_of_one_and_of_nothing_else() -> None:
    assert not ARM.ik(TARGETS, bad="skip").invalid.any()
    np.testing.assert_array_equal(ARM.ik(TARGETS, bad="skip").q, ARM.ik(TARGETS).q)
    assert ARM.ik(TARGETS[0], bad="skip").status is Status.SOLVED
    alone = ARM.ik(spoilt()[3], bad="skip")
    assert (alone.status, alone.success, alone.invalid) == (Status.INVALID, False, True)
    assert np.isnan(alone.q).all()
    assert alone.q.shape == (6,)
    with pytest.raises(kinseek.NotReached, match="1 target is not a pose"):
        alone.require()
    every = ARM.ik(spoilt()[[3, 7]], bad="skip")
    assert every.invalid.all()
    assert every.q.shape == (2, 6)
    assert ARM.ik(kinseek.Goal.pose(TARGETS[:2]), bad="skip").success.all()


def test_with_every_other_option() -> None:
    for options in (
        {"prefer": "limits"},
        {"prove": True},
        {"solver": kinseek.CoordinateDescent()},
        {"time_limit": 9.0},
    ):
        solution = ARM.ik(spoilt()[2:5], bad="skip", **options)
        assert solution.invalid.tolist() == [False, True, False], options
    traced = ARM.ik(spoilt()[2:5], trace=True, bad="skip")
    assert traced.trace[1] is None
    assert len(traced.trace[0].passes) > 0


def test_a_function_as_an_arm() -> None:
    arm = kinseek.Arm.from_fk(ARM.fk, ARM.lower, ARM.upper, kinds="revolute")
    assert arm.ik(spoilt()[2:5], bad="skip").invalid.tolist() == [False, True, False]


def test_misuse_is_told() -> None:
    with pytest.raises(InvalidProblem, match="unknown value of bad= 'skipp'; did you mean 'skip'"):
        ARM.ik(spoilt(), bad="skipp")  # type: ignore[call-overload]
    with pytest.raises(InvalidGoal, match="shape"):
        ARM.ik(np.zeros((5, 7)), bad="skip")
    with pytest.raises(InvalidProblem, match="near must have shape"):
        ARM.ik(spoilt(), near=Q[:3], bad="skip")
