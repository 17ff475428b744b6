"""Targets that move, and a judge of what follows them: finite differences and forward kinematics, in NumPy alone.

A stream is an array of poses, one a period, and the joint values at which its first pose is reached. It is made from an
arm's geometry and a seed. Where a target comes to rest it rests for three seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import kinseek
from kinseek.robots.chain import SerialChain

from .targets import Array, plain_fk, pose_errors

PERIOD = 0.002
"""[s]"""

HOLD = 3.0
"""How long a target rests [s]."""

LINEAR, ANGULAR = 0.2, 0.8
"""Largest speeds of the mouse [m/s], [rad/s]."""

SETTLED = 2.0
"""The hand has to rest so long after its target does [s]."""

RESTING, TURNING = 1e-5, 1e-6
"""A joint rests below the first speed; opposite speeds are a reversal if both exceed the second [rad/s, m/s]."""

SLACK = 1e-9
"""Share of a limit beyond it that is rounding."""

REACHED = 1e-6
"""[m], [rad]"""


class Stream(NamedTuple):
    """A target that moves."""

    T: Array
    """Poses, one a period, (k, 4, 4)."""
    q0: Array
    """Joint values that reach the place where it begins, (n,)."""


# Streams


def ease(count: int) -> Array:
    """From 0 to 1 with rest at both ends, (count,)."""
    s = np.linspace(0.0, 1.0, count)
    return np.asarray(s**3 * (10 - 15 * s + 6 * s * s))


def between(A: Array, B: Array, s: Array) -> Array:
    """Poses on the straight line from one pose to another, turning evenly, (k,) -> (k, 4, 4)."""
    T = np.repeat(A[None], len(s), axis=0)
    T[:, :3, 3] += s[:, None] * (B[:3, 3] - A[:3, 3])
    turn = Rotation.from_matrix(B[:3, :3] @ A[:3, :3].T).as_rotvec()
    T[:, :3, :3] = Rotation.from_rotvec(s[:, None] * turn).as_matrix() @ A[:3, :3]
    return T


def integrated(T0: Array, twists: Array) -> Array:
    """Poses of velocities in the axes of the base, (k, 6) [m/s, rad/s] -> (k, 4, 4)."""
    T = np.repeat(T0[None], len(twists), axis=0)
    T[:, :3, 3] += np.cumsum(twists[:, :3], axis=0) * PERIOD
    R = T0[:3, :3]
    for k, turn in enumerate(Rotation.from_rotvec(twists[:, 3:] * PERIOD).as_matrix()):
        T[k, :3, :3] = R = turn @ R
        if k % 100 == 99:
            u, _, v = np.linalg.svd(R)
            T[k, :3, :3] = R = u @ v
    return T


def periods(seconds: float) -> int:
    """How many periods some time takes."""
    return max(2, round(seconds / PERIOD))


def rest(T: Array, seconds: float = HOLD) -> Array:
    """The last pose for a while, (4, 4) or (k, 4, 4) -> (m, 4, 4)."""
    return np.repeat(T.reshape(-1, 4, 4)[-1:], periods(seconds), axis=0)


def there_and_back(way: Array) -> Array:
    """A way, a rest, the way back, and a rest."""
    return np.concatenate([way, rest(way[-1]), way[::-1], rest(way[0])])


def margin(arm: kinseek.Arm, q: Array) -> float:
    """Least singular value of the Jacobian: how far from a singularity."""
    return float(np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1])


def somewhere(arm: kinseek.Arm, rng: np.random.Generator, share: float = 0.6, looks: int = 30) -> Array:
    """Joint values in the inner part of the ranges, the farthest from a singularity among some, (n,)."""
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 2, np.pi)
    each = middle + share * half * rng.uniform(-1, 1, (looks, arm.dof))
    return np.asarray(max(each, key=lambda q: margin(arm, q)))


def base_axis(chain: SerialChain) -> tuple[Array, Array]:
    """A point on the first axis, and its direction."""
    return chain.fixed[0][:3, 3], chain.fixed[0][:3, 2]


def smooth(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """Poses of a smooth curve of joint values, the fastest joint at 0.8 rad/s."""
    q0, t = somewhere(arm, rng), np.arange(periods(4.0)) * PERIOD
    waves = np.zeros((len(t), arm.dof))
    for h in range(1, 5):
        a, b = rng.normal(size=(2, arm.dof)) / h
        waves += np.cos(0.5 * np.pi * h * t)[:, None] * a + np.sin(0.5 * np.pi * h * t)[:, None] * b
    waves = (waves - waves[0]) * (4 * ease(len(t)) * (1 - ease(len(t))))[:, None]
    waves *= 0.8 * PERIOD / np.abs(np.diff(waves, axis=0)).max()
    inside = np.where(waves > 0, arm.upper - q0, q0 - arm.lower)
    waves *= min(1.0, 0.95 * float((inside / np.maximum(np.abs(waves), 1e-9)).min()))
    way = plain_fk(arm.chain, q0 + waves)
    return Stream(np.concatenate([way, rest(way)]), q0)


def step(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """Jumps to poses that can be reached, of up to half a radian a joint, the last but one of up to a radian and a half."""
    q0 = somewhere(arm, rng)
    q = q0 + np.array([0.5, 0.5, 0.5, 1.5, 0.5])[:, None] * rng.uniform(-1, 1, (5, arm.dof))
    T = plain_fk(arm.chain, np.clip(q, arm.lower, arm.upper))
    return Stream(np.concatenate([rest(one, HOLD if k > 2 else 0.7) for k, one in enumerate(T)]), q0)


def noise(arm: kinseek.Arm, rng: np.random.Generator, q0: Array, times: float) -> Stream:
    """Noise between 0.2 and 2.5 Hz on all six velocities of the hand, at most so many times those of the mouse."""
    t = np.arange(periods(4.0)) * PERIOD
    waves = np.zeros((len(t), 6))
    for f in np.geomspace(0.2, 2.5, 12):
        waves += rng.normal(size=6) * np.cos(2 * np.pi * f * t[:, None] + rng.uniform(0, 2 * np.pi, 6))
    waves *= np.minimum(1.0, np.minimum(t, t[::-1]) / 0.5)[:, None]
    for part, largest in ((slice(0, 3), LINEAR), (slice(3, 6), ANGULAR)):
        waves[:, part] *= times * largest / np.linalg.norm(waves[:, part], axis=1).max()
    way = integrated(plain_fk(arm.chain, q0[None])[0], waves)
    return Stream(np.concatenate([way, rest(way)]), q0)


def mouse(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """The mouse, where it needs no joint out of its range, and none faster than 1 rad/s."""
    for _ in range(40):
        found = noise(arm, rng, somewhere(arm, rng, 0.5, 60), 1.0)
        if arm.dof < 6 or is_easy(arm, found):
            break
    return found


def rough_mouse(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """A mouse that is three times as fast, anywhere."""
    return noise(arm, rng, somewhere(arm, rng, 0.95, 1), 3.0)


def is_easy(arm: kinseek.Arm, stream: Stream, every: int = 25) -> bool:
    """Do Newton steps follow a stream inside the ranges, no joint faster than 1 rad/s?"""
    q = stream.q0
    for target in stream.T[::every]:
        before = q
        for _ in range(4):
            q = q + np.linalg.pinv(arm.jacobian(q), rcond=1e-3) @ missing(arm.chain, q, target)
        fast = np.abs(q - before).max() > 1.0 * every * PERIOD
        if fast or (~arm.chain.endless & ((q < arm.lower + 0.1) | (q > arm.upper - 0.1))).any():
            return False
    return bool(np.abs(missing(arm.chain, q, target)).max() < 1e-6)


def missing(chain: SerialChain, q: Array, target: Array) -> Array:
    """The twist that leads to a pose in the time 1, (6,)."""
    T = plain_fk(chain, q[None])[0]
    return np.concatenate(
        [target[:3, 3] - T[:3, 3], Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()]
    )


def joint_limit(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """Poses of a joint that runs to its limit and a quarter of a radian beyond, and back."""
    q0 = somewhere(arm, rng)
    joint = rng.choice(np.flatnonzero(~arm.chain.endless & ~arm.chain.prismatic[: arm.dof]))
    up = rng.random() < 0.5
    limit, way = (arm.upper[joint], 1.0) if up else (arm.lower[joint], -1.0)
    q0[joint] = limit - way * min(0.5, (arm.upper[joint] - arm.lower[joint]) / 2)
    q = np.repeat(q0[None], periods(1.25), axis=0)
    q[:, joint] = np.linspace(q0[joint], limit + way * 0.25, len(q))
    return Stream(there_and_back(plain_fk(arm.chain, q)), q0)


def across_axis(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """A line past the axis of the first joint, in half of the streams right through it, at 0.3 m/s."""
    q0 = somewhere(arm, rng)
    A = plain_fk(arm.chain, q0[None])[0]
    point, axis = base_axis(arm.chain)
    out = A[:3, 3] - point
    out = out - (out @ axis) * axis
    side = np.cross(axis, out) / max(float(np.linalg.norm(out)), 1e-9)
    B = A.copy()
    B[:3, 3] += -2 * out + side * rng.choice([0.0, rng.uniform(0, 0.06)])
    length = float(np.linalg.norm(B[:3, 3] - A[:3, 3]))
    return Stream(there_and_back(between(A, B, np.linspace(0, 1, periods(min(length / 0.3, 4.0))))), q0)


def singular(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """A line through the pose of a singular q, begun 0.6 rad before it: through that of the wrist, where there is one."""
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 2, np.pi)
    looks: list[Array] = []
    for q in middle + 0.6 * half * rng.uniform(-1, 1, (20, arm.dof)):
        for joint in range(
            max(arm.dof - 3, 1), arm.dof - 1
        ):  # Not the last one, which no singularity depends on.
            looks += [
                np.where(np.arange(arm.dof) == joint, value, q) for value in (0.0, np.pi / 2, -np.pi / 2)
            ]
    inside = [q for q in looks if ((q > arm.lower + 0.3) & (q < arm.upper - 0.3)).all()] or looks
    q = min(inside, key=lambda one: margin(arm, one))
    away = rng.normal(size=arm.dof)
    away *= 0.6 / np.abs(away).max()
    q0 = np.clip(q - away, arm.lower, arm.upper)
    A, M, B = plain_fk(arm.chain, np.array([q0, q, np.clip(q + away, arm.lower, arm.upper)]))
    s = np.linspace(0, 1, periods(1.0))
    return Stream(there_and_back(np.concatenate([between(A, M, s), between(M, B, s)[1:]])), q0)


def out_of_reach(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """Straight away from the base to one and a third of the reach, and back."""
    q0, (point, _) = somewhere(arm, rng), base_axis(arm.chain)
    A = plain_fk(arm.chain, q0[None])[0]
    out, B = A[:3, 3] - point, A.copy()
    B[:3, 3] = point + 4 / 3 * reach(arm) * out / np.linalg.norm(out)
    return Stream(there_and_back(between(A, B, ease(periods(2.0)))), q0)


def boundary(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """Out to the edge of the reach and some percent beyond it, and around the first axis there."""
    q0, (point, axis) = somewhere(arm, rng), base_axis(arm.chain)
    A = plain_fk(arm.chain, q0[None])[0]
    out, B = A[:3, 3] - point, A.copy()
    B[:3, 3] = point + rng.uniform(1.0, 1.1) * reach(arm) * out / np.linalg.norm(out)
    turn = rng.choice([-1.0, 1.0]) * 1.5 * ease(periods(3.0))
    around = np.repeat(B[None], len(turn), axis=0)
    R = Rotation.from_rotvec(turn[:, None] * axis).as_matrix()
    around[:, :3, :3] = R @ B[:3, :3]
    wave = 1 + 0.03 * np.sin(6 * turn)[:, None]
    around[:, :3, 3] = point + wave * np.einsum("kij,j->ki", R, B[:3, 3] - point)
    way = np.concatenate([between(A, B, ease(periods(1.0))), around])
    return Stream(np.concatenate([way, rest(way)]), q0)


def reach(arm: kinseek.Arm) -> float:
    """How far the tip gets from the first joint, of many random joint values [m]."""
    q = np.random.default_rng(5).uniform(arm.lower, arm.upper, (3000, arm.dof))
    return float(np.linalg.norm(plain_fk(arm.chain, q)[:, :3, 3] - base_axis(arm.chain)[0], axis=1).max())


def walk(arm: kinseek.Arm, rng: np.random.Generator) -> Stream:
    """A random walk, of 1 mm and 5 mrad a period."""
    q0 = somewhere(arm, rng)
    steps = rng.normal(size=(periods(4.0), 6)) * ([1e-3 / PERIOD] * 3 + [5e-3 / PERIOD] * 3)
    way = integrated(plain_fk(arm.chain, q0[None])[0], steps)
    return Stream(np.concatenate([way, rest(way)]), q0)


STREAMS: dict[str, Callable[[kinseek.Arm, np.random.Generator], Stream]] = {
    "smooth": smooth,
    "step": step,
    "mouse": mouse,
    "rough mouse": rough_mouse,
    "joint limit": joint_limit,
    "across the base axis": across_axis,
    "singularity": singular,
    "out of reach": out_of_reach,
    "boundary": boundary,
    "random walk": walk,
}


def stream(arm: kinseek.Arm, kind: str, seed: int) -> Stream:
    """One stream, the same for the same arm and seed."""
    return STREAMS[kind](arm, np.random.default_rng([seed, list(STREAMS).index(kind)]))


# Judge


class Limits(NamedTuple):
    """What joints may do; infinite where nothing is asked."""

    velocity: float
    """[rad/s] or [m/s]"""
    acceleration: float = np.inf
    """[rad/s²] or [m/s²]"""
    jerk: float = np.inf
    """[rad/s³] or [m/s³]"""


@dataclass
class Violations:
    """Of the limits of one motion."""

    steps: dict[str, int]
    """In how many steps, by the kind of limit: position, velocity, acceleration, jerk."""
    share: dict[str, float]
    """The largest share of the limit, by its kind; of the position how far outside [rad] or [m]."""
    first: dict[str, tuple[int, int]]
    """The first step and its joint, by the kind of limit, where there is one."""


def differences(q: Array, q0: Array) -> tuple[Array, Array, Array]:
    """Velocities, accelerations and jerks of joint values one a period, begun at rest, (k, n) each."""
    rest = np.zeros_like(q0)[None]
    v = np.diff(q, axis=0, prepend=q0[None]) / PERIOD
    a = np.diff(v, axis=0, prepend=rest) / PERIOD
    return v, a, np.diff(a, axis=0, prepend=rest) / PERIOD


def violations(arm: kinseek.Arm, q: Array, q0: Array, limits: Limits) -> Violations:
    """What joint values one a period, (k, n), violate: by more than `SLACK` and what rounding of q does to differences."""
    ulp = 4 * np.spacing(np.abs(np.vstack([q0, q])).max())
    found = Violations({}, {}, {})
    outside = np.where(arm.chain.endless, 0.0, np.maximum(q - arm.upper, arm.lower - q))
    excess: dict[str, tuple[Array, float]] = {"position": (outside, 0.0)}
    for order, (name, d) in enumerate(zip(Limits._fields, differences(q, q0), strict=True), 1):
        largest = limits[order - 1]
        excess[name] = np.abs(d) / largest, 1 + SLACK + ulp / PERIOD**order / largest
    for name, (size, allowed) in excess.items():
        bad = ~(size <= allowed)
        found.steps[name], found.share[name] = int(bad.any(axis=1).sum()), float(size.max())
        if bad.any():
            row, joint = np.argwhere(bad)[0].tolist()
            found.first[name] = row, joint
    return found


@dataclass
class Rest:
    """What happens while a target rests."""

    begin: int
    """The step with which the target comes to rest."""
    seconds: float
    """After which the hand rests, too; infinite if it does not."""
    reversals: int
    """Changes of direction of any joint later than `SETTLED` and than the first moment at which all rest."""
    position: float
    """Where it is at the end of the rest, off the target [m]."""
    orientation: float
    """[rad]"""
    end: int
    """The last step of the rest."""

    @property
    def reached(self) -> bool:
        """Is it there?"""
        return self.position <= REACHED and self.orientation <= REACHED


def holds(T: Array, seconds: float = HOLD) -> Iterator[tuple[int, int]]:
    """First step and end of every rest of a target that is as long."""
    moves = (np.diff(T, axis=0) != 0).any(axis=(1, 2))
    ends = np.concatenate([[0], np.flatnonzero(moves) + 1, [len(T)]])
    for begin, end in pairwise(ends):
        if end - begin >= periods(seconds):
            yield int(begin), int(end)


def rests(chain: SerialChain, q: Array, T: Array) -> list[Rest]:
    """What joint values one a period, (k, n), do at every rest of their targets, (k, 4, 4)."""
    found = []
    v = np.diff(q, axis=0, prepend=q[:1]) / PERIOD
    for begin, end in holds(T):
        moving = np.flatnonzero((np.abs(v[begin:end]) > RESTING).any(axis=1))
        still = int(moving[-1]) + 1 if len(moving) else 0
        resting = np.flatnonzero((np.abs(v[begin:end]) <= RESTING).all(axis=1))
        first = max(int(resting[0]) if len(resting) else 0, periods(SETTLED))
        late = v[begin + first : end]
        (place,), (turn,) = pose_errors(plain_fk(chain, q[end - 1 : end]), T[end - 1 : end])
        found.append(
            Rest(
                begin,
                np.inf if begin + still >= end else still * PERIOD,
                sum(reversals(column) for column in late.T),
                float(place),
                float(turn),
                end - 1,
            )
        )
    return found


def reversals(v: Array) -> int:
    """Changes of sign among those speeds that count."""
    signs = np.sign(v[np.abs(v) > TURNING])
    return int((signs[1:] != signs[:-1]).sum())


@dataclass
class Lag:
    """How far a hand is behind its target."""

    mean: float
    """Distance in the same period [m]."""
    largest: float
    """[m]"""
    behind: float
    """The time shift that makes the mean distance least [s]."""
    shape: float
    """The largest distance at that shift [m]."""


def lag(chain: SerialChain, q: Array, T: Array, longest: float = 0.4) -> Lag:
    """How far joint values one a period, (k, n), are behind their targets, (k, 4, 4)."""
    hand, target = plain_fk(chain, q)[:, :3, 3], T[:, :3, 3]
    away = np.linalg.norm(hand - target, axis=1)
    shifts = [
        np.linalg.norm(hand[k:] - target[: len(target) - k], axis=1)
        for k in range(min(periods(longest), len(q)))
    ]
    best = int(np.argmin([one.mean() for one in shifts]))
    return Lag(float(away.mean()), float(away.max()), best * PERIOD, float(shifts[best].max()))


def overshoot(q: Array, T: Array) -> float:
    """How far any joint goes beyond the value at which it is at the end of a rest of its target, at most [rad] or [m]."""
    most = 0.0
    for begin, end in holds(T):
        first, last = q[max(begin - 1, 0)], q[end - 1]
        most = max(most, float((np.sign(last - first) * (q[begin:end] - last)).max()))
    return most
