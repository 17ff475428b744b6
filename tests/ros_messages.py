"""Messages of ROS 2 without ROS.

As the classes that ROS 2 generates, these have the fields and types of the public definitions, and reject all others.
"""

from __future__ import annotations

from typing import Any, ClassVar


class Message:
    """A message: its class has the type of each field, in a list for a sequence; fields start as zero, empty or such."""

    FIELDS: ClassVar[dict[str, Any]] = {}

    def __init__(self, **values: Any) -> None:
        for name, kind in self.FIELDS.items():
            setattr(self, name, [] if isinstance(kind, list) else kind())
        for name, value in values.items():
            setattr(self, name, value)

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in self.FIELDS:
            raise AttributeError(f"{type(self).__name__} has no field {name!r}")
        kind = self.FIELDS[name]
        if isinstance(kind, list):
            assert isinstance(value, list), f"{type(self).__name__}.{name}: {value!r}"
        for each in value if isinstance(kind, list) else [value]:
            assert isinstance(each, kind[0] if isinstance(kind, list) else kind), f"{name}: {value!r}"
        object.__setattr__(self, name, value)


def message(name: str, /, **fields: Any) -> Any:
    return type(name, (Message,), {"FIELDS": fields})


# builtin_interfaces, std_msgs, geometry_msgs, sensor_msgs, trajectory_msgs of ROS 2.
Time = message("Time", sec=int, nanosec=int)
Duration = message("Duration", sec=int, nanosec=int)
Header = message("Header", stamp=Time, frame_id=str)
MultiArrayDimension = message("MultiArrayDimension", label=str, size=int, stride=int)
MultiArrayLayout = message("MultiArrayLayout", dim=[MultiArrayDimension], data_offset=int)
Float64MultiArray = message("Float64MultiArray", layout=MultiArrayLayout, data=[float])
Point = message("Point", x=float, y=float, z=float)
Quaternion = message("Quaternion", x=float, y=float, z=float, w=float)
Pose = message("Pose", position=Point, orientation=Quaternion)
PoseStamped = message("PoseStamped", header=Header, pose=Pose)
JointState = message(
    "JointState",
    header=Header,
    name=[str],
    position=[float],
    velocity=[float],
    effort=[float],
)
JointTrajectoryPoint = message(
    "JointTrajectoryPoint",
    positions=[float],
    velocities=[float],
    accelerations=[float],
    effort=[float],
    time_from_start=Duration,
)
JointTrajectory = message("JointTrajectory", header=Header, joint_names=[str], points=[JointTrajectoryPoint])
# moveit_msgs of ROS 2; parts that the node does not read are messages without fields.
MultiDOFJointState, AttachedCollisionObject, Constraints = (
    message(name) for name in ("MultiDOFJointState", "AttachedCollisionObject", "Constraints")
)
RobotState = message(
    "RobotState",
    joint_state=JointState,
    multi_dof_joint_state=MultiDOFJointState,
    attached_collision_objects=[AttachedCollisionObject],
    is_diff=bool,
)
PositionIKRequest = message(
    "PositionIKRequest",
    group_name=str,
    robot_state=RobotState,
    constraints=Constraints,
    avoid_collisions=bool,
    ik_link_name=str,
    pose_stamped=PoseStamped,
    ik_link_names=[str],
    pose_stamped_vector=[PoseStamped],
    timeout=Duration,
)


class MoveItErrorCodes(Message):
    FIELDS: ClassVar[dict[str, Any]] = {"val": int, "message": str, "source": str}
    SUCCESS = 1
    TIMED_OUT = -6
    INVALID_GOAL_CONSTRAINTS = -16
    INVALID_ROBOT_STATE = -17
    INVALID_LINK_NAME = -18
    FRAME_TRANSFORM_FAILURE = -21
    COLLISION_CHECKING_UNAVAILABLE = -22
    NO_IK_SOLUTION = -31


class GetPositionIK:
    Request = message("GetPositionIK_Request", ik_request=PositionIKRequest)
    Response = message("GetPositionIK_Response", solution=RobotState, error_code=MoveItErrorCodes)
