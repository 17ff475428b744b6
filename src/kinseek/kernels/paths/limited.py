"""Moving joints after a target in steps, within limits, so that they can always stop in time.

A state is safe if braking from it, see `stopping`, stays inside the limits of the joints, and as far from obstacles as
demanded. Each step chooses a safe next state, and braking is always one of them. Nearly the same idea with another braking
motion is in *Berscheid & Kröger 2021*.
"""

from __future__ import annotations

from math import inf
from typing import Annotated, NamedTuple

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.descent import goal_of
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.task import TOLERANCES, Job, handle_at, lanes_of, task_at
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .servo import NO_POSE, State, servo_step
from .stopping import Rates, change, follow, stop, velocities

HALVINGS = 40
"""Halvings between braking and what is desired, until the next state is safe inside the limits of a joint."""

SHARES = 12
"""The same for distances of bodies, which cost more."""

SMOOTHING = 0.004
"""Time constant with which the velocity of the target is averaged [s]. A longer one follows less of the noise, and falls
behind a target that accelerates. Not examined further."""

NEAR = 0.02
"""The distance that bodies keep with `FOLLOW` [m]; where that is too much, `STRAIGHT` has to do. Not examined further."""

FOLLOW, GO, STRAIGHT = 0, 1, 2
"""Follow `Motion.target`, each joint as fast as it may; reach velocities `Motion.wanted`; or go straight to the target."""

FREE, POSITION, VELOCITY, ACCELERATION, JERK = 0, 1, 2, 3, 4
"""What keeps a joint from what is desired."""

ON_TARGET = 1e-12
"""A joint that is this close to its target is at it [rad] or [m]."""


class Motion(NamedTuple):
    """A motion of n joints: limits, infinite if there is none, state and target, (n,) each, in [rad], [m] and [s]."""

    lower: Annotated[Array, "n"]
    upper: Annotated[Array, "n"]
    velocity_limit: Annotated[Array, "n"]
    acceleration_limit: Annotated[Array, "n"]
    jerk_limit: Annotated[Array, "n"]
    q: Annotated[Array, "n", OUT]
    velocity: Annotated[Array, "n", OUT]
    acceleration: Annotated[Array, "n", OUT]
    target: Annotated[Array, "n", OUT]
    """Joint values to follow at the end of the step."""
    before: Annotated[Array, "n", OUT]
    """The target of the step before."""
    rate: Annotated[Array, "n", OUT]
    """Averaged velocity of the target; after `GO` the velocity that was wanted."""
    wanted: Annotated[Array, "n", OUT]
    """Velocities to reach."""
    desired: Annotated[Array, "n", OUT]
    """Scratch: velocities of the next step."""
    braking: Annotated[Array, "n", OUT]
    """Scratch: the same when braking."""
    extent: Annotated[Array, "n", OUT]
    """Scratch: largest distance from the present joint values until rest."""
    rest: Annotated[Array, "n", OUT]
    """Where the joints would come to rest after what is desired, if that is not possible."""


class Room(NamedTuple):
    """How far joints may move until a pair of bodies may touch."""

    levers: Annotated[Array, "p", "n"]
    """Largest relative motion of each pair by each joint, (p, n), [m/rad] or [m/m]."""
    distance: Annotated[Array, "p", OUT]
    """Distance that each pair may lose, (p,) [m]; a step reduces it by the largest motion of the pair."""


@inlined
def rates_of(motion: Motion, i: int, h: float) -> Rates:
    """Limits of joint i."""
    return Rates(motion.velocity_limit[i], motion.acceleration_limit[i], motion.jerk_limit[i], h)


@inlined
def inside(motion: Motion, i: int, v: float, h: float) -> bool:
    """Return whether joint i, with velocity v in this step, can brake inside its limits.

    A joint that is outside, or cannot stop inside, must not go farther than braking leads it.
    """
    rates, q = rates_of(motion, i, h), motion.q[i]
    now = stop(motion.velocity[i], motion.acceleration[i], rates)
    then = stop(v, (v - motion.velocity[i]) / h, rates)
    upper, lower = max(motion.upper[i], q + now.highest), min(motion.lower[i], q + now.lowest)
    return bool(q + h * v + then.highest <= upper and q + h * v + then.lowest >= lower)


@inlined
def brake(motion: Motion, i: int, h: float) -> float:
    """Return the velocity of joint i that brakes."""
    rates, v = rates_of(motion, i, h), motion.velocity[i]
    low, high = velocities(v, motion.acceleration[i], rates)
    return float(min(max(v + change(-v, rates), low), high))


@inlined
def smoothed(motion: Motion, i: int, h: float) -> float:
    """Return the averaged velocity of the target of joint i, at most its limit."""
    V = motion.velocity_limit[i]
    moved = min(max((motion.target[i] - motion.before[i]) / h, -V), V)
    return float(motion.rate[i] + h / (h + SMOOTHING) * (moved - motion.rate[i]))


