"""The checks of a URDF file: each is one function, and `CHECKS` lists all of them.

Reading an arm raises the first finding of the checks that refuse a file or an arm. `kinseek check` reports what all checks
find (`soundness`).

A check of a robot yields a part, such as ``joint 'a'`` or an empty string, and a sentence. A check of a link or a joint
yields what follows its name in the sentence.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot, near_names, suggest, unknown
from kinseek.support.turns import TURN, holds_a_turn
from kinseek.support.units import TURNS_OF_A_JOINT

from .joints import wrong_axis, wrong_limits
from .mechanism import CONTINUOUS, PRISMATIC, RATES, REVOLUTE
from .packages import in_package, mesh_path
from .several_axes import SEVERAL_AXES
from .urdf_file import JOINT_TYPES, MOVING, Robot, UrdfJoint, UrdfLink, numbers, parse_numbers
from .xml_files import XACRO

_FAR = 100.0
"""Lengths beyond this [m] are reported: the file was probably written in millimetres."""
_ROUNDED = 1e-3
"""Rounding tolerance for angles against a turn, and principal moments against the triangle inequality."""
_SUGGESTED = 20
"""Unknown names for which suggestions are computed: a file with more of them has another error than a misspelt name."""
_NAMED = 8
"""Most links or joints in one sentence."""

_ONCE = ("origin", "parent", "child", "axis", "limit", "mimic", "safety_controller")
"""Elements that a joint has at most once."""
_REQUIRED = {"parent": "link", "child": "link", "axis": "xyz", "mimic": "joint"}
"""Attributes that these elements of a joint must have."""
_READ = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""Numbers of a joint that are read, and how many each attribute has."""
_ENDS = {tag: tuple(_READ[tag]) for tag in ("limit", "safety_controller")}
"""Attributes that limit a joint."""
_IGNORED = {
    "limit": dict.fromkeys(("effort", *RATES, "deceleration"), 1),
    "inertial/mass": {"value": 1},
    "inertial/inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
}
"""Numbers of a joint or link that kinematics does not need."""

Found = Iterator[tuple[str, str]]
"""Parts and sentences."""


class Severity(Enum):
    """Severity of a finding; the value is for display."""

    ERROR = "error"
    """The robot is invalid, or kinseek rejects it."""
    WARNING = "warning"
    """The robot can be read, or the part can be left out, and it is probably a mistake."""
    NOTE = "note"
    """Useful information; a correct file may have it."""


class Refuses(Enum):
    """What cannot be read if a check finds something."""

    NOTHING = 0
    FILE = 1
    ARM = 2
    """Arms that have the joint between base and tip; for checks of joints alone."""


# The whole file


def other_formats(robot: Robot) -> Found:
    """Find commands of xacro, and origins with a quaternion, which urdfdom reads in files of version 1.1 and later."""
    # xacro knows its commands by their prefix, and many files name another address than it does.
    if robot.root.xpath(f"descendant::*[namespace-uri() = '{XACRO}' or starts-with(name(), 'xacro:')]"):
        yield "", "the file has xacro commands; rename it to .xacro to expand them"
    for origin in robot.root.iterfind(".//origin[@quat_xyzw]"):
        line = origin.sourceline
        yield "", f"an <origin> in line {line} has quat_xyzw, which is not supported, expected rpy"


def missing_names(robot: Robot) -> Found:
    """Find links and joints without a name."""
    parts: list[UrdfLink | UrdfJoint] = [*robot.links, *robot.joints]
    for each in parts:
        if not each.name:
            noun = each.element.tag
            yield noun, f"a <{noun}> in line {each.element.sourceline} has no name"


def repeated_names(robot: Robot) -> Found:
    """Find names of several links or joints."""
    for noun, parts in (("link", robot.links), ("joint", robot.joints)):
        twice = [name for name, count in Counter(each.name for each in parts).items() if name and count > 1]
        if twice:
            yield "", f"duplicate {noun} names: {some(twice)}"


