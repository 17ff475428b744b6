"""The joint values in which a motion is planned: their limits, how they turn, and which motions are free."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain
from kinseek.support.turns import nearest_turns
from kinseek.timing.obstacles import Obstacles
from kinseek.timing.tip import levers

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.1
"""Bound on the motion of any point of the arm between neighbouring samples of a motion [m]. The proof checks what the
samples miss. Found by trial with `python -m benchmarks.planning`."""

LEAST = 4
"""Samples of a motion at least."""


class Space:
    """Joint values of an arm in a scene, (n,), [rad] or [m].

    Args:
        chain: The arm.
        scene: The scene.
        clearance: Minimum distance of bodies [m].
        begin: Joint values at the begin of the motion, (n,).
        ends: Joint values at which it may end, (k, n).
    """

    def __init__(
        self, chain: SerialChain, scene: Obstacles, clearance: float, begin: Array, ends: Array
    ) -> None:
        """Bound the samples: a full turn around the begin and the ends is enough for joints with limits of many turns."""
        self.chain, self.scene, self.clearance = chain, scene, clearance
        self.endless = chain.endless
        given = np.concatenate([begin[None], ends])
        low, high = given.min(axis=0) - np.pi, given.max(axis=0) + np.pi
        self.lower = np.where(
            self.endless, begin - np.pi, np.maximum(chain.lower, np.where(chain.turns, low, -np.inf))
        )
        self.upper = np.where(
            self.endless, begin + np.pi, np.minimum(chain.upper, np.where(chain.turns, high, np.inf))
        )
        reach = np.zeros(chain.dof)
        np.add.at(reach, chain.leader, np.abs(chain.multiplier) * levers(chain))
        self.reach = reach
        """How far a unit of motion of each joint moves a point of the arm at most, about, (n,)."""
        root = _root(chain.dof)
        self._steps = root ** -np.arange(1.0, chain.dof + 1.0)

    def samples(self, first: int, count: int) -> Array:
        """Return some joint values of a fixed sequence that fills the space evenly, (count, n) (*Roberts 2018*)."""
        numbers = np.arange(first + 1, first + count + 1)[:, None]
        share = (0.5 + numbers * self._steps) % 1.0
        return np.asarray(self.lower + share * (self.upper - self.lower))

    def way(self, gap: Array) -> Array:
        """Return differences of joint values, (..., n), the shorter way round for continuous joints."""
        return gap - self.turns(gap) if self.endless.any() else gap

    def turns(self, gap: Array) -> Array:
        """Return the full turns of continuous joints in differences of joint values, (..., n); 0 for other joints."""
        return np.where(self.endless, nearest_turns(gap), 0.0)

    def free(self, q: Array) -> Flags:
        """Return which joint values, (k, n), are free, (k,)."""
        return np.asarray(self.scene.free(q, self.clearance), dtype=np.bool_)

    def free_part(self, begins: Array, ways: Array) -> Array:
        """Return which part of each motion is free up to its first contact, by samples, (k,) from 0 to 1.

        Args:
            begins: Joint values at which the motions begin, (k, n); they are free.
            ways: Differences to their ends, (k, n).
        """
        if not len(ways):
            return np.zeros(0)
        counts = np.maximum(np.ceil(np.abs(ways) @ self.reach / APART), LEAST).astype(np.int64)
        firsts = np.cumsum(counts) - counts
        which = np.repeat(np.arange(len(ways)), counts)
        number = np.arange(len(which)) - firsts[which] + 1
        q = begins[which] + (number / counts[which])[:, None] * ways[which]
        touching = np.where(self.free(q), len(which) + 1, number)
        return np.asarray(np.minimum(np.minimum.reduceat(touching, firsts) - 1, counts) / counts)

    def proved(self, begins: Array, ends: Array) -> Flags:
        """Return which linear motions, (k, n) to (k, n), are proved free, (k,)."""
        if not len(begins):
            return np.zeros(0, dtype=np.bool_)
        return np.asarray(self.scene.free_motion(begins, ends, self.clearance), dtype=np.bool_)


def _root(dof: int) -> float:
    """Return the root above 1 of x**(n + 1) = x + 1: its powers give the sequence of *Roberts 2018*."""
    x = 2.0
    for _ in range(64):
        x = (1.0 + x) ** (1.0 / (dof + 1.0))
    return x
