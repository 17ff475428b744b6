"""Solutions of a redundant arm at a given arm angle: Newton's method along its self-motion."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.derivatives import constraint_jacobian
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Array
from kinseek.postures import PostureRequest
from kinseek.problem import Problem, within_limits
from kinseek.support.deadline import Deadline
from kinseek.support.transforms import rotation_vectors
from kinseek.support.turns import nearest_turns
from kinseek.virtual_joints import extended

STEPS = 40
"""Largest number of steps; half a turn of the arm angle takes eleven. Not examined further."""

AT_ONCE = 0.3
"""Largest change of the arm angle in a step, and of a joint [rad or m]. Larger steps leave the curve of solutions."""

EXACT = 1e-12
"""Error of the arm angle [rad] and of the goal at which a walk ends."""

DAMPING = 1e-12
"""Added to the diagonal of J Jᵀ, which may be singular: a pointing goal has three rows for two components. The error of the
step is corrected by the next one."""

MET = 1e-10
"""Largest error of the arm angle of a solution [rad]."""


class Walked(NamedTuple):
    """Ends of the walks that reached the arm angle."""

    q: Array
    """Joint values, (k, n), inside the limits."""
    evaluations: int


def walk_to_arm_angle(problem: Problem, posture: PostureRequest, starts: Array, deadline: Deadline) -> Walked:
    """Move solutions of one target to a requested arm angle, and return those that arrive inside the limits.

    Each step solves the linear equations for the goal and the arm angle; if the arm is still redundant, the shortest step is
    taken.

    Args:
        problem: One target.
        posture: What is requested, an arm angle among it.
        starts: Solutions, or joint values close to one, (k, n).
        deadline: When to end.
    """
    # The joints of an arm with virtual joints for the ranges of a goal move, too; the arm angle is that of the arm itself.
    more = extended(problem, inside=True)
    q, spent, own = more.with_virtual(starts), 0, more.own
    walking = np.ones(len(q), dtype=np.bool_)
    for _ in range(STEPS):
        moving = np.flatnonzero(walking)
        if not len(moving) or deadline.passed:
            break
        some = q[moving]
        off, gradients = np.empty(len(some)), np.zeros_like(some)
        off[:], gradients[:, own] = posture.angle_errors(some[:, own])
        error = _error(more.problem, some)
        spent += len(some)
        done = (np.abs(off) < EXACT) & (np.abs(error).max(axis=1) < EXACT)
        lost = np.isnan(off)
        walking[moving[done | lost]] = False
        q[moving[lost]] = np.nan
        going = ~(done | lost)
        if not going.any():
            break
        rows = np.concatenate(
            [constraint_jacobian(more.problem, some[going]), gradients[going, None, :]], axis=1
        )
        wanted = np.concatenate([error[going], np.clip(off[going], -AT_ONCE, AT_ONCE)[:, None]], axis=1)
        across = np.swapaxes(rows, 1, 2)
        step = (
            across @ np.linalg.solve(rows @ across + DAMPING * np.eye(rows.shape[1]), wanted[:, :, None])
        )[:, :, 0]
        largest = np.abs(step).max(axis=1)
        q[moving[going]] += step * np.minimum(1.0, AT_ONCE / np.maximum(largest, AT_ONCE))[:, None]
    q = q[~np.isnan(q).any(axis=1)][:, own]
    return Walked(_inside(problem, posture, q), spent)


def _inside(problem: Problem, posture: PostureRequest, q: Array) -> Array:
    """Choose full turns, and return the joint values, (k, n), that are solutions at the requested arm angle."""
    chain, (lower, upper) = problem.chain, problem.limits
    q = problem.placed(np.where(chain.endless, q, within_limits(chain, q)))
    if problem.near is not None:
        nearer = q + np.where(chain.periodic, nearest_turns(problem.near - q), 0.0)
        q = np.where((nearer >= lower) & (nearer <= upper), nearer, q)
    met = problem.goal.met(problem.errors_of(q))
    return q[met & (np.abs(posture.angle_errors(q)[0]) < MET) & ((q >= lower) & (q <= upper)).all(axis=1)]


def _error(problem: Problem, q: Array) -> Array:
    """Return how far the target is from the poses of joint values, in the rows of `constraint_jacobian`, (k, rows)."""
    reached, target = forward_many(problem.arrays, np.ascontiguousarray(q)), problem.goal.targets[0]
    position, columns = target[:, 3] - reached[:, :3, 3], problem.goal.columns
    if columns == 0:
        return np.asarray(position)
    if columns == 1:
        normal = np.cross(reached[:, :3, 0], target[:, 0])
        sine = np.linalg.norm(normal, axis=1)
        angle = np.arctan2(sine, reached[:, :3, 0] @ target[:, 0])
        turn = normal * (angle / np.maximum(sine, 1e-300))[:, None]
    else:
        turn = rotation_vectors(target[:, :3] @ np.swapaxes(reached[:, :3, :3], 1, 2))
    return np.concatenate([position, turn], axis=1)
