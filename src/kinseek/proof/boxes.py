"""Branch and bound on boxes that are shared by threads in rounds; the result is the same for any number of threads."""

from __future__ import annotations

import functools
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.arrays import Array, Flags
from kinseek.kernels.proof.box import Form, ProofGoal
from kinseek.kernels.proof.infeasibility import OFTEN, STEPS
from kinseek.kernels.proof.last_joint import LastJoint
from kinseek.kernels.proof.memory import Heap, Memory, Places
from kinseek.kernels.proof.progress import (
    COUNT,
    COUNTS,
    ENCLOSE,
    ENDED,
    EXCLUDE,
    FLOOR,
    FOUND,
    FULL,
    ISOLATE,
    SEEN,
    STOPPED,
    STUCK,
    UPPER,
    Question,
    Tuning,
)
from kinseek.kernels.proof.search import search_boxes
from kinseek.problem import Problem
from kinseek.solvers.threads import in_threads
from kinseek.support.deadline import Deadline
from kinseek.support.interrupts import uninterrupted

from .reduce import error_question, question, start_boxes
from .shoulder import bounded_by_ball
from .wrist import without_wrist

SECOND_ORDER = 2.5
"""Boxes whose rotation of the hand is less than this [rad] are tested to second order. Found by trial on four arms of six
joints: with twice the value an exclusion takes 22 % fewer boxes but no less time, since most second-order tests of wide
boxes are in vain; with half the value it takes 37 % more boxes. The program of this trial is not in the repository."""

SHRINK = 0.5
"""Boxes that shrink to less than this fraction of their volume are tested again before they are cut. Found by trial: 2 to 5
% more boxes with 0.25 and with 0.8. With 1 or more every box would be tested again endlessly. The program of this trial is
not in the repository."""

PASSES = 2
"""Forms tried on a box if the tolerances decide. Found by trial: 13 % more boxes with one, no fewer with four. The program
of this trial is not in the repository."""


PIECE = 8192
"""Boxes that one thread examines before the boxes are shared again: some tens of milliseconds. With twice as many the
threads wait longer for each other; with half as many the sharing in Python takes more time. The value affects the result,
since bounds depend on which thread knew which pose."""


FIRST = 1024
"""Boxes after which a proof also tries the arm without its wrist, if it has one. They take a millisecond and decide most
goals of six joints."""

SHARE = 0.5
"""Fraction of the budget for the arm without its wrist; the rest is for the whole arm. Not examined further."""


HANDS = 16
"""Parts into which the remaining boxes are divided, one per thread and round: about the number of cores of a fast machine.
With twice as many parts each knows less of the best pose of the others. The number does not depend on the machine, so that
the bits stay the same."""


CHUNK = 60_000
"""A kernel returns after this number of boxes divided by the square of the number of joints, and is then called again. This
bounds the wait for an interrupt or a deadline to some hundredths of a second. The result does not depend on it."""


ENDLESS = Deadline()


class Search(NamedTuple):
    """Result of a search."""

    outcome: int
    """ENDED: no box is left; FOUND: `q` is within the tolerances; STOPPED: ended by the budget, the time or rounding."""
    boxes: int
    largest: float
    """Half width of the widest variable in any remaining box [rad] or [m]; 0 if there is none."""
    q: Array
    """The best joint values found, (n,)."""
    lower: float
    """Lower bound of the weighted error."""
    upper: float
    """Weighted error of `q`."""
    left: Array
    """Boxes that remain if the budget ended the search, (k, 2 dof), or with their bounds, (k, 2 dof + 1)."""
    stuck: float
    """Width of the widest box that remains because it is as small as rounding allows, [rad] or [m]; 0 if there is none."""
    floor: float
    """Lower bound of the weighted error in such boxes; inf if there are none."""


@dataclass
class Watch:
    """Signals all threads of a search when to return."""

    deadline: Deadline = ENDLESS
    interrupted: bool = False
    cut: bool = False
    """Whether the deadline ended anything early."""

    def interrupt(self) -> None:
        """Make all threads return, after Ctrl-C."""
        self.interrupted = True

    @property
    def over(self) -> bool:
        """Whether no more work may be started; check it before each piece of work."""
        if self.deadline.passed:
            self.cut = True
        return self.cut or self.interrupted


