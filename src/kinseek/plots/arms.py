"""Arms, their branches, and frames in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.collision import Scene
from kinseek.errors import InvalidProblem, InvalidUse
from kinseek.goal import Goal
from kinseek.paths.path import Path
from kinseek.problem import as_joints
from kinseek.robots.chain import SerialChain, joint_points
from kinseek.robots.mechanism import Mechanism
from kinseek.timing.trajectory import Trajectory

from .figures import COLOURS, drawn, given_or_new_space, same_scale, text_of, trim
from .scenes import draw_scene, draw_way, require_scene, rows_of
from .shown import count_of

Array = NDArray[np.float64]

VIEW = (22.0, -60.0)
"""Elevation and azimuth of the camera [degrees]."""

FRAME_PART = 0.14
"""Length of the axes of a goal, relative to the longest side of the picture."""

LABEL_PAD = 6.0
"""Additional distance of the label of y [pt]: it is printed at an angle above numbers."""

SHORTEST = 0.4
"""Minimum side of a picture in space, relative to the longest side."""


@drawn
def arm(
    arm: Arm | Mechanism,
    q: ArrayLike | Path | Trajectory,
    *,
    goal: Goal | ArrayLike | None = None,
    scene: Scene | None = None,
    ax: Any = None,
    size: tuple[float, float] = (6.0, 5.2),
    view: tuple[float, float] = VIEW,
) -> Any:
    """Draw an arm in true proportions: solid at its first joint values, as ghosts at the others.

    Args:
        arm: An arm with axes; the links of black-box kinematics are unknown.
        q: Joint values, (n,) or (k, n), [rad] or [m]; or a path or trajectory of the arm. Of these the curve of the tip is
            drawn, and some postures, of which the last one is solid.
        scene: The collision scene of the arm, by default that of a path. Its bodies are drawn; red are those that touch at
            any of the joint values, the shapes of links that touch where the arm is drawn, and the part of the curve where
            the arm touches something.
        goal: A pose or a `Goal` of one target, drawn as its axes x, y and z in red, green and blue; a position goal is drawn
            as a star.
        ax: Axes in space to draw on, such as those of `space`.
        size: Size of a new figure before its margins are cut [inch].
        view: Elevation and azimuth of the camera of a new figure [degrees].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: An arm with black-box kinematics, or joint values that do not fit it.
        InvalidScene: Not a scene of this arm.
        InvalidUse: No joint values, a motion of another arm, a batch of goals, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    figure, axes = given_or_new_space(ax, size, view)
    cell = require_scene(scene, arm, q)
    rows = rows_of(q)[1] if isinstance(q, Path | Trajectory) else _rows(arm, q)
    _draw(axes, arm, rows, goal, q if isinstance(q, Path | Trajectory) else None, cell)
    if ax is None:
        trim(figure, axes)
    return figure


@drawn
def branches(
    branches: Branches,
    *,
    chosen: int = 0,
    ax: Any = None,
    size: tuple[float, float] = (6.0, 5.2),
    view: tuple[float, float] = VIEW,
) -> Any:
    """Draw all solutions of a goal, `arm.branches(goal)`: one solid, the others as ghosts.

    Args:
        branches: Branches of one goal, with at least one solution.
        chosen: Index of the solid one.
        ax: Axes in space to draw on, such as those of `space`.
        size: Size of a new figure before its margins are cut [inch].
        view: Elevation and azimuth of the camera of a new figure [degrees].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: An arm with black-box kinematics.
        InvalidUse: Not branches, none among them, an index out of range, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    if not isinstance(branches, Branches):
        raise InvalidUse(
            f"expected the branches of one goal, arm.branches(goal), got {type(branches).__name__}"
        )
    if not len(branches):
        raise InvalidUse("there is no branch to draw: the goal was not reached")
    if count_of("chosen", chosen, 0) >= len(branches):
        raise InvalidUse(f"chosen must be from 0 to {len(branches) - 1}, got {chosen!r}")
    first = [chosen, *(i for i in range(len(branches)) if i != chosen)]
    problem = branches.problem
    figure, axes = given_or_new_space(ax, size, view)
    _draw(axes, problem.mechanism, _rows(problem.mechanism, branches.q[first]), problem.goal)
    count = f"{len(branches)} {'solution' if len(branches) == 1 else 'solutions'}"
    sample = ", a sample of infinitely many" if branches.sampled else ""
    title = f"{text_of(problem.mechanism.name)}: {count}{sample}"
    if ax is None:
        trim(figure, axes, title)
    else:
        axes.set_title(title)
    return figure


def draw_line(axes: Any, points: ArrayLike, **look: Any) -> None:
    """Draw a line through points, (k, 2) or (k, 3) [m]; `look` has keyword arguments of Matplotlib's `plot`."""
    axes.plot(*np.asarray(points, dtype=float).T, **look)


