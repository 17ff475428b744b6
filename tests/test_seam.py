"""A continuous joint has no limits and no seam: answers near a start come within half a turn of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal
from kinseek.problem import Problem
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import rotation, transform

Array = NDArray[np.float64]

ENDLESS = ("gen3", "jaco2_6")


def turning(arm: kinseek.Arm) -> NDArray[np.bool_]:
    return np.asarray(np.array(arm.kinds) == "continuous")


def curves(arm: kinseek.Arm, steps: int, seed: int) -> Array:
    """Joint values along a smooth curve that carries continuous joints over ±π and on, (steps, n)."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, steps)[:, None]
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    swing = middle + 0.5 * half * np.sin(
        2 * np.pi * (s * rng.uniform(0.3, 1.0, arm.dof) + rng.random(arm.dof))
    )
    onward = rng.uniform(-np.pi, np.pi, arm.dof) + s * rng.choice([-1, 1], arm.dof) * rng.uniform(
        4, 10, arm.dof
    )
    return np.asarray(np.where(turning(arm), onward, swing))


def inside(arm: kinseek.Arm, q: Array, near: Array) -> bool:
    """Limited joints inside their limits, continuous joints within half a turn of near."""
    low = np.where(turning(arm), near - np.pi, arm.lower)
    high = np.where(turning(arm), near + np.pi, arm.upper)
    return bool(((q >= low) & (q <= high)).all())


@pytest.mark.slow
@pytest.mark.parametrize("name", ENDLESS)
@pytest.mark.parametrize("seed", range(4))
def test_tracked_poses_never_jump_over_the_seam(name: str, seed: int) -> None:
    arm = kinseek.load(name)
    path = curves(arm, 1000, seed)
    assert (np.abs(path[:, turning(arm)]) > np.pi).any()
    q = path[0]
    for target in arm.fk(path):
        solution = arm.ik(target, near=q)
        assert solution.success
        step = np.abs(solution.q - q)[turning(arm)]
        assert (step <= np.pi).all()
        assert inside(arm, solution.q, q)
        # Another branch: the walk met a singularity; go on from the curve.
        if np.abs(solution.q - q).max() > 1.0:
            near = path[np.argmin(np.abs(arm.fk(path) - target).max(axis=(1, 2)))]
            solution = arm.ik(target, near=near)
        q = solution.q


@pytest.mark.slow
@pytest.mark.parametrize("turns", [0, 1, -3, 1000])
def test_every_path_answers_within_half_a_turn_of_near(turns: int) -> None:
    arm = kinseek.load("gen3")
    near = np.where(turning(arm), 3.13 + 2 * np.pi * turns, 0.5)
    target = arm.fk(np.where(turning(arm), 3.16, 0.52))
    batch = np.array([target] * 3)
    many: Any = arm.branches(batch, near=near)
    answers = [
        arm.ik(target, near=near).q,
        arm.ik(Goal.pose(target), near=near).q,
        *arm.ik(batch, near=near).q,
        *arm.ik(batch, near=np.array([near] * 3)).q,
        arm.ik(Goal.pose(target, free="rz"), near=near).q,
        arm.ik(Goal.pose(target, box={"x": (-1e-3, 1e-3)}), near=near).q,
        *arm.ik(Goal.pose(batch, free="rz"), near=near).q,
        arm.ik(Goal.position(target[:3, 3]), near=near).q,
        *arm.branches(target, near=near).q,
        *many[1].q,
    ]
    for q in answers:
        assert inside(arm, q, near)
    assert np.abs(answers[0] - near).max() < 0.2
    np.testing.assert_array_equal(answers[0], answers[2])


@pytest.mark.parametrize(
    "solver",
    [kinseek.CoordinateDescent(), kinseek.BlindSearch(), kinseek.Polished(kinseek.CoordinateDescent())],
    ids=lambda solver: type(solver).__name__,
)
def test_local_searches_stay_near_their_start(solver: Any) -> None:
    arm = three_endless()
    near = np.array([3.13, 0.4, -3.12])
    target = arm.fk(near + np.array([0.03, 0.02, -0.04]))
    solution = arm.ik(target, near=near, solver=solver)
    assert solution.position_error < 1e-3
    assert np.abs(solution.q - near).max() < 0.2
    assert inside(arm, solution.q, near)


