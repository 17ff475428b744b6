"""Conversion of the pose and the tolerances of a command line to a goal."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, InvalidProblem, UnitWarning
from kinseek.goal import Frame, Goal
from kinseek.pose_arguments import pose
from kinseek.ranges import FRAMES, check_cone
from kinseek.support.units import warn_of_angles
from kinseek.tolerances import TOLERANCES, WEIGHTS

from .words import LENGTHS, numbers, option_of, split

Array = NDArray[np.float64]

TURNS = ("rpy", "quat_wxyz", "quat_xyzw", "rotvec")
"""Forms of a rotation: the names of arguments of `kinseek.pose`, and of the options."""
IN_DEGREES = ("rpy", "rotvec")
"""Forms that ``--deg`` applies to."""
DIRECTIONS = ("z_axis", "x_axis", "y_axis")
"""Directions, two of which are a rotation: the names of arguments of `kinseek.pose`, and of the options."""


class GoalSpec(NamedTuple):
    """The options for the constrained part of a pose, and for its tolerances."""

    position_only: bool
    free: str | None
    box: tuple[str, ...]
    cone: float
    frame: str
    tool: str | None
    position_tolerance: float
    orientation_tolerance: float
    position_weight: float
    orientation_weight: float

    def goal(self, targets: Array, deg: bool = False) -> Goal:
        """Return the goal of one pose, (4, 4), or of many, (..., 4, 4); `deg`: the angles of the options are in degrees."""
        options: Any = {name: getattr(self, name) for name in (*TOLERANCES, *WEIGHTS)}
        options |= {"free": split(self.free or ""), "box": self._ranges(deg), "tool": self._tool(deg)}
        cone = check_cone(np.deg2rad(self.cone) if deg else self.cone, not self.position_only)
        if self.frame not in FRAMES:
            raise InvalidGoal(f"--frame must be {' or '.join(FRAMES)}, got {self.frame!r}")
        if self.position_only:
            return Goal.position(targets[..., :3, 3], **options)
        return Goal.pose(targets, frame=cast("Frame", self.frame), cone=cone, **options)

    def _ranges(self, deg: bool) -> dict[str, tuple[float, ...]]:
        """Read ``--box``: lower and upper end for each axis.

        Raises:
            InvalidProblem: Not AXIS=LOW:HIGH, or an axis is given twice.
        """
        ranges: dict[str, tuple[float, ...]] = {}
        for word in split(" ".join(self.box)):
            axis, equals, ends = word.partition("=")
            if not equals or ends.count(":") != 1:
                raise InvalidProblem(f"--box takes AXIS=LOW:HIGH, for example z=-0.01:0.01, got {word!r}")
            if axis in ranges:
                raise InvalidProblem(f"--box names the axis {axis!r} twice")
            pair = numbers(ends.replace(":", " "), f"--box {axis}", 2)
            ranges[axis] = tuple(np.deg2rad(pair).tolist() if deg and axis.startswith("r") else pair)
        return ranges

    def _tool(self, deg: bool) -> Array | None:
        """Read ``--tool``: a pose, (4, 4).

        Raises:
            InvalidProblem: Neither three nor six numbers.
        """
        if self.tool is None:
            return None
        given = numbers(self.tool, "--tool")
        if len(given) not in (3, 6):
            raise InvalidProblem(
                f"--tool needs 3 numbers, X Y Z, or 6, X Y Z ROLL PITCH YAW, got {len(given)}: {self.tool or 'none'}"
            )
        turn = {"rpy": given[3:]} if given[3:] else {}
        suspect_degrees(turn, deg, f"--tool {self.tool}")
        return silent_pose(given[:3], turn, deg)


class PoseWords(NamedTuple):
    """The options that give one pose, as text."""

    at: str | None
    rpy: str | None
    quat_wxyz: str | None
    quat_xyzw: str | None
    rotvec: str | None
    z_axis: str | None
    x_axis: str | None
    y_axis: str | None

    @property
    def given(self) -> dict[str, str]:
        """The options that are given, by field."""
        return {name: text for name, text in self._asdict().items() if text is not None}

    def target(self, position_only: bool, deg: bool) -> Array:
        """Read the target pose, (4, 4).

        Raises:
            InvalidGoal: No position, no rotation, more than one, one direction or three, or directions that are no rotation.
        """
        if self.at is None:
            raise InvalidGoal("a goal needs --at X Y Z, the target position in metres")
        turns = {name: text for name, text in self.given.items() if name != "at"}
        chosen = [*map(option_of, turns), *(["--position-only"] if position_only else [])]
        axes = [name for name in turns if name in DIRECTIONS]
        if len(chosen) - max(len(axes) - 1, 0) != 1:
            valid = f"{', '.join(map(option_of, TURNS))}, --z-axis with --x-axis, or --position-only"
            raise InvalidGoal(f"a goal needs exactly one of {valid}; got {' and '.join(chosen) or 'none'}")
        position = numbers(self.at, "--at", LENGTHS["--at"])
        turn = {}
        for name, text in turns.items():
            option = option_of(name)
            turn[name] = numbers(text, option, LENGTHS[option])
            suspect_degrees(turn, deg, f"{option} {text}")
        if len(axes) not in (0, 2):
            raise InvalidGoal(
                f"give exactly two of {', '.join(map(option_of, DIRECTIONS))}, got {' and '.join(map(option_of, axes))}; "
                "for any turn about z, also give any x axis and --free rz"
            )
        return silent_pose(position, turn, deg)


def silent_pose(position: Any, turn: Mapping[str, Any], deg: bool) -> Array:
    """Make poses as `kinseek.pose`, without its warning about angles; `suspect_degrees` has that of the command line.

    Args:
        position: Positions, (..., 3), [m].
        turn: At most one rotation, by its name in `TURNS`, or two axes; as keyword arguments of `kinseek.pose`.
        deg: Are the angles of `IN_DEGREES` in degrees?

    Raises:
        InvalidGoal: As `kinseek.pose`.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)
        return pose(position, **turn, degrees=deg and any(name in turn for name in IN_DEGREES))


def suspect_degrees(turn: Mapping[str, Any], deg: bool, where: str) -> None:
    """Warn of angles, valid ones, that look like degrees if `deg` is not given; `where` is their name in the message."""
    for name in IN_DEGREES:
        if name in turn and not deg:
            warn_of_angles(np.asarray(turn[name], dtype=np.float64), where, "add --deg", 1)
