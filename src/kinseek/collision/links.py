"""Links of a robot's file around an arm: where each is, and which are neighbours."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot, InvalidScene, suggest
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.robots.chain import Frame, Limits, SerialChain
from kinseek.robots.mechanism import PRISMATIC
from kinseek.robots.tree import tree_path
from kinseek.robots.urdf import read_arm
from kinseek.robots.urdf_file import Robot, UrdfJoint, origin_of
from kinseek.support.transforms import rotation, transform
from kinseek.support.validation import as_number

Array = NDArray[np.float64]

_SAME = 1e-6
"""Tolerance for comparing the links of a file with those of the arm [m]."""


def same_robot(chain: SerialChain, root: Any, path: Path) -> Robot:
    """Return the links and joints of a file, given its root element, and check that they move as those of the arm.

    Raises:
        InvalidScene: They do not, or the file has no arm between these links.
    """
    try:
        robot = Robot(root, str(path))
        other = read_arm(robot, chain.base, chain.tip, limits=_ranges(chain))
    except InvalidRobot as error:
        raise InvalidScene(f"this file does not describe the arm {chain.name!r}: {error}") from error
    locked = dict(chain.locked)
    if set(other.joint_names) != {*chain.joint_names, *locked}:
        raise InvalidScene(
            f"{robot.where}: its joints between {chain.base!r} and {chain.tip!r} are {', '.join(other.joint_names)}, "
            f"those of the arm {', '.join(chain.joint_names)}"
        )
    # Names alone do not show that two files describe the same arm: poses at some joint values do.
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (3, chain.dof))
    full = np.stack(
        [
            q[:, chain.joint_names.index(name)]
            if name in chain.joint_names
            else np.full(len(q), locked[name])
            for name in other.joint_names
        ],
        axis=1,
    )
    ours = forward_many(chain.arrays_to(chain.frames[chain.tip]), q)
    theirs = forward_many(other.arrays_to(other.frames[chain.tip]), np.ascontiguousarray(full))
    if (off := float(np.abs(ours - theirs).max())) > _SAME:
        raise InvalidScene(
            f"{path}: link {chain.tip!r} is up to {off:.3g} m away from where the arm has it: this is another arm, or "
            f"a xacro file expanded with other arguments; give the URDF that the arm was loaded from as urdf="
        )
    return robot


def _ranges(chain: SerialChain) -> Limits:
    """Return the limits of the joints of an arm by name, locked ones included."""
    ranges = {name: (value, value) for name, value in chain.locked}
    return ranges | dict(
        zip(chain.joint_names, zip(chain.lower.tolist(), chain.upper.tolist(), strict=True), strict=True)
    )


def link_frames(
    robot: Robot, chain: SerialChain, joints: Mapping[str, float], notes: list[str]
) -> dict[str, Frame]:
    """Return the frame of every link of the file.

    Args:
        robot: The file.
        chain: The arm that is in it.
        joints: Values of joints that do not belong to the arm, [rad] or [m].
        notes: Notes on these values are appended here.

    Raises:
        InvalidScene: A joint beside the arm has another value than a number, or cannot be used.
    """
    spine = tree_path(robot.parents, chain.base, chain.tip).names[::-1]
    frames = {name: chain.frames[name] for name in spine}
    near: dict[str, list[tuple[str, UrdfJoint, bool]]] = {}
    for joint in robot.joints:
        near.setdefault(joint.parent, []).append((joint.child, joint, True))
        near.setdefault(joint.child, []).append((joint.parent, joint, False))
    others = _Others(robot, chain, joints)
    # Links beside the chain move with the link of the chain that they hang on.
    to_visit = list(spine)
    while to_visit:
        name = to_visit.pop()
        for link, joint, below in near.get(name, []):
            if link in frames:
                continue
            pose = others.pose(joint)
            frame = frames[name]
            frames[link] = Frame(frame.joints, frame.pose @ (pose if below else np.linalg.inv(pose)))
            to_visit.append(link)
    if unknown := [name for name in joints if name not in others.values]:
        raise InvalidScene(f"joints: {suggest(str(unknown[0]), others.values, 'joint beside the arm')}")
    notes.extend(
        f"joint {name!r} is not the arm's and stands at {value:g}" for name, value in others.values.items()
    )
    return frames


class _Others:
    """Values and poses of those joints of a file that do not belong to the arm."""

    def __init__(self, robot: Robot, chain: SerialChain, joints: Mapping[str, float]) -> None:
        self.robot, self.chain, self.given = robot, chain, joints
        self.values: dict[str, float] = {}
        self.mimics = robot.mimics
        self.limits = {joint.name: joint.limits for joint in robot.joints}

    def pose(self, joint: UrdfJoint) -> Array:
        """Return the pose of the child link in the parent link, (4, 4)."""
        origin = origin_of(joint.element)
        if joint.kind == "fixed":
            return origin
        if not joint.moves:
            raise InvalidScene(
                f"{self.robot.where}: {joint.part} is {joint.kind}; outside the arm only joints with one axis are supported"
            )
        leader, multiplier, offset = self.mimics.driver(joint.name)
        if leader in (*self.chain.joint_names, *dict(self.chain.locked)):
            raise InvalidScene(
                f"{self.robot.where}: {joint.part} follows {leader!r} of the arm, and is not between its base and its tip: "
                "such a joint is not supported"
            )
        value = multiplier * self._value(leader) + offset
        if not abs(value) <= LARGEST:
            raise InvalidScene(
                f"{self.robot.where}: {joint.part} must have a value of at most {LARGEST:g} rad or m, got {value:g}"
            )
        if not (axis := joint.axis).any():
            raise InvalidScene(f"{self.robot.where}: the axis of {joint.part} is 0 0 0, expected a direction")
        axis = axis / np.abs(axis).max()  # Squares of very large or small numbers would overflow, or vanish.
        axis = axis / np.linalg.norm(axis)
        if joint.kind == PRISMATIC:
            return np.asarray(origin @ transform(np.eye(3), value * axis))
        return np.asarray(origin @ transform(rotation(axis, value), np.zeros(3)))

    def _value(self, name: str) -> float:
        if name not in self.values:
            lower, upper = self.limits.get(name, (-np.inf, np.inf))
            value = self.given.get(name, min(max(0.0, lower), upper) if lower <= upper else 0.0)
            self.values[name] = as_number(
                f"joints: the value of {name!r}", value, -LARGEST, LARGEST, InvalidScene
            )
        return self.values[name]


def neighbours_of(robot: Robot, solid: set[str]) -> list[tuple[str, str]]:
    """Pairs of links with geometry that one joint connects, fixed links without geometry between them passed over."""
    above = {joint.child: (joint.parent, int(joint.kind != "fixed")) for joint in robot.joints}
    nearest: dict[str, tuple[str | None, int]] = {}
    """Of a link the nearest solid one above it, and how many joints move between them; at the base no link."""
    for end in above:
        link, climbed = end, list[str]()
        while link in above and link not in nearest:
            climbed.append(link)
            link = above[link][0]
        for below in reversed(climbed):
            parent, moves = above[below]
            solid_one, more = (parent, 0) if parent in solid else nearest.get(parent, (None, 0))
            nearest[below] = solid_one, moves + more
    return sorted(
        (parent, child)
        for child, (parent, moving) in nearest.items()
        if child in solid and parent is not None and moving <= 1
    )
