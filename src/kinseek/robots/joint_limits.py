"""Limits of joints from the joint_limits.yaml of a MoveIt configuration, which replace those of a URDF.

    joint_limits:
      panda_joint1: {has_velocity_limits: true, max_velocity: 2.175, has_acceleration_limits: true, max_acceleration: 3.75,
                     has_jerk_limits: true, max_jerk: 500.0, has_position_limits: true, min_position: -2, max_position: 2}

As in MoveIt (`RobotModelLoader::configure` in moveit_ros/planning/robot_model_loader of MoveIt 2), a number of the file
replaces that of the URDF, soft limits included, and ``has_velocity_limits: false`` removes it. Three things differ. A number
counts without its flag too; of these MoveIt takes the positions only. Position limits make a continuous joint revolute;
MoveIt ignores them. A wider limit raises a warning. The ``default_velocity_scaling_factor`` of a file is the default of
MoveIt's requests and not a limit, so it is not read.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot, LimitWarning, suggest
from kinseek.support.forks import importing
from kinseek.support.units import warn_of_rates

from .chain import SerialChain, with_limits
from .checks import refuse_file
from .files import home_path
from .mechanism import CONTINUOUS, RATES, REVOLUTE
from .several_axes import SEVERAL_AXES
from .urdf import Urdf
from .urdf_file import Robot, UrdfJoint, parse_numbers
from .xml_files import root_element, text_of
from .yaml_files import read_yaml

MOST_BYTES = 2**16
"""Most bytes of a file of limits; PyYAML reads some 100 kB a second."""

_KEYS = {
    "lower": ("position", "min_position"),
    "upper": ("position", "max_position"),
    "velocity": ("velocity", "max_velocity"),
    "acceleration": ("acceleration", "max_acceleration"),
    "deceleration": ("deceleration", "max_deceleration"),
    "jerk": ("jerk", "max_jerk"),
}
"""The attributes of ``<limit>`` in a URDF; for each the word of its flag, ``has_…_limits``, and the key of its number.
MoveIt has no deceleration; ros2_control has, and the Pilz planner with a negative sign."""
_VARIABLES = {axis: axis for axes in SEVERAL_AXES.values() for axis, _ in axes}
_VARIABLES |= {"theta": "yaw", "trans_x": "x", "trans_y": "y", "trans_z": "z"}
"""Our names of the variables of planar and floating joints, by our names and by those of MoveIt."""
_ROUNDED = 1e-4
"""Part of a limit by which another one may exceed it and still be the same, written with fewer digits."""
_LISTED = 8
"""Most limits in one warning."""

Limits = dict[str, float]
"""The limits that a file gives to one joint, by attribute, in [rad], [m], [s]; NaN for one that it removes."""


def limited(urdf: Urdf, file: str | os.PathLike[str]) -> tuple[Urdf, dict[str, Limits]]:
    """Return a URDF with the limits of a joint_limits.yaml.

    Args:
        urdf: The URDF.
        file: The path of the YAML file. Names that the URDF does not have are accepted if each of its joints has an entry,
            since none can be misspelt then.

    Returns:
        The URDF, and the limits of the variables of planar and floating joints by name, for which a URDF has no place.

    Raises:
        InvalidRobot: The file cannot be read, has a joint that the URDF does not have, or a limit that is not one.
    """
    path = home_path(file)
    given = {name: _limits_of(entry, f"{path}: joint {name!r}") for name, entry in _entries(path).items()}
    root = root_element(urdf.text, urdf.where)
    robot = Robot(root, urdf.where)
    refuse_file(robot)
    variables = {called: limits for name, limits in given.items() if (called := _variable(name))}
    joints = {joint.name: joint for joint in robot.joints}
    _require_known([name for name in given if name not in joints and not _variable(name)], given, robot, path)
    moved = [joint for name, joint in joints.items() if joint.moves and name in given]
    wider = [what for joint in moved for what in _set_limits(joint, given[joint.name], path)]
    _warn_of_degrees(moved, given, path)
    if wider:
        more = f" and {len(wider) - _LISTED} more" if len(wider) > _LISTED else ""
        warnings.warn(
            f"{path} allows more than {urdf.where}, and counts, as in MoveIt: {', '.join(wider[:_LISTED])}{more}",
            LimitWarning,
            stacklevel=4,
        )
    for name, limits in variables.items():
        _require_both_ends(limits, f"{path}: joint {name!r}")
    return urdf._replace(text=text_of(root), limits=_ranges(variables)), variables


def with_variables(chain: SerialChain, variables: Mapping[str, Limits]) -> SerialChain:
    """Return an arm with the limits of its variables of planar and floating joints, as `limited` returns them.

    Raises:
        InvalidRobot: As `with_limits`.
    """
    own = {name: limits for name, limits in variables.items() if name in chain.joint_names}
    rates = {
        rate: {
            name: limits[rate] for name, limits in own.items() if math.isfinite(limits.get(rate, math.nan))
        }
        for rate in RATES
    }
    return with_limits(chain, _ranges(own), rates)


def _ranges(variables: Mapping[str, Limits]) -> dict[str, tuple[float, float]]:
    return {
        name: (limits["lower"], limits["upper"]) for name, limits in variables.items() if "lower" in limits
    }


def _require_both_ends(limits: Limits, what: str) -> None:
    if ("lower" in limits) != ("upper" in limits):
        raise InvalidRobot(
            f"{what} has no limits in the URDF: expected both min_position and max_position, or none of them"
        )


def _entries(path: Path) -> dict[str, Any]:
    """Return the entries of the joints by name.

    Raises:
        InvalidRobot: It is no file of limits.
    """
    tags = {"!degrees": _in_radians, "!radians": lambda loader, node: float(loader.construct_scalar(node))}
    found = _sections(read_yaml(path, MOST_BYTES, tags))
    if len(found) != 1 or not isinstance(found[0], dict) or not found[0]:
        raise InvalidRobot(
            f"{path}: expected one entry 'joint_limits' with joints, each with has_velocity_limits, max_velocity and so on, "
            f"as MoveIt has them; got {len(found) if len(found) != 1 else repr(found[0])[:80]}"
        )
    for name in found[0]:
        if not isinstance(name, str):
            raise InvalidRobot(f"{path}: expected the name of a joint, got {name!r:.80}")
    return found[0]


def _sections(content: Any) -> list[Any]:
    """Return what stands under ``joint_limits``, below names of nodes and ``ros__parameters`` too."""
    if not isinstance(content, dict):
        return []
    if "joint_limits" in content:
        return [content["joint_limits"]]
    return [section for inner in content.values() for section in _sections(inner)]


def _in_radians(loader: Any, node: Any) -> float:
    return math.radians(float(loader.construct_scalar(node)))


def _limits_of(entry: Any, where: str) -> Limits:
    """Read the entry of one joint.

    Raises:
        InvalidRobot: A flag or a number is wrong, or a number is missing.
    """
    if not isinstance(entry, dict):
        raise InvalidRobot(
            f"{where}: expected has_velocity_limits, max_velocity and so on, got {entry!r:.80}"
        )
    limits: Limits = {}
    for attribute, (word, key) in _KEYS.items():
        flag = entry.get(f"has_{word}_limits")
        if not isinstance(flag, bool | None):
            raise InvalidRobot(f"{where}: has_{word}_limits must be true or false, got {flag!r:.80}")
        if flag is False:
            if word in RATES:  # The range of positions stays: a search needs one.
                limits[attribute] = math.nan
        elif key in entry:
            limits[attribute] = _number(entry[key], word, f"{where}: {key}")
        elif flag:
            raise InvalidRobot(f"{where} has has_{word}_limits: true, but no {key}")
    if limits.get("lower", -math.inf) > limits.get("upper", math.inf):
        raise InvalidRobot(
            f"{where}: min_position {limits['lower']:g} is above max_position {limits['upper']:g}"
        )
    if "deceleration" in limits:
        # One limit holds in both directions; `fmin` ignores NaN.
        limits["acceleration"] = float(
            np.fmin(limits.get("acceleration", math.nan), limits.pop("deceleration"))
        )
    return limits


def _number(value: Any, word: str, what: str) -> float:
    """Read a limit; all but positions are above 0.

    Raises:
        InvalidRobot: It is no such number.
    """
    try:
        # YAML reads 1e-05, without a dot, as text.
        number = parse_numbers("none" if isinstance(value, bool) else str(value), 1)[0]
    except ValueError:
        raise InvalidRobot(f"{what} must be a finite number, got {value!r:.80}") from None
    if word == "deceleration":
        number = abs(number)
    if word != "position" and number <= 0:
        raise InvalidRobot(
            f"{what} must be above 0, got {number:g}; has_{word}_limits: false says that there is no limit"
        )
    return number


def _variable(name: str) -> str:
    """Return our name of a variable of a planar or floating joint, such as ``base/yaw``; "" for other names."""
    joint, slash, variable = name.rpartition("/")
    return f"{joint}/{_VARIABLES[variable]}" if slash and variable in _VARIABLES else ""


def _require_known(unknown: list[str], given: Mapping[str, Any], robot: Robot, path: Path) -> None:
    """Reject names of other joints, unless every joint of the robot has an entry.

    Raises:
        InvalidRobot: A name may be misspelt.
    """
    own = [joint.name for joint in robot.joints if joint.moves]
    without = [
        joint.name for joint in robot.joints if joint.moves and not joint.mimic and joint.name not in given
    ]
    if unknown and without:
        raise InvalidRobot(
            f"{path}: {robot.where}: {suggest(unknown[0], own, 'joint')}. Joints of other robots are ignored only if each "
            f"joint of this one has an entry; without: {', '.join(without[:_LISTED])}"
        )


def _set_limits(joint: UrdfJoint, limits: Limits, path: Path) -> list[str]:
    """Write limits into the element of a joint, and return those that are wider than the ones before, for people.

    Raises:
        InvalidRobot: A continuous joint gets one limit only, or the limits leave no value.
    """
    with importing:
        from lxml import etree

    element, before, new = joint.element, _bounds(joint), dict(limits)
    if "lower" in new or "upper" in new:
        if joint.kind == CONTINUOUS:
            _require_both_ends(limits, f"{path}: {joint.part}")
            element.set("type", REVOLUTE)
        # They replace soft limits, too.
        new = dict(zip(("lower", "upper"), joint.narrowed, strict=True)) | new
        for soft in element.iterfind("safety_controller"):
            for end in ("soft_lower_limit", "soft_upper_limit"):
                soft.attrib.pop(end, None)
    limit = element.find("limit")
    if limit is None:
        limit = etree.SubElement(element, "limit")
    for attribute, value in new.items():
        if math.isfinite(value):
            limit.set(attribute, repr(value))
        else:
            limit.attrib.pop(attribute, None)
    if "acceleration" in new:  # It holds in both directions.
        limit.attrib.pop("deceleration", None)
    after = UrdfJoint(element)
    if after.narrowed[0] > after.narrowed[1]:
        raise InvalidRobot(
            f"{path}: {joint.part}: lower limit {after.narrowed[0]:g} is above upper limit {after.narrowed[1]:g}"
        )
    return _wider(joint, before, _bounds(after))


def _bounds(joint: UrdfJoint) -> dict[str, float]:
    """Return the limits of a joint by name, NaN where there is none."""
    ends = (math.nan, math.nan) if joint.kind == CONTINUOUS else joint.narrowed
    return dict(zip(("lower limit", "upper limit", *RATES), (*ends, *joint.rates), strict=True))


def _wider(joint: UrdfJoint, before: Mapping[str, float], after: Mapping[str, float]) -> list[str]:
    """Return the limits of a joint that are wider than the ones that it had, for people."""
    found = []
    for name, old in before.items():
        new = after[name]
        excess = old - new if name == "lower limit" else new - old
        # NaN is a limit that was removed.
        if math.isfinite(old) and not excess <= _ROUNDED * abs(old):
            found.append(
                f"{joint.part} {name} {'removed' if math.isnan(new) else f'{new:g}'} instead of {old:g}"
            )
    return found


def _warn_of_degrees(joints: list[UrdfJoint], given: Mapping[str, Limits], path: Path) -> None:
    names, kinds = [joint.name for joint in joints], [joint.kind for joint in joints]
    for rate in RATES:
        values = np.array([given[name].get(rate, math.nan) for name in names])
        warn_of_rates(rate, names, kinds, values, str(path), 5)
