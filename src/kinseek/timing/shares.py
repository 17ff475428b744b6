"""Which share of each limit a motion uses: bounds that hold on every interval of its law."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain

from .bernstein import product
from .curve import Curve
from .law import Law
from .limits import Limits
from .tip import speed_bounds

Array = NDArray[np.float64]


TINY = 1e-300
"""Prevents division by zero."""


class Shares(NamedTuple):
    """Upper bounds of the shares of limits that a motion uses on each of m intervals; 1 is the limit."""

    velocity: Array
    """(m, n)"""
    acceleration: Array
    """(m, n)"""
    jerk: Array | None
    """(m, n); None without a limit."""
    tool_speed: Array | None
    """(m,); None without a limit."""


def shares_of_limits(curve: Curve, law: Law, limits: Limits, chain: SerialChain | None) -> Shares:
    """Bound the velocities, accelerations and jerks of a motion.

    With ``v = ds/dt`` and ``u = d²s/dt²``, a joint has the velocity ``q' v``, the acceleration ``q'' v² + q' u`` and the
    jerk ``q''' v³ + 3 q'' v u + q' du/dt``. On an interval v² and u are polynomials in s, so their Bernstein coefficients
    bound them.

    Args:
        curve: The curve, with one piece for each interval of the law.
        law: The motion on it.
        limits: The limits.
        chain: The arm up to its tip; needed for a limit of the tool speed.
    """
    first, second = curve.rates(1), curve.rates(2)
    squares, pulls = (values[:, None] for values in _polynomials(law))
    velocity = np.sqrt(_largest(product(product(first, first), squares)))
    acceleration = _largest(_sum(product(second, squares), product(first, pulls)))
    # Where the jerk is constant in time, v² and u are no polynomials in s: the largest values of all factors are multiplied.
    timed, square, pull = law.jerk != 0.0, squares.max(axis=2), np.abs(pulls).max(axis=2)
    acceleration[timed] = (_largest(second) * square + _largest(first) * pull)[timed]
    tool_speed = None
    if limits.tool_speed is not None and chain is not None:
        bound = product(speed_bounds(chain, curve)[0], squares[:, 0])
        tool_speed = np.sqrt(_largest(bound)) / limits.tool_speed
    return Shares(
        velocity / limits.velocity,
        acceleration / limits.acceleration,
        None if limits.jerk is None else share_of_jerk(curve, law, limits.jerk),
        tool_speed,
    )


def share_of_jerk(curve: Curve, law: Law, limit: Array) -> Array:
    """Bound the jerks of a motion as shares of their limits, (n,), on each interval of its law, (m, n)."""
    first, second, third = (curve.rates(order) for order in (1, 2, 3))
    squares, pulls = (values[:, None] for values in _polynomials(law))
    terms = _sum(product(third, squares), 3.0 * product(second, pulls))
    jerk = _with_root(np.abs(_sum(terms, law.gain[:, None, None] * first)), squares)
    # Where it is constant in time, see above.
    timed = law.jerk != 0.0
    speed, pull = np.sqrt(squares[timed].max(axis=2)), np.abs(pulls[timed]).max(axis=2)
    rate, bend, bow = (_largest(rates[timed]) for rates in (first, second, third))
    jerk[timed] = bow * speed**3 + 3.0 * bend * speed * pull + rate * np.abs(law.jerk[timed])[:, None]
    return np.asarray(jerk / limit)


def _polynomials(law: Law) -> tuple[Array, Array]:
    """Return the Bernstein coefficients of v² and u on each interval, (m, 3) and (m, 2).

    Where the jerk is constant in time, they are bounds.
    """
    h, v2, u, g = np.diff(law.s), law.speed**2, law.acceleration, law.gain
    squares = np.stack([v2, v2 + u * h, v2 + 2.0 * u * h + g * h * h], axis=1)
    pulls = np.stack([u, u + g * h], axis=1)
    tau, timed = np.diff(law.times), law.jerk != 0.0
    end = law.speed + u * tau + law.jerk * tau**2 / 2.0
    squares[timed] = np.maximum(v2, end**2)[timed, None]
    pulls[timed] = np.stack([u, u + law.jerk * tau], axis=1)[timed]
    return np.maximum(squares, 0.0), pulls


def _with_root(rates: Array, squares: Array) -> Array:
    """Bound the products of polynomials of degree 2 with the root of x, given as in `Shares` but with absolute coefficients.

    The root is at most ``2 √M / (3 - x/M)`` for any M > 0, as 1/√x lies above its tangent. The values of x at three points
    are tried as M, and the largest x.
    """
    bound: Array = rates.max(axis=2) * np.sqrt(squares.max(axis=2))
    for k in range(squares.shape[2]):
        M = np.maximum(squares[:, :, k : k + 1], TINY)
        room = 3.0 - squares / M
        roots = np.where(room > 0.0, 2.0 * np.sqrt(M) / np.where(room > 0.0, room, 1.0), np.inf)
        # A coefficient of 0 stays 0 beside an infinite root.
        terms = np.multiply(rates, roots, out=np.zeros_like(rates), where=rates > 0.0)
        bound = np.minimum(bound, terms.max(axis=2))
    return bound


def _sum(a: Array, b: Array) -> Array:
    """Return the sum of polynomials, the second of at most the degree of the first."""
    while b.shape[-1] < a.shape[-1]:
        b = product(b, np.ones(2))
    return a + b


def _largest(coefficients: Array) -> Array:
    """Return the largest absolute coefficient of each polynomial, (...)."""
    return np.asarray(np.abs(coefficients).max(axis=-1))
