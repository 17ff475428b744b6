"""Pictures of maps of workspaces: slices, the capability cloud, bounds of the volume, base placements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.maps.cells import EMPTY, REACHED, UNDECIDED
from kinseek.maps.grid import Rings
from kinseek.maps.reading import capability, grid_of_map, require_whole, volume
from kinseek.support.validation import as_integer, is_finite_number

from .figures import COLOURS, drawn, given_or_new, given_or_new_space, same_scale, text_of

Array = NDArray[np.float64]

CELLS = {
    REACHED: ("reached somewhere", COLOURS[5]),
    UNDECIDED: ("undecided", COLOURS[3]),
    EMPTY: ("proved empty", "#4d4d4d"),
}

ARROW = 0.3
"""Length of an arrow that shows the direction of a base [inch]."""

SHARES = "viridis"
"""Colour map of fractions."""


@drawn
def map_slice(
    dataset: Any,
    *,
    orientation: int | None = None,
    ax: Any = None,
    size: tuple[float, float] | None = None,
    **where: float,
) -> Any:
    """Draw a plane of a map: the fraction of orientations reached, or the results for one orientation.

    Args:
        dataset: A map from `kinseek.maps.reach`, or its capability.
        orientation: Index of one orientation; by default the capability of all. For a map with ``prove=True``, the class of
            each cell is drawn. Not for a capability, which has no single orientations.
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch]; by default as wide as the plane requires.
        where: Position of the plane along one dimension of a `Grid`: ``z=0.4`` [m]; the nearest cells are drawn. By default
            the middle of y. `Rings` are a plane already.

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidMap: It is not a map, or only a part of one.
        InvalidUse: No such dimension, place or orientation, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    grid = grid_of_map(dataset)
    require_whole(dataset, grid)
    if isinstance(grid, Rings):
        if where:
            raise InvalidUse(f"rings are a plane already, got {', '.join(where)}")
    elif not where:
        where = {"y": float(np.median(grid.places[1]))}
    if len(where) > 1 or not set(where) <= set(grid.names):
        raise InvalidUse(
            f"give the position of the plane by one of {', '.join(grid.names)}, got {', '.join(where) or 'none'}"
        )
    if orientation is not None and _is_capability(dataset):
        raise InvalidUse("a capability has no separate orientations: give the map itself")
    if orientation is not None:
        orientation = as_integer("orientation", orientation, 0, grid.shape[-1] - 1, InvalidUse)
    for name, at in where.items():
        if not is_finite_number(at):
            raise InvalidUse(f"{name} must be a finite number [m], got {at!r:.200}")
    plane = dataset.sel(where, method="nearest") if where else dataset
    across, up = (name for name in grid.names if name not in where)
    extent = [
        (float(dataset[name][end]) + side * grid.widths[grid.names.index(name)] / 2)
        for name in (across, up)
        for end, side in ((0, -1), (-1, 1))
    ]
    figure, axes = given_or_new(ax, size or _size(extent, 3.4 if orientation is None else 5.6))
    look = {"origin": "lower", "extent": extent, "interpolation": "nearest", "aspect": "equal"}
    if orientation is None:
        share = _share(plane.assign_attrs(dataset.attrs)).transpose(up, across)
        shown = axes.imshow(share.values, cmap=SHARES, vmin=0.0, vmax=1.0, **look)
        figure.colorbar(shown, ax=axes, label="share of orientations reached", shrink=0.8)
        what = "capability"
    else:
        _one(figure, axes, plane.isel(orientation=orientation).transpose(up, across, ...), look)
        what = f"orientation {orientation}"
    axes.grid(False)
    axes.set(xlabel=f"{across} [m]", ylabel=f"{up} [m]")
    place = "".join(f", {name} = {float(plane[name]):.3g} m" for name in where)
    axes.set_title(f"{_name(dataset)}, {what}{place}")
    return figure


def _one(figure: Any, axes: Any, plane: Any, look: dict[str, Any]) -> None:
    """Colour the cells of one orientation, with a legend."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    if "cell" in plane:
        words, values = CELLS, plane["cell"].values
    else:
        words, values = (
            {1: ("reached", COLOURS[5]), 0: ("no answer found", "#cccccc")},
            plane["reached"].values,
        )
    numbers = list(words)
    shown = np.full(values.shape, np.nan)
    for k, number in enumerate(numbers):
        shown[values == number] = k
    colours = ListedColormap([colour for _, colour in words.values()])
    axes.imshow(shown, cmap=colours, vmin=-0.5, vmax=len(numbers) - 0.5, **look)
    patches = [
        Patch(color=colour, label=f"{word}: {share:.0%}")
        for number, (word, colour) in words.items()
        if (share := float((values == number).mean()))
    ]
    axes.legend(handles=patches, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3, frameon=False)


@drawn
def cloud(
    dataset: Any,
    *,
    least: float = 0.05,
    cut: bool = True,
    ax: Any = None,
    size: tuple[float, float] = (6.2, 5.0),
    view: tuple[float, float] = (22.0, -60.0),
) -> Any:
    """Draw the capability of a map in space: a dot for each position, coloured by the fraction of orientations reached.

    Args:
        dataset: A map of a `Grid` from `kinseek.maps.reach`, or its capability.
        least: Positions with a smaller fraction are left out.
        cut: Leave out the front quarter, so that the inside is visible.
        ax: Axes in space to draw on.
        size: Size of a new figure [inch].
        view: Elevation and azimuth of the camera [degrees].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidMap: It is not a map, or only a part of one.
        InvalidUse: A map of `Rings`, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    grid = grid_of_map(dataset)
    require_whole(dataset, grid)
    if isinstance(grid, Rings):
        raise InvalidUse(
            "a cloud needs a map of a Grid; draw one of Rings, which are a plane, with map_slice"
        )
    share = _share(dataset).transpose(*grid.names).values
    x, y, z = np.meshgrid(*grid.places, indexing="ij")
    shown = share >= least
    if cut:
        azimuth = np.radians(view[1])
        towards, sideways = (
            x * np.cos(azimuth) + y * np.sin(azimuth),
            x * np.sin(azimuth) - y * np.cos(azimuth),
        )
        shown &= towards < np.abs(sideways)
    figure, axes = given_or_new_space(ax, size, view)
    dots = axes.scatter(
        x[shown],
        y[shown],
        z[shown],
        c=share[shown],
        cmap=SHARES,
        vmin=0.0,
        vmax=1.0,
        s=_dot(grid.shape[:3]),
        lw=0,
        depthshade=False,
    )
    figure.colorbar(dots, ax=axes, label="share of orientations reached", shrink=0.7, pad=0.12)
    same_scale(axes)
    axes.set_title(_name(dataset))
    return figure


