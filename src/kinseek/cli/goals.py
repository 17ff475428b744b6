"""Conversion of the pose and the tolerances of a command line to a goal."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, UnitWarning
from kinseek.goal import Frame, Goal
from kinseek.pose_arguments import pose
from kinseek.ranges import check_cone
from kinseek.support.units import warn_of_angles

from .words import LENGTHS, numbers, option_of, split

Array = NDArray[np.float64]

TURNS = ("rpy", "quat_wxyz", "quat_xyzw", "rotvec")
"""Forms of a rotation: the names of arguments of `kinseek.pose`, and of the options."""
IN_DEGREES = ("rpy", "rotvec")
"""Forms that ``--deg`` applies to."""


class GoalSpec(NamedTuple):
    """The options for the constrained part of a pose, and for its tolerances."""

    position_only: bool
    free: str | None
    frame: str
    cone: float
    position_tolerance: float
    orientation_tolerance: float
    position_weight: float
    orientation_weight: float

    def goal(self, targets: Array) -> Goal:
        """Return the goal of one pose, (4, 4), or of many, (..., 4, 4)."""
        free, options = split(self.free or ""), cast(Any, dict(zip(self._fields[4:], self[4:], strict=True)))
        if self.position_only:
            check_cone(self.cone, one_axis=False)
            return Goal.position(targets[..., :3, 3], free=free, **options)
        return Goal.pose(targets, free=free, frame=cast("Frame", self.frame), cone=self.cone, **options)


class PoseWords(NamedTuple):
    """The options that give one pose, as text."""

    at: str | None
    rpy: str | None
    quat_wxyz: str | None
    quat_xyzw: str | None
    rotvec: str | None

    @property
    def given(self) -> dict[str, str]:
        """The options that are given, by field."""
        return {name: text for name, text in self._asdict().items() if text is not None}

    def target(self, position_only: bool, deg: bool) -> Array:
        """Read the target pose, (4, 4).

        Raises:
            InvalidGoal: No position, no rotation, or more than one.
        """
        if self.at is None:
            raise InvalidGoal("a goal needs --at X Y Z, the target position in metres")
        turns = {name: text for name, text in self.given.items() if name in TURNS}
        chosen = [*map(option_of, turns), *(["--position-only"] if position_only else [])]
        if len(chosen) != 1:
            valid = f"{', '.join(map(option_of, TURNS))} or --position-only"
            raise InvalidGoal(f"a goal needs exactly one of {valid}; got {' and '.join(chosen) or 'none'}")
        position = numbers(self.at, "--at", LENGTHS["--at"])
        turn = {}
        for name, text in turns.items():
            option = option_of(name)
            turn[name] = numbers(text, option, LENGTHS[option])
            suspect_degrees(turn, deg, f"{option} {text}")
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
