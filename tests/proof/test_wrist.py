"""A proof about the arm without its wrist: whatever reaches the goal must meet the question that is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from benchmarks.proof import unreachable
from chains import awkward_joints, poses
from kinseek import Goal, Problem
from kinseek.kernels.proof.progress import ENDED
from kinseek.proof.boxes import FIRST, excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict
from kinseek.proof.wrist import WRIST, without_wrist
from kinseek.robots.chain import SerialChain
from kinseek.robots.joints import Joint, serial_chain
from reference import errors, fk
from test_bounds import moved

Array = NDArray[np.float64]

WRISTS = ("puma560", "irb120", "kr6r900", "mh180", "pr2_left", "iiwa14", "gen3", "atlas_torso_arm")
"""Arms whose last three axes meet."""


def question_without_wrist(problem: Problem) -> Problem:
    easier = without_wrist(problem)
    assert easier is not None
    return easier


def missed(chain: SerialChain, q: Array, rng: np.random.Generator) -> bool:
    """Does the question without the wrist refuse joint values, (n,), that reach a goal at the edge of its tolerances?"""
    place, angle = 10.0 ** rng.uniform(-9, -0.5, 2)
    edge = 0.999999 * rng.integers(0, 2)
    T = moved(fk(chain, q), rng, edge * place, edge * angle)
    goal = Goal.pose(T, position_tolerance=place, orientation_tolerance=angle)
    easier = question_without_wrist(Problem(chain, goal))
    away, lean = errors(fk(easier.chain, q[: easier.chain.dof]), easier.goal)
    return away > easier.goal.position_tolerance or lean > easier.goal.orientation_tolerance + 1e-14


@pytest.mark.slow
@pytest.mark.parametrize("name", WRISTS)
def test_what_reaches_the_goal_meets_the_question_without_the_wrist(name: str) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(3)
    assert not any(missed(chain, awkward_joints(chain, rng), rng) for _ in range(100))


@pytest.mark.parametrize("name", ["ur5e", "panda", "xarm7", "scara4", "planar5", "planar2"])
def test_an_arm_without_a_wrist_has_no_such_question(name: str) -> None:
    arm = kinseek.load(name)
    assert without_wrist(Problem(arm.chain, Goal.pose(arm.fk(arm.lower)))) is None


def test_only_a_whole_pose_has_such_a_question() -> None:
    arm = kinseek.load("puma560")
    T = arm.fk(arm.lower)
    for goal in (Goal.position(T[:3, 3]), Goal.pointing(T[:3, 3], T[:3, 2])):
        assert without_wrist(Problem(arm.chain, goal)) is None


@st.composite
def wristed(draw: st.DrawFn) -> SerialChain:
    """A random arm of turns whose last three axes meet, or all but meet, at any angles."""
    joints: list[Joint] = []
    axis = np.array([0.0, 0.0, 1.0])

    def add(origin: Array) -> None:
        lower = draw(st.floats(-4, 2))
        name = f"j{len(joints)}"
        joints.append(Joint(name, "revolute", origin, axis, lower, lower + draw(st.floats(0, 6))))

    for _ in range(draw(st.integers(2, 4))):
        add(draw(poses()))
    add(draw(poses()))
    before = np.eye(4)
    before[2, 3] = -draw(
        st.floats(-1, 1)
    )  # Where along its axis a joint stands says nothing of where the axes meet.
    for _ in range(WRIST - 1):
        frame = draw(poses())
        frame[:3, 3] *= 10.0 ** -draw(st.integers(3, 16))
        frame[:3, 3] += frame[:3, 2] * draw(st.floats(-1, 1))
        add(np.linalg.inv(before) @ frame)
        before = frame
    return serial_chain(joints, draw(poses()), name="wristed", base="base", tip="tip")


@pytest.mark.slow
@given(chain=wristed(), seed=st.integers(0, 2**32 - 1))
def test_any_wrist_keeps_what_reaches(chain: SerialChain, seed: int) -> None:
    rng = np.random.default_rng(seed)
    if without_wrist(Problem(chain, Goal.pose(fk(chain, chain.lower)))) is None:
        return
    assert not any(missed(chain, awkward_joints(chain, rng), rng) for _ in range(5))


@pytest.mark.slow
@pytest.mark.parametrize("name", WRISTS)
def test_the_cone_is_no_wider_than_the_middle_joint_makes_it(name: str) -> None:
    """Its edge is where the middle joint's range ends or the axes are farthest apart: some joint value comes near it."""
    arm = kinseek.load(name)
    chain, rng = arm.chain, np.random.default_rng(0)
    for _ in range(5):
        ends = np.sort(rng.uniform(chain.lower[-2], chain.upper[-2], 2))
        lower, upper = chain.lower.copy(), chain.upper.copy()
        lower[-2], upper[-2] = ends
        narrow = replace(chain, lower=lower, upper=upper)
        q = np.tile(rng.uniform(lower, upper), (2001, 1))
        q[:, -2] = np.linspace(ends[0], ends[1], 2001)
        goal = Goal.pose(narrow.forward(q[:1])[0], position_tolerance=0.0, orientation_tolerance=0.0)
        easier = question_without_wrist(Problem(narrow, goal))
        # As the middle joint turns, the last axis leans; as seen from the goal, the first axis does.
        leans = []
        for each in q[::50]:
            there = Goal.pose(fk(narrow, each), position_tolerance=0.0, orientation_tolerance=0.0)
            asked = question_without_wrist(Problem(narrow, there))
            leans.append(errors(fk(asked.chain, each[: asked.chain.dof]), asked.goal)[1])
        assert max(leans) == pytest.approx(easier.goal.orientation_tolerance, abs=2e-2)


@pytest.mark.slow
@pytest.mark.parametrize("name", WRISTS)
def test_the_boxes_without_the_wrist_never_exclude_what_is_in_reach(name: str) -> None:
    """At the edge of what the arm reaches: stretched, its wrist's middle joint at a limit."""
    arm, rng = kinseek.load(name), np.random.default_rng(5)
    for trial in range(60):
        q = awkward_joints(arm.chain, rng)
        if trial % 2:
            q[-2] = rng.choice([arm.lower[-2], arm.upper[-2]])
        place, angle = 10.0 ** rng.uniform(-6, -2, 2)
        T = moved(arm.fk(q), rng, 0.999 * place, 0.999 * angle)
        problem = Problem(arm.chain, Goal.pose(T, position_tolerance=place, orientation_tolerance=angle))
        assert excluded(question_without_wrist(problem), 3000, threads=1).outcome != ENDED, q


@pytest.mark.slow
def test_ten_joints_are_proved() -> None:
    """Near misses, by 13 mm or by 1.3°: of most two million boxes of the whole arm decide nothing, or nearly as many do."""
    arm = kinseek.load("atlas_torso_arm")
    for problem, answer in unreachable(arm, 75, 11):
        found = prove(problem, solution=answer, budget=400_000)
        assert found.verdict is Verdict.UNREACHABLE
        assert found.boxes < 200_000


@pytest.mark.slow
def test_few_boxes_need_no_such_question() -> None:
    """What a first look decides is decided as ever; beyond it boxes of both questions count."""
    arm = kinseek.load("gen3")
    boxes = [prove(problem, solution=answer).boxes for problem, answer in unreachable(arm, 40, 11)]
    assert min(boxes) == 0
    assert FIRST < max(boxes) < 10_000
