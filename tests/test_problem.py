"""What a solver is given: starts, limits, budgets, batches."""

from __future__ import annotations

import numpy as np
import pytest

import kinseek
from kinseek import Goal, Problem
from kinseek.errors import InvalidProblem
from kinseek.problem import within_limits

ARM = kinseek.load("panda")
GOAL = Goal.pose(np.eye(4))


@pytest.mark.parametrize(
    ("near", "words"),
    [
        (np.zeros(6), r"near must have shape \(7,\) or \(..., 7\), got \(6,\)"),
        (np.float64(1.0), "near must have shape"),
        (
            [0, 0, 0, np.nan, 0, 0, 0],
            r"near contains NaN or infinity at index \(3,\) \(joint 'panda_joint4'\)",
        ),
        (["a"] * 7, "near must be numbers"),
        ([[0.0], [0.0, 1.0]], "near must be numbers"),
        (np.zeros((3, 7)), r"near must have shape \(7,\), got \(3, 7\): the goal is one target"),
    ],
)
def test_a_start_that_does_not_fit(near: object, words: str) -> None:
    with pytest.raises(InvalidProblem, match=words):
        ARM.ik(GOAL, near=near)  # type: ignore[call-overload]


def test_a_start_must_fit_the_batch() -> None:
    batch = Goal.pose(np.stack([np.eye(4)] * 4))
    for shape in ((7,), (1, 7), (4, 7)):
        assert len([one.start for one in Problem(ARM.chain, batch, np.zeros(shape)).each()]) == 4
    with pytest.raises(InvalidProblem, match=r"near must have shape \(7,\) or \(4, 7\), got \(3, 7\)"):
        Problem(ARM.chain, batch, np.zeros((3, 7)))
    with pytest.raises(InvalidProblem, match="near"):
        Problem(ARM.chain, batch, np.zeros((2, 4, 7)))


def test_the_start_is_inside_the_limits() -> None:
    np.testing.assert_allclose(Problem(ARM.chain, GOAL).start, (ARM.lower + ARM.upper) / 2)
    start = Problem(ARM.chain, GOAL, ARM.upper + 0.1).start
    assert ((start >= ARM.lower) & (start <= ARM.upper)).all()


def test_full_turns_are_taken_off_where_that_helps() -> None:
    chain = kinseek.load("cylindrical3").chain
    q = np.array([[7.0, 0.6, 0.5], [-1.0, 0.2, 0.1], [3.0, 0.3, 0.4]])
    expected = [[7.0 - 2 * np.pi, 0.5, 0.5], [2 * np.pi - 1.0, 0.2, 0.25], [3.0, 0.3, 0.4]]
    np.testing.assert_allclose(within_limits(chain, q), expected)


@pytest.mark.parametrize("budget", [0, -5])
def test_a_budget_below_one(budget: int) -> None:
    with pytest.raises(InvalidProblem, match=f"budget must be a whole number of at least 1, got {budget}"):
        Problem(ARM.chain, GOAL, budget=budget)


def test_each_goes_through_the_batch_in_order() -> None:
    Ts = ARM.fk(np.random.default_rng(0).uniform(ARM.lower, ARM.upper, (2, 3, 7)))
    nears = np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (2, 3, 7))
    problems = list(Problem(ARM.chain, Goal.pose(Ts, position_weight=2.0), nears, budget=9).each())
    assert len(problems) == 6
    for index, one in zip(np.ndindex(2, 3), problems, strict=True):
        np.testing.assert_array_equal(one.goal.target, Ts[index])
        np.testing.assert_array_equal(one.start, nears[index])
        assert (one.goal.position_weight, one.budget, one.goal.shape) == (2.0, 9, ())


@pytest.mark.parametrize("q", [np.zeros(6), "zero", [np.inf] * 7, 1.0])
def test_fk_refuses_the_same(q: object) -> None:
    with pytest.raises(InvalidProblem, match="q "):
        ARM.fk(q)  # type: ignore[call-overload]
