"""Conversion of command-line options to a goal."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, UnitWarning
from kinseek.goal import Frame, Goal
from kinseek.poses import pose
from kinseek.support.units import warn_of_angles
from kinseek.tolerances import GoalOptions

from .words import LENGTHS, numbers

TURNS = ("rpy", "quat_wxyz", "quat_xyzw", "rotvec")
"""Forms of a rotation: the names of arguments of `kinseek.pose`, and of the options."""
IN_DEGREES = ("rpy", "rotvec")
"""Forms that ``--deg`` applies to."""


@dataclass(frozen=True)
class GoalSpec:
    """The constrained part of a pose, and its tolerances."""

    position_only: bool = False
    free: Sequence[str] = ()
    frame: str = "tool"
    tolerances: GoalOptions = field(default_factory=GoalOptions)

    def goal(self, targets: NDArray[np.float64]) -> Goal:
        """Return the goal of one pose, (4, 4), or of many, (..., 4, 4)."""
        if self.position_only:
            return Goal.position(targets[..., :3, 3], free=self.free, **self.tolerances)
        return Goal.pose(targets, free=self.free, frame=cast("Frame", self.frame), **self.tolerances)


def take_turns(words: dict[str, Any]) -> dict[str, str]:
    """Remove the rotations from the options of a command, and return those that were given."""
    taken = {name: words.pop(name) for name in TURNS}
    return {name: text for name, text in taken.items() if text is not None}


def target_of(
    at: str | None, turns: Mapping[str, str], position_only: bool, deg: bool
) -> NDArray[np.float64]:
    """Read the target pose, (4, 4).

    Raises:
        InvalidGoal: No position, no rotation, or more than one.
    """
    if at is None:
        raise InvalidGoal("a goal needs --at X Y Z, the target position in metres")
    options = {name: f"--{name.replace('_', '-')}" for name in TURNS}
    chosen = [*(options[name] for name in turns), *(["--position-only"] if position_only else [])]
    if len(chosen) != 1:
        valid = f"{', '.join(options.values())} or --position-only"
        raise InvalidGoal(f"a goal needs exactly one of {valid}; got {' and '.join(chosen) or 'none'}")
    position = numbers(at, "--at", LENGTHS["--at"])
    turn: dict[str, Any] = {}
    for name, text in turns.items():
        values = np.array(numbers(text, options[name], LENGTHS[options[name]]))
        turn[name] = np.deg2rad(values) if deg and name in IN_DEGREES else values
        if name in IN_DEGREES and not deg:
            warn_of_angles(values, f"{options[name]} {text}", "add --deg", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)  # Reported above in terms of the command line.
        return pose(position, **turn)
