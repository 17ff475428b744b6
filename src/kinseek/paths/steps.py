"""Steps of a path from pose to pose: which are too long, which collide, and which no arm could make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.robots import SerialChain

from .between import apart
from .joints import Turning
from .request import PathRequest

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def steps_of(request: PathRequest, q: Array) -> tuple[Array, Array]:
    """Return the start and end of each step of a path, (N - 1, n), or of its first poses.

    A closed path includes the step from the last pose to the first, (N, n).
    """
    if not request.closed or len(q) == 1 or len(q) < len(request):
        return q[:-1], q[1:]
    back = q[-1] + Turning(request.problem.chain).way(q[0] - q[-1])
    return q, np.concatenate([q[1:], back[None]])


def short_steps(request: PathRequest, begin: Array, end: Array) -> Flags:
    """Return for each step of `steps_of` whether every joint stays within its longest step."""
    return np.asarray((np.abs(end - begin) <= request.longest[: len(begin)] * (1 + 1e-9)).all(axis=1))


def open_beside(request: PathRequest, missed: Flags) -> Array:
    """Return the largest steps without a bound to and from the missed poses, (N,): these steps cannot break."""
    longest = request.longest.copy()
    longest[: len(missed) - 1][missed[:-1] | missed[1:]] = np.inf
    return longest


def beyond_a_step(chain: SerialChain, longest: Array, distance: Array, turn: Array) -> tuple[Flags, Flags]:
    """Return whether a distance [m] and an angle [rad], (k,) each, exceed what the longest joint steps, (k, n), can cause.

    The bound on the distance assumes that no joint moves the hand faster than the arm's length allows.
    """
    return distance > chain.reach * longest.sum(axis=1), turn > longest[:, chain.turns].sum(axis=1)


def faulty(request: PathRequest, q: Array) -> Flags:
    """Return for each step of an open path, (N - 1,), whether it is a break or collides."""
    fine = short_steps(request, q[:-1], q[1:])
    if request.valid is not None:
        fine[fine] = request.valid.free_ways(q[:-1][fine], q[1:][fine])
    return ~fine


def avoidable(request: PathRequest) -> Flags:
    """Return for each step of an open path, (N - 1,), whether the joints could be fast enough to make it without a break."""
    goal = request.problem.goal
    distance, turn = apart(goal.target[:-1], goal.target[1:])
    distance, turn = distance - 2 * goal.position_tolerance, turn - 2 * goal.orientation_tolerance
    torn, turned = beyond_a_step(request.problem.chain, request.longest, distance, turn)
    if goal.columns == 3:
        # Only a goal with a whole orientation fixes how far the hand has to turn.
        torn = torn | turned
    return np.asarray(~torn | (goal.ranges is not None))
