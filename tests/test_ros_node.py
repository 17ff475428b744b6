"""The code of docs/ros2.md that needs ROS 2 runs with message classes of the same shape."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest

import kinseek
from kinseek.robots import catalog_path
from places import ROOT
from ros_messages import (
    Duration,
    GetPositionIK,
    Header,
    JointState,
    JointTrajectory,
    JointTrajectoryPoint,
    MoveItErrorCodes,
    Point,
    Pose,
    PoseStamped,
    PositionIKRequest,
    Quaternion,
    RobotState,
)

PAGE = ROOT / "docs" / "ros2.md"
if not PAGE.is_file():
    pytest.skip("the documentation is not part of what is tested here", allow_module_level=True)


class Parameter:
    def __init__(self, value: str) -> None:
        self.value = value


class Node:
    """What the page uses of rclpy.node.Node; the parameter is given as a launch file would."""

    parameters: ClassVar[dict[str, str]] = {"robot_description": catalog_path("ur5e").read_text()}

    def __init__(self, name: str) -> None:
        self.services: dict[str, tuple[Any, Callable[[Any, Any], Any]]] = {}

    def declare_parameter(self, name: str, value: str) -> Parameter:
        return Parameter(self.parameters.get(name, value))

    def create_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        self.services[name] = kind, callback


def block(containing: str) -> str:
    (code,) = (
        code for code in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL) if containing in code
    )
    return str(code)


def modules(spun: list[Any]) -> dict[str, ModuleType]:
    """The packages that the page imports, by name."""
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {"init": lambda: None, "spin": spun.append},
        "rclpy.node": {"Node": Node},
        "moveit_msgs": {},
        "moveit_msgs.msg": {"MoveItErrorCodes": MoveItErrorCodes},
        "moveit_msgs.srv": {"GetPositionIK": GetPositionIK},
        "builtin_interfaces": {},
        "builtin_interfaces.msg": {"Duration": Duration},
        "trajectory_msgs": {},
        "trajectory_msgs.msg": {
            "JointTrajectory": JointTrajectory,
            "JointTrajectoryPoint": JointTrajectoryPoint,
        },
    }
    found = {}
    for name, names in contents.items():
        found[name] = ModuleType(name)
        found[name].__dict__.update(names)
    return found


@pytest.fixture
def node(monkeypatch: pytest.MonkeyPatch) -> Any:
    spun: list[Any] = []
    for name, module in modules(spun).items():
        monkeypatch.setitem(sys.modules, name, module)
    exec(block("class InverseKinematics"), {})
    (made,) = spun
    return made


def request(**changes: Any) -> Any:
    pose = Pose(position=Point(x=0.4, y=0.2, z=0.3), orientation=Quaternion(x=1.0))
    stamped = PoseStamped(header=Header(frame_id="base_link"), pose=pose)
    return GetPositionIK.Request(
        ik_request=PositionIKRequest(group_name="manipulator", **{"pose_stamped": stamped, **changes})
    )


def serve(node: Any, asked: Any) -> Any:
    kind, callback = node.services["compute_ik"]
    answer = callback(asked, kind.Response())
    assert type(answer) is kind.Response
    return answer


def test_the_node_answers_with_joint_values_that_reach_the_pose(node: Any) -> None:
    arm = kinseek.load("ur5e")
    seeds = arm.sample(20, seed=3)
    for seed in seeds:
        names = [
            *arm.joint_names[::-1],
            "finger_joint",
        ]  # In any order, with joints that the arm does not have.
        state = RobotState(joint_state=JointState(name=names, position=[*map(float, seed[::-1]), 0.04]))
        reply = serve(node, request(robot_state=state, timeout=Duration(sec=0, nanosec=500_000_000)))
        assert reply.error_code.val == MoveItErrorCodes.SUCCESS
        joints = dict(zip(reply.solution.joint_state.name, reply.solution.joint_state.position, strict=True))
        assert tuple(joints) == arm.joint_names
        target = kinseek.pose([0.4, 0.2, 0.3], quat_xyzw=[1.0, 0.0, 0.0, 0.0])
        assert np.abs(arm.fk(joints) - target).max() < 1e-6
        nearest = arm.branches(target, near=seed, copies=True).q[0]
        assert np.array([*joints.values()]) == pytest.approx(nearest, abs=1e-6)


def test_the_node_needs_no_seed_and_no_timeout(node: Any) -> None:
    assert serve(node, request()).error_code.val == MoveItErrorCodes.SUCCESS


def moved(frame: str = "base_link", x: float = 0.4, w: float = 1.0) -> Any:
    pose = Pose(position=Point(x=x), orientation=Quaternion(w=w))
    return PoseStamped(header=Header(frame_id=frame), pose=pose)


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"pose_stamped": moved(frame="world")}, "FRAME_TRANSFORM_FAILURE"),
        ({"pose_stamped": moved(x=9.0)}, "NO_IK_SOLUTION"),
        ({"pose_stamped": moved(w=0.0)}, "INVALID_GOAL_CONSTRAINTS"),
        ({"pose_stamped": moved(x=0.9), "timeout": Duration(nanosec=1)}, "TIMED_OUT"),
        ({"ik_link_name": "gripper"}, "INVALID_LINK_NAME"),
        ({"avoid_collisions": True}, "COLLISION_CHECKING_UNAVAILABLE"),
        (
            {"robot_state": RobotState(joint_state=JointState(name=["elbow_joint"], position=[1.0]))},
            "INVALID_ROBOT_STATE",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.filterwarnings("ignore::kinseek.UnitWarning")
def test_the_node_reports_why_there_is_no_solution(node: Any, changes: Any, code: str) -> None:
    reply = serve(node, request(**changes))
    assert reply.error_code.val == getattr(MoveItErrorCodes, code)
    assert reply.solution.joint_state.position == []


def test_every_code_of_the_table_is_one_of_moveit() -> None:
    codes = set(re.findall(r"^\| `([A-Z_]+)` \|", PAGE.read_text(), re.MULTILINE))
    used = {name for name in vars(MoveItErrorCodes) if name.isupper()} - {"FIELDS"}
    others = {"GOAL_IN_COLLISION", "GOAL_CONSTRAINTS_VIOLATED"}
    assert codes == (used | others) - {"COLLISION_CHECKING_UNAVAILABLE"}


def test_a_path_fills_a_trajectory(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, module in modules([]).items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(
        sys.modules["trajectory_msgs"], "msg", sys.modules["trajectory_msgs.msg"], raising=False
    )
    arm = kinseek.load("ur5e")
    start = kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0, 0])
    poses = kinseek.interpolate([start, kinseek.pose([0, 0, 0.1]) @ start], step=0.01, turn=0.1)
    names: dict[str, Any] = {"arm": arm, "poses": poses, "solution": arm.ik(poses[0])}
    exec(block("to_ros("), names)
    trajectory, motion = names["trajectory"], names["path"].timed(acceleration=5.0)
    assert type(trajectory) is JointTrajectory
    assert len(trajectory.points) == len(motion.sample(0.01).times)
    stamp = trajectory.points[-1].time_from_start
    assert stamp.sec + stamp.nanosec / 1e9 == pytest.approx(motion.duration, abs=1e-9)
    for point, pose in ((trajectory.points[0], poses[0]), (trajectory.points[-1], poses[-1])):
        assert np.abs(arm.fk(point.positions) - pose).max() < 1e-6
        assert np.abs(point.velocities).max() < 1e-12


def test_the_stand_ins_reject_what_ros_rejects() -> None:
    with pytest.raises(AttributeError):
        JointState(names=["a"])
    for field, value in (("position", [1]), ("position", np.zeros(2)), ("name", ("a",)), ("header", 1)):
        with pytest.raises(AssertionError):
            JointState(**{field: value})
