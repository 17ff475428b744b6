"""One goal without ranges is answered by a short way: the same bits as the long way gives, and the same words on misuse."""

from __future__ import annotations

import copy
import pickle
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal
from kinseek.errors import InvalidGoal, InvalidProblem, UnitWarning
from kinseek.problem import Problem
from kinseek.solvers.atlas import solver

TOOL = kinseek.pose([0.02, -0.01, 0.1], rpy=[0.3, -0.2, 1.0])
BASE = kinseek.pose([-0.2, 0.1, 0.05], rpy=[0.0, 0.1, -0.4])
OPTIONS: dict[str, dict[str, Any]] = {
    "usual": {},
    "tool": {"tool": TOOL},
    "base": {"base": BASE},
    "coarse": {"position_tolerance": 1e-3, "orientation_tolerance": 1e-2},
    "exact": {"position_tolerance": 0, "orientation_tolerance": 1e-9},
    "weights": {"position_weight": 3, "orientation_weight": np.float32(0.2)},
}
NAMED = (
    "q",
    "success",
    "position_error",
    "orientation_error",
    "weighted_error",
    "evaluations",
    "nodes_created",
    "out_of_time",
)


def goals(T: np.ndarray, options: dict[str, Any]) -> list[Goal]:
    return [
        Goal.position(T[:3, 3], **options),
        Goal.pointing(T[:3, 3], T[:3, 0], (1.0, 0.0, 0.0), **options),
        Goal.pose(T, free="rz", **options),
        Goal.pose(T, **options),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
@pytest.mark.parametrize("name", ["ur5e", "panda", "scara4"])
def test_the_short_way_gives_the_bits_of_the_long_one(name: str, options: dict[str, Any]) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(5)
    for scale in (1.0, 1.0, 1.0, 1.1, 3.0):
        q, near = rng.uniform(arm.lower, arm.upper, (2, arm.dof))
        T = arm.fk(q)
        T[:3, 3] *= scale
        for goal in goals(T, options):
            for start in (None, near):
                short = arm.ik(goal, near=start)
                long = kinseek.Atlas().solve(Problem(arm.chain, goal, start))
                for field in NAMED:
                    mine, other = getattr(short, field), getattr(long, field)
                    assert np.array_equal(mine, other), (field, goal)
                    assert type(mine) is type(other), field
                assert short.problem.goal is goal
                assert short.status is long.status
                assert short.require() is short if short.success else True


def test_a_function_and_a_batch_and_a_class_of_its_own_go_the_long_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Own(Goal):
        pass

    def never(*given: Any) -> None:
        raise AssertionError("the short way")

    arm, p = kinseek.load("scara4"), np.array([0.3, 0.2, 0.1])
    monkeypatch.setattr("kinseek.arm.solve_quickly", never)
    for goal in (Own.position(p), Goal.position(p[None]), Goal.position(p, free="z")):
        arm.ik(goal)
    for more in ({"time_limit": 1.0}, {"trace": True}, {"solver": kinseek.Atlas()}, {"prove": True}):
        arm.ik(Goal.position(p), **more)
    with pytest.raises(AssertionError, match="the short way"):
        arm.ik(Goal.position(p))


def test_what_is_missed_under_wide_tolerances_is_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(solver.Atlas, "_retry_missed", lambda *given: asked.append(given))
    arm = kinseek.load("ur5e")
    for _ in range(2):  # The first that is out of reach goes the long way: a kernel is lacking yet.
        asked.clear()
        arm.ik(Goal.pose(kinseek.pose([3.0, 0.0, 0.0]), orientation_tolerance=1e-6))
    assert not asked
    arm.ik(Goal.pose(kinseek.pose([3.0, 0.0, 0.0]), orientation_tolerance=1e-2))
    assert asked


def test_the_caller_may_write_the_next_start_into_the_same_array() -> None:
    arm, near = kinseek.load("ur5e"), np.full(6, 0.5)
    solution = arm.ik(Goal.position([0.4, 0.1, 0.3]), near=near)
    near[:] = 9.0
    assert solution.problem.near is not None
    assert np.array_equal(solution.problem.near, np.full(6, 0.5))


def test_a_pose_may_lie_in_memory_column_by_column() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk([0.3, -1.0, 1.2, 0.4, 0.8, -0.2])
    for kind in ("pose", "position"):
        other = arm.ik(Goal(np.asfortranarray(T), kind=kind))
        assert np.array_equal(other.q, arm.ik(Goal(T, kind=kind)).q)


def test_a_start_that_does_not_fit_is_refused_in_the_same_words() -> None:
    arm, goal = kinseek.load("ur5e"), Goal.position([0.4, 0.1, 0.3])
    for near, words in (
        (np.zeros((2, 6)), r"near must have shape \(6,\), got \(2, 6\): the goal is one target"),
        (np.zeros(5), r"near must have shape \(6,\)"),
        (np.full(6, np.nan), "near contains NaN or infinity"),
        (np.full(6, 1e9), "near must lie within 1e\\+07"),
    ):
        with pytest.raises(InvalidProblem, match=words):
            arm.ik(goal, near=near)


def test_a_place_in_millimetres_is_asked_about() -> None:
    arm = kinseek.load("ur5e")
    with pytest.warns(UnitWarning, match="if these are millimetres, divide by 1000") as told:
        arm.ik(Goal.position([400.0, 100.0, 300.0]))
    assert [each.filename for each in told] == [__file__]


def test_pickles_and_copies_of_an_arm_leave_its_atlases_behind() -> None:
    arm, goal = kinseek.load("scara4"), Goal.position([0.3, 0.2, 0.1])
    first = arm.ik(goal)
    for other in (copy.copy(arm), pickle.loads(pickle.dumps(arm))):
        assert np.array_equal(other.ik(goal).q, first.q)
    moved = arm.with_tool(TOOL).ik(goal)
    assert moved.success
    assert not np.array_equal(moved.q, first.q)


@pytest.mark.parametrize(
    "place",
    [np.array([0.3, 0.2, 0.1]), [0.3, 0.2, 0.1], (0.3, 0.2, 0.1), np.array([9.0, 0.3, 0.2, 0.1])[1:]],
    ids=["array", "list", "tuple", "part"],
)
def test_a_place_that_is_plain_makes_the_same_goal(place: Any) -> None:
    quick, slow = Goal.position(place), Goal(kinseek.pose([0.3, 0.2, 0.1]), kind="position")
    for field in fields(Goal):
        assert np.array_equal(getattr(quick, field.name), getattr(slow, field.name))
        assert field.name in vars(quick)
    assert repr(quick) == repr(slow) == repr(pickle.loads(pickle.dumps(quick)))
    assert quick.target.flags.owndata
    assert replace(quick, position_tolerance=1e-3).position_tolerance == 1e-3
    with pytest.raises(InvalidGoal, match="position_tolerance"):
        replace(quick, position_tolerance=-1.0)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ([0.0, 0.0, np.nan], "position contains NaN or infinity"),
        (np.array([0.0, -np.inf, 0.0]), "position contains NaN or infinity"),
        ([0.0, 1e8, 0.0], "must lie within 1e\\+07 m of the origin"),
        (np.array([0.0, 1e8, 0.0]), "must lie within 1e\\+07 m of the origin"),
        ([0.0, 0.0], r"position must have shape \(3,\)"),
        (np.zeros(4), r"position must have shape \(3,\)"),
        (["a", "b", "c"], "position must be numbers"),
        ([0.0, 0.0, None], "position"),
        (np.array([1.0, 1j, 0.0]), "imaginary part"),
        (np.ma.MaskedArray([0.1, 0.2, 0.3], [True, False, False]), "1 of 3 numbers are masked"),
        (0.5, r"position must have shape \(3,\)"),
    ],
)
def test_a_place_that_is_none_is_refused(place: Any, words: str) -> None:
    with pytest.raises(InvalidGoal, match=words):
        Goal.position(place)


@pytest.mark.parametrize(
    "place",
    [
        [0, 1, 2],
        np.array([0, 1, 2]),
        np.array([0.0, 1.0, 2.0], dtype=">f8"),
        np.array([0, 1, 2], dtype=np.float32),
        [True, 1, 2],
    ],
    ids=["whole", "int64", "other bytes", "float32", "truth"],
)
def test_other_numbers_are_read_with_more_care(place: Any) -> None:
    goal = Goal.position(place)
    assert np.array_equal(goal.target[:3, 3], np.asarray(place, dtype=float))
    assert goal.target.dtype == np.dtype(np.float64)


def test_free_axes_and_options_are_looked_at_all_the_same() -> None:
    with pytest.raises(InvalidGoal, match="every axis is free"):
        Goal.position([0.1, 0.2, 0.3], free=("x", "y", "z"))
    with pytest.raises(InvalidGoal, match="position_tolerance"):
        Goal.position([0.1, 0.2, 0.3], position_tolerance=float("nan"))
    with pytest.raises(InvalidGoal, match="box must map axes"):
        Goal.position([0.1, 0.2, 0.3], box=3)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        Goal.position([0.1, 0.2, 0.3], colour="red")  # type: ignore[call-arg]
