"""Arms that are groups of an SRDF, with their named joint values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from kinseek.errors import InvalidRobot, suggest
from kinseek.printable import printable
from kinseek.support.transforms import from_quaternion

from .chain import SerialChain
from .checks import refuse_file
from .files import require_few
from .several_axes import SEVERAL_AXES
from .srdf import Group, Srdf, VirtualJoint
from .urdf import Urdf
from .urdf_file import Robot, UrdfJoint, parse_numbers, read_robot
from .xml_files import text_of

Ends = tuple[str, str]
"""Names of a base link and a tip link."""

_MOST_CHAINS = 100
"""Most chains of a group with its subgroups."""
_TRIED = 100
"""Groups of a file that are tried for the list in a message."""


def arm_of_group(urdf: Urdf, base: str | None, tip: str | None, srdf: Srdf, group: str | None) -> SerialChain:
    """Read the arm that is a group of an SRDF, with the states of the group.

    Args:
        urdf: The robot.
        base: Name of the base link; the default is that of the group.
        tip: Name of the tip link; the default is that of the group.
        srdf: The SRDF of the robot.
        group: Name of the group. Without it, the base and tip are those of the URDF, and every state is the arm's.

    Raises:
        InvalidRobot: There is no such group, it is not one serial chain, or the arm cannot be used; or no group is given,
            and the robot has several leaves.
    """
    robot = read_robot(urdf.text, urdf.where)
    refuse_file(robot)
    virtual = _add_virtual_joint(robot, srdf)
    if group is not None:
        own_base, own_tip = _ends(srdf, group, robot)
        urdf = urdf._replace(base=own_base, tip=own_tip)
    elif base is None and tip is None and urdf.tip is None and len(_leaves(robot)) > 1 and srdf.groups:
        raise InvalidRobot(
            f"{urdf.where} has several leaves, so choose group= from the groups of {srdf.where}, or tip=. "
            f"{_serial_groups(srdf, robot)}"
        )
    ends = urdf.base if base is None else base, urdf.tip if tip is None else tip
    if virtual is not None and virtual.parent in ends:
        urdf = urdf._replace(text=text_of(robot.root))
    chain = urdf.arm(*ends)
    return replace(chain, srdf=srdf, states=_states(srdf, group, chain.joint_names))


def _add_virtual_joint(robot: Robot, srdf: Srdf) -> VirtualJoint | None:
    """Add the virtual joint of an SRDF to its robot, a planar or floating one if there are several; None if there is none.

    As in MoveIt, a virtual joint counts only if its child is the root of the robot.
    """
    root = next(link for link, parent in robot.parents.items() if parent is None)
    known = {joint.name for joint in robot.joints}
    found = [
        (name, joint)
        for name, joint in srdf.virtual.items()
        if joint.child == root
        and joint.kind in (*SEVERAL_AXES, "fixed")
        and name
        and name not in known
        and joint.parent
        and joint.parent not in robot.parents
    ]
    if not found:
        return None
    name, joint = min(found, key=lambda each: each[1].kind == "fixed")
    robot.add_root(name, joint.kind, joint.parent, joint.child)
    return joint


def _leaves(robot: Robot) -> set[str]:
    return robot.parents.keys() - set(robot.parents.values())


def _states(srdf: Srdf, group: str | None, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Return the values of an arm's joints, by joint, of each state of a group, or of all groups, by state.

    Raises:
        InvalidRobot: A value is not a finite number.
    """
    found: dict[str, dict[str, float]] = {}
    for state in srdf.states:
        values = {joint: text for joint, text in state.values if _variables(joint, names)}
        if not values or group not in (None, state.group):
            continue
        known = found.setdefault(state.name, {})
        for joint, text in values.items():
            variables = _variables(joint, names)
            try:
                known |= zip(variables, _numbers(text, len(variables)), strict=True)
            except ValueError as error:
                raise InvalidRobot(f"{srdf.where}: state {state.name!r}, joint {joint!r}: {error}") from None
    return found


def _variables(joint: str, names: Sequence[str]) -> list[str]:
    """Return the names of an arm's joints that make the motion of a joint, in the order of its values in an SRDF."""
    if joint in names:
        return [joint]
    return [
        f"{joint}/{axis}" for axis in ("x", "y", "z", "roll", "pitch", "yaw") if f"{joint}/{axis}" in names
    ]


def _numbers(text: str, count: int) -> tuple[float, ...]:
    """Return the values of a joint with so many variables; MoveIt has a quaternion, x y z w, for a floating joint.

    Raises:
        ValueError: The text has other values.
    """
    if count < 6:
        return parse_numbers(text, count)
    x, y, z, *xyzw = parse_numbers(text, 7)
    if not any(xyzw):
        raise ValueError("the quaternion is 0")
    turn = from_quaternion(np.array([xyzw[3], *xyzw[:3]]))
    roll, yaw = np.arctan2(turn[2, 1], turn[2, 2]), np.arctan2(turn[1, 0], turn[0, 0])
    pitch = np.arctan2(-turn[2, 0], np.hypot(turn[2, 1], turn[2, 2]))
    return x, y, z, float(roll), float(pitch), float(yaw)


def _serial_groups(srdf: Srdf, robot: Robot) -> str:
    """Return a sentence that lists the groups that are one serial chain, for messages."""
    serial = []
    for name in list(srdf.groups)[:_TRIED]:
        try:
            _ends(srdf, name, robot, hint=False)
        except InvalidRobot:
            continue
        serial.append(name)
    return f"Groups that are one serial chain: {', '.join(map(printable, serial)) or 'none'}"


