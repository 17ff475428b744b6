"""``kinseek map``: what an arm reaches of a whole grid of poses."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

import click
import numpy as np

from kinseek.arm import Arm
from kinseek.cli.help import Command, option
from kinseek.cli.options import Robot, json_option, robot_options
from kinseek.cli.output import complain, on_terminal
from kinseek.cli.report import print_json
from kinseek.cli.scenes import Cell, scene_options
from kinseek.cli.words import numbers, split
from kinseek.errors import InvalidMap
from kinseek.maps import Grid, Rings, capability, estimate, orientations, reach, volume
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.whole_file import output_path

_GRID, _WORK = "The grid", "The computation"


@click.command(
    "map",
    cls=Command,
    examples=[
        "kinseek map ur5e --step 0.5 --orientations 72 --store ur5e.zarr",
        "kinseek map ur5e --rings --step 0.05 --estimate",
        "kinseek map ur5e --step 0.5 --orientations 12 --scene cell.urdf --capsules 0.05",
    ],
    more=[
        "Time and memory are estimated and printed before the work begins. With --store it can be stopped at any "
        "time, and --resume continues it.",
        "Exit codes: 0 done, 2 misuse or interrupted; 130 stopped with Ctrl-C.",
    ],
)
@robot_options
@scene_options
@option(
    "--step",
    metavar="M",
    type=float,
    group=_GRID,
    help="Width of a cell, m. Default: a tenth of the arm's reach.",
)
@option(
    "--range",
    "ranges",
    metavar="X X Y Y Z Z",
    group=_GRID,
    help="Lower and upper value along x, y and z, m. With --rings: lower and upper radius and height, four values. "
    "Default: the arm's reach.",
)
@option(
    "--orientations",
    "count",
    metavar="N",
    type=int,
    default=576,
    group=_GRID,
    help="Approximate number of orientations, evenly spread.",
)
@option(
    "--rings",
    is_flag=True,
    group=_GRID,
    help="Divide out the first joint: one plane of cells represents all rotations about it.",
)
@option(
    "--what",
    metavar="WORDS",
    default="reached",
    group=_WORK,
    help="Measures separated by commas: reached, branches, dexterity, limit_distance.",
)
@option(
    "--prove",
    is_flag=True,
    group=_WORK,
    help="Classify each whole cell: reached somewhere, proved empty or undecided.",
)
@option(
    "--depth",
    metavar="N",
    type=int,
    default=2,
    group=_WORK,
    help="Number of halvings of an undecided cell.",
)
@option(
    "--store",
    metavar="FOLDER",
    type=click.Path(path_type=Path),
    group=_WORK,
    help="Write the map here, block by block (Zarr).",
)
@option("--resume", is_flag=True, group=_WORK, help="Continue the map in the folder.")
@option(
    "--scheduler",
    metavar="ADDRESS",
    group=_WORK,
    help="Scheduler of a Dask cluster, tcp://HOST:PORT. Default: the cores of this machine.",
)
@option(
    "--picture",
    metavar="FILE",
    type=click.Path(path_type=Path),
    group=_WORK,
    help="Draw the middle slice into this .png file.",
)
@option("--estimate", "only", is_flag=True, group=_WORK, help="Print the estimate and stop.")
@json_option
def command(
    robot: Robot,
    cell: Cell,
    step: float | None,
    ranges: str | None,
    count: int,
    rings: bool,
    what: str,
    prove: bool,
    depth: int,
    store: Path | None,
    resume: bool,
    scheduler: str | None,
    picture: Path | None,
    only: bool,
    as_json: bool,
) -> int:
    """Map which poses of an even grid an arm reaches, and with options how well."""
    loaded = robot.load()
    grid = _grid(loaded, step, ranges, count, rings)
    if resume and store is None:
        raise InvalidMap("--resume needs --store FOLDER, the folder of the map to continue")
    if store is not None and not resume and store.exists():
        raise InvalidMap(f"{str(store)!r} already exists; add --resume to continue the map in it")
    if picture is not None and picture.suffix.lower() != ".png":
        raise InvalidMap(f"--picture must end in .png, got {str(picture)!r}")
    if picture is not None:
        output_path(picture, "--picture")
    if picture is not None and not only:
        _load_matplotlib()
    words = tuple(split(what))
    options: dict[str, Any] = {"prove": prove, "depth": depth}
    options |= {"scene": cell.of(loaded, robot), "clearance": cell.clearance}
    client = _client(scheduler)
    cores = None if client is None else sum(client.nthreads().values()) or 1
    cost = estimate(loaded, grid, words, seconds=0.5, cores=cores, **options)
    complain(str(cost))
    facts: dict[str, Any] = {"cells": cost.cells, "estimated_seconds": cost.duration}
    if not only:
        began = time.perf_counter()
        dataset = reach(loaded, grid, words, store=store, client=client, progress=on_terminal(), **options)
        facts |= {"seconds": time.perf_counter() - began, "reached": float((dataset.reached == 1).mean())}
        facts["places_reached"] = float((capability(dataset) > 0).mean())
        if prove:
            facts |= {
                "empty": float((dataset.cell == 2).mean()),
                "undecided": float((dataset.cell == 0).mean()),
            }
            facts |= {f"volume_{name}": each for name, each in volume(dataset)._asdict().items()}
    if as_json:
        print_json(facts)
    else:
        print("\n".join(f"{name}: {value:.6g}" for name, value in facts.items()))
    if picture is not None and not only:  # Last, since it may be impossible to write it.
        from kinseek import plots

        plots.save(plots.map_slice(dataset), picture)
    return 0


def _load_matplotlib() -> None:
    """Import Matplotlib without the ``matplotlibrc`` of the working folder, which may be somebody else's.

    Matplotlib reads that file when it is imported, before those of the user, and has no option against it.

    Raises:
        MissingExtra: Matplotlib is not installed.
    """
    from kinseek.plots.figures import pyplot

    with contextlib.chdir(Path(__file__).parent):
        pyplot()


def _grid(arm: Arm, step: float | None, ranges: str | None, count: int, rings: bool) -> Grid | Rings:
    """The requested grid: whole cells, by default as far as the arm reaches."""
    reach_of_it = arm.chain.reach
    width = step if step is not None else float(f"{reach_of_it / 10:.1g}")
    if not np.isfinite(width) or width <= 0.0:
        raise InvalidMap(f"--step must be a positive length, m, got {width:g}")
    names = Rings.names if rings else Grid.names
    if ranges is None:
        half = np.ceil(reach_of_it / width) * width
        centre = np.zeros(3) if rings else arm.chain.fixed[0, :, 3]
        ends = [(-half, half)] * 3 if not rings else [(0.0, half), (-half, half)]
        middles = [0.0, 0.0] if rings else [round(float(c) / width) * width for c in centre]
        pairs = [(low + middle, high + middle) for (low, high), middle in zip(ends, middles, strict=True)]
    else:
        bounds = numbers(ranges, "--range", 2 * len(names))
        pairs = list(zip(bounds[::2], bounds[1::2], strict=True))
    cells = [(float(low), float(high), width) for low, high in pairs]
    turns = orientations(count)
    return Rings(cells[0], cells[1], turns) if rings else Grid(cells[0], cells[1], cells[2], turns)


def _client(scheduler: str | None) -> Any:
    if scheduler is None:
        return None
    import distributed

    connect: Any = distributed.Client
    try:
        return connect(scheduler, timeout=10)
    except Exception as error:  # Dask raises TypeError if TLS is not configured, and others.
        raise_of_handler(error)
        raise InvalidMap(f"cannot connect to a Dask scheduler at {scheduler!r}: {error}") from None
