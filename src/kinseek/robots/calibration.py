"""Measured origins of joints, which replace those of a URDF.

Universal Robots measures each arm in the factory. Their ROS package ur_calibration writes the result as a file, which
ur_description reads in place of its nominal values (config/ur5e/default_kinematics.yaml there):

    kinematics:
      shoulder: {x: 0, y: 0, z: 0.1625, roll: 0, pitch: 0, yaw: 0}    # origin of the joint that moves shoulder_link
      upper_arm: …
      hash: calib_…
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidGoal, InvalidRobot, suggest
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.poses import one_pose
from kinseek.support.forks import importing

from .chain import Array
from .checks import refuse_file
from .files import home_path
from .urdf import Urdf
from .urdf_file import Robot, UrdfJoint, parse_numbers
from .xml_files import root_element, text_of
from .yaml_files import read_yaml

Calibration = str | Path | Mapping[str, Any]
"""A file of ur_calibration, or a mapping from joints to the poses of their frames."""

MOST_BYTES = 2**16
"""Most bytes of a calibration file; PyYAML reads some 100 kB a second."""

_NUMBERS = ("x", "y", "z", "roll", "pitch", "yaw")
_FARTHEST = 0.03
"""A file that moves an origin by more than this [m] belongs to another model: nominal and measured values differ by
millimetres, and the most similar models, UR5e and UR16e, by 0.053 m."""


def calibrated(urdf: Urdf, calibration: Calibration) -> Urdf:
    """Return a URDF with the origins of a calibration.

    Args:
        urdf: The URDF.
        calibration: The path of a file of ur_calibration; or a mapping from joints, or the links that they move, to poses of
            the joint frames in the links before, (4, 4), or objects with a pose, lengths in [m].

    Raises:
        InvalidRobot: The calibration cannot be read, has a joint that the URDF does not have, or belongs to another robot.
    """
    root = root_element(urdf.text, urdf.where)
    robot = Robot(root, urdf.where)
    refuse_file(robot)
    if isinstance(calibration, Mapping):
        joints = _joints(robot, calibration, "calibration")
        for pose, joint in zip(calibration.values(), joints, strict=True):
            _set_origin(joint, *_xyz_rpy(pose, f"calibration: the origin of {joint.part}"))
    elif isinstance(calibration, str | os.PathLike):
        _set_origins_of_file(robot, home_path(calibration))
    else:
        raise InvalidRobot(
            "calibration must be the path of a .yaml file, or a mapping from joints to poses, got "
            f"{calibration!r:.80} ({type(calibration).__name__})"
        )
    return urdf._replace(text=text_of(root))


def _set_origins_of_file(robot: Robot, path: Path) -> None:
    """Set the origins that a file of ur_calibration names.

    Raises:
        InvalidRobot: It cannot be read, or does not fit the robot.
    """
    entries = _entries(path)
    for (name, entry), joint in zip(entries.items(), _joints(robot, entries, str(path)), strict=True):
        where = f"{path}: {name}"
        numbers = _six_numbers(entry, where)
        if (moved := math.dist(numbers[:3], joint.pose[:3, 3])) > _FARTHEST:
            raise InvalidRobot(
                f"{where} puts {joint.part} {moved:.3g} m away from where {robot.where} has it, expected at most "
                f"{_FARTHEST:g} m: this is the calibration of another model"
            )
        _set_origin(joint, numbers[:3], numbers[3:])


def _entries(path: Path) -> dict[Any, Any]:
    """Return the entries of a file of ur_calibration by name.

    Raises:
        InvalidRobot: It is no such file.
    """
    content = read_yaml(path, MOST_BYTES)
    entries = content.get("kinematics") if isinstance(content, dict) else None
    if not isinstance(entries, dict) or not set(entries) - {"hash"}:
        raise InvalidRobot(
            f"{path}: not a calibration: expected the entry 'kinematics' with the links of the arm and for each "
            f"{', '.join(_NUMBERS)}, as ur_calibration writes it"
        )
    return {name: entry for name, entry in entries.items() if name != "hash"}


def _six_numbers(entry: Any, where: str) -> list[float]:
    """Return x, y, z [m], roll, pitch, yaw [rad] of an entry.

    Raises:
        InvalidRobot: One is missing, or not a finite number.
    """
    if not isinstance(entry, dict) or not set(entry) >= set(_NUMBERS):
        got = ", ".join(map(str, entry)) if isinstance(entry, dict) else repr(entry)[:80]
        raise InvalidRobot(f"{where}: expected {', '.join(_NUMBERS)}, got {got or 'none'}")
    try:
        # YAML reads 1e-05, without a dot, as text.
        return [parse_numbers(str(entry[name]), 1)[0] for name in _NUMBERS]
    except ValueError as error:
        raise InvalidRobot(f"{where}: {error}") from None


def _joints(robot: Robot, names: Iterable[Any], where: str) -> list[UrdfJoint]:
    """Return the joints of some names, see `_joint`.

    Raises:
        InvalidRobot: There is none of a name, or two names are of one joint.
    """
    known: dict[str, Any] = {}
    found = list[UrdfJoint]()
    for name in names:
        joint = _joint(robot, name, where)
        if joint.name in known:
            raise InvalidRobot(f"{where}: {known[joint.name]!r} and {name!r} are both {joint.part}")
        known[joint.name] = name
        found.append(joint)
    return found


def _joint(robot: Robot, name: Any, where: str) -> UrdfJoint:
    """Return the joint of that name, or that moves the link of that name; ``_link``, and a prefix, may be left out.

    Raises:
        InvalidRobot: There is none, or several.
    """
    by_joint = {joint.name: joint for joint in robot.joints}
    by_link = {joint.child.removesuffix("_link"): joint for joint in robot.joints}
    if not isinstance(name, str):
        raise InvalidRobot(f"{where}: expected the name of a joint or a link, got {name!r:.80}")
    if exact := by_joint.get(name) or by_link.get(name.removesuffix("_link")):
        return exact
    prefixed = [joint for link, joint in by_link.items() if link.endswith(f"_{name}")]
    if len(prefixed) == 1:
        return prefixed[0]
    if prefixed:
        raise InvalidRobot(
            f"{where}: several links of {robot.where} end in {name!r}: {', '.join(joint.child for joint in prefixed)}; "
            "give a mapping from the names of joints to poses"
        )
    raise InvalidRobot(f"{where}: {robot.where}: {suggest(name, by_joint, 'joint')}")


def _xyz_rpy(pose: Any, what: str) -> tuple[Array, Array]:
    """Return position (3,) [m], and roll, pitch, yaw (3,) [rad], of a pose.

    Raises:
        InvalidRobot: It is not a pose.
    """
    try:
        T = one_pose(pose, what)
    except InvalidGoal as error:
        raise InvalidRobot(str(error)) from None
    # Roll is measured after yaw is taken out, so it is accurate for every pitch, also at a right angle.
    yaw = math.atan2(T[1, 0], T[0, 0])
    sine, cosine = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-T[2, 0], cosine * T[0, 0] + sine * T[1, 0])
    roll = math.atan2(sine * T[0, 2] - cosine * T[1, 2], cosine * T[1, 1] - sine * T[0, 1])
    return T[:3, 3], np.array([roll, pitch, yaw])


def _set_origin(joint: UrdfJoint, xyz: Any, rpy: Any) -> None:
    """Write the origin of a joint into its element.

    Raises:
        InvalidRobot: It lies too far off.
    """
    if (farthest := float(np.abs(xyz).max())) > LARGEST:
        raise InvalidRobot(
            f"the origin of {joint.part} must lie within {LARGEST:g} m along each axis, got {farthest:g} m"
        )
    with importing:
        from lxml import etree

    origin = joint.element.find("origin")
    if origin is None:
        origin = etree.SubElement(joint.element, "origin")
    for name, values in (("xyz", xyz), ("rpy", rpy)):
        origin.set(name, " ".join(repr(float(value)) for value in values))
