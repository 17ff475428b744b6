"""Ranking of base placements of an arm, for a list of poses that it must reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.poses import as_pose
from kinseek.printable import printable
from kinseek.support.transforms import inverse, square

from .measures import DEXTERITY, LIMITS, REACHED, measured

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

QUALITIES = (LIMITS, DEXTERITY)


def best_base(arm: Arm, poses: Any, candidates: Any, by: str = LIMITS) -> xarray.Dataset:
    """Rank base placements of an arm by how well it reaches the poses of a task.

    Placements that reach more poses come first; among equals, the one whose worst pose is best. Runs in one process; a
    candidate with n poses costs n searches for all solutions, some tens of microseconds each.

    Args:
        arm: An arm with axes.
        poses: Poses of the task, (n, 4, 4), lengths in [m].
        candidates: Base poses in the frame of these poses, (k, 4, 4), lengths in [m].
        by: Quality of a pose: ``"limit_distance"`` or ``"dexterity"``, see `reach`.

    Returns:
        A dataset along ``candidate``, the best first: its number in `candidates`, ``base``, the number of poses reached, the
            quality of the worst of these, and ``limiting``, the number of the worst pose: one that is not reached, if there
            is one.

    Raises:
        InvalidGoal: Not poses.
        InvalidMap: No poses, no candidates, an arm with black-box kinematics, or an unknown quality.
    """
    task, places = as_pose(poses).reshape(-1, 4, 4), as_pose(candidates).reshape(-1, 4, 4)
    if by not in QUALITIES:
        raise InvalidMap(f"by must be one of {', '.join(QUALITIES)}, got {by!r}")
    if arm.axes is None:
        raise InvalidMap(
            f"the ranking of bases needs the axes and links of an arm, but {arm.name!r} has black-box "
            "kinematics"
        )
    if not len(task) or not len(places):
        raise InvalidMap(f"at least one pose and one candidate are needed, got {len(task)} and {len(places)}")
    import xarray

    found, quality = np.empty((2, len(places), len(task)))
    for i, place in enumerate(places):
        values = measured(arm, square(inverse(place)) @ task, (REACHED, by), Goal.pose)
        found[i], quality[i] = values[REACHED], values[by]
    quality = np.where(found == 1, quality, -np.inf)
    reached, limiting = found.sum(axis=1).astype(int), quality.argmin(axis=1)
    worst = np.where(found == 1, quality, np.inf).min(axis=1)
    worst[reached == 0] = np.nan
    order = np.lexsort((-np.nan_to_num(worst, nan=-np.inf), -reached))
    return xarray.Dataset(
        {
            "number": ("candidate", order, {"long_name": "as it was given"}),
            "base": (
                ("candidate", "row", "column"),
                places[order],
                {"long_name": "place of the base", "units": "m"},
            ),
            "reached": (
                "candidate",
                reached[order],
                {"long_name": f"poses reached, of {len(task)}", "units": "1"},
            ),
            "worst": (
                "candidate",
                worst[order],
                {"long_name": f"least {by} of a pose reached", "units": "1"},
            ),
            "limiting": ("candidate", limiting[order], {"long_name": "number of the worst pose"}),
        },
        attrs={"title": f"Places for the base of {printable(arm.name)}", "by": by, "poses": len(task)},
    )