def _ends(srdf: Srdf, name: str, robot: Robot, hint: bool = True) -> Ends:
    """Return the base and the tip of a group.

    Raises:
        InvalidRobot: There is no such group, or it is not one serial chain; with `hint` the message lists those that are.
    """
    if name not in srdf.groups:
        raise InvalidRobot(f"{srdf.where}: {suggest(name, srdf.groups, 'group')}")
    try:
        return _Members(srdf, name, robot).ends()
    except InvalidRobot as error:
        if not hint:
            raise
        raise InvalidRobot(f"{srdf.where}: group {name!r} {error}. {_serial_groups(srdf, robot)}") from None


class _Members:
    """The links and joints of a group and its subgroups. Messages continue the words "group 'name'"."""

    def __init__(self, srdf: Srdf, name: str, robot: Robot) -> None:
        self._srdf, self._robot = srdf, robot
        self._joints = {joint.name: joint for joint in robot.joints}
        self._above = {joint.child: joint for joint in robot.joints}
        self._chains: dict[Ends, None] = {}
        self._moved: dict[str, UrdfJoint] = {}
        """Joints of the group by name; those of its chains follow in `ends`."""
        self._links: dict[str, None] = {}
        """Further links that have to lie between the base and the tip."""
        for group in self._with_subgroups(name):
            self._add(group)
        require_few(len(self._chains), "chains", _MOST_CHAINS, "has")

    def _with_subgroups(self, name: str) -> Iterator[Group]:
        to_visit, seen = [name], {name}
        for one in to_visit:  # The list grows during the loop.
            if one not in self._srdf.groups:
                raise InvalidRobot(f"has {suggest(one, self._srdf.groups, 'subgroup')}")
            group = self._srdf.groups[one]
            to_visit += [sub for sub in dict.fromkeys(group.groups) if sub not in seen]
            seen |= set(group.groups)
            yield group

    def _add(self, group: Group) -> None:
        for chain in group.chains:
            self._chains[chain] = None
            for link in chain:
                self._require_link(link)
        for name in group.joints:
            if name in self._srdf.virtual and name not in self._joints:
                continue  # It moves nothing: it is fixed, or does not carry the root.
            if name not in self._joints:
                raise InvalidRobot(f"has {self._unknown(name, self._joints, 'joint')}")
            self._moved[name] = self._joints[name]
        for name in group.links:
            self._require_link(name)
            joint = self._above.get(name)
            if joint is None or joint.kind == "fixed" or joint.name in self._srdf.virtual:
                self._links[name] = None
            else:
                self._moved[joint.name] = joint

    def _require_link(self, name: str) -> None:
        if name not in self._robot.parents:
            raise InvalidRobot(f"has {self._unknown(name, self._robot.parents, 'link')}")

    def _unknown(self, name: str, valid: Iterable[str], noun: str) -> str:
        said = suggest(name, valid, noun)
        if self._srdf.robot in ("", self._robot.name):
            return said
        return f"{said}; the SRDF is of robot {self._srdf.robot!r}, the URDF of {self._robot.name!r}"

    def ends(self) -> Ends:
        """Return the base and the tip.

        Raises:
            InvalidRobot: The group is not one serial chain.
        """
        if len(self._chains) == 1 and not self._moved and not self._links:
            return next(iter(self._chains))
        for base, tip in self._chains:
            self._add_chain(base, tip)
        covered = dict.fromkeys(self._links)
        for joint in self._moved.values():
            covered |= {joint.parent: None, joint.child: None}
        if all(joint.kind == "fixed" for joint in self._moved.values()):
            raise InvalidRobot("has no joints that move")
        depth = _depths(self._robot)
        path = self._root_to(max(covered, key=depth.__getitem__))
        place = {link: i for i, link in enumerate(path)}
        if aside := next((link for link in covered if link not in place), None):
            raise InvalidRobot(f"branches: {path[-1]!r} and {aside!r} are not on one way from the root")
        path = path[min(place[link] for link in covered) :]
        for link in path[1:]:
            joint = self._above[link]
            if joint.kind != "fixed" and joint.mimic is None and joint.name not in self._moved:
                raise InvalidRobot(
                    f"leaves out joint {joint.name!r}, which moves between its links {path[0]!r} and {path[-1]!r}; give "
                    "these as base= and tip=, and lock the joint by with_locked"
                )
        return path[0], path[-1]

    def _add_chain(self, base: str, tip: str) -> None:
        path = self._root_to(tip)
        if base not in path:
            raise InvalidRobot(
                f"has more than a chain from {base!r} to {tip!r}, and its base is not above its tip"
            )
        self._links |= {base: None, tip: None}
        for link in path[path.index(base) + 1 :]:
            self._moved[self._above[link].name] = self._above[link]

    def _root_to(self, link: str) -> list[str]:
        path = [link]
        while (parent := self._robot.parents[path[-1]]) is not None:
            path.append(parent)
        return path[::-1]


def _depths(robot: Robot) -> dict[str, int]:
    """Return the number of joints above each link."""
    depth: dict[str, int] = {}
    for link in robot.parents:
        way = [link]
        # Up to a link whose depth is known, without recursion: a chain may have thousands of links.
        while way[-1] not in depth and (parent := robot.parents[way[-1]]) is not None:
            way.append(parent)
        start = depth.get(way[-1], 0)
        depth |= {name: start + i for i, name in enumerate(reversed(way))}
    return depth
