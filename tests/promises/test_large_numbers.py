"""Whole numbers that no float can hold, wherever a number is asked for: a KinseekError, as for infinity."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Goal

LARGE: Any = 10**400
ARM = kinseek.load("ur5e")
T = ARM.fk(np.zeros(6))

CALLS: dict[str, Callable[[], Any]] = {
    "a pose": lambda: ARM.ik([[LARGE] * 4] * 4),
    "near": lambda: ARM.ik(T, near=[LARGE] * 6),
    "fk": lambda: ARM.fk([LARGE] * 6),
    "a tolerance": lambda: Goal.pose(T, position_tolerance=LARGE),
    "a weight": lambda: Goal.pose(T, orientation_weight=LARGE),
    "a place": lambda: Goal.position([LARGE, 0, 0]),
    "a direction": lambda: Goal.pointing([0, 0, 0], [LARGE, 0, 0]),
    "a range": lambda: Goal.pose(T, box={"x": (0, LARGE)}),
    "quaternion": lambda: kinseek.pose([0, 0, 0], quat_wxyz=[LARGE, 0, 0, 0]),
    "a direction of a pose": lambda: kinseek.pose([0, 0, 0], z_axis=[0, 0, LARGE], x_axis=[1, 0, 0]),
    "a step of poses": lambda: kinseek.interpolate([T], step=LARGE, turn=1.0),
    "a blend": lambda: kinseek.interpolate([T], step=1.0, turn=1.0, blend=LARGE),
    "DH": lambda: kinseek.Arm.from_dh([[0, 0, 0, LARGE]], [-1], [1]),
    "limits": lambda: kinseek.Arm.from_dh([[0, 0, 0, 0]], [-1], [LARGE]),
    "a step": lambda: ARM.follow([T], max_step=LARGE),
    "times": lambda: ARM.follow([T], times=[LARGE]),
    "a period": lambda: ARM.track(np.zeros(6), period=LARGE),
    "a speed": lambda: ARM.track(np.zeros(6), period=0.1, velocity=LARGE),
    "a gap": lambda: ARM.prove(T, gap=LARGE),
    "a distance": lambda: kinseek.SeparateChains(again=LARGE),
}


@pytest.mark.parametrize("what", CALLS)
def test_a_number_that_no_float_holds_is_refused(what: str) -> None:
    with pytest.raises(kinseek.KinseekError):
        CALLS[what]()


def test_a_time_limit_may_be_as_long_as_one_likes() -> None:
    assert ARM.ik(T, time_limit=LARGE).success
