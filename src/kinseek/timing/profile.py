"""The fastest motion along a curve: the squared speeds ``(ds/dt)²`` at the ends of its pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.kernels.timing.fastest import fastest_profile
from kinseek.robots.chain import SerialChain

from .curve import Curve
from .law import Law, constant_acceleration
from .limits import Limits
from .tip import speed_bounds

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Fraction of every limit that is kept for rounding errors."""

MOTION_PIECES = 1000
"""Pieces into which a curve is divided at least, so that a limit is nowhere kept by much more than necessary."""

MOST_PARTS = 8
"""Largest number of parts into which a piece of a curve is divided."""


def fastest(
    curve: Curve, limits: Limits, chain: SerialChain | None, tip_speeds: tuple[float, float] = (0.0, 0.0)
) -> Law:
    """Return the law of the fastest motion along a curve.

    Args:
        curve: The curve; each piece is an interval of the law.
        limits: Limits of velocity, acceleration and tool speed.
        chain: The arm up to its tip; needed for a limit of the tool speed, and for speeds at the ends.
        tip_speeds: Speeds of the tip at the start and at the end [m/s].

    Raises:
        InvalidProblem: The speed at an end cannot be kept.
    """
    count = len(curve.widths)
    tool = np.zeros((count, 2))
    if limits.tool_speed is not None and chain is not None:
        tool = speed_bounds(chain, curve)[0] / (limits.tool_speed * (1.0 - ROUNDING)) ** 2
    reachable, x = np.zeros(count + 1), np.zeros(count + 1)
    rates = _rates_of_tip(curve, chain) if any(tip_speeds) else (1.0, 1.0)
    x[0], reachable[-1] = squares = tuple((v / rate) ** 2 for v, rate in zip(tip_speeds, rates, strict=True))
    fastest_profile(
        curve.rates(1),
        curve.widths,
        limits.velocity * (1.0 - ROUNDING),
        limits.acceleration * (1.0 - ROUNDING),
        tool,
        reachable,
        x,
    )
    for name, wanted, most, rate in zip(("start", "end"), squares, (reachable[0], x[-1]), rates, strict=True):
        if wanted > most * (1.0 + ROUNDING):
            raise InvalidProblem(
                f"{name}_velocity: the tip has {math.sqrt(wanted) * rate:g} m/s there, but inside the limits at most "
                f"{math.sqrt(most) * rate:.6g} m/s"
            )
    return constant_acceleration(curve.knots, x)


def _rates_of_tip(curve: Curve, chain: SerialChain | None) -> tuple[float, float]:
    """Return ``|dp/ds|`` of the tip at both ends of a curve.

    Raises:
        InvalidProblem: The tip rests there.
    """
    assert chain is not None
    square = speed_bounds(chain, curve)[1][[0, -1]]
    if not (square > 0.0).all():
        raise InvalidProblem(
            "start_velocity and end_velocity are speeds of the tip, but it only turns in place there"
        )
    return float(np.sqrt(square[0])), float(np.sqrt(square[1]))


def parts_for(count: int, limits: Limits) -> int:
    """Return into how many parts each of `count` pieces of a curve is divided."""
    # The speed of the tip is bounded less closely than that of the joints.
    wanted = MOTION_PIECES * (1 if limits.tool_speed is None else 2)
    return min(max(-(-wanted // count), 1), MOST_PARTS)
