"""Branch and bound: prove that a goal is out of reach, or say how near any pose could come.

Boxes of joint values are cut in half, again and again. Each is tested by the bounds of `kernels.bounds`: first what the
whole box can do, then one linear form of the hand's pose to second order, which also cuts the box from its sides. All
boxes gone: nothing inside the limits reaches the goal. Best box first, the same search encloses the least error.
(Land & Doig 1960; in robotics Rao, Asaithambi & Agrawal 1998, who solve inverse kinematics by interval analysis.)
"""

from __future__ import annotations

import itertools
import math
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from kinseek.certificate import Certificate, Verdict
from kinseek.deadline import Deadline
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.kernels.enclosure import enclose
from kinseek.kernels.exclusion import ENDED, FOUND, STOPPED, Search, exclude
from kinseek.kernels.gate import least_by_gate
from kinseek.problem import Problem
from kinseek.solution import Solution, conclude

from .atlas import Atlas
from .questions import ROUNDING, error_question, question, start_boxes

BUDGET = 2_000_000
"""Boxes, unless told otherwise: some seconds."""

SPREAD, SHRINK = 2.5, 0.5
"""Boxes that turn the hand by less [rad] are looked at to second order; those that shrink to less of their volume, again."""


PIECE = 8192
"""Boxes that one thread examines at a stretch: some milliseconds."""

HANDS = 16
"""Parts that the boxes left over are dealt into, each with a thread for a stretch."""


def prove(
    problem: Problem,
    *,
    gap: float | None = None,
    budget: int = BUDGET,
    answer: Solution | None = None,
    threads: int | None = None,
    deadline: Deadline | None = None,
) -> Certificate:
    """Prove that a goal is out of reach, or find joint values that reach it.

    Args:
        problem: One target.
        gap: If the goal is not reached: go on until the bounds on the least weighted error are this close, relative to the
            upper one, > 0; None leaves out this second search.
        budget: Boxes to examine at most, over both searches, >= 0; the bounds hold whenever the search stops.
        answer: A solution of the same problem, if there is one already; else the atlas is asked.
        threads: Threads that share the boxes; every core unless given. The certificate has the same bits.
        deadline: After which no further boxes are begun.

    Raises:
        InvalidProblem: A batch, an empty one included; a gap or budget out of its range.
    """
    if problem.goal.shape:
        raise InvalidProblem(f"a proof is about one target, got a batch of shape {problem.goal.shape}")
    if gap is not None and not 0.0 < gap < 1.0:
        raise InvalidProblem(f"gap must be in (0, 1), got {gap}")
    refuse_ranges(problem.goal)
    if budget < 0:
        raise InvalidProblem(f"budget must be at least 0 boxes, got {budget}")
    best = answer if answer is not None else Atlas().solve(replace(problem, budget=None))
    if best.success:
        return _certificate(problem, Verdict.REACHABLE, best.q, 0.0, 0, 0.0)
    search = excluded(problem, budget, threads=threads)
    if search.outcome == FOUND:
        return _certificate(problem, Verdict.REACHABLE, search.q, 0.0, search.boxes, 0.0)
    q = search.q if search.upper < best.weighted_error else best.q
    verdict, boxes, lower, largest = Verdict.UNDECIDED, search.boxes, 0.0, search.largest
    if search.outcome == ENDED:
        verdict, lower = Verdict.UNREACHABLE, least_outside(problem.goal)
        if boxes == 0:  # The gate knows how far out of reach the goal is.
            form, wanted, _ = error_question(problem, q, 0.5)
            lower = max(lower, least_by_gate(form, wanted, problem.arrays))
    if gap is not None:
        nearest = enclosed(problem, q, gap, budget - boxes, threads=threads)
        q, boxes, largest = nearest.q, boxes + nearest.boxes, nearest.largest
        lower = max(lower, nearest.lower)
    certificate = _certificate(problem, verdict, q, lower, boxes, largest)
    goal = problem.goal
    met = certificate.position_error <= goal.position_tolerance
    if met and certificate.orientation_error <= goal.orientation_tolerance:
        return replace(certificate, verdict=Verdict.REACHABLE, lower_bound=0.0)
    if lower > ROUNDING and lower > most_inside(goal):
        return replace(certificate, verdict=Verdict.UNREACHABLE)
    return certificate


def refuse_ranges(goal: Goal) -> None:
    """Refuse a goal with free axes or ranges.

    Raises:
        InvalidProblem: It has them.
    """
    if goal.kind == "box":
        raise InvalidProblem("nothing can be proved yet of a goal with free axes or ranges")


def least_outside(goal: Goal) -> float:
    """The least weighted error that misses a tolerance."""
    position = goal.position_weight * goal.position_tolerance
    angle = min(goal.orientation_tolerance, math.pi)
    turn = goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2
    return (position if goal.kind == "position" else min(position, turn)) * (1.0 - ROUNDING)


def most_inside(goal: Goal) -> float:
    """The largest weighted error within both tolerances."""
    position = goal.position_weight * goal.position_tolerance
    axes = goal.paper_columns
    angle = min(goal.orientation_tolerance, math.pi)
    return (position + axes * goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2) * (1.0 + ROUNDING)