@inlined
def together(motion: Motion, h: float) -> Rates:
    """Return the limits of a parameter along the straight way to the target, 0 here and 1 there."""
    V, A, J = inf, inf, inf
    for i in range(len(motion.q)):
        gap = abs(motion.target[i] - motion.q[i])
        if gap > 0.0:
            V, A = min(V, motion.velocity_limit[i] / gap), min(A, motion.acceleration_limit[i] / gap)
            J = min(J, motion.jerk_limit[i] / gap)
    return Rates(V, A, J, h)


@inlined
def after_target(motion: Motion, i: int, along: Rates) -> float:
    """Return the velocity with which joint i follows its target; see `limited_step`.

    Args:
        motion: The motion.
        i: The joint.
        along: Limits of the straight way, see `together`; without limits the joint moves as fast as it may.
    """
    h = along.period
    rates, v, q, target = rates_of(motion, i, h), motion.velocity[i], motion.q[i], motion.target[i]
    low, high = velocities(v, motion.acceleration[i], rates)
    exactly, moved = (target - q) / h, (target - motion.before[i]) / h
    # A joint that has been on the target and can stay there does so, up to what one step may change.
    if low <= exactly <= high and abs(exactly - moved) <= h * min(rates.acceleration, rates.jerk * h):
        return float(exactly)
    rate, gap = smoothed(motion, i, h), abs(target - q)
    if gap > 0.0:
        A, J = min(rates.acceleration, gap * along.acceleration), min(rates.jerk, gap * along.jerk)
        rates = Rates(min(rates.velocity, gap * along.velocity), A, J, h)
    return float(rate + follow(target - q - rate * h, v - rate, low - rate, high - rate, rates))


@inlined
def moved(room: Room, p: int, extent: Array) -> float:
    """Return a bound of the relative motion of pair p if each joint moves by at most its extent, (n,) [m]."""
    motion = 0.0
    for i in range(len(extent)):
        motion += room.levers[p, i] * extent[i]
    return motion


@inlined
def roomy(motion: Motion, room: Room, share: float, h: float, least: float) -> int:
    """Return a pair that may touch before rest, -1 if there is none, -2 if a joint cannot stop inside its limits.

    The velocities of the step are those of braking and a share of what is desired beyond them; `least` is the distance that
    all pairs keep [m].
    """
    for i in range(len(motion.q)):
        v = motion.braking[i] + share * (motion.desired[i] - motion.braking[i])
        if not inside(motion, i, v, h):
            return -2
        to = stop(v, (v - motion.velocity[i]) / h, rates_of(motion, i, h))
        motion.extent[i] = max(abs(h * v + to.highest), abs(h * v + to.lowest))
        motion.rest[i] = motion.q[i] + h * v + to.end
    for p in range(len(room.distance)):
        if moved(room, p, motion.extent) > room.distance[p] - least:
            return p
    return -1


@inlined
def kept_by(motion: Motion, i: int, v: float, h: float) -> int:
    """Return which limit joint i is at with velocity v in this step; if none, it brakes before its target."""
    rates, near = rates_of(motion, i, h), 1.0 - 1e-9
    a = (v - motion.velocity[i]) / h
    if abs(v) >= near * rates.velocity:
        return VELOCITY
    if abs(a) >= near * rates.acceleration:
        return ACCELERATION
    return JERK if rates.jerk < inf else ACCELERATION