def draw_arm(axes: Any, arm: Arm | Mechanism, q: ArrayLike, color: str = COLOURS[0], **look: Any) -> None:
    """Draw a serial arm as a line through its joints at joint values q, (n,).

    Raises:
        InvalidProblem: An arm with black-box kinematics, whose joints are unknown.
    """
    points = joint_points(_chain_of(arm), np.asarray(q, dtype=float))
    draw_line(axes, points, **({"color": color, "linewidth": 2.5, "solid_capstyle": "round"} | look))
    moving = points[1:-1]
    axes.scatter(*moving.T, color=color, s=14, alpha=look.get("alpha", 1.0), zorder=look.get("zorder", 2))


def draw_frame(axes: Any, T: ArrayLike, length: float) -> None:
    """Draw the axes x, y and z of a pose, (4, 4), in red, green and blue, `length` [m] long."""
    matrix = np.asarray(T, dtype=float)
    for c, color in enumerate((COLOURS[1], COLOURS[2], COLOURS[0])):
        draw_line(axes, [matrix[:3, 3], matrix[:3, 3] + length * matrix[:3, c]], color=color, linewidth=1.4)


def _chain_of(arm: Arm | Mechanism) -> SerialChain:
    """Return the axes and links of an arm.

    Raises:
        InvalidProblem: An arm with black-box kinematics.
    """
    if arm.axes is None:
        raise InvalidProblem(
            f"{arm.name!r} has black-box kinematics, so the positions of its links are unknown; use draw_line"
        )
    return arm.axes


def _rows(arm: Arm | Mechanism, q: ArrayLike) -> Array:
    """Read joint values to be drawn, (k, n).

    Raises:
        InvalidUse: There are none, or more than one batch of them.
    """
    mechanism = arm.mechanism if isinstance(arm, Arm) else arm
    rows = np.atleast_2d(as_joints(mechanism, q))
    if rows.ndim != 2 or not len(rows):
        raise InvalidUse(
            f"q must have shape ({mechanism.dof},) or (k, {mechanism.dof}), got {np.shape(q)}; nothing to draw"
        )
    return rows


def _draw(
    axes: Any,
    arm: Arm | Mechanism,
    rows: Array,
    goal: Goal | ArrayLike | None,
    motion: Path | Trajectory | None = None,
    scene: Scene | None = None,
) -> None:
    """Draw an arm, solid at its first joint values, a goal, what a motion passes, and a scene."""
    if motion is not None:
        draw_way(axes, _chain_of(arm), motion, scene)
    if scene is not None:
        draw_scene(axes, _chain_of(arm), scene, rows, rows if motion is None else rows_of(motion)[0])
    # Separate colours while they can be distinguished.
    few = motion is None and len(rows) <= len(COLOURS)
    for i in range(len(rows) - 1, 0, -1):
        color = COLOURS[i] if few else COLOURS[-1]
        draw_arm(axes, arm, rows[i], color, linewidth=1.6, alpha=0.5 if few else 0.35)
    draw_arm(axes, arm, rows[0], linewidth=3.2, zorder=5)
    if goal is not None:
        _draw_goal(axes, goal)
    _widen(axes)
    same_scale(axes)
    axes.yaxis.labelpad += LABEL_PAD


def _widen(axes: Any) -> None:
    """Give a flat picture some depth; on a short side the numbers of two axes would overlap."""
    ends = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    sides = np.ptp(ends, axis=1)
    more = np.maximum(SHORTEST * sides.max() - sides, 0.0) / 2
    axes.set(**{f"{axis}lim": tuple(ends[i] + [-more[i], more[i]]) for i, axis in enumerate("xyz")})


def _draw_goal(axes: Any, goal: Goal | ArrayLike) -> None:
    """Draw a goal as its axes, or as a star if the orientation is free, in the arm's base."""
    requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
    if requested.shape:
        raise InvalidUse(f"one goal is drawn, got a batch of shape {requested.shape}; choose one")
    T = np.vstack([requested.targets[0], [0.0, 0.0, 0.0, 1.0]])
    T[:3, :3] = T[:3, :3] @ requested.tip_rotation.T
    if requested.form.columns == 0 and not requested.form.ranges:
        axes.scatter(*T[:3, 3], marker="*", s=110, color="black", zorder=6)
        return
    ends = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    draw_frame(axes, T, FRAME_PART * float((ends[:, 1] - ends[:, 0]).max()))
