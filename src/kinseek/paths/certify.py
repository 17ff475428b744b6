"""Prove that one continuous branch of solutions leads from pose to pose, see `kernels.paths.tube`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import constraint_jacobian
from kinseek.kernels.paths.motion import Margins
from kinseek.kernels.paths.steps import INSIDE, Moves, prove_steps
from kinseek.problem import Problem
from kinseek.proof.reduce import margins, question
from kinseek.solvers.threads import GoOn, parallel_for
from kinseek.support.deadline import Deadline
from kinseek.support.transforms import rotation_vectors

from .joints import Turning

Array = NDArray[np.float64]

RIM, MISSED = 1e-7, 1e3
"""Largest distance [rad] or [m] between joint values and a branch that belongs to them: `RIM` plus `MISSED` times the pose
error. `MISSED` estimates how much a pose error changes joint values away from singularities. The tubes of the steps on both
sides of a pose contain everything within this distance, so both contain the same branch."""

HALF_TURN = 3.0
"""Largest rotation between two poses [rad] for which a proof is tried: near half a turn its axis is not well defined."""

NEAR, MOVES = 0.02, 0.1
"""Thresholds for holding a joint of a redundant arm that approaches a limit. A joint is held on its straight line if it
comes nearer to a limit than `NEAR` [rad] or [m], and a unit step of self-motion moves it by more than `MOVES`. Not examined
further."""

CHUNK, JOINTS = 64, 7
"""Steps that a thread takes at a time, and the number of joints up to which they are proved in one piece: some milliseconds
of work. The work of a step grows about with the square of the number of joints, so the pieces shrink accordingly."""


@dataclass(frozen=True)
class Proved:
    """Result of the proofs for some steps."""

    state: NDArray[np.int64]
    """Status codes, see `kernels.paths.steps.UNPROVED`, (steps,)."""
    within: Array
    """Upper bounds of the distances between the branch and the joint values at both ends of each step, (steps, 2), [rad] or
    [m]."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Return for each step whether the branch is continuous and stays inside the limits."""
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
    """Prove for steps of a path that one branch leads from the joint values of a pose to those of the next.

    Args:
        problem: The arm and N targets: poses, directions or positions, without ranges.
        q: Joint values that reach them, (N, n).
        which: Indices i of the steps from pose i to pose i + 1, in ascending order, (k,).
        keep: Whether the branch must stay inside the limits. If not, steps that leave them may be proved; see `SOMEWHERE`.
        threads: Threads that share the steps; None uses every core.
        rims: Largest accepted distance between the branch and each row, (N,); the default follows from the pose errors.
        limits: Lower and upper limits, (n,) each, infinite for joints without; the default is the arm's limits.
        deadline: No further step is proved after it.
    """
    targets = problem.goal.targets
    count, dof, columns = len(which), q.shape[1], problem.goal.form.columns
    state, within = np.zeros(count, dtype=np.int64), np.full((count, 2), np.inf)
    redundancy = dof - problem.goal.form.constraints
    if not count or redundancy < 0:
        return Proved(state, within)
    begin, end = targets[which], targets[which + 1]
    turns = turns_between(begin, end, columns)
    # A rotation by half a turn or more has no unique axis: the straight motion between the poses is not defined.
    small_turn = np.linalg.norm(turns, axis=1) <= HALF_TURN
    begins, ends = np.ascontiguousarray(q[which]), np.ascontiguousarray(q[which + 1])
    poses, slides = np.ascontiguousarray(begin), np.ascontiguousarray((end - begin)[:, :, 3])
    rim = np.ascontiguousarray(
        (rims_of(problem, q) if rims is None else rims)[np.stack([which, which + 1], axis=1)]
    )
    turning = Turning(problem.chain)
    lower, upper = (turning.open_lower, turning.open_upper) if limits is None else limits
    chain = problem.arrays._replace(lower=lower, upper=upper)
    margins = margins_of(problem, q)

    piece = max(int(CHUNK * min(JOINTS / dof, 1.0) ** 2), 1)

    def some(begin: int, end: int, go_on: GoOn) -> None:
        for first in range(begin, end, piece):
            if not go_on():
                return
            part = slice(first, min(first + piece, end))
            hold = _holds(problem, begins[part], ends[part], redundancy)
            way = poses[part], slides[part], turns[part], begins[part], ends[part]
            moves = Moves(*way, hold, rim[part], small_turn[part])
            prove_steps(chain, columns, moves, keep, margins, state[part], within[part])

    parallel_for(some, count, CHUNK, threads, Deadline() if deadline is None else deadline)
    return Proved(state, within)


