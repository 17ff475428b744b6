"""Read a serial arm from a URDF or xacro file.

Fixed joints are folded into the joints after them. Planar and floating joints become several joints (`several_axes`). Soft
limits of a `<safety_controller>` narrow the limits of a joint, as in MoveIt (`jointBoundsFromURDF` in
moveit_core/robot_model). Meshes, masses, transmissions and simulator tags are ignored, so no ROS package is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.support.units import warn_of_joints

from .chain import Array, Frame, Limits, SerialChain
from .checks import refuse_arm, refuse_file
from .files import MOST_JOINTS, file_bytes, require_few
from .joints import Joint, Mimics, Segment, joined, serial_chain
from .several_axes import SEVERAL_AXES, joints_of
from .tree import frame_path
from .urdf_file import Robot, UrdfJoint, read_robot


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
    limits: Mapping[str, tuple[float, float]] = {}
    """Limits of the slides of planar and floating joints."""

    def arm(self, base: str | None, tip: str | None) -> SerialChain:
        """Read the arm between two links.

        Raises:
            InvalidRobot: As `read_urdf`.
        """
        chain = read_arm(read_robot(self.text, self.where), base, tip, self.name, self.limits)
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
    if path.suffix.lower() == ".xacro":
        from .xacro import expand_xacro

        text = expand_xacro(path, args, packages, trusted)
    elif args or packages:
        raise InvalidRobot(f"args and packages are for .xacro files, got {str(path)!r}")
    else:
        text = file_bytes(path)
    return Urdf(text, str(path), path.name.split(".")[0], packages or {})


def read_urdf(
    path: str | Path,
    base: str | None = None,
    tip: str | None = None,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
    limits: Limits | None = None,
) -> SerialChain:
    """Read the arm between two links of a ``.urdf`` or ``.xacro`` file.

    Args:
        path: The file; a file with the extension ``.xacro`` is expanded first.
        base: Name of the base link; the default is the root of the tree.
        tip: Name of the link whose pose is computed; the default is the only leaf of the tree.
        args: Values of a xacro file's arguments, by name.
        packages: Folders of ROS packages for a xacro file, by name.
        trusted: Whether Python may evaluate the expressions of a xacro file.
        limits: Limits of planar and floating joints, see `several_axes.joints_of`.

    Raises:
        InvalidRobot: The file, the tree of links, or a joint between base and tip cannot be used.
    """
    urdf = urdf_of_file(path, args=args, packages=packages, trusted=trusted)
    return urdf._replace(limits=limits or {}).arm(base, tip)


def read_arm(
    robot: Robot, base: str | None, tip: str | None, name: str = "robot", limits: Limits | None = None
) -> SerialChain:
    """Read the arm between two links of a robot, as `Urdf.arm` does.

    Raises:
        InvalidRobot: A check refuses the file or the arm.
    """
    refuse_file(robot)
    return arm_of(robot, base, tip, name, limits)


def arm_of(
    robot: Robot, base: str | None, tip: str | None, name: str = "robot", limits: Limits | None = None
) -> SerialChain:
    """Read the arm between two links of a robot of which no check refuses the file.

    Raises:
        InvalidRobot: There is no such arm, or a check refuses it.
    """
    with np.errstate(all="ignore"):  # Overflowing numbers are rejected when the chain is built.
        chain = _chain(robot, base, tip, name, limits or {})
    warn_of_joints(
        chain.joint_names,
        chain.kinds,
        chain.lower,
        chain.upper,
        robot.where,
        "write radians, as URDF has them",
    )
    return chain


def _chain(robot: Robot, base: str | None, tip: str | None, name: str, limits: Limits) -> SerialChain:
    leaves = robot.parents.keys() - {parent for parent in robot.parents.values() if parent}
    moved = {joint.child for joint in robot.joints if joint.kind != "fixed"}
    path = frame_path(robot.parents, base, tip, ends=leaves, noun="link", moving=moved)
    above = {joint.child: joint for joint in robot.joints}
    count = sum(above[link].kind != "fixed" for link in (*path.up[1:], *path.down[1:]))
    require_few(count, "moving joints between base and tip", MOST_JOINTS, robot.where)
    up, down = (_segment(links, above, robot.mimics, limits) for links in path)
    joints, end, frames = joined(up, down)
    return serial_chain(
        joints,
        end,
        name=robot.name or name,
        base=path.names[0],
        tip=path.names[-1],
        source=robot.where,
        links=frames,
    )


def _segment(links: list[str], above: Mapping[str, UrdfJoint], mimics: Mimics, limits: Limits) -> Segment:
    """Return the joints from the first of some links down to the last one; `above` has the joint above each link."""
    moving, pose = list[Joint](), np.eye(4)
    of_links, of_joints = [(links[0], Frame(0, pose))], []
    for joint in (above[link] for link in links[1:]):
        pose = pose @ joint.pose
        if joint.kind != "fixed":
            moving += _moving_joints(joint, pose, mimics, limits)
            pose = np.eye(4)
        of_links.append((joint.child, Frame(len(moving), pose)))
        of_joints.append((joint.name, Frame(len(moving), pose)))
    return Segment(moving, pose, of_links + of_joints)


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


def _moving_joints(joint: UrdfJoint, origin: Array, mimics: Mimics, limits: Limits) -> list[Joint]:
    """Return the joints with one variable each that make the motion of a joint."""
    refuse_arm(joint)
    if joint.kind in SEVERAL_AXES:
        return joints_of(joint.name, joint.kind, origin, joint.normal, limits, joint.child)
    leader, multiplier, offset = mimics.driver(joint.name)
    return [
        Joint(
            name=joint.name,
            kind=joint.kind,
            origin=origin,
            axis=joint.axis,
            lower=joint.narrowed[0],
            upper=joint.narrowed[1],
            mimic=leader if joint.name in mimics else None,
            multiplier=multiplier,
            offset=offset,
            rates=joint.rates,
        )
    ]
