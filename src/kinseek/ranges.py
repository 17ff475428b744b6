"""Free axes of a goal, and ranges of accepted deviations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from .errors import InvalidGoal, suggest
from .kernels.arm.pose_error import LARGEST
from .kinds import POSE, Kind
from .support.validation import as_number

Ranges = tuple[tuple[float, float], ...]
"""Lower and upper ends for x, y, z [m] and rx, ry, rz [rad]."""

AXES = ("x", "y", "z", "rx", "ry", "rz")
FRAMES = ("tool", "base")
_TURNS = {"roll": "rx", "pitch": "ry", "yaw": "rz"}

FREE_PLACE, FREE_TURN = (-math.inf, math.inf), (-math.pi, math.pi)
PINNED = (0.0, 0.0)


def read_ranges(
    free: str | Iterable[str], box: Mapping[str, Sequence[float]] | None, kind: Kind = POSE
) -> Ranges | None:
    """Read free axes and a tolerance box.

    Args:
        free: Name or names among `AXES`.
        box: Lower and upper end of the accepted deviation of some axes, [m] or [rad].
        kind: Kind of the goal; for any kind but a pose only x, y and z are valid axes.

    Returns:
        The ranges of all six axes, or None if neither is given.

    Raises:
        InvalidGoal: Unknown axes, an axis that is both free and boxed, an invalid range, or nothing left to reach.
    """
    try:
        names = [free] if isinstance(free, str) else list(free)
    except TypeError:
        raise InvalidGoal(f"free must be the name of an axis or several of them, got {free!r}") from None
    if box is not None and not isinstance(box, Mapping):
        raise InvalidGoal(f"box must map axes to ranges, such as {{'x': (-0.01, 0.01)}}, got {box!r}")
    given = dict(box or {})
    if not names and not given:
        return None
    for name in [*names, *given]:
        if name not in AXES:
            if name in _TURNS:
                raise InvalidGoal(
                    f"unknown axis {name!r}: kinseek calls it {_TURNS[name]!r}. Valid: {', '.join(AXES)}"
                )
            raise InvalidGoal(suggest(str(name), AXES, "axis"))
        if kind.columns < POSE.columns and name.startswith("r"):
            raise InvalidGoal(
                f"a {kind.name} goal already defines its orientation, so {name!r} can be neither free nor boxed; "
                "valid: x, y, z"
            )
    if both := sorted(set(names) & set(given)):
        raise InvalidGoal(f"{' and '.join(both)} cannot be both free and boxed: leave one of the two out")
    turns = PINNED if kind.columns else FREE_TURN
    ranges = [PINNED] * 3 + [turns] * 3
    for i, axis in enumerate(AXES):
        if axis in names:
            ranges[i] = FREE_TURN if axis.startswith("r") else FREE_PLACE
        elif axis in given:
            ranges[i] = _range(axis, given[axis])
    if all(pair in (FREE_PLACE, FREE_TURN) for pair in ranges) and not kind.turned:
        raise InvalidGoal(
            "every axis is free, so nothing is constrained. Leave at least one axis out of free="
        )
    least = math.sqrt(sum(max(low, 0.0, -high) ** 2 for low, high in ranges[3:]))
    if least > math.pi:
        raise InvalidGoal(
            f"no rotation lies in this box: a rotation vector is at most π long, and the shortest in the ranges of "
            f"rx, ry and rz is {least:.4g} rad long"
        )
    return tuple(ranges)


def check_ranges(ranges: object) -> Ranges:
    """Validate the six ranges of a goal whose fields were given directly.

    Raises:
        InvalidGoal: Not six pairs, or a pair that is not a range.
    """
    try:
        return _checked(ranges)
    except TypeError:  # It cannot be a key of the cache.
        return _checked.__wrapped__(ranges)


@lru_cache(maxsize=256)
def _checked(ranges: object) -> Ranges:
    try:
        table = np.array(ranges, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        table = np.zeros(0)
    if table.shape != (6, 2):
        raise InvalidGoal(f"ranges must be six pairs, of {', '.join(AXES)}, got {ranges!r}")
    read_ranges((), {axis: tuple(pair) for axis, pair in zip(AXES, table.tolist(), strict=True)})
    return tuple((float(low), float(high)) for low, high in table)


def check_cone(cone: object, one_axis: bool) -> float:
    """Validate the angle of a cone about the only free axis of rotation.

    Args:
        cone: The largest accepted angle [rad]; 0 for no cone.
        one_axis: Whether one rotation axis is free, and the other two have no range.

    Raises:
        InvalidGoal: Not an angle in [0, π], or a cone about no axis or about several.
    """
    angle = as_number("cone, an angle in rad,", cone, 0.0, math.pi, InvalidGoal)
    if angle and not one_axis:
        raise InvalidGoal(
            f"a cone of {angle:.6g} rad is about one axis of the tool: leave exactly that rotation free, as in "
            "free='rz' or --free rz, and give no range about the other two"
        )
    return angle


def free_turns(ranges: Ranges) -> list[int]:
    """Return which of rx, ry and rz are free, as 0, 1 and 2."""
    return [i for i, pair in enumerate(ranges[3:]) if pair == FREE_TURN]


def unit(axis: int) -> tuple[float, float, float]:
    """Return the unit vector along axis 0, 1 or 2."""
    return (float(axis == 0), float(axis == 1), float(axis == 2))


def _range(axis: str, pair: object) -> tuple[float, float]:
    try:
        low, high = (float(end) for end in pair)  # type: ignore[attr-defined]
    except (TypeError, ValueError, OverflowError):
        raise InvalidGoal(f"box[{axis!r}] must be a pair (lower, upper), got {pair!r}") from None
    if math.isnan(low) or math.isnan(high) or low > high or low == math.inf or high == -math.inf:
        raise InvalidGoal(f"box[{axis!r}] must have lower <= upper, got ({low}, {high})")
    for end in (low, high):
        if math.isfinite(end) and abs(end) > LARGEST:
            raise InvalidGoal(
                f"box[{axis!r}] must end within {LARGEST:g} m, or not at all, at infinity; got ({low:g}, {high:g}): farther "
                f"off, rounding of positions comes close to 1e-6 m"
            )
    if axis.startswith("r") and (low < -math.pi or high > math.pi):
        raise InvalidGoal(
            f"box[{axis!r}] must lie within [-π, π] rad, got ({low:.6g}, {high:.6g}): no component of a rotation vector "
            f"is larger; to allow every rotation, write free={axis!r}"
        )
    return low, high