def three_endless() -> kinseek.Arm:
    """A planar arm of three continuous joints."""
    return kinseek.Arm.from_dh([[1.0, 0, 0, 0]] * 3, [-np.inf] * 3, [np.inf] * 3)


@pytest.mark.slow
def test_without_near_a_continuous_joint_stays_within_half_a_turn_of_zero() -> None:
    arm = three_endless()
    targets = arm.fk(np.random.default_rng(1).uniform(-np.pi, np.pi, (50, 3)))
    for solver in (None, kinseek.CoordinateDescent(), kinseek.Polished()):
        q = arm.ik(targets, solver=solver).q
        assert (np.abs(q) <= np.pi).all()
    for prefer in ("mid-range", "dexterity", "limits"):
        gen3 = kinseek.load("gen3")
        poses = gen3.fk(np.random.default_rng(2).uniform(gen3.lower, gen3.upper, (5, 7)))
        q = gen3.ik(poses, prefer=prefer).q
        assert ((q >= gen3.lower) & (q <= gen3.upper)).all()


def test_branches_near_a_start_are_sorted_and_proved_near_it() -> None:
    arm = kinseek.load("jaco2_6")
    q = np.where(turning(arm), 3.16, np.clip(2.0, arm.lower, arm.upper))
    target, near = arm.fk(q), np.where(turning(arm), 3.13, np.clip(2.0, arm.lower, arm.upper))
    wishes: list[dict[str, Any]] = [{}, {"prove": True}, {"copies": True}]
    for options in wishes:
        branches = arm.branches(target, near=near, **options)
        assert len(branches)
        assert all(inside(arm, row, near) for row in branches.q)
        gaps = np.linalg.norm(branches.q - near, axis=1)
        assert (np.diff(gaps) >= -1e-9).all()
        assert gaps[0] < 0.2


def test_a_continuous_joint_of_a_function_has_no_seam() -> None:
    arm = three_endless()
    box = kinseek.Arm.from_fk(arm.fk, [0] * 3, [0] * 3, kinds="continuous")
    near = np.array([3.13, 0.4, -3.12])
    target = arm.fk(near + np.array([0.03, 0.02, -0.04]))
    for solver in (None, kinseek.CoordinateDescent()):
        solution = box.ik(Goal.position(target[:3, 3]), near=near, solver=solver)
        assert np.abs(solution.q - near).max() <= np.pi
    assert np.abs(box.ik(target, near=near).q - near).max() < 0.2


def test_a_follower_of_half_turns_keeps_its_leader_where_it_is() -> None:
    """A full turn of such a joint is another pose, so it is left out."""
    joints = [
        Joint("a", "continuous", np.eye(4), np.eye(3)[2], 0.0, 0.0),
        Joint("b", "continuous", transform(np.eye(3), [1, 0, 0]), np.eye(3)[2], 0.0, 0.0, "a", 0.5),
        Joint("c", "revolute", transform(rotation(np.eye(3)[0], 1.0), [1, 0, 0]), np.eye(3)[2], -1.0, 1.0),
    ]
    arm = kinseek.Arm(serial_chain(joints, transform(np.eye(3), [1, 0, 0]), name="m", base="b", tip="t"))
    problem = Problem(arm.mechanism, Goal.pose(np.eye(4)), np.array([9.0, 0.0]))
    np.testing.assert_array_equal(problem.placed(np.array([-3.0, 0.5])), [-3.0, 0.5])
    target = arm.fk([-3.0, 0.5])
    solution = arm.ik(target, near=[3.3, 0.5])
    assert solution.success
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()


def test_preferences_pass_the_seam_of_a_start() -> None:
    arm = kinseek.load("gen3")
    near = np.where(turning(arm), 3.13, 0.5)
    target = arm.fk(np.where(turning(arm), 3.16, 0.52))
    solution = arm.ik(target, near=near, valid=lambda q: bool(q[0] > 0.0))
    assert solution.success
    assert inside(arm, solution.q, near)
    assert np.abs(solution.q - near)[turning(arm)].max() < 1.0
