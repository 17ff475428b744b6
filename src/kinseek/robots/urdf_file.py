"""The links and joints of a URDF file as records, and how its numbers and origins are read.

A value that is missing or malformed is None or has its default here. `checks` reports it, and rejects the file if it has to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.support.transforms import rotation, transform

from .chain import Array
from .files import MOST_LINKS, MOST_NAME, require_few
from .joints import Mimics
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .xml_files import root_element

MOVING = (REVOLUTE, CONTINUOUS, PRISMATIC)
"""Types of joints that can be used between base and tip."""
JOINT_TYPES = (*MOVING, "fixed", "floating", "planar")


class UrdfLink:
    """One ``<link>``."""

    def __init__(self, element: Any) -> None:
        self.element = element
        self.name = str(element.get("name") or "")
        self.part = f"link {self.name!r}"
        """How messages name it."""


class UrdfJoint:
    """One ``<joint>``."""

    def __init__(self, element: Any) -> None:
        self.element = element
        self.name, self.kind = str(element.get("name") or ""), str(element.get("type") or "")
        self.part = f"joint {self.name!r}"
        """How messages name it."""
        self.moves = self.kind in MOVING
        """Whether the joint can be used between base and tip."""
        self.parent, self.child = (str(self.get(tag, "link") or "") for tag in ("parent", "child"))
        self.mimic = self._mimic() if element.find("mimic") is not None else None
        """The joint that this one follows, multiplier, and offset [rad] or [m]; None if it follows none."""
        lower, upper = (numbers(self.get("limit", end), 1) for end in ("lower", "upper"))
        self.limits = (-math.inf, math.inf) if lower is None or upper is None else (lower[0], upper[0])
        """Lower and upper limit, [rad] or [m]; infinite unless there are both."""
        self.is_limited = self.moves and self.kind != CONTINUOUS and self.limits[0] > -math.inf
        """Whether the joint has limits that are used."""
        self.soft = self._soft()
        """Soft limits, [rad] or [m]; infinite without any."""
        self.narrowed = max(self.limits[0], self.soft[0]), min(self.limits[1], self.soft[1])
        """The limits within the soft limits, [rad] or [m]."""

    def get(self, tag: str, attribute: str) -> str | None:
        """Return an attribute of an element of the joint."""
        element = self.element.find(tag)
        return None if element is None else element.get(attribute)

    @property
    def pose(self) -> Array:
        """Pose of the joint frame in the parent link, (4, 4), lengths in [m]."""
        xyz, rpy = (numbers(self.get("origin", name), 3) or (0.0, 0.0, 0.0) for name in ("xyz", "rpy"))
        return _pose(xyz, rpy)

    @property
    def axis(self) -> Array:
        """Axis of motion in the joint frame, (3,); the default of URDF is x."""
        return np.array(numbers(self.get("axis", "xyz"), 3) or (1.0, 0.0, 0.0))

    @property
    def normal(self) -> Array:
        """Normal of the plane of a planar joint in the joint frame, a unit vector, (3,); without an axis it is z.

        URDF defines x as the default of an axis, but MoveIt and pinocchio let all planar joints move in x and y.
        """
        if self.element.find("axis") is None:
            return np.array([0.0, 0.0, 1.0])
        return np.asarray(self.axis / np.linalg.norm(self.axis))

    @property
    def rates(self) -> tuple[float, float, float]:
        """Limits of velocity, acceleration and jerk, in the units of `RATES`; NaN if unknown.

        URDF 1.2 has acceleration and jerk too, and a separate limit for slowing down; here one limit holds in both
        directions, the smaller of the two.
        """
        fastest, jerk = self._rate("velocity"), self._rate("jerk")
        return fastest, float(np.fmin(self._rate("acceleration"), self._rate("deceleration"))), jerk

    def _rate(self, name: str) -> float:
        """Return a limit of the element ``<limit>``; NaN if unknown.

        URDF 1.0 requires a velocity in every limit, so files contain 0 for an unknown one. Poses do not depend on it: a
        value that is negative or malformed counts as unknown too.
        """
        (value,) = numbers(self.get("limit", name), 1) or (0.0,)
        return value if value > 0 else math.nan

    def _mimic(self) -> tuple[str, float, float]:
        (multiplier,), (offset,) = (
            numbers(self.get("mimic", name), 1) or (default,)
            for name, default in (("multiplier", 1.0), ("offset", 0.0))
        )
        return str(self.get("mimic", "joint") or ""), multiplier, offset

    def _soft(self) -> tuple[float, float]:
        """Return the limits ``<safety_controller soft_lower_limit=… soft_upper_limit=…>``.

        URDF defines 0 for a missing attribute. With a ``<safety_controller k_velocity=…>`` alone this would fix the joint at
        0, and tools that fill in defaults write 0 0 there. So a missing attribute is not a limit here, and neither is 0 0.
        """
        given = [self.get("safety_controller", end) for end in ("soft_lower_limit", "soft_upper_limit")]
        (lower,), (upper,) = numbers(given[0], 1) or (-math.inf,), numbers(given[1], 1) or (math.inf,)
        return (-math.inf, math.inf) if lower == upper == 0.0 else (lower, upper)


class Robot:
    """The links and joints of a URDF file."""

    def __init__(self, root: Any, where: str, packages: Mapping[str, str | Path] | None = None) -> None:
        """Take the root element of a file, its name for messages, and folders of ROS packages by name.

        Raises:
            InvalidRobot: The root is not a robot, it has too many links or joints, or a name is too long.
        """
        if root.tag != "robot":
            raise InvalidRobot(f"{where}: not a robot: the root tag is <{root.tag}>, expected <robot>")
        for noun in ("link", "joint"):
            require_few(sum(1 for _ in root.iterchildren(noun)), f"{noun}s", MOST_LINKS, where)
        self.root, self.where, self.packages = root, where, packages or {}
        self.name = str(root.get("name") or "")
        self.links = [UrdfLink(element) for element in root.iterchildren("link")]
        self.joints = [UrdfJoint(element) for element in root.iterchildren("joint")]
        self._require_short(self, *self.links, *self.joints)
        self.parents: dict[str, str | None] = {link.name: None for link in self.links}
        """The parent of each link, None for the root."""
        for joint in self.joints:
            if joint.parent in self.parents and joint.child in self.parents:
                self.parents[joint.child] = joint.parent

    def add_root(self, name: str, kind: str, parent: str, child: str) -> None:
        """Add a joint with the root as its child, and a link without geometry as its parent, also to the element.

        Raises:
            InvalidRobot: A name is too long.
        """
        make = self.root.makeelement
        link, joint = make("link", name=parent), make("joint", name=name, type=kind)
        joint.append(make("parent", link=parent))
        joint.append(make("child", link=child))
        self.root.append(link)
        self.root.append(joint)
        self.links.append(UrdfLink(link))
        self.joints.append(UrdfJoint(joint))
        self._require_short(self.links[-1], self.joints[-1])
        self.parents |= {parent: None, child: parent}

    def _require_short(self, *parts: Robot | UrdfLink | UrdfJoint) -> None:
        for part in parts:
            require_few(len(part.name), "letters in a name", MOST_NAME, self.where)

    @property
    def mimics(self) -> Mimics:
        """The moving joints that follow others."""
        return Mimics({joint.name: joint.mimic for joint in self.joints if joint.mimic and joint.moves})


def read_robot(text: bytes, where: str) -> Robot:
    """Parse a URDF.

    Raises:
        InvalidRobot: The text is broken XML, not a robot, or too large.
    """
    return Robot(root_element(text, where), where)


def parse_numbers(text: str, count: int) -> tuple[float, ...]:
    """Return the `count` finite numbers of an attribute.

    Raises:
        ValueError: These are not `count` finite numbers; the message says why.
    """
    words = text.split()
    if len(words) != count:
        raise ValueError(f"{len(words)} values, expected {count}")
    values = []
    for word in words:
        try:
            values.append(float(word.replace("_", "?")))  # Python alone would accept 1_000.
        except ValueError:
            raise ValueError(f"{word!r} is not a number") from None
        if not math.isfinite(values[-1]):
            raise ValueError(f"{word!r} is not finite")
    return tuple(values)


def numbers(text: str | None, count: int) -> tuple[float, ...] | None:
    """Return the `count` finite numbers of an attribute; None if it is missing or malformed."""
    try:
        return None if text is None else parse_numbers(text, count)
    except ValueError:
        return None


def numbers_of(text: str | None, count: int, default: float | None = None) -> Array:
    """Return the `count` finite numbers of an attribute.

    Raises:
        InvalidRobot: The attribute has another count of numbers, or is missing without a default.
    """
    if text is None and default is not None:
        return np.full(count, default)
    found = numbers(text, count)
    if found is None:
        raise InvalidRobot(f"expected {count} finite number{'s' if count > 1 else ''}, got {text!r}")
    return np.array(found)


def origin_of(element: Any) -> Array:
    """The <origin> of a shape, (4, 4), lengths in [m].

    Raises:
        InvalidRobot: It holds no finite numbers, or lies too far off.
    """
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    rpy, xyz = numbers_of(origin.get("rpy"), 3, 0.0), numbers_of(origin.get("xyz"), 3, 0.0)
    if (farthest := float(np.abs(xyz).max())) > LARGEST:
        raise InvalidRobot(f"an origin must lie within {LARGEST:g} m along each axis, got {farthest:g} m")
    return _pose(xyz, rpy)


def _pose(xyz: Sequence[float] | Array, rpy: Sequence[float] | Array) -> Array:
    """Return the pose of an origin, (4, 4): ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    turn = np.eye(3)
    for axis, angle in zip(np.eye(3), rpy, strict=True):
        turn = rotation(axis, float(angle)) @ turn
    return transform(turn, xyz)
