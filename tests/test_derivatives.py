"""Derivatives of solutions, against differences of `arm.ik` itself; and where there are none."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Branches, Goal
from kinseek.kernels.arrays import Array
from kinseek.support.transforms import rotation

STEP = 4e-4
"""Largest motion of the target in differences [m] and [rad]; the error of the formula below grows with its fourth power."""


def moved(T: Array, twist: Array) -> Array:
    """Translate a pose, and rotate it about its own origin, both along the axes of its frame."""
    T, angle = T.copy(), float(np.linalg.norm(twist[3:]))
    T[:3, 3] += twist[:3]
    if angle:
        T[:3, :3] = rotation(twist[3:] / angle, angle) @ T[:3, :3]
    return T


def differences(solve: Callable[[Array], Array]) -> Array:
    """Derivative of a function of a twist by central differences of fourth order, (n, 6)."""
    columns = []
    for unit in np.eye(6):
        one, two = ((solve(step * unit) - solve(-step * unit)) / (2 * step) for step in (STEP, 2 * STEP))
        columns.append((4.0 * one - two) / 3.0)
    return np.stack(columns, axis=1)


def of_pose(arm: kinseek.Arm, solution: kinseek.Solution, T: Array, **options: Any) -> Array:
    """Derivative of `arm.ik(near=)` for a whole pose by differences."""
    return of_ik(arm, solution, lambda twist: Goal.pose(moved(T, twist), **EXACT, **options))


def of_ik(arm: kinseek.Arm, solution: kinseek.Solution, goal_of: Callable[[Array], Goal]) -> Array:
    """Derivative of `arm.ik(near=)` at a solution by differences; the goal is a function of the twist of its target."""

    def solve(twist: Array) -> Array:
        return arm.ik(goal_of(twist), near=solution.q).require().q

    return differences(solve)


EXACT: dict[str, Any] = {"position_tolerance": 1e-12, "orientation_tolerance": 1e-12}


def conditioned(arm: kinseek.Arm, count: int, seed: int = 3) -> list[Array]:
    """Joint values inside the limits, away from singularities, where differences are accurate."""
    q = arm.lower + (0.1 + 0.8 * np.random.default_rng(seed).random((400, arm.dof))) * (arm.upper - arm.lower)
    values = np.linalg.svd(arm.jacobian(q), compute_uv=False)[:, -1]
    return list(q[values > 0.6 * values.max()][:count])


@pytest.mark.parametrize("name", ["ur5e", "puma560", "ur10e_calibrated", "panda", "iiwa14", "gen3", "xarm7"])
def test_whole_poses(name: str) -> None:
    arm = kinseek.load(name)
    for q in conditioned(arm, 4):
        T = arm.fk(q)
        solution = arm.ik(T, near=q)
        D, null = solution.derivative, solution.null_space
        assert D.shape == (arm.dof, 6)
        np.testing.assert_allclose(D, of_pose(arm, solution, T), atol=1e-6)
        # The definition without ik: the tip follows the target, and no other such motion is shorter.
        np.testing.assert_allclose(arm.jacobian(solution.q) @ D, np.eye(6), atol=1e-10)
        assert null.shape == (arm.dof, arm.dof - 6)
        np.testing.assert_allclose(null.T @ D, 0.0, atol=1e-10)
        np.testing.assert_allclose(null.T @ null, np.eye(arm.dof - 6), atol=1e-12)
        np.testing.assert_allclose(arm.jacobian(solution.q) @ null, 0.0, atol=1e-12)


TOOL = kinseek.pose([0.05, -0.02, 0.12], rpy=[0.3, -0.4, 1.1])
BASE = kinseek.pose([1.0, 2.0, 0.5], rpy=[0.7, 0.2, -2.0])


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_tool_and_a_base_move_the_target_in_their_frames(name: str) -> None:
    arm = kinseek.load(name)
    q = conditioned(arm, 1)[0]
    T = BASE @ arm.fk(q) @ TOOL
    solution = arm.ik(Goal.pose(T, tool=TOOL, base=BASE), near=q)
    expected = of_ik(arm, solution, lambda twist: Goal.pose(moved(T, twist), tool=TOOL, base=BASE, **EXACT))
    np.testing.assert_allclose(solution.derivative, expected, atol=1e-6)
    # The same for a tool that the arm carries.
    with_tool = arm.with_tool(TOOL)
    same = with_tool.ik(Goal.pose(T, base=BASE), near=q)
    np.testing.assert_allclose(same.derivative, solution.derivative, atol=1e-6)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
@pytest.mark.parametrize("base", [None, BASE])
def test_positions_and_directions(name: str, base: Array | None) -> None:
    arm = kinseek.load(name)
    q = conditioned(arm, 1)[0]
    axis = np.array([0.6, 0.0, 0.8])
    T = (np.eye(4) if base is None else base) @ arm.fk(q)
    start = arm.ik(Goal.position(T[:3, 3], base=base), near=q)
    expected = of_ik(arm, start, lambda twist: Goal.position(moved(T, twist)[:3, 3], base=base, **EXACT))
    np.testing.assert_allclose(start.derivative, expected, atol=1e-6)
    assert (start.derivative[:, 3:] == 0.0).all()
    assert start.null_space.shape == (arm.dof, arm.dof - 3)

    def pointing(twist: Array, **options: Any) -> Goal:
        there = moved(T, twist)
        return Goal.pointing(there[:3, 3], there[:3, :3] @ axis, tool_axis=tuple(axis), base=base, **options)

    ahead = arm.ik(pointing(np.zeros(6)), near=q)
    expected = of_ik(arm, ahead, lambda twist: pointing(twist, **EXACT))
    np.testing.assert_allclose(ahead.derivative, expected, atol=1e-6)
    np.testing.assert_allclose(ahead.derivative[:, 3:] @ (T[:3, :3] @ axis), 0.0, atol=1e-9)
    assert ahead.null_space.shape == (arm.dof, arm.dof - 5)


@pytest.mark.parametrize("name", ["planar2", "scara4", "so101"])
def test_arms_that_follow_only_some_motions(name: str) -> None:
    arm = kinseek.load(name)
    q = 0.35 * arm.lower + 0.65 * arm.upper
    solution = arm.ik(arm.fk(q), near=q)
    assert solution.derivative.shape == (arm.dof, 6)
    np.testing.assert_allclose(solution.derivative @ arm.jacobian(solution.q), np.eye(arm.dof), atol=1e-9)
    assert solution.null_space.shape == (arm.dof, 0)


def test_mimic_joints() -> None:
    urdf = """<robot name="folding"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
    <joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
      <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
    <joint name="follow" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.5 0 0"/><axis xyz="0 0 1"/>
      <limit lower="-4" upper="4" effort="1" velocity="1"/><mimic joint="lead" multiplier="-1.5" offset="0.2"/></joint>
    <joint name="last" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
      <limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>"""
    arm = kinseek.load(urdf).with_tool(kinseek.pose([0.3, 0.0, 0.0]))
    q = np.array([0.9, 0.4])
    T = arm.fk(q)
    # In the plane: two joints reach x and y.
    solution = arm.ik(Goal.position(T[:3, 3]), near=q)

    def flat(twist: Array) -> Goal:
        return Goal.position(T[:3, 3] + twist[:3] * [1.0, 1.0, 0.0], **EXACT)

    np.testing.assert_allclose(solution.derivative, of_ik(arm, solution, flat), atol=1e-6)


def test_batches_and_branches() -> None:
    arm = kinseek.load("panda")
    q = np.stack(conditioned(arm, 4)).reshape(2, 2, 7)
    batch = arm.ik(arm.fk(q), near=q)
    D, null = batch.derivative, batch.null_space
    assert D.shape == (2, 2, 7, 6)
    assert null.shape == (2, 2, 7, 1)
    for i in np.ndindex(2, 2):
        np.testing.assert_array_equal(batch[i].derivative, D[i])
        np.testing.assert_array_equal(batch[i].null_space, null[i])
    assert batch[:0].derivative.shape == (0, 2, 7, 6)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(batch)).derivative, D)

    six = kinseek.load("ur5e")
    branches = six.branches(six.fk(conditioned(six, 1)[0]))
    assert isinstance(branches, Branches)
    assert branches.derivative.shape == (len(branches), 6, 6)
    np.testing.assert_allclose(
        six.jacobian(branches.q) @ branches.derivative, np.eye(6) + np.zeros((len(branches), 6, 6)), atol=1e-9
    )
    assert branches.null_space.shape == (len(branches), 6, 0)
    far = six.branches(kinseek.pose([9.0, 0.0, 0.0]))
    assert isinstance(far, Branches)
    assert far.derivative.shape == (0, 6, 6)


def test_nothing_where_there_is_no_derivative() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.0, 0.5])  # The wrist is straight.
    singular = arm.ik(arm.fk(q), near=q)
    assert singular.success
    assert np.isnan(singular.derivative).all()
    assert singular.null_space.shape == (6, 0)
    far = arm.ik(kinseek.pose([0.0, 0.0, 5.0]))
    assert np.isnan(far.derivative).all()
    seven = kinseek.load("panda")
    poses = seven.fk(np.stack(conditioned(seven, 3)))
    poses[1] = np.nan
    mixed = seven.ik(poses, bad="skip")
    assert np.isnan(mixed.derivative).all(axis=(1, 2)).tolist() == [False, True, False]
    assert np.isnan(mixed.null_space).all(axis=(1, 2)).tolist() == [False, True, False]


def test_errors() -> None:
    arm = kinseek.load("ur5e")
    q = conditioned(arm, 1)[0]
    ranged = arm.ik(Goal.pose(arm.fk(q), free="x", box={"ry": (-0.1, 0.1)}), near=q)
    with pytest.raises(kinseek.InvalidUse, match=r"derivative is defined for whole poses.*got .*\(x, ry\)"):
        _ = ranged.derivative
    with pytest.raises(kinseek.InvalidUse, match="null_space is defined for whole poses"):
        _ = ranged.null_space
    box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds="revolute")
    with pytest.raises(kinseek.InvalidUse, match=r"derivative is computed from axes, but .* black-box"):
        _ = box.ik(arm.fk(q), near=q).derivative


def test_the_gradient_of_the_recipe() -> None:
    """The matrix that docs/recipes.md gives to torch has the products that a derivative by the pose's entries must have."""
    arm = kinseek.load("panda")
    q = conditioned(arm, 1)[0]
    T, weights, random = arm.fk(q), np.arange(1.0, 8.0), np.random.default_rng(1)
    solution = arm.ik(T, near=q)
    v, w = np.split(weights @ solution.derivative, 2)
    gradient = np.zeros((4, 4))
    gradient[:3, :3], gradient[:3, 3] = np.cross(w, T[:3, :3].T).T / 2, v
    twist = random.standard_normal(6)
    step = 1e-6
    dT = (moved(T, step * twist) - moved(T, -step * twist)) / (2 * step)
    assert (gradient * dT).sum() == pytest.approx(weights @ solution.derivative @ twist, rel=1e-7)
