"""Which missed poses of a path are out of reach: proved of many poses at once, and within a budget for all of them.

If no joint values bring the hand within d and an angle of a pose, beyond the tolerances, then none of the poses that lie so
close to it can be reached. So a stretch of missed poses is asked of its middle, with tolerances that hold all of it, and
where that proves nothing, of its halves. Far out of reach one question answers for hundreds of poses.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.deadline import Deadline
from kinseek.kernels.proof.progress import ENDED
from kinseek.problem import Problem
from kinseek.proof.boxes import Watch, excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict

from .intervals import intervals
from .path import Path

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST, EACH = 500_000, 2_000
"""Boxes of all questions about a path, and so many more for every pose that is missed: some seconds, unless they are
thousands."""

ROUNDS = (10_000, 200_000)
"""Boxes that a question may take, round after round where poses are still open: on six joints thousands are enough, so that
one pose that takes very many is asked last."""

CLEAR = 2.0
"""Many poses are asked about at once if the hand is seen to stay so many times as far away as they are apart. By trial."""

ROUNDING = 1e-7
"""By so much more than measured poses are taken to be apart, relative to where they are, and [rad]: more than rounding
makes, of an angle near half a turn as well."""


class Missed(NamedTuple):
    """What is known of the poses that a path misses, (N,) each; where both are False of a missed pose, nothing is."""

    out_of_reach: Flags
    """Proved: no joint values inside the limits meet the tolerances."""
    in_reach: Flags
    """There are joint values that do, though not where the path goes by."""


def judge_missed(path: Path, missed: Flags, threads: int | None, deadline: Deadline | None = None) -> Missed:
    """Try to prove of missed poses, (N,), that they are out of reach; of ranges nothing is proved."""
    deadline = Deadline() if deadline is None else deadline
    search = _Search(path, MOST + EACH * int(missed.sum()), threads, deadline)
    if path.problem.goal.ranges is not None:
        return Missed(search.out_of_reach, search.in_reach)
    # Lengths and angles alone tell of most poses that are far out, without a box.
    for i in np.flatnonzero(missed).tolist():
        if deadline.passed:
            break
        search.out_of_reach[i] = excluded(search.at(i), 0).outcome == ENDED
    for budget in ROUNDS:
        for first, last in intervals(missed & ~search.out_of_reach & ~search.in_reach):
            search.ask(first, last, budget)
    return Missed(search.out_of_reach, search.in_reach)


class _Search:
    def __init__(self, path: Path, budget: int, threads: int | None, deadline: Deadline) -> None:
        self.deadline = deadline
        self.problem, self.q, self.threads, self.left = path.problem, path.q, threads, budget
        self.out_of_reach, self.in_reach = np.zeros((2, len(path)), dtype=np.bool_)

    def ask(self, first: int, last: int, budget: int) -> None:
        """Ask about poses first … last, with so many boxes a question; about many at once in the first round alone."""
        most = min(budget, self.left)
        if most <= 0 or self.deadline.passed:
            return
        if first == last:
            one = prove(self.at(first), budget=most, threads=self.threads, deadline=self.deadline)
            self.left -= one.boxes
            self.out_of_reach[first] = one.verdict is Verdict.UNREACHABLE
            self.in_reach[first] = one.verdict is Verdict.REACHABLE
            return
        middle, wide = (first + last) // 2, self.holding(first, last)
        if budget == ROUNDS[0] and self.stays_clear(wide, first, last):
            together = excluded(wide, most, threads=self.threads, watch=Watch(self.deadline))
            self.left -= together.boxes
            if together.outcome == ENDED:
                self.out_of_reach[first : last + 1] = True
                return
        self.ask(first, middle, budget)
        self.ask(middle + 1, last, budget)

    def at(self, i: int) -> Problem:
        """One pose, as it was asked."""
        return Problem(self.problem.mechanism, self.problem.goal.at(self.problem.goal.target[i]))

    def holding(self, first: int, last: int) -> Problem:
        """The pose in the middle, with tolerances within which all poses first … last lie, and what they tolerate."""
        goal, middle = self.problem.goal, (first + last) // 2
        distance, turn = farthest(goal.targets[first : last + 1], goal.targets[middle], goal.columns)
        wide = replace(
            goal.at(goal.target[middle]),
            position_tolerance=goal.position_tolerance + distance,
            orientation_tolerance=goal.orientation_tolerance + turn,
        )
        return Problem(self.problem.mechanism, wide)

    def stays_clear(self, wide: Problem, first: int, last: int) -> bool:
        """Are the joint values of the path so far from all poses of a question that the answer may be no?"""
        q = np.ascontiguousarray(self.q[first : last + 1])
        goal = wide.goal.at(np.repeat(wide.goal.target[None], len(q), axis=0))
        errors = goal.measure(wide.arrays, q)
        clear = errors[:, 0] > CLEAR * goal.position_tolerance
        clear |= errors[:, 1] > CLEAR * goal.orientation_tolerance
        return bool(clear.all())


def farthest(targets: Array, one: Array, columns: int) -> tuple[float, float]:
    """How far targets, (k, 3, 4), are from one of them at most [m], and turned from it [rad], and a little more.

    Columns are those of the rotation that count, see `Goal.columns`.
    """
    distance = float(np.linalg.norm(targets[:, :, 3] - one[:, 3], axis=1).max())
    size = float(np.abs(targets[:, :, 3]).max())
    chord = np.linalg.norm((targets - one)[:, :, :columns], axis=(1, 2)).max(initial=0.0)
    half = min(float(chord) / (2.0 * math.sqrt(2.0 if columns == 3 else 1.0)), 1.0)
    return distance * (1.0 + ROUNDING) + ROUNDING * size, 2.0 * math.asin(half) + ROUNDING
