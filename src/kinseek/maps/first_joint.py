"""The first joint divided out: a pose rotated about the first axis needs a change of the first joint only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.robots import SerialChain
from kinseek.support.transforms import square

from .measures import STEP, all_solutions

Array = NDArray[np.float64]

FULL = 2 * np.pi

ISOLATED = 6
"""Number of joints up to which a pose has isolated solutions."""

FEW = 12
"""Number of solutions tried first for a redundant arm; they covered all but one of a Panda's 1,506 poses all around."""


class FirstJoint(NamedTuple):
    """An arm without the limits of its first joint, in that joint's frame."""

    chain: SerialChain
    place: Array
    """Pose of the first joint's frame in the base of the arm, (4, 4), lengths in [m]."""
    sign: float
    """Sign of the tip's rotation about the axis when the joint's value grows."""
    lower: float
    """Lower limit of the first joint [rad]."""
    upper: float

    @property
    def whole(self) -> bool:
        """Can the joint make a full turn?"""
        return self.upper - self.lower >= FULL


def divided(chain: SerialChain) -> FirstJoint:
    """Remove the first joint's limits and pose from an arm.

    Raises:
        InvalidMap: The first joint is prismatic, is coupled with others, or turns by less than half a turn.
    """
    name = chain.joint_names[0]
    lower, upper, sign = float(chain.lower[0]), float(chain.upper[0]), float(chain.multiplier[0])
    advice = "use a Grid, which does not need this"
    if chain.prismatic[0] or chain.leader[0] != 0:
        raise InvalidMap(f"Rings need a first joint that turns, and {name!r} does not; {advice}")
    if (chain.leader == 0).sum() > 1 or abs(sign) != 1.0:
        raise InvalidMap(
            f"Rings need a first joint that moves nothing else, and others mimic {name!r}; {advice}"
        )
    endless = chain.kinds[0] == "continuous"
    if endless:
        lower, upper = -np.pi, np.pi
    elif upper - lower < np.pi:
        raise InvalidMap(
            f"Rings need a first joint that makes half a turn, and {name!r} turns from {lower:g} to {upper:g} rad; {advice}"
        )
    # The pose of the first axis is divided out too: rings are circles about that axis.
    fixed = chain.fixed.copy()
    place = square(fixed[0])
    fixed[0] = np.eye(4)[:3]
    free = chain.limited(
        np.concatenate([[-np.pi], chain.lower[1:]]),
        np.concatenate([[np.pi], chain.upper[1:]]),
        ("continuous", *chain.kinds[1:]),
    )
    if endless:
        upper = lower + FULL  # As given, -π and π are a rounding error less than a full turn apart.
    return FirstJoint(replace(free, fixed=fixed), place, sign, lower, upper)


def turns(
    first: FirstJoint, arm: Arm, poses: Array, found: NDArray[np.bool_], goal: Callable[[Array], Goal]
) -> tuple[Array, Array]:
    """Return the range of rotations about the first axis for which each pose is reached: from and to [rad].

    A solution with first joint a covers all rotations that move a between its limits. This is at least half a turn, so one
    solution leaves an uncovered arc shorter than half a circle. The arc that several solutions leave is the intersection of
    such arcs, which is one arc or empty.

    Args:
        first: The arm with its first joint divided out.
        arm: Arm of `first.chain`.
        poses: Poses in the first joint's frame, (k, 4, 4), lengths in [m].
        found: Poses that are reached at some rotation, (k,).
        goal: Makes a goal of poses, with tolerances.

    Returns:
        (k,) and (k,), NaN if nothing is reached. The first lies in [-π, π]; rotations from it up to the second are reached.
    """
    begins = np.where(found, -np.pi, np.nan)
    ends = np.where(found, np.pi, np.nan)
    if first.whole or not found.any():
        return begins, ends
    gap = FULL - (first.upper - first.lower)
    every = np.flatnonzero(found)
    for begin in range(0, len(every), STEP):
        some = every[begin : begin + STEP]
        if arm.dof > ISOLATED:  # Solutions are a sample, and a few cover nearly every pose all around.
            low, high = _left(first, gap, *all_solutions(arm, goal(poses[some]), count=FEW))
            some = some[low < high]
            if not len(some):
                continue
        low, high = _left(first, gap, *all_solutions(arm, goal(poses[some])))
        # What is reached begins where the uncovered arc ends.
        start = np.mod(high + np.pi, FULL) - np.pi
        some, start, left = some[low < high], start[low < high], (high - low)[low < high]
        begins[some], ends[some] = start, start + FULL - left
    return begins, ends


def _left(
    first: FirstJoint, gap: float, q: Array, firsts: NDArray[np.int64], counts: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Return for each pose the arc [rad] at which no solution is inside the first joint's limits; empty if low >= high.

    Args:
        first: The arm with its first joint divided out.
        gap: Arc outside the limits [rad].
        q: See `all_solutions`.
        firsts: See `all_solutions`.
        counts: See `all_solutions`.
    """
    starts = first.upper - q[:, 0] if first.sign > 0 else q[:, 0] - first.lower
    low, high = starts[firsts], starts[firsts] + gap
    for k in range(1, int(counts.max())):
        has = counts > k
        start, middle = starts[firsts[has] + k], (low[has] + high[has]) / 2
        # Arcs are compared modulo full turns, so each is brought next to the arc that is left so far.
        near = start + FULL * np.round((middle - (start + gap / 2)) / FULL)
        low[has], high[has] = np.maximum(low[has], near), np.minimum(high[has], near + gap)
    return low, high