@drawn
def volumes(
    datasets: Sequence[Any], *, what: str = "poses", ax: Any = None, size: tuple[float, float] = (5.6, 4.0)
) -> Any:
    """Draw how the bounds of a workspace's volume converge as cells get smaller.

    Args:
        datasets: Maps of one arm, made with ``prove=True``, with cells of several sizes.
        what: ``"poses"`` or ``"positions"``, see `kinseek.maps.volume`.
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidMap: One is not a map, or not proved.
        InvalidUse: No maps, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    if not datasets:
        raise InvalidUse("at least one map is drawn, got none")
    widths = np.array([grid_of_map(each).widths[0] for each in datasets])
    order = np.argsort(widths)
    bounds = np.array([volume(each, what) for each in datasets])[order]
    figure, axes = given_or_new(ax, size)
    x = widths[order] * 100
    axes.fill_between(x, bounds[:, 0], bounds[:, 2], color=COLOURS[5], alpha=0.3, lw=0)
    axes.plot(x, bounds[:, 2], "o-", color=COLOURS[0], label="all that is not proved empty")
    axes.plot(x, bounds[:, 1], "o-", color=COLOURS[2], label="cells in which a pose is reached")
    axes.plot(x, bounds[:, 0], "o-", color=COLOURS[1], label="all that is proved to be reached")
    unit = "m³ x share of orientations" if what == "poses" else "m³"
    axes.set(xlabel="width of a cell [cm]", ylabel=f"volume [{unit}]", ylim=(0.0, None))
    axes.set_title(f"{_name(datasets[0])}, {what}")
    axes.legend(frameon=False)
    return figure


@drawn
def bases(ranked: Any, *, ax: Any = None, size: tuple[float, float] | None = None) -> Any:
    """Draw base placements from above: how many poses each reaches, and the best.

    If several candidates have the same position, each is an arrow along the x axis of the base. Candidates that differ only
    in height or tilt overlap, with the best in front. The colour of a candidate that was not examined at all poses is an
    estimate from those at which it was.

    Args:
        ranked: The result of `kinseek.maps.best_base`.
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch]; by default as wide as the positions require.

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: Not such a result, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    if not {"base", "reached", "examined"} <= set(getattr(ranked, "data_vars", ())):
        raise InvalidUse(f"ranked must be a result of maps.best_base, got {type(ranked).__name__}")
    places, most = ranked["base"].values[:, :2, 3], ranked.attrs["poses"]
    reached = ranked["reached"].values * (most / ranked["examined"].values)
    (left, low), (right, high) = places.min(axis=0), places.max(axis=0)
    figure, axes = given_or_new(ax, size or _size([left, right, low, high], 3.4))
    shown = axes.scatter(*places[::-1].T, c=reached[::-1], cmap=SHARES, vmin=0, vmax=most, s=40)
    figure.colorbar(shown, ax=axes, label=f"poses reached, of {most}", shrink=0.8)
    if len(np.unique(places.round(6), axis=0)) < len(places):
        directions = ranked["base"].values[:, :2, 0]
        look = {"angles": "xy", "scale_units": "inches", "scale": 1 / ARROW, "width": 0.03, "units": "inches"}
        axes.quiver(*places[::-1].T, *directions[::-1].T, reached[::-1], cmap=SHARES, clim=(0, most), **look)
        axes.quiver(*places[0], *directions[0], color=COLOURS[1], label="x axis of the best", **look)
        axes.margins(0.15)  # Arrows at the edge do not widen the axes.
    axes.plot(*places[0], "*", color=COLOURS[1], markersize=16, label="best")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_title(text_of(ranked.attrs["title"]))
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.12))
    return figure


def _is_capability(dataset: Any) -> bool:
    """Return whether a dataset is a result of `kinseek.maps.capability` instead of a map."""
    return not hasattr(dataset, "data_vars")


def _share(dataset: Any) -> Any:
    """Return the capability of a map, or the capability itself."""
    return dataset if _is_capability(dataset) else capability(dataset)


def _dot(shape: tuple[int, ...]) -> float:
    """Return the area of a dot [points²] that hides the dots behind it, for this number side by side in a usual figure."""
    return float(np.clip(150.0 / max(shape), 2.0, 16.0) ** 2)


def _size(extent: Sequence[float], least: float) -> tuple[float, float]:
    """Return width and height of a figure [inch] for a plane from left, right, low, high, with space for a scale."""
    left, right, low, high = extent
    wide = (right - left) / max(high - low, 1e-9)
    if 4.0 * wide + 2.0 > 8.0:
        return 8.0, max(2.6, 6.0 / wide + 1.6)
    return max(least, 4.0 * wide + 2.0), 5.0


def _name(dataset: Any) -> str:
    return text_of(str(dataset.attrs["kinseek"]["name"]))