@entry
def limited_step(motion: Motion, room: Room, h: float, what: int, sure: bool) -> tuple[int, int, int]:
    """Move the joints by one step.

    With `FOLLOW`, a joint that can be at its target does so. Otherwise its velocity relative to the target is the one from
    which it would come to rest at the target, if this keeps its velocity: the fastest way without overshooting. With `GO`
    all joints reach their velocities at the same time, if they start at rest.

    Args:
        motion: Limits, state and target.
        room: Distances of bodies; no pairs if there are no obstacles.
        h: Duration of the step [s].
        what: `FOLLOW`, `GO` or `STRAIGHT`: beside obstacles a joint that hurries ahead of the others leads the wrong way.
        sure: Whether the distances are the best ones that can be had. Otherwise nothing is moved if they do not suffice.

    Returns:
        Joint that is farthest from what is desired and not free, or -1; what keeps it; the pair of bodies that slowed the
        joints, or -1.
    """
    n, longest, along = len(motion.q), 0.0, Rates(inf, inf, inf, h)
    if what == STRAIGHT:
        along = together(motion, h)
    if what == GO:
        for i in range(n):
            size = abs(motion.wanted[i] - motion.velocity[i])
            A = motion.acceleration_limit[i]
            longest = max(longest, size / A, (size / motion.jerk_limit[i]) ** 0.5)
    for i in range(n):
        motion.braking[i] = brake(motion, i, h)
        if what != GO:
            motion.desired[i] = after_target(motion, i, along)
            continue
        rates, v = rates_of(motion, i, h), motion.velocity[i]
        left = motion.wanted[i] - v
        low, high = velocities(v, motion.acceleration[i], rates)
        # A joint that had the velocity that was wanted, and can have it again, does.
        had = abs(v - motion.rate[i]) <= h * min(rates.acceleration, rates.jerk * h)
        if left != 0.0 and longest > 0.0 and not (had and low <= motion.wanted[i] <= high):
            # Smaller limits, so that all joints change their velocities in the same time and the tip keeps its direction.
            A, J = rates.acceleration, rates.jerk
            slower = min(1.0, max(abs(left) / A, (abs(left) / J) ** 0.5) / longest)
            step = change(left, Rates(rates.velocity, A, J * slower * slower, h))
            most = A * slower * h
            left = min(max(step, -most), most)
        motion.desired[i] = min(max(v + left, low), high)
    at_limits = 0
    for i in range(n):
        if inside(motion, i, motion.desired[i], h):
            continue
        at_limits |= 1 << i
        safe, unsafe = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (safe + unsafe)
            if inside(motion, i, motion.braking[i] + middle * (motion.desired[i] - motion.braking[i]), h):
                safe = middle
            else:
                unsafe = middle
        motion.desired[i] = motion.braking[i] + safe * (motion.desired[i] - motion.braking[i])
    pair, share = -1, 1.0
    if len(room.distance) > 0:
        pair = roomy(motion, room, 1.0, h, NEAR if what == FOLLOW else 0.0)
        if pair >= 0 and not sure:
            return -1, FREE, pair
        if pair >= 0:
            share, unsafe = 0.0, 1.0
            for _ in range(SHARES):
                middle = 0.5 * (share + unsafe)
                if roomy(motion, room, middle, h, 0.0) == -1:
                    share = middle
                else:
                    unsafe = middle
    joint, kept, farthest = -1, FREE, ON_TARGET
    for i in range(n):
        v = motion.braking[i] + share * (motion.desired[i] - motion.braking[i])
        q = motion.q[i] + h * v
        # Rounding must lead no joint out of its limits, and none away from its target.
        if motion.q[i] <= motion.upper[i]:
            q = min(q, motion.upper[i])
        if motion.q[i] >= motion.lower[i]:
            q = max(q, motion.lower[i])
        if what != GO and abs(q - motion.target[i]) <= 4e-16 * max(1.0, abs(q)):
            q = motion.target[i]
        off = abs(q - motion.target[i]) if what != GO else h * abs(v - motion.wanted[i])
        if off > farthest:
            kept = POSITION if at_limits >> i & 1 else kept_by(motion, i, v, h)
            joint, farthest = i, off
        motion.acceleration[i] = (v - motion.velocity[i]) / h
        motion.extent[i] = abs(q - motion.q[i])
        motion.velocity[i] = v
        motion.q[i] = q
        if what != GO:
            motion.rate[i] = smoothed(motion, i, h)
            motion.before[i] = motion.target[i]
        else:
            motion.rate[i], motion.before[i] = motion.wanted[i], q
    for p in range(len(room.distance)):
        room.distance[p] -= moved(room, p, motion.extent)
    return joint, kept, pair


@entry
def track_step(
    address: int,
    tolerances: Annotated[Array, TOLERANCES],
    target: Annotated[Array, 4, 4],
    memory: Annotated[Array, "*"],
    state: State,
    motion: Motion,
    room: Room,
    h: float,
) -> tuple[float, float, int, int, int, int]:
    """Move the joint values that track a pose by `servo_step`, and the joints after them by `limited_step`.

    Returns:
        Position error [m] and orientation error [rad] of the joints, the outcome of `servo_step`, and what `limited_step`
        returns. If that is a pair of bodies, the joints have not moved.
    """
    position, orientation, ended = servo_step(address, tolerances, target, memory, state)
    if ended == NO_POSE:
        return position, orientation, ended, -1, FREE, -1
    for d in range(len(motion.q)):
        motion.target[d] = state.now[d]
    joint, kept, pair = limited_step(motion, room, h, FOLLOW, False)
    if joint >= 0:
        handle = handle_at(address)
        job = Job(handle, tolerances, memory, lanes_of(handle))
        task = task_at(job)
        scratch = scratch_of(job, task)
        forward(task.chain, motion.q, scratch.pose)
        position, orientation = errors(scratch.pose, goal_of(task, target))
    return position, orientation, ended, joint, kept, pair
