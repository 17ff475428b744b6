"""Two arms that move at the same time, each along its trajectory.

Both arms are one chain: from the last link of one back to its base, and from there along the other one. So the broad phase
and coal check pairs of links at joint values of both arms, and a motion of both is one motion of this chain. Bodies at
distance d cannot touch before both together have moved by d, each relative to its base.

Between two times h apart, a joint with an acceleration of at most a is at most a h² / 8 from its linear motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import Frame, SerialChain
from kinseek.timing.trajectory import Trajectory

from .assembly import assemble
from .bodies import Body
from .engine import Engine, Solid
from .motion import Speeds, are_free
from .others import OtherArm
from .pairs import Pair, key

Array = NDArray[np.float64]

_STEP, _HALVINGS = 1 / 16, 7
"""Longest interval of time that is checked first [s], and how often an interval is halved. Not examined further."""

_ROUNDING = 1e-9
"""Bound of the rounding errors of a trajectory, [rad] or [m]."""


class Timed(NamedTuple):
    """A trajectory that begins at some time; the arm rests before and after it."""

    trajectory: Trajectory
    begin: float
    """[s]"""

    @property
    def end(self) -> float:
        """Time at which it ends [s]."""
        return self.begin + self.trajectory.duration

    def q(self, t: Array) -> Array:
        """Return the joint values at times, (k,), as (k, n)."""
        return self.trajectory.q(np.clip(t - self.begin, 0.0, self.trajectory.duration))

    def deviation(self, width: Array) -> Array:
        """Bound how far each joint is from its linear motion within intervals of these widths, (k,) [s], as (k, n)."""
        return np.outer(width**2 / 8.0, self.trajectory.limits.acceleration) + _ROUNDING


def free_until(speeds: Speeds, one: Timed, other: Timed, clearance: float) -> float:
    """Return the time up to which two arms are proved free of each other [s]; infinite if they are free at all times.

    Args:
        speeds: The pairs, of `speeds_of_both`.
        one: The motion of the first arm.
        other: The motion of the other arm.
        clearance: Minimum distance of bodies [m].
    """
    engine = speeds.engine
    # Where a motion begins or ends, the velocity may jump.
    knots = np.unique([0.0, one.begin, one.end, other.begin, other.end])
    counts = np.ceil(np.diff(knots) / _STEP).astype(np.int64).tolist()
    each = [
        np.linspace(begin, end, count + 1)[1:]
        for begin, end, count in zip(knots, knots[1:], counts, strict=False)
    ]
    times = np.concatenate([knots[:1], *each])

    def q(t: Array) -> Array:
        return np.concatenate([one.q(t), other.q(t)], axis=1)

    def first_contact(t: Array) -> float:
        return float(t[~engine.free(q(t), clearance)].min(initial=np.inf))

    if (contact := first_contact(times)) == 0.0:
        return 0.0
    begins, ends = times[:-1], times[1:]
    for _ in range(_HALVINGS + 1):
        before = begins < contact
        begins, ends = begins[before], ends[before]
        widths = ends - begins
        around = np.concatenate([one.deviation(widths), other.deviation(widths)], axis=1)
        with engine.lock:
            left = ~are_free(speeds, q(begins), q(ends), clearance, around)
        if not left.any():
            return np.inf
        begins, ends = begins[left], ends[left]
        first, middles = float(begins.min()), (begins + ends) / 2
        contact = min(contact, first_contact(middles))
        begins, ends = np.concatenate([begins, middles]), np.concatenate([middles, ends])
    return first


def speeds_of_both(
    chain: SerialChain, bodies: Sequence[Body], other: OtherArm, never: Mapping[tuple[str, str], str]
) -> Speeds:
    """Return the pairs of a body of one arm and a body of another, at joint values of both, (k, n + m).

    Args:
        chain: The arm.
        bodies: Its links, and what they carry.
        other: The other arm.
        never: Reasons of the pairs that are not checked, by both names.
    """
    theirs = [replace(body, name=name) for body, name in zip(other.bodies, other.names, strict=True)]
    pairs = [
        Pair(a.name, b.name, never.get(key(a.name, b.name), ""))
        for a in bodies
        for b in theirs
        if a.frame.joints or b.frame.joints  # The bases rest.
    ]
    joined = _Joined(chain, other)
    placed = [joined.of_one(body) for body in bodies] + [joined.of_other(body) for body in theirs]
    assembly = assemble(joined.chain, placed, pairs)
    named = {body.name: body for body in (*bodies, *theirs)}
    solids = [
        Solid(body.frame.joints, part.shape, body.frame.pose @ part.pose, body.padding)
        for body in (named[name] for name in assembly.numbers)
        for part in body.parts
    ]
    return _SpeedsOfBoth(joined.chain, assembly.engine, solids, (chain, other.chain))


class _Parts(NamedTuple):
    """What `Speeds` needs of an engine."""

    solids: Sequence[Solid]
    pairs: Sequence[tuple[int, int]]


class _SpeedsOfBoth(Speeds):
    """Bounds on the motion of both parts of each pair together, each relative to the base of its own arm."""

    def __init__(
        self,
        joined: SerialChain,
        engine: Engine,
        solids: Sequence[Solid],
        chains: tuple[SerialChain, SerialChain],
    ) -> None:
        """Compute what does not depend on the motion; `solids` are the parts in the frames of their own arms."""
        super().__init__(joined, engine)
        self._dof, base = chains[0].dof, len(solids)
        parts = [*solids, *(solid._replace(joint=0) for solid in solids[:1])]
        of_each: list[Any] = [
            _Parts(parts, [(base, pair[side]) for pair in engine.pairs]) for side in range(2)
        ]
        self._each = [Speeds(chain, own) for chain, own in zip(chains, of_each, strict=True)]

    def of(self, q0: Array, q1: Array, moved: Array | None = None) -> Array:
        """Return the bounds for joint values of both arms, (k, n + m) each; see `Speeds.of`."""
        total = np.zeros((len(q0), len(self.engine.pairs)))
        for speeds, own in zip(self._each, (slice(self._dof), slice(self._dof, None)), strict=True):
            total += speeds.of(q0[:, own], q1[:, own], None if moved is None else moved[:, own])
        return total


class _Joined:
    """The chain from the last joint of an arm back to its base, and along another arm, for joint values (one, other).

    From the part that a joint moves, back to the part before the joint, the motion is the inverse one about the same axis.
    """

    def __init__(self, one: SerialChain, other: OtherArm) -> None:
        """Join the chains at their bases."""
        self._joints = len(one.leader)
        self._back = np.linalg.inv(_square(one.fixed[: self._joints]))
        """From the frame before each joint to that of the part that carries it, (joints, 4, 4)."""
        self._base = self._back[0] @ other.base
        theirs, far = other.chain, _square(other.chain.fixed)
        fixed = [np.eye(4)[None], self._back[:0:-1], (self._base @ far[0])[None], far[1:]]
        reverse = slice(None, None, -1)
        self.chain = replace(
            one,
            joint_names=(*one.joint_names, *(f"{other.name}/{name}" for name in theirs.joint_names)),
            kinds=(*one.kinds, *theirs.kinds),
            lower=np.concatenate([one.lower, theirs.lower]),
            upper=np.concatenate([one.upper, theirs.upper]),
            fixed=np.concatenate(fixed)[:, :3],
            prismatic=np.concatenate([one.prismatic[reverse], theirs.prismatic]),
            leader=np.concatenate([one.leader[reverse], one.dof + theirs.leader]),
            multiplier=np.concatenate([-one.multiplier[reverse], theirs.multiplier]),
            offset=np.concatenate([-one.offset[reverse], theirs.offset]),
            rates=np.concatenate([one.rates, theirs.rates], axis=1),
        )

    def of_one(self, body: Body) -> Body:
        """Return a body of the first arm in the frames of the chain."""
        k, pose = body.frame
        pose = self._back[k] @ pose if k < self._joints else pose
        return replace(body, frame=Frame(self._joints - k, pose))

    def of_other(self, body: Body) -> Body:
        """Return a body of the other arm in the frames of the chain."""
        k, pose = body.frame
        return replace(body, frame=Frame(self._joints + k, pose if k else self._base @ pose))


def _square(transforms: Array) -> Array:
    """Complete transforms, (k, 3, 4), to (k, 4, 4)."""
    return np.concatenate([transforms, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(transforms), 1, 1))], axis=1)
