"""Arms with locked joints, narrower limits and tools: the same poses with fewer joints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from chains import serial_chains
from kinseek import Arm, Goal
from kinseek.errors import InvalidRobot
from kinseek.robots import catalog_path
from kinseek.robots.chain import SerialChain
from pinocchio_poses import configuration, pinocchio_poses
from reference import fk

Array = NDArray[np.float64]


@pytest.mark.slow
@settings(max_examples=60)
@given(serial_chains(), st.data())
def test_locked_joints_change_no_pose(chain: SerialChain, data: st.DataObject) -> None:
    arm = Arm(chain)
    q = np.array([data.draw(st.floats(low, high)) for low, high in zip(arm.lower, arm.upper, strict=True)])
    which = data.draw(st.lists(st.sampled_from(range(arm.dof)), unique=True, max_size=arm.dof - 1))
    locked = arm.with_locked({arm.joint_names[i]: q[i] for i in which})
    left = [i for i in range(arm.dof) if i not in which]
    assert locked.joint_names == tuple(arm.joint_names[i] for i in left)
    np.testing.assert_array_equal(locked.lower, arm.lower[left])
    np.testing.assert_allclose(fk(locked.chain, q[left]), fk(chain, q), atol=1e-12)
    np.testing.assert_allclose(locked.fk(q[left]), arm.fk(q), atol=1e-12)
    for frame in arm.chain.frames:
        np.testing.assert_allclose(locked.fk(q[left], link=frame), arm.fk(q, link=frame), rtol=0, atol=1e-12)
    assert arm.dof == chain.dof  # The arm itself stays as it was.


def test_locked_panda_is_pinocchios_reduced_model() -> None:
    arm = kinseek.load("panda")
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromUrdf(str(catalog_path("panda")))
    name, value = arm.joint_names[2], 0.4
    reference = configuration(pinocchio, model, [name], np.array([value]))
    reduced = pinocchio.buildReducedModel(model, [model.getJointId(name)], reference)
    locked = arm.with_locked({name: value})
    q = locked.sample(1)
    np.testing.assert_allclose(locked.fk(q), pinocchio_poses(pinocchio, reduced, locked, q), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "iiwa14", "ur10e_rail", "ur5e"])
def test_arms_with_a_locked_joint_are_solved(name: str) -> None:
    arm = kinseek.load(name)
    locked = arm.with_locked({arm.joint_names[0]: float(arm.lower[0] + arm.upper[0]) / 2})
    q = np.random.default_rng(1).uniform(locked.lower, locked.upper, (500, locked.dof))
    T = np.array([fk(locked.chain, each) for each in q])
    solution = locked.ik(T)
    assert solution.success.all(), np.flatnonzero(~solution.success)


def test_narrower_limits_are_kept() -> None:
    arm = kinseek.load("panda")
    name = arm.joint_names[1]
    narrow = arm.with_limits({name: (-0.5, 0.5)})
    assert (narrow.lower[1], narrow.upper[1]) == (-0.5, 0.5)
    q = np.random.default_rng(2).uniform(narrow.lower, narrow.upper, (500, 7))
    solution = narrow.ik(arm.fk(q))
    assert solution.success.all()
    assert (np.abs(solution.q[:, 1]) <= 0.5).all()
    assert arm.upper[1] > 0.5


def test_a_continuous_joint_becomes_a_limited_one() -> None:
    arm = Arm.from_dh([[0.5, 0, 0, 0], [0.4, 0, 0, 0]], [-np.inf, -2], [np.inf, 2])
    assert arm.chain.kinds[0] == "continuous"
    name = arm.joint_names[0]
    narrow = arm.with_limits({name: (2.0, 4.0)})
    assert narrow.chain.kinds[0] == "revolute"
    q = np.random.default_rng(3).uniform(narrow.lower, narrow.upper, (100, 2))
    solution = narrow.ik(Goal.position(arm.fk(q)[:, :3, 3]))
    assert solution.success.all()
    assert ((solution.q[:, 0] >= 2.0) & (solution.q[:, 0] <= 4.0)).all()
    np.testing.assert_allclose(arm.with_locked({name: 9.0}).fk([0.3]), arm.fk([9.0, 0.3]), atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"shoulder_pan": 0.0}, "unknown joint 'shoulder_pan'; did you mean 'shoulder_pan_joint'"),
        ({"elbow_joint": 10.0}, "joint 'elbow_joint' cannot be locked at 10: its limits are"),
        ({"elbow_joint": np.nan}, "must be a finite number, got nan"),
        ({"elbow_joint": "bent"}, "must be a finite number, got 'bent'"),
        (["elbow_joint"], "expected a mapping from joint names to value"),
    ],
)
def test_wrong_locks(values: Any, words: str) -> None:
    with pytest.raises(InvalidRobot, match=words):
        kinseek.load("ur5e").with_locked(values)


def test_not_every_joint_can_be_locked() -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidRobot, match="every joint is locked"):
        arm.with_locked(dict.fromkeys(arm.joint_names, 0.0))
    assert arm.with_locked({}).dof == 2


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"elbow": (0, 1)}, "unknown joint 'elbow'"),
        ({"elbow_joint": (1, 0)}, "lower limit 1 is above upper limit 0"),
        ({"elbow_joint": (-9, 0)}, r"limits \[-9, 0\] are wider than those of the arm"),
        ({"elbow_joint": (0, np.nan)}, "must be a finite number, got nan"),
        ({"elbow_joint": 1.0}, r"must be a pair \(lower, upper\), got 1.0"),
        ({"elbow_joint": (0, 1, 2)}, r"must be a pair \(lower, upper\)"),
    ],
)
def test_wrong_limits(limits: Any, words: str) -> None:
    with pytest.raises(InvalidRobot, match=words):
        kinseek.load("ur5e").with_limits(limits)