def unknown_links(robot: Robot) -> Found:
    """Find joints that refer to links that do not exist."""
    count = 0
    for joint in robot.joints:
        for name in (joint.parent, joint.child):
            if name and name not in robot.parents:
                count += 1
                known = [link for link in robot.parents if link] if count <= _SUGGESTED else []
                near = " or ".join(map(repr, near_names(name, known)))
                what = f"{joint.part} refers to link {name!r}, which does not exist"
                yield joint.part, f"{what}; did you mean {near}?" if near else what


def two_parents(robot: Robot) -> Found:
    """Find links with several parents."""
    parents: dict[str, str] = {}
    for joint in robot.joints:
        if joint.parent in robot.parents and joint.child in robot.parents:
            if joint.child in parents:
                part = f"link {joint.child!r}"
                yield part, f"{part} has two parents, {parents[joint.child]!r} and {joint.parent!r}"
            parents[joint.child] = joint.parent


def loops(robot: Robot) -> Found:
    """Find links that hang on themselves."""
    rooted: set[str | None] = {None}
    for start in robot.parents:
        way: dict[str, None] = {}  # In the order in which they were visited.
        link: str | None = start
        while link is not None and link not in rooted and link not in way:
            way[link] = None
            link = robot.parents[link]
        if link in way:
            met = list(way)
            loop = [*met[met.index(str(link)) :], str(link)][::-1]
            yield "", f"the links form a loop: {some(loop, ' -> ')}"
        rooted.update(way)


def roots(robot: Robot) -> Found:
    """Find links that hang on nothing, besides the root."""
    if not robot.links:
        yield "", "the robot has no links"
    found = [link for link, parent in robot.parents.items() if parent is None]
    if len(found) > 1:
        yield "", f"several root links, expected one: {some(found)}"


def leaders(robot: Robot) -> Found:
    """Find mimic joints of a joint that does not exist or does not move, and those that follow one another."""
    kinds, mimics = {joint.name: joint.kind for joint in robot.joints}, robot.mimics
    count, looped = 0, False
    for joint in robot.joints:
        leader = "" if joint.mimic is None else joint.mimic[0]
        if leader and leader not in kinds:
            count += 1
            known = [name for name in kinds if name] if count <= _SUGGESTED else []
            yield joint.part, f"{joint.part} mimics {unknown(leader, known, 'joint')}"
        elif leader and kinds[leader] not in MOVING:
            yield joint.part, f"{joint.part} mimics {leader!r}, which is {kinds[leader]}"
        try:
            mimics.driver(joint.name)
        except InvalidRobot as error:
            if not looped:  # One line per loop; two loops are rarer than two joints in one.
                yield joint.part, str(error)
            looped = True


def lost_meshes(robot: Robot) -> Found:
    """Find meshes whose files are missing."""
    lost: dict[str, list[str]] = {}
    for name in dict.fromkeys(mesh.get("filename") or "" for mesh in robot.root.iter("mesh")):
        try:
            package, _ = in_package(name) or ("", "")
        except InvalidRobot as error:
            yield "mesh", str(error)
            continue
        if not name:
            yield "mesh", "a <mesh> has no filename"
        elif not _is_there(name, robot):
            lost.setdefault(package, []).append(name)
    for package, names in lost.items():
        if package:
            part = f"package {package!r}"
            yield part, f"{part}: not found, or not all of it: {len(names)} meshes, {some(names, most=2)}"
            continue
        for name in names:
            yield f"mesh {name!r}", f"mesh {name!r}: not found"


def missing_masses(robot: Robot) -> Found:
    """Find links without a mass, which a simulator needs."""
    without = [link.name for link in robot.links if link.element.find("inertial") is None]
    if robot.links and len(without) == len(robot.links):
        yield "", "no link has a mass: kinematics does not need masses, a simulator does"
    elif without:
        yield "", f"{len(without)} of {len(robot.links)} links have no mass: {some(without)}"


# Each link


def ignored_numbers(each: UrdfLink | UrdfJoint) -> Iterator[str]:
    """Find malformed numbers that kinematics does not need."""
    yield from _malformed(each, _IGNORED)


