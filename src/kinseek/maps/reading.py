"""What a finished map tells: values at any pose, shares, volumes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidMap
from kinseek.poses import as_pose
from kinseek.transforms import inverse, square

from .cells import EMPTY, SHARES
from .cells import REACHED as TOUCHED
from .first_joint import FULL
from .grid import Grid, Rings, azimuths, grid_of
from .measures import BRANCHES, MEASURES, REACHED
from .store import DESCRIPTION

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]


def grid_of_map(dataset: xarray.Dataset) -> Grid | Rings:
    """The grid of a map.

    Raises:
        InvalidMap: It is none that `reach` made.
    """
    return grid_of(described(dataset)["grid"])


def described(dataset: xarray.Dataset) -> dict[str, Any]:
    """What a map is of.

    Raises:
        InvalidMap: It is none that `reach` made.
    """
    try:
        told: dict[str, Any] = dataset.attrs[DESCRIPTION]
    except (AttributeError, KeyError):
        raise InvalidMap("this is no map that maps.reach made: it lacks the attribute 'kinseek'") from None
    return told


def at(dataset: xarray.Dataset, poses: ArrayLike) -> dict[str, Array]:
    """Read a map at any poses: the values of the cells that they lie in.

    Of `Rings`, ``reached`` also asks whether the first joint can turn so far.

    Args:
        dataset: A map; ``dataset.load()`` before many small questions, else each reads the store.
        poses: In the arm's base, (..., 4, 4), lengths in [m].

    Returns:
        Of each variable of the map an array (...), and ``inside``. Outside of the map, where that is False, nothing is
        known: whole numbers are -1, all others NaN.

    Raises:
        InvalidMap: It is no map.
        InvalidGoal: Wrong shape, NaN, no rigid transform, as of `Goal.pose`.
    """
    told, T = described(dataset), as_pose(poses)
    grid = grid_of(told["grid"])
    if isinstance(grid, Rings):
        T = square(inverse(np.array(told["first_frame"]))) @ T
    cells = grid.cells_of(T)
    inside = np.all([cell >= 0 for cell in cells], axis=0)
    values = {}
    for name in told["variables"]:
        there = dataset[name].transpose(*grid.dims).values[cells]
        nothing = -1 if np.issubdtype(there.dtype, np.integer) else np.nan
        values[name] = np.where(inside, there, nothing).astype(there.dtype)
    if isinstance(grid, Rings):
        turn = np.mod(azimuths(T) - values["turn_from"], FULL)
        within = turn <= values["turn_to"] - values["turn_from"]  # False where either is NaN.
        values[REACHED] = np.where(values[REACHED] == 1, within, values[REACHED]).astype("int8")
        for name in (name for name in MEASURES if name in values and name != REACHED):
            nothing = 0 if name == BRANCHES else MEASURES[name].fill
            values[name] = np.where(values[REACHED] == 0, nothing, values[name]).astype(MEASURES[name].dtype)
    return {**values, "inside": inside}


def expand(dataset: xarray.Dataset, grid: Grid) -> xarray.Dataset:
    """Make of a map of `Rings` one of boxes of positions, each with the values of the cell that its middle lies in.

    Args:
        dataset: A map of `Rings`.
        grid: The boxes and orientations that are wanted.

    Returns:
        A Dataset along the dimensions of the grid; outside of the rings nothing is known: ``reached`` is -1.

    Raises:
        InvalidMap: It is no map.
    """
    import xarray

    told = described(dataset)
    dataset = dataset.load()
    names = [name for name in told["variables"] if name not in ("turn_from", "turn_to", "cell", *SHARES)]
    made = {name: np.empty(grid.shape, dataset[name].dtype) for name in names}
    for i in range(grid.shape[0]):
        part = (slice(i, i + 1), *[slice(None)] * 3)
        values = at(dataset, grid.poses(part))
        for name in names:
            made[name][part] = values[name]
    coordinates = dict(zip(grid.names, grid.places, strict=True))
    variables = {name: (grid.dims, each, dataset[name].attrs) for name, each in made.items()}
    attributes = {**dataset.attrs, "expanded_to": grid.description()}
    del attributes[DESCRIPTION]
    return xarray.Dataset(variables, coordinates, attributes)


def capability(dataset: xarray.Dataset) -> xarray.DataArray:
    """Share of all orientations that are reached, of each position (Zacharias, Borst and Hirzinger 2007).

    Of `Rings` it is the mean around the ring. NaN where a block is not done. `plots.map_slice` and `plots.cloud` draw it.

    Args:
        dataset: A map.

    Raises:
        InvalidMap: It is no map.
    """
    grid, known = grid_of_map(dataset), dataset[REACHED]
    share = (known == 1).astype(float)
    if isinstance(grid, Rings):
        share = share * ((dataset["turn_to"] - dataset["turn_from"]) / FULL).fillna(0.0)
    share = share.where(known >= 0).mean("orientation", skipna=False)
    share.attrs = {"long_name": "share of orientations that are reached", "units": "1"}
    share.attrs[DESCRIPTION] = described(dataset)
    return share.rename("capability")


class Volume(NamedTuple):
    """How much an arm reaches, as far as a map with ``prove=True`` tells: from `least` to `most`."""

    least: float
    """Of all that is proved to be reached: what is reached is no less than this."""
    touched: float
    """Of the cells in which a pose is reached. The arm need not reach all of these cells."""
    most: float
    """Of all that is not proved empty: what is reached is no more than this."""


def volume(dataset: xarray.Dataset, what: str = "poses") -> Volume:
    """Bound the workspace inside of a map's range.

    Args:
        dataset: A map made with ``prove=True``.
        what: ``"poses"``: cubic metres times the share of all orientations; or ``"positions"``, reached with any
            orientation, [m³].

    Raises:
        InvalidMap: It is no map, it is not proved, or it is not finished.
    """
    grid = grid_of_map(dataset)
    if what not in ("poses", "positions"):
        raise InvalidMap(f"what must be 'poses' or 'positions', got {what!r}")
    if "cell" not in dataset:
        raise InvalidMap("a volume is bounded by proofs: maps.reach(..., prove=True) makes such a map")
    known, empty, whole = (dataset[name].transpose(*grid.dims).values for name in ("cell", *SHARES))
    if (known < 0).any():
        raise InvalidMap("the map is not finished; the call of maps.reach that began it goes on with it")
    weights = np.full(known.shape[:-1], grid.volume / np.prod(known.shape[:-1]))
    if isinstance(grid, Rings):
        ends = grid.places[0][:, None] + np.array([-0.5, 0.5]) * grid.widths[0]
        weights = np.pi * (ends[:, 1:] ** 2 - ends[:, :1] ** 2) * grid.widths[1] * np.ones(known.shape[1])
    touched, left = known == TOUCHED, np.where(known == EMPTY, 0.0, 1.0 - empty)
    gather = np.mean if what == "poses" else np.max
    if what == "positions":
        whole = np.floor(whole)  # Of parts of cells it is not known whether their positions are the same.
    # An answer serves all turns that take the first joint from one limit to the other.
    if isinstance(grid, Rings):
        whole = whole * described(dataset)["first_turns"]
    return Volume(
        float((weights * gather(whole, axis=-1)).sum()),
        float((weights * gather(touched.astype(float), axis=-1)).sum()),
        float((weights * gather(left if what == "poses" else np.ceil(left), axis=-1)).sum()),
    )
