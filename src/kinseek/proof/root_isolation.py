"""Prove of a list of answers that there are no others.

Around every answer a neighbourhood is proved to hold only answers near it, and at most one joint vector that reaches the
goal exactly; the rest of the joint space is cut into boxes, and each is excluded as in `branch_and_bound`. Answers that the
list lacks are found on the way. See `kernels.proof.isolation`; docs/proof.md has the proof.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.deadline import Deadline
from kinseek.errors import InvalidProblem
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.progress import COUNT, KNOWN, LEFT
from kinseek.kernels.proof.root_isolation import MOST, OFTEN, STEPS
from kinseek.problem import Problem, as_joints
from kinseek.turns import shortest
from kinseek.validation import as_integer

from .boxes import ENDLESS, Run, Watch, places_for, tuning_of
from .reduce import question, start_boxes
from .rounding import gamma

BUDGET = 200_000
"""Boxes, unless told otherwise: a fraction of a second."""


@dataclass(frozen=True, eq=False)
class Isolation:
    """Answers, one a branch, and whether it is proved that there are no others.

    If `complete`, every joint vector inside the limits that meets both tolerances lies within `distance[i]` of `q[i]` for
    one i, joint by joint, whole turns left out of account. These are k neighbourhoods, and in each of them at most one joint
    vector reaches the goal exactly. So modulo whole turns at most k joint vectors reach it exactly.
    """

    complete: bool
    """Is it proved?"""
    q: NDArray[np.float64]
    """The answers given, one of those that share a branch, then those found; inside the limits, (k, n), [rad] or [m]."""
    distance: NDArray[np.float64]
    """How far the tolerances reach along each joint, (k, n), [rad] or [m]; infinite for a singular answer."""
    given: NDArray[np.int64]
    """Which of the answers given it is, or -1 for one that was not among them, (k,)."""
    exact: NDArray[np.bool_]
    """Is it proved that exactly one joint vector of the neighbourhood reaches the goal exactly, inside the limits? (k,)

    That takes as many joints as the goal has constraints. It is never so for an answer at a limit: the solution beside it
    may lie beyond.
    """
    boxes: int
    """Boxes examined."""
    undecided: int
    """Boxes that are left; 0 if `complete`."""
    periodic: NDArray[np.bool_]
    """Is a whole turn of the joint as good as none? (n,)"""
    out_of_time: bool = False
    """Did a time limit end the search, before its budget did?"""

    @property
    def solutions(self) -> int | None:
        """How many joint vectors inside the limits reach the goal exactly, modulo whole turns, if that is proved; else None.

        The list has to be complete, each answer `exact`, and no two solutions may be the same: they are told apart where the
        answers are farther from each other than both distances together.
        """
        if not (self.complete and self.exact.all()):
            return None
        for i in range(len(self.q)):
            away = np.abs(self.q[:i] - self.q[i])
            away = np.where(self.periodic, np.abs(shortest(away)), away)
            if not (away > _roomy(self.distance[:i] + self.distance[i], self.q[i])).any(axis=1).all():
                return None
        return len(self.q)

    def __repr__(self) -> str:
        """Short enough to print in a shell."""
        known = "complete" if self.complete else f"not proved complete, {self.undecided} boxes left"
        found = int((self.given < 0).sum())
        if self.solutions is not None:
            known = f"complete, exactly {self.solutions} solutions"
        return f"Isolation({len(self.q)} answers, {found} of them not given; {known}; {self.boxes} boxes)"


def isolate(
    problem: Problem,
    answers: ArrayLike | None = None,
    *,
    budget: int = BUDGET,
    trust: float = 1.0,
    deadline: Deadline = ENDLESS,
) -> Isolation:
    """Prove that a goal has no other answers than those given, or find some.

    Singular answers cannot be told from their neighbours: with one of them, and for arms that have joints to spare, the
    result is not complete.

    Args:
        problem: One target.
        answers: Joint values that meet the tolerances, (k, n); none by default, then all are looked for.
        budget: Boxes to examine at most, >= 0.
        trust: 1; tests make every bound smaller by it, and must notice.
        deadline: When to stop; what was found by then is in the result, which is not complete.

    Raises:
        InvalidProblem: A batch; a negative budget; answers of a wrong shape, outside the limits or the tolerances.
    """
    goal, chain = problem.goal, problem.chain
    if goal.shape:
        raise InvalidProblem(f"a proof is about one target, got a batch of shape {goal.shape}")
    budget = as_integer("budget", budget, 0, error=InvalidProblem)
    known = _checked(problem, answers)
    asked = question(problem, trust)
    without_last = asked[2].present
    boxes = start_boxes(chain, without_last)
    if chain.dof > goal.form.constraints:
        nothing, never = np.full(known.shape, np.inf), np.zeros(len(known), dtype=np.bool_)
        return Isolation(False, known, nothing, np.arange(len(known)), never, 0, len(boxes), chain.periodic)
    dof = boxes.shape[1] // 2
    places = places_for(known, chain.periodic[:dof].copy(), MOST + len(known))
    run = Run(problem, asked, boxes, np.zeros(chain.dof), tuning_of(problem, OFTEN, STEPS), places=places)
    watch = Watch(deadline)
    run.go(budget, watch)
    count, left = int(run.counts[KNOWN]), int(run.counts[COUNT] + run.counts[LEFT])
    q, distance = places.q[:count].copy(), _distances(problem, places.distance[:count], without_last)
    room = _roomy(distance, q)
    inside = (q - room >= chain.lower) & (q + room <= chain.upper)
    return Isolation(
        complete=left == 0 and bool(places.isolated[:count].all()),
        q=q,
        distance=distance,
        given=places.number[:count].copy(),
        exact=places.exists[:count] & (inside | (chain.periodic & chain.full)).all(axis=1),
        boxes=run.seen,
        undecided=left,
        periodic=chain.periodic,
        out_of_time=watch.cut,
    )


def prove_complete(
    problem: Problem, answers: ArrayLike, *, budget: int = BUDGET, deadline: Deadline = ENDLESS
) -> tuple[Array, bool]:
    """What `Arm.branches` asks for: its answers and those it lacks, (k, n), and whether these are proved to be all.

    The call is ``q, complete = prove_complete(Problem(chain, goal), q)``. Every answer given comes back: at the edge of
    reach two of them may be too close together to be told apart by a proof.

    Raises:
        InvalidProblem: As `isolate`.
    """
    isolation = isolate(problem, answers, budget=budget, deadline=deadline)
    found = isolation.q[isolation.given < 0]
    return np.concatenate(
        [np.asarray(answers, dtype=float).reshape(-1, problem.chain.dof), found]
    ), isolation.complete


def _checked(problem: Problem, answers: ArrayLike | None) -> Array:
    chain, goal = problem.chain, problem.goal
    if answers is None:
        return np.empty((0, chain.dof))
    known = as_joints(chain, answers, "answers")
    if known.ndim != 2:
        raise InvalidProblem(f"answers must have shape (k, {chain.dof}), got {known.shape}")
    outside = np.argwhere((known < chain.lower) | (known > chain.upper))
    if len(outside):
        row, i = (int(each) for each in outside[0])
        raise InvalidProblem(
            f"answers must lie inside the limits, got {known[row, i]:.6g} for joint {chain.joint_names[i]!r} in row "
            f"{row}; its range is [{chain.lower[i]:.6g}, {chain.upper[i]:.6g}]"
        )
    targets = np.repeat(goal.targets, len(known), axis=0)
    measured = judge(problem.arrays, known, targets, goal.arrays)
    missed = (measured[:, 0] > goal.position_tolerance) | (measured[:, 1] > goal.orientation_tolerance)
    if missed.any():
        row = int(missed.argmax())
        raise InvalidProblem(
            f"answers must meet the tolerances {goal.position_tolerance:g} m and {goal.orientation_tolerance:g} rad, "
            f"row {row} misses the goal by {measured[row, 0]:.3g} m and {measured[row, 1]:.3g} rad"
        )
    return np.ascontiguousarray(known)


def _roomy(distance: Array, q: Array) -> Array:
    """Distances with room for what rounding takes where they are added to joint values or compared with differences."""
    return np.asarray(distance * (1.0 + gamma(16)) + gamma(16) * (2.0 * math.pi + np.abs(q)))


def _distances(problem: Problem, reduced: Array, without_last: bool) -> Array:
    """From distances to the centre of a neighbourhood to those from an answer within it, last joint included."""
    distance, chain = 2.0 * reduced, problem.chain
    if not without_last:
        return distance
    turning = [k for k in range(len(chain.leader) - 1) if not chain.prismatic[k]]
    turned = sum(abs(chain.multiplier[k]) * distance[:, chain.leader[k]] for k in turning)
    last = np.minimum(turned + 2.0 * min(problem.goal.orientation_tolerance, math.pi), math.pi)
    return np.column_stack([distance, np.broadcast_to(last, len(distance))])
