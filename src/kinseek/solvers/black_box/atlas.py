"""The atlas for black-box kinematics: look the goal up among samples, refine the nearest, and continue if that fails."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.base import Found
from kinseek.solvers.recording import Recorder
from kinseek.support.deadline import Deadline
from kinseek.support.turns import nearest_turns, shortest

from .evaluator import Evaluator
from .refine import Ends, into_range, squared, walk
from .samples import Samples, sample_joints, samples_of

Array = NDArray[np.float64]

SEEDS = 16
"""Seeds that are refined first, at once; half as many if every row runs Python code. Not examined further."""
FIRST_STEPS, MORE_STEPS = 12, 30
MORE = 48
"""Seeds of the second lookup. Not examined further."""
RESTARTS, ROUNDS = 64, 8
"""Starts of a round, half of them around the best, and number of rounds. Not examined further."""
BEST = 8
APART = 0.02
"""Smallest difference, as a fraction of the spans, between configurations that count as distinct. Not examined further."""
PROMISING = 1e-2
"""Weighted error, with lengths relative to the mechanism's, below which a goal may still be reached. Not examined
further."""
NEAR = 32
MOST_PASSES = ROUNDS + 5
"""Most passes of a trace: the look-up, a walk from `near`, two of samples, the restarts, and the nearest pose."""


def solve_target(
    box: Mechanism, problem: Problem, count: int, deadline: Deadline, recorder: Recorder | None = None
) -> Found:
    """Solve one target."""
    samples = samples_of(box, count)
    evaluator = Evaluator(box, problem, deadline)
    seeds = samples.nearest(problem.goal, evaluator.target, SEEDS + MORE)

    def record(name: str, q: Array) -> None:
        if recorder:
            recorder.add(name, q, evaluator.spent, memory=samples.memory)

    record("look-up", samples.q[seeds[0]])
    if problem.near is not None:
        q = nearest_to(evaluator, samples, problem, seeds)
        record(f"from near and {NEAR} samples", samples.q[seeds[0]] if q is None else q)
        if q is not None:
            return Found(q, evaluator.spent, out_of_time=evaluator.out_of_time)
    best = Best(evaluator, samples, samples.q[seeds[0]])
    first = SEEDS if box.cheap else SEEDS // 2
    # The nearest samples usually lead to a solution, so a few of them are tried alone before many are refined.
    for begin, end, steps in ((0, first, FIRST_STEPS), (first, SEEDS + MORE, MORE_STEPS)):
        solved = best.take(walk(evaluator, samples.length, samples.q[seeds[begin:end]], steps))
        record(f"samples {begin + 1} to {min(end, len(seeds))}", best.result())
        if solved:
            return Found(best.result(), evaluator.spent, out_of_time=evaluator.out_of_time)
    # Half of the starts of a round are spread over the box, the other half lie around the best configurations: the goal may
    # be missed because it lies elsewhere, or because descents end just beside it.
    starts = sample_joints(box, RESTARTS * ROUNDS)
    for round_number in range(ROUNDS):
        rows = starts[round_number::ROUNDS].copy()
        around = into_range(box, best.q[np.arange(RESTARTS // 2) % len(best.q)] + kicks(box, round_number))
        rows[: RESTARTS // 2] = around
        solved = best.take(walk(evaluator, samples.length, rows, MORE_STEPS))
        record(f"restarts, round {round_number + 1}", best.result())
        if solved:
            return Found(best.result(), evaluator.spent, out_of_time=evaluator.out_of_time)
        if best.seems_unreachable():
            break
    if problem.nearest:
        best.polish()
    return Found(best.result(), evaluator.spent, out_of_time=evaluator.out_of_time)


def kicks(box: Mechanism, round_number: int) -> Array:
    """Return steps away from the best, smaller in every round, (RESTARTS / 2, n)."""
    centred = sample_joints(box, RESTARTS // 2) - (box.lower + box.upper) / 2
    return np.asarray(centred * 0.5 ** (1 + round_number))


def nearest_to(
    evaluator: Evaluator, samples: Samples, problem: Problem, seeds: NDArray[np.int64]
) -> Array | None:
    """Walk from `near` and from the samples nearest to it; return the solution nearest to it, or None."""
    box = evaluator.box
    start = problem.start
    far = distance(box, samples.q[seeds], start)
    chosen = seeds[np.argsort(far, kind="stable")[:NEAR]]
    rows = np.concatenate([start[None], samples.q[chosen]])
    ends = walk(evaluator, samples.length, rows, MORE_STEPS, first_only=False)
    if not ends.solved.any():
        return None
    q = ends.q[ends.solved]
    assert problem.near is not None
    # A joint with room for whole turns uses the turn that is nearest to `near`.
    with np.errstate(invalid="ignore"):
        turns = np.where(box.full, nearest_turns(problem.near - q), 0.0)
    moved = q + turns
    q = np.where(box.endless | ((moved >= box.lower) & (moved <= box.upper)), moved, q)
    return np.asarray(q[np.argmin(distance(box, q, problem.near))])


def distance(box: Mechanism, q: Array, near: Array) -> Array:
    """Return distances in joint space, the short way round for continuous joints, (k, n) -> (k,)."""
    away = q - near
    away = np.where(box.endless, shortest(away), away)
    return np.asarray(np.sqrt((away**2).sum(axis=1)))


def distinct(box: Mechanism, q: Array) -> list[int]:
    """Return the first BEST rows of joint values, (k, n), that are not close to a row before them."""
    scaled = q / np.where(box.span > 0, box.span, 1.0)
    chosen: list[int] = []
    for i, row in enumerate(scaled):
        if len(chosen) == BEST:
            break
        if not chosen or np.abs(scaled[chosen] - row).max(axis=1).min() > APART:
            chosen.append(i)
    return chosen


class Best:
    """The best configurations found, for a goal that is hard or out of reach."""

    def __init__(self, evaluator: Evaluator, samples: Samples, fallback: Array) -> None:
        """Start with a fallback sample."""
        self.evaluator, self.length = evaluator, samples.length
        self.q = fallback[None]
        self.error = np.array([np.inf])
        self.solved: Array | None = None

    def take(self, ends: Ends) -> bool:
        """Keep the best of a walk; return whether one of its lanes is a solution."""
        if ends.solved.any():
            residual = squared(np.where(np.isnan(ends.away), np.inf, ends.away))
            self.solved = ends.q[np.argmin(np.where(ends.solved, residual, np.inf))]
            return True
        q = np.concatenate([self.q, ends.q])
        error = np.concatenate([self.error, self.evaluator.weighted(ends.away)])
        order = np.argsort(error, kind="stable")
        chosen = distinct(self.evaluator.box, q[order])
        self.q, self.error = q[order][chosen], error[order][chosen]
        return False

    def seems_unreachable(self) -> bool:
        """Return whether the best is so far from the goal that further starts are useless."""
        goal = self.evaluator.goal
        return bool(
            self.error[0] > PROMISING * (goal.position_weight * self.length + goal.orientation_weight)
        )

    def polish(self) -> None:
        """Minimise the weighted error itself."""
        self.take(walk(self.evaluator, self.length, self.q, MORE_STEPS, polish=True))

    def result(self) -> Array:
        """Return the best joint values found."""
        return self.q[0] if self.solved is None else self.solved