def tuning_of(problem: Problem, often: int, steps: int, gap: float = 0.0) -> Tuning:
    """Return the parameters that determine how much a search tries per box."""
    tolerances = float(problem.goal.position_tolerance), float(problem.goal.orientation_tolerance)
    return Tuning(SECOND_ORDER, SHRINK, PASSES, often, steps, *tolerances, gap)


class Run:
    """The kernel's loop on some boxes, call after call."""

    def __init__(
        self,
        problem: Problem,
        reduction: tuple[Form, ProofGoal, LastJoint],
        boxes: Array,
        q: Array,
        tuning: Tuning,
        heap: Heap | None = None,
        places: Places | None = None,
    ) -> None:
        """Allocate room for more boxes than the given ones, (k, 2 dof); q, (n,), is overwritten. See `search_boxes`."""
        self.question = Question(*reduction, problem.arrays, problem.goal.arrays)
        self.kind = ENCLOSE if heap is not None else ISOLATE if places is not None else EXCLUDE
        self._chunk, self.tuning = chunk_of(problem), tuning
        self.boxes, self.q = roomy(boxes), q
        self.heap = heap_for(len(self.boxes), heap)
        self._places = no_places(len(q), boxes.shape[1] // 2) if places is None else places
        self.counts = np.zeros(COUNTS, dtype=np.int64)
        self.counts[COUNT] = len(boxes)
        self.figures = np.array([np.inf, np.inf, 0.0, np.inf])

    def go(self, most: int, watch: Watch) -> int:
        """Continue until the loop ends, `most` boxes have been examined, or `watch` signals the end; see `search_boxes`.

        The first test of the tolerances is always made.
        """
        outcome = STOPPED
        while outcome in (STOPPED, FULL) and not (self.seen and watch.over):
            judge_only = self.kind == ENCLOSE and watch.over
            until = 0 if judge_only else min(self.seen + self._chunk, most)
            outcome = search_boxes(self.kind, self.question, self.tuning, self.memory, until, most)
            if outcome == FULL:
                self._enlarge()
            elif judge_only or self.seen >= most:
                break
        return outcome

    def _enlarge(self) -> None:
        if self.kind == ENCLOSE:  # A heap keeps the boxes of all depths, so its size is doubled.
            self.boxes = np.concatenate([self.boxes, np.zeros_like(self.boxes)])
        else:
            self.boxes = roomy(self.boxes)
        self.heap = heap_for(len(self.boxes), self.heap)

    @property
    def memory(self) -> Memory:
        """State of the loop, which the kernel reads and writes."""
        return Memory(self.boxes, self.heap, self._places, self.q, self.counts, self.figures)

    @property
    def seen(self) -> int:
        """Number of boxes examined."""
        return int(self.counts[SEEN])

    def search(self, outcome: int, largest: float, left: Array) -> Search:
        """Return the current result, without a lower bound."""
        upper, stuck, floor = (float(self.figures[each]) for each in (UPPER, STUCK, FLOOR))
        return Search(outcome, self.seen, largest, self.q, 0.0, upper, left, stuck, floor)


def heap_for(room: int, given: Heap | None = None) -> Heap:
    """Allocate a heap of `room` rows, with the order of a given one."""
    more = Heap(np.empty(room), np.empty(room, dtype=np.int64))
    if given is not None:
        for new, old in zip(more, given, strict=True):
            new[: len(old)] = old
    return more


def places_for(solutions: Array, periodic: Flags, most: int) -> Places:
    """Allocate memory for `most` solutions with neighbourhoods; `solutions`, (k, n), are known, `periodic`, (reduced n,)."""
    whole, reduced = solutions.shape[1], len(periodic)
    return Places(
        solutions,
        periodic,
        np.zeros(most, dtype=np.bool_),
        np.zeros(most, dtype=np.int64),
        np.zeros((most, whole)),
        np.zeros((most, reduced)),
        np.zeros((most, reduced)),
        np.zeros((most, reduced)),
        np.zeros(most, dtype=np.bool_),
    )


@functools.cache
def no_places(whole: int, reduced: int) -> Places:
    """Return memory for no solutions; it is shared by all searches of the same size, since nothing is written there."""
    return places_for(np.empty((0, whole)), np.zeros(reduced, dtype=np.bool_), 0)


def excluded(
    problem: Problem,
    budget: int,
    trust: float = 1.0,
    threads: int | None = None,
    watch: Watch | None = None,
    begin: Array | None = None,
) -> Search:
    """Search all boxes for joint values within both tolerances.

    `begin` are boxes that contain all such joint values, as left by another search, see `Search.left`. The default is the
    whole range of the joints.

    The boxes that a piece of work leaves are distributed to the threads, round after round. The result for a box depends
    only on the box, and results are read in order. So the verdict, the witness and the count are the same for any number of
    threads. If the first piece does not decide, the arm without its wrist is tried before the search continues.
    """
    watch, reduction = watch or Watch(), question(problem, trust)
    tuning, last_joint = tuning_of(problem, OFTEN, STEPS), reduction[2]

    def search_piece(_: Search | None, boxes: Array, most: int) -> Search:
        run = Run(problem, reduction, boxes, np.zeros(problem.chain.dof), tuning)
        if run.go(most, watch) == FOUND:
            return run.search(FOUND, 0.0, boxes[:0])._replace(floor=np.inf)
        left = run.boxes[: run.counts[COUNT]].copy()
        stuck = float(run.figures[STUCK])
        largest = float(left[:, left.shape[1] // 2 :].max(initial=stuck))
        return run.search(STOPPED if len(left) or stuck > 0.0 else ENDED, largest, left)

    boxes = start_boxes(problem.chain, last_joint.present) if begin is None else begin
    search = search_piece(None, boxes, min(budget, FIRST))
    if not len(search.left) or search.boxes >= budget or watch.over:
        return search
    # Boxes from another search describe the whole arm, so the smaller question does not apply to them.
    easier = without_wrist(problem) if begin is None else None
    if easier is not None:
        most = int(SHARE * (budget - search.boxes))
        rest = excluded(easier, most, trust, threads, watch)
        search = search._replace(boxes=search.boxes + rest.boxes)
        if rest.outcome == ENDED:
            return search._replace(outcome=ENDED, largest=0.0, left=search.left[:0], stuck=0.0, floor=np.inf)
    search = _together(search, [search_piece(search, search.left, min(budget - search.boxes, PIECE))])
    return _shared(search, search_piece, budget, sys.maxsize, threads, watch)


def chunk_of(problem: Problem) -> int:
    """Return the number of boxes after which a kernel returns."""
    return max(CHUNK // len(problem.chain.leader) ** 2, 1)


def roomy(boxes: Array) -> Array:
    """Copy boxes into an array with room for 64 halvings of every variable, which suffice for all but huge ranges.

    The last box is examined first, so a halving adds one box; a range in radians is narrower than `NARROW` after 35.
    """
    dof = boxes.shape[1] // 2
    more = np.empty((len(boxes) + 64 * (dof + 1), 2 * dof))
    more[: len(boxes)] = boxes
    return more


def _shared(
    search: Search,
    search_piece: Callable[[Search, Array, int], Search],
    budget: int,
    hands: int,
    threads: int | None,
    watch: Watch,
    prune: Callable[[Search], Search] = lambda search: search,
) -> Search:
    """Continue with the remaining boxes, divided into `hands` parts in each round, until none is left or the budget ends.

    If the time is up, boxes that were not examined stay as they are.
    """
    if not len(search.left) or search.boxes >= budget or watch.over:
        return search

    def one(known: Search, most: int, boxes: Array) -> Search:
        return _untouched(known, boxes) if watch.over else search_piece(known, boxes, most)

    def rounds() -> Search:
        found = search
        while len(found.left) and not watch.over:
            parts = min(hands, len(found.left))
            most = min(PIECE, (budget - found.boxes) // parts)
            if most == 0:
                break
            # Every part gets boxes from all over the list, so that the parts take about the same time.
            dealt = [found.left[part::parts] for part in range(parts)]
            found = prune(_together(found, in_threads(functools.partial(one, found, most), dealt, threads)))
        return found

    return uninterrupted(rounds, stop=watch.interrupt)


def _untouched(search: Search, boxes: Array) -> Search:
    """Return the result for boxes that are not examined."""
    dof = boxes.shape[1] // 2
    largest = float(boxes[:, dof : 2 * dof].max())
    return search._replace(outcome=STOPPED, boxes=0, largest=largest, left=boxes, stuck=0.0, floor=np.inf)


def _together(before: Search, pieces: Sequence[Search]) -> Search:
    """Combine a search with the results of a round."""
    boxes = before.boxes + sum(piece.boxes for piece in pieces)
    # The order of the pieces does not depend on the threads, so ties are decided the same way in every run.
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
    """Enclose the least weighted error, starting from joint values q, (n,), with the best box first.

    The boxes that a piece of work leaves are divided into at most `HANDS` parts. The parts do not depend on the number of
    threads, so the bounds, the pose and the count do not either.
    """
    chain, watch = problem.chain, watch or Watch()
    form, proof_goal, last_joint = error_question(problem, q, gap, trust)
    tuning = tuning_of(problem, OFTEN, 0, gap)

    def search_piece(known: Search, boxes: Array, most: int) -> Search:
        heap = Heap(boxes[:, -1], np.zeros(len(boxes), dtype=np.int64))
        run = Run(problem, (form, proof_goal, last_joint), boxes[:, :-1], known.q.copy(), tuning, heap)
        run.go(most, watch)
        bounded = np.c_[run.boxes, run.heap.bound]
        return prune(run.search(STOPPED, 0.0, bounded[run.heap.order[: run.counts[COUNT]]]))

    def prune(search: Search) -> Search:
        """Remove the boxes that the best known pose rules out."""
        ceiling = (1.0 - gap) * search.upper
        left = search.left[search.left[:, -1] < ceiling]
        return search._replace(
            outcome=STOPPED if len(left) or search.floor < ceiling else ENDED,
            left=left,
            lower=min([ceiling, search.floor, *left[:, -1]]),
            largest=float(left[:, left.shape[1] // 2 : -1].max(initial=search.stuck)),
        )

    def sort(search: Search) -> Search:
        """Sort the boxes, the lowest bounds first."""
        pruned = prune(search)
        return pruned._replace(left=pruned.left[np.argsort(pruned.left[:, -1], kind="stable")])

    # The bound by a ball joint needs few boxes, so it comes before the boxes of all joints.
    start = Search(STOPPED, 0, 0.0, np.ascontiguousarray(q), 0.0, np.inf, np.empty((0, 0)), 0.0, np.inf)
    error = float(judge(problem.arrays, start.q[None], problem.goal.targets, problem.goal.arrays)[0, 2])
    ball = bounded_by_ball(problem, (1.0 - gap) * error, budget, trust, lambda: watch.over)
    if ball.lower >= (1.0 - gap) * error:
        return start._replace(outcome=ENDED, boxes=ball.boxes, lower=ball.lower, upper=error)
    search = search_piece(
        start, np.c_[start_boxes(chain, last_joint.present), ball.lower], min(budget - ball.boxes, PIECE)
    )
    search = search._replace(boxes=search.boxes + ball.boxes)
    if not len(search.left) or search.boxes >= budget or watch.over:
        return search
    off = max(math.pi - (last_joint.upper - last_joint.lower) / 2, 0.0)
    if (
        last_joint.present
        and 2.0 * problem.goal.orientation_weight * (1.0 - math.cos(off)) > gap * search.upper
    ):
        # The limits of the last joint can cost more than the gap, so from here on this joint is part of the boxes.
        form, proof_goal, last_joint = error_question(problem, search.q, gap, trust, whole=True)
        last = [chain.dof - 1, 2 * chain.dof - 2]
        middle_and_half = start_boxes(chain, False)[0, [chain.dof - 1, 2 * chain.dof - 1]]
        search = search._replace(left=np.insert(search.left, last, middle_and_half, axis=1))
    return _shared(sort(search), search_piece, budget, HANDS, threads, watch, sort)
