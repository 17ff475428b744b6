"""Choose the preferred branch, and optimise along the self-motion of a redundant arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from kinseek.derivatives import constraint_jacobian
from kinseek.errors import InvalidProblem, suggest
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.near import solve_goal
from kinseek.postures import PostureRequest, read_posture
from kinseek.problem import Problem
from kinseek.solution import Solution, conclude
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline
from kinseek.virtual_joints import extended

from .at_arm_angle import walk_to_arm_angle
from .find import LAST, SEARCHING, branches_of, full_turn_copies
from .index import BranchIndex, index_of
from .order import DEFAULT, ORDERS, Cost, Preferred, Selection, Valid, is_valid, scores
from .result import Branches, BranchesBatch

_SLIDERS = 3
"""Number of solutions of a sample, the best ones, from which the optimisation starts. Not examined further."""

_SLIDES = 60
"""Largest number of steps of an optimisation. Not examined further."""

_FIRST, _LAST, _PROBE = 0.3, 1e-4, 1e-4
"""Length of the first step, of the shortest step that is tried, and of the differences for a gradient [rad or m]. Not
examined further."""


class Preference(NamedTuple):
    """Which solution is preferred: first by posture, then by order."""

    order: str
    """One of `ORDERS`, unless the problem has joint values to be near to, or there is a cost."""
    cost: Cost | None
    posture: PostureRequest | None

    @property
    def copies(self) -> bool:
        """Whether full turns matter."""
        return self.cost is not None or (self.posture is not None and bool(self.posture.turns))

    def mismatches(self, q: Array) -> int:
        """Return how many of the requested names a solution, (n,), does not have."""
        return 0 if self.posture is None else int(self.posture.mismatches(q[None])[0])

    def sorted(self, q: Array) -> Array:
        """Return solutions that are sorted by order, (k, n), sorted by posture first."""
        return q if self.posture is None else q[np.argsort(self.posture.mismatches(q), kind="stable")]


def preference_of(problem: Problem, prefer: Preferred | None, cost: Cost | None) -> Preference:
    """Read a preference.

    Raises:
        InvalidProblem: An unknown order or posture, or two orders.
    """
    if isinstance(prefer, Mapping):
        posture, order = read_posture(problem.mechanism, prefer), None
    else:
        posture, order = None, prefer
        if order is not None and order not in ORDERS:
            raise InvalidProblem(
                f"{suggest(str(order), ORDERS, 'preference')}, or a posture such as {{'elbow': 'up'}}; "
                "for the solution nearest to joint values, give near="
            )
    given = [("near", problem.near), ("prefer", order), ("cost", cost)]
    chosen = [name for name, value in given if value is not None]
    if len(chosen) > 1:
        raise InvalidProblem(
            f"{' and '.join(chosen)} cannot be combined, since each sets the order; give one of them"
        )
    return Preference(order or DEFAULT, cost, posture)


def preferred(
    problem: Problem, prefer: Preferred | None, cost: Cost | None, valid: Valid | None, threads: int | None
) -> Solution:
    """Solve every target with the preferred solution; see `Arm.ik`.

    Raises:
        InvalidProblem: An unknown preference, more than one, or a `cost` or `valid` that fails.
    """
    preference = preference_of(problem, prefer, cost)
    deadline, index = Deadline(problem.time_limit), index_of(problem)
    shape, count, dof = problem.goal.shape, len(problem.goal.targets), problem.chain.dof
    searching = deadline.share(SEARCHING) if shape else deadline
    selection = Selection(order=preference.order, cost=cost, copies=preference.copies)
    found = branches_of(problem, selection, threads, searching)
    # What a target keeps that the time does not suffice for; `valid` has not accepted it.
    q = np.broadcast_to(problem.start, (*shape, dof)).reshape(-1, dof).copy()
    work, refused = np.zeros((count, 3), dtype=np.int64), np.zeros(count, dtype=np.int64)
    passed, late = np.full(count, valid is None), np.ones(count, dtype=np.bool_)
    last = deadline.extended(LAST)
    each = found if isinstance(found, BranchesBatch) else [found]
    for i, (one, branches) in enumerate(zip(problem.each(), each, strict=True)):
        if shape and last.passed:
            break
        pick = _pick(one, branches, preference, valid, index, deadline)
        q[i], work[i, 0], passed[i], refused[i] = pick.q, pick.evaluations, pick.passed, pick.refused
        late[i] = pick.out_of_time
    solution = conclude(problem, q, work, late)
    if not shape:
        return replace(solution, success=solution.success and bool(passed[0]), rejected=int(refused[0]))
    return replace(
        solution, success=solution.success & passed.reshape(shape), rejected=refused.reshape(shape)
    )


class Pick(NamedTuple):
    """The solution for one target."""

    q: Array
    """Joint values, (n,)."""
    evaluations: int
    passed: bool
    """Whether `valid` accepted it, if there is one."""
    refused: int
    """Number of solutions that `valid` rejected."""
    out_of_time: bool


class Slide(NamedTuple):
    """End point of an optimisation along the self-motion."""

    q: Array
    """Joint values, (n,)."""
    cost: float
    evaluations: int
    refused: int


def _pick(
    problem: Problem,
    branches: Branches,
    preference: Preference,
    valid: Valid | None,
    index: BranchIndex,
    deadline: Deadline,
) -> Pick:
    """Choose a solution for one target."""
    candidates, spent, refused = branches.q, branches.evaluations, 0
    # The atlas sometimes reaches a pose at which the search for branches finds nothing.
    if not len(candidates):
        last = Atlas().solve(replace(problem, time_limit=deadline.left))
        spent += last.evaluations
        if not last.success:
            # The target is missed: the errors show it, and `valid` was not called.
            return Pick(last.q, spent, True, 0, last.out_of_time)
        candidates = last.q[None]
    candidates, at_angle, walked = _by_posture(problem, preference, candidates, index, deadline)
    spent += walked
    if valid is not None:
        while refused < len(candidates) and not is_valid(valid, candidates[refused]):
            refused += 1
        if refused == len(candidates):
            return Pick(candidates[0], spent, False, refused, branches.out_of_time)
    best = candidates[refused]
    if not index.freedom or refused < at_angle:
        return Pick(best, spent, True, refused, branches.out_of_time)
    posture, least = preference.posture, preference.mismatches(best)

    def measure(q: Array) -> Array:
        if posture is None or posture.arm_angle is None:
            return _scores(problem, q, preference)
        return _angle_errors(posture, q)

    def keeps(q: Array) -> bool:
        return preference.mismatches(q) <= least

    # With `valid` each further start costs the user's calls, so only the best accepted solution is improved.
    starts = [best] if valid is not None else [q for q in candidates[:_SLIDERS] if keeps(q)]
    slides = [slide(problem, index, start, measure, valid, deadline, keeps) for start in starts]
    spent += sum(slide.evaluations for slide in slides)
    refused += sum(slide.refused for slide in slides)
    return Pick(min(slides, key=lambda slide: slide.cost).q, spent, True, refused, deadline.passed)


def _scores(problem: Problem, q: Array, preference: Preference) -> Array:
    return scores(problem, q, preference.order, preference.cost)


def _by_posture(
    problem: Problem, preference: Preference, candidates: Array, index: BranchIndex, deadline: Deadline
) -> tuple[Array, int, int]:
    """Sort solutions of one target by posture; if an arm angle is requested, solutions at this angle come first.

    Returns:
        The solutions, (k, n); how many of them have a requested arm angle; FK evaluations spent.
    """
    posture = preference.posture
    if posture is None or posture.arm_angle is None:
        return preference.sorted(candidates), 0, 0
    starts, spent = candidates, 0
    if problem.near is not None:
        nearest, target = np.empty_like(problem.near), np.ascontiguousarray(problem.goal.targets[0])
        *_, spent, met = solve_goal(
            index.fine.address, tolerances_of(problem.goal), target, problem.near, True, nearest
        )
        starts = np.concatenate([nearest[None][:met], candidates])
    walked = walk_to_arm_angle(problem, posture, starts, deadline)
    found = full_turn_copies(problem.chain, walked.q) if preference.copies else walked.q
    found = found[np.argsort(_scores(problem, found, preference), kind="stable")]
    # `valid` may reject all of them, and accept a solution at another angle.
    others = candidates[np.argsort(_angle_errors(posture, candidates), kind="stable")]
    each = [preference.sorted(found), preference.sorted(others)]
    return np.concatenate(each), len(found), spent + walked.evaluations


def _angle_errors(posture: PostureRequest, q: Array) -> Array:
    """Return how far each of some solutions, (k, n), is from the requested arm angle, (k,) [rad]."""
    return np.nan_to_num(np.abs(posture.angle_errors(q)[0]), nan=np.pi)


def slide(
    problem: Problem,
    index: BranchIndex,
    q: Array,
    measure: Callable[[Array], Array],
    valid: Valid | None,
    deadline: Deadline,
    keeps: Callable[[Array], bool] = lambda q: True,
) -> Slide:
    """Minimise a cost along the self-motion.

    Every step follows the gradient inside the null space of what the goal constrains. It is projected back onto the
    self-motion by the atlas's refinement. The step is accepted only if the tolerances are met, the cost decreases, `keeps`
    returns True for the result, and `valid` accepts it.
    """
    goal = problem.goal
    if goal.form.ranges:
        return _slide_in_ranges(problem, q, measure, valid, deadline)
    tolerances, target = tolerances_of(goal), np.ascontiguousarray(goal.targets[0])
    value, step, spent, refused = float(measure(q[None])[0]), _FIRST, 0, 0
    lower, upper = problem.limits
    for _ in range(_SLIDES):
        if deadline.passed:
            break
        accepted = False
        # From here q is the same until a step is accepted, so the directions are computed once.
        ways = _ways_down(problem, index, q, measure)
        while ways and not accepted and step > _LAST:
            for way in ways:
                aim = np.clip(q + step * way, lower, upper)
                reached = np.empty_like(q)
                *_, evaluations, met = solve_goal(index.fine.address, tolerances, target, aim, True, reached)
                # A continuous joint that leaves its range re-enters at the other end, and the cost is evaluated there.
                there = problem.placed(reached)
                spent += evaluations
                # The refinement may jump to another branch, which is not a step along the self-motion.
                if not met or np.abs(reached - aim).max() > 2 * step:
                    continue
                less = float(measure(there[None])[0])
                if less >= value or not keeps(there):
                    continue
                if valid is not None and not is_valid(valid, there):
                    refused += 1
                    continue
                q, value, accepted = there, less, True
                break
            # Line search without derivatives: a success lengthens the next step, a failure shortens it.
            step = 1.5 * step if accepted else 0.5 * step
        if not accepted:
            break
    return Slide(q, value, spent, refused)


def _slide_in_ranges(
    problem: Problem, q: Array, measure: Callable[[Array], Array], valid: Valid | None, deadline: Deadline
) -> Slide:
    """Do the same for a goal with ranges, with virtual joints for them."""
    more, refused = extended(problem), 0

    def accepted(whole: Array) -> bool:
        nonlocal refused
        if not more.accepts(whole[None])[0]:
            return False
        if valid is None or is_valid(valid, whole[more.own]):
            return True
        refused += 1
        return False

    end = slide(
        more.problem,
        index_of(more.problem),
        more.with_virtual(q[None])[0],
        lambda many: measure(many[:, more.own]),
        None if valid is None and more.exact else accepted,
        deadline,
    )
    reached = problem.placed(end.q[more.own])
    met = problem.goal.met(problem.errors_of(reached[None]))[0]
    return Slide(reached if met else q, end.cost, end.evaluations, refused)


def _ways_down(
    problem: Problem, index: BranchIndex, q: Array, measure: Callable[[Array], Array]
) -> list[Array]:
    """Return unit directions in the null space in which the cost decreases, the steepest first; none if the cost is flat.

    A joint at a limit that would be pushed beyond it is fixed, and the null space is computed again.
    """
    dof, (lower, upper) = problem.chain.dof, problem.limits
    J = constraint_jacobian(problem, q[None])[0]
    at_limit = np.zeros(dof, dtype=bool)
    while index.freedom > at_limit.sum():
        rows = np.vstack([J, np.eye(dof)[at_limit]])
        null = np.linalg.svd(rows)[2][dof - index.freedom + int(at_limit.sum()) :]
        # Central differences, because the cost is an arbitrary function of the user.
        probes = np.concatenate([q + _PROBE * null, q - _PROBE * null])
        values = measure(np.clip(probes, lower, upper))
        slopes = values[: len(null)] - values[len(null) :]
        down = -slopes @ null
        if np.linalg.norm(down) == 0.0:
            return []
        down /= np.linalg.norm(down)
        blocked = ((q <= lower) & (down < -1e-9)) | ((q >= upper) & (down > 1e-9))
        if not (blocked & ~at_limit).any():
            return [down]
        at_limit |= blocked
    return []
