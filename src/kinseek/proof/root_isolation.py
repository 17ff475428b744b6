"""Prove that a list of solutions is complete.

A neighbourhood around every solution is proved to contain only solutions near it, and at most one joint vector that reaches
the goal exactly. The rest of the joint space is cut into boxes, and each is excluded as in `branch_and_bound`. Solutions
that are missing in the list are found during this search. See `kernels.proof.root_isolation`; docs/proof_explained.md has
the proof.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.arrays import Array
from kinseek.kernels.proof.progress import COUNT, KNOWN, LEFT
from kinseek.kernels.proof.root_isolation import MOST, OFTEN, STEPS
from kinseek.problem import Problem, as_joints
from kinseek.support.deadline import Deadline
from kinseek.support.turns import shortest
from kinseek.support.validation import as_integer

from .boxes import ENDLESS, Run, Watch, places_for, tuning_of
from .reduce import question, start_boxes
from .rounding import gamma

BUDGET = 200_000
"""Default number of boxes: a fraction of a second."""


@dataclass(frozen=True, eq=False)
class Isolation:
    """Solutions, one per branch, and whether they are proved to be complete.

    If `complete`, every joint vector inside the limits that meets both tolerances lies within `distance[i]` of `q[i]` for
    one i, joint by joint, modulo whole turns. These are k neighbourhoods, and each contains at most one joint vector that
    reaches the goal exactly. So modulo whole turns at most k joint vectors reach it exactly.
    """

    complete: bool
    """Whether the list is proved to be complete."""
    q: NDArray[np.float64]
    """The given solutions, one of each branch, then those found; inside the limits, (k, n), [rad] or [m]."""
    distance: NDArray[np.float64]
    """How far the tolerances reach along each joint, (k, n), [rad] or [m]; infinite for a singular solution."""
    given: NDArray[np.int64]
    """Index among the given solutions, or -1 for a solution that was found, (k,)."""
    exact: NDArray[np.bool_]
    """Whether it is proved that exactly one joint vector of the neighbourhood, inside the limits, reaches the goal exactly,
    (k,).

    This requires as many joints as the goal has constraints. It is never the case for a solution at a limit, since the exact
    solution may lie beyond the limit."""
    boxes: int
    """Boxes examined."""
    undecided: int
    """Number of remaining boxes; 0 if `complete`."""
    periodic: NDArray[np.bool_]
    """Whether whole turns of the joint make no difference, (n,)."""
    out_of_time: bool = False
    """Whether a time limit ended the search before its budget did."""

    @property
    def solutions(self) -> int | None:
        """Return how many joint vectors inside the limits reach the goal exactly, modulo whole turns; None if not proved.

        The list has to be complete, each solution `exact`, and no two solutions may be the same. Two solutions are distinct
        if their distance exceeds the sum of both `distance` values.
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
        """Return a short representation for a shell."""
        known = "complete" if self.complete else f"not proved complete, {self.undecided} boxes left"
        found = int((self.given < 0).sum())
        if self.solutions is not None:
            known = f"complete, exactly {self.solutions} solutions"
        return f"Isolation({len(self.q)} solutions, {found} of them not given; {known}; {self.boxes} boxes)"


