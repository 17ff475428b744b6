"""Read a serial arm from a URDF or xacro file.

Fixed joints are folded into the joints after them. Soft limits of a `<safety_controller>` narrow the limits of a joint, as
in MoveIt (`jointBoundsFromURDF` in moveit_core/robot_model). Meshes, masses, transmissions and simulator tags are ignored,
so ROS packages need not be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.support.units import warn_of_joints

from .chain import Array, Frame, SerialChain
from .checks import refuse_arm, refuse_file
from .files import MOST_JOINTS, require_few
from .joints import Joint, Mimics, serial_chain
from .tree import frame_path
from .urdf_file import Robot, UrdfJoint, read_robot
from .xacro import urdf_text


class Urdf(NamedTuple):
    """The text of a URDF, before an arm in it is chosen."""

    text: bytes
    where: str
    """Source of the text, for messages."""
    name: str = "robot"
    """Name of the robot, if the text has none."""
    packages: Mapping[str, str | Path] = {}
    """Folders of ROS packages that were given with it, by name."""
    base: str | None = None
    """The base link of its arm, unless the caller chooses another; None for the root."""
    tip: str | None = None
    """The tip link of its arm, unless the caller chooses another; None for the only leaf."""

    def arm(self, base: str | None, tip: str | None) -> SerialChain:
        """Read the arm between two links.

        Raises:
            InvalidRobot: As `read_urdf`.
        """
        chain = read_arm(read_robot(self.text, self.where), base, tip, self.name)
        return replace(chain, urdf=self.text, packages=dict(self.packages))


def urdf_of_file(
    path: str | Path,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> Urdf:
    """Return the URDF of a ``.urdf`` or ``.xacro`` file; the arguments are those of `read_urdf`.

    Raises:
        InvalidRobot: The file cannot be read or expanded.
    """
    path = Path(path)
    if (args or packages) and path.suffix.lower() != ".xacro":
        raise InvalidRobot(f"args and packages are for .xacro files, got {str(path)!r}")
    text = urdf_text(path, args, packages, trusted)
    return Urdf(text, str(path), path.name.split(".")[0], packages or {})


def read_urdf(
    path: str | Path,
    base: str | None = None,
    tip: str | None = None,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> SerialChain:
    """Read the arm between two links of a ``.urdf`` or ``.xacro`` file.

    Args:
        path: The file; a file with the extension ``.xacro`` is expanded first.
        base: Name of the base link; the default is the root of the tree.
        tip: Name of the link whose pose is computed; the default is the only leaf of the tree.
        args: Values of a xacro file's arguments, by name.
        packages: Folders of ROS packages for a xacro file, by name.
        trusted: Whether Python may evaluate the expressions of a xacro file.

    Raises:
        InvalidRobot: The file, the tree of links, or a joint between base and tip cannot be used.
    """
    return urdf_of_file(path, args=args, packages=packages, trusted=trusted).arm(base, tip)


def read_arm(robot: Robot, base: str | None, tip: str | None, name: str = "robot") -> SerialChain:
    """Read the arm between two links of a robot, as `Urdf.arm` does.

    Raises:
        InvalidRobot: A check refuses the file or the arm.
    """
    refuse_file(robot)
    return arm_of(robot, base, tip, name)


def arm_of(robot: Robot, base: str | None, tip: str | None, name: str = "robot") -> SerialChain:
    """Read the arm between two links of a robot of which no check refuses the file.

    Raises:
        InvalidRobot: There is no such arm, or a check refuses it.
    """
    with np.errstate(all="ignore"):  # Overflowing numbers are rejected when the chain is built.
        chain = _chain(robot, base, tip, name)
    warn_of_joints(
        chain.joint_names,
        chain.kinds,
        chain.lower,
        chain.upper,
        robot.where,
        "write radians, as URDF has them",
    )
    return chain


def _chain(robot: Robot, base: str | None, tip: str | None, name: str) -> SerialChain:
    leaves = robot.parents.keys() - {parent for parent in robot.parents.values() if parent}
    above = {joint.child: joint for joint in robot.joints}
    moved = {joint.child for joint in robot.joints if joint.kind != "fixed"}
    links = frame_path(robot.parents, base, tip, ends=leaves, noun="link", moving=moved)
    joints = [above[link] for link in links[1:]]
    count = sum(joint.kind != "fixed" for joint in joints)
    require_few(count, "moving joints between base and tip", MOST_JOINTS, robot.where)
    moving, pose, mimics = list[Joint](), np.eye(4), robot.mimics
    of_links, of_joints = [], []
    for joint in joints:
        pose = pose @ joint.pose
        if joint.kind != "fixed":
            moving.append(_moving_joint(joint, pose, mimics))
            pose = np.eye(4)
        of_links.append((joint.child, Frame(len(moving), pose)))
        of_joints.append((joint.name, Frame(len(moving), pose)))
    return serial_chain(
        moving,
        pose,
        name=robot.name or name,
        base=links[0],
        tip=links[-1],
        source=robot.where,
        links=of_links + of_joints,
    )


def fixed_links(robot: Robot) -> dict[str, Array]:
    """Return the poses of the links of a URDF in its root, (4, 4), lengths in [m]; all joints must be fixed.

    Raises:
        InvalidRobot: A check refuses the file, or a joint is movable.
    """
    refuse_file(robot)
    above = {joint.child: joint for joint in robot.joints}
    for joint in robot.joints:
        if joint.kind != "fixed":
            raise InvalidRobot(
                f"{robot.where}: {joint.part} is {joint.kind}, expected fixed: obstacles cannot move"
            )
    poses: dict[str, Array] = {}
    for link in robot.parents:
        way = [link]
        # Up to a link whose pose is known, without recursion: a chain may have thousands of links.
        while way[-1] not in poses and (parent := robot.parents[way[-1]]) is not None:
            way.append(parent)
        for name in reversed(way):
            if name not in poses:
                up = robot.parents[name]
                poses[name] = np.eye(4) if up is None else poses[up] @ above[name].pose
    return poses


def _moving_joint(joint: UrdfJoint, origin: Array, mimics: Mimics) -> Joint:
    refuse_arm(joint)
    leader, multiplier, offset = mimics.driver(joint.name)
    return Joint(
        name=joint.name,
        kind=joint.kind,
        origin=origin,
        axis=joint.axis,
        lower=joint.narrowed[0],
        upper=joint.narrowed[1],
        mimic=leader if joint.name in mimics else None,
        multiplier=multiplier,
        offset=offset,
        velocity=joint.velocity,
    )
