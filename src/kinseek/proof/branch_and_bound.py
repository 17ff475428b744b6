"""Prove by branch and bound that a goal is out of reach, or bound the least error of any pose.

Boxes of joint values are halved repeatedly. Each is tested by the bounds of `kernels.proof.bounds`: first by a bound for the
whole box, then by one linear form of the hand's pose to second order, which also cuts the box from its sides. If no box is
left, nothing inside the limits reaches the goal. With the best box first, the same search encloses the least error. (Land &
Doig 1960; in robotics Rao, Asaithambi & Agrawal 1998, who solve inverse kinematics by interval analysis.)
"""

from __future__ import annotations

import math
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from kinseek.errors import InternalError, InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.gate import least_by_gate
from kinseek.kernels.proof.progress import ENDED, FOUND
from kinseek.problem import Problem
from kinseek.solution import Solution, conclude
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline
from kinseek.support.validation import as_integer
from kinseek.virtual_joints import extended

from .boxes import ENDLESS, Watch, enclosed, excluded
from .certificate import Certificate, Verdict
from .reduce import error_question, slack_of_error
from .rounding import gamma

BUDGET = 2_000_000
"""Default number of boxes: some seconds."""


def prove(
    problem: Problem,
    *,
    gap: float | None = None,
    budget: int = BUDGET,
    solution: Solution | None = None,
    threads: int | None = None,
    deadline: Deadline = ENDLESS,
) -> Certificate:
    """Prove that a goal is out of reach, or find joint values that reach it.

    Args:
        problem: One target.
        gap: If the goal is not reached, continue until the bounds of the least weighted error are this close, relative to
            the upper one, > 0. None skips this second search.
        budget: Largest number of boxes examined by both searches, >= 0; the bounds hold whenever the search stops.
        solution: A solution of the same problem, if known; otherwise the atlas is used.
        threads: Threads that share the boxes; None uses every core. The certificate has the same bits for any number.
        deadline: When to stop. The bounds hold then too, and the certificate reports that its time was up.

    Raises:
        InvalidProblem: The problem is a batch, even an empty one; a gap or budget is out of its range; or an arm or a goal
            is so large that rounding allows no proof.
        InternalError: A bound contradicts a known pose, which is a bug in kinseek.
    """
    if problem.goal.shape:
        raise InvalidProblem(f"a proof is about one target, got a batch of shape {problem.goal.shape}")
    if gap is not None and not (isinstance(gap, int | float | np.floating) and 0.0 < gap < 1.0):
        raise InvalidProblem(f"gap must be a number in (0, 1), got {gap!r:.200}")
    if problem.goal.form.ranges:
        return _prove_in_ranges(problem, gap, budget, solution, threads, deadline)
    budget = as_integer("budget", budget, 0, error=InvalidProblem)
    best = solution if solution is not None else Atlas().solve(replace(problem, budget=None))
    if best.success:
        return _certificate(problem, Verdict.REACHABLE, best.q, 0.0, 0, 0.0)
    watch = Watch(deadline)
    search = excluded(problem, budget, threads=threads, watch=watch)
    if search.outcome == FOUND:
        return _certificate(problem, Verdict.REACHABLE, search.q, 0.0, search.boxes, 0.0)
    # The proof evaluates poses as well, and may have found a better one than the search.
    q = search.q if search.upper < best.weighted_error else best.q
    verdict, boxes, lower, largest = Verdict.UNDECIDED, search.boxes, 0.0, search.largest
    if search.outcome == ENDED:
        verdict, lower = Verdict.UNREACHABLE, least_outside(problem.goal)
        if boxes == 0:  # The quick check gives a lower bound of the error.
            form, proof_goal, _ = error_question(problem, q, 0.5)
            lower = max(lower, least_by_gate(form, proof_goal, problem.arrays))
    if gap is not None:
        nearest = enclosed(problem, q, gap, budget - boxes, threads=threads, watch=watch)
        q, boxes, largest = nearest.q, boxes + nearest.boxes, nearest.largest
        lower = max(lower, nearest.lower)
    certificate = _certificate(problem, verdict, q, lower, boxes, largest, watch.cut)
    goal = problem.goal
    met = certificate.position_error <= goal.position_tolerance
    if met and certificate.orientation_error <= goal.orientation_tolerance:
        # Both cannot be true: an error in kinseek is reported instead of a wrong verdict.
        if verdict is Verdict.UNREACHABLE:
            raise contradiction(
                "all boxes are excluded, and the pose of q meets both tolerances", certificate
            )
        return replace(certificate, verdict=Verdict.REACHABLE, lower_bound=0.0, out_of_time=False)
    most = most_inside(goal)
    # The bound holds for exact arithmetic, so it must also exceed the rounding error of the measured errors.
    if lower > most and lower > most + slack_of_error(problem):
        return replace(certificate, verdict=Verdict.UNREACHABLE)
    return certificate


