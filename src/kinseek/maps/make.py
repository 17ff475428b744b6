"""Maps of what an arm reaches on a grid of poses, computed block by block and kept in a store."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack, cast

import numpy as np

import kinseek
from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.collision.solutions import judge_of
from kinseek.errors import InvalidMap, MissingExtra, suggest
from kinseek.goal import Goal
from kinseek.support.private import resolved
from kinseek.support.validation import NO_BOUND, as_flag, as_integer
from kinseek.tolerances import DEFAULT_TOLERANCE, TOLERANCES, check_tolerance

from .block import Work, digest, slim, version
from .cells import SHARES
from .first_joint import FULL, divided
from .grid import BLOCK, Grid, Rings
from .measures import REACHED, required
from .reading import checked
from .run import run
from .search import PATIENCE, axes_of, patience_of
from .store import DIGEST, MOST_BLOCKS, MOST_CHUNK, Store, blocks_of, compare, require_own
from .variables import CELL, TURNS

if TYPE_CHECKING:
    import xarray
    from distributed import Client


class Options(TypedDict, total=False):
    """Options of a map."""

    prove: bool
    """Also classify each whole cell as reached somewhere, proved empty, or undecided? Default False."""
    depth: int
    """Number of times a cell is halved before it is called undecided; default 2. Beyond 8 ``whole_share`` does not change.
    Below 4 it is 0 nearly everywhere, and for cells of 3 cm and more below 8.
    """
    budget: int
    """Maximum number of boxes of joint values per proof; default 10,000."""
    patience: int | None
    """Maximum number of FK evaluations for a pose not solved from its first samples, or for which the closed form is not
    certain; None uses as many as `Arm.ik`. Default 1,000, which finds hardly fewer poses; None if a tolerance is above 1e-3.
    """
    block: int | None
    """Approximate number of poses per block; a block is lost if a worker dies. None means 524,288, with ``prove`` 8,192."""
    position_tolerance: float
    """Largest position error of a reached pose [m]; default 1e-6."""
    orientation_tolerance: float
    """Largest orientation error of a reached pose [rad]; default 1e-6."""
    scene: Scene | None
    """The collision scene: a pose is reached if a collision-free solution is found. For a `Grid` only."""
    clearance: float
    """Minimum distance between bodies of the scene [m]; default 0."""
    goal: Goal | None
    """What counts of each pose: a goal, with its tolerances, whose target every pose of the grid replaces, such as
    ``Goal.pose(np.eye(4), free="rz", cone=0.17)``. By default the whole pose. For a `Grid` only, and without `prove`.
    """


PROVED = 8192
"""Number of cells of a block with proofs of whole cells: some seconds of one core."""


DEFAULTS = Options(
    prove=False,
    depth=2,
    budget=10_000,
    patience=PATIENCE,
    block=None,
    position_tolerance=DEFAULT_TOLERANCE,
    orientation_tolerance=DEFAULT_TOLERANCE,
    scene=None,
    clearance=0.0,
    goal=None,
)


def options_of(given: Mapping[str, Any]) -> Options:
    """Return all options, with defaults for those not given.

    Raises:
        InvalidGoal: A tolerance is not valid.
        InvalidMap: An unknown option.
    """
    for name in given:
        if name not in DEFAULTS:
            raise InvalidMap(suggest(name, DEFAULTS, "option of a map"))
    options = cast(Options, {**DEFAULTS, **given})
    for name in TOLERANCES:
        check_tolerance(name, options[name])  # type: ignore[literal-required]
    if "patience" not in given:
        goal = options["goal"]
        if isinstance(goal, Goal):
            options["patience"] = patience_of(goal.position_tolerance, goal.orientation_tolerance)
        else:
            options["patience"] = patience_of(options["position_tolerance"], options["orientation_tolerance"])
    return options


def reach(
    arm: Arm,
    grid: Grid | Rings,
    what: Sequence[str] = (REACHED,),
    *,
    store: str | Path | None = None,
    client: Client | None = None,
    progress: bool = False,
    **options: Unpack[Options],
) -> xarray.Dataset:
    """Make a map: for each cell of a grid, what the arm can do at its centre.

    Args:
        arm: An arm with axes; its tip is mapped, so use `Arm.with_tool` to map a tool.
        grid: `Grid`, boxes of positions in the arm's base; or `Rings`, with the first joint divided out.
        what: ``"reached"``, ``"branches"``, ``"dexterity"`` and ``"limit_distance"``; each variable of the map describes
            itself. All but the first need every solution, which takes ten to thirty times as long. For a redundant arm the
            solutions are a sample of infinitely many.
        store: A folder that the map is written to, block by block. Blocks of this map that it already has are not computed
            again. Unless a client is given, it and all folders in it must belong to this user, and nobody else may write to
            them. On a cluster all workers must see it. By default the map stays in memory.
        client: A ``distributed.Client`` of a cluster; by default a process is started for each core of this machine, which
            nobody else can reach. The cluster's settings control who may connect to it.
        progress: Show a progress bar.
        options: Options of the map, see `Options`: ``prove``, ``depth``, ``budget``, ``patience``, ``block``,
            ``position_tolerance``, ``orientation_tolerance``, ``scene``, ``clearance`` and ``goal``.

    Returns:
        A Dataset along the grid's dimensions and ``orientation``, with units and provenance; data in a store are read
        lazily.

    Raises:
        InvalidMap: An arm with black-box kinematics, a goal with a base, unknown measures, a store of another map or that
            another user can change, no client, workers with another version, or rings in a scene.
        InvalidScene: The scene belongs to another arm, or the clearance is not a length.
        MapInterrupted: Scheduler gone, disk full, or a block that kills its workers; the same call resumes.
        MissingExtra: xarray, Dask or Zarr is not installed.
    """
    require_extra()
    if client is not None:
        from distributed import Client

        if not isinstance(client, Client):
            raise InvalidMap(f"client must be a distributed.Client, got {type(client).__name__}")
    work = work_of(
        arm,
        grid,
        what,
        **options_of(options),
        store=None if store is None else _place(store),
    )
    map_store = store_of(arm, grid, work, client is not None)
    todo, work = map_store.missing(), replace(work, map=map_store.description[DIGEST])
    run(work, todo, math.prod(map_store.blocks), client, progress, map_store.write)
    dataset: xarray.Dataset = map_store.dataset()
    # On threads: a client of Dask elsewhere in the program would be sent the whole map.
    return dataset if work.store is not None else dataset.load(scheduler="threads")


def open_map(store: str | Path) -> xarray.Dataset:
    """Open a finished or unfinished map that `reach` has written; missing blocks have the variables' fill values.

    Args:
        store: Its folder.

    Raises:
        InvalidMap: There is no map, or one that `reach` did not make.
        MissingExtra: xarray, Dask or Zarr is not installed.
    """
    require_extra()
    dataset: xarray.Dataset = checked(Store.at(_place(store))).dataset()
    return dataset


def _place(store: str | Path) -> str:
    """Return the path of a store without links.

    Raises:
        InvalidMap: It is no path, the home or working folder that it begins with does not exist, or another user may have
            put a link there.
    """
    try:
        return str(resolved(Path(store).expanduser()))
    except (OSError, RuntimeError, TypeError, ValueError) as error:
        raise InvalidMap(f"store must be the path of a folder, got {str(store)!r}: {error}") from None


def work_of(
    arm: Arm, grid: Grid | Rings, what: Sequence[str], *, store: str | None, **options: Unpack[Options]
) -> Work:
    """Return the data that workers need.

    Raises:
        InvalidMap: An argument is not valid, or the arguments do not fit together.
    """
    axes = axes_of(arm, "a map")
    if not isinstance(grid, Grid | Rings):
        raise InvalidMap(f"grid must be a maps.Grid or maps.Rings, got {type(grid).__name__}")
    given: Mapping[str, Any] = options
    for name, least in (("depth", 0), ("budget", 1), ("block", 1), ("patience", 1)):
        value = given[name]
        if name in ("patience", "block") and value is None:
            continue
        as_integer(name, value, least, MOST_CHUNK if name == "block" else NO_BOUND, InvalidMap)
    # Raises if the first joint cannot be divided out.
    if isinstance(grid, Rings):
        divided(axes)
    scene, clearance = given["scene"], given["clearance"]
    if scene is None and clearance != 0.0:
        raise InvalidMap(f"clearance= needs a scene: give scene=, got clearance={clearance!r}")
    if scene is not None:
        clearance = judge_of(scene, arm.mechanism, clearance, None).clearance
        if isinstance(grid, Rings):
            raise InvalidMap(
                "Rings are not supported in a scene: their poses rotate about the first axis, but obstacles do not; "
                "use a Grid"
            )
        scene = copy(scene)  # Another thread may change it before all workers have it.
    goal = given["goal"]
    if goal is not None:
        _check_goal(goal, grid, given)
    prove = as_flag("prove", options["prove"], InvalidMap)
    chain, patience = slim(axes), options["patience"]
    chunks = grid.chunks(int(options["block"] or (PROVED if prove else BLOCK)))
    if (blocks := math.prod(blocks_of(grid.shape, chunks))) > MOST_BLOCKS:
        raise InvalidMap(
            f"a map of {grid.size:,} cells in blocks of {math.prod(chunks):,} has {blocks:,} blocks, expected at most "
            f"{MOST_BLOCKS:,}: give a larger block="
        )
    return Work(
        chain=chain,
        arm=digest(chain),
        grid=grid.description(),
        chunks=chunks,
        what=required(what),
        position_tolerance=float(options["position_tolerance"]),
        orientation_tolerance=float(options["orientation_tolerance"]),
        patience=None if patience is None else int(patience),
        prove=prove,
        depth=int(options["depth"]) if prove else 0,
        budget=int(options["budget"]) if prove else 0,
        version=version(),
        store=store,
        scene=scene,
        clearance=clearance,
        cell=None if scene is None else scene.digest,
        goal=goal,
    )


def _check_goal(goal: object, grid: Grid | Rings, options: Mapping[str, Any]) -> None:
    """Check the goal of a map.

    Raises:
        InvalidMap: Not one goal, a goal with a base, or options that do not go with a goal.
    """
    if not isinstance(goal, Goal) or goal.shape != () or goal.base is not None:
        raise InvalidMap(
            "goal must be a Goal with one target, which every pose of the grid replaces, and without base=, got "
            f"{goal!r:.200}"
        )
    if isinstance(grid, Rings) or options["prove"]:
        raise InvalidMap("a map of a goal= needs a maps.Grid, and cannot be combined with prove=True")
    if any(options[name] != DEFAULTS[name] for name in TOLERANCES):  # type: ignore[literal-required]
        raise InvalidMap("give the tolerances to the goal, and not to the map of a goal=")


def _description_of(goal: Goal) -> dict[str, str]:
    """Return all that a goal asks of each pose, as text for the provenance of a map."""
    named = {each.name: getattr(goal, each.name) for each in fields(goal) if each.name != "target"}
    return {
        name: repr(value.tolist() if isinstance(value, np.ndarray) else value)
        for name, value in named.items()
    }


def store_of(arm: Arm, grid: Grid | Rings, work: Work, cluster: bool = False) -> Store:
    """Return the existing store, if it is of this map, or a new one.

    Args:
        arm: The arm.
        grid: The grid.
        work: The data that workers need.
        cluster: May another user own or change the store? A cluster may run as one.

    Raises:
        InvalidMap: The store is of another map, another user can change it, or it cannot be made.
    """
    turns, proofs = TURNS if isinstance(grid, Rings) else (), (CELL, *SHARES) if work.prove else ()
    description: dict[str, Any] = {
        "arm": work.arm,
        "name": arm.name,
        "version": work.version,
        "grid": work.grid,
        "variables": [*work.what, *turns, *proofs],
        "position_tolerance": work.position_tolerance,
        "orientation_tolerance": work.orientation_tolerance,
        "patience": work.patience,
        "prove": work.prove,
        "depth": work.depth,
        "budget": work.budget,
        "scene": work.cell,
        "clearance": work.clearance if work.cell is not None else None,
        "dims": list(grid.dims),
        "shape": list(grid.shape),
        "chunks": list(work.chunks),
    }
    if work.goal is not None:
        description["goal"] = _description_of(work.goal)
    if isinstance(grid, Rings):
        first = divided(work.chain)
        description["first_frame"] = first.place.tolist()
        description["first_turns"] = min(1.0, (first.upper - first.lower) / FULL)
    description = json.loads(json.dumps(description))  # In the form in which a store returns it.
    path = None if work.store is None else Path(work.store)
    if path is not None and path.exists():
        return _there(path, description, cluster)
    attributes: dict[str, Any] = {
        "Conventions": "CF-1.11",
        "title": f"What {arm.name} reaches",
        "source": f"kinseek {kinseek.__version__}, maps.reach",
        "references": "see docs/maps.md of kinseek",
    }
    try:
        return Store.create(path, description, attributes)
    except InvalidMap:
        if path is None or not path.exists():
            raise
        return _there(path, description, cluster)  # Another run of this map was faster.


def _there(path: Path, description: dict[str, Any], cluster: bool) -> Store:
    """Return an existing store.

    Raises:
        InvalidMap: It is of another map, another user can change it, or it is damaged.
    """
    there = Store.at(str(path))
    compare(str(path), there.description, description)
    if not cluster:
        require_own(path)
    return checked(there)  # All that the finished map needs, before anything is computed.


def require_extra() -> None:
    """Check that the packages for maps are installed.

    Raises:
        MissingExtra: xarray, Dask or Zarr is not installed.
    """
    try:
        import dask
        import xarray
        import zarr
    except ImportError:
        raise MissingExtra("A map", "maps") from None
    del dask, xarray, zarr
