"""Messages of ROS with a pose are poses, wherever poses are taken."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, InvalidGoal, Status

ARM = kinseek.load("ur5e")
T = kinseek.pose([0.4, 0.2, 0.3], quat_xyzw=[0.9, 0.1, 0.2, 0.3])


def vector(x: Any, y: Any, z: Any) -> Any:
    return SimpleNamespace(x=x, y=y, z=z)


def quaternion(x: Any, y: Any, z: Any, w: Any) -> Any:
    return SimpleNamespace(x=x, y=y, z=z, w=w)


def pose(place: Any = (0.4, 0.2, 0.3), turn: Any = (0.9, 0.1, 0.2, 0.3)) -> Any:
    """A geometry_msgs/Pose."""
    return SimpleNamespace(position=vector(*place), orientation=quaternion(*turn))


def transform() -> Any:
    """A geometry_msgs/Transform."""
    return SimpleNamespace(translation=vector(0.4, 0.2, 0.3), rotation=quaternion(0.9, 0.1, 0.2, 0.3))


HEADER = SimpleNamespace(frame_id="base_link", stamp=SimpleNamespace(sec=1, nanosec=2))
MESSAGES = {
    "Pose": pose(),
    "PoseStamped": SimpleNamespace(header=HEADER, pose=pose()),
    "Transform": transform(),
    "TransformStamped": SimpleNamespace(header=HEADER, child_frame_id="tool0", transform=transform()),
    "PoseWithCovarianceStamped": SimpleNamespace(
        header=HEADER, pose=SimpleNamespace(covariance=[0.0] * 36, pose=pose())
    ),
}


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES)
def test_a_message_is_a_pose(message: Any) -> None:
    np.testing.assert_array_equal(kinseek.pose(message), T)
    np.testing.assert_array_equal(Goal.pose(message).target, T)
    np.testing.assert_array_equal(ARM.ik(message).q, ARM.ik(T).q)
    np.testing.assert_array_equal(kinseek.pose([message, T, message]), [T, T, T])
    np.testing.assert_array_equal(kinseek.pose([T, message]), [T, T])


CALLS: dict[str, Callable[[Any], NDArray[np.float64]]] = {
    "branches": lambda one: ARM.branches(one).q,
    "prove": lambda one: np.array(ARM.prove(one).verdict.name),
    "tool": lambda one: ARM.with_tool(one).fk(np.zeros(6)),
    "base of a goal": lambda one: ARM.ik(Goal.pose(ARM.fk(np.full(6, 0.5)), base=one)).q,
    "follow": lambda one: ARM.follow([one, one]).q,
    "follow, iterator": lambda one: ARM.follow(each for each in (one, one)).q,
    "follow_stream": lambda one: np.concatenate(
        [np.atleast_2d(piece.q) for piece in ARM.follow_stream([one, one])]
    ),
    "track": lambda one: ARM.track(ARM.ik(T).q, period=0.01).step(one).q,
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_every_call_reads_messages(call: Callable[[Any], NDArray[np.float64]]) -> None:
    np.testing.assert_array_equal(call(MESSAGES["PoseStamped"]), call(T))


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (
            pose(turn=(0.0, 0.0, 0.0, 0.0)),
            "its rotation is zero, as that of a message whose orientation was never set",
        ),
        (pose(turn=(np.nan, 0.0, 0.0, 1.0)), "a pose contains NaN or infinity"),
        (pose(place=(np.inf, 0.0, 0.0)), "a pose contains NaN or infinity"),
        (pose(place=("far", 0.0, 0.0)), "x of a message must be a number, got 'far'"),
        (pose(turn=(None, 0.0, 0.0, 1.0)), "x of a message must be a number, got None"),
        (pose(place=(10**400, 0.0, 0.0)), "x of a message must be a number, got 1000"),
        (
            SimpleNamespace(position=[0.0] * 6, name=["a"] * 6),
            "or a ROS message of a pose or transform, got",
        ),
        (SimpleNamespace(pose=SimpleNamespace(position=vector(0, 0, 0))), "or a ROS message of a pose"),
    ],
)
def test_what_is_no_pose_is_refused(message: Any, said: str) -> None:
    with pytest.raises(InvalidGoal, match=said):
        ARM.ik(message)
    with pytest.raises(InvalidGoal, match=said):
        ARM.ik([T, message])


def test_messages_that_were_never_set_can_be_skipped() -> None:
    solution = ARM.ik([pose(), pose(turn=(0, 0, 0, 0)), pose(turn=(np.nan, 0, 0, 1)), pose()], bad="skip")
    assert (solution.status == Status.INVALID).tolist() == [False, True, True, False]
    np.testing.assert_array_equal(solution.q[[0, 3]], [ARM.ik(T).q] * 2)
