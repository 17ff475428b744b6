"""Limits of a motion, read from the arguments or from the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem
from kinseek.printable import printable
from kinseek.robots.mechanism import RATES, Mechanism
from kinseek.support.validation import as_number

Array = NDArray[np.float64]


SMALLEST, LARGEST = 1e-9, 1e12
"""Range of limits: beyond it, squares and cubes of speeds lose their digits."""


@dataclass(frozen=True)
class Limits:
    """Limits that a motion keeps at every time."""

    velocity: Array
    """Largest speed of each joint, (n,), [rad/s] or [m/s]."""
    acceleration: Array
    """Largest acceleration of each joint, (n,), [rad/s²] or [m/s²]."""
    jerk: Array | None = None
    """Largest jerk of each joint, (n,), [rad/s³] or [m/s³]; None for no limit."""
    tool_speed: float | None = None
    """Largest speed of the tip [m/s]; None for no limit."""


def read_limits(
    arm: Mechanism,
    velocity: ArrayLike | None,
    acceleration: ArrayLike | None,
    jerk: ArrayLike | None,
    tool_speed: float | None = None,
) -> Limits:
    """Read limits; speeds and accelerations that are not given are those of the arm.

    Raises:
        InvalidProblem: A limit is not a number from `SMALLEST` to `LARGEST`, or neither is given nor known.
    """
    limits = Limits(
        _known(arm, "velocity", velocity, 2.0),
        _known(arm, "acceleration", acceleration, 10.0),
        None if jerk is None else positive(arm, "jerk", jerk, RATES["jerk"]),
        None
        if tool_speed is None
        else as_number("tool_speed", tool_speed, SMALLEST, LARGEST, InvalidProblem),
    )
    for name in RATES:
        values = getattr(limits, name)
        if values is not None and not ((values >= SMALLEST) & (values <= LARGEST)).all():
            raise InvalidProblem(
                f"{name} must be from {SMALLEST:g} to {LARGEST:g} [{RATES[name]}], got {values.min():g} to {values.max():g}"
            )
    return limits


def _known(arm: Mechanism, name: str, value: ArrayLike | None, example: float) -> Array:
    """Return a limit of every joint, (n,): the given one or that of the arm.

    Raises:
        InvalidProblem: It is not given, and the arm has none.
    """
    if value is not None:
        return positive(arm, name, value, RATES[name])
    own: Array = getattr(arm, name)
    unknown = np.flatnonzero(np.isnan(own))
    if len(unknown):
        joints = ", ".join(printable(arm.joint_names[i]) for i in unknown)
        raise InvalidProblem(
            f"{arm.name!r} has no {name} limit for {joints}: give {name}= [{RATES[name]}], for example {name}={example:g} "
            f"for every joint, or {arm.dof} numbers; or give the arm limits by with_limits({name}=...) or load(..., "
            "limits='joint_limits.yaml')"
        )
    return own


def positive(arm: Mechanism, name: str, value: ArrayLike, unit: str) -> Array:
    """Read one number for all joints or one for each, all above zero, (n,).

    Raises:
        InvalidProblem: They are not.
    """
    try:
        numbers = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (arm.dof,)))
    except (TypeError, ValueError, OverflowError):
        raise InvalidProblem(
            f"{name} must be a number or {arm.dof} of them [{unit}], got {value!r:.80}"
        ) from None
    if not (np.isfinite(numbers) & (numbers > 0)).all():
        bad = int(np.flatnonzero(~(np.isfinite(numbers) & (numbers > 0)))[0])
        raise InvalidProblem(
            f"{name} must be above 0 and finite [{unit}], got {numbers[bad]:g} for joint {arm.joint_names[bad]!r}"
        )
    return numbers
