"""Check the description of a robot: report all errors and suspicious values in a file, not only the first.

Reading an arm stops at the first error, and ignores what kinematics does not need. This module runs all `checks` of a URDF
or xacro file, and tries its tips.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from kinseek.errors import InvalidRobot, UnitWarning

from .chain import Limits, SerialChain
from .checks import CHECKS, Severity, findings, some
from .mjcf import read_mjcf
from .urdf import arm_of
from .urdf_file import Robot
from .xacro import urdf_text
from .xml_files import root_element

_TRIED, _WORK = 40, 40_000
"""Most tips that are tried, and largest product of tips and joints of the file, since an arm may contain all of them."""
_HEAD = 1_000
"""Length of the part of a reader's message that is searched for names of links and joints."""


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

    @property
    def sound(self) -> bool:
        """Whether all findings are notes."""
        return all(finding.severity is Severity.NOTE for finding in self.findings)

    def add(self, severity: Severity, part: str, what: str) -> None:
        """Add a finding."""
        self.findings.append(Finding(severity, part, what))


def check(
    path: Path,
    base: str | None = None,
    tip: str | None = None,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
    limits: Limits | None = None,
) -> Checkup:
    """Check the description of a robot.

    Args:
        path: A .urdf or .xacro file, or a .xml file that contains URDF or MJCF. For MJCF the result only says whether it can
            be read, and which limits are probably in degrees.
        base: Base link, as in `kinseek.load`.
        tip: Link whose pose is computed, as in `kinseek.load`.
        args: Values of a xacro file's arguments, by name.
        packages: Folders of ROS packages by name; meshes are searched there too.
        trusted: Whether Python may evaluate the expressions of a xacro file.
        limits: Limits of planar and floating joints, as in `kinseek.load`.

    Raises:
        InvalidRobot: The file does not exist, or is not a robot description.
        MissingExtra: The file is MJCF, and MuJoCo is not installed.
    """
    if args and path.suffix.lower() != ".xacro":
        raise InvalidRobot(f"args are for .xacro files, got {str(path)!r}")
    root = root_element(urdf_text(path, args, packages, trusted), str(path))
    if root.tag == "mujoco":
        found = Checkup()
        _check_chains(found, path, partial(read_mjcf, path, base), tip, {})
        return found
    robot = Robot(root, str(path), packages)
    moving = sum(joint.kind not in ("fixed", "") for joint in robot.joints)
    found = Checkup([], len(robot.links), len(robot.joints), moving)
    for each in CHECKS:
        for part, sentence in findings(each, robot):
            found.add(each.severity, part, sentence.removeprefix(part).removeprefix(":").strip())
    if not any(finding.severity is Severity.ERROR for finding in found.findings):
        _check_chains(found, path, partial(arm_of, robot, base, limits=limits), tip, robot.parents)
    return found


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
        found.add(
            Severity.NOTE,
            "",
            f"{len(ends)} tips: kinseek.load needs tip=, one of {some(ends)}, or another link before them",
        )
    reported = {each.part for each in found.findings if each.part and each.severity is not Severity.NOTE}
    tried = ends[: min(_TRIED, max(1, _WORK // len(parents)))] if tip is None and len(ends) > 1 else [tip]
    if tip is None and len(tried) < len(ends):
        found.add(Severity.NOTE, "", f"only the first {len(tried)} of {len(ends)} tips are tried")
    for end in tried:
        try:
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always", UnitWarning)
                read(tip=end)
            for warning in caught:
                # For URDF they are reported for each joint already; MJCF has no parents here.
                if not parents and issubclass(warning.category, UnitWarning):
                    found.add(Severity.WARNING, "", str(warning.message).removeprefix(f"{path}: "))
        except InvalidRobot as error:
            why = str(error).removeprefix(f"{path}: ")
            # Messages begin with their subject; what follows may list every joint of the file.
            if any(part in why[:_HEAD] for part in reported):
                continue
            if end is not tip:
                found.add(Severity.NOTE, f"tip {end!r}", f"no arm ends there: {why}")
            # This is MJCF; for URDF the tips are known.
            elif tip is None and why.startswith("the arm branches"):
                found.add(Severity.NOTE, "", why)
            else:
                found.add(Severity.ERROR, "", why)
