"""How joints turn on a path: copies inside the limits, and arms whose limits are opened so that no branch ends at one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinseek.caching import WeakCache
from kinseek.errors import InvalidProblem
from kinseek.kernels.paths.viterbi import COPIED, ENDLESS, ROOM, STRAIGHT
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import CONTINUOUS, REVOLUTE
from kinseek.turns import TURN

Array = NDArray[np.float64]

MOST_COPIES = 20_000
"""Copies of an answer at most: each is a node of every layer, and a million of them take minutes and gigabytes."""


class Turning:
    """Of each joint of an arm: how it turns, and how many copies of a value its limits hold."""

    def __init__(self, chain: SerialChain) -> None:
        """Look at the limits.

        Raises:
            InvalidProblem: They allow more than `MOST_COPIES` of an answer.
        """
        self.lower, self.upper = chain.lower, chain.upper
        free = chain.periodic & chain.turns
        endless = chain.endless & free
        self.kind = np.where(endless, ENDLESS, np.where(free, COPIED, STRAIGHT)).astype(np.int64)
        """See `kernels.paths.graph.STRAIGHT`, (n,)."""
        width = np.where(self.kind == COPIED, self.upper - self.lower, 0.0)
        self.copies = 1 + np.floor(np.maximum(width - 2 * ROOM, 0.0) / TURN).astype(np.int64)
        """Copies at most of each joint, (n,); one more exactly at the ends of a range of whole turns is left out."""
        self.units = np.concatenate([[1], np.cumprod(self.copies)[:-1]]).astype(np.int64)
        """What a turn of each joint counts in the number of a node, (n,)."""
        self.total = math.prod(self.copies.tolist())
        """Copies at most of an answer."""
        if self.total > MOST_COPIES:
            turned = zip(chain.joint_names, self.copies.tolist(), strict=True)
            report = ", ".join(f"{joint!r} {count}" for joint, count in turned if count > 1)
            raise InvalidProblem(
                f"turned by the full turns that the limits of {chain.name!r} allow ({report}), each answer to a pose is "
                f"there {self.total:,} times; a path chooses among at most {MOST_COPIES:,}: narrow the limits by with_limits"
            )
        self.open_lower = np.where(endless, -np.inf, self.lower)
        """Limits where a joint without any has none, (n,)."""
        self.open_upper = np.where(endless, np.inf, self.upper)

    def first_turn(self, q: Array) -> Array:
        """Values of joints with copies in the first turn of their range, (..., n)."""
        turns = np.floor((q - (self.lower - ROOM)) / TURN)
        return np.where(self.kind == COPIED, q - TURN * turns, q)

    def inside(self, q: Array) -> NDArray[np.bool_]:
        """Of values in the first turn, (..., n): do they lie inside the limits, with some room for rounding?"""
        fits = (q >= self.lower - ROOM) & (q <= self.upper + ROOM)
        return np.asarray((fits | (self.kind == ENDLESS)).all(axis=-1))

    def at_lower_end(self, q: Array) -> NDArray[np.bool_]:
        """Of values in the first turn, (..., n): does one more copy than was counted lie at the upper end of the range?"""
        return np.asarray((self.kind == COPIED) & (q + self.copies * TURN <= self.upper + ROOM))

    @property
    def off_upper_end(self) -> Array:
        """What first turns such a copy has, a rounding off the end, (n,)."""
        return self.lower + TURN - 3 * ROOM

    def step(self, gap: Array) -> Array:
        """Differences of values, full turns that make no difference taken off, (..., n)."""
        return np.where(self.kind == STRAIGHT, gap, gap - TURN * np.round(gap / TURN))

    def way(self, gap: Array) -> Array:
        """As `step`, between joint values as they are: a full turn makes no difference to endless joints alone, (..., n)."""
        return np.where(self.kind == ENDLESS, gap - TURN * np.round(gap / TURN), gap)

    def node_values(self, q: Array, turns: NDArray[np.int64]) -> Array:
        """Values of nodes: answers in the first turn, (k, n), with their turns as one number, (k,)."""
        digits = turns[:, None] // self.units % self.copies
        return np.asarray(q + TURN * digits)

    def whole_turns(self, q: Array) -> Array:
        """The whole turns of endless joints nearest to joint values, (..., n), [rad]; of others none."""
        return np.where(self.kind == ENDLESS, TURN * np.round(q / TURN), 0.0)

    def off_ends(self, q: Array) -> Array:
        """Joint values a rounding off the ends of ranges, (..., n), where copies are left out."""
        return np.where(self.kind == COPIED, np.clip(q, self.lower + 2 * ROOM, self.upper - 2 * ROOM), q)

    def turns_of(self, q: Array) -> int:
        """The turns of joint values inside the limits and off their ends, (n,), as one number."""
        digits = np.round((q - self.first_turn(q)) / TURN).astype(np.int64)
        return int((np.clip(digits, 0, self.copies - 1) * self.units).sum())

    def unwrapped(self, q: Array) -> Array:
        """The same path with endless joints turned the short way from row to row, (N, n)."""
        steps = self.step(np.diff(q, axis=0))
        smooth = np.concatenate([q[:1], q[:1] + np.cumsum(steps, axis=0)])
        return np.where(self.kind == ENDLESS, smooth, q)


_opened: WeakCache[SerialChain, str, SerialChain] = WeakCache()


def opened(chain: SerialChain) -> SerialChain:
    """The arm with limits of a whole turn where a joint has less: a branch then ends at singularities alone."""
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