def isolate(
    problem: Problem,
    solutions: ArrayLike | None = None,
    *,
    budget: int = BUDGET,
    trust: float = 1.0,
    deadline: Deadline = ENDLESS,
) -> Isolation:
    """Prove that a goal has only the given solutions, or find others.

    A proof cannot separate singular solutions from their neighbours. With one of them, and for redundant arms, the result is
    not complete.

    Args:
        problem: One target.
        solutions: Joint values that meet the tolerances, (k, n); without them all solutions are searched.
        budget: Largest number of boxes to examine, >= 0.
        trust: 1; tests scale every bound by a smaller value to check that they notice it.
        deadline: When to stop; the result contains what was found by then, and is not complete.

    Raises:
        InvalidProblem: A batch; a negative budget; solutions of a wrong shape, or outside the limits or the tolerances.
    """
    goal, chain = problem.goal, problem.chain
    if goal.shape:
        raise InvalidProblem(f"a proof is about one target, got a batch of shape {goal.shape}")
    budget = as_integer("budget", budget, 0, error=InvalidProblem)
    known = _checked(problem, solutions)
    reduction = question(problem, trust)
    without_last = reduction[2].present
    boxes = start_boxes(chain, without_last)
    # A redundant arm has continua of solutions, which no neighbourhood can isolate.
    if chain.dof > goal.form.constraints:
        nothing, never = np.full(known.shape, np.inf), np.zeros(len(known), dtype=np.bool_)
        return Isolation(False, known, nothing, np.arange(len(known)), never, 0, len(boxes), chain.periodic)
    dof = boxes.shape[1] // 2
    places = places_for(known, chain.periodic[:dof].copy(), MOST + len(known))
    run = Run(problem, reduction, boxes, np.zeros(chain.dof), tuning_of(problem, OFTEN, STEPS), places=places)
    watch = Watch(deadline)
    run.go(budget, watch)
    count, left = int(run.counts[KNOWN]), int(run.counts[COUNT] + run.counts[LEFT])
    q, distance = places.q[:count].copy(), _distances(problem, places.distance[:count], without_last)
    # The exact solution may be anywhere within `room` of the given one, so the whole of it must lie inside the limits.
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
    problem: Problem, solutions: ArrayLike, *, budget: int = BUDGET, deadline: Deadline = ENDLESS
) -> tuple[Array, bool]:
    """Complete the solutions of `Arm.branches`: return all known ones, (k, n), and whether they are proved to be all.

    The call is ``q, complete = prove_complete(Problem(chain, goal), q)``. Every given solution is returned: at the boundary
    of the workspace two of them may be too close together for a proof to separate them.

    Raises:
        InvalidProblem: As `isolate`.
    """
    isolation = isolate(problem, solutions, budget=budget, deadline=deadline)
    found = isolation.q[isolation.given < 0]
    return np.concatenate(
        [np.asarray(solutions, dtype=float).reshape(-1, problem.chain.dof), found]
    ), isolation.complete


def _checked(problem: Problem, solutions: ArrayLike | None) -> Array:
    chain, goal = problem.chain, problem.goal
    if solutions is None:
        return np.empty((0, chain.dof))
    known = as_joints(chain, solutions, "solutions")
    if known.ndim != 2:
        raise InvalidProblem(f"solutions must have shape (k, {chain.dof}), got {known.shape}")
    outside = np.argwhere((known < chain.lower) | (known > chain.upper))
    if len(outside):
        row, i = (int(each) for each in outside[0])
        raise InvalidProblem(
            f"solutions must lie inside the limits, got {known[row, i]:.6g} for joint {chain.joint_names[i]!r} in row "
            f"{row}; its range is [{chain.lower[i]:.6g}, {chain.upper[i]:.6g}]"
        )
    targets = np.repeat(goal.targets, len(known), axis=0)
    measured = judge(problem.arrays, known, targets, goal.arrays)
    missed = (measured[:, 0] > goal.position_tolerance) | (measured[:, 1] > goal.orientation_tolerance)
    if missed.any():
        row = int(missed.argmax())
        raise InvalidProblem(
            f"solutions must meet the tolerances {goal.position_tolerance:g} m and {goal.orientation_tolerance:g} rad, "
            f"row {row} misses the goal by {measured[row, 0]:.3g} m and {measured[row, 1]:.3g} rad"
        )
    return np.ascontiguousarray(known)


def _roomy(distance: Array, q: Array) -> Array:
    """Enlarge distances by the rounding error of adding them to joint values or comparing them with differences."""
    return np.asarray(distance * (1.0 + gamma(16)) + gamma(16) * (2.0 * math.pi + np.abs(q)))


def _distances(problem: Problem, reduced: Array, without_last: bool) -> Array:
    """Convert distances from the centre of a neighbourhood into distances from a solution within it, last joint included."""
    # Both a solution and the given one may be this far from the centre, on opposite sides.
    distance, chain = 2.0 * reduced, problem.chain
    if not without_last:
        return distance
    # The pose determines the last joint, up to what the other joints and the tolerance at both solutions turn the hand.
    turning = [k for k in range(len(chain.leader) - 1) if not chain.prismatic[k]]
    rotation = sum(abs(chain.multiplier[k]) * distance[:, chain.leader[k]] for k in turning)
    last = np.minimum(rotation + 2.0 * min(problem.goal.orientation_tolerance, math.pi), math.pi)
    return np.column_stack([distance, np.broadcast_to(last, len(distance))])
