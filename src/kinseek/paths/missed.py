"""Prove which missed poses of a path are out of reach, many poses at once, within a budget for the whole path.

Suppose that no joint values bring the hand within a distance d and an angle of a pose, beyond the tolerances. Then no pose
within this distance and angle can be reached. So a run of missed poses is proved unreachable at once: by its middle pose,
with tolerances that cover all of it. If this proof fails, the halves of the run are tried. Far out of reach one proof covers
hundreds of poses.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.proof.progress import ENDED
from kinseek.problem import Problem
from kinseek.proof.boxes import Watch, excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict
from kinseek.support.deadline import Deadline
from kinseek.virtual_joints import extended

from .path import Path, intervals

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST, EACH = 500_000, 2_000
"""Most boxes of all proofs for a path, and additional boxes for every missed pose. This takes some seconds, unless thousands
of poses are missed."""

ROUNDS = (10_000, 200_000)
"""Most boxes of a proof, in each round over the poses that are still open. Thousands are enough for six joints, so a pose
that takes very many is tried last."""

CLEAR = 2.0
"""Several poses are tried together if the hand's errors exceed their common tolerances by this factor. Not examined
further."""

ROUNDING = 1e-7
"""Margin added to the measured distances between poses, relative to their distance from the base, and in [rad]. It exceeds
the rounding errors, also for angles near half a turn."""


class Missed(NamedTuple):
    """Results for the missed poses of a path, (N,) each; a missed pose with both flags False is undecided."""

    out_of_reach: Flags
    """Poses that are proved unreachable: no joint values inside the limits meet the tolerances."""
    in_reach: Flags
    """Poses that can be reached by other joint values than those of the path."""


def judge_missed(path: Path, missed: Flags, threads: int | None, deadline: Deadline | None = None) -> Missed:
    """Try to prove that missed poses, (N,), are out of reach; of a goal with ranges by virtual joints for them."""
    deadline = Deadline() if deadline is None else deadline
    search = _Search(path, MOST + EACH * int(missed.sum()), threads, deadline)
    # Lengths and angles alone decide most poses that are far out of reach, without any box.
    for i in np.flatnonzero(missed).tolist():
        if deadline.passed:
            break
        search.out_of_reach[i] = excluded(search.at(i), 0).outcome == ENDED
    for budget in ROUNDS:
        for first, last in intervals(missed & ~search.out_of_reach & ~search.in_reach):
            search.decide(first, last, budget)
    return Missed(search.out_of_reach, search.in_reach & search.exact)


class _Search:
    def __init__(self, path: Path, budget: int, threads: int | None, deadline: Deadline) -> None:
        self.deadline = deadline
        more = extended(path.problem)
        self.exact = more.exact and not more.leverage
        self.problem, self.q, self.threads, self.left = (
            more.loosened,
            more.with_virtual(path.q),
            threads,
            budget,
        )
        self.out_of_reach, self.in_reach = np.zeros((2, len(path)), dtype=np.bool_)

    def decide(self, first: int, last: int, budget: int) -> None:
        """Try to decide poses first … last, with `budget` boxes per proof; poses are combined only in the first round."""
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
        # One proof for several poses saves time only while their common tolerances stay small.
        if budget == ROUNDS[0] and self.stays_clear(wide, first, last):
            together = excluded(wide, most, threads=self.threads, watch=Watch(self.deadline))
            self.left -= together.boxes
            if together.outcome == ENDED:
                self.out_of_reach[first : last + 1] = True
                return
        self.decide(first, middle, budget)
        self.decide(middle + 1, last, budget)

    def at(self, i: int) -> Problem:
        """Return the problem of one pose."""
        return Problem(self.problem.mechanism, self.problem.goal.at(self.problem.goal.target[i]))

    def holding(self, first: int, last: int) -> Problem:
        """Return the problem of the middle pose with tolerances that cover poses first … last and their own tolerances."""
        goal, middle = self.problem.goal, (first + last) // 2
        distance, turn = farthest(goal.targets[first : last + 1], goal.targets[middle], goal.columns)
        wide = replace(
            goal.at(goal.target[middle]),
            position_tolerance=goal.position_tolerance + distance,
            orientation_tolerance=goal.orientation_tolerance + turn,
        )
        return Problem(self.problem.mechanism, wide)

    def stays_clear(self, wide: Problem, first: int, last: int) -> bool:
        """Return whether the path's errors are so large at all poses of a run that a common proof may succeed."""
        q = np.ascontiguousarray(self.q[first : last + 1])
        goal = wide.goal.at(np.repeat(wide.goal.target[None], len(q), axis=0))
        errors = goal.measure(wide.arrays, q)
        clear = errors[:, 0] > CLEAR * goal.position_tolerance
        clear |= errors[:, 1] > CLEAR * goal.orientation_tolerance
        return bool(clear.all())


def farthest(targets: Array, one: Array, columns: int) -> tuple[float, float]:
    """Return the largest distance [m] and angle [rad] of targets, (k, 3, 4), from one of them, slightly enlarged.

    `columns` is the number of columns of the rotation that count, see `Goal.columns`.
    """
    distance = float(np.linalg.norm(targets[:, :, 3] - one[:, 3], axis=1).max())
    size = float(np.abs(targets[:, :, 3]).max())
    chord = np.linalg.norm((targets - one)[:, :, :columns], axis=(1, 2)).max(initial=0.0)
    half = min(float(chord) / (2.0 * math.sqrt(2.0 if columns == 3 else 1.0)), 1.0)
    return distance * (1.0 + ROUNDING) + ROUNDING * size, 2.0 * math.asin(half) + ROUNDING
