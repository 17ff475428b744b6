"""What a finished map tells: values at any pose, shares, volumes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidGoal, InvalidMap
from kinseek.interrupts import raise_of_handler
from kinseek.poses import as_pose
from kinseek.transforms import inverse, square
from kinseek.validation import as_number

from .cells import EMPTY, SHARES
from .cells import REACHED as TOUCHED
from .first_joint import FULL
from .grid import Grid, Rings, azimuths, grid_of
from .measures import BRANCHES, MEASURES, REACHED
from .store import DESCRIPTION, Store

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


TURNS = ("turn_from", "turn_to")

TYPES: dict[str, tuple[str, float]] = {
    **{name: (measure.dtype, measure.fill) for name, measure in MEASURES.items()},
    **dict.fromkeys(TURNS, ("float64", np.nan)),
    "cell": ("int8", -1),
    **dict.fromkeys(SHARES, ("float32", np.nan)),
}
"""Of each variable its type, and its value where nothing is known."""


MOST_LOADED = 2**30
"""Bytes of a map that is read as a whole, where parts of it are asked for one after the other."""


def opened(store: Store) -> xarray.Dataset:
    """Return the map in a store, which anybody may have made.

    Raises:
        InvalidMap: It is not as `reach` makes it.
    """
    try:
        _require_description(store.description)
        store.require_sound(TYPES)
        dataset: xarray.Dataset = store.dataset()
    except InvalidMap:
        raise
    except Exception as error:  # Zarr and xarray raise whatever they meet.
        raise_of_handler(error)
        raise InvalidMap(f"the map in {store.place!r} cannot be read: {error!s:.500}") from error
    return dataset


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
        report: dict[str, Any] = dataset.attrs[DESCRIPTION]
    except (AttributeError, KeyError):
        raise InvalidMap("this is no map that maps.reach made: it lacks the attribute 'kinseek'") from None
    _require_description(report)
    return report


def _require_description(report: Any) -> None:
    """Refuse what says of a map what cannot be.

    Raises:
        InvalidMap: Something that is missing, unknown or of another type.
    """
    what = "this is no map that maps.reach made: "
    if not isinstance(report, dict) or not isinstance(report.get("grid"), dict):
        raise InvalidMap(f"{what}its attribute {DESCRIPTION!r} describes no grid")
    names, rings = report.get("variables"), isinstance(grid_of(report["grid"]), Rings)
    if not isinstance(names, list) or not all(isinstance(name, str) and name in TYPES for name in names):
        raise InvalidMap(f"{what}its variables are {names!r:.200}, expected some of {', '.join(TYPES)}")
    needed = {REACHED, *(TURNS if rings else ()), *(("cell", *SHARES) if "cell" in names else ())}
    if len(set(names)) < len(names) or not needed <= set(names):
        raise InvalidMap(f"{what}its variables are {names!r:.200}, expected {', '.join(sorted(needed))} once")
    if not isinstance(report.get("name"), str):
        raise InvalidMap(f"{what}the name of its arm is {report.get('name')!r:.200}")
    if not rings:
        return
    try:
        shape = as_pose(report.get("first_frame")).shape
    except InvalidGoal as error:
        raise InvalidMap(f"{what}its first frame is no pose: {error!s:.200}") from None
    if shape != (4, 4):
        raise InvalidMap(f"{what}its first frame is of shape {shape}")
    as_number("the share of a turn of its first joint", report.get("first_turns"), 0.0, 1.0, InvalidMap)


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
    report, T = described(dataset), as_pose(poses)
    grid = grid_of(report["grid"])
    if isinstance(grid, Rings):
        T = square(inverse(np.array(report["first_frame"]))) @ T
    cells = grid.cells_of(T)
    inside = np.all([cell >= 0 for cell in cells], axis=0)
    values = {}
    for name in report["variables"]:
        there = _values(dataset[name].transpose(*grid.dims), cells)
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


def _values(variable: xarray.DataArray, cells: tuple[Indices, ...]) -> Array:
    """Read the values of some cells, and of a store no other blocks than theirs."""
    flat, data = tuple(each.ravel() for each in cells), variable.data
    with _reading():
        there = data[flat] if isinstance(data, np.ndarray) else data.vindex[flat].compute()
    return np.asarray(there).reshape(cells[0].shape)


@contextmanager
def _reading() -> Iterator[None]:
    """Say it of a map if its values cannot be read.

    Raises:
        InvalidMap: They cannot.
    """
    try:
        yield
    except InvalidMap:
        raise
    except Exception as error:  # Codecs raise whatever they meet.
        raise_of_handler(error)
        raise InvalidMap(f"the values of the map cannot be read: {error!s:.500}") from error


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

    report = described(dataset)
    if dataset.nbytes <= MOST_LOADED:
        with _reading():
            dataset = dataset.load()
    names = [name for name in report["variables"] if name not in ("turn_from", "turn_to", "cell", *SHARES)]
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
    with _reading():
        cell = dataset["cell"]
        last = cell.isel(
            dict.fromkeys(cell.dims, -1)
        )  # Of most maps that are not finished, this is not known.
        if bool(last < 0) or bool(
            (cell < 0).any()
        ):  # Block by block, and before anything is read as a whole.
            raise InvalidMap("the map is not finished; the call of maps.reach that began it goes on with it")
        known, empty, whole = (dataset[name].transpose(*grid.dims).values for name in ("cell", *SHARES))
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
