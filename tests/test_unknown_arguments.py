"""Arguments that a call does not have raise an error that names kinseek's own argument."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal, InvalidUse
from kinseek.tolerances import GoalOptions
from kinseek.unknown_arguments import _FOREIGN, _PLACES, unknown_argument

ARM: Any = kinseek.load("ur5e")
T = kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0, 0])
Q = np.zeros(6)

# Keyword arguments of TRAC-IK, ikpy, Robotics Toolbox, MoveIt, pinocchio's examples, OptIK, PyBullet and others.
FOREIGN: list[tuple[Any, tuple[Any, ...], str, str]] = [
    *((ARM.ik, (T,), word, "near=") for word in ("seed", "q_init", "qinit", "q0", "x0", "initial_position")),
    *((ARM.ik, (T,), word, "near=") for word in ("seed_state", "restPoses", "currentPositions")),
    *((ARM.ik, (T,), word, "time_limit=") for word in ("timeout", "max_time", "max_iterations", "ilimit")),
    *((ARM.ik, (T,), word, "position_tolerance=") for word in ("tol", "eps", "epsilon", "residualThreshold")),
    *((ARM.ik, (T,), word, "free=") for word in ("mask", "orientation_mode", "bounds")),
    (ARM.ik, (T,), "joint_limits", "arm.with_limits("),
    (kinseek.load, ("ur5e",), "joint_limits", "limits="),
    (ARM.ik, (T,), "avoid_collisions", "scene="),
    (ARM.ik, (T,), "consistency_limits", "valid="),
    (ARM.ik, (T,), "n_jobs", "threads="),
    (ARM.ik, (T,), "elbow", "prefer="),
    (ARM.ik, (T,), "damping", "no such setting"),
    (ARM.branches, (T,), "seed", "near="),
    (ARM.branches, (T,), "max_solutions", "count="),
    (ARM.follow, (T[None],), "q0", "start="),
    (ARM.follow, (T[None],), "jump_threshold", "max_step="),
    (ARM.follow, (T[None],), "timeout", "time_limit="),
    (ARM.follow_stream, (T[None],), "seed", "start="),
    (ARM.prove, (T,), "max_iter", "budget="),
    (ARM.track, (Q,), "dt", "period="),
    (kinseek.load, ("ur5e",), "ee_link", "tip="),
    (kinseek.load, ("ur5e",), "base_link_name", "base="),
    (kinseek.load, ("f.xacro",), "mappings", "args="),
    (kinseek.pose, ([0, 0, 0],), "quat", "quat_wxyz= or quat_xyzw="),
    (kinseek.pose, ([0, 0, 0],), "quaternion", "quat_wxyz= or quat_xyzw="),
    (kinseek.pose, ([0, 0, 0],), "R", "rotation="),
    (kinseek.pose, ([0, 0, 0],), "euler", "rpy="),
    (Goal.pose, (T,), "tol", "position_tolerance= or orientation_tolerance="),
    (Goal.pose, (T,), "mask", "free= or box="),
    (Goal.position, ([0, 0, 0],), "tolerance", "position_tolerance="),
    (Goal.pointing, ([0, 0, 0], [0, 0, 1]), "tcp", "tool="),
]


@pytest.mark.parametrize(
    ("call", "given", "word", "ours"), FOREIGN, ids=[f"{row[0].__name__}-{row[2]}" for row in FOREIGN]
)
def test_words_of_other_libraries_are_answered_with_ours(
    call: Any, given: tuple[Any, ...], word: str, ours: str
) -> None:
    with pytest.raises(InvalidUse) as raised:
        call(*given, **{word: 1})
    named = str(raised.value).partition(" Valid: ")[0]
    assert f"{call.__name__}() has no argument {word!r}; " in named
    assert ours in named


def test_the_message_lists_every_unknown_argument_and_the_valid_ones() -> None:
    with pytest.raises(InvalidUse) as raised:
        ARM.prove(T, timeout=1, budgett=2)
    assert str(raised.value) == (
        "prove() has no argument 'timeout'; kinseek calls it time_limit=. prove() has no argument 'budgett'; did "
        "you mean budget=? Valid: goal=, gap=, budget=, threads=, time_limit="
    )


@pytest.mark.parametrize(
    ("call", "given", "word", "place"),
    [
        (ARM.ik, (T,), "free", "it belongs to kinseek.Goal.pose(T, free="),
        (ARM.ik, (T,), "tool", "it belongs to kinseek.Goal.pose(T, tool="),
        (ARM.ik, (T,), "count", "it belongs to arm.branches(T, count="),
        (ARM.follow, (T[None],), "near", "it belongs to arm.ik(T, near="),
        (Goal.pose, (T,), "near", "it belongs to arm.ik(T, near="),
        (Goal.pose, (T,), "quat", "kinseek.pose(p, quat_wxyz=…) or kinseek.pose(p, quat_xyzw=…)"),
    ],
)
def test_arguments_of_another_call_are_answered_with_that_call(
    call: Any, given: tuple[Any, ...], word: str, place: str
) -> None:
    with pytest.raises(InvalidUse, match="has no argument") as raised:
        call(*given, **{word: 1})
    assert place in str(raised.value)


def test_names_without_resemblance_get_the_valid_ones_only() -> None:
    with pytest.raises(InvalidUse, match=r"^ik\(\) has no argument 'xyzzy'\. Valid: goal=, near=, "):
        ARM.ik(T, xyzzy=1)


def test_misspelt_arguments_raise_a_type_error_as_in_python() -> None:
    with pytest.raises(TypeError, match=r"'neer'; did you mean near="):
        ARM.ik(T, neer=Q)


def test_every_word_has_one_answer_and_every_answer_exists() -> None:
    words = [word for group in _FOREIGN for word in group.words.split()]
    assert len(words) == len(set(words))
    assert all(word == word.replace("_", "").lower() for word in words)
    assert {one for group in _FOREIGN for one in group.ours} <= set(_PLACES)


def test_no_call_answers_one_of_its_own_arguments() -> None:
    """A place that the table names has the argument, so the advice can be followed."""
    calls: dict[str, Any] = {
        "kinseek.Goal.pose": Goal.pose,
        "kinseek.load": kinseek.load,
        "kinseek.pose": kinseek.pose,
        "kinseek.interpolate": kinseek.interpolate,
        **{f"arm.{name}": getattr(ARM, name) for name in ("ik", "branches", "prove", "follow", "track")},
    }
    for name, place in _PLACES.items():
        call = calls.get(place.partition("(")[0])
        if call is not None and f"{name}=" in place:
            assert name in {*inspect.signature(call).parameters, *GoalOptions.__annotations__}, place


def test_the_error_can_be_made_for_any_function() -> None:
    def plan(goal: object, *, near: object = None) -> None: ...

    assert str(unknown_argument(plan, ["seed"])).endswith(
        "plan() has no argument 'seed'; kinseek calls it near=. Valid: goal=, near="
    )
