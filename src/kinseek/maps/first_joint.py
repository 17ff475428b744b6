"""The first joint divided out: a pose turned about the first axis is reached by the same joint values but for the first."""

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
from kinseek.transforms import square

from .measures import STEP, every_answer

Array = NDArray[np.float64]

FULL = 2 * np.pi

ISOLATED = 6
"""Joints that a pose leaves none of to choose."""

FEW = 12
"""Answers asked first of an arm with joints to spare. Of a Panda's 1,506 poses one was not served all around by these."""


class FirstJoint(NamedTuple):
    """An arm without the limits of its first joint, seen from that joint's frame."""

    chain: SerialChain
    place: Array
    """Of the first joint's frame in the base of the arm, (4, 4), lengths in [m]."""
    sign: float
    """Which way the hand goes round when the joint's value grows."""
    lower: float
    """Of the first joint, [rad]."""
    upper: float

    @property
    def whole(self) -> bool:
        """Does the joint turn all around?"""
        return self.upper - self.lower >= FULL


def divided(chain: SerialChain) -> FirstJoint:
    """Take the first joint's limits and place out of an arm.

    Raises:
        InvalidMap: The first joint slides, is coupled with others, or turns by less than half a turn.
    """
    name = chain.joint_names[0]
    lower, upper, sign = float(chain.lower[0]), float(chain.upper[0]), float(chain.multiplier[0])
    advice = "take a Grid, which asks for no such thing"
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
    fixed = chain.fixed.copy()
    place = square(fixed[0])
    fixed[0] = np.eye(4)[:3]
    free = chain.limited(
        np.concatenate([[-np.pi], chain.lower[1:]]),
        np.concatenate([[np.pi], chain.upper[1:]]),
        ("continuous", *chain.kinds[1:]),
    )
    if endless:
        upper = lower + FULL  # As they come, -π and π are a rounding less than a full turn apart.
    return FirstJoint(replace(free, fixed=fixed), place, sign, lower, upper)


def turns(
    first: FirstJoint, arm: Arm, poses: Array, found: NDArray[np.bool_], goal: Callable[[Array], Goal]
) -> tuple[Array, Array]:
    """About the first axis, how far each pose can be turned and be reached: from and to [rad].

    An answer with first joint a serves all turns that take a from one limit to the other. Half a turn at least, so what one
    answer leaves is an arc of less than half a circle; and what several leave, where such arcs meet, is one arc or nothing.

    Args:
        first: What was divided out.
        arm: Of `first.chain`.
        poses: In the first joint's frame, (k, 4, 4), lengths in [m].
        found: Which of them are reached somewhere, (k,).
        goal: Makes a goal of poses, with tolerances.

    Returns:
        (k,) and (k,), NaN where nothing is reached. The first lies in [-π, π], and the turns from it up to the second.
    """
    begins = np.where(found, -np.pi, np.nan)
    ends = np.where(found, np.pi, np.nan)
    if first.whole or not found.any():
        return begins, ends
    gap = FULL - (first.upper - first.lower)
    every = np.flatnonzero(found)
    for begin in range(0, len(every), STEP):
        some = every[begin : begin + STEP]
        if arm.dof > ISOLATED:  # Answers are a sample, and a few of them serve nearly every pose all around.
            low, high = _left(first, gap, *every_answer(arm, goal(poses[some]), count=FEW))
            some = some[low < high]
            if not len(some):
                continue
        low, high = _left(first, gap, *every_answer(arm, goal(poses[some])))
        start = np.mod(high + np.pi, FULL) - np.pi
        some, start, left = some[low < high], start[low < high], (high - low)[low < high]
        begins[some], ends[some] = start, start + FULL - left
    return begins, ends


def _left(
    first: FirstJoint, gap: float, q: Array, firsts: NDArray[np.int64], counts: NDArray[np.int64]
) -> tuple[Array, Array]:
    """The arc of turns [rad] at which no answer to a pose is inside the first joint's limits, of each; none if low >= high.

    Args:
        first: What was divided out.
        gap: That the limits leave [rad].
        q: See `every_answer`.
        firsts: See `every_answer`.
        counts: See `every_answer`.
    """
    starts = first.upper - q[:, 0] if first.sign > 0 else q[:, 0] - first.lower
    low, high = starts[firsts], starts[firsts] + gap
    for k in range(1, int(counts.max())):
        has = counts > k
        start, middle = starts[firsts[has] + k], (low[has] + high[has]) / 2
        near = start + FULL * np.round((middle - (start + gap / 2)) / FULL)
        low[has], high[has] = np.maximum(low[has], near), np.minimum(high[has], near + gap)
    return low, high
