"""What is asked: poses that the judge's forward kinematics gives, so that no solver's own arithmetic makes them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple
from zlib import crc32

import numpy as np

from .judge import Judge
from .protocol import Array

Rng = np.random.Generator


class Asked(NamedTuple):
    """Targets of one question to one arm."""

    poses: Array
    """(k, 4, 4)"""
    starts: Array
    """Where a solver is to begin, (k, n), or (0, n) where none is given."""
    origins: Array
    """Joint values that reach the poses, (k, n), which no solver sees; (0, n) where there are none."""


@dataclass(frozen=True)
class Size:
    """How much of it all is measured."""

    name: str
    arms: int
    """The first of the thirty."""
    targets: float = 1.0
    """Of each question's count."""
    time: float = 1.0
    """Of each question's seconds, where the targets do not end before; what is asked of few arms has all of them."""
    few: int = 3
    """Arms that questions for a few are asked on."""
    swept: int = 3
    """Arms on which settings are chosen."""
    questions: tuple[str, ...] = ()
    """Names; all if there are none."""
    recommended: bool = True
    """Whether solvers are measured with their recommended settings, too, where others did best in the sweep."""


SIZES = {
    each.name: each
    for each in (
        Size("quick", 2, targets=0.2, few=2, swept=1),
        Size("table", 6, swept=2, questions=("random", "singular"), recommended=False),
        Size("half", 30, targets=0.5, time=0.3, swept=2),
        Size("full", 30),
    )
}

SLICES = 8
"""Slices of the targets of an arm: each solver gets a slice, then each the next one. A median of eight has an interval."""


@dataclass(frozen=True)
class Question:
    """One question."""

    name: str
    title: str
    count: int
    """Targets an arm."""
    seconds: float
    """For all targets of an arm; what has not been asked by then is left out, and the page says how many."""
    make: Callable[[Judge, int, Rng], Asked]
    way: str = "solve"
    """How the worker asks, see `benchmarks.field.worker`."""
    tuned: bool = True
    """Whether it is asked with the best settings of the sweep, too."""
    few: bool = False
    """Whether only a few arms are asked."""

    @property
    def timed(self) -> bool:
        """Whether each target is a call, until time is up."""
        return self.way in ("solve", "start", "position", "branches")

    def slices(self, count: int) -> list[tuple[int, int]]:
        """The first of each slice of so many targets, and the one after its last; a question that is asked once has one."""
        number = min(SLICES, count) if self.timed or self.way == "batch" else 1
        return [(count * i // number, count * (i + 1) // number) for i in range(number)]

    def of(self, judge: Judge, seed: int, size: Size) -> Asked:
        """The targets for an arm; the same for the same seed."""
        count = max(int(self.count * size.targets), 1)
        return self.make(
            judge, count, np.random.default_rng([seed, crc32(f"{self.name} {judge.arm.name}".encode())])
        )


def reached(judge: Judge, origins: Array, starts: Array | None = None) -> Asked:
    """The poses of joint values."""
    none = np.zeros((0, origins.shape[1]))
    return Asked(judge.fk(origins), none if starts is None else starts, origins)


def uniform(judge: Judge, count: int, rng: Rng) -> Array:
    """Joint values, uniform inside the limits, (count, n)."""
    return rng.uniform(judge.arm.lower, judge.arm.upper, (count, len(judge.arm.lower)))


def at_random(judge: Judge, count: int, rng: Rng) -> Asked:
    """Anywhere."""
    return reached(judge, uniform(judge, count, rng))


def singular(judge: Judge, count: int, rng: Rng) -> Asked:
    """Turns of 0 and ±π/2 in half the joints, then a thousandth of a radian aside; the most singular tenth of them."""
    q = uniform(judge, 10 * count, rng)
    turns = np.array([kind != "prismatic" for kind in judge.arm.kinds])
    quarter = rng.choice([0.0, np.pi / 2, -np.pi / 2], q.shape)
    chosen = turns & (rng.random(q.shape) < 0.5) & (quarter > judge.arm.lower) & (quarter < judge.arm.upper)
    aside = rng.choice([0.0, 1e-3], q.shape)
    q = np.clip(np.where(chosen, quarter + aside, q), judge.arm.lower, judge.arm.upper)
    return reached(judge, q[np.argsort(judge.least_singular(q), kind="stable")[:count]])


def at_limits(judge: Judge, count: int, rng: Rng) -> Asked:
    """Half the joints at a limit exactly, one of them at least; joints without limits are anywhere."""
    q = uniform(judge, count, rng)
    limited = np.array([kind != "continuous" for kind in judge.arm.kinds])
    at = limited & (rng.random(q.shape) < 0.5)
    at[np.arange(count), rng.choice(np.flatnonzero(limited), count)] = True
    ends = np.where(rng.random(q.shape) < 0.5, judge.arm.lower, judge.arm.upper)
    return reached(judge, np.where(at, ends, q))


def out_of_reach(judge: Judge, count: int, rng: Rng) -> Asked:
    """Turned as a pose within reach is, and one and a half times as far from the base as all links in a row."""
    poses = judge.fk(uniform(judge, count, rng))
    ways = rng.normal(size=(count, 3))
    poses[:, :3, 3] = 1.5 * judge.reach * ways / np.linalg.norm(ways, axis=1)[:, None]
    none = np.zeros((0, len(judge.arm.lower)))
    return Asked(poses, none, none)


def from_a_start(judge: Judge, count: int, rng: Rng) -> Asked:
    """A start inside the limits whose joints are each up to 0.1 rad (or m) from joint values that reach the pose."""
    starts = uniform(judge, count, rng)
    moved = np.clip(starts + rng.uniform(-0.1, 0.1, starts.shape), judge.arm.lower, judge.arm.upper)
    return reached(judge, moved, starts)


QUESTIONS = (
    Question("random", "Random poses", 200, 1.0, at_random),
    Question("singular", "Near singularities", 100, 0.4, singular),
    Question("limits", "At limits", 100, 0.4, at_limits),
    Question("unreachable", "Out of reach", 20, 0.4, out_of_reach),
    Question("position", "Position only", 100, 0.3, at_random, "position"),
    Question("start", "A given start", 100, 0.3, from_a_start, "start"),
    Question("branches", "Every answer", 50, 0.5, at_random, "branches", tuned=False),
    Question("batch", "Batches", 2000, 2.0, at_random, "batch", tuned=False, few=True),
    Question("first", "The first answer", 5, 30.0, at_random, "first", tuned=False, few=True),
)
"""In the order in which they are asked and shown; docs/field.md says what each is."""

SWEEP = Question("sweep", "Sweep", 100, 0.7, at_random)
"""What settings are chosen by."""


def fits(question: Question, judge: Judge, place: int, size: Size) -> bool:
    """Whether an arm, the so-and-so-many-th, is asked this; all answers are counted where they are finitely many."""
    if question.name == "branches":
        return len(judge.arm.joints) == 6
    return not question.few or place < size.few
