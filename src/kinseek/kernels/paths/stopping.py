"""Stopping a joint within limits of its velocity, acceleration and jerk, in closed form.

A step of duration h changes the state of a joint by ``v' = v + a' h`` and ``q' = q + v' h``, with ``|a'| ≤ A`` and
``|a' - a| ≤ J h``. The joint brakes by the largest change of a that lets v and a become 0 together. In continuous time the
velocity ``v + a |a| / 2J`` is then the one that is left when a has become 0; the sign of it decides to which side to brake.

The range of joint values that braking passes in continuous time contains the range that it passes in steps, whatever the
durations of the steps are: v is decreasing in size, and a step moves by its smallest value. So a state from which braking
stays inside an interval has a next state with the same property, even if a period is missed. `test_stopping.py` tries it.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import NamedTuple

from kinseek.kernels.jit import inlined

MOST, FINE = 60, 1e-9
"""Largest number of evaluations in `follow`, and how exact the velocity is, as a fraction of a step's change by the jerk."""


class Rates(NamedTuple):
    """Limits of a joint in a step; infinite if there is none."""

    velocity: float
    """V [rad/s] or [m/s]"""
    acceleration: float
    """A [rad/s²] or [m/s²]"""
    jerk: float
    """J [rad/s³] or [m/s³]"""
    period: float
    """Duration h of the step [s]."""


class Stop(NamedTuple):
    """Displacements of a joint that brakes [rad] or [m]."""

    end: float
    """At rest."""
    lowest: float
    """The lowest on the way, at most 0."""
    highest: float
    """The highest, at least 0."""


@inlined
def stop(v: float, a: float, rates: Rates) -> Stop:
    """Return where a joint comes to rest that brakes from velocity v and acceleration a, in continuous time."""
    A, J = rates.acceleration, rates.jerk
    if inf == J:
        end = 0.0 if inf == A else v * abs(v) / (2.0 * A)
        return Stop(end, min(end, 0.0), max(end, 0.0))
    # Braking towards negative accelerations; the other case is its mirror image.
    sign = 1.0 if v + a * abs(a) / (2.0 * J) >= 0.0 else -1.0
    v, a = sign * v, sign * a
    # The acceleration sinks from a to -b and rises to 0: (a² - b²) / 2J - b² / 2J = -v. At -A it stays for a while.
    b2 = max(J * v + 0.5 * a * a, 0.0)
    b, hold = sqrt(b2), 0.0
    if b > A:
        b, hold = A, (b2 - A * A) / (J * A)
    sink = (a + b) / J
    v_then = v + (a * a - b * b) / (2.0 * J)
    end = sink * (v + sink * (a / 2.0 - J * sink / 6.0))
    end += hold * (v_then - b * hold / 2.0) + b * b * b / (6.0 * J * J)
    lowest = 0.0
    if v < 0.0:  # It moves back until the velocity is 0.
        t = (a - sqrt(max(a * a + 2.0 * J * v, 0.0))) / J
        lowest = min(t * (v + t * (a / 2.0 - J * t / 6.0)), 0.0)
    highest = max(end, 0.0)
    if sign < 0.0:
        return Stop(-end, -highest, -lowest)
    return Stop(end, lowest, highest)


@inlined
def change(left: float, rates: Rates) -> float:
    """Return the change of velocity in a step that leaves ``left`` for it and the fading of the acceleration together.

    ``x h + x |x| / 2J = left`` for the new acceleration x, from acceleration 0 on; the result is x h.
    """
    J, h = rates.jerk, rates.period
    if inf == J:
        return left
    step = 2.0 * J * h * abs(left) / (J * h + sqrt(J * J * h * h + 2.0 * J * abs(left)))
    return step if left > 0.0 else -step


@inlined
def velocities(v: float, a: float, rates: Rates) -> tuple[float, float]:
    """Return the smallest and the largest velocity of the next step that keep the limits, now and later.

    The velocity must not exceed V while the acceleration fades: ``v' + a'² / 2J ≤ V``.
    """
    V, A, J, h = rates
    low, high = -V, V
    if inf > V:
        low, high = v - change(max(V + v, 0.0), rates), v + change(max(V - v, 0.0), rates)
    if inf > A:
        low, high = max(low, v - A * h), min(high, v + A * h)
    if inf > J:
        low, high = max(low, v + (a - J * h) * h), min(high, v + (a + J * h) * h)
    # Rounding may exchange ends that are equal.
    return min(low, high), max(low, high)


@inlined
def follow(gap: float, v: float, low: float, high: float, rates: Rates) -> float:
    """Return the next velocity, from `low` to `high`, from which a joint that brakes comes to rest at a place.

    Args:
        gap: Where the place is [rad] or [m].
        v: Present velocity, of which the next acceleration is counted.
        low: See `velocities`.
        high: See `velocities`.
        rates: Limits.
    """
    A, J, h = rates.acceleration, rates.jerk, rates.period
    if inf == J:
        if inf == A:
            return min(max(gap / h, low), high)
        # x h + x² / 2A = gap
        x = 2.0 * A * abs(gap) / (A * h + sqrt(A * A * h * h + 2.0 * A * abs(gap)))
        return min(max(x if gap > 0.0 else -x, low), high)
    # The place of rest increases with the velocity: regula falsi, with a bisection in every third step (Illinois).
    below = h * low + stop(low, (low - v) / h, rates).end - gap
    above = h * high + stop(high, (high - v) / h, rates).end - gap
    if below >= 0.0:
        return low
    if above <= 0.0:
        return high
    side = 0
    for k in range(MOST):
        if high - low <= FINE * J * h * h:
            break
        x = 0.5 * (low + high) if k % 3 == 2 else (low * above - high * below) / (above - below)
        off = h * x + stop(x, (x - v) / h, rates).end - gap
        if off < 0.0:
            low, below = x, off
            above *= 0.5 if side < 0 else 1.0
            side = -1
        else:
            high, above = x, off
            below *= 0.5 if side > 0 else 1.0
            side = 1
    return 0.5 * (low + high)
