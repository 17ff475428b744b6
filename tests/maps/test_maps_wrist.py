"""Where the hand wants the wrist: never out of reach where the arm is, often so where it cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinseek
from chains import beside
from kinseek import maps
from kinseek.maps.cells import EMPTY, Judge
from kinseek.maps.search import beyond, ruled_out
from kinseek.maps.wrist import circles


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "ur5e", "xarm7", "puma560", "jaco2_6", "irb120"])
def test_no_pose_of_the_arm_is_beyond(name: str) -> None:
    arm = kinseek.load(name)
    q = arm.sample(20_000, seed=1)
    q[::2] *= np.random.default_rng(1).random((len(q[::2]), arm.dof)) < 0.5  # Stretched in some joints.
    q = np.clip(q, arm.lower, arm.upper)
    T = arm.fk(q)
    assert circles(arm.chain)
    for position, orientation in ((0.0, 0.0), (1e-3, 1e-3), (0.05, 0.3), (0.3, 3.0)):
        around = beside(T, position, orientation, seed=2)
        for circle in circles(arm.chain):
            assert not circle.beyond(around, position, orientation).any()


def test_the_bound_is_as_long_as_a_stretched_arm() -> None:
    """A Panda's wrist is farthest from its shoulder where its elbow is straight but for the offsets there."""
    (first, second) = circles(kinseek.load("panda").chain)
    assert first.length == pytest.approx(np.hypot(0.316, 0.0825) + np.hypot(0.384, 0.0825))
    assert second.radius == pytest.approx(0.088)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5e"])
def test_it_says_no_to_most_of_what_the_gate_lets_through_in_vain(name: str) -> None:
    arm, rng = kinseek.load(name), np.random.default_rng(3)
    T = np.tile(np.eye(4), (4000, 1, 1))
    T[:, :3, 3] = rng.uniform(-1.0, 1.0, (len(T), 3)) * arm.chain.reach
    T[:, :3, :3] = Rotation.random(len(T), random_state=3).as_matrix()
    T = T[~ruled_out(arm, kinseek.Goal.pose(T))]
    goal = kinseek.Goal.pose(T)
    out, found = beyond(arm, goal.targets, goal), arm.ik(T).success
    assert not (out & found).any()
    assert out.sum() > 0.6 * (~found).sum()


def test_nothing_is_said_of_an_arm_that_slides_or_is_short() -> None:
    for name in ("cylindrical3", "scara4", "planar2"):
        assert circles(kinseek.load(name).chain) == []


def test_a_stack_at_the_edge_of_reach_is_proved_empty() -> None:
    """A Panda whose elbow would have to be longer: 10,000 boxes of joint values do not tell it."""
    arm = kinseek.load("panda")
    rings = maps.Rings((0.0, 1.2, 0.05), (-1.2, 1.2, 0.05), maps.orientations(12_000))
    direction = int(np.argmin(np.abs(rings.orientations.frames[:, :, 2] - [0.05, 0.89, 0.44]).sum(axis=1)))
    judge = Judge(kinseek.Arm(maps.first_joint.divided(arm.chain).chain), rings, 0, 1)
    assert judge.stack((7, 41), direction).known == EMPTY
