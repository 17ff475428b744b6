"""Arms, their branches, and frames in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.errors import InvalidProblem, InvalidUse
from kinseek.goal import Goal
from kinseek.problem import as_joints
from kinseek.robots.chain import SerialChain, joint_points
from kinseek.robots.mechanism import Mechanism

from .figures import COLOURS, drawn, given_or_new_space, same_scale, text_of, trim
from .shown import count_of

Array = NDArray[np.float64]

VIEW = (22.0, -60.0)
"""Elevation and azimuth of the eye [degrees]."""

FRAME_PART = 0.14
"""Length of the axes of a goal, as a part of the longest side of the picture."""

ASIDE = 6.0
"""By so much [pt] the label of y stands farther off: it is printed aslant, and numbers lie below it."""

SHORTEST = 0.4
"""Of the sides of a picture in space, as a part of the longest."""


@drawn
def arm(
    arm: Arm | Mechanism,
    q: ArrayLike,
    *,
    goal: Goal | ArrayLike | None = None,
    ax: Any = None,
    size: tuple[float, float] = (6.0, 5.2),
    view: tuple[float, float] = VIEW,
) -> Any:
    """Draw an arm in true proportions: solid at its first joint values, as ghosts at the others.

    Args:
        arm: With axes; where the links of a function are, only its author knows.
        q: Joint values, (n,) or (k, n), [rad] or [m].
        goal: A pose or a `Goal` of one target, drawn as its axes x, y and z in red, green and blue; as a star where it asks
            for a position alone.
        ax: Axes in space to draw on, such as those of `space`.
        size: Of a new figure before its margins are cut [inch].
        view: Elevation and azimuth of the eye of a new figure [degrees].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: An arm that is a function, or joint values that do not fit it.
        InvalidUse: No joint values, a batch of goals, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    figure, axes = given_or_new_space(ax, size, view)
    _draw(axes, arm, q, goal)
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
    """Draw all answers to a goal, `arm.branches(goal)`: one solid, the others as ghosts.

    Args:
        branches: Of one goal, with at least one answer.
        chosen: Which is solid, from 0 on.
        ax: Axes in space to draw on, such as those of `space`.
        size: Of a new figure before its margins are cut [inch].
        view: Elevation and azimuth of the eye of a new figure [degrees].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: An arm that is a function.
        InvalidUse: No branches, none among them, no such number, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    if not isinstance(branches, Branches):
        raise InvalidUse(
            f"the branches of one goal are needed, arm.branches(goal); got {type(branches).__name__}"
        )
    if not len(branches):
        raise InvalidUse("there is no branch to draw: the goal was not reached")
    if count_of("chosen", chosen, 0) >= len(branches):
        raise InvalidUse(f"chosen must be from 0 to {len(branches) - 1}, got {chosen!r}")
    first = [chosen, *(i for i in range(len(branches)) if i != chosen)]
    problem = branches.problem
    figure, axes = given_or_new_space(ax, size, view)
    _draw(axes, problem.mechanism, branches.q[first], problem.goal)
    count = f"{len(branches)} {'answer' if len(branches) == 1 else 'answers'}"
    sample = ", a sample of endlessly many" if branches.sampled else ""
    title = f"{text_of(problem.mechanism.name)}: {count}{sample}"
    if ax is None:
        trim(figure, axes, title)
    else:
        axes.set_title(title)
    return figure


def draw_line(axes: Any, points: ArrayLike, **look: Any) -> None:
    """Draw a line through points, (k, 2) or (k, 3) [m]; `look` as Matplotlib's `plot` takes it."""
    axes.plot(*np.asarray(points, dtype=float).T, **look)


def draw_arm(axes: Any, arm: Arm | Mechanism, q: ArrayLike, color: str = COLOURS[0], **look: Any) -> None:
    """Draw a serial arm as a line through its joints at joint values q, (n,).

    Raises:
        InvalidProblem: An arm that is a function: nobody knows where its joints are.
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
    """Its axes and links.

    Raises:
        InvalidProblem: An arm that is a function.
    """
    if arm.axes is None:
        raise InvalidProblem(
            f"{arm.name!r} is a function: where its links are, only its author knows; use draw_line"
        )
    return arm.axes


def _draw(axes: Any, arm: Arm | Mechanism, q: ArrayLike, goal: Goal | ArrayLike | None) -> None:
    """Draw an arm, solid at its first joint values, and a goal."""
    mechanism = arm.mechanism if isinstance(arm, Arm) else arm
    rows = np.atleast_2d(as_joints(mechanism, q))
    if rows.ndim != 2 or not len(rows):
        raise InvalidUse(
            f"q must have shape ({mechanism.dof},) or (k, {mechanism.dof}), got {np.shape(q)}; nothing to draw"
        )
    # Colours of their own as long as they can be told apart.
    few = len(rows) <= len(COLOURS)
    for i in range(len(rows) - 1, 0, -1):
        color = COLOURS[i] if few else COLOURS[-1]
        draw_arm(axes, arm, rows[i], color, linewidth=1.6, alpha=0.5 if few else 0.35)
    draw_arm(axes, arm, rows[0], linewidth=3.2, zorder=5)
    if goal is not None:
        _draw_goal(axes, goal)
    _widen(axes)
    same_scale(axes)
    axes.yaxis.labelpad += ASIDE


def _widen(axes: Any) -> None:
    """Give a flat picture some depth: where a side is short, numbers of two axes are printed over each other."""
    ends = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    sides = np.ptp(ends, axis=1)
    more = np.maximum(SHORTEST * sides.max() - sides, 0.0) / 2
    axes.set(**{f"{axis}lim": tuple(ends[i] + [-more[i], more[i]]) for i, axis in enumerate("xyz")})


def _draw_goal(axes: Any, goal: Goal | ArrayLike) -> None:
    """Its axes, or a star where the orientation is free, in the arm's base."""
    asked = goal if isinstance(goal, Goal) else Goal.pose(goal)
    if asked.shape:
        raise InvalidUse(f"one goal is drawn, got a batch of shape {asked.shape}; choose one")
    T = np.vstack([asked.targets[0], [0.0, 0.0, 0.0, 1.0]])
    T[:3, :3] = T[:3, :3] @ asked.tip_rotation.T
    if asked.form.columns == 0 and not asked.form.ranges:
        axes.scatter(*T[:3, 3], marker="*", s=110, color="black", zorder=6)
        return
    ends = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    draw_frame(axes, T, FRAME_PART * float((ends[:, 1] - ends[:, 0]).max()))