def _prove_in_ranges(
    problem: Problem,
    gap: float | None,
    budget: int,
    solution: Solution | None,
    threads: int | None,
    deadline: Deadline,
) -> Certificate:
    """Do the same for a goal with ranges: an arm with virtual joints for them reaches all that they accept.

    If the joints allow more than the ranges do, a pose of that arm proves nothing, and the verdict is UNDECIDED.
    """
    goal = problem.goal
    best = solution if solution is not None else Atlas().solve(replace(problem, budget=None))
    if best.success:
        return _certificate(problem, Verdict.REACHABLE, best.q, 0.0, 0, 0.0)
    more = extended(problem)
    found = prove(more.loosened, gap=gap, budget=budget, threads=threads, deadline=deadline)
    verdict = found.verdict
    # The error of a whole orientation counts two axes, so it is at most twice that of a goal with ranges.
    lower = found.lower_bound if more.problem.goal.columns < 3 else 0.5 * found.lower_bound
    lower = 0.0 if more.leverage else lower
    q = problem.placed(found.q[more.own])
    errors = problem.errors_of(q[None])
    met = bool(goal.met(errors)[0])
    if met:
        verdict, lower = Verdict.REACHABLE, 0.0
    elif verdict is Verdict.UNREACHABLE:
        lower = max(lower, least_outside(more.problem.goal))
    elif verdict is Verdict.REACHABLE:
        verdict, lower = Verdict.UNDECIDED, 0.0
    if not met and best.weighted_error < errors[0, 2]:
        q = best.q
    return _certificate(problem, verdict, q, lower, found.boxes, found.largest_box, found.out_of_time)


def least_outside(goal: Goal) -> float:
    """Return the least weighted error that misses a tolerance."""
    position = goal.position_weight * goal.position_tolerance
    angle = min(goal.orientation_tolerance, math.pi)
    turn = goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2
    return (position if goal.columns == 0 else min(position, turn)) * (1.0 - gamma(16))


def most_inside(goal: Goal) -> float:
    """Return the largest weighted error within both tolerances."""
    position = goal.position_weight * goal.position_tolerance
    axes = goal.paper_columns
    angle = min(goal.orientation_tolerance, math.pi)
    return (position + axes * goal.orientation_weight * 2.0 * math.sin(angle / 2) ** 2) * (1.0 + gamma(16))


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
    certificate = Certificate(
        verdict=verdict,
        q=judged.q,
        lower_bound=float(lower) if lower > 0.0 else 0.0,  # NaN is treated as no bound.
        upper_bound=upper,
        position_error=float(judged.position_error),
        orientation_error=float(judged.orientation_error),
        boxes=int(boxes),
        largest_box=float(largest),
        problem=problem,
        out_of_time=out_of_time,
    )
    if certificate.lower_bound <= upper:
        return certificate
    # Rounding alone may cause this if both bounds almost agree; a larger difference shows that a bound is wrong.
    if certificate.lower_bound > upper + slack_of_error(problem):
        raise contradiction("the lower bound is above the error of a known pose", certificate)
    return replace(certificate, lower_bound=upper)


def contradiction(what: str, certificate: Certificate) -> InternalError:
    """Create the error to raise if a certificate contradicts itself, with all data for a bug report."""
    problem = certificate.problem
    chain, goal = problem.chain, problem.goal
    try:
        release = version("kinseek")
    except PackageNotFoundError:
        release = "not installed"
    given = {
        "kinseek": release,
        "arm": f"{chain.name!r} with {chain.dof} joints",
        "lower": chain.lower.tolist(),
        "upper": chain.upper.tolist(),
        "fixed": chain.fixed.tolist(),
        "goal": f"{goal.kind}, {goal.targets[0].tolist()}",
        "tolerances": f"{goal.position_tolerance!r} m, {goal.orientation_tolerance!r} rad",
        "weights": f"{goal.position_weight!r}, {goal.orientation_weight!r}",
        "q": certificate.q.tolist(),
        "lower bound": repr(certificate.lower_bound),
        "upper bound": repr(certificate.upper_bound),
        "errors of q": f"{certificate.position_error!r} m, {certificate.orientation_error!r} rad",
        "boxes": certificate.boxes,
    }
    report = "; ".join(f"{name}: {value}" for name, value in given.items())
    return InternalError(
        f"a proof contradicts itself: {what}. This is a fault of kinseek; rely on no result of this call, and please "
        f"report what follows. {report}"
    )
