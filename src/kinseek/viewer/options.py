"""The settings of a page: plain values that can be stored in a browser and read back."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import KinseekError
from kinseek.goal import Goal
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.poses import as_pose
from kinseek.ranges import AXES
from kinseek.robots.mechanism import Mechanism

from .searches import DEFAULT, SEARCHES, make_search, parameters_of

Array = NDArray[np.float64]

COUNTS: dict[str, tuple[str, ...]] = {
    "whole pose": (),
    "position and z direction": ("rz",),
    "position": ("rx", "ry", "rz"),
}
"""Choices of the constrained part of a goal, by name on the page, with the axes that are then free."""

CHOSEN = "chosen axes"
"""Name of every other choice of free axes."""

VERSION = 1
"""Version of the stored settings; other versions are ignored."""


@dataclass(frozen=True, eq=False)
class ViewerOptions:
    """One person's goal, search and display options."""

    target: Array
    """Wanted pose of the tip in the base, (4, 4), lengths in [m]."""
    q: Array
    """Joint values shown last, (n,), [rad] or [m]: the next solution is close to them."""
    free: tuple[str, ...] = ()
    """Axes of the target pose along and about which any deviation is accepted."""
    follow: bool = True
    """Request the solution nearest to the one shown, so that a drag stays on its branch?"""
    search: str = DEFAULT
    parameters: dict[str, str] = field(default_factory=dict)
    """Parameters of the search, as text."""
    ghosts: bool = True
    """Show every branch?"""
    samples: bool = False
    """Show the atlas's samples around the goal?"""
    reach: bool = False
    """Show the region reachable at this orientation?"""
    boxes: bool = False
    """Show the remaining boxes of a proof?"""
    swept: bool = True
    """Show postures along a motion?"""
    meshes: bool = True
    """Show the meshes of the robot's file, if there are any?"""
    dark: bool = False
    camera: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    """Position and target of the camera [m]; None: the initial view."""

    @property
    def goal(self) -> Goal:
        """The goal with these options.

        Raises:
            InvalidGoal: Every axis is free.
        """
        return Goal.pose(self.target, free=self.free)

    @property
    def counts(self) -> str:
        """The constrained part of the goal, by its name on the page."""
        return next((name for name, free in COUNTS.items() if free == self.free), CHOSEN)

    def has_goal_of(self, other: Self) -> bool:
        """Return whether the goal has not been changed between these options and others."""
        return self.target is other.target and self.free == other.free

    def but(self, **changes: Any) -> Self:
        """Return a copy with other values.

        Raises:
            KinseekError: A target that is not a pose.
        """
        if "target" in changes:
            changes["target"] = as_pose(changes["target"])
        if "free" in changes:
            changes["free"] = tuple(axis for axis in AXES if axis in changes["free"])
        if changes.get("search", self.search) != self.search:
            changes.setdefault("parameters", parameters_of(changes["search"]))
        return replace(self, **changes)

    def to_json(self) -> str:
        """Return the options as text to store in a browser."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        values |= {"target": self.target.tolist(), "q": self.q.tolist(), "version": VERSION}
        return json.dumps(values)


def first_selection(arm: Mechanism, q: Array, target: Array) -> ViewerOptions:
    """Return the initial options of a page.

    An arm with few joints hardly ever reaches a whole pose, so less of the pose is constrained.
    """
    counts = "whole pose" if arm.dof >= 6 else "position and z direction" if arm.dof == 5 else "position"
    return ViewerOptions(target, q, COUNTS[counts])


def read_selection(text: str | None, begin: ViewerOptions) -> ViewerOptions:
    """Read stored options. The text is not trusted: whatever is invalid is taken from `begin`.

    Args:
        text: Text from `ViewerOptions.to_json`, or anything else.
        begin: The initial options of the page.
    """
    try:
        values = json.loads(text or "{}")
        if not isinstance(values, dict) or values.get("version") != VERSION:
            return begin
        target, q = as_pose(np.array(values["target"], dtype=float)), np.array(values["q"], dtype=float)
        if target.shape != (4, 4) or q.shape != begin.q.shape or not (np.abs(q) <= LARGEST).all():
            return begin
        options = begin.but(target=target, q=q, free=tuple(map(str, values["free"])))
    except (ValueError, TypeError, OverflowError, KeyError, RecursionError, KinseekError):
        return begin
    flags = ("follow", "ghosts", "samples", "reach", "boxes", "swept", "meshes", "dark")
    options = options.but(**{name: bool(values[name]) for name in flags if name in values})
    search, given = values.get("search"), values.get("parameters")
    if isinstance(search, str) and search in SEARCHES and isinstance(given, dict):
        own = {name: str(given.get(name, default)) for name, default in parameters_of(search).items()}
        try:
            make_search(search, own)
        except KinseekError:
            return options
        options = options.but(search=search, parameters=own)
    return options.but(camera=_camera(values.get("camera")))


def _camera(value: Any) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """Read two points, or None."""
    try:
        eye, at = (tuple(float(each) for each in point) for point in value)
    except (TypeError, ValueError, OverflowError):
        return None
    near = all(abs(each) <= LARGEST for each in eye + at)
    sound = len(eye) == len(at) == 3 and near and math.dist(eye, at) > 1e-6
    return (eye, at) if sound else None
