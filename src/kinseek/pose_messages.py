"""Poses of ROS messages, recognised by their fields: no ROS installation is required, and similar objects are read as well.

A quaternion in a message has named numbers, so its order is never ambiguous. The frame of a stamped message is its sender's
matter: it is not compared with the base of an arm.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidGoal
from .support.transforms import from_quaternion, transform

Array = NDArray[np.float64]

_NESTED = ("pose", "transform")
"""Fields in which stamped messages, and those with a covariance, hold the message proper."""
_DEEPEST = 2
"""A PoseWithCovarianceStamped has a pose that has a pose."""
_PLACE, _TURN = ("x", "y", "z"), ("w", "x", "y", "z")


def is_message(value: Any) -> bool:
    """Return whether an object has the fields of a Pose, a Transform, or a message that holds one of these."""
    return _parts(value) is not None


def matrix_of_message(message: Any) -> Array | None:
    """Read the pose of a message, (4, 4), [m]; None if an object is not a message with a pose.

    A quaternion need not be of unit length. For one that is zero or not finite the rotation is zero or NaN, so that the
    matrix is rejected where matrices are checked, or skipped where invalid ones are.

    Raises:
        InvalidGoal: A field is not a number.
    """
    if (parts := _parts(message)) is None:
        return None
    place, wxyz = _numbers(parts[0], _PLACE), _numbers(parts[1], _TURN)
    if not np.isfinite(wxyz).all():
        return transform(np.full((3, 3), np.nan), place)
    return transform(from_quaternion(wxyz) if np.abs(wxyz).max() > 0.0 else np.zeros((3, 3)), place)


def _parts(value: Any) -> tuple[Any, Any] | None:
    """Return the objects with the fields x, y, z and x, y, z, w; None if an object is not a message."""
    for _ in range(_DEEPEST + 1):
        for place, turn in (("position", "orientation"), ("translation", "rotation")):
            parts = getattr(value, place, None), getattr(value, turn, None)
            if _has(parts[0], _PLACE) and _has(parts[1], _TURN):
                return parts
        value = next((getattr(value, name) for name in _NESTED if hasattr(value, name)), None)
    return None


def _has(value: Any, names: tuple[str, ...]) -> bool:
    return all(hasattr(value, name) for name in names)


def _numbers(fields: Any, names: tuple[str, ...]) -> Array:
    numbers = []
    for name in names:
        value = getattr(fields, name)
        try:
            numbers.append(float(value))
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidGoal(f"{name} of a message must be a number, got {value!r:.80}: {error}") from None
    return np.array(numbers)
