"""When a motion is where on its curve: the position s(t), in intervals on each of which it has a closed form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SMALL = 1e-3
"""Below this angle the first terms of a power series replace the functions of an oscillation; the next is below 1e-15."""


TINY = 1e-300
"""Prevents division by zero."""


class Moment(NamedTuple):
    """A position on a curve and its derivatives with respect to time, (k,) each."""

    s: Array
    speed: Array
    acceleration: Array
    jerk: Array


class Law(NamedTuple):
    """The position s(t) on a curve, in m intervals that begin at the positions `s`.

    On an interval the acceleration is ``u + g σ + j τ``, σ after its begin and at the time τ after it. Either g or j is 0.
    """

    s: Array
    """Positions, not decreasing, (m + 1,)."""
    times: Array
    """Times, increasing, (m + 1,), [s]; the first is 0."""
    speed: Array
    """ds/dt at the begin of each interval, (m,)."""
    acceleration: Array
    """u, (m,)."""
    gain: Array
    """g, (m,)."""
    jerk: Array
    """j, (m,)."""

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return float(self.times[-1])

    def at(self, t: Array) -> tuple[Moment, Indices]:
        """Return where the motion is at times, (k,), and the intervals of these times, (k,)."""
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.speed) - 1)
        tau, v, u, g, j = t - self.times[i], self.speed[i], self.acceleration[i], self.gain[i], self.jerk[i]
        # σ'' = u + g σ has the solution v S1(τ) + u S2(τ), with the derivatives S2' = S1 and S1' = 1 + g S2.
        first, second = _fundamental(g, tau)
        moved = v * first + u * second + j * tau**3 / 6.0
        speed = v * (1.0 + g * second) + u * first + j * tau**2 / 2.0
        end = self.s[i + 1] - self.s[i]
        moment = Moment(self.s[i] + np.clip(moved, 0.0, end), speed, u + g * moved + j * tau, g * speed + j)
        return moment, i

    def time_at(self, s: Array) -> Array:
        """Return the times at which the motion is at positions, (k,), [s]."""
        i = np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.speed) - 1)
        moved, v, u, g, j = s - self.s[i], self.speed[i], self.acceleration[i], self.gain[i], self.jerk[i]
        speed = np.sqrt(np.maximum(v**2 + 2.0 * u * moved + g * moved**2, 0.0))
        after = _durations(moved, v, speed, g)
        # Where the jerk is constant in time, the motion begins or ends at rest: σ = j τ³ / 6 from there.
        length, cube = np.diff(self.times)[i], 6.0 / np.where(j > 0.0, j, 1.0)
        left = np.maximum(self.s[i + 1] - s, 0.0)
        from_rest = np.where(v == 0.0, np.cbrt(cube * moved), length - np.cbrt(cube * left))
        after = np.clip(np.where(j > 0.0, from_rest, after), 0.0, length)
        return np.where(s >= self.s[i + 1], self.times[i + 1], self.times[i] + after)


def _durations(width: Array, v0: Array, v1: Array, g: Array) -> Array:
    """Return the durations of motions with ``σ'' = u + g σ`` over some widths, from the speed v0 to v1.

    They are ``2/ω artanh(ω h / (v0 + v1))`` for g = ω², and with the arc tangent for g = -ω².
    """
    # Where there is no speed, there is no width either.
    mean = np.where(v0 + v1 > 0.0, width / np.maximum(v0 + v1, TINY), 0.0)
    omega = np.sqrt(np.abs(g))
    angle = omega * mean
    small, w, grows = angle < SMALL, np.maximum(omega, TINY), g > 0.0
    turned = np.where(grows, np.arctanh(np.where(grows, np.minimum(angle, 1.0), 0.0)), np.arctan(angle)) / w
    series = mean * (1.0 + g * mean**2 / 3.0 + g**2 * mean**4 / 5.0)
    return np.asarray(2.0 * np.where(small, series, turned))


def _fundamental(g: Array, tau: Array) -> tuple[Array, Array]:
    """Return S1 = sinh(ωτ)/ω and S2 = (cosh(ωτ) - 1)/ω² for g = ω², and with sin and cos for g = -ω²."""
    omega = np.sqrt(np.abs(g))
    angle, grows = omega * tau, g > 0.0
    small = angle < SMALL
    w = np.where(small, 1.0, omega)
    half = np.where(small, 0.0, 0.5 * angle)
    sinh, sin = np.sinh(np.where(grows, half, 0.0)), np.sin(half)
    cosh, cos = np.cosh(np.where(grows, half, 0.0)), np.cos(half)
    # sinh x = 2 sinh(x/2) cosh(x/2), and cosh x - 1 = 2 sinh²(x/2): no digits are lost.
    first = np.where(grows, 2.0 * sinh * cosh, 2.0 * sin * cos) / w
    second = np.where(grows, 2.0 * sinh * sinh, 2.0 * sin * sin) / w**2
    square = g * tau * tau
    return (
        np.where(small, tau * (1.0 + square / 6.0 + square**2 / 120.0), first),
        np.where(small, tau**2 * (0.5 + square / 24.0 + square**2 / 720.0), second),
    )


def constant_acceleration(s: Array, x: Array) -> Law:
    """Return the law with squared speeds, (m + 1,), at the ends of intervals, (m + 1,), linear in between.

    An interval takes ``2 h / (v0 + v1)``, and its acceleration is ``(x1 - x0) / 2h``.
    """
    widths, speed = np.diff(s), np.sqrt(x)
    zero = np.zeros(len(widths))
    times = np.concatenate([[0.0], np.cumsum(2.0 * widths / (speed[:-1] + speed[1:]))])
    return Law(s, times, speed[:-1], np.diff(x) / (2.0 * widths), zero, zero)


def quadratic(s: Array, x: Array) -> Law:
    """Return the law of a motion from rest to rest whose squared speed is a quadratic spline, see `kernels.timing.smooth`.

    Args:
        s: Ends of intervals, (m + 1,).
        x: Middle Bernstein coefficients of the squared speed on each interval, (m,); for the first and the last interval its
            value at their inner ends.
    """
    h = np.diff(s)
    # At the knots the squared speed is a mean of both neighbours.
    inner = (h[2:-1] * x[1:-2] + h[1:-2] * x[2:-1]) / (h[1:-2] + h[2:-1])
    squares = np.concatenate([[0.0, x[0]], inner, [x[-1], 0.0]])
    speed, u, gain = np.sqrt(squares), np.zeros(len(h)), np.zeros(len(h))
    u[1:-1] = (x[1:-1] - squares[1:-2]) / h[1:-1]
    gain[1:-1] = (squares[2:-1] - 2.0 * x[1:-1] + squares[1:-2]) / h[1:-1] ** 2
    # On the intervals at rest the jerk is constant in time.
    jerk = np.zeros(len(h))
    jerk[[0, -1]] = 2.0 * x[[0, -1]] ** 1.5 / (9.0 * h[[0, -1]] ** 2)
    u[-1] = -2.0 * x[-1] / (3.0 * h[-1])
    durations = _durations(h, speed[:-1], speed[1:], gain)
    durations[[0, -1]] = 3.0 * h[[0, -1]] / np.sqrt(x[[0, -1]])
    return Law(s, np.concatenate([[0.0], np.cumsum(durations)]), speed[:-1], u, gain, jerk)


def rest() -> Law:
    """Return the law of a motion that ends when it begins."""
    zero = np.zeros(1)
    return Law(np.array([0.0, 1.0]), np.zeros(2), zero, zero, zero, zero)


def joined(laws: list[Law]) -> Law:
    """Return laws, each of which begins at the position where the one before ends, one after another."""
    s, times = [law.s[:-1] for law in laws] + [laws[-1].s[-1:]], [laws[0].times[:1]]
    for law in laws:
        times.append(times[-1][-1] + law.times[1:])
    rest = [np.concatenate([law[k] for law in laws]) for k in range(2, 6)]
    return Law(np.concatenate(s), np.concatenate(times), *rest)
