"""The fastest motion along a curve: the squared speeds ``(ds/dt)²`` at the ends of its pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InternalError, InvalidProblem
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.timing.fastest import fastest_profile
from kinseek.kernels.timing.smooth import smooth_profile
from kinseek.robots.chain import SerialChain

from .curve import Curve
from .law import Law, constant_acceleration, quadratic
from .limits import Limits
from .shares import share_of_jerk
from .tip import speed_bounds

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""Fraction of every limit that is kept for rounding errors."""

MOTION_PIECES = 1000
"""Pieces into which a curve is divided at least, so that a limit is nowhere kept by much more than necessary."""

SMOOTH_PIECES = 200
"""The same with limits of jerk."""

RUN_PIECES = 32
"""Pieces from stop to stop at least."""

MOST_PARTS = 64
"""Largest number of parts into which a piece of a curve is divided, if `RUN_PIECES` do not demand more."""

SHORTER, CUTS = 0.7, 16
"""With limits of jerk, the first and the last interval are divided into this many more, each shorter by this factor towards
rest."""

GAP = 0.01
"""Share by which a motion with limits of jerk may be longer than the best one that the search tends to."""

GUESS = 1e-4
"""Smallest squared speed of a first guess, relative to the largest."""


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
        InvalidProblem: The speed at an end cannot be kept, or is not 0 though jerks are limited.
    """
    if limits.jerk is not None and any(tip_speeds):
        raise InvalidProblem(
            "with limits of jerk a motion begins and ends at rest: start_velocity and end_velocity must be 0"
        )
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
    law = constant_acceleration(curve.knots, x)
    return law if limits.jerk is None else smooth(curve, limits, tool, law)


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


def smooth(curve: Curve, limits: Limits, tool: Array, first: Law) -> Law:
    """Return the law of a motion from rest to rest along a curve that keeps limits of jerk too.

    Args:
        curve: The curve, of at least 3 pieces; each piece is an interval of the law.
        limits: The limits, with jerks.
        tool: See `smooth_profile`, (m, 2).
        first: The fastest motion without limits of jerk.
    """
    assert limits.jerk is not None
    widths, squares = curve.widths, first.speed**2
    guess = np.minimum(squares, np.append(squares[1:], 0.0)) + GUESS * squares.max()
    report = np.zeros(2)
    allowed = np.stack([limits.velocity, limits.acceleration, limits.jerk]) * (1.0 - ROUNDING)
    smooth_profile(curve.slopes, widths, allowed, tool, GAP, LANES, guess, report)
    if not report[0]:
        raise InternalError("no motion was found inside the limits, though every slow motion is possible")
    law = quadratic(curve.knots, guess)
    # The bound of the jerk is less close here than in the kernel. It grows with the power 3/2 of the squared speed.
    over = float(share_of_jerk(curve, law, limits.jerk).max()) / (1.0 - ROUNDING)
    return law if over <= 1.0 else quadratic(curve.knots, guess * over ** (-2.0 / 3.0))


def in_intervals(curve: Curve, total: int, limits: Limits) -> Curve:
    """Return a curve from stop to stop, divided into the intervals of a law, of `total` pieces of a motion."""
    pieces = len(curve.widths)
    wanted = MOTION_PIECES if limits.jerk is None else SMOOTH_PIECES
    parts = max(min(-(-wanted // total), MOST_PARTS), -(-RUN_PIECES // pieces))
    curve = curve.divided(parts)
    if limits.jerk is None:
        return curve
    # Near rest the squared speed grows with a power of the distance: the intervals become shorter towards both ends.
    near = SHORTER ** np.arange(CUTS, 0, -1)
    first, last = curve.knots[0], curve.knots[-1]
    begin, end = first + near * curve.widths[0], last - near[::-1] * curve.widths[-1]
    return curve.cut(np.concatenate([begin, end]))
