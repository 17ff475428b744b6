"""The joint values in which a motion is planned: their limits, how they turn, and which motions are free."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.robots.chain import SerialChain
from kinseek.support.turns import nearest_turns
from kinseek.timing.obstacles import Obstacles
from kinseek.timing.tip import levers

from .along import Along

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

APART = 0.1
"""Bound on the motion of any point of the arm between neighbouring samples of a motion [m]. The proof checks what the
samples miss. Found by trial with `python -m benchmarks.planning`."""

LEAST = 4
"""Samples of a motion at least."""

NEAR = 0.5
"""Size of a part of the space around joint values, along each axis. Found by trial with `python -m benchmarks.planning`."""

STEP = 0.05
"""Length of the motions along which a goal holds [rad or m]; between their ends it holds nearly. Not examined further."""

MOST_STEPS = 60
"""Such motions in a row."""

PROGRESS = 0.1
"""A motion along which a goal holds ends where a step leads nearer to its end by less than this fraction of the step."""

SAME = 1e-6
"""Projections of joint values at which a goal holds change them by less than this [rad or m]."""


class Space:
    """Joint values of an arm in a scene, (n,), [rad] or [m].

    Args:
        chain: The arm.
        scene: The scene.
        clearance: Minimum distance of bodies [m].
        begin: Joint values at the begin of the motion, (n,).
        ends: Joint values at which it may end, (k, n).
        along: What holds all along the motion.
    """

    def __init__(
        self,
        chain: SerialChain,
        scene: Obstacles,
        clearance: float,
        begin: Array,
        ends: Array,
        along: Along | None = None,
    ) -> None:
        """Bound the samples: a full turn around the begin and the ends is enough for joints with limits of many turns."""
        self.chain, self.scene, self.clearance, self.along = chain, scene, clearance, along
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

    def around(self, q: Array, samples: Array) -> Array:
        """Return q, (k, n), moved by `NEAR` times the way of samples, (k, n), from the middle of the space."""
        return np.clip(q + NEAR * (samples - (self.lower + self.upper) / 2.0), self.lower, self.upper)

    def way(self, gap: Array) -> Array:
        """Return differences of joint values, (..., n), the shorter way round for continuous joints."""
        return gap - self.turns(gap) if self.endless.any() else gap

    def turns(self, gap: Array) -> Array:
        """Return the full turns of continuous joints in differences of joint values, (..., n); 0 for other joints."""
        return np.where(self.endless, nearest_turns(gap), 0.0)

    def free(self, q: Array, margin: float = 0.0) -> Flags:
        """Return which joint values, (k, n), are free with a margin [m] beyond the clearance, (k,)."""
        return np.asarray(self.scene.free(q, self.clearance + margin), dtype=np.bool_)

    def free_part(self, begins: Array, ways: Array, margin: float = 0.0) -> Array:
        """Return which part of each motion is free up to its first contact, by samples, (k,) from 0 to 1.

        Args:
            begins: Joint values at which the motions begin, (k, n); they are free.
            ways: Differences to their ends, (k, n).
            margin: Distance that is kept beyond the clearance [m].
        """
        if not len(ways):
            return np.zeros(0)
        counts = np.maximum(np.ceil(np.abs(ways) @ self.reach / APART), LEAST).astype(np.int64)
        return np.asarray(
            self.scene.free_samples(begins, begins + ways, counts, self.clearance + margin) / counts
        )

    def advance(self, begins: Array, ways: Array) -> tuple[list[Array], Flags]:
        """Move from joint values towards others as far as is free, by samples.

        Args:
            begins: Joint values at which the motions begin, (k, n); they are free.
            ways: Differences to their ends, (k, n).

        Returns:
            The joint values at the ends of the linear motions of each, (m, n), and whether it gets to its end, (k,).
        """
        if self.along is not None:
            return self._advance_along(self.along, begins, ways)
        parts = self.free_part(begins, ways)
        return list((begins + parts[:, None] * ways)[:, None]), parts == 1.0

    def _advance_along(self, along: Along, begins: Array, ways: Array) -> tuple[list[Array], Flags]:
        """Do so in short steps, each of which is projected onto the goal (*Berenson et al. 2009*, CBiRRT)."""
        rows, ends = [begins[k : k + 1] for k in range(len(begins))], begins + ways
        reached, going = np.zeros(len(begins), dtype=np.bool_), np.arange(len(begins))
        for _ in range(MOST_STEPS):
            if not len(going):
                break
            here = np.array([rows[k][-1] for k in going])
            far = np.linalg.norm(ends[going] - here, axis=1)
            share = np.minimum(1.0, STEP / np.maximum(far, 1e-300))
            q, on = along.projected(here + share[:, None] * (ends[going] - here))
            # Nodes fulfil the goal, samples do not.
            there = (far <= STEP) & on & (np.abs(q - ends[going]).max(axis=1) < SAME)
            q[there] = ends[going[there]]
            left = np.linalg.norm(ends[going] - q, axis=1)
            on &= there | (left < far - PROGRESS * np.minimum(far, STEP))
            on &= np.linalg.norm(q - here, axis=1) <= 2.0 * STEP
            on &= ((q >= self.lower) & (q <= self.upper)).all(axis=1)
            on[on] = self.free_part(here[on], (q - here)[on]) == 1.0
            for k, row in zip(going[on], q[on], strict=True):
                rows[k] = np.concatenate([rows[k], row[None]])
            reached[going[on & there]] = True
            going = going[on & ~there]
        return [each[1:] for each in rows], reached

    def proved(self, begins: Array, ends: Array, margin: float = 0.0) -> Flags:
        """Return which linear motions, (k, n) to (k, n), are proved free with a margin [m] beyond the clearance, (k,)."""
        if not len(begins):
            return np.zeros(0, dtype=np.bool_)
        free = self.scene.free_motion(begins, ends, self.clearance + margin, thorough=False)
        return np.asarray(free, dtype=np.bool_)


def _root(dof: int) -> float:
    """Return the root above 1 of x**(n + 1) = x + 1: its powers give the sequence of *Roberts 2018*."""
    x = 2.0
    for _ in range(64):
        x = (1.0 + x) ** (1.0 / (dof + 1.0))
    return x
