"""The one loop of the three searches by boxes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.proof.infeasibility import OFTEN, STEPS
from kinseek.kernels.proof.progress import COUNT, ENDED, FOUND, STOPPED, UPPER
from kinseek.proof.boxes import Run, Watch, tuning_of
from kinseek.proof.reduce import question, start_boxes
from kinseek.proof.root_isolation import isolate

BOXES = 1500


def beyond(name: str, seed: int) -> Problem:
    """A pose a little further out than one that the arm has."""
    arm = kinseek.load(name)
    T: NDArray[np.float64] = arm.fk(np.random.default_rng(seed).uniform(arm.lower, arm.upper))
    T[:3, 3] *= 1.1
    return Problem(arm.chain, Goal.pose(T))


def run_of(problem: Problem) -> Run:
    asked = question(problem)
    boxes = start_boxes(problem.chain, asked[2].present)
    return Run(problem, asked, boxes, np.zeros(problem.chain.dof), tuning_of(problem, OFTEN, STEPS))


@pytest.mark.parametrize("name", ["planar2", "elbow6", "puma560"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_box_worth_another_look_outlives_the_budget(name: str, seed: int) -> None:
    """One box more a call, where every call is told that its budget is over: the same as all at once."""
    problem = beyond(name, seed)
    whole, pieces = run_of(problem), run_of(problem)
    outcome = whole.go(BOXES, Watch())
    reached = STOPPED
    for most in range(1, BOXES + 1):
        reached = pieces.go(most, Watch())
        assert pieces.seen <= most
        if reached != STOPPED:
            break
    assert reached == outcome
    np.testing.assert_array_equal(pieces.counts, whole.counts)
    np.testing.assert_array_equal(pieces.figures, whole.figures)
    np.testing.assert_array_equal(pieces.q, whole.q)
    left = whole.counts[COUNT]
    np.testing.assert_array_equal(pieces.boxes[:left], whole.boxes[:left])


def test_the_loop_ends_as_it_was_told() -> None:
    """No box left, an answer, or the budget: the words of the outcome, and nothing of the loop's own."""
    arm = kinseek.load("planar2")
    T = arm.fk((arm.lower + arm.upper) / 2 + 0.3)
    wide = Goal.pose(T, position_tolerance=0.05, orientation_tolerance=0.1)
    T[:3, 3] *= 100.0
    gone = run_of(Problem(arm.chain, Goal.pose(T)))
    assert gone.go(BOXES, Watch()) == ENDED
    assert gone.seen == 0  # The gate is shut.
    found = run_of(Problem(arm.chain, wide))
    assert found.go(BOXES, Watch()) == FOUND
    assert np.isfinite(found.figures[UPPER])


def test_an_answer_is_told_once() -> None:
    """Of two given answers in one neighbourhood the second does not count, and no box in it is cut for a third."""
    arm = kinseek.load("puma560")
    q = np.random.default_rng(7).uniform(arm.lower, arm.upper)
    problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
    alone, twice = isolate(problem, [q]), isolate(problem, [q, q + 1e-8])
    assert alone.complete
    assert twice.complete
    assert (alone.given == 0).sum() == 1
    np.testing.assert_array_equal(twice.q, alone.q)
    np.testing.assert_array_equal(twice.given, alone.given)
    assert twice.boxes == alone.boxes
