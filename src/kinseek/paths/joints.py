"""Joints on a path: copies of solutions inside the limits, and arms with limits so wide that no branch ends there."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.kernels.paths.viterbi import COPIED, ENDLESS, ROOM, STRAIGHT, Turns
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import CONTINUOUS, REVOLUTE
from kinseek.support.caching import WeakCache
from kinseek.support.turns import TURN

Array = NDArray[np.float64]

MOST_COPIES = 20_000
"""Largest number of copies of a solution: each is a node of every layer, and a million of them take minutes and
gigabytes."""


class Turning:
    """For each joint of an arm: how it turns, and how many copies of a value its limits contain."""

    def __init__(self, chain: SerialChain) -> None:
        """Read the limits.

        Raises:
            InvalidProblem: They allow more than `MOST_COPIES` copies of a solution.
        """
        self.lower, self.upper = chain.lower, chain.upper
        free = chain.periodic & chain.turns
        endless = chain.endless & free
        self.kind = np.where(endless, ENDLESS, np.where(free, COPIED, STRAIGHT)).astype(np.int64)
        """Kind of each joint, see `kernels.paths.viterbi.STRAIGHT`, (n,)."""
        width = np.where(self.kind == COPIED, self.upper - self.lower, 0.0)
        self.copies = 1 + np.floor(np.maximum(width - 2 * ROOM, 0.0) / TURN).astype(np.int64)
        """Largest number of copies for each joint, (n,); the additional one exactly at the ends of a range of whole turns is
        excluded."""
        self.turns = Turns(self.lower, self.upper, self.kind, self.copies)
        """All of these, for kernels."""
        self.units = np.concatenate([[1], np.cumprod(self.copies)[:-1]]).astype(np.int64)
        """Stride of a turn of each joint in the number of a node, (n,)."""
        self.total = math.prod(self.copies.tolist())
        """Largest number of copies of a solution."""
        if self.total > MOST_COPIES:
            turned = zip(chain.joint_names, self.copies.tolist(), strict=True)
            report = ", ".join(f"{joint!r} {count}" for joint, count in turned if count > 1)
            raise InvalidProblem(
                f"with the full turns inside the limits of {chain.name!r} ({report}) each solution of a pose occurs "
                f"{self.total:,} times, expected at most {MOST_COPIES:,}: narrow the limits with with_limits"
            )
        self.open_lower = np.where(endless, -np.inf, self.lower)
        """Lower limits, -inf for joints without limits, (n,)."""
        self.open_upper = np.where(endless, np.inf, self.upper)

    def first_turn(self, q: Array) -> Array:
        """Move values of joints with copies into the first turn of their range, (..., n)."""
        turns = np.floor((q - (self.lower - ROOM)) / TURN)
        return np.where(self.kind == COPIED, q - TURN * turns, q)

    def inside(self, q: Array) -> NDArray[np.bool_]:
        """Return whether values in the first turn, (..., n), lie inside the limits, with a margin for rounding."""
        fits = (q >= self.lower - ROOM) & (q <= self.upper + ROOM)
        return np.asarray((fits | (self.kind == ENDLESS)).all(axis=-1))

    def at_lower_end(self, q: Array) -> NDArray[np.bool_]:
        """Return whether values in the first turn, (..., n), have one more copy than counted, at the range's upper end."""
        return np.asarray((self.kind == COPIED) & (q + self.copies * TURN <= self.upper + ROOM))

    @property
    def off_upper_end(self) -> Array:
        """First-turn values of such a copy, off the end by a rounding error, (n,)."""
        return self.lower + TURN - 3 * ROOM

    def step(self, gap: Array) -> Array:
        """Return differences of values, (..., n), reduced by full turns where these make no difference."""
        return np.where(self.kind == STRAIGHT, gap, gap - TURN * np.round(gap / TURN))

    def way(self, gap: Array) -> Array:
        """Like `step`, but between actual joint values: only endless joints are reduced by full turns, (..., n)."""
        return np.where(self.kind == ENDLESS, gap - TURN * np.round(gap / TURN), gap)

    def node_values(self, q: Array, turns: NDArray[np.int64]) -> Array:
        """Return joint values of nodes: solutions in the first turn, (k, n), with their turns as one number, (k,)."""
        digits = turns[:, None] // self.units % self.copies
        return np.asarray(q + TURN * digits)

    def whole_turns(self, q: Array) -> Array:
        """Return the whole turns nearest to joint values, (..., n), [rad]; zero for joints that are not endless."""
        return np.where(self.kind == ENDLESS, TURN * np.round(q / TURN), 0.0)

    def off_ends(self, q: Array) -> Array:
        """Move joint values, (..., n), off the ends of ranges by a rounding error where copies are excluded."""
        return np.where(self.kind == COPIED, np.clip(q, self.lower + 2 * ROOM, self.upper - 2 * ROOM), q)

    def turns_of(self, q: Array) -> int:
        """Encode the turns of joint values inside the limits and off their ends, (n,), as one number."""
        digits = np.round((q - self.first_turn(q)) / TURN).astype(np.int64)
        return int((np.clip(digits, 0, self.copies - 1) * self.units).sum())

    def unwrapped(self, q: Array) -> Array:
        """Return the same path with endless joints turned the short way from row to row, (N, n)."""
        steps = self.step(np.diff(q, axis=0))
        smooth = np.concatenate([q[:1], q[:1] + np.cumsum(steps, axis=0)])
        return np.where(self.kind == ENDLESS, smooth, q)


_opened: WeakCache[SerialChain, str, SerialChain] = WeakCache()


def opened(chain: SerialChain) -> SerialChain:
    """Return the arm with limits of at least a whole turn for every joint: a branch then ends only at singularities."""
    narrow = chain.periodic & chain.turns & (chain.upper - chain.lower < TURN)
    if not narrow.any():
        return chain

    def make() -> SerialChain:
        middle = (chain.lower + chain.upper) / 2
        lower = np.where(narrow, middle - np.pi, chain.lower)
        upper = np.where(narrow, middle + np.pi, chain.upper)
        kinds = tuple(
            REVOLUTE if kind == CONTINUOUS and n else kind
            for kind, n in zip(chain.kinds, narrow, strict=True)
        )
        return chain.limited(lower, upper, kinds)

    return _opened.of(chain).get("opened", make)
