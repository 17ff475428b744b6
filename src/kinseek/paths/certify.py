"""Proofs that one unbroken branch leads from pose to pose, see `kernels.paths.tube`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import constraint_jacobian
from kinseek.deadline import Deadline
from kinseek.kernels.paths.motion import COUNT, LENGTH, MARGIN, MARGIN_A
from kinseek.kernels.paths.steps import INSIDE, prove_steps
from kinseek.problem import Problem
from kinseek.proof.reduce import margins, question
from kinseek.solvers.threads import GoOn, parallel_for

from .between import rotation_vectors
from .joints import Turning

Array = NDArray[np.float64]

RIM, MISSED = 1e-7, 1e3
"""A branch counts as that of a pose if it passes the joint values by less than this [rad] or [m], and so often what the hand
misses the pose by: about what a miss makes of joint values that stand off singularities. Steps on both sides of a pose hold
everything within it in their tubes, so that it is the same branch."""

HALF_TURN = 3.0
"""A turn between two poses of more than this [rad] is no turn that they tell: nothing is proved of it."""

NEAR, LEADS = 0.02, 0.1
"""With joints to spare, one that comes nearer to a limit than this [rad] or [m] is held to its straight way, if a unit of
self-motion moves it by so much at least. By trial."""

CHUNK = 64
"""Steps that a thread takes at a time: some milliseconds."""


@dataclass(frozen=True)
class Proved:
    """What is proved of some steps."""

    state: NDArray[np.int64]
    """See `kernels.paths.steps.UNPROVED`, (steps,)."""
    within: Array
    """How far the branch passes by the joint values at begin and end, at most, (steps, 2), [rad] or [m]."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Does an unbroken branch lead on, inside the limits? Of each step, (steps,)."""
        return np.asarray(self.state == INSIDE)


def prove_rows(
    problem: Problem,
    q: Array,
    which: NDArray[np.int64],
    *,
    keep: bool,
    threads: int | None = 1,
    rims: Array | None = None,
    limits: tuple[Array, Array] | None = None,
    deadline: Deadline | None = None,
) -> Proved:
    """Prove of steps of a path that one branch leads from the joint values of a pose to those of the next.

    Args:
        problem: The arm and N targets: poses, directions or places, without ranges.
        q: Joint values that reach them, (N, n).
        which: Numbers i of the steps from pose i to pose i + 1, in order, (k,).
        keep: Must the branch stay inside the limits? If not, steps may be proved that leave them; see `SOMEWHERE`.
        threads: Threads that share the steps; None takes every core.
        rims: How near a branch must be known to pass by each row, (N,); by default as near as the rows reach the poses.
        limits: Lower and upper, (n,) each, infinite where there are none; those of the arm by default.
        deadline: After it no further step is proved.
    """
    targets = problem.goal.targets
    count, dof, columns = len(which), q.shape[1], problem.goal.form.columns
    state, within = np.zeros(count, dtype=np.int64), np.full((count, 2), np.inf)
    spare = dof - problem.goal.form.constraints
    if not count or spare < 0:
        return Proved(state, within)
    begin, end = targets[which], targets[which + 1]
    turns = turns_between(begin, end, columns)
    request = np.linalg.norm(turns, axis=1) <= HALF_TURN
    begins, ends = np.ascontiguousarray(q[which]), np.ascontiguousarray(q[which + 1])
    given = (
        np.ascontiguousarray(begin),
        np.ascontiguousarray((end - begin)[:, :, 3]),
        turns,
        begins,
        ends,
        _holds(problem, begins, ends, spare),
        np.ascontiguousarray(
            (rims_of(problem, q) if rims is None else rims)[np.stack([which, which + 1], axis=1)]
        ),
        request,
    )
    turning = Turning(problem.chain)
    lower, upper = (turning.open_lower, turning.open_upper) if limits is None else limits
    chain = problem.arrays._replace(lower=lower, upper=upper)
    numbers = numbers_of(problem, q)

    def some(first: int, last: int, go_on: GoOn) -> None:
        if not go_on():
            return
        steps: Any = [each[first:last] for each in given]
        report = state[first:last], within[first:last]
        prove_steps(*[chain, columns, *steps, keep, numbers, *report])

    parallel_for(some, count, CHUNK, threads, Deadline() if deadline is None else deadline)
    return Proved(state, within)


def turns_between(begin: Array, end: Array, columns: int) -> Array:
    """The turns about axes of the base that lead from poses to others, (k, 3), [rad]; of a direction the shortest."""
    if columns == 0:
        return np.zeros((len(begin), 3))
    if columns == 1:
        a, b = begin[:, :, 0], end[:, :, 0]
        axis = np.cross(a, b)
        sine = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(sine, (a * b).sum(axis=1))
        return np.asarray(axis * (angle / np.maximum(sine, 1e-300))[:, None])
    return rotation_vectors(end[:, :, :3] @ np.swapaxes(begin[:, :, :3], 1, 2))


def _holds(problem: Problem, begins: Array, ends: Array, spare: int) -> Array:
    """Directions in which joints to spare are held to their straight way, (k, spare, n).

    Along the self-motion in the middle of a step; but a joint that comes near a limit is held itself: so it stays inside.
    """
    if spare == 0:
        return np.zeros((len(begins), 0, begins.shape[1]))
    _, _, V = np.linalg.svd(constraint_jacobian(problem, (begins + ends) / 2))
    hold = np.ascontiguousarray(V[:, -spare:])
    turning = Turning(problem.chain)
    room = np.minimum(
        np.minimum(begins, ends) - turning.open_lower, turning.open_upper - np.maximum(begins, ends)
    )
    share = np.linalg.norm(hold, axis=1)
    for i in np.flatnonzero(((room < NEAR) & (share > LEADS)).any(axis=1)):
        near = np.flatnonzero((room[i] < NEAR) & (share[i] > LEADS))
        near = near[np.argsort(room[i, near], kind="stable")][:spare]
        _, _, mix = np.linalg.svd(hold[i][:, near].T)
        hold[i] = np.concatenate([np.eye(begins.shape[1])[near], mix[len(near) :] @ hold[i]])
    return hold


def rims_of(problem: Problem, q: Array) -> Array:
    """How near the branch of a pose must be known to pass by joint values, (N, n) -> (N,), [rad] or [m]."""
    errors = problem.goal.measure(problem.arrays, np.ascontiguousarray(q))
    return np.asarray(RIM + MISSED * (errors[:, 0] + errors[:, 1]))


def numbers_of(problem: Problem, q: Array) -> Array:
    """What a radian counts as, and the margins for rounding of the farthest target."""
    goal = problem.goal
    farthest = int(np.argmax(np.linalg.norm(goal.targets[:, :, 3], axis=1)))
    one = Problem(problem.mechanism, goal.at(goal.target[farthest]))
    _, wanted, _ = question(one)
    angles = np.abs(problem.arrays.multiplier * q[:, problem.arrays.leader]).sum(axis=1).max()
    numbers = np.zeros(COUNT)
    numbers[LENGTH] = wanted.length
    # Twice: the two joints that undo the hand's way, and their frames, are no more than the arm with its goal.
    margin, margin_a = margins(one, angles=float(angles))
    numbers[MARGIN] = 2.0 * max(margin, wanted.margin)
    numbers[MARGIN_A] = 2.0 * max(margin_a, wanted.margin_a)
    return numbers
