"""Check the description of a robot: report all errors and suspicious values in a file, not only the first.

Readers stop at the first error, and ignore what kinematics does not need. This module checks a whole URDF or xacro file: the
tree of links, joints with their limits, axes and mimic joints, masses, and meshes.
"""

from __future__ import annotations

import math
import os
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot, UnitWarning, suggest, unknown
from kinseek.support.turns import TURN, holds_a_turn
from kinseek.support.units import TURNS_OF_A_JOINT

from .chain import SerialChain
from .files import MOST_LINKS, file_bytes, require_few
from .joints import Mimics
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from .mjcf import read_mjcf
from .packages import in_package, mesh_path
from .urdf import UrdfTree
from .urdf_xml import JOINT_TYPES, expand_xacro, root_element

READABLE = (".urdf", ".xacro", ".xml")
"""Extensions of the files that can be checked."""

_MOVES = (REVOLUTE, CONTINUOUS, PRISMATIC)
_ENDS = {"limit": ("lower", "upper"), "safety_controller": ("soft_lower_limit", "soft_upper_limit")}
"""Attributes that limit a joint."""
_FAR = 100.0
"""Lengths beyond this [m] are reported: the file was probably written in millimetres."""
_ROUNDED = 1e-3
"""Rounding tolerance for axes against unit length, angles against a turn, and principal moments against the triangle
inequality."""
_SUGGESTED = 20
"""Unknown names for which suggestions are computed: a file with more of them has another error than a misspelt name."""
_TRIED, _WORK = 40, 40_000
"""Most tips that are tried, and largest product of tips and joints of the file, since an arm may contain all of them."""
_HEAD = 1_000
"""Length of the part of a reader's message that is searched for names of links and joints."""
_NAMED = 8
"""Most links or joints in one line."""


class Severity(Enum):
    """Severity of a finding; the value is for display."""

    ERROR = "error"
    """The robot is invalid, or kinseek rejects it."""
    WARNING = "warning"
    """The robot can be read, or the part can be left out, and it is probably a mistake."""
    NOTE = "note"
    """Useful information; a correct file may have it."""


class Finding(NamedTuple):
    """One finding."""

    severity: Severity
    part: str
    """The link, joint or mesh of the finding, or an empty string."""
    what: str


