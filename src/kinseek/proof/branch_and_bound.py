"""Branch and bound: prove that a goal is out of reach, or say how near any pose could come.

Boxes of joint values are cut in half, again and again. Each is tested by the bounds of `kernels.bounds`: first what the
whole box can do, then one linear form of the hand's pose to second order, which also cuts the box from its sides. All
boxes gone: nothing inside the limits reaches the goal. Best box first, the same search encloses the least error.
(Land & Doig 1960; in robotics Rao, Asaithambi & Agrawal 1998, who solve inverse kinematics by interval analysis.)
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.enclosure import FLOOR, enclose
from kinseek.kernels.proof.exclusion import COUNT, ENDED, FOUND, FULL, SEEN, STOPPED, STUCK, UPPER, exclude
from kinseek.kernels.proof.gate import least_by_gate
from kinseek.problem import Problem
from kinseek.solution import Solution, conclude
from kinseek.solvers.atlas.solver import Atlas

from .certificate import Certificate, Verdict
from .reduce import ROUNDING, error_question, question, start_boxes

BUDGET = 2_000_000
"""Boxes, unless told otherwise: some seconds."""

SPREAD, SHRINK = 2.5, 0.5
"""Boxes that turn the hand by less [rad] are looked at to second order; those that shrink to less of their volume, again."""


PIECE = 8192
"""Boxes that one thread examines at a stretch: some tens of milliseconds."""

HANDS = 16
"""Parts that the boxes left over are dealt into, each with a thread for a stretch."""

CHUNK = 60_000
"""A kernel comes back after so many boxes, divided by the square of the joints, to be asked to go on: the longest that an
interrupt or a deadline waits, some hundredth of a second. What is found does not depend on it."""

ENDLESS = Deadline()


class Search(NamedTuple):
    """How a search went."""

    outcome: int
    """ENDED: no box left; FOUND: `q` is within the tolerances; STOPPED: by the budget, the time or by rounding."""
    boxes: int
    largest: float
    """Widest box that is left, the half width of its widest variable [rad] or [m]; 0 if none."""
    q: Array
    """(n,), the best joint values seen."""
    lower: float
    """Lower bound on the weighted error."""
    upper: float
    """Weighted error of `q`."""
    left: Array
    """Boxes that are left where the budget ended the search, (k, 2 dof), or with their bounds, (k, 2 dof + 1)."""
    stuck: float
    """Widest box that is left because it is as small as numbers allow, [rad] or [m]; 0 if none."""
    floor: float
    """Lower bound on the weighted error in such boxes; inf if none."""


@dataclass
class Watch:
    """Says to all threads of a search when to come back."""

    deadline: Deadline = ENDLESS
    interrupted: bool = False
    cut: bool = False
    """Has the deadline ended anything early?"""

    @property
    def over(self) -> bool:
        """Ask it before more work is begun, and do none if it says so."""
        if self.deadline.passed:
            self.cut = True
        return self.cut or self.interrupted


def prove(
    problem: Problem,
    *,
    gap: float | None = None,
    budget: int = BUDGET,
    answer: Solution | None = None,
    threads: int | None = None,
    deadline: Deadline = ENDLESS,
) -> Certificate:
    """Prove that a goal is out of reach, or find joint values that reach it.

    Args:
        problem: One target.
        gap: If the goal is not reached: go on until the bounds on the least weighted error are this close, relative to the
            upper one, > 0; None leaves out this second search.
        budget: Boxes to examine at most, over both searches, >= 0; the bounds hold whenever the search stops.
        answer: A solution of the same problem, if there is one already; else the atlas is asked.
        threads: Threads that share the boxes; every core unless given. The certificate has the same bits.
        deadline: When to stop; the bounds hold then too, and the certificate says that its time was up.

    Raises:
        InvalidProblem: A batch, an empty one included; a gap or budget out of its range; an arm or a goal of a size that
            numbers do not bear.
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
    watch = Watch(deadline)
    search = excluded(problem, budget, threads=threads, watch=watch)
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
        nearest = enclosed(problem, q, gap, budget - boxes, threads=threads, watch=watch)
        q, boxes, largest = nearest.q, boxes + nearest.boxes, nearest.largest
        lower = max(lower, nearest.lower)
    certificate = _certificate(problem, verdict, q, lower, boxes, largest, watch.cut)
    goal = problem.goal
    met = certificate.position_error <= goal.position_tolerance
    if met and certificate.orientation_error <= goal.orientation_tolerance:
        return replace(certificate, verdict=Verdict.REACHABLE, lower_bound=0.0, out_of_time=False)
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


