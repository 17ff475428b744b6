"""Forward kinematics and error kernels against their plain twins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import serial_chains
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.pose_error import judge
from kinseek.robots.chain import SerialChain
from reference import errors, fk, weighted_error

ARMS = ("planar2", "cylindrical3", "scara4", "elbow6", "panda", "irb5400")


@pytest.mark.parametrize("name", ARMS)
def test_catalog_arms_agree_with_the_twin(name: str) -> None:
    arm = kinseek.load(name)
    q = np.random.default_rng(1).uniform(arm.lower, arm.upper, (20, arm.dof))
    np.testing.assert_allclose(arm.fk(q), [fk(arm.chain, each) for each in q], atol=1e-13)


@pytest.mark.slow
@given(serial_chains(), st.integers(0, 2**32 - 1))
@settings(max_examples=100)
def test_random_chains_agree_with_the_twin(chain: SerialChain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-4, 4, (3, chain.dof))
    many = forward_many(chain.arrays, q)
    np.testing.assert_allclose(many, [fk(chain, each) for each in q], atol=1e-11)
    np.testing.assert_array_equal(forward_many(chain.arrays, q[1:2]), many[1:2])


@pytest.mark.parametrize("shape", [(), (1,), (3, 2), (0,), (2, 0)])
def test_fk_broadcasts(shape: tuple[int, ...]) -> None:
    arm = kinseek.load("scara4")
    assert arm.fk(np.full((*shape, 4), 0.1)).shape == (*shape, 4, 4)


def goals() -> list[kinseek.Goal]:
    target = kinseek.pose([0.3, -0.2, 0.4], rotvec=[0.5, -1.0, 2.0])
    weights: dict[str, Any] = {"position_weight": 3.0, "orientation_weight": 0.7}
    return [
        kinseek.Goal.pose(target, position_weight=3.0, orientation_weight=0.7),
        kinseek.Goal.position(target[:3, 3], **weights),
        kinseek.Goal.pointing(target[:3, 3], [1.0, 2.0, -1.0], tool_axis=(0.0, 1.0, 1.0), **weights),
    ]


@pytest.mark.parametrize("goal", goals(), ids=lambda goal: goal.kind)
@pytest.mark.parametrize("name", ["elbow6", "irb5400"])
def test_errors_agree_with_the_twin(goal: kinseek.Goal, name: str) -> None:
    arm = kinseek.load(name)
    problem = kinseek.Problem(arm.chain, goal)
    q = np.random.default_rng(2).uniform(arm.lower, arm.upper, (20, arm.dof))
    measured = judge(problem.arrays, q, np.repeat(goal.targets, 20, axis=0), goal.arrays)
    for row, each in zip(measured, q, strict=True):
        T = fk(arm.chain, each)
        np.testing.assert_allclose(row, [*errors(T, goal), weighted_error(T, goal)], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-3, 3.0, np.pi - 1e-9, np.pi])
def test_angles_are_accurate_at_both_ends(angle: float) -> None:
    turned = kinseek.pose([0, 0, 0], rotvec=angle * np.array([0.6, 0.0, 0.8]))
    arm = kinseek.Arm.from_dh([[0.0, 0.0, 0.0, 0.0]], [-1.0], [1.0])
    solution = arm.ik(
        turned, near=[0.0], solver=kinseek.BlindSearch(most_steps=1, step=1e-300, smallest_step=1.0)
    )
    assert solution.q == 0.0
    assert solution.orientation_error == pytest.approx(angle, rel=1e-9, abs=1e-15)
