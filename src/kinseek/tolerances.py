"""How exactly a goal is to be reached, and how position and orientation are weighed against each other."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Real
from typing import Any, TypedDict

from .errors import InvalidGoal
from .kernels.arm.pose_error import HEAVIEST, LARGEST, LIGHTEST

DEFAULT_TOLERANCE = 1e-6
"""[m] and [rad]"""
DEFAULT_WEIGHT = 1.0

TOLERANCES = {"position_tolerance": " m", "orientation_tolerance": " rad"}
"""And their units."""
WEIGHTS = ("position_weight", "orientation_weight")


class GoalOptions(TypedDict, total=False):
    """The fields of a `Goal` that say how exactly, of what tool, and how position and orientation are weighed."""

    position_tolerance: float
    orientation_tolerance: float
    position_weight: float
    orientation_weight: float
    tool: Any
    base: Any


def check_tolerance(name: str, value: float) -> None:
    """Refuse what is no tolerance.

    Raises:
        InvalidGoal: Negative, not finite, or so large that it says nothing.
    """
    if type(value) is float and 0.0 <= value <= LARGEST:
        return
    if not (isinstance(value, Real) and 0 <= value < math.inf):
        raise InvalidGoal(f"{name} must be a finite number >= 0, got {value!r}")
    if value > LARGEST:
        raise InvalidGoal(
            f"{name} must be at most {LARGEST:g}, got {value!r}: nothing that is reached lies that far off. Where "
            f"the position or the orientation does not matter, Goal.pose(..., free=...) or Goal.position say so"
        )


def check_weight(name: str, value: float) -> None:
    """Refuse what is no weight.

    Raises:
        InvalidGoal: Not positive, not finite, or too small or too large to compute with.
    """
    if type(value) is float and LIGHTEST <= value <= HEAVIEST:
        return
    if not (isinstance(value, Real) and 0 < value < math.inf):
        raise InvalidGoal(f"{name} must be a finite number > 0, got {value!r}")
    if not LIGHTEST <= value <= HEAVIEST:
        raise InvalidGoal(
            f"{name} must lie between {LIGHTEST:g} and {HEAVIEST:g}, got {value!r}: searches multiply weighted "
            f"errors, and beyond that doubles end"
        )


def said(values: Mapping[str, float]) -> list[str]:
    """Of tolerances and weights by name, those that are not the default, as text."""
    usual = {**dict.fromkeys(TOLERANCES, DEFAULT_TOLERANCE), **dict.fromkeys(WEIGHTS, DEFAULT_WEIGHT)}
    return [
        f"{name}={value:g}{TOLERANCES.get(name, '')}"
        for name, value in values.items()
        if value != usual[name]
    ]