def excluded(problem: Problem, budget: int, trust: float = 1.0, threads: int | None = None) -> Search:
    """Look in every box for joint values within both tolerances; see `exclude`.

    What a stretch of boxes leaves over is shared out, a box to a thread, round after round. What becomes of a box depends on
    nothing but itself, and the results are read in order: so the verdict, the witness and the count are the same for any
    number of threads.
    """
    goal = problem.goal
    form, wanted, roll = question(problem, trust)
    tuning = np.array([SPREAD, 2, SHRINK, goal.position_tolerance, goal.orientation_tolerance])
    boxes, arrays = start_boxes(problem.chain, roll.present), (problem.arrays, goal.arrays)

    def stretch(_: Search, some: Array, most: int) -> Search:
        return exclude(form, wanted, roll, *arrays, np.ascontiguousarray(some), tuning, most)

    search = exclude(form, wanted, roll, *arrays, boxes, tuning, min(budget, PIECE))
    return _shared(search, stretch, budget, sys.maxsize, threads)


def _shared(
    search: Search,
    stretch: Callable[[Search, Array, int], Search],
    budget: int,
    hands: int,
    threads: int | None,
    settle: Callable[[Search], Search] = lambda search: search,
) -> Search:
    """Go on with the boxes left, dealt out to so many `hands`, round after round, until none is left or the budget ends."""
    if not len(search.left) or search.boxes >= budget:
        return search
    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        while len(search.left):
            parts = min(hands, len(search.left))
            most = min(PIECE, (budget - search.boxes) // parts)
            if most == 0:
                break
            dealt = [search.left[part::parts] for part in range(parts)]
            pieces = pool.map(stretch, itertools.repeat(search), dealt, itertools.repeat(most))
            search = settle(_together(search, list(pieces)))
    return search


def _together(before: Search, pieces: Sequence[Search]) -> Search:
    """What a round of pieces adds to a search."""
    boxes = before.boxes + sum(piece.boxes for piece in pieces)
    best = min([before, *pieces], key=lambda piece: piece.upper)
    for piece in pieces:
        if piece.outcome == FOUND:
            return piece._replace(boxes=boxes)
    left, stuck = (
        np.concatenate([piece.left for piece in pieces]),
        max(piece.stuck for piece in [before, *pieces]),
    )
    return best._replace(
        outcome=STOPPED if len(left) or stuck > 0.0 else ENDED,
        boxes=boxes,
        largest=max([stuck, *(piece.largest for piece in pieces if len(piece.left))]),
        left=left,
        stuck=stuck,
        floor=min(before.floor, *(piece.floor for piece in pieces)),
    )


def enclosed(
    problem: Problem, q: Array, gap: float, budget: int, trust: float = 1.0, threads: int | None = None
) -> Search:
    """Enclose the least weighted error, starting from joint values q, (n,); see `enclose`.

    What a stretch of boxes leaves over is dealt out to `HANDS` threads or fewer, the same hands for any number of them, so
    that the bounds, the pose and the count are the same too.
    """
    chain = problem.chain
    form, wanted, roll = error_question(problem, q, gap, trust)
    arrays, tuning = (problem.arrays, problem.goal.arrays), np.array([SPREAD, SHRINK, gap])
    boxes = start_boxes(chain, roll.present)

    def stretch(known: Search, some: Array, most: int) -> Search:
        return enclose(form, wanted, roll, *arrays, np.ascontiguousarray(some), known.q, tuning, most)

    def settle(search: Search) -> Search:
        """Drop what the best pose known by now rules out; the boxes with the lowest bounds first."""
        ceiling = (1.0 - gap) * search.upper
        left = search.left[search.left[:, -1] < ceiling]
        return search._replace(
            outcome=STOPPED if len(left) or search.floor < ceiling else ENDED,
            left=left[np.argsort(left[:, -1], kind="stable")],
            lower=min([ceiling, search.floor, *left[:, -1]]),
            largest=left[:, left.shape[1] // 2 : -1].max(initial=search.stuck),
        )

    first, start = np.c_[boxes, 0.0], np.ascontiguousarray(q)
    search = enclose(form, wanted, roll, *arrays, first, start, tuning, min(budget, PIECE))
    if not len(search.left) or search.boxes >= budget:
        return search
    off = max(math.pi - (roll.upper - roll.lower) / 2, 0.0)
    if roll.present and 2.0 * problem.goal.orientation_weight * (1.0 - math.cos(off)) > gap * search.upper:
        # What the limits of the last joint can cost is more than the gap: from here on it is part of the boxes.
        form, wanted, roll = error_question(problem, search.q, gap, trust, whole=True)
        last = [chain.dof - 1, 2 * chain.dof - 2]
        middle_and_half = start_boxes(chain, False)[0, [chain.dof - 1, 2 * chain.dof - 1]]
        search = search._replace(left=np.insert(search.left, last, middle_and_half, axis=1))
    return _shared(settle(search), stretch, budget, HANDS, threads, settle)


def _certificate(
    problem: Problem, verdict: Verdict, q: Array, lower: float, boxes: int, largest: float
) -> Certificate:
    judged = conclude(problem, q[None], np.zeros((1, 3), dtype=np.int64))
    return Certificate(
        verdict=verdict,
        q=judged.q,
        lower_bound=float(min(lower, judged.weighted_error)),
        upper_bound=float(judged.weighted_error),
        position_error=float(judged.position_error),
        orientation_error=float(judged.orientation_error),
        boxes=int(boxes),
        largest_box=float(largest),
        problem=problem,
    )