def turns_between(begin: Array, end: Array, columns: int) -> Array:
    """Rotation vectors in the base frame that lead from poses to others, (k, 3), [rad]; the shortest ones for directions."""
    if columns == 0:
        return np.zeros((len(begin), 3))
    if columns == 1:
        a, b = begin[:, :, 0], end[:, :, 0]
        axis = np.cross(a, b)
        sine = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(sine, (a * b).sum(axis=1))
        return np.asarray(axis * (angle / np.maximum(sine, 1e-300))[:, None])
    return rotation_vectors(end[:, :, :3] @ np.swapaxes(begin[:, :, :3], 1, 2))


def _holds(problem: Problem, begins: Array, ends: Array, redundancy: int) -> Array:
    """Return the directions in which redundant joints are held on their straight line, (k, redundant, n).

    They follow the self-motion in the middle of a step. A joint that comes near a limit is held itself, so that it stays
    inside.
    """
    if redundancy == 0:
        return np.zeros((len(begins), 0, begins.shape[1]))
    _, _, V = np.linalg.svd(constraint_jacobian(problem, (begins + ends) / 2))
    hold = np.ascontiguousarray(V[:, -redundancy:])
    turning = Turning(problem.chain)
    room = np.minimum(
        np.minimum(begins, ends) - turning.open_lower, turning.open_upper - np.maximum(begins, ends)
    )
    share = np.linalg.norm(hold, axis=1)
    # Without this the straight line along the self-motion would leave the limits.
    for i in np.flatnonzero(((room < NEAR) & (share > MOVES)).any(axis=1)):
        near = np.flatnonzero((room[i] < NEAR) & (share[i] > MOVES))
        near = near[np.argsort(room[i, near], kind="stable")][:redundancy]
        _, _, mix = np.linalg.svd(hold[i][:, near].T)
        hold[i] = np.concatenate([np.eye(begins.shape[1])[near], mix[len(near) :] @ hold[i]])
    return hold


def rims_of(problem: Problem, q: Array) -> Array:
    """Largest accepted distance between the branch of each pose and its joint values, (N, n) -> (N,), [rad] or [m]."""
    errors = problem.goal.measure(problem.arrays, np.ascontiguousarray(q))
    return np.asarray(RIM + MISSED * (errors[:, 0] + errors[:, 1]))


def margins_of(problem: Problem, q: Array) -> Margins:
    """Return the length that scales a radian, and the rounding margins for the farthest target."""
    goal = problem.goal
    # Rounding grows with the lengths, so the margins of the farthest target hold for all.
    farthest = int(np.argmax(np.linalg.norm(goal.targets[:, :, 3], axis=1)))
    one = Problem(problem.mechanism, goal.at(goal.target[farthest]))
    _, proof_goal, _ = question(one)
    angles = np.abs(problem.arrays.multiplier * q[:, problem.arrays.leader]).sum(axis=1).max()
    # The factor 2 covers the two virtual joints that compensate the motion of the hand, and their frames: these add no more
    # rounding error than the arm with its goal.
    margin, margin_a = margins(one, angles=float(angles))
    point, columns = max(margin, proof_goal.margin), max(margin_a, proof_goal.margin_a)
    return Margins(float(proof_goal.length), 2.0 * float(point), 2.0 * float(columns))