def masses(link: UrdfLink) -> Iterator[str]:
    """Find masses and inertias that are missing, and masses that are not above 0."""
    inertial = link.element.find("inertial")
    if inertial is None:
        return
    mass = inertial.find("mass")
    if mass is None or mass.get("value") is None:
        yield ": <inertial> has no mass"
    elif (value := numbers(mass.get("value"), 1)) is not None and not value[0] > 0:
        yield f": mass {value[0]:g} kg, expected more than 0"
    if inertial.find("inertia") is None:
        yield ": <inertial> has no inertia"


def inertias(link: UrdfLink) -> Iterator[str]:
    """Find inertias of no body: principal moments are positive, and none is larger than the other two together."""
    inertia = link.element.find("inertial/inertia")
    if inertia is None:
        return
    moments = "ixx", "iyy", "izz"
    if missing := [name for name in moments if inertia.get(name) is None]:
        yield f": inertia has no {missing[0]}"
        return
    names = (*moments, "ixy", "ixz", "iyz")
    found = [numbers(inertia.get(name, "0"), 1) for name in names]
    if None in found:
        return
    xx, yy, zz, xy, xz, yz = (each[0] for each in found if each is not None)
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    small, middle, large = np.linalg.eigvalsh(matrix)
    what = ": inertia is not that of a body: "
    if not small > 0:
        yield f"{what}its least principal moment is {small:.3g} kg m², expected more than 0"
    elif large > (small + middle) * (1 + _ROUNDED):
        others = f"{large:.3g} > {small:.3g} + {middle:.3g} kg m²"
        yield f"{what}the largest principal moment is more than the others together, {others}"


# Each joint


def joint_type(joint: UrdfJoint) -> Iterator[str]:
    """Find types that URDF does not have."""
    if joint.kind not in JOINT_TYPES:
        what = suggest(joint.kind, JOINT_TYPES, "joint type") if joint.kind else "no type"
        yield f": {what}"


def joint_elements(joint: UrdfJoint) -> Iterator[str]:
    """Find elements that are missing or repeated, and those without a required attribute."""
    for tag in _ONCE:
        found = joint.element.findall(tag)
        if len(found) > 1:
            yield f": {len(found)} <{tag}> elements, expected one"
        elif not found and tag in ("parent", "child"):
            yield f": no <{tag}>"
        elif found and tag in _REQUIRED and not found[0].get(_REQUIRED[tag]):
            yield f": <{tag}> has no {_REQUIRED[tag]}"


def joint_numbers(joint: UrdfJoint) -> Iterator[str]:
    """Find malformed numbers."""
    yield from _malformed(joint, _READ)


def several_axes(joint: UrdfJoint) -> Iterator[str]:
    """Find joints that are read as several joints."""
    if joint.kind in SEVERAL_AXES:
        yield f" is {joint.kind}: between base and tip it needs the limits= of kinseek.load, as files have none for it"


def needs_limits(joint: UrdfJoint) -> Iterator[str]:
    """Find joints without a lower or an upper limit."""
    missing = any(joint.get("limit", end) is None for end in _ENDS["limit"])
    if missing and joint.moves and joint.kind != CONTINUOUS and joint.mimic is None:
        yield f" is {joint.kind} and needs a <limit> with both lower and upper"


def limits_in_order(joint: UrdfJoint) -> Iterator[str]:
    """Find reversed limits; those of mimic joints are ignored."""
    if joint.is_limited and joint.mimic is None and (why := wrong_limits(*joint.limits)):
        yield f": {why}"


def soft_limits(joint: UrdfJoint) -> Iterator[str]:
    """Find soft limits that leave no value."""
    lower, upper = joint.limits
    if joint.moves and joint.kind != CONTINUOUS and lower <= upper and joint.narrowed[0] > joint.narrowed[1]:
        yield (
            f": soft limits [{joint.soft[0]:g}, {joint.soft[1]:g}] of its <safety_controller> leave no value within the "
            f"limits [{lower:g}, {upper:g}]"
        )


def unit_axis(joint: UrdfJoint) -> Iterator[str]:
    """Find axes whose length is not 1."""
    if (joint.moves or joint.kind == "planar") and (why := wrong_axis(joint.axis)):
        yield f": {why}"


def default_axis(joint: UrdfJoint) -> Iterator[str]:
    """Find joints without an axis."""
    if joint.moves and joint.element.find("axis") is None:
        yield ": no <axis>: the default of URDF is used, 1 0 0"


