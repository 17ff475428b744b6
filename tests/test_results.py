"""Results as Python objects: truth, length, items, copies, help, and nothing that is not there."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import pydoc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, InvalidProblem, InvalidUse, KinseekError, Problem, Solution, Status

Array = NDArray[np.float64]
ARM = kinseek.load("scara4")
NO_COLUMNS = ("q", "problem", "_trace", "_contacts")
COLUMNS = [each.name for each in dataclasses.fields(Solution) if each.name not in NO_COLUMNS]


def batch_of(shape: tuple[int, ...], **options: Any) -> Solution:
    q = ARM.sample(int(np.prod(shape)), seed=5).reshape(*shape, 4)
    T = ARM.fk(q)
    T.reshape(-1, 4, 4)[::3, 0, 3] += 9.0  # Every third is out of reach.
    return ARM.ik(T, near=q, **options)


# --- truth ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solution", [ARM.ik(kinseek.pose([9, 0, 0])), batch_of((3,)), batch_of((0,))])
def test_a_solution_has_no_truth_value(solution: Solution) -> None:
    with pytest.raises(InvalidUse, match=r"use solution\.success") as caught:
        bool(solution)
    assert isinstance(caught.value, KinseekError)
    assert isinstance(caught.value, TypeError)


def test_branches_are_true_where_there_is_an_answer() -> None:
    T = ARM.fk(np.full(4, 0.2))
    assert ARM.branches(T)
    assert not ARM.branches(kinseek.pose([9, 0, 0]))


# --- length, items, iteration ---------------------------------------------------------------------------------------


def same(one: Solution, batch: Solution, at: Any) -> None:
    np.testing.assert_array_equal(one.q, batch.q[at])
    np.testing.assert_array_equal(one.problem.goal.target, batch.problem.goal.target[at])
    near = batch.problem.near
    assert near is not None
    np.testing.assert_array_equal(one.problem.near, near[at])
    for name in (*COLUMNS, "status"):
        np.testing.assert_array_equal(getattr(one, name), getattr(batch, name)[at])


def test_a_batch_can_be_counted_indexed_and_walked() -> None:
    batch = batch_of((7,))
    assert len(batch) == 7
    assert batch.success.any()
    assert not batch.success.all()
    for i, one in enumerate(batch):
        same(one, batch, i)
        kinds = [
            type(getattr(one, name)) for name in ("success", "position_error", "evaluations", "rejected")
        ]
        assert kinds == [bool, float, int, int]
        assert isinstance(one.status, Status)
    same(batch[-1], batch, -1)
    for some in (slice(2, 5), slice(None, None, -2), ~batch.success, [4, 1], slice(3, 3)):
        part = batch[some]
        assert isinstance(part, Solution)
        assert len(part) == len(batch.q[some])
        same(part, batch, some)
    assert [one.success for one in batch[2:5]] == batch.success[2:5].tolist()


def test_a_batch_of_two_dimensions_is_indexed_as_its_arrays_are() -> None:
    batch = batch_of((2, 3))
    assert len(batch) == 2
    same(batch[1], batch, 1)
    same(batch[1, 2], batch, (1, 2))
    same(batch[:, 1], batch, (slice(None), 1))
    assert [one.q.shape for one in batch] == [(3, 4), (3, 4)]
    assert isinstance(batch[1, 2].success, bool)
    for one, at in zip(batch.each(), np.ndindex(2, 3), strict=True):
        same(one, batch, at)


def test_parts_of_a_batch_are_solved_to_the_same_bits() -> None:
    batch = batch_of((6,))
    again = ARM.ik(batch[1:4].problem.goal, near=batch[1:4].problem.near)
    np.testing.assert_array_equal(again.q, batch[1:4].q)


def test_a_start_for_all_is_one_for_each_part() -> None:
    q = ARM.sample(3, seed=6)
    batch = ARM.ik(ARM.fk(q), near=q[0])
    for part in (batch[1], batch[1:]):
        np.testing.assert_array_equal(np.atleast_2d(np.asarray(part.problem.near))[0], q[0])


def test_one_answer_is_no_sequence() -> None:
    one: Any = ARM.ik(ARM.fk(np.full(4, 0.2)))
    for use in (len, iter, list, lambda it: it[0], lambda it: it[1:]):
        with pytest.raises(InvalidUse, match=r"solution for one target.*solution\.q"):
            use(one)
    assert list(one.each()) == [one]


def test_what_is_no_index_and_what_is_out_of_range() -> None:
    batch: Any = batch_of((3,))
    with pytest.raises(IndexError, match=r"out of bounds.*shape \(3,\)"):
        batch[3]
    with pytest.raises(IndexError, match=r"boolean index.*shape \(3,\)"):
        batch[np.ones(4, dtype=bool)]
    for wrong in ("q", 1.5):
        with pytest.raises(InvalidUse, match="integers, slices and masks"):
            batch[wrong]


# --- attributes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(1,), (3,), (2, 3), (0,), (2, 0)])
@pytest.mark.parametrize(
    "solver",
    [kinseek.Atlas(), kinseek.CoordinateDescent(), kinseek.DivideAndConquer(), kinseek.Polished()],
    ids=lambda solver: type(solver).__name__,
)
def test_every_field_of_a_batch_has_its_shape(solver: kinseek.Solver, shape: tuple[int, ...]) -> None:
    batch = batch_of(shape, solver=solver)
    assert batch.q.shape == (*shape, 4)
    assert {getattr(batch, name).shape for name in (*COLUMNS, "status")} == {shape}
    assert batch.success.dtype == bool
    assert f"{batch.success.sum()} of {batch.success.size} solved" in repr(batch)


@pytest.mark.parametrize("make", [ARM.ik, lambda T: ARM.ik(T, near=np.zeros(4)), ARM.branches])
def test_the_problem_is_made_when_it_is_asked_for_and_once(make: Any) -> None:
    T = ARM.fk(np.full(4, 0.2))
    result = make(T)
    for other in (copy.copy(result), copy.deepcopy(result), pickle.loads(pickle.dumps(result))):
        assert "problem" not in vars(other)
        np.testing.assert_array_equal(other.problem.goal.target, T)
    assert result.problem is result.problem
    np.testing.assert_array_equal(dataclasses.replace(result, rejected=3).problem.goal.target, T)
    assert not hasattr(result, "sucess")
    with pytest.raises(AttributeError, match="'sucess'"):
        _ = result.sucess
    with pytest.raises(dataclasses.FrozenInstanceError):
        result.problem = None


def test_the_problem_belongs_to_an_object() -> None:
    with pytest.raises(AttributeError, match="in each object alone"):
        _ = getattr(Solution, "problem")  # noqa: B009
    with pytest.raises(TypeError, match="'problem'"):
        Solution(*[np.zeros(1)] * 8)  # type: ignore[arg-type]


def test_near_for_one_goal_names_one_shape() -> None:
    T = ARM.fk(np.zeros(4))
    with pytest.raises(
        InvalidProblem, match=r"near must have shape \(4,\), got \(2, 4\): the goal is one target"
    ):
        Problem(ARM.chain, Goal.pose(T), np.zeros((2, 4)))
    with pytest.raises(InvalidProblem, match=r"near must have shape \(4,\) or \(3, 4\), got \(2, 4\)"):
        Problem(ARM.chain, Goal.pose([T] * 3), np.zeros((2, 4)))


# --- help and text --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cls", [kinseek.Solution, kinseek.Branches, kinseek.BranchesBatch])
def test_help_shows_every_field(cls: type[Any]) -> None:
    shown = pydoc.render_doc(cls, renderer=pydoc.plaintext)  # type: ignore[attr-defined]
    listed = (inspect.getdoc(cls) or "").split("Attributes:\n")[1].split("\n\n")[0]
    told = [
        line.split(":")[0].strip()
        for line in listed.splitlines()
        if line.startswith(" " * 4 + line.strip()[0])
    ]
    assert told == [each.name.lstrip("_") for each in dataclasses.fields(cls)]
    lines = {
        name: line
        for name in told
        for line in shown.splitlines()
        if f"      {name}: " in line and line[-1] != ","
    }
    assert set(lines) == set(told)
    for name, unit in {"q": "[rad] or [m]", "position_error": "[m]", "orientation_error": "[rad]"}.items():
        assert name not in lines or unit in lines[name]


T = kinseek.pose([0.4, 0.1, 0.5], rpy=[3.0, 0.2, -0.1])


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        (Goal.pose(T), "Goal(pose at [0.4, 0.1, 0.5] m, rpy [3, 0.2, -0.1] rad)"),
        (
            Goal.pose(kinseek.pose([0, 0, 0], rpy=[0.3, np.pi / 2, 0]), orientation_weight=2),
            "Goal(pose at [0, 0, 0] m, rpy [0.3, 1.5708, 0] rad, orientation_weight=2)",
        ),
        (
            Goal.pose([T, T], position_tolerance=1e-3),
            "Goal(pose, batch of shape (2,), position_tolerance=0.001 m)",
        ),
        (
            Goal.position([1, 2, 3], orientation_tolerance=0.1, tool=T),
            "Goal(position at [1, 2, 3] m, orientation_tolerance=0.1 rad, tool)",
        ),
        (
            Goal.pointing([1, 2, 3], [0, 0, -2]),
            "Goal(pointing at [1, 2, 3] m, tool axis [0, 0, 1] along [0, 0, -1])",
        ),
        (
            Goal.pose(T, free="y", box={"x": (-0.01, 0.02)}, frame="base"),
            "Goal(pose at [0.4, 0.1, 0.5] m, rpy [3, 0.2, -0.1] rad, x within [-0.01, 0.02], y free, frame='base')",
        ),
    ],
)
def test_a_goal_is_one_line(goal: Goal, text: str) -> None:
    assert repr(goal) == text
