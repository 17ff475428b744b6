"""Arms, frames and axes with Matplotlib, and files of pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidProblem, InvalidUse, MissingExtra
from kinseek.robots.chain import joint_points

Array = NDArray[np.float64]

COLOURS = ("#0072b2", "#c23b00", "#009e73", "#e69f00", "#7a4e8f", "#56b4e9", "#000000", "#999999")
"""Apart for most eyes, and in grey."""

ZOOM = 0.85
"""Of the box in space, so that numbers and labels beside it stay in the picture."""

NUMBERS, LABEL = 11.5, 30.0
"""Way of numbers and of a label from an axis of a cube [pt], with Matplotlib's own 8 and 21 in it."""


def pyplot() -> Any:
    """Matplotlib's pyplot.

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    try:
        import matplotlib
    except ImportError:
        raise MissingExtra("A picture", "experiments") from None
    matplotlib.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update({"font.size": 9, "grid.alpha": 0.3})
    return pyplot


def space(
    size: tuple[float, float] = (5.2, 4.6), elevation: float = 22.0, azimuth: float = -60.0
) -> tuple[Any, Any]:
    """Make a figure with axes in space, lengths in [m], drawn without a screen.

    Args:
        size: Of the figure [inch].
        elevation: Of the eye [degrees].
        azimuth: Of the eye [degrees].

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    figure = pyplot().figure(figsize=size, layout="constrained")
    axes = figure.add_subplot(projection="3d")
    axes.view_init(elevation, azimuth)
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure, axes


def plane(columns: int = 1, size: tuple[float, float] = (5.2, 4.2), rows: int = 1) -> tuple[Any, Any]:
    """Make a figure with axes in a plane, an array of them if there are more than one, drawn without a screen.

    Args:
        columns: Axes beside each other.
        size: Of the figure [inch].
        rows: Axes below each other.

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    figure, axes = pyplot().subplots(rows, columns, figsize=size, layout="constrained")
    for each in np.ravel(axes):
        each.grid(True)
    return figure, axes


def draw_line(axes: Any, points: ArrayLike, **look: Any) -> None:
    """Draw a line through points, (k, 2) or (k, 3) [m]; `look` as Matplotlib's `plot` takes it."""
    axes.plot(*np.asarray(points, dtype=float).T, **look)


def draw_arm(axes: Any, arm: Arm, q: ArrayLike, color: str = COLOURS[0], **look: Any) -> None:
    """Draw a serial arm as a line through its joints at joint values q, (n,).

    Raises:
        InvalidProblem: An arm that is a function: nobody knows where its joints are.
    """
    if arm.axes is None:
        raise InvalidProblem(
            f"{arm.name!r} is a function: where its links are, only its author knows; use draw_line"
        )
    points = joint_points(arm.axes, np.asarray(q, dtype=float))
    draw_line(axes, points, **({"color": color, "linewidth": 2.5, "solid_capstyle": "round"} | look))
    moving = points[1:-1]
    axes.scatter(*moving.T, color=color, s=14, alpha=look.get("alpha", 1.0))


def draw_frame(axes: Any, T: ArrayLike, length: float) -> None:
    """Draw the axes x, y and z of a pose, (4, 4), in red, green and blue, `length` [m] long."""
    matrix = np.asarray(T, dtype=float)
    for c, color in enumerate((COLOURS[1], COLOURS[2], COLOURS[0])):
        draw_line(axes, [matrix[:3, 3], matrix[:3, 3] + length * matrix[:3, c]], color=color, linewidth=1.4)


def same_scale(axes: Any) -> None:
    """Let a metre be as long along every axis."""
    if not hasattr(axes, "get_zlim"):
        axes.set_aspect("equal")
        return
    from matplotlib.ticker import MaxNLocator

    ends = np.array([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])
    sides = ends[:, 1] - ends[:, 0]
    axes.set_box_aspect(sides, zoom=ZOOM)
    elevation, azimuth = np.radians([axes.elev, axes.azim])
    towards = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    seen = sides * np.sqrt(1.0 - np.square(towards))
    for i, axis in enumerate((axes.xaxis, axes.yaxis, axes.zaxis)):
        # An axis that is short, or points at the eye, has few numbers, else they are printed over each other. Those of z
        # stand above each other and take less room.
        least = 2 if i == 2 else 1
        axis.set_major_locator(MaxNLocator(max(least, round(5 * seen[i] / seen.max())), min_n_ticks=least))
        # Matplotlib moves numbers and label away from an axis by a share of the two other sides: into the numbers where
        # those are short, out of the picture where they are long. Here the way is as long as beside a cube.
        beside = np.linalg.norm(np.delete(sides, i)) / np.linalg.norm(sides) / np.sqrt(2 / 3)
        axis.labelpad = LABEL / beside - 21.0
        axis.set_tick_params(pad=NUMBERS / beside - 8.0)


def save(figure: Any, path: str | Path, dpi: int = 110) -> Path:
    """Write a PNG of `dpi` dots an inch, without the name of the program that made it, and forget the figure.

    Raises:
        InvalidUse: The path ends in that of another format.
    """
    if Path(path).suffix.lower() != ".png":
        raise InvalidUse(f"pictures are PNG files: the path must end in .png, got {str(path)!r}")
    figure.savefig(path, dpi=dpi, metadata={"Software": None})
    pyplot().close(figure)
    return Path(path)
