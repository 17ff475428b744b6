"""Reading a finished map: values at any pose, fractions, volumes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidGoal, InvalidMap, reason
from kinseek.poses import as_pose
from kinseek.support.interrupts import chunks, in_chunks, raise_of_handler
from kinseek.support.transforms import inverse, square
from kinseek.support.validation import as_number

from .cells import EMPTY, SHARES
from .cells import REACHED as TOUCHED
from .first_joint import FULL
from .grid import Grid, Rings, azimuths, grid_of
from .measures import BRANCHES, MEASURES, REACHED
from .store import DESCRIPTION, DIGEST, Store, signed
from .variables import CELL, TURN_FROM, TURN_TO, TURNS, VARIABLES

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


MOST_LOADED = 2**30
"""Maximum size of a map that is loaded as a whole when its parts are read one after the other [bytes]."""


_EXPANDED = 2**17
"""Poses that `expand` makes at a time."""


def checked(store: Store) -> Store:
    """Return a store of unknown origin with its metadata as they are now, all of them checked.

    Raises:
        InvalidMap: It is not as `reach` makes it.
    """
    try:
        store = store.fixed()
        _require_description(store.description)
        store.require_sound()
    except InvalidMap:
        raise
    except Exception as error:  # Zarr raises many kinds of errors.
        raise_of_handler(error)
        raise InvalidMap(f"the map in {store.place!r} cannot be read: {reason(error)}") from None
    return store


def grid_of_map(dataset: xarray.Dataset) -> Grid | Rings:
    """Return the grid of a map.

    Raises:
        InvalidMap: `reach` did not make it.
    """
    return grid_of(described(dataset)["grid"])


def described(dataset: xarray.Dataset) -> dict[str, Any]:
    """Return the description of a map.

    Raises:
        InvalidMap: `reach` did not make it.
    """
    try:
        description: dict[str, Any] = dataset.attrs[DESCRIPTION]
    except (AttributeError, KeyError):
        raise InvalidMap("this is not a map of maps.reach: it has no attribute 'kinseek'") from None
    _require_description(description)
    return description


def _require_description(description: Any) -> None:
    """Validate the description of a map.

    Raises:
        InvalidMap: Something is missing, unknown or of another type.
    """
    what = "this is no map that maps.reach made: "
    if not isinstance(description, dict) or not isinstance(description.get("grid"), dict):
        raise InvalidMap(f"{what}its attribute {DESCRIPTION!r} does not describe a grid")
    names, rings = description.get("variables"), isinstance(grid_of(description["grid"]), Rings)
    if not isinstance(names, list) or not all(isinstance(name, str) and name in VARIABLES for name in names):
        raise InvalidMap(f"{what}its variables are {names!r:.200}, expected some of {', '.join(VARIABLES)}")
    needed = {REACHED, *(TURNS if rings else ()), *((CELL, *SHARES) if CELL in names else ())}
    if len(set(names)) < len(names) or not needed <= set(names):
        raise InvalidMap(f"{what}its variables are {names!r:.200}, expected {', '.join(sorted(needed))} once")
    if not isinstance(description.get("name"), str):
        raise InvalidMap(f"{what}the name of its arm is {description.get('name')!r:.200}")
    if description.get("scene") is not None:
        as_number("the clearance in its scene", description.get("clearance"), 0.0, np.inf, InvalidMap)
    if signed(description)[DIGEST] != description.get(DIGEST):
        raise InvalidMap(f"{what}its attribute {DESCRIPTION!r} is damaged, or an earlier version wrote it")
    if not rings:
        return
    try:
        shape = as_pose(description.get("first_frame")).shape
    except InvalidGoal as error:
        raise InvalidMap(f"{what}its first frame is not a pose: {reason(error, 200)}") from None
    if shape != (4, 4):
        raise InvalidMap(f"{what}its first frame is of shape {shape}")
    as_number("the share of a turn of its first joint", description.get("first_turns"), 0.0, 1.0, InvalidMap)


def require_whole(dataset: xarray.Dataset | xarray.DataArray, grid: Grid | Rings) -> None:
    """Check that a map has the cells of its grid, in their order: a part of a map keeps the description of the whole.

    Args:
        dataset: The map, or its capability, which has no orientations.
        grid: Its grid.

    Raises:
        InvalidMap: It has others, or its coordinates are missing.
    """
    dims = grid.dims if hasattr(dataset, "data_vars") else grid.names
    for name, places in zip(dims, (*grid.places, np.arange(grid.shape[-1])), strict=False):
        there = dataset.indexes.get(name)
        if there is None or len(there) != len(places) or not np.all(there.values == places):
            raise InvalidMap(
                f"the cells along {name!r} are not those of the map's grid, in order: give the whole map, as maps.open "
                "returns it"
            )


def _variable(dataset: xarray.Dataset, name: str, dims: tuple[str, ...]) -> xarray.DataArray:
    """Return a variable of a map, which may have been edited.

    Raises:
        InvalidMap: It is missing, is not along `dims`, or does not have the numbers of a map.
    """
    there = dataset.get(name)
    if there is None:
        raise InvalidMap(f"the map has no variable {name!r}: give the whole map, as maps.open returns it")
    if set(there.dims) != set(dims) or there.dtype.kind not in "if":
        raise InvalidMap(
            f"the variable {name!r} is of type {there.dtype} along {there.dims}, expected numbers along {dims}: give the "
            "map as maps.open returns it"
        )
    return there.transpose(*dims)


def at(dataset: xarray.Dataset, poses: ArrayLike) -> dict[str, Array]:
    """Read a map at any poses: the values of the cells that contain them.

    For `Rings`, ``reached`` also depends on whether the first joint can turn so far.

    Args:
        dataset: A map; call ``dataset.load()`` before many small calls, otherwise each reads the store.
        poses: Poses in the arm's base, (..., 4, 4), lengths in [m].

    Returns:
        An array (...) of each variable of the map, and ``inside``. Outside the map, where that is False, integers are -1 and
        all others NaN.

    Raises:
        InvalidMap: It is not a map, or only a part of one.
        InvalidGoal: Wrong shape, NaN, or not a rigid transform, as in `Goal.pose`.
    """
    description, T = described(dataset), as_pose(poses)
    grid = grid_of(description["grid"])
    require_whole(dataset, grid)
    first = square(inverse(np.array(description["first_frame"]))) if isinstance(grid, Rings) else None
    flat = T.reshape(-1, 4, 4)
    cells = in_chunks(lambda some: np.stack(grid.cells_of(some if first is None else first @ some), -1), flat)
    there = {name: _values(_variable(dataset, name, grid.dims), cells) for name in description["variables"]}
    parts: list[dict[str, NDArray[Any]]] = []
    for some in chunks(len(flat)):
        turns = None if first is None else azimuths(first @ flat[some])
        values = {name: each[some] for name, each in there.items()}
        inside = np.asarray(np.all(cells[some] >= 0, axis=-1))
        parts.append({**_inside(values, inside, turns), "inside": inside})
    names = parts[0].keys()
    return {name: np.concatenate([part[name] for part in parts]).reshape(T.shape[:-2]) for name in names}


def _inside(there: dict[str, Array], inside: NDArray[np.bool_], turns: Array | None) -> dict[str, Array]:
    """Return the values at poses, given those of cells, for poses inside the map and the first joint's range.

    Args:
        there: Values of each variable, (k,).
        inside: Whether the map contains the pose, (k,).
        turns: For a map of `Rings`, the azimuths of the poses [rad], (k,).
    """
    values = {}
    for name, each in there.items():
        nothing = -1 if np.issubdtype(each.dtype, np.integer) else np.nan
        values[name] = np.where(inside, each, nothing).astype(each.dtype)
    if turns is not None:
        width = values[TURN_TO] - values[TURN_FROM]
        within = np.mod(turns - values[TURN_FROM], FULL) <= width
        values[REACHED] = np.where(values[REACHED] == 1, within, values[REACHED]).astype("int8")
        for name in (name for name in MEASURES if name in values and name != REACHED):
            nothing = 0 if name == BRANCHES else MEASURES[name].fill
            values[name] = np.where(values[REACHED] == 0, nothing, values[name]).astype(MEASURES[name].dtype)
    return values


def _values(variable: xarray.DataArray, cells: Indices) -> Array:
    """Read the values of some cells, (k, dimensions); from a store only their blocks, once each."""
    data = variable.data
    with _reading():
        if isinstance(data, np.ndarray):
            return in_chunks(lambda some: data[tuple(some.T)], cells)
        return np.asarray(data.vindex[tuple(cells.T)].compute())


@contextmanager
def _reading() -> Iterator[None]:
    """Turn an error while reading values into one about the map.

    Raises:
        InvalidMap: The values cannot be read.
    """
    try:
        yield
    except InvalidMap:
        raise
    except Exception as error:  # Codecs raise many kinds of errors.
        raise_of_handler(error)
        raise InvalidMap(f"the values of the map cannot be read: {reason(error)}") from None


def expand(dataset: xarray.Dataset, grid: Grid) -> xarray.Dataset:
    """Convert a map of `Rings` to boxes of positions, each with the values of the cell that contains its centre.

    Args:
        dataset: A map of `Rings`.
        grid: The boxes and orientations.

    Returns:
        A Dataset along the dimensions of the grid; outside the rings ``reached`` is -1, unknown.

    Raises:
        InvalidMap: It is not a map, or `grid` is no grid.
    """
    import xarray

    description = described(dataset)
    if not isinstance(grid, Grid):
        raise InvalidMap(f"grid must be a maps.Grid, got {type(grid).__name__}")
    if dataset.nbytes <= MOST_LOADED:
        with _reading():
            dataset = dataset.load()
    names = [name for name in description["variables"] if name not in (*TURNS, CELL, *SHARES)]
    dims = grid_of(description["grid"]).dims
    made = {name: np.empty(grid.shape, _variable(dataset, name, dims).dtype) for name in names}
    planes, rows = grid.shape[0], grid.shape[1]
    some = max(_EXPANDED * rows * planes // grid.size, 1)
    for i, columns in itertools.product(range(planes), chunks(rows, some)):
        part = (slice(i, i + 1), columns, slice(None), slice(None))
        values = at(dataset, grid.poses(part))
        for name in names:
            made[name][part] = values[name]
    coordinates = dict(zip(grid.names, grid.places, strict=True))
    variables = {name: (grid.dims, each, dataset[name].attrs) for name, each in made.items()}
    attributes = {**dataset.attrs, "expanded_to": grid.description()}
    del attributes[DESCRIPTION]
    return xarray.Dataset(variables, coordinates, attributes)


def _along_orientations(dataset: xarray.Dataset, name: str) -> xarray.DataArray:
    """Return a variable of a part of a map that has its orientations.

    Raises:
        InvalidMap: As for `_variable`.
    """
    dims = tuple(map(str, dataset[name].dims)) if name in dataset else ()
    return _variable(dataset, name, dims if "orientation" in dims else (*dims, "orientation"))


def capability(dataset: xarray.Dataset) -> xarray.DataArray:
    """Return the fraction of orientations reached at each position (Zacharias, Borst and Hirzinger 2007).

    For `Rings` it is the mean around the ring. It is NaN if a block is not done. `plots.map_slice` and `plots.cloud` draw
    it.

    Args:
        dataset: A map.

    Raises:
        InvalidMap: It is not a map.
    """
    grid, known = grid_of_map(dataset), _along_orientations(dataset, REACHED)
    share = (known == 1).astype(float)
    if isinstance(grid, Rings):
        first, last = (_along_orientations(dataset, name) for name in TURNS)
        width = (last - first) / FULL
        share = (share * width).where(known == 1, 0.0)
    share = share.where(known >= 0).mean("orientation", skipna=False)
    share.attrs = {"long_name": "share of orientations that are reached", "units": "1"}
    share.attrs[DESCRIPTION] = described(dataset)
    return share.rename("capability")


class Volume(NamedTuple):
    """Bounds on the volume of the workspace from a map with ``prove=True``: from `least` to `most`."""

    least: float
    """Volume that is proved reached: a lower bound of the reached volume."""
    touched: float
    """Volume of the cells in which a pose is reached. The arm need not reach all of these cells."""
    most: float
    """Volume that is not proved empty: an upper bound of the reached volume."""


def volume(dataset: xarray.Dataset, what: str = "poses") -> Volume:
    """Bound the volume of the workspace inside a map's range.

    Args:
        dataset: A map made with ``prove=True``.
        what: ``"poses"``: cubic metres times the fraction of all orientations; or ``"positions"``, reached with any
            orientation, [m³].

    Raises:
        InvalidMap: It is not a whole map, is not proved, or is not finished.
    """
    grid = grid_of_map(dataset)
    if what not in ("poses", "positions"):
        raise InvalidMap(f"what must be 'poses' or 'positions', got {what!r}")
    if CELL not in dataset:
        raise InvalidMap("bounds of a volume need proofs: make the map with maps.reach(..., prove=True)")
    require_whole(dataset, grid)
    with _reading():
        cell = _variable(dataset, CELL, grid.dims)
        last = cell.isel(dict.fromkeys(cell.dims, -1))  # For most unfinished maps this is unknown.
        # Block by block, before loading anything as a whole; NaN is not known either.
        if not (bool(last >= 0) and bool((cell >= 0).all())):
            raise InvalidMap(
                "the map is not finished; repeat the call of maps.reach that began it to continue it"
            )
        known, empty, whole = (_variable(dataset, name, grid.dims).values for name in (CELL, *SHARES))
    weights = np.full(known.shape[:-1], grid.volume / np.prod(known.shape[:-1]))
    if isinstance(grid, Rings):
        ends = grid.places[0][:, None] + np.array([-0.5, 0.5]) * grid.widths[0]
        weights = np.pi * (ends[:, 1:] ** 2 - ends[:, :1] ** 2) * grid.widths[1] * np.ones(known.shape[1])
    touched, left = known == TOUCHED, np.where(known == EMPTY, 0.0, 1.0 - empty)
    combine = np.mean if what == "poses" else np.max
    if what == "positions":
        whole = np.floor(whole)  # Parts of cells may or may not share positions.
    # A solution covers all rotations that move the first joint between its limits.
    if isinstance(grid, Rings):
        whole = whole * described(dataset)["first_turns"]
    return Volume(
        float((weights * combine(whole, axis=-1)).sum()),
        float((weights * combine(touched.astype(float), axis=-1)).sum()),
        float((weights * combine(left if what == "poses" else np.ceil(left), axis=-1)).sum()),
    )
