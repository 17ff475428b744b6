"""Where to put the base of an arm, for a list of poses that it shall reach."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.poses import as_pose
from kinseek.printable import printable
from kinseek.transforms import inverse, square

from .measures import DEXTERITY, LIMITS, REACHED, measured

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]

QUALITIES = (LIMITS, DEXTERITY)


def best_base(arm: Arm, poses: Any, candidates: Any, by: str = LIMITS) -> xarray.Dataset:
    """Rank places for the base of an arm by what it reaches of a task.

    More poses reached come first; of places that reach as many, that whose worst pose is best. One process; a candidate
    with n poses costs n questions for all answers, some tens of microseconds each.

    Args:
        arm: With axes.
        poses: Of the task, (n, 4, 4), lengths in [m].
        candidates: Places of the base in the frame of these poses, (k, 4, 4), lengths in [m].
        by: What makes a pose a good one: ``"limit_distance"`` or ``"dexterity"``, see `reach`.

    Returns:
        Along ``candidate``, the best first: its number as it was given, ``base``, how many poses are reached, the quality of
        the worst of these, and ``limiting``, the number of the pose that is worst: one not reached, if there is one.

    Raises:
        InvalidGoal: Not poses.
        InvalidMap: No poses, no candidates, a function as an arm, or an unknown quality.
    """
    task, places = as_pose(poses).reshape(-1, 4, 4), as_pose(candidates).reshape(-1, 4, 4)
    if by not in QUALITIES:
        raise InvalidMap(f"by must be one of {', '.join(QUALITIES)}, got {by!r}")
    if arm.axes is None:
        raise InvalidMap(f"a base is ranked by an arm's axes and links, and {arm.name!r} is a function")
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
