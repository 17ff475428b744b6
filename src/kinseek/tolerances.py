"""Tolerances of a goal, and weights of position against orientation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any, TypedDict

from .errors import InvalidGoal
from .kernels.arm.pose_error import HEAVIEST, LARGEST, LIGHTEST

DEFAULT_TOLERANCE = 1e-6
"""Default tolerance, [m] and [rad]."""
DEFAULT_WEIGHT = 1.0

TOLERANCES = {"position_tolerance": " m", "orientation_tolerance": " rad"}
"""Names of the tolerances, and their units."""
WEIGHTS = ("position_weight", "orientation_weight")


class GoalOptions(TypedDict, total=False):
    """The fields of a `Goal` for tolerances, weights, tool and base."""

    position_tolerance: float
    orientation_tolerance: float
    position_weight: float
    orientation_weight: float
    tool: Any
    base: Any


def check_tolerance(name: str, value: float) -> None:
    """Validate a tolerance.

    Raises:
        InvalidGoal: Negative, not finite, or too large to be a tolerance.
    """
    if type(value) is float and 0.0 <= value <= LARGEST:
        return
    if not (isinstance(value, Real) and 0 <= value < math.inf):
        raise InvalidGoal(f"{name} must be a finite number >= 0, got {value!r}")
    if value > LARGEST:
        raise InvalidGoal(
            f"{name} must be at most {LARGEST:g}, got {value!r}: no reachable pose is that far away. If the position "
            "or the orientation does not matter, use Goal.pose(..., free=...) or Goal.position"
        )


def check_weight(name: str, value: float) -> None:
    """Validate a weight.

    Raises:
        InvalidGoal: Not positive, not finite, or too small or too large to compute with.
    """
    if type(value) is float and LIGHTEST <= value <= HEAVIEST:
        return
    if not (isinstance(value, Real) and 0 < value < math.inf):
        raise InvalidGoal(f"{name} must be a finite number > 0, got {value!r}")
    if not LIGHTEST <= value <= HEAVIEST:
        raise InvalidGoal(
            f"{name} must lie between {LIGHTEST:g} and {HEAVIEST:g}, got {value!r}: products of weighted errors would "
            "overflow beyond that"
        )


def said(values: Mapping[str, float]) -> list[str]:
    """Format those of some tolerances and weights, by name, that are not the default."""
    usual = {**dict.fromkeys(TOLERANCES, DEFAULT_TOLERANCE), **dict.fromkeys(WEIGHTS, DEFAULT_WEIGHT)}
    return [
        f"{name}={value:g}{TOLERANCES.get(name, '')}"
        for name, value in values.items()
        if value != usual[name]
    ]
