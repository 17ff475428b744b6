"""Joint values by name: in any order in, base to tip out; unknown and lacking names are told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import kinseek
from kinseek import InvalidProblem, InvalidRobot

ARM = kinseek.load("ur5e")
Q = np.array([0.3, -1.2, 1.4, -0.5, -1.5, 0.2])
NAMED = dict(zip(reversed(ARM.joint_names), reversed(Q.tolist()), strict=True))
TARGET = ARM.fk(Q)


def test_values_by_name_are_those_in_order() -> None:
    np.testing.assert_array_equal(ARM.fk(NAMED), TARGET)
    np.testing.assert_array_equal(ARM.fk(NAMED, link="wrist_1_link"), ARM.fk(Q, link="wrist_1_link"))
    np.testing.assert_array_equal(ARM.jacobian(NAMED), ARM.jacobian(Q))
    assert ARM.manipulability(NAMED) == ARM.manipulability(Q)
    np.testing.assert_array_equal(ARM.ik(TARGET, near=NAMED).q, ARM.ik(TARGET, near=Q).q)
    np.testing.assert_array_equal(ARM.branches(TARGET, near=NAMED).q, ARM.branches(TARGET, near=Q).q)


def test_values_of_many_by_name_broadcast() -> None:
    first = np.linspace(-1.0, 1.0, 6).reshape(2, 3)
    many = ARM.fk({**NAMED, ARM.joint_names[0]: first})
    assert many.shape == (2, 3, 4, 4)
    np.testing.assert_array_equal(many[1, 2], ARM.fk([first[1, 2], *Q[1:]]))


def test_a_message_may_tell_of_the_whole_robot() -> None:
    message = SimpleNamespace(
        name=["gripper", *NAMED], position=np.array([0.04, *NAMED.values()]), velocity=[]
    )
    np.testing.assert_array_equal(ARM.fk(message), TARGET)
    message.name = message.name[:-1]
    with pytest.raises(InvalidProblem, match="q: 6 names and 7 positions"):
        ARM.fk(message)
    with pytest.raises(InvalidProblem, match="q: name and position must be lists: 'float' object"):
        ARM.fk(SimpleNamespace(name=["elbow_joint"], position=0.3))
    message.position = message.position[:-1]
    with pytest.raises(
        InvalidProblem, match="no value for joint 'shoulder_pan_joint'; given: wrist_3_joint, "
    ):
        ARM.fk(message)


def test_answers_tell_their_values_by_name() -> None:
    solution = ARM.ik(TARGET, near=Q)
    assert list(solution.joints) == list(ARM.joint_names)
    assert list(solution.joints.values()) == solution.q.tolist()
    np.testing.assert_array_equal(ARM.fk(solution.joints), ARM.fk(solution.q))
    batch = ARM.ik(np.stack([TARGET] * 6).reshape(2, 3, 4, 4))
    assert batch.joints["elbow_joint"].shape == (2, 3)
    np.testing.assert_array_equal(ARM.fk(batch.joints), ARM.fk(batch.q))
    branches = ARM.branches(TARGET)
    assert isinstance(branches, kinseek.Branches)
    np.testing.assert_array_equal(ARM.fk(branches.joints), ARM.fk(branches.q))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"elbow": 0.1}, r"near: unknown joint 'elbow'; did you mean 'elbow_joint'\? Valid: elbow_joint, "),
        ({"elbow_joint": "bent"}, "near: values of joints must be numbers, .*'bent'"),
        ({"elbow_joint": [0.1, 0.2], "wrist_1_joint": [1, 2, 3]}, "near: values of joints .*broadcast"),
        ({"elbow_joint": np.nan}, r"near contains NaN or infinity at index \(2,\) \(joint 'elbow_joint'\)"),
    ],
)
def test_wrong_names_and_values_are_told(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidProblem, match=message):
        ARM.ik(TARGET, near={**NAMED, **change})  # type: ignore[dict-item]
    with pytest.raises(
        InvalidProblem, match="q: no value for joint 'elbow_joint'; given: wrist_3_joint, wrist_2"
    ):
        ARM.fk({name: value for name, value in NAMED.items() if name != "elbow_joint"})


def test_limits_by_name() -> None:
    rows = [(0.5, 0.0, 0.0, 0.0), (0.4, 0.0, 0.0, 0.0)]
    arm = kinseek.Arm.from_dh(
        rows, {"elbow": -1.0, "shoulder": -2.0}, {"shoulder": 2.5, "elbow": 1.5}, names=["shoulder", "elbow"]
    )
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-2.0, -1.0], [2.5, 1.5]])
    with pytest.raises(InvalidRobot, match="lower limits: unknown joint 'elbo'; did you mean 'elbow'"):
        kinseek.Arm.from_dh(rows, {"elbo": -1.0, "shoulder": -2.0}, [1, 1], names=["shoulder", "elbow"])
    with pytest.raises(InvalidRobot, match="upper limits: no value for joint 'joint2'; given: joint1"):
        kinseek.Arm.from_dh(rows, [-1, -1], {"joint1": 1.0})


def test_limits_of_a_function_by_name_give_its_joints_their_names() -> None:
    lower, upper = {"shoulder": -2.0, "elbow": -1.0}, {"elbow": 1.5, "shoulder": 2.5}
    planar = kinseek.load("planar2")
    arm = kinseek.Arm.from_fk(planar.fk, lower, upper)
    assert arm.joint_names == ("shoulder", "elbow")
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-2.0, -1.0], [2.5, 1.5]])
    arm = kinseek.Arm.from_fk(planar.fk, lower, upper, names=["elbow", "shoulder"])
    np.testing.assert_array_equal(arm.upper, [1.5, 2.5])
    with pytest.raises(InvalidRobot, match="upper: no value for joint 'elbow'"):
        kinseek.Arm.from_fk(planar.fk, lower, {"shoulder": 1.0})
