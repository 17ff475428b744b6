"""What comes back: judged by FK alone, one sentence a status, batches of any shape."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, NotReached, Problem, Status
from kinseek.solution import conclude

ARM = kinseek.load("planar2")
Q = np.array([1.0, 2.0])
OFF = Q + np.array([1e-3, 0.0])


def judged(q: np.ndarray, **options: Any) -> kinseek.Solution:
    problem = Problem(ARM.chain, Goal.pose(ARM.fk(Q), **options))
    return conclude(problem, q[None], np.array([[1, 2, 3]]))


def test_success_is_decided_by_fk() -> None:
    assert judged(Q).success is True
    assert judged(Q).status is Status.SOLVED
    off = judged(OFF)
    assert off.success is False
    assert off.status is Status.BEST_EFFORT
    assert off.orientation_error == pytest.approx(1e-3, rel=1e-6)
    assert off.position_error == pytest.approx(np.linalg.norm(ARM.fk(Q)[:3, 3] - ARM.fk(OFF)[:3, 3]))
    assert judged(OFF, position_tolerance=1e-2).success is False
    assert judged(OFF, position_tolerance=1e-2, orientation_tolerance=1e-2).success is True
    assert (off.evaluations, off.nodes_created, off.nodes_expanded) == (1, 2, 3)


def test_require_returns_or_raises_with_the_solution() -> None:
    solved, missed = judged(Q), judged(Q + 0.1)
    assert solved.require() is solved
    with pytest.raises(
        NotReached, match=r"nearest pose found is .* m and 0\.2 rad away, tolerances 1e-06 m, 1e-06 rad"
    ) as caught:
        missed.require()
    assert caught.value.solution is missed
    batch = ARM.ik(ARM.fk(np.stack([Q, Q])), near=Q, solver=kinseek.CoordinateDescent())
    assert batch.require() is batch
    far = ARM.ik(kinseek.pose([[7.0, 0.0, 0.0]] * 3), solver=kinseek.DivideAndConquer())
    with pytest.raises(NotReached, match="3 of 3 targets not reached"):
        far.require()


def test_one_pose_gives_plain_numbers_and_a_short_text() -> None:
    solution = judged(Q)
    kinds = [type(getattr(solution, name)) for name in ("success", "position_error", "evaluations")]
    assert kinds == [bool, float, int]
    assert repr(solution).startswith("Solution(SOLVED, q=[1., 2.], position_error=")
    assert str(Status.SOLVED).startswith("Solved:")


def test_errors_and_their_solution_pickle() -> None:
    error = NotReached("no", judged(Q))
    assert pickle.loads(pickle.dumps(error)).solution.success is True


def test_the_question_is_the_one_that_was_asked() -> None:
    arm = kinseek.load("planar2")
    target = arm.fk([0.3, 0.5])
    asked = target.copy()
    solution = arm.ik(target)
    target[:3, 3] = 9.0
    np.testing.assert_array_equal(solution.problem.goal.target, asked)


def test_require_says_what_is_proved_and_leaves_out_a_free_orientation() -> None:
    place = Goal.position([7.0, 0.0, 0.0])
    with pytest.raises(NotReached, match=r"nearest pose found is \S+ m away, tolerance 1e-06 m$"):
        ARM.ik(place).require()
    with pytest.raises(NotReached, match=r"tolerance 1e-06 m; proved: no joint .* reach the goal$"):
        ARM.ik(place, prove=True).require()
    both = Goal.position(np.stack([place.target, ARM.fk(Q)])[:, :3, 3])
    with pytest.raises(NotReached, match=r"1 of 2 targets .*; proved: no joint .* reach 1 of them$"):
        ARM.ik(both, prove=True).require()
