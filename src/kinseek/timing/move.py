"""The fastest motion from point to point, from rest to rest, by Ruckig (*Berscheid & Kröger 2021*).

Each joint has a profile of up to seven phases of constant jerk, or of constant acceleration without a limit of the jerk. The
slowest joint determines the duration; the profiles of the others are stretched to it. So the joint values are
cubic polynomials of time between the changes of phase of all joints: a `Curve` whose parameter is the time.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InternalError, InvalidProblem, MissingExtra
from kinseek.goal import Goal
from kinseek.problem import as_joints
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN, nearest_turns

from . import bernstein
from . import curve as curves
from . import law as laws
from .curve import Curve, deviation
from .limits import Limits
from .obstacles import Obstacles
from .trajectory import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

RESERVE = 1e-6
"""Fraction of every limit that is kept for rounding errors: phases shorter than some microseconds are merged with others, so
that their differences of speeds are not lost in rounding errors."""

TIE = 1e-6
"""Weight of the mean duration of all joints when motions are compared: it decides between motions of equal duration."""

PIECES = 100
"""Pieces into which a motion is divided at least, in which `Trajectory.bottleneck` looks for the limit that is reached."""

MORE = (0.0, 1e-8, -1e-8, 1e-7, -1e-7)
"""Changes of the limit of the acceleration, as fractions, for which Ruckig is called until it succeeds."""

MOST_HALVINGS = 7
"""How often a piece of a motion is halved before it counts as not free. Not examined further."""

OUTSIDE = 1e-9
"""Joint values that are outside the limits by less than this are moved onto them [rad] or [m]."""


class Move(NamedTuple):
    """A motion from joint values to others, or to one of several."""

    arm: Mechanism
    begin: Array
    """Joint values at the begin, (n,), [rad] or [m]."""
    limits: Limits
    scene: Obstacles | None = None
    clearance: float = 0.0
    """Minimum distance of bodies in the scene [m]."""
    tool: Array | None = None
    """Pose of the tool at the tip, (4, 4)."""

    def cost(self, ends: Array) -> Array:
        """Return what orders motions to ends, (k, n): their durations, and a little of those of all joints, (k,) [s].

        Continuous joints turn to the nearer side.
        """
        return _costs(self.nearest(ends) - self.begin, self.limits)

    def nearest(self, ends: Array) -> Array:
        """Return ends, (k, n), with the full turns of continuous joints that are nearest to the begin."""
        return np.where(self.arm.endless, ends + nearest_turns(self.begin - ends), ends)

    def both_ways(self, ends: Array) -> Array:
        """Return ends, (k, n), that continuous joints reach by turning to either side, (K, n)."""
        ends = self.nearest(ends)
        for joint in np.flatnonzero(self.arm.endless):
            other = ends.copy()
            other[:, joint] += np.where(ends[:, joint] < self.begin[joint], TURN, -TURN)
            ends = np.concatenate([ends, other])
        return ends


def are_joints(goal: Any) -> bool:
    """Return whether a goal is joint values, (n,) or by name, and not a pose."""
    if isinstance(goal, Mapping) or (hasattr(goal, "name") and hasattr(goal, "position")):
        return True
    try:
        return np.ndim(goal) == 1
    except ValueError:  # A list of lists of unequal lengths.
        return False


def read_end(arm: Mechanism, goal: Any) -> Array | Goal:
    """Read where a motion ends: joint values inside the limits, (n,), or one goal.

    Raises:
        InvalidProblem: Joint values that are not n numbers inside the limits, or several goals.
        InvalidGoal: Not a pose.
    """
    if are_joints(goal):
        return inside_limits(arm, goal, "goal")
    requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
    if requested.shape:
        raise InvalidProblem(f"goal must be one goal, got a batch of shape {requested.shape}")
    return requested


def inside_limits(arm: Mechanism, q: Any, name: str) -> Array:
    """Read joint values inside the limits, (n,), [rad] or [m].

    Raises:
        InvalidProblem: Not n numbers, or outside the limits.
    """
    values = as_joints(arm, q, name)
    if values.ndim != 1:
        raise InvalidProblem(
            f"{name} must have shape ({arm.dof},), got {values.shape}: a motion has one begin and one end"
        )
    lower, upper = np.where(arm.endless, -np.inf, arm.lower), np.where(arm.endless, np.inf, arm.upper)
    outside = np.flatnonzero((values < lower - OUTSIDE) | (values > upper + OUTSIDE))
    if len(outside):
        i = outside[0]
        raise InvalidProblem(
            f"{name} must be inside the limits of the joints, got {values[i]:.9g} for joint {arm.joint_names[i]!r} with the "
            f"limits {lower[i]:.9g} to {upper[i]:.9g}"
        )
    return np.clip(values, lower, upper)


def least_durations(distances: Array, limits: Limits) -> Array:
    """Return the least duration of each joint for its distance from rest to rest, (..., n), [s].

    The limits are reached in trapezoidal or double S profiles (*Biagiotti & Melchiorri 2008, sections 3.2 and 3.4*).
    """
    d, v, a, j = np.abs(distances), limits.velocity, limits.acceleration, limits.jerk
    if j is None:
        return np.where(d >= v**2 / a, d / v + v / a, 2.0 * np.sqrt(d / a))
    # Time from rest to the full speed; the acceleration grows up to its limit if there is enough time.
    rise = np.where(v * j >= a**2, v / a + a / j, 2.0 * np.sqrt(v / j))
    ramp = a / j
    slow = np.where(d >= 2.0 * a * ramp**2, ramp + np.sqrt(ramp**2 + 4.0 * d / a), np.cbrt(32.0 * d / j))
    return np.where(d >= v * rise, d / v + rise, slow)


def _costs(ways: Array, limits: Limits) -> Array:
    """Return the costs of motions by some distances, (k, n), as `Move.cost`, (k,) [s]."""
    durations = least_durations(ways, limits)
    return np.asarray(durations.max(axis=1) + TIE * durations.mean(axis=1))


def fastest_free(move: Move, ends: Array, deadline: Deadline) -> Trajectory:
    """Return the fastest motion to one of some ends, (k, n), that is proved free of collision.

    Raises:
        MissingExtra: Ruckig is not installed.
        InvalidProblem: No motion to any of the ends is proved free, or none in time.
    """
    order = np.argsort(_costs(ends - move.begin, move.limits), kind="stable")
    if move.scene is None:
        return point_to_point(move, ends[order[0]])
    if hits := move.scene.hits(move.begin, move.clearance):
        raise InvalidProblem(f"the motion begins in collision, so none is free: {hits[0]}")
    for tried, end in enumerate(ends[order]):
        if tried and deadline.passed:
            break
        trajectory = point_to_point(move, end)
        if _is_free(trajectory._curve, move.scene, move.clearance):
            return trajectory
    else:
        tried = len(ends)
    late = f"; {len(ends) - tried} more were not tried within the time limit" if tried < len(ends) else ""
    raise InvalidProblem(
        f"{move.arm.name!r}: none of {tried} motions to the goal is proved free of collision{late}. Choose points between "
        "them, and move from one to the next"
    )


def _is_free(curve: Curve, scene: Obstacles, clearance: float) -> bool:
    """Return whether a motion is proved free of collision; pieces for which the proof fails are halved."""
    pieces = curve.coefficients
    for _ in range(MOST_HALVINGS + 1):
        ends = pieces[..., 3]
        if not np.all(scene.free(ends, clearance)):
            return False
        free = np.asarray(
            scene.free_motion(pieces[..., 0], ends, clearance, deviation(pieces)), dtype=np.bool_
        )
        if free.all():
            return True
        pieces = bernstein.subdivided(pieces[~free], 2)
    return False


def point_to_point(move: Move, end: Array) -> Trajectory:
    """Return the fastest motion from rest to rest, see the top of this file.

    Raises:
        MissingExtra: Ruckig is not installed.
    """
    if (end == move.begin).all():
        curve, law = curves.rest(move.begin), laws.rest()
    else:
        curve = _by_ruckig(move.begin, end, move.limits)
        one, zero = np.ones(len(curve.widths)), np.zeros(len(curve.widths))
        law = laws.Law(curve.knots, curve.knots, one, zero, zero, zero)
    stops = np.zeros(0, dtype=np.int64)
    return Trajectory(move.arm, move.limits, stops, move.tool, curve, law, curve.knots[[0, -1]])


def _by_ruckig(begin: Array, end: Array, limits: Limits) -> Curve:
    """Return the curve of the fastest motion between different joint values, (n,), with the time as its parameter.

    Raises:
        MissingExtra: Ruckig is not installed.
        InternalError: Ruckig finds no motion.
    """
    moving = np.flatnonzero(begin != end)
    way, own = (end - begin)[moving], _kept(limits, moving)
    durations = least_durations(way, own)
    profiles = _profiles(np.abs(way), durations, own)
    # `MORE` and rounding errors may make a duration a little longer.
    duration = float(max(durations * [profile.duration for profile in profiles]))
    knots = _knots(profiles, np.abs(way), duration, own)
    states = np.zeros((3, len(knots), len(begin)))
    states[:, :, moving] = way * np.stack([profile.at(knots) for profile in profiles], axis=-1)
    q, v, a = states
    h = np.diff(knots)[:, None]
    if limits.jerk is None:  # The acceleration jumps at knots.
        slopes = np.stack([v[:-1], 0.5 * (v[:-1] + v[1:]), v[1:]], axis=-1)
    else:
        slopes = np.stack([v[:-1], v[:-1] + 0.5 * h * a[:-1], v[:-1] + 0.5 * h * (a[:-1] + a[1:])], axis=-1)
    return Curve(knots * duration, begin + q[:-1], slopes / duration)


def _kept(limits: Limits, joints: Indices) -> Limits:
    """Return the limits of some joints, less the reserve."""
    jerk = None if limits.jerk is None else (1.0 - RESERVE) * limits.jerk[joints]
    return Limits(
        (1.0 - RESERVE) * limits.velocity[joints], (1.0 - RESERVE) * limits.acceleration[joints], jerk
    )


class _Profile(NamedTuple):
    """The motion of a joint by the distance 1 in the time 1: phases of constant jerk, or of constant acceleration."""

    duration: float
    """The time that it takes with the given limits, 1 up to rounding errors."""
    begins: Array
    """Begins of the phases, (7,)."""
    q: Array
    """Distance moved at these times, (7,)."""
    velocity: Array
    """(7,)"""
    acceleration: Array
    """After these times, (7,)."""
    jerk: Array
    """(7,)"""

    def at(self, t: Array) -> Array:
        """Return distance moved, velocity and acceleration at times from 0 to 1, (3, k)."""
        i = np.searchsorted(self.begins, t, side="right") - 1
        tau, v, a, j = t - self.begins[i], self.velocity[i], self.acceleration[i], self.jerk[i]
        moved = self.q[i] + tau * (v + tau * (a / 2.0 + tau * j / 6.0))
        state = np.stack([moved, v + tau * (a + tau * j / 2.0), a + tau * j])
        state[:, t == 1.0] = [[1.0], [0.0], [0.0]]
        return state


def _profiles(distances: Array, durations: Array, limits: Limits) -> list[_Profile]:
    """Let Ruckig find the profile of each joint, in units in which its distance and its least duration are 1.

    In these units Ruckig's absolute tolerances are tight for motions of every size. A profile that is run more slowly than
    possible needs less of each limit, so all joints can take the same time.

    Args:
        distances: Distance of each joint, (n,), above 0.
        durations: Least duration of each joint, (n,), [s].
        limits: Limits of these joints.

    Raises:
        MissingExtra: Ruckig is not installed.
        InternalError: Ruckig finds no motion.
    """
    try:
        import ruckig
    except ImportError:
        raise MissingExtra("A motion from point to point", "motion") from None
    count = len(distances)
    request, found = ruckig.InputParameter(count), ruckig.Trajectory(count)
    request.synchronization = ruckig.Synchronization.No
    request.current_position, request.target_position = [0.0] * count, [1.0] * count
    # The largest velocity on the way is below 2 times the mean one.
    request.max_velocity = np.minimum(limits.velocity * durations / distances, 4.0).tolist()
    if limits.jerk is not None:
        request.max_jerk = (limits.jerk * durations**3 / distances).tolist()
    for more in MORE:
        # Ruckig may find nothing where one kind of profile ends and another one begins, such as without a phase of constant
        # acceleration. A slightly different limit of the acceleration leaves that point.
        request.max_acceleration = ((1.0 + more) * limits.acceleration * durations**2 / distances).tolist()
        with suppress(ruckig.RuckigError):
            ruckig.Ruckig(count).calculate(request, found)
            return [_read(profile) for profile in found.profiles[0]]
    raise InternalError(f"Ruckig finds no motion over {distances.tolist()} with {limits}")


def _read(profile: Any) -> _Profile:
    """Read a profile of Ruckig, and let it take the time 1."""
    ends = np.cumsum(profile.t)
    total = float(ends[-1])
    rates = (np.array(rate[:7]) for rate in (profile.p, profile.v, profile.a, profile.j))
    scaled = [rate * total**order for order, rate in enumerate(rates)]
    return _Profile(total, np.concatenate([[0.0], ends[:-1] / total]), *scaled)


def _knots(profiles: list[_Profile], distances: Array, duration: float, limits: Limits) -> Array:
    """Return the times, from 0 to 1, between which the motion is one polynomial, (m + 1,).

    These are the changes of phase of all joints, and times in between where these are far apart. A change that follows
    another one too soon lies inside a shortest interval: over a time h the difference of velocities v is rounded by ε v / h,
    and that of accelerations by ε v / h².
    """
    noise = 8.0 * np.finfo(np.float64).eps / RESERVE
    least = noise
    if limits.jerk is not None:
        least += np.sqrt(noise * float(max(2.0 * distances / (limits.jerk * duration**3))))
    changes = np.unique(np.concatenate([profile.begins for profile in profiles]))
    kept = [0.0]
    for change in changes:
        knot = max(change, kept[-1] + least)
        if change > kept[-1] and knot <= 1.0 - least:
            kept.append(knot)
    ends = np.append(kept[1:], 1.0)
    parts = np.ceil((ends - kept) * PIECES).astype(np.int64)
    fine = [np.linspace(t, end, many, endpoint=False) for t, end, many in zip(kept, ends, parts, strict=True)]
    return np.append(np.concatenate(fine), 1.0)