def units(joint: UrdfJoint) -> Iterator[str]:
    """Find angles and lengths of origins and limits that are probably in other units."""
    degrees, millimetres = "URDF uses radians, are these degrees?", "URDF uses metres, are these millimetres?"
    rpy, xyz = (numbers(joint.get("origin", name), 3) for name in ("rpy", "xyz"))
    if rpy is not None and max(map(abs, rpy)) > TURN * (1 + _ROUNDED):
        yield f": origin rpy={joint.get('origin', 'rpy')!r} is more than a full turn; {degrees}"
    if xyz is not None and max(map(abs, xyz)) > _FAR:
        yield f": origin xyz={joint.get('origin', 'xyz')!r} is more than {_FAR:g} m; {millimetres}"
    (lower, upper), farthest = joint.limits, max(-joint.limits[0], joint.limits[1])
    if joint.is_limited and joint.kind == REVOLUTE and farthest > TURNS_OF_A_JOINT:
        yield f": limits [{lower:g}, {upper:g}] are many turns; {degrees}"
    if joint.is_limited and joint.kind == PRISMATIC and farthest > _FAR:
        yield f": limits [{lower:g}, {upper:g}] are more than {_FAR:g} m; {millimetres}"


def stuck(joint: UrdfJoint) -> Iterator[str]:
    """Find joints that cannot move."""
    (lower, upper), soft = joint.limits, joint.narrowed
    # Files contain 0 0 for limits of mimic joints that nobody specified.
    if joint.is_limited and lower == upper and joint.mimic is None:
        yield f" cannot move: both limits are {lower:g}"
    elif joint.is_limited and lower < upper and soft[0] == soft[1]:
        yield f" cannot move: its soft limits leave only {soft[0]:g}"
    elif joint.moves and joint.mimic is not None and joint.mimic[1] == 0:
        yield " mimics with multiplier 0: it does not move"


def odd_limits(joint: UrdfJoint) -> Iterator[str]:
    """Find limits of effort and of `RATES` below 0, and reversed limits of mimic joints."""
    for name in _IGNORED["limit"]:
        value = numbers(joint.get("limit", name), 1)
        if joint.is_limited and value is not None and value[0] < 0:
            yield f": {name} limit {value[0]:g} is below 0"
    if joint.is_limited and joint.mimic is not None and (why := wrong_limits(*joint.limits)):
        yield f" mimics another joint, and its limits are ignored: {why}"


def unused_limits(joint: UrdfJoint) -> Iterator[str]:
    """Find limits that are ignored."""
    for tag, ends in _ENDS.items():
        if joint.kind == CONTINUOUS and any(joint.get(tag, end) is not None for end in ends):
            yield f" is continuous, so its limits in <{tag}> are ignored"
    if not joint.is_limited:
        return
    if joint.mimic is None and numbers(joint.get("limit", "velocity"), 1) == (0.0,):
        yield ": velocity limit 0: its speed is treated as unknown, and a tracker does not bound it"
    given = [numbers(joint.get("safety_controller", end), 1) for end in _ENDS["safety_controller"]]
    if given == [(0.0,), (0.0,)]:
        yield ": both soft limits are 0: they are read as if they were missing"


def narrowed_limits(joint: UrdfJoint) -> Iterator[str]:
    """Find soft limits inside of the limits."""
    (lower, upper), soft = joint.limits, joint.narrowed
    if joint.is_limited and lower <= upper and soft != (lower, upper) and soft[0] < soft[1]:
        yield f": soft limits narrow [{lower:g}, {upper:g}] to [{soft[0]:g}, {soft[1]:g}], as in MoveIt"


def nearly_a_turn(joint: UrdfJoint) -> Iterator[str]:
    """Find limits that are rounded, so that they are a little less than a full turn."""
    lower, upper = joint.limits
    short = TURN - (upper - lower)
    if joint.kind != REVOLUTE or not 0.0 < short < _ROUNDED:
        return
    if not holds_a_turn(np.array(lower), np.array(upper)):
        yield (
            f": limits [{lower:.15g}, {upper:.15g}] are {short:.2g} rad short of a full turn, and no motion "
            f'crosses the gap; if a full turn is meant, write 15 digits or more, or type="continuous"'
        )


