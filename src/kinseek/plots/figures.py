"""Figures, axes and their style, and image files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from itertools import product
from pathlib import Path
from typing import Any, ParamSpec

import numpy as np

from kinseek.errors import InvalidUse, MissingExtra
from kinseek.printable import printable
from kinseek.support.whole_file import output_path, whole_file

P = ParamSpec("P")

COLOURS = ("#0072b2", "#c23b00", "#009e73", "#e69f00", "#7a4e8f", "#56b4e9", "#000000", "#999999")
"""Colours that most people can distinguish, also in grey."""

ZOOM = 0.85
"""Zoom of the box in space, so that numbers and labels beside it stay in the picture."""

NUMBERS, LABEL = 11.5, 30.0
"""Distance of numbers and of a label from an axis of a cube [pt], including Matplotlib's own 8 and 21."""

EDGE, TITLE = 0.08, 0.25
"""Margin around a picture in space after trimming, and above it for a title [inch]."""

HINTED = 1.08
"""Factor by which a title may become wider when the picture is saved with more dots per inch. Characters are moved to whole
dots, so the width of a line of 60 characters differs by 7.5 % between 72 and 300 dots per inch.
"""

LETTERS = 9
"""Font size [pt]."""

LOOK = {"font.size": LETTERS, "axes.titlesize": LETTERS + 0.5, "legend.fontsize": LETTERS}
"""Matplotlib settings for the functions of this package; settings for other drawings are not changed."""


def pyplot() -> Any:
    """Import Matplotlib's pyplot.

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    try:
        from matplotlib import pyplot
    except ImportError:
        raise MissingExtra("A picture", "plot") from None
    return pyplot


@contextmanager
def _looking() -> Iterator[None]:
    """Apply the style of this package.

    Matplotlib's own `rc_context` restores every setting, including those that a backend changes when the first figure loads
    it. In notebooks pyplot then showed no more figures.
    """
    settings = pyplot().rcParams
    before = {name: settings[name] for name in LOOK}
    settings.update(LOOK)
    try:
        yield
    finally:
        settings.update(before)


def _leave_to_the_cell(figure: Any) -> None:
    """Remove a figure from pyplot in a notebook.

    There pyplot shows its figures at the end of a cell, and the cell also shows the figure that it returns: the same one
    twice.
    """
    if "inline" in pyplot().get_backend():
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        pyplot().close(figure)
        FigureCanvasAgg(figure)  # A closed figure may have a canvas that cannot draw.


def drawn(draw: Callable[P, Any]) -> Callable[P, Any]:
    """Decorate a function to draw with the package's style, on its own figure or on given axes."""

    @wraps(draw)
    def dressed(*given: P.args, **named: P.kwargs) -> Any:
        with _looking():
            return draw(*given, **named)

    return dressed


def space(
    size: tuple[float, float] = (5.2, 4.6), elevation: float = 22.0, azimuth: float = -60.0
) -> tuple[Any, Any]:
    """Make a figure with axes in space, lengths in [m].

    Args:
        size: Size of the figure [inch].
        elevation: Elevation of the camera [degrees].
        azimuth: Azimuth of the camera [degrees].

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    with _looking():
        figure = pyplot().figure(figsize=size, layout="constrained")
        _leave_to_the_cell(figure)
        axes = figure.add_subplot(projection="3d")
        axes.tick_params(labelsize=LETTERS)
        axes.view_init(elevation, azimuth)
        axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    return figure, axes


def plane(columns: int = 1, size: tuple[float, float] = (5.2, 4.2), rows: int = 1) -> tuple[Any, Any]:
    """Make a figure with axes in a plane, or an array of them if there are more than one.

    Args:
        columns: Number of axes beside each other.
        size: Size of the figure [inch].
        rows: Number of axes below each other.

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    with _looking():
        figure, axes = pyplot().subplots(rows, columns, figsize=size, layout="constrained")
        _leave_to_the_cell(figure)
        for each in np.ravel(axes):
            each.grid(True, alpha=0.3)
            each.tick_params(labelsize=LETTERS)
    return figure, axes


def given_or_new(ax: Any, size: tuple[float, float]) -> tuple[Any, Any]:
    """Return the given axes in a plane with their figure, or new ones.

    Raises:
        InvalidUse: Not axes in a plane.
        MissingExtra: Matplotlib is not installed.
    """
    if ax is None:
        return plane(size=size)
    return _figure_of(ax, in_space=False), ax


