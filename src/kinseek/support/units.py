"""Warnings of numbers that are probably in another unit: degrees for radians, millimetres for metres, Hz for seconds.

No value is changed or rejected: a `UnitWarning` names the value and says how to write it in the other unit.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import UnitWarning

from .turns import TURN
from .validation import largest_of

Array = NDArray[np.float64]

TURNS_OF_A_JOINT = 4 * math.pi * 1.001
"""Limits beyond this cause a warning [rad]: the wrists with the widest range turn twice to either side."""
FAST = {"velocity": 50.0, "acceleration": 500.0}
"""Limits beyond these cause a warning [rad/s], [rad/s²]: 50 rad/s are 8 turns a second. Not examined further. Limits of jerk
are not judged: common ones, 500 to 10,000 rad/s³, could be either unit."""
FAR = 10.0
"""A goal or a body farther away than this multiple of the reach causes a warning."""
SLOW = 1.0
"""A period of control longer than this causes a warning [s]: robots are servoed at 10 to 1,000 Hz."""


def warn_of_angles(angles: Array | Sequence[float], what: str, advice: str, level: int) -> None:
    """Warn of angles beyond a full turn, which no rotation requires.

    Args:
        angles: Any number of them, [rad].
        what: Their name in the message.
        advice: What to write if they are degrees.
        level: Number of calls between here and the line to blame.
    """
    most = largest_of(angles)
    if most > TURN * (1 + 1e-9):
        warnings.warn(
            f"{what} has an angle of {most:g} rad, more than a full turn: if it is in degrees, {advice}",
            UnitWarning,
            stacklevel=level + 1,
        )


def warn_of_joints(
    names: Sequence[str], kinds: Sequence[str], lower: Array, upper: Array, where: str, advice: str
) -> None:
    """Warn of limits of revolute joints beyond two turns to one side.

    Args:
        names: Names of the joints.
        kinds: Kinds of the joints.
        lower: Lower limits, (n,), [rad] or [m].
        upper: Upper limits, (n,), [rad] or [m].
        where: The file.
        advice: How degrees are written there.
    """
    wide = [
        f"{name!r} [{low:g}, {high:g}]"
        for name, kind, low, high in zip(names, kinds, lower, upper, strict=True)
        if kind == "revolute" and max(-low, high) > TURNS_OF_A_JOINT
    ]
    if wide:
        listed = ", ".join(wide[:8]) + (f" and {len(wide) - 8} more" if len(wide) > 8 else "")
        warnings.warn(
            f"{where}: joints with limits of many turns in rad: {listed}; if these are degrees, {advice}",
            UnitWarning,
            stacklevel=2,
        )


def warn_of_rates(
    name: str, joints: Sequence[str], kinds: Sequence[str], limits: Array, where: str, level: int
) -> None:
    """Warn of limits of speed or acceleration that no joint has.

    Args:
        name: The derivative that is limited, a key of `FAST`; others are not judged.
        joints: Names of the joints.
        kinds: Kinds of the joints; prismatic ones are not judged.
        limits: Their limits, (n,), [rad/s] or [rad/s²]; NaN if unknown.
        where: The file or the call.
        level: Number of calls between here and the line to blame.
    """
    fast = [
        f"{joint!r} {limit:g}"
        for joint, kind, limit in zip(joints, kinds, limits, strict=True)
        if kind in ("revolute", "continuous") and limit > FAST.get(name, math.inf)
    ]
    if fast:
        listed = ", ".join(fast[:8]) + (f" and {len(fast) - 8} more" if len(fast) > 8 else "")
        warnings.warn(
            f"{where}: {name} limits in radians that hardly any joint has: {listed}; if these are degrees, multiply them by "
            "π/180",
            UnitWarning,
            stacklevel=level + 1,
        )


def warn_of_period(period: float, level: int) -> None:
    """Warn of a period of control that is probably a rate.

    Args:
        period: Time between two steps [s].
        level: Number of calls between here and the line to blame.
    """
    if period > SLOW:
        warnings.warn(
            f"period is {period:g} s between two steps: if it is a rate in Hz, write period=1/{period:g}",
            UnitWarning,
            stacklevel=level + 1,
        )


def warn_of_distance(
    far: float, reach: float, level: int, what: str = "the goal is", origin: str = "the base"
) -> None:
    """Warn of a goal or a body whose distance is many times the arm's reach.

    Args:
        far: The distance [m].
        reach: Upper bound on the distance of the tip from the base [m].
        level: Number of calls between here and the line to blame.
        what: What is that far away, with its verb.
        origin: Of what.
    """
    if 0.0 < FAR * reach < far:
        unit = "millimetres" if far <= 1000 * reach else "other units"
        warnings.warn(
            f"{what} {far:g} m from {origin}, and the arm reaches {reach:.3g} m at most: lengths are in metres; "
            f"if these are {unit}, divide by {'1000' if unit == 'millimetres' else 'what makes them metres'}",
            UnitWarning,
            stacklevel=level + 1,
        )
