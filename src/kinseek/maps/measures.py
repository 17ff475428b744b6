"""The variables of a map, and their computation for a block of poses."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import BranchesBatch
from kinseek.collision import Scene
from kinseek.errors import InvalidMap, suggest
from kinseek.goal import Goal
from kinseek.support.turns import shortest

from .free import reached_freely
from .search import PATIENCE, reached

Array = NDArray[np.float64]


class Measure(NamedTuple):
    """One variable of a map."""

    dtype: str
    fill: float
    """Value where no pose is reached, or the block is not done yet."""
    least: float
    most: float
    """Range of its other values."""
    attributes: dict[str, Any]


REACHED, BRANCHES, DEXTERITY, LIMITS = "reached", "branches", "dexterity", "limit_distance"

MEASURES = {
    REACHED: Measure(
        "int8",
        -1,
        0,
        1,
        {
            "long_name": "whether an answer is found within the tolerances",
            "flag_values": [0, 1],
            "flag_meanings": "not_found reached",
            "units": "1",
        },
    ),
    BRANCHES: Measure(
        "int16",
        -1,
        0,
        np.inf,
        {"long_name": "number of distinct solutions found, modulo whole turns", "units": "1"},
    ),
    DEXTERITY: Measure(
        "float32",
        np.nan,
        0.0,
        np.inf,
        {
            "long_name": "manipulability of the answer that has most: product of the singular values of its Jacobian",
            "references": "Yoshikawa 1985, eq. 4",
            "comment": "metres and radians are mixed: compare values of one arm",
            "units": "1",
        },
    ),
    LIMITS: Measure(
        "float32",
        np.nan,
        0.0,
        1.0,
        {
            "long_name": "distance from the nearest joint limit, of the answer that is farthest from its own",
            "comment": "each joint measured in half its range: 0 at a limit, 1 where all are in the middle",
            "units": "1",
        },
    ),
}
"""All variables by name, in their order in a map."""

PIECE = 131_072
"""Number of poses solved at a time, small enough that memory is reused instead of being cleared by the system again."""

STEP = 256
"""Number of poses whose branches are computed at a time. Not examined further."""


def required(what: Sequence[str]) -> tuple[str, ...]:
    """Return the requested measures, each once, in their order, with `REACHED`.

    Raises:
        InvalidMap: One of them is unknown.
    """
    if not isinstance(what, Iterable):
        raise InvalidMap(f"what must be some of {', '.join(MEASURES)}, got {what!r:.200}")
    what = [what] if isinstance(what, str) else list(what)
    for name in what:
        if not isinstance(name, str) or name not in MEASURES:
            raise InvalidMap(suggest(str(name), MEASURES, "measure"))
    return tuple(name for name in MEASURES if name == REACHED or name in what)


GoalOf = Callable[[Array], Goal]
"""Makes a goal of poses, (k, 4, 4)."""


def measured(
    arm: Arm,
    poses: Array,
    what: Sequence[str],
    goal: GoalOf,
    free: int = 0,
    patience: int | None = PATIENCE,
    scene: Scene | None = None,
    clearance: float = 0.0,
) -> dict[str, Array]:
    """Solve a block of poses, (..., 4, 4), on one thread, and return an array (...) of each measure.

    Args:
        arm: The arm; its atlas is built now unless it exists.
        poses: Poses, lengths in [m].
        what: Names of measures.
        goal: Makes goals with the tolerances.
        free: Number of first joints that are ignored in the distance from limits.
        patience: See `search.reached`.
        scene: Scene in which solutions must be free.
        clearance: Minimum distance of bodies in it [m].
    """
    flat = poses.reshape(-1, 4, 4)
    found = np.zeros(len(flat), dtype=bool)
    for first in range(0, len(flat), PIECE):
        goals = goal(flat[first : first + PIECE])
        if scene is None:
            found[first : first + PIECE] = reached(arm, goals, patience)
        else:
            found[first : first + PIECE] = reached_freely(arm, goals, scene, clearance, patience)
    values = {name: np.full(len(flat), MEASURES[name].fill, MEASURES[name].dtype) for name in what}
    values[REACHED] = found.astype("int8")
    if len(values) > 1:
        if BRANCHES in values:
            values[BRANCHES][:] = 0
        every = np.flatnonzero(found)
        for first in range(0, len(every), STEP):
            some = every[first : first + STEP]
            _best(arm, goal(flat[some]), some, values, free, scene, clearance)
    return {name: each.reshape(poses.shape[:-2]) for name, each in values.items()}


def _best(
    arm: Arm,
    goal: Goal,
    some: NDArray[np.int64],
    values: dict[str, Array],
    free: int,
    scene: Scene | None,
    clearance: float,
) -> None:
    """Write the measures of all solutions of a goal whose poses have these numbers."""
    q, firsts, counts = all_solutions(arm, goal, scene, clearance)
    if BRANCHES in values:
        values[BRANCHES][some] = counts
    if DEXTERITY in values:
        values[DEXTERITY][some] = np.maximum.reduceat(arm.manipulability(q), firsts)
    if LIMITS in values:
        values[LIMITS][some] = np.maximum.reduceat(limit_distance(arm, q, free), firsts)


def all_solutions(
    arm: Arm,
    goal: Goal,
    scene: Scene | None = None,
    clearance: float = 0.0,
    count: int | None = None,
) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Return all solutions of a goal whose k poses are all reached, collision-free in a scene; at least one each.

    Args:
        arm: The arm; its atlas is built now unless it exists.
        goal: Poses, (k, 4, 4), and tolerances.
        scene: Scene in which solutions must be free.
        clearance: Minimum distance of bodies in it [m].
        count: Maximum number of solutions of each pose.

    Returns:
        Joint values, (m, n); the index of the first solution of each pose, (k,), and their number, (k,).
    """
    branches = cast(
        BranchesBatch, arm.branches(goal, count=count, scene=scene, clearance=clearance, threads=1)
    )
    counts, q = branches.counts, branches.q
    missed = np.flatnonzero(counts == 0)  # `ik` found one that the search for all missed.
    if len(missed):
        single = arm.ik(goal.at(goal.target[missed]), scene=scene, clearance=clearance, threads=1)
        q = np.insert(q, branches.offsets[missed], single.q, axis=0)
        counts = np.maximum(counts, 1)
    return q, np.cumsum(counts) - counts, counts


def limit_distance(arm: Arm, q: Array, free: int = 0) -> Array:
    """Return the distance of joint values, (k, n), from the nearest limit, relative to half the range, (k,); at most 1.

    A joint that can turn more than once is measured at the full turn nearest to the middle.
    """
    chain = arm.chain
    half = np.maximum((chain.upper - chain.lower) / 2, 1e-12)
    off = q - (chain.lower + chain.upper) / 2
    off = np.where(chain.periodic & (half >= np.pi), shortest(off), off)
    counts = np.array(chain.kinds) != "continuous"
    counts[:free] = False
    return np.asarray(1.0 - (np.abs(off) / half)[:, counts].max(axis=1, initial=0.0))