def given_or_new_space(ax: Any, size: tuple[float, float], view: tuple[float, float]) -> tuple[Any, Any]:
    """Return the given axes in space with their figure, or new ones, seen from (elevation, azimuth) [degrees].

    Raises:
        InvalidUse: Not axes in space.
        MissingExtra: Matplotlib is not installed.
    """
    if ax is None:
        return space(size, *view)
    return _figure_of(ax, in_space=True), ax


def _figure_of(ax: Any, in_space: bool) -> Any:
    from matplotlib.axes import Axes

    expected = "axes in space, such as those of plots.space()" if in_space else "axes in a plane"
    if not isinstance(ax, Axes):
        raise InvalidUse(f"ax must be {expected}, got {type(ax).__name__}")
    if hasattr(ax, "get_zlim") != in_space:
        raise InvalidUse(f"ax must be {expected}, got axes {'in a plane' if in_space else 'in space'}")
    return ax.get_figure()


def text_of(name: str) -> str:
    """Return a name from a file as a text for Matplotlib, without formulas, and with escapes for unprintable characters."""
    return printable(name).replace("$", r"\$")


def same_scale(axes: Any) -> None:
    """Scale a metre equally along every axis."""
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
        # A short axis, or one that points at the camera, gets few numbers so that they do not overlap. Those of z are above
        # each other and need less space.
        least = 2 if i == 2 else 1
        axis.set_major_locator(MaxNLocator(max(least, round(5 * seen[i] / seen.max())), min_n_ticks=least))
        # Matplotlib moves numbers and label away from an axis in proportion to the two other sides: into the numbers if
        # those are short, out of the picture if they are long. Here the distance is that of a cube.
        beside = np.linalg.norm(np.delete(sides, i)) / np.linalg.norm(sides) / np.sqrt(2 / 3)
        axis.labelpad = LABEL / beside - 21.0
        axis.set_tick_params(pad=NUMBERS / beside - 8.0)


def trim(figure: Any, axes: Any, title: str = "") -> None:
    """Cut the margins of a figure with one axes in space, which are wide for a long or flat arm, and add a title.

    Call it last, before the figure is saved or shown: later additions may not fit.

    Raises:
        InvalidUse: Axes in a plane, or no axes.
    """
    _figure_of(axes, in_space=True)
    words = figure.suptitle(title, va="top", fontsize=LOOK["axes.titlesize"])
    figure.canvas.draw()
    figure.set_layout_engine("none")
    drawn, place, dpi = _extent_in_space(axes), axes.get_window_extent().frozen(), figure.dpi
    edge, above = EDGE * dpi, (TITLE if title else 0.0) * dpi
    wide = max(drawn.width, HINTED * words.get_window_extent().width if title else 0.0) + 2 * edge
    high = drawn.height + 2 * edge + above
    figure.set_size_inches(wide / dpi, high / dpi)
    left = place.x0 - drawn.x0 + (wide - drawn.width) / 2
    below = place.y0 - drawn.y0 + edge
    axes.set_position((left / wide, below / high, place.width / wide, place.height / high))
    words.set_y(1.0 - edge / high)


def _extent_in_space(axes: Any) -> Any:
    """Return the bounding box [px] of axes in space with their numbers and labels, without the empty square around them."""
    from matplotlib.transforms import Bbox
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    corners = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim()))).T
    x, y, _ = proj_transform(*corners, axes.get_proj())
    seen = axes.transData.transform(np.stack([x, y], axis=1))
    renderer = axes.figure.canvas.get_renderer()
    beside = [axis.get_tightbbox(renderer) for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    if axes.get_legend() is not None:
        beside.append(axes.get_legend().get_window_extent(renderer))
    return Bbox.union([Bbox([seen.min(axis=0), seen.max(axis=0)]), *beside])


def save(figure: Any, path: str | Path, dpi: int = 110) -> Path:
    """Write a PNG with `dpi` dots per inch, without the name of the program, and close the figure.

    Raises:
        InvalidUse: The path has the extension of another format.
        InvalidProblem: The file cannot be written.
    """
    if Path(path).suffix.lower() != ".png":
        raise InvalidUse(f"pictures are PNG files: the path must end in .png, got {str(path)!r}")
    with whole_file(output_path(Path(path), "the picture")) as file:
        figure.savefig(file, format="png", dpi=dpi, metadata={"Software": None})
    pyplot().close(figure)
    return Path(path)