class Check(NamedTuple):
    """One check, and what its findings mean."""

    of: Literal["robot", "link", "joint"]
    """What it examines: the ``"robot"``, each ``"link"`` or each ``"joint"``."""
    find: Callable[[Any], Iterator[Any]]
    severity: Severity
    refuses: Refuses = Refuses.NOTHING


_ERROR, _WARNING, _NOTE = Severity

CHECKS = (
    Check("robot", other_formats, _ERROR, Refuses.FILE),
    Check("robot", missing_names, _ERROR, Refuses.FILE),
    Check("joint", joint_type, _ERROR, Refuses.FILE),
    Check("joint", joint_elements, _ERROR, Refuses.FILE),
    Check("joint", joint_numbers, _ERROR, Refuses.FILE),
    Check("robot", repeated_names, _ERROR, Refuses.FILE),
    Check("robot", unknown_links, _ERROR, Refuses.FILE),
    Check("robot", two_parents, _ERROR, Refuses.FILE),
    Check("robot", loops, _ERROR, Refuses.FILE),
    Check("robot", roots, _ERROR, Refuses.FILE),
    Check("joint", needs_limits, _ERROR, Refuses.ARM),
    Check("joint", limits_in_order, _ERROR, Refuses.ARM),
    Check("joint", soft_limits, _ERROR, Refuses.ARM),
    Check("joint", unit_axis, _ERROR, Refuses.ARM),
    Check("robot", leaders, _ERROR),
    Check("joint", several_axes, _WARNING),
    Check("joint", ignored_numbers, _WARNING),
    Check("link", ignored_numbers, _WARNING),
    Check("joint", units, _WARNING),
    Check("joint", stuck, _WARNING),
    Check("joint", odd_limits, _WARNING),
    Check("link", masses, _WARNING),
    Check("link", inertias, _WARNING),
    Check("robot", lost_meshes, _WARNING),
    Check("joint", default_axis, _NOTE),
    Check("joint", unused_limits, _NOTE),
    Check("joint", narrowed_limits, _NOTE),
    Check("joint", nearly_a_turn, _NOTE),
    Check("robot", missing_masses, _NOTE),
)
"""All checks, in the order in which they refuse."""


def findings(check: Check, robot: Robot) -> Found:
    """Yield what a check finds in a robot: the part, and a sentence."""
    if check.of == "robot":
        yield from check.find(robot)
        return
    parts: dict[str, list[Any]] = {"link": robot.links, "joint": robot.joints}
    for each in parts[check.of]:
        yield from ((each.part, f"{each.part}{what}") for what in check.find(each))


def refuse_file(robot: Robot) -> None:
    """Raise the first finding that refuses the file.

    Raises:
        InvalidRobot: There is one.
    """
    for check in CHECKS:
        if check.refuses is Refuses.FILE:
            for _, sentence in findings(check, robot):
                raise InvalidRobot(f"{robot.where}: {sentence}")


def refuse_arm(joint: UrdfJoint) -> None:
    """Raise the first finding that refuses arms that have this joint between base and tip.

    Raises:
        InvalidRobot: There is one.
    """
    for check in CHECKS:
        if check.refuses is Refuses.ARM:
            for what in check.find(joint):
                raise InvalidRobot(f"{joint.part}{what}")


def _malformed(each: UrdfLink | UrdfJoint, table: dict[str, dict[str, int]]) -> Iterator[str]:
    for path, attributes in table.items():
        if (element := each.element.find(path)) is None:
            continue
        for attribute, count in attributes.items():
            try:
                if (text := element.get(attribute)) is not None:
                    parse_numbers(text, count)
            except ValueError as error:
                yield f": <{element.tag}> {attribute}={text!r}: {error}"


def _is_there(mesh: str, robot: Robot) -> bool:
    try:
        return os.path.isfile(mesh_path(mesh, Path(robot.where), robot.packages))
    except InvalidRobot:
        return False


def some(names: list[str], between: str = ", ", most: int = _NAMED) -> str:
    """Return the first names, and the number of the others."""
    return between.join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
