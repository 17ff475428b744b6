"""Collision checks of whole motions between two q, proved by bounds on motion instead of samples.

Conservative advancement (Mirtich 1996): two bodies at distance d at one moment of a motion cannot touch before one of them
has moved by d relative to the other. The lengths of the links bound the speed of any point. So every checked moment covers
an interval around itself, and the motion is free if the intervals of every pair cover it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.collision.gaps import TOUCH as TOUCHING
from kinseek.kernels.collision.motions import MANY
from kinseek.robots.chain import SerialChain

from .engine import LOOKS, TOUCH, Engine, Solid

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

FINEST = 1e-5
"""A motion that comes this close to contact, or to the clearance, is not reported as free [m]."""

_MOST = 20_000
"""Maximum number of moments checked per motion; a motion that needs more is not reported as free. Not examined further."""

_TOGETHER = 512
"""Number of motions checked together. Not examined further."""


class Speeds:
    """Bounds on the motion of points of one part of each pair, relative to the other part.

    Args:
        chain: The arm.
        engine: The pairs.
    """

    def __init__(self, chain: SerialChain, engine: Engine) -> None:
        """Compute what does not depend on the motion."""
        self._chain, self.engine = chain, engine
        joints = len(chain.leader)
        ends = np.array(
            [sorted((engine.solids[i].joint, engine.solids[j].joint)) for i, j in engine.pairs],
            dtype=np.int64,
        ).reshape(-1, 2)
        radii = [_radius(solid) for solid in engine.solids]
        last = [max(pair, key=lambda i: engine.solids[i].joint) for pair in engine.pairs]
        self._ends, self._radii = ends, np.array([radii[i] for i in last]).reshape(-1)
        moving = np.arange(joints)
        self._moves = (moving >= ends[:, :1]) & (moving < ends[:, 1:])
        """Joints between the two parts, (pairs, joints)."""
        self._levers = None if chain.prismatic.any() else self._levers_of(np.zeros((1, joints)))
        """See `levers`; None if slides change them."""

    def of(self, q0: Array, q1: Array, moved: Array | None = None) -> Array:
        """Return bounds on the motion of any point of each pair's parts from q0 to q1, (k, n) each, (k, pairs) [m].

        With `moved`, (k, n), the joints move by this much between q0 and q1 instead.
        """
        chain = self._chain
        if moved is None:
            moved = q1 - q0
        travel, levers = np.abs(chain.multiplier * moved[:, chain.leader]), self.levers(q0, q1)
        if len(levers) == 1:
            # Not by BLAS, whose sums depend on its threads.
            return np.asarray(np.einsum("kj,pj->kp", travel, levers[0]))
        return np.asarray((travel[:, None] * levers).sum(axis=2))

    def levers(self, q0: Array, q1: Array) -> Array:
        """Return bounds on the motion of a point per motion of each joint, between q0 and q1, (k, n) each.

        Returns:
            (k, pairs, joints), or (1, pairs, joints) for all; 0 for joints that move both parts or none.
        """
        chain = self._chain
        if self._levers is not None:
            return self._levers
        ends = [np.abs(chain.multiplier * q[:, chain.leader] + chain.offset) for q in (q0, q1)]
        return self._levers_of(np.where(chain.prismatic, np.maximum(*ends), 0.0))

    def _levers_of(self, slides: Array) -> Array:
        """Return bounds on the motion of a point for each joint's motion, with the joints slid out this far, (k, joints).

        Returns:
            (k, pairs, joints), 0 for joints that move both parts or none.
        """
        chain = self._chain
        lengths = np.linalg.norm(chain.fixed[:-1, :, 3], axis=1) + slides
        before = np.concatenate([np.zeros((len(slides), 1)), np.cumsum(lengths, axis=1)], axis=1)
        """Maximum distance from the base to the frame of each joint along the links."""
        reach = before[:, self._ends[:, 1], None] - before[:, None, 1:] + self._radii[:, None]
        return np.where(self._moves, np.where(chain.prismatic, 1.0, reach), 0.0)


def are_free(
    speeds: Speeds,
    q0: Array,
    q1: Array,
    clearance: float,
    around: Array | None = None,
    thorough: bool = True,
) -> Flags:
    """Return which linear motions from q0 to q1, (k, n) each, are proved free, (k,). See `Scene.free_motion`.

    Args:
        speeds: The pairs, and bounds of their motion.
        q0: Begins of the motions, (k, n).
        q1: Their ends.
        clearance: Minimum distance of bodies [m].
        around: How far each joint may be from the linear motion, (k, n); None for not at all.
        thorough: Measure exact distances too where bodies nearly touch for long.
    """
    free = np.ones(len(q0), dtype=np.bool_)
    if speeds.engine.pairs:
        for begin in range(0, len(q0), _TOGETHER):
            some = slice(begin, begin + _TOGETHER)
            deviation = None if around is None else around[some]
            least = _least(speeds, q0[some], q1[some], clearance, deviation)
            free[some] = _are_free(speeds, q0[some], q1[some], least, thorough)
    return free


def _are_free(speeds: Speeds, q0: Array, q1: Array, least: Array, thorough: bool) -> Flags:
    """Return which motions are proved free, by the broad phase, and by exact distances in the intervals in doubt."""
    engine, way = speeds.engine, q1 - q0
    verdicts, number, parts = engine.broad.free_motions(q0, way, speeds.levers(q0, q1), least)
    free, many = np.asarray(verdicts != TOUCHING), np.flatnonzero(verdicts == MANY)
    if thorough:
        number, parts = (
            np.concatenate([number, many]),
            np.concatenate([parts, np.tile([0.0, 1.0], (len(many), 1))]),
        )
    else:
        free[many] = False
    if not len(number):
        return free
    # One interval of each motion first: if it is not free, the others need no check.
    first = np.unique(number, return_index=True)[1]
    for chosen in (first, np.setdiff1d(np.arange(len(number)), first)):
        which = chosen[free[number[chosen]]]
        rows, ends = number[which], parts[which].T[..., None]
        a, b = (q0[rows] + end * way[rows] for end in ends)
        rates = speeds.of(q0[rows], q1[rows]) * (ends[1] - ends[0])
        stopped = _stops_of(engine, rates, a, b, least[rows])
        free[rows[~np.isnan(stopped)]] = False
    return free


def stops(speeds: Speeds, q0: Array, q1: Array, clearance: float) -> Array:
    """Return where the linear motions from q0 to q1, (k, n) each, are not free, as fractions, (k,); NaN if all is free.

    The place is not necessarily the first on the way. See `Scene.hits_between`.
    """
    if not speeds.engine.pairs:
        return np.full(len(q0), np.nan)
    least = _least(speeds, q0, q1, clearance, None)
    return _stops_of(speeds.engine, speeds.of(q0, q1), q0, q1, least)


def _least(speeds: Speeds, q0: Array, q1: Array, clearance: float, around: Array | None) -> Array:
    """Return the distance that each pair keeps, (k, pairs) [m]; see `are_free`."""
    least = np.array(clearance + FINEST)
    if around is not None:
        # The ranges of slides, and with them the levers, are those of the whole motion.
        low, high = np.minimum(q0, q1) - around, np.maximum(q0, q1) + around
        least = least + speeds.of(low, high, around)
    return np.broadcast_to(least, (len(q0), len(speeds.engine.pairs)))


def surely_hits(speeds: Speeds, q: Array, reach: Array, clearance: float) -> bool:
    """Return whether one pair is within the clearance wherever no joint is farther than `reach` from q, (n,) both.

    Bodies at distance d are at most d + m apart after no point of one has moved by more than m relative to the other. For
    convex bodies this also holds if they penetrate, with d the negative penetration depth: the differences of their points
    contain a ball of that radius about zero, and no smaller motion can exclude zero (Brouwer).
    """
    if not np.isfinite(reach).all():
        return False
    engine = speeds.engine
    moved = speeds.of((q - reach)[None], (q + reach)[None])[0] / 2
    return any(
        near.distance + moved[near.pair] < clearance - TOUCH
        for near in engine.touching(q, clearance)
        if engine.is_convex(near.pair) or near.distance > -engine.larger(near.pair)
    )


def _stops_of(engine: Engine, rates: Array, q0: Array, q1: Array, least: Array) -> Array:
    """Check the middle of every motion, then the middles of the halves that it does not cover, and so on.

    `least` is the distance that each pair keeps in each motion, (k, pairs).
    """
    found = np.full(len(q0), np.nan)
    number, moment, half = np.arange(len(q0)), np.full(len(q0), 0.5), 0.5
    left, looked = np.ones(rates.shape, dtype=np.bool_), np.zeros(len(q0), dtype=np.int64)
    while len(number):
        np.add.at(looked, number, 1)
        # Such a motion stays close to contact for long: without a limit the halving would hardly end.
        late = looked[number] > _MOST
        found[number[late]] = moment[late]
        q = q0[number] + moment[:, None] * (q1 - q0)[number]
        # Bounds from spheres and planes exclude most pairs; only the rest is measured exactly.
        left &= engine.bounds(q, LOOKS) - least[number] <= rates[number] * half
        for row in np.flatnonzero(left.any(axis=1)):
            if found[number[row]] >= 0:
                continue
            engine.place(q[row])
            for n in np.flatnonzero(left[row]):
                distance = engine.near_pair(int(n)).distance
                need = least[number[row], n]
                if distance <= need:
                    found[number[row]] = moment[row]
                    break
                left[row, n] = distance - need <= rates[number[row], n] * half
        on = left.any(axis=1) & np.isnan(found[number])
        half /= 2
        # Both halves of an interval inherit the pairs that its middle did not cover.
        number, left = np.tile(number[on], 2), np.tile(left[on], (2, 1))
        moment = np.concatenate([moment[on] - half, moment[on] + half])
    return found


def _radius(solid: Solid) -> float:
    """Return a bound on the distance of any point of a part from the frame of its joint [m]."""
    corners = solid.shape.corners @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    # The farthest corner bounds all points of a convex part, and the hull of any other.
    return float(np.linalg.norm(corners, axis=1).max()) + solid.shape.thickness + solid.padding + TOUCH
