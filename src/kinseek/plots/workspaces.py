"""Pictures of the reachable part of a plane at one orientation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidUse
from kinseek.goal import Goal
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict

from .figures import COLOURS, drawn, given_or_new, text_of
from .shown import count_of

Array = NDArray[np.float64]

REACHED, PROVED, OPEN = COLOURS[5], "#4d4d4d", COLOURS[3]

NAMES = ("reached", "proved out of reach", "not reached, no proof")


@drawn
def workspace(
    arm: Arm,
    goal: Goal | ArrayLike,
    *,
    plane: str | None = None,
    width: float | None = None,
    cells: int = 48,
    budget: int = 2000,
    ax: Any = None,
    size: tuple[float, float] = (6.0, 5.4),
) -> Any:
    """Draw which part of a plane through a goal an arm reaches, with the goal's orientation, or provably cannot reach.

    Each cell is coloured by the result at its centre. Cells that are neither reached nor proved unreachable within the
    budget have a colour of their own.

    Args:
        arm: An arm; proofs require axes.
        goal: A pose or a `Goal` of one target without ranges. The plane goes through its position, and its orientation, or
            direction, is requested in every cell.
        plane: Two of the axes x, y and z of the frame in which the goal is given, along which the picture is. By default the
            plane of motion of a planar arm, else ``"xz"``.
        width: Width of the picture [m], around the arm's base; by default twice its reach.
        cells: Number of cells along each side; cells² goals are solved, by default 2,304, which takes some tenths of a
            second to seconds.
        budget: Maximum number of boxes of a proof, for each cell that is not reached; 0 disables the proofs.
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidGoal: Not a pose.
        InvalidProblem: A goal with ranges, or proofs for an arm with black-box kinematics; ``budget=0`` disables them.
        InvalidUse: A batch of goals, no such plane, a width or a number out of its range, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
    requested.require_plain("a slice of a workspace cannot be drawn for")
    if requested.shape:
        raise InvalidUse(f"one goal is drawn, got a batch of shape {requested.shape}; choose one")
    plane = _plane(arm, requested) if plane is None else plane
    if len(plane) != 2 or not set(plane) <= set("xyz") or plane[0] == plane[1]:
        raise InvalidUse(f"plane must be two of the axes x, y and z, such as 'xz'; got {plane!r}")
    across, up = ("xyz".index(axis) for axis in plane)
    cells, budget = count_of("cells", cells, 2), count_of("budget", budget, 0)
    centre, half = _extent(arm, requested, width)
    middles = (np.arange(cells) + 0.5) / cells * 2 * half - half
    targets = np.tile(requested.target, (cells, cells, 1, 1))
    targets[..., across, 3], targets[..., up, 3] = np.meshgrid(
        centre[across] + middles, centre[up] + middles, indexing="xy"
    )
    solution = arm.ik(requested.at(targets))
    verdict = np.where(solution.success, 0, 2)
    if budget:
        for place in np.argwhere(verdict == 2):
            one = solution[tuple(place)]
            proof = prove(one.problem, solution=one, budget=budget, threads=1).verdict
            verdict[tuple(place)] = {Verdict.REACHABLE: 0, Verdict.UNREACHABLE: 1}.get(proof, 2)
    figure, axes = given_or_new(ax, size)
    _colour(figure, axes, verdict, (centre[across], centre[up], half), ax is None)
    axes.plot(*requested.target[[across, up], 3], "*", color="black", markersize=10)
    other = ({0, 1, 2} - {across, up}).pop()
    axes.set(xlabel=f"{plane[0]} [m]", ylabel=f"{plane[1]} [m]", aspect="equal")
    what = {0: "any orientation", 1: "one direction"}.get(requested.form.columns, "one orientation")
    axes.set_title(f"{text_of(arm.name)}, {'xyz'[other]} = {requested.target[other, 3]:.3g} m, {what}")
    return figure


def _plane(arm: Arm, goal: Goal) -> str:
    """Return the axes of a planar arm's plane of motion, in the frame in which the goal is given; for other arms x and z."""
    places = arm.fk(arm.sample(64))[:, :3, 3]
    places = places[np.isfinite(places).all(axis=1)]
    if goal.base is not None:
        places = places @ goal.base[:3, :3].T
    spread = np.ptp(places, axis=0) if len(places) else np.ones(3)
    flat = int(np.argmin(spread))
    return "xyz".replace("xyz"[flat], "") if spread[flat] <= 1e-9 * spread.max() else "xz"


def _extent(arm: Arm, goal: Goal, width: float | None) -> tuple[Array, float]:
    """Return centre and half width of the picture [m], in the frame in which the goal is given."""
    if width is not None:
        if not np.isfinite(width) or width <= 0:
            raise InvalidUse(f"width must be a positive length [m], got {width!r}")
        half = width / 2
    elif arm.axes is None:
        raise InvalidUse(f"{arm.name!r} has black-box kinematics, so its reach is unknown: give width= [m]")
    else:
        half = float(arm.axes.reach)
    centre = np.zeros(3) if arm.axes is None else arm.axes.fixed[0][:3, 3]
    if goal.base is not None:
        centre = goal.base[:3, :3] @ centre + goal.base[:3, 3]
    return np.asarray(centre, dtype=float), half


def _colour(
    figure: Any, axes: Any, verdict: NDArray[np.int64], extent: tuple[float, float, float], own: bool
) -> None:
    """Colour the cells, with a legend of the colours that occur."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    x, y, half = extent
    colours = (REACHED, PROVED, OPEN)
    axes.imshow(
        verdict,
        origin="lower",
        extent=(x - half, x + half, y - half, y + half),
        cmap=ListedColormap(colours),
        vmin=0,
        vmax=2,
        interpolation="nearest",
    )
    axes.grid(False)
    patches = [
        Patch(color=colours[i], label=f"{NAMES[i]}: {share:.0%}")
        for i in range(3)
        if (share := float((verdict == i).mean()))
    ]
    if own:
        figure.legend(handles=patches, loc="outside lower center", ncols=3, frameon=False)
    else:
        axes.legend(handles=patches)