@dataclass
class Checkup:
    """Result of checking a file."""

    findings: list[Finding] = field(default_factory=list)
    links: int = 0
    joints: int = 0
    moving: int = 0
    """Number of movable joints."""
    unknown: int = field(default=0, repr=False)
    """Number of names that the file uses without defining them."""

    @property
    def sound(self) -> bool:
        """Whether all findings are notes."""
        return all(finding.severity is Severity.NOTE for finding in self.findings)

    def error(self, part: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(Finding(Severity.ERROR, part, what))

    def warning(self, part: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(Finding(Severity.WARNING, part, what))

    def note(self, part: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(Finding(Severity.NOTE, part, what))


def check(
    path: Path,
    base: str | None = None,
    tip: str | None = None,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> Checkup:
    """Check the description of a robot.

    Args:
        path: A .urdf or .xacro file, or a .xml file that contains URDF or MJCF. For MJCF the result only says whether it can
            be read.
        base: Base link, as in `kinseek.load`.
        tip: Link whose pose is computed, as in `kinseek.load`.
        args: Values of a xacro file's arguments, by name.
        packages: Folders of ROS packages by name; meshes are searched there too.
        trusted: Whether Python may evaluate the expressions of a xacro file.

    Raises:
        InvalidRobot: The file does not exist, or is not a robot description.
        MissingExtra: The file is MJCF, and MuJoCo is not installed.
    """
    if path.suffix.lower() == ".xacro":
        text = expand_xacro(path, args, packages, trusted)
    elif args:
        raise InvalidRobot(f"args are for .xacro files, got {str(path)!r}")
    else:
        text = file_bytes(path)
    root = root_element(text, str(path))
    found = Checkup()
    if root.tag == "mujoco":
        _check_chains(found, path, partial(read_mjcf, path, base), tip, {})
        return found
    if root.tag != "robot":
        raise InvalidRobot(f"{path}: not a robot: the root tag is <{root.tag}>, expected <robot>")
    links, joints = list(root.iterchildren("link")), list(root.iterchildren("joint"))
    for noun, elements in (("links", links), ("joints", joints)):
        require_few(len(elements), noun, MOST_LINKS, str(path))
    found.links, found.joints = len(links), len(joints)
    found.moving = sum(joint.get("type") not in ("fixed", None) for joint in joints)
    parents = _check_tree(found, links, joints)
    for joint in joints:
        _check_joint(found, joint)
    _check_mimics(found, joints)
    _check_masses(found, links)
    _check_meshes(found, root, path, packages or {})
    if not any(finding.severity is Severity.ERROR for finding in found.findings):
        try:
            tree = UrdfTree(text, str(path))
        except InvalidRobot as error:
            found.error("", str(error).removeprefix(f"{path}: "))
            return found
        _check_chains(found, path, partial(tree.arm, base), tip, parents)
    return found


def _check_tree(found: Checkup, links: list[Any], joints: list[Any]) -> dict[str, str | None]:
    """Check names, and that links and joints form one tree; return the parent of each link."""
    for noun, elements in (("link", links), ("joint", joints)):
        names = Counter(element.get("name") for element in elements)
        for element in elements:
            if not element.get("name"):
                found.error(noun, f"the <{noun}> in line {element.sourceline} has no name")
        for name in (name for name, count in names.items() if name and count > 1):
            found.error(f"{noun} {name!r}", f"{names[name]} {noun}s have this name")
    parents: dict[str, str | None] = {link.get("name"): None for link in links}
    if not parents:
        found.error("", "the robot has no links")
    for joint in joints:
        ends = {
            tag: element.get("link")
            for tag in ("parent", "child")
            if (element := joint.find(tag)) is not None
        }
        for tag in ("parent", "child"):
            if not ends.get(tag):
                found.error(_name(joint), f"no <{tag} link=...>")
            elif ends[tag] not in parents:
                found.error(_name(joint), f"its {tag}: {_unknown(found, ends[tag], parents, 'link')}")
        parent, child = ends.get("parent"), ends.get("child")
        if parent in parents and child in parents:
            if parents[child] is not None:
                found.error(f"link {child!r}", f"has two parents, {parents[child]!r} and {parent!r}")
            parents[child] = parent
    roots = [name for name, parent in parents.items() if parent is None]
    if len(roots) > 1:
        found.error("", f"several root links, expected one: {_some(roots)}")
    if loop := _in_loops(parents):
        found.error("", f"the links form a loop, these or some of these: {_some(loop)}")
    return parents


def _in_loops(parents: Mapping[str, str | None]) -> list[str]:
    """Return the links whose chain of parents never ends."""
    hanging: set[str | None] = {None}
    looping: set[str | None] = set()
    for start in parents:
        way: dict[str | None, None] = {}  # In the order in which they were visited.
        link: str | None = start
        while link not in hanging and link not in looping and link not in way:
            way[link] = None
            link = parents[link] if link is not None else None
        (hanging if link in hanging else looping).update(way)
    return [name for name in parents if name in looping]


def _check_joint(found: Checkup, joint: Any) -> None:
    here, kind = _name(joint), joint.get("type")
    if kind not in JOINT_TYPES:
        found.error(here, suggest(kind, JOINT_TYPES, "joint type") if kind else "no type")
        return
    origin = joint.find("origin")
    if origin is not None:
        _check_origin(found, here, origin)
    if kind not in _MOVES:
        if kind != "fixed":
            found.warning(
                here,
                f"{kind} joints are not supported between base and tip: choose base= or tip= to leave it out",
            )
        return
    axis = joint.find("axis")
    if axis is None:
        found.note(here, "no <axis>: the default of URDF is used, 1 0 0")
    elif (direction := _numbers(found, here, axis, "xyz", 3, required=True)) is not None:
        length = math.hypot(*direction)
        if abs(length - 1.0) > _ROUNDED:
            unit = " ".join(f"{value / length:.9g}" for value in direction) if length else "a unit vector"
            found.error(here, f"axis {axis.get('xyz')} has length {length:g}, expected 1; write {unit}")
    _check_limits(found, joint, kind)


def _check_origin(found: Checkup, here: str, origin: Any) -> None:
    angles = _numbers(found, here, origin, "rpy", 3)
    if angles is not None and max(map(abs, angles)) > TURN * (1 + _ROUNDED):
        found.warning(
            here,
            f"origin rpy={origin.get('rpy')!r} is more than a full turn; URDF uses radians, are these degrees?",
        )
    place = _numbers(found, here, origin, "xyz", 3)
    if place is not None and max(map(abs, place)) > _FAR:
        found.warning(
            here,
            f"origin xyz={origin.get('xyz')!r} is more than {_FAR:g} m; URDF uses metres, are these millimetres?",
        )


def _check_limits(found: Checkup, joint: Any, kind: str) -> None:
    here, limit = _name(joint), joint.find("limit")
    mimics = joint.find("mimic") is not None
    if kind == CONTINUOUS:
        for tag, names in _ENDS.items():
            element = joint.find(tag)
            if element is not None and any(element.get(name) is not None for name in names):
                found.note(here, f"is continuous, so its limits in <{tag}> are ignored")
        return
    if limit is None:
        if not mimics:
            found.error(here, f"no <limit>: a {kind} joint needs lower and upper")
        return
    ends = {end: _numbers(found, here, limit, end, 1) for end in _ENDS["limit"]}
    missing = [end for end in ends if limit.get(end) is None]
    if missing and not mimics:
        found.error(here, f"<limit> has no {' and no '.join(missing)}")
    if ends["lower"] is None or ends["upper"] is None:
        return
    (lower,), (upper,) = ends["lower"], ends["upper"]
    if lower > upper:
        found.error(here, f"lower limit {lower:g} is above upper limit {upper:g}")
    elif lower == upper and not mimics:  # Files contain 0 0 for limits of mimic joints that nobody specified.
        found.warning(here, f"cannot move: both limits are {lower:g}")
    if kind == REVOLUTE and max(-lower, upper) > TURNS_OF_A_JOINT:
        found.warning(
            here, f"limits [{lower:g}, {upper:g}] are many turns; URDF uses radians, are these degrees?"
        )
    short = TURN - (upper - lower)
    if kind == REVOLUTE and 0.0 < short < _ROUNDED and not holds_a_turn(np.array(lower), np.array(upper)):
        found.note(
            here,
            f"limits [{lower:.15g}, {upper:.15g}] are {short:.2g} rad short of a full turn, and no motion crosses the gap; "
            f'if a full turn is meant, write 15 digits or more, or type="continuous"',
        )
    if kind == PRISMATIC and max(-lower, upper) > _FAR:
        found.warning(
            here,
            f"limits [{lower:g}, {upper:g}] are more than {_FAR:g} m; URDF uses metres, are these millimetres?",
        )
    for name in ("effort", "velocity"):
        value = _numbers(found, here, limit, name, 1)
        if value is not None and value[0] < 0:
            found.warning(here, f"{name} limit {value[0]:g} is below 0")
        elif value is not None and value[0] == 0 and name == "velocity" and not mimics:
            found.note(
                here, "velocity limit 0: its speed is treated as unknown, and a tracker does not bound it"
            )
    if lower <= upper:
        _check_soft_limits(found, joint, lower, upper)


def _check_soft_limits(found: Checkup, joint: Any, lower: float, upper: float) -> None:
    """Compare the soft limits with the limits, as `soft_limits` and the reader interpret them."""
    here, controllers = _name(joint), joint.findall("safety_controller")
    if len(controllers) > 1:
        found.error(here, f"{len(controllers)} <safety_controller> elements, expected one")
    if len(controllers) != 1:
        return
    below, above = (_numbers(found, here, controllers[0], end, 1) or () for end in _ENDS["safety_controller"])
    if below == above == (0.0,):
        found.note(here, "both soft limits are 0: they are read as if they were missing")
        return
    inner = max([lower, *below]), min([upper, *above])
    if inner[0] > inner[1]:
        found.error(here, f"soft limits leave no value within the limits [{lower:g}, {upper:g}]")
    elif inner[0] == inner[1] and lower < upper:
        found.warning(here, f"cannot move: its soft limits leave only {inner[0]:g}")
    elif inner != (lower, upper):
        found.note(
            here, f"soft limits narrow [{lower:g}, {upper:g}] to [{inner[0]:g}, {inner[1]:g}], as in MoveIt"
        )


def _check_mimics(found: Checkup, joints: list[Any]) -> None:
    kinds = {joint.get("name"): joint.get("type") for joint in joints}
    mimics: dict[str, tuple[str, float, float]] = {}
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        here, leader = _name(joint), mimic.get("joint")
        factor, _ = (_numbers(found, here, mimic, name, 1) for name in ("multiplier", "offset"))
        if leader not in kinds:
            found.error(here, f"mimics {_unknown(found, str(leader), kinds, 'joint')}")
            continue
        if kinds[leader] not in _MOVES:
            found.error(here, f"mimics {leader!r}, which is {kinds[leader]}")
        if factor == (0.0,):
            found.warning(here, "mimics with multiplier 0: it does not move")
        mimics[joint.get("name")] = (leader, 1.0, 0.0)
    followers = Mimics(mimics)
    for name in mimics:
        try:
            followers.driver(name)
        except InvalidRobot as error:
            found.error(f"joint {name!r}", str(error))
            return  # Report one line per loop; two loops are rarer than two joints in one.


def _check_masses(found: Checkup, links: list[Any]) -> None:
    without = []
    for link in links:
        inertial = link.find("inertial")
        if inertial is None:
            without.append(link.get("name"))
            continue
        here = f"link {link.get('name')!r}"
        mass, inertia = inertial.find("mass"), inertial.find("inertia")
        if mass is None or mass.get("value") is None:
            found.warning(here, "<inertial> has no mass")
        elif (value := _numbers(found, here, mass, "value", 1)) is not None and not value[0] > 0:
            found.warning(here, f"mass {value[0]:g} kg, expected more than 0")
        if inertia is None:
            found.warning(here, "<inertial> has no inertia")
        elif why := _why_no_inertia(found, here, inertia):
            found.warning(here, why)
    if links and len(without) == len(links):
        found.note("", "no link has a mass: kinematics does not need masses, a simulator does")
    elif without:
        found.note("", f"{len(without)} of {len(links)} links have no mass: {_some(without)}")


def _why_no_inertia(found: Checkup, here: str, inertia: Any) -> str:
    """Explain why an inertia is impossible, or return "".

    Principal moments must be positive, and none may be larger than the sum of the other two.
    """
    values = {}
    for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
        number = _numbers(found, here, inertia, name, 1)
        if number is None and (name in ("ixx", "iyy", "izz") or inertia.get(name) is not None):
            return f"inertia has no {name}" if inertia.get(name) is None else ""
        values[name] = 0.0 if number is None else number[0]
    xx, yy, zz, xy, xz, yz = values.values()
    matrix: NDArray[np.float64] = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    small, middle, large = np.linalg.eigvalsh(matrix)
    if not small > 0:
        return f"inertia is not that of a body: its least principal moment is {small:.3g} kg m², expected more than 0"
    if large > (small + middle) * (1 + _ROUNDED):
        return (
            "inertia is not that of a body: the largest principal moment is more than the others together, "
            f"{large:.3g} > {small:.3g} + {middle:.3g} kg m²"
        )
    return ""


def _check_meshes(found: Checkup, root: Any, path: Path, packages: Mapping[str, str | Path]) -> None:
    files = dict.fromkeys(mesh.get("filename") or "" for mesh in root.iter("mesh"))
    lost: dict[str, list[str]] = {}
    for name in files:
        if not name:
            found.warning("mesh", "a <mesh> has no filename")
            continue
        try:
            package, _ = in_package(name) or ("", "")
        except InvalidRobot as error:
            found.warning("mesh", str(error))
            continue
        if not _is_there(name, path, packages):
            lost.setdefault(package, []).append(name)
    for package, names in lost.items():
        if package:
            found.warning(
                f"package {package!r}", f"not found, or not all of it: {len(names)} meshes, {_some(names, 2)}"
            )
        else:
            for name in names:
                found.warning(f"mesh {name!r}", "not found")


def _is_there(mesh: str, path: Path, packages: Mapping[str, str | Path]) -> bool:
    try:
        return os.path.isfile(mesh_path(mesh, path, packages))
    except InvalidRobot:
        return False


def _check_chains(
    found: Checkup,
    path: Path,
    read: Callable[..., SerialChain],
    tip: str | None,
    parents: Mapping[str, str | None],
) -> None:
    """Check whether the file contains an arm.

    The first tips are tried unless one is given; `read` reads the arm that ends at ``tip=``.
    """
    above = set(parents.values())
    ends = [name for name in parents if name not in above]
    if tip is None and len(ends) > 1:
        found.note(
            "",
            f"{len(ends)} tips: kinseek.load needs tip=, one of {_some(ends)}, or another link before them",
        )
    reported = {finding.part for finding in found.findings if finding.part}
    tried = ends[: min(_TRIED, max(1, _WORK // len(parents)))] if tip is None and len(ends) > 1 else [tip]
    if tip is None and len(tried) < len(ends):
        found.note("", f"only the first {len(tried)} of {len(ends)} tips are tried")
    for end in tried:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UnitWarning)  # Reported for each joint already.
                read(tip=end)
        except InvalidRobot as error:
            why = str(error).removeprefix(f"{path}: ")
            about = why[
                :_HEAD
            ]  # Messages begin with their subject; what follows may list every joint of the file.
            if any(part in about for part in reported):
                continue
            if end is not tip:
                found.note(f"tip {end!r}", f"no arm ends there: {why}")
            # This is MJCF; for URDF the tips are known.
            elif tip is None and why.startswith("the arm branches"):
                found.note("", why)
            else:
                found.error("", why)


def _name(joint: Any) -> str:
    return f"joint {joint.get('name')!r}"


def _unknown(found: Checkup, got: str, names: Iterable[str | None], noun: str) -> str:
    """Return a message that a name is unknown, with a suggestion."""
    found.unknown += 1
    known = [name for name in names if name] if found.unknown <= _SUGGESTED else []
    return unknown(got, known, noun)


def _some(names: list[str], most: int = _NAMED) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _numbers(
    found: Checkup, here: str, element: Any, attribute: str, count: int, required: bool = False
) -> tuple[float, ...] | None:
    """Read the numbers of an attribute; return None if they are missing or invalid.

    Invalid numbers are reported, and missing ones if they are required.
    """
    text, tag = element.get(attribute), str(element.tag).rpartition("}")[2]
    if text is None:
        if required:
            found.error(here, f"<{tag}> has no {attribute}")
        return None
    try:
        values = tuple(
            float(word.replace("_", "?")) for word in text.split()
        )  # Python alone would accept 1_000.
    except ValueError:
        found.error(here, f"<{tag}> {attribute}={text!r} is not a number")
        return None
    if len(values) != count:
        found.error(here, f"<{tag}> {attribute}={text!r}: {len(values)} values, expected {count}")
        return None
    if not all(map(math.isfinite, values)):
        found.error(here, f"<{tag}> {attribute}={text!r} is not finite")
        return None
    return values
