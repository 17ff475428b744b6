"""The first joint divided out: a pose turned about the first axis is reached by the same joint values but for the first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import BranchesBatch
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.robots import SerialChain
from kinseek.transforms import square

Array = NDArray[np.float64]

FULL = 2 * np.pi


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
    some = np.flatnonzero(found)
    answers = cast(BranchesBatch, arm.branches(goal(poses[some]), threads=1))
    single = arm.ik(goal(poses[some]), threads=1).q[:, 0]
    for i, number in enumerate(some):
        every = answers[i].q[:, 0] if len(answers[i]) else single[i : i + 1]
        low, high = _left(first, every, gap)
        if low < high:
            start = np.mod(high + np.pi, FULL) - np.pi
            begins[number], ends[number] = start, start + FULL - (high - low)
    return begins, ends


def _left(first: FirstJoint, q: Array, gap: float) -> tuple[float, float]:
    """The arc of turns [rad] at which no answer with such a first joint, (m,), is inside the limits; none if low >= high."""
    starts = first.upper - q if first.sign > 0 else q - first.lower
    low, high = float(starts[0]), float(starts[0]) + gap
    for start in starts[1:]:
        near = start + FULL * np.round(((low + high) / 2 - (start + gap / 2)) / FULL)
        low, high = max(low, near), min(high, near + gap)
        if low >= high:
            break
    return low, high