def excluded(
    problem: Problem,
    budget: int,
    trust: float = 1.0,
    threads: int | None = None,
    watch: Watch | None = None,
) -> Search:
    """Look in every box for joint values within both tolerances; see `exclude`.

    What a stretch of boxes leaves over is shared out, a box to a thread, round after round. What becomes of a box depends on
    nothing but itself, and the results are read in order: so the verdict, the witness and the count are the same for any
    number of threads.
    """
    goal, watch = problem.goal, watch or Watch()
    form, wanted, roll = question(problem, trust)
    tuning = np.array([SPREAD, 2, SHRINK, goal.position_tolerance, goal.orientation_tolerance])
    arrays, chunk = (problem.arrays, goal.arrays), chunk_of(problem)

    def stretch(_: Search | None, boxes: Array, most: int) -> Search:
        stack, q = roomy(boxes), np.zeros(problem.chain.dof)
        counts, figures = np.array([len(boxes), 0, 0]), np.array([np.inf, 0.0])
        outcome = STOPPED
        while outcome in (STOPPED, FULL) and not (counts[SEEN] and watch.over):
            until = min(int(counts[SEEN]) + chunk, most)
            outcome = exclude(form, wanted, roll, *arrays, stack, q, tuning, counts, figures, until)
            if outcome == FULL:
                stack = roomy(stack)
            elif counts[SEEN] >= most:
                break
        seen, upper, stuck = int(counts[SEEN]), float(figures[UPPER]), float(figures[STUCK])
        if outcome == FOUND:
            return Search(FOUND, seen, 0.0, q, 0.0, upper, stack[:0], stuck, np.inf)
        left = stack[: counts[COUNT]].copy()
        largest = left[:, left.shape[1] // 2 :].max(initial=stuck)
        outcome = STOPPED if len(left) or stuck > 0.0 else ENDED
        return Search(
            outcome, seen, float(largest), q, 0.0, upper, left, stuck, 0.0 if stuck > 0.0 else np.inf
        )

    search = stretch(None, start_boxes(problem.chain, roll.present), min(budget, PIECE))
    return _shared(search, stretch, budget, sys.maxsize, threads, watch)


def chunk_of(problem: Problem) -> int:
    """Boxes after which a kernel comes back."""
    return max(CHUNK // len(problem.chain.leader) ** 2, 1)


def roomy(boxes: Array) -> Array:
    """Room for more boxes behind these: that of 64 halvings of every variable, which are enough for all but giants."""
    more = np.empty((len(boxes) + 32 * boxes.shape[1] + 64, boxes.shape[1]))
    more[: len(boxes)] = boxes
    return more


def _shared(
    search: Search,
    stretch: Callable[[Search, Array, int], Search],
    budget: int,
    hands: int,
    threads: int | None,
    watch: Watch,
    settle: Callable[[Search], Search] = lambda search: search,
) -> Search:
    """Go on with the boxes left, dealt out to so many `hands`, round after round, until none is left or the budget ends.

    Where the time is up, what has not been examined is left as it is.
    """
    if not len(search.left) or search.boxes >= budget or watch.over:
        return search

    def one(boxes: Array) -> Search:
        return _untouched(search, boxes) if watch.over else stretch(search, boxes, most)

    with ThreadPoolExecutor(threads or os.cpu_count() or 1) as pool:
        try:
            while len(search.left) and not watch.over:
                parts = min(hands, len(search.left))
                most = min(PIECE, (budget - search.boxes) // parts)
                if most == 0:
                    break
                dealt = [search.left[part::parts] for part in range(parts)]
                search = settle(_together(search, list(pool.map(one, dealt))))
        except BaseException:
            watch.interrupted = True  # Leaving waits for the threads.
            raise
    return search


def _untouched(search: Search, boxes: Array) -> Search:
    """What comes of boxes that nobody looks at."""
    dof = boxes.shape[1] // 2
    largest = float(boxes[:, dof : 2 * dof].max())
    return search._replace(outcome=STOPPED, boxes=0, largest=largest, left=boxes, stuck=0.0, floor=np.inf)


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
    problem: Problem,
    q: Array,
    gap: float,
    budget: int,
    trust: float = 1.0,
    threads: int | None = None,
    watch: Watch | None = None,
) -> Search:
    """Enclose the least weighted error, starting from joint values q, (n,); see `enclose`.

    What a stretch of boxes leaves over is dealt out to `HANDS` threads or fewer, the same hands for any number of them, so
    that the bounds, the pose and the count are the same too.
    """
    chain, watch = problem.chain, watch or Watch()
    form, wanted, roll = error_question(problem, q, gap, trust)
    arrays, tuning = (problem.arrays, problem.goal.arrays), np.array([SPREAD, SHRINK, gap])
    chunk = chunk_of(problem)

    def stretch(known: Search, boxes: Array, most: int) -> Search:
        room = len(boxes) + 1024
        rows, bound, order = (
            np.empty((room, boxes.shape[1] - 1)),
            np.zeros(room),
            np.zeros(room, dtype=np.int64),
        )
        rows[: len(boxes)], bound[: len(boxes)], best = boxes[:, :-1], boxes[:, -1], known.q.copy()
        counts, figures = np.array([len(boxes), 0, 0]), np.array([np.inf, 0.0, np.inf])
        outcome = STOPPED
        while outcome in (STOPPED, FULL) and not (counts[SEEN] and watch.over):
            until = 0 if watch.over else min(int(counts[SEEN]) + chunk, most)
            outcome = enclose(
                form, wanted, roll, *arrays, rows, bound, order, best, tuning, counts, figures, until, most
            )
            if outcome == FULL:
                rows, bound, order = (
                    np.concatenate([each, np.zeros_like(each)]) for each in (rows, bound, order)
                )
            elif counts[SEEN] >= until == most or until == 0:
                break
        return settle(
            Search(
                STOPPED,
                int(counts[SEEN]),
                0.0,
                best,
                0.0,
                float(figures[UPPER]),
                np.c_[rows, bound][order[: counts[COUNT]]],
                float(figures[STUCK]),
                float(figures[FLOOR]),
            )
        )

    def settle(search: Search) -> Search:
        """Drop what the best pose known by now rules out."""
        ceiling = (1.0 - gap) * search.upper
        left = search.left[search.left[:, -1] < ceiling]
        return search._replace(
            outcome=STOPPED if len(left) or search.floor < ceiling else ENDED,
            left=left,
            lower=min([ceiling, search.floor, *left[:, -1]]),
            largest=float(left[:, left.shape[1] // 2 : -1].max(initial=search.stuck)),
        )

    def sort(search: Search) -> Search:
        """The boxes with the lowest bounds first."""
        settled = settle(search)
        return settled._replace(left=settled.left[np.argsort(settled.left[:, -1], kind="stable")])

    start = Search(STOPPED, 0, 0.0, np.ascontiguousarray(q), 0.0, np.inf, np.empty((0, 0)), 0.0, np.inf)
    search = stretch(start, np.c_[start_boxes(chain, roll.present), 0.0], min(budget, PIECE))
    if not len(search.left) or search.boxes >= budget or watch.over:
        return search
    off = max(math.pi - (roll.upper - roll.lower) / 2, 0.0)
    if roll.present and 2.0 * problem.goal.orientation_weight * (1.0 - math.cos(off)) > gap * search.upper:
        # What the limits of the last joint can cost is more than the gap: from here on it is part of the boxes.
        form, wanted, roll = error_question(problem, search.q, gap, trust, whole=True)
        last = [chain.dof - 1, 2 * chain.dof - 2]
        middle_and_half = start_boxes(chain, False)[0, [chain.dof - 1, 2 * chain.dof - 1]]
        search = search._replace(left=np.insert(search.left, last, middle_and_half, axis=1))
    return _shared(sort(search), stretch, budget, HANDS, threads, watch, sort)


def _certificate(
    problem: Problem,
    verdict: Verdict,
    q: Array,
    lower: float,
    boxes: int,
    largest: float,
    out_of_time: bool = False,
) -> Certificate:
    judged = conclude(problem, q[None], np.zeros((1, 3), dtype=np.int64))
    upper = max(float(judged.weighted_error), 0.0)
    return Certificate(
        verdict=verdict,
        q=judged.q,
        lower_bound=min(max(float(lower), 0.0), upper),
        upper_bound=upper,
        position_error=float(judged.position_error),
        orientation_error=float(judged.orientation_error),
        boxes=int(boxes),
        largest_box=float(largest),
        problem=problem,
        out_of_time=out_of_time,
    )
