"""Read a serial arm from a URDF or xacro file.

Fixed joints are folded into the joints after them. Soft limits of a `<safety_controller>` narrow the limits of a joint, as
in MoveIt (`jointBoundsFromURDF` in moveit_core/robot_model). Meshes, masses, transmissions and simulator tags are ignored,
so ROS packages need not be installed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.transforms import rotation, transform
from kinseek.support.units import warn_of_joints

from .chain import Array, Frame, SerialChain
from .files import MOST_JOINTS, file_bytes, require_few
from .joints import Joint, Mimics, serial_chain
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .tree import frame_path
from .urdf_xml import expand_xacro, joint_velocities, kinematic_part, root_element, soft_limits

_MOVES = (REVOLUTE, CONTINUOUS, PRISMATIC)


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
    path = Path(path)
    if path.suffix.lower() == ".xacro":
        text = expand_xacro(path, args, packages, trusted)
        chain = read_urdf_text(text, base, tip, where=str(path), name=path.name.split(".")[0])
        return replace(chain, packages=dict(packages or {}))
    if args or packages:
        raise InvalidRobot(f"args and packages are for .xacro files, got {str(path)!r}")
    return read_urdf_text(file_bytes(path), base, tip, where=str(path), name=path.name.split(".")[0])


def read_urdf_text(
    text: bytes, base: str | None = None, tip: str | None = None, *, where: str, name: str = "robot"
) -> SerialChain:
    """Read the arm between two links of a URDF text.

    Args:
        text: The URDF.
        base: As in `read_urdf`.
        tip: As in `read_urdf`.
        where: Source of the text, for messages.
        name: Name of the robot, if the text has none.

    Raises:
        InvalidRobot: As `read_urdf`.
    """
    return UrdfTree(text, where, name).arm(base, tip)


class UrdfTree:
    """The links and joints of a URDF, parsed once; `arm` extracts arms."""

    def __init__(self, text: bytes, where: str, name: str = "robot") -> None:
        """Parse a URDF; the arguments are those of `read_urdf_text`.

        Raises:
            InvalidRobot: The text cannot be parsed, or its links do not form a tree.
        """
        self._text, self._where = text, where
        # Numbers that overflow are rejected later, with the name of their joint.
        with np.errstate(all="ignore"):
            root = root_element(text, where)
            robot = _parse(kinematic_part(root, name, where), where)
        self._name = robot.name
        self._velocities, self._softs = joint_velocities(root), soft_limits(root, where)
        self._parents = _link_tree(robot, where)
        self._leaves = self._parents.keys() - {parent for parent in self._parents.values() if parent}
        self._above = {joint.child: joint for joint in robot.joints}
        self._moved = {joint.child for joint in robot.joints if joint.type != "fixed"}
        self._mimics = Mimics(
            {
                joint.name: (
                    joint.mimic.joint,
                    1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier,
                    0.0 if joint.mimic.offset is None else joint.mimic.offset,
                )
                for joint in robot.joints
                if joint.mimic is not None and joint.type in _MOVES
            }
        )

    def arm(self, base: str | None = None, tip: str | None = None) -> SerialChain:
        """Return the arm between two links, with the arguments of `read_urdf`.

        Raises:
            InvalidRobot: There is no such arm.
        """
        with np.errstate(all="ignore"):  # Overflowing numbers are rejected when the chain is built.
            chain = self._arm(base, tip)
        warn_of_joints(
            chain.joint_names,
            chain.kinds,
            chain.lower,
            chain.upper,
            self._where,
            "write radians, as URDF has them",
        )
        return replace(chain, urdf=self._text)

    def _arm(self, base: str | None, tip: str | None) -> SerialChain:
        links = frame_path(self._parents, base, tip, ends=self._leaves, noun="link", moving=self._moved)
        path_joints = [self._above[link] for link in links[1:]]
        count = sum(joint.type != "fixed" for joint in path_joints)
        require_few(count, "moving joints between base and tip", MOST_JOINTS, self._where)
        moving, pose = [], np.eye(4)
        of_links, of_joints = [], []
        for joint in path_joints:
            pose = pose @ _origin(joint)
            if joint.type != "fixed":
                velocity = self._velocities.get(joint.name, np.nan)
                soft = self._softs.get(joint.name, (-np.inf, np.inf))
                moving.append(_moving_joint(joint, pose, self._mimics, velocity, soft))
                pose = np.eye(4)
            of_links.append((joint.child, Frame(len(moving), pose)))
            of_joints.append((joint.name, Frame(len(moving), pose)))
        return serial_chain(
            moving,
            pose,
            name=self._name,
            base=links[0],
            tip=links[-1],
            source=self._where,
            links=of_links + of_joints,
        )


def fixed_links(text: bytes, where: str) -> dict[str, Array]:
    """Return the poses of the links of a URDF in its root, (4, 4), lengths in [m]; all joints must be fixed.

    Raises:
        InvalidRobot: The text is not a URDF, its links do not form a tree, or a joint is movable.
    """
    robot = _parse(kinematic_part(root_element(text, where), "obstacles", where), where)
    parents = _link_tree(robot, where)
    above = {joint.child: joint for joint in robot.joints}
    for joint in robot.joints:
        if joint.type != "fixed":
            raise InvalidRobot(
                f"{where}: joint {joint.name!r} is {joint.type}, expected fixed: obstacles cannot move"
            )
    poses: dict[str, Array] = {}
    for link in parents:
        way = [link]
        # Up to a link whose pose is known, without recursion: a chain may have thousands of links.
        while way[-1] not in poses and (parent := parents[way[-1]]) is not None:
            way.append(parent)
        for name in reversed(way):
            if name not in poses:
                up = parents[name]
                poses[name] = np.eye(4) if up is None else poses[up] @ _origin(above[name])
    return poses


def _parse(kinematics: Any, where: str) -> Any:
    with importing:
        from lxml import etree
        from urdf_parser_py.urdf import URDF

    try:
        return URDF.from_xml_string(etree.tostring(kinematics))
    except Exception as error:  # The parser raises whatever its conversions raise.
        raise_of_handler(error)
        raise InvalidRobot(f"{where}: {error}") from None


def _link_tree(robot: Any, where: str) -> dict[str, str | None]:
    """Return the parent of each link, None for the root, and check that the links form a tree."""
    for noun, names in (
        ("link", [link.name for link in robot.links]),
        ("joint", [joint.name for joint in robot.joints]),
    ):
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            raise InvalidRobot(f"{where}: duplicate {noun} names: {', '.join(twice)}")
    if not robot.links:
        raise InvalidRobot(f"{where}: the robot has no links")

    parents: dict[str, str | None] = {link.name: None for link in robot.links}
    for joint in robot.joints:
        for link in (joint.parent, joint.child):
            if link not in parents:
                raise InvalidRobot(
                    f"{where}: joint {joint.name!r} refers to link {link!r}, which does not exist"
                )
        if parents[joint.child] is not None:
            raise InvalidRobot(
                f"{where}: link {joint.child!r} has two parents, "
                f"{parents[joint.child]!r} and {joint.parent!r}"
            )
        parents[joint.child] = joint.parent
    _check_loops(parents, where)
    if len(roots := [link for link, parent in parents.items() if parent is None]) > 1:
        raise InvalidRobot(f"{where}: several root links, expected one: {', '.join(roots)}")
    return parents


def _check_loops(parents: dict[str, str | None], where: str) -> None:
    rooted: set[str | None] = {None}
    for start in parents:
        path: dict[str, None] = {}  # In the order in which they were visited.
        link: str | None = start
        while link is not None and link not in rooted:
            if link in path:
                met = list(path)
                loop = [*met[met.index(link) :], link]
                raise InvalidRobot(f"{where}: the links form a loop: {' -> '.join(reversed(loop))}")
            path[link] = None
            link = parents[link]
        rooted.update(path)


def _origin(joint: Any) -> Array:
    """Return the pose of the joint frame in the parent link, (4, 4): ``Rz(yaw) Ry(pitch) Rx(roll)``, lengths in [m]."""
    if joint.origin is None:
        return np.eye(4)
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), joint.origin.rpy, strict=True):
        turn = rotation(axis, angle) @ turn
    return transform(turn, joint.origin.xyz)


def _moving_joint(
    joint: Any,
    origin: Array,
    mimics: Mimics,
    velocity: float,
    soft: tuple[float, float],
) -> Joint:
    if joint.type not in _MOVES:
        raise InvalidRobot(
            f"joint {joint.name!r} is {joint.type}: between base and tip only fixed, {', '.join(_MOVES)} "
            f"joints can be used. Choose base={joint.child!r} to leave it out"
        )
    leader, multiplier, offset = mimics.driver(joint.name)
    follows = joint.name in mimics
    lower, upper = (joint.limit.lower, joint.limit.upper) if joint.limit else (-np.inf, np.inf)
    if joint.limit is None and joint.type != CONTINUOUS and not follows:
        raise InvalidRobot(
            f"joint {joint.name!r} is {joint.type} and needs a <limit> with both lower and upper"
        )
    inner = (max(lower, soft[0]), min(upper, soft[1]))
    if joint.type != CONTINUOUS and lower <= upper and inner[0] > inner[1]:
        raise InvalidRobot(
            f"joint {joint.name!r}: soft limits [{soft[0]:g}, {soft[1]:g}] of its <safety_controller> leave no value within "
            f"the limits [{lower:g}, {upper:g}]"
        )
    return Joint(
        name=joint.name,
        kind=joint.type,
        origin=origin,
        axis=np.array([1.0, 0.0, 0.0] if joint.axis is None else joint.axis),
        lower=inner[0],
        upper=inner[1],
        mimic=leader if follows else None,
        multiplier=multiplier,
        offset=offset,
        velocity=velocity,
    )
