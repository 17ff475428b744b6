"""The variables and coordinates of a map: their types and attributes, and the values that a finished block can have."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .cells import ATTRIBUTES, EMPTY, SHARES, UNDECIDED
from .first_joint import FULL
from .grid import Grid, Rings
from .measures import BRANCHES, LIMITS, MEASURES, Measure

Array = NDArray[np.float64]

CELL = "cell"

TURNS = TURN_FROM, TURN_TO = "turn_from", "turn_to"

VARIABLES: dict[str, Measure] = {
    **MEASURES,
    TURN_FROM: Measure(
        "float64",
        np.nan,
        -np.pi,
        np.pi,
        {
            "long_name": "azimuth of the position from which on the pose is reached, about the first axis",
            "units": "radian",
        },
    ),
    TURN_TO: Measure(
        "float64",
        np.nan,
        -np.pi,
        np.pi + FULL,
        {
            "long_name": "azimuth of the position up to which the pose is reached, about the first axis",
            "units": "radian",
        },
    ),
    CELL: Measure("int8", -1, UNDECIDED, EMPTY, ATTRIBUTES[CELL]),
    **{name: Measure("float32", np.nan, 0.0, 1.0, ATTRIBUTES[name]) for name in SHARES},
}
"""All variables that a map can have."""

ROUNDING = 1e-6
"""Distance outside the range of a variable that can be due to rounding."""


def variables_of(description: Mapping[str, Any], grid: Grid | Rings) -> dict[str, Measure]:
    """Return the variables of a described map, with comments on what they mean in it."""
    variables = {name: VARIABLES[name] for name in description["variables"]}
    comments = {name: each.attributes.get("comment") for name, each in variables.items()}
    if isinstance(grid, Rings):
        comments[BRANCHES] = "limits of the first joint left out"
        comments[LIMITS] = "of the joints after the first, each measured in half its range"
    if description["scene"] is not None:
        free = f"of solutions that are free in the scene, bodies {description['clearance']:g} m apart"
        comments |= {name: "; ".join(filter(None, (comments.get(name), free))) for name in MEASURES}
    return {
        name: each._replace(
            attributes=each.attributes | ({"comment": comments[name]} if comments[name] else {})
        )
        for name, each in variables.items()
    }


def coordinates_of(
    grid: Grid | Rings, rotations: Any
) -> dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]]:
    """Return the dimensions, values and attributes of each coordinate of a map.

    Args:
        grid: The grid.
        rotations: Its orientations as matrices, (k, 3, 3), or a Dask array of them: there may be millions.
    """
    whose = "arm's base" if isinstance(grid, Grid) else "frame of the first joint"
    table: dict[str, tuple[tuple[str, ...], Any, dict[str, Any]]] = {
        name: (
            (name,),
            place,
            {
                "units": "m",
                "long_name": f"{name} of the tip in the {whose}, middle of a cell",
                "width": width,
            },
        )
        for name, place, width in zip(grid.names, grid.places, grid.widths, strict=True)
    }
    table["orientation"] = (
        ("orientation",),
        np.arange(grid.shape[-1]),
        {"long_name": "number of an orientation"},
    )
    table["rotation"] = (
        ("orientation", "row", "column"),
        rotations,
        {
            "long_name": f"orientation of the tip in the {whose}, as a rotation matrix",
            "units": "1",
            "covering_radius": grid.orientations.covering_radius,
            "comment": "covering_radius [rad]: every orientation is at most so far from one of these",
        },
    )
    return table


def is_possible(name: str, values: Array) -> bool:
    """Return whether all values of a variable in a finished block are in its range, or mean that nothing is reached."""
    variable = VARIABLES[name]
    good = (values >= variable.least - ROUNDING) & (values <= variable.most + ROUNDING)
    if name not in SHARES:  # They are known of every cell.
        good |= np.isnan(values)
    return bool(good.all())
