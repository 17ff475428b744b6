"""The implementation of `Arm.branches`; `kernels.branches` contains the search itself."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from kinseek.errors import InvalidProblem, suggest
from kinseek.kernels.arrays import Array
from kinseek.kernels.branches.refine_all import ANSWER, Metric
from kinseek.kernels.branches.search import ROWS, many_branches
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import open_limits
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.solvers.atlas.solver import Atlas
from kinseek.solvers.threads import GoOn, parallel_for
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN, shortest
from kinseek.support.validation import as_integer
from kinseek.virtual_joints import Extended, extended, slide_limits

from .index import SAMPLE_SIZE, BranchIndex, index_of
from .order import DEFAULT, ORDERS, Cost, Selection, scores, which_valid
from .result import Branches, BranchesBatch, OfEachGoal, late_branches, solutions_of

MOST = 100_000
"""Largest number of solutions that may be requested, or that full turns may make: two joints of ±4,000 rad have more than a
million copies of each."""


MOST_SAMPLED = 2_000
"""Largest number of solutions in a sample of a redundant arm. The farthest are chosen from all that were found, so the time
grows with the square of their number: this many take some tenths of a second, in one call of a kernel."""


SEARCHING = 0.5
"""Fraction of the time limit that the search for solutions of a batch may take, if work on every goal follows."""


LAST = 0.1
"""Time [s] beyond the time limit for sorting and filtering solutions that were found, without a proof."""


_SAME = 1e-6
"""Solutions of goals with ranges that differ by less in every joint are one [rad or m]: different virtual joints may reach
the same joint values."""

_CHUNK = 64
"""Targets that a thread takes at a time."""


_PIECE, _SAMPLED = 4, 200
"""Targets that are solved in one piece, and the number of solutions in a sample above which there are fewer in a piece: some
ten milliseconds if they are hard."""


def branches_of(
    problem: Problem, selection: Selection, threads: int | None = None, deadline: Deadline | None = None
) -> Branches | BranchesBatch:
    """Find every branch of every target of a problem; see `Arm.branches`.

    Args:
        problem: The problem.
        selection: Which solutions are requested, and in which order.
        threads: Number of threads for a batch; None uses every core.
        deadline: Where this is a step of longer work: when it ends, in place of the time limit of the problem.
    """
    selection = _checked(problem, selection)
    whole = Deadline(problem.time_limit)
    deadline, last = (whole, whole.extended(LAST)) if deadline is None else (deadline, deadline)
    if problem.goal.form.ranges:
        return _ranged(problem, selection, threads, deadline, last)
    index, goal = index_of(problem), problem.goal
    if index.freedom and selection.count is not None and selection.count > MOST_SAMPLED:
        raise InvalidProblem(
            f"count must be at most {MOST_SAMPLED:,} for {problem.chain.name!r}, which is redundant for this goal, got "
            f"{selection.count:,}: for more, narrow a joint's limits by with_limits, and take a sample of each part"
        )
    # Isolated solutions are all found, so only a continuum needs a number.
    number = (selection.count or SAMPLE_SIZE) if index.freedom else 0
    tolerances = tolerances_of(goal)
    targets = np.zeros((len(goal.targets), 4, 4))
    targets[:, :3], targets[:, 3, 3] = goal.targets, 1.0
    views, nears = index.view[None], None
    if problem.near is not None:
        nears = np.broadcast_to(problem.near, (*goal.shape, problem.chain.dof)).reshape(-1, problem.chain.dof)
    # A proof takes solutions inside [-π, π], so they are turned and sorted afterwards.
    if nears is not None and not selection.prove:
        views = np.stack(
            [nears, np.ones_like(nears), np.broadcast_to(Metric(*index.view).rates, nears.shape)], axis=1
        )
    searching = deadline if selection.as_found or not goal.shape else deadline.share(SEARCHING)
    found = _search(index, tolerances, targets, np.ascontiguousarray(views), number, threads, searching)
    if not goal.shape:
        rows, sampled = found[0], index.freedom > 0
        if rows is None:
            return late_branches((problem, goal.target, problem.near), problem.chain.dof, sampled)
        return _finish(problem, rows, index, selection, deadline)
    if not found:
        return BranchesBatch((), goal.shape)
    ready = found if selection.as_found else _finished(problem, found, index, selection, deadline, last)
    return BranchesBatch(OfEachGoal(problem, ready, nears, index.freedom > 0, selection.count), goal.shape)


def _ranged(
    problem: Problem, selection: Selection, threads: int | None, deadline: Deadline, last: Deadline
) -> Branches | BranchesBatch:
    """Find solutions of goals with ranges, by the arm that has virtual joints for them."""
    goal, dof = problem.goal, problem.chain.dof
    if not len(goal.targets):
        return BranchesBatch((), goal.shape)
    more = _extended_for_all(problem)
    if more is None:
        each = (branches_of(one, selection, threads, deadline) for one in problem.each())
        return BranchesBatch(tuple(cast(Iterator[Branches], each)), goal.shape)
    nears = None
    if problem.near is not None:
        rows = np.broadcast_to(problem.near, (*goal.shape, dof)).reshape(-1, dof)
        nears = more.with_virtual(rows).reshape(*goal.shape, -1)
    index = index_of(more.problem)
    if not index.freedom:  # All solutions are found, also those at the ends of ranges.
        more = extended(problem)
        index = index_of(more.problem)
    prove = selection.prove and more.exact and not index.freedom
    inner = Selection(count=selection.count if index.freedom else None, prove=prove)
    found = branches_of(replace(more.problem, near=nears), inner, threads, deadline)
    answers = []
    for one, wide in zip(problem.each(), [found] if isinstance(found, Branches) else found, strict=True):
        if goal.shape and last.passed:
            answers.append(late_branches((one, one.goal.target, one.near), dof, wide.sampled))
            continue
        q = _distinct(problem.placed(wide.q[more.accepts(wide.q)][:, more.own]), problem.chain)
        errors = one.errors_of(q)
        met = one.goal.met(errors)
        evaluations = wide.evaluations
        if not (met.any() or wide.complete or deadline.passed):
            # Ranges that are narrow and far from 0 may contain none of the sample, which is of slightly larger ones.
            searched = Atlas(threads=threads).solve(replace(one, time_limit=deadline.left))
            q, evaluations = searched.q[None], evaluations + searched.evaluations
            errors = one.errors_of(q)
            met = one.goal.met(errors)
        late = wide.out_of_time or (selection.prove and not wide.complete and deadline.passed)
        of_one = Branches(
            q=q[met],
            position_error=errors[met, 0],
            orientation_error=errors[met, 1],
            complete=wide.complete,
            sampled=wide.sampled,
            evaluations=evaluations,
            rejected=0,
            problem=one,
            out_of_time=late,
        )
        answers.append(_chosen(of_one, selection, sort=True))
    return BranchesBatch(tuple(answers), goal.shape) if goal.shape else answers[0]


def _extended_for_all(problem: Problem) -> Extended | None:
    """Return the arm with virtual joints that all targets share; None if the targets of a batch need different ones.

    Raises:
        InvalidProblem: One goal alone, with ranges that no virtual joints have.
    """
    if np.ptp(slide_limits(problem)):
        return None
    try:
        return extended(problem, inside=True)
    except InvalidProblem:  # The axes of the ranges change from target to target.
        if not problem.goal.shape:
            raise
        return None


def _distinct(q: Array, chain: SerialChain) -> Array:
    """Return solutions, (k, n), without those that differ from an earlier one by full turns and rounding alone."""
    kept: list[int] = []
    for i in range(len(q)):
        gaps = q[i] - q[kept]
        gaps = np.where(chain.periodic, shortest(gaps), gaps)
        if not kept or np.abs(gaps).max(axis=1).min() > _SAME:
            kept.append(i)
    return np.ascontiguousarray(q[kept])


def _finished(
    problem: Problem,
    found: Sequence[Array | None],
    index: BranchIndex,
    selection: Selection,
    deadline: Deadline,
    last: Deadline,
) -> list[Branches | None]:
    """Return the solutions of each target; None for targets that the time did not suffice for.

    Nothing is proved after `deadline`, and nothing is done after `last`.
    """
    ready: list[Branches | None] = [None] * len(found)
    for i, one in enumerate(problem.each()):
        if last.passed:
            break
        rows = found[i]
        ready[i] = None if rows is None else _finish(one, rows, index, selection, deadline)
    return ready


def _checked(problem: Problem, selection: Selection) -> Selection:
    order = selection.order
    if order not in ORDERS:
        raise InvalidProblem(suggest(str(order), ORDERS, "order"))
    if selection.count is not None:
        selection = replace(selection, count=as_integer("count", selection.count, 1, MOST, InvalidProblem))
    chosen = [name for name, given in _given(problem, order, selection.cost) if given]
    if len(chosen) > 1:
        raise InvalidProblem(
            f"{' and '.join(chosen)} cannot be combined, since each sets the order; give one of them"
        )
    return selection


def _given(problem: Problem, order: str, cost: Cost | None) -> list[tuple[str, bool]]:
    return [
        ("near", problem.near is not None),
        ("cost", cost is not None),
        (f"order={order!r}", order != DEFAULT),
    ]


def _search(
    index: BranchIndex,
    tolerances: Array,
    targets: Array,
    views: Array,
    number: int,
    threads: int | None,
    deadline: Deadline,
) -> list[Array | None]:
    """Return rows of solutions for each target, (k, 4, 4); None for targets that the time did not suffice for."""
    found: list[Array | None] = [None] * len(targets)
    if len(targets) == 1:
        if not deadline.passed:
            found[0] = index.search(tolerances, targets[0], views[0], number)
        return found
    most, width = number or ROWS, views.shape[-1] + ANSWER
    piece = min(max(_SAMPLED // most, 1), _PIECE)

    def work(begin: int, end: int, go_on: GoOn) -> None:
        # One row more than there are solutions: the last row has their number and the cost of the search.
        results, counts = np.empty((piece, most + 1, width)), np.empty(piece, dtype=np.int64)
        for first in range(begin, end, piece):
            if not go_on():
                return
            last = min(first + piece, end)
            some = slice(first, last)
            many_branches(
                index.tables,
                tolerances,
                targets[some],
                views[some] if len(views) > 1 else views,
                number,
                results[: last - first],
                counts[: last - first],
            )
            for i in range(first, last):
                # A copy, since the next piece overwrites the results.
                found[i] = results[i - first, : counts[i - first]].copy()

    parallel_for(work, len(targets), _CHUNK, threads, deadline)
    return found


def _finish(
    problem: Problem, rows: Array, index: BranchIndex, selection: Selection, deadline: Deadline
) -> Branches:
    """Prove, sort, filter and evaluate the solutions of one target."""
    found, complete, late = solutions_of(rows, problem.chain.dof), False, False
    q, errors = found.q.copy(), found.errors
    if selection.prove:
        from kinseek.proof.root_isolation import prove_complete

        # The proof returns solutions that the search missed; they come without errors, which are computed below.
        if not deadline.passed:
            q, complete = prove_complete(problem, q, deadline=deadline)
        late = not complete and deadline.passed
        q = problem.placed(q)
        errors = problem.errors_of(q)
    branches = Branches(
        q=q,
        position_error=errors[:, 0].copy(),
        orientation_error=errors[:, 1].copy(),
        complete=complete,
        sampled=bool(index.freedom) or (found.singular and not complete),
        evaluations=found.evaluations,
        rejected=0,
        problem=problem,
        out_of_time=late,
    )
    # The kernels have sorted by the default order already; a proof may have added solutions.
    return _chosen(branches, selection, sort=selection.prove)


def _chosen(found: Branches, selection: Selection, sort: bool) -> Branches:
    """Add full turns to the solutions of one target, sort them, and keep those that are requested.

    Args:
        found: The solutions.
        selection: What is requested.
        sort: Whether they are not in the default order yet.
    """
    q, problem = found.q, found.problem
    errors = np.stack([found.position_error, found.orientation_error], axis=1)
    if selection.copies:
        q = full_turn_copies(problem.chain, q)
        errors = problem.errors_of(q)
    place = np.arange(len(q))
    if sort or selection.copies or selection.cost is not None or selection.order != DEFAULT:
        place = np.argsort(scores(problem, q, selection.order, selection.cost), kind="stable")
    rejected = 0
    if selection.valid is not None:
        passed = which_valid(selection.valid, q[place])
        # The check comes after sorting, so that calls of `valid` are in the order of preference.
        rejected, place = len(place) - int(passed.sum()), place[passed]
    place = place[: selection.count]
    return replace(
        found,
        q=q[place],
        position_error=errors[place, 0],
        orientation_error=errors[place, 1],
        # Complete only if `count` has cut off none of the solutions.
        complete=found.complete and len(place) + rejected == len(q),
        rejected=rejected,
    )


def full_turn_copies(chain: SerialChain, q: Array) -> Array:
    """Return every solution with all full turns that the limits allow, (k, n) -> (K, n).

    A continuous joint has no copies: its values are angles.

    Raises:
        InvalidProblem: There are more than `MOST`.
    """
    rows: list[tuple[float, ...]] = []
    open_lower, _ = open_limits(chain)
    for solution in q:
        choices = []
        for i, value in enumerate(solution):
            # A range without room for a further turn has one copy.
            if not np.isfinite(open_lower[i]) or open_lower[i] == chain.lower[i]:
                choices.append(np.array([value]))
                continue
            # The tolerance of 1e-12 keeps a copy that rounding puts just outside a limit; it is clipped below.
            least = np.ceil((chain.lower[i] - value) / TURN - 1e-12)
            most = np.floor((chain.upper[i] - value) / TURN + 1e-12)
            copies = value + TURN * np.arange(least, most + 1)
            choices.append(np.clip(copies, chain.lower[i], chain.upper[i]))
        count = len(rows) + math.prod(len(values) for values in choices)
        if count > MOST:
            raise InvalidProblem(
                f"with all full turns inside the limits of {chain.name!r} this goal has more than {MOST:,} solutions, "
                "too many for copies=True or a cost; narrow the limits with with_limits, or choose among the "
                "solutions of branches() yourself"
            )
        rows += list(itertools.product(*choices))
    return np.array(rows).reshape(-1, chain.dof)
