"""The lanes against plain twins: forward kinematics, residual, Jacobian and one damped step at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from chains import serial_chains
from kinseek.kernels.arm import trigonometry
from kinseek.kernels.arm.links import links_of
from kinseek.kernels.atlas import lanes as eight
from kinseek.kernels.atlas.lanes import LANES, Lanes
from kinseek.kernels.jit import exposed
from kinseek.robots.chain import SerialChain
from reference import fk

pytestmark = pytest.mark.jit

Array = NDArray[np.float64]

lanes_forward, lanes_residual = exposed(eight.lanes_forward), exposed(eight.lanes_residual)
lanes_jacobian, lanes_hold = exposed(eight.lanes_jacobian), exposed(eight.lanes_hold)
lanes_gram, lanes_solve = exposed(eight.lanes_gram), exposed(eight.lanes_solve)
lanes_move = exposed(eight.lanes_move)
sine_cosine, rough_angle = exposed(trigonometry.sine_cosine), exposed(trigonometry.rough_angle)

POSE = np.array([0.5, 0.5, 0.5])
DIRECTION = np.array([1.0, 0.0, 0.0])


def lanes_at(chain: SerialChain, q: Array, goals: Array, weight: Array) -> Lanes:
    """Lanes at q, (LANES, n), for goals, (LANES, 3, 4), with a scale for positions and one for orientations."""
    n, m = chain.dof, len(chain.leader)
    lanes = Lanes(
        q=np.ascontiguousarray(q.T),
        target=np.ascontiguousarray(np.moveaxis(goals, 0, 2)),
        pose=np.zeros((3, 4, LANES)),
        axes=np.zeros((m, 6, LANES)),
        jacobian=np.full((n, 6, LANES), np.nan),
        gram=np.zeros((21, LANES)),
        residual=np.zeros((6, LANES)),
        step=np.zeros((n, LANES)),
        share=np.zeros(LANES),
        before=np.zeros(LANES),
        stubborn=np.zeros(LANES),
        error=np.zeros((4, LANES)),
        weight=np.repeat(weight[:, None], LANES, axis=1),
    )
    return lanes


def poses_of(lanes: Lanes) -> Array:
    return np.moveaxis(lanes.pose, 2, 0)


def jacobian_of(chain: SerialChain, lanes: Lanes) -> Array:
    """The Jacobian, (n, 6, LANES)."""
    lanes_jacobian(chain.leader, links_of(chain.arrays), lanes, 0.0, LANES)
    return lanes.jacobian.copy()


def plain_jacobian(chain: SerialChain, q: Array, weight: Array) -> Array:
    """Central differences of position and of the turn seen from the base, scaled, (6, n)."""
    J, h, R = np.empty((6, chain.dof)), 1e-6, fk(chain, q)[:3, :3]
    for i in range(chain.dof):
        ahead, behind = q.copy(), q.copy()
        ahead[i] += h
        behind[i] -= h
        A, B = fk(chain, ahead), fk(chain, behind)
        J[:3, i] = weight[0] * (A[:3, 3] - B[:3, 3]) / (2 * h)
        turned = (
            Rotation.from_matrix(A[:3, :3] @ R.T).as_rotvec()
            - Rotation.from_matrix(B[:3, :3] @ R.T).as_rotvec()
        )
        J[3:, i] = weight[1] * turned / (2 * h)
    return J


@pytest.mark.slow
@given(serial_chains(), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_forward_kinematics_agrees_with_the_twin(chain: SerialChain, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-4, 4, (LANES, chain.dof))
    lanes = lanes_at(chain, q, np.zeros((LANES, 3, 4)), np.ones(2))
    lanes_forward(chain.leader, links_of(chain.arrays), lanes, LANES)
    np.testing.assert_allclose(poses_of(lanes), [fk(chain, each)[:3] for each in q], atol=1e-11)


@pytest.mark.slow
@given(serial_chains(), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_the_jacobian_agrees_with_finite_differences(chain: SerialChain, seed: int) -> None:
    q, weight = np.random.default_rng(seed).uniform(-3, 3, (LANES, chain.dof)), np.array([2.0, 0.7])
    lanes = lanes_at(chain, q, np.zeros((LANES, 3, 4)), weight)
    lanes_forward(chain.leader, links_of(chain.arrays), lanes, LANES)
    J = jacobian_of(chain, lanes)
    for l in range(LANES):
        np.testing.assert_allclose(J[:, :, l].T, plain_jacobian(chain, q[l], weight), atol=1e-6)


@pytest.mark.parametrize("columns", [POSE, DIRECTION], ids=["pose", "direction"])
def test_the_residual_agrees_with_the_twin(columns: Array) -> None:
    chain, rng = kinseek.load("panda").chain, np.random.default_rng(3)
    q, other = (rng.uniform(chain.lower, chain.upper, (LANES, chain.dof)) for _ in range(2))
    goals = np.array([fk(chain, each)[:3] for each in other])
    lanes = lanes_at(chain, q, goals, np.array([2.0, 0.7]))
    lanes_forward(chain.leader, links_of(chain.arrays), lanes, LANES)
    lanes_residual(lanes, columns, LANES)
    residual, error = lanes.residual, lanes.error
    for k in range(LANES):
        T, G = fk(chain, q[k]), goals[k]
        turn = sum(columns[c] * np.cross(T[:3, c], G[:, c]) for c in range(3))
        np.testing.assert_allclose(residual[:, k], [*2 * (G[:, 3] - T[:3, 3]), *0.7 * turn], atol=1e-12)
        assert error[0, k] == pytest.approx(((G[:, 3] - T[:3, 3]) ** 2).sum())
        assert error[1, k] == pytest.approx((turn**2).sum())
        assert error[3, k] == pytest.approx((residual[:, k] ** 2).sum())
        if columns is POSE:
            angle = Rotation.from_matrix(T[:3, :3].T @ G[:, :3]).magnitude()
            assert error[1, k] == pytest.approx(np.sin(angle) ** 2, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("at_limits", [False, True])
@pytest.mark.parametrize("name", ["panda", "ur10e_rail", "scara4", "planar5"])
def test_a_damped_step_agrees_with_the_twin(name: str, at_limits: bool) -> None:
    chain, rng = kinseek.load(name).chain, np.random.default_rng(4)
    q = rng.uniform(chain.lower, chain.upper, (LANES, chain.dof))
    if at_limits:
        q = np.where(
            rng.random(q.shape) < 0.5, np.where(rng.random(q.shape) < 0.5, chain.lower, chain.upper), q
        )
    goals = np.array([fk(chain, each)[:3] for each in rng.uniform(chain.lower, chain.upper, q.shape)])
    lanes = lanes_at(chain, q, goals, np.array([2.0, 1.0]))
    floor, damping, longest = np.full(LANES, 1e-3), 0.1, 0.8
    lanes_forward(chain.leader, links_of(chain.arrays), lanes, LANES)
    lanes_residual(lanes, POSE, LANES)
    e = lanes.residual.T.copy()
    J = jacobian_of(chain, lanes)
    lanes_hold(chain.lower, chain.upper, lanes, LANES)
    lanes_gram(damping, floor, lanes, LANES)
    lanes_solve(lanes, LANES)
    lanes_move(chain.lower, chain.upper, longest, lanes, LANES)
    for k in range(LANES):
        columns = J[:, :, k].T.copy()
        push = columns.T @ e[k]
        held = ((q[k] >= chain.upper) & (push > 0)) | ((q[k] <= chain.lower) & (push < 0))
        assert at_limits or not held.any()
        columns[:, held] = 0.0
        system = columns @ columns.T + (damping * (e[k] ** 2).sum() + floor[k]) * np.eye(6)
        step = columns.T @ np.linalg.solve(system, e[k])
        step *= longest / max(longest, np.abs(step).max())
        np.testing.assert_allclose(lanes.q[:, k], np.clip(q[k] + step, chain.lower, chain.upper), atol=1e-9)


def test_a_lane_does_not_look_at_the_others() -> None:
    chain, rng = kinseek.load("panda").chain, np.random.default_rng(5)
    q = rng.uniform(chain.lower, chain.upper, (LANES, chain.dof))
    alone = lanes_at(chain, np.repeat(q[:1], LANES, axis=0), np.zeros((LANES, 3, 4)), np.ones(2))
    lanes = lanes_at(chain, q, np.zeros((LANES, 3, 4)), np.ones(2))
    for each in (alone, lanes):
        lanes_forward(chain.leader, links_of(chain.arrays), each, LANES)
    np.testing.assert_array_equal(poses_of(alone), np.repeat(poses_of(lanes)[:1], LANES, axis=0))


def test_sine_and_cosine() -> None:
    x = np.concatenate(
        [np.linspace(-100, 100, 5001), np.arange(-20, 21) * np.pi / 4, [0.0, 1e-300, 9e4, -9e4]]
    )
    pairs = np.array([sine_cosine(each) for each in x])
    np.testing.assert_allclose(pairs, np.stack([np.sin(x), np.cos(x)], axis=1), atol=3e-16)


def test_rough_angle() -> None:
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 5001)[1:], np.arange(-3, 5) * np.pi / 4])
    rough = np.array([rough_angle(3 * np.sin(each), 3 * np.cos(each)) for each in angles])
    error = np.abs((rough - angles + np.pi) % (2 * np.pi) - np.pi)
    assert error.max() < 2e-4
    assert rough_angle(0.0, 0.0) == 0.0


def test_links_of_axes_that_are_almost_parallel() -> None:
    """Where a common normal would lie kilometres away nothing is lost."""
    rows = [[0.4, 1e-9, 0.1, 0.2], [0.4, 1e-7, 0.0, 0.1], [0.3, np.pi - 1e-8, 0.2, 0.0], [0.1, 0.5, 0.0, 0.0]]
    chain = kinseek.Arm.from_dh(rows, [-3.0] * 4, [3.0] * 4).chain
    q = np.random.default_rng(6).uniform(-3, 3, (LANES, 4))
    lanes = lanes_at(chain, q, np.zeros((LANES, 3, 4)), np.ones(2))
    lanes_forward(chain.leader, links_of(chain.arrays), lanes, LANES)
    np.testing.assert_allclose(poses_of(lanes), [fk(chain, each)[:3] for each in q], atol=1e-14)
