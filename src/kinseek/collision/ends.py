"""Where a planned motion begins and may end: joint values that are free, from all that `Scene.plan` accepts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.find import branches_of
from kinseek.branches.order import Selection
from kinseek.branches.result import Branches
from kinseek.errors import InvalidProblem, NotReached
from kinseek.goal import Goal
from kinseek.planning.plan import Ends
from kinseek.planning.space import Space
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline
from kinseek.timing.move import inside_limits, read_end

from .solutions import free_solution

if TYPE_CHECKING:
    from .scene import Scene

Array = NDArray[np.float64]

MOST = 64
"""Ends that are kept for each goal, the nearest ones: full turns inside wide limits make hundreds. Not examined further."""

AROUND = 512
"""Joint values that are tried at each distance from a begin in collision. Not examined further."""


def free_begin(scene: Scene, q0: Any, clearance: float) -> Array:
    """Read the begin of a motion, (n,).

    Raises:
        InvalidProblem: It is not n numbers inside the limits, or it is in collision.
    """
    chain = scene._chain
    begin = inside_limits(chain, q0, "q0")
    if scene.free(begin, clearance):
        return begin
    nearest = _nearest_free(scene, chain, begin, clearance)
    offer = "" if nearest is None else f". The nearest free joint values found are {_written(nearest)}"
    raise InvalidProblem(
        f"q0 {_fault(scene, begin, clearance)}, so no motion from there is free: {_contacts(scene, begin, clearance)}{offer}"
    )


def free_ends(scene: Scene, begin: Array, goal: Any, clearance: float, deadline: Deadline) -> Ends:
    """Return all free joint values at which one of the given goals is reached.

    Raises:
        InvalidProblem: Joint values that do not fit the arm; or all of them are in collision.
        InvalidGoal: Not a pose.
        NotReached: No goal has a solution that is free; the error carries a solution.
    """
    chain = scene._chain
    goals = _goals(chain, goal)
    found: list[Array | Solution | None] = []
    for one in goals:
        if found and deadline.passed:
            break
        found.append(_of_one(scene, chain, begin, one, clearance, deadline))
    free = [q for q in found if isinstance(q, np.ndarray)]
    tool = next((one.tool for one in goals if isinstance(one, Goal)), None)
    if free or deadline.passed:
        return Ends(np.concatenate([np.zeros((0, chain.dof)), *free]), tool)
    several = "" if len(goals) == 1 else f"none of {len(goals)} goals can be reached; the first one: "
    failed = next((one for one in found if isinstance(one, Solution)), None)
    if failed is None:
        contacts = _contacts(scene, goals[0], clearance)
        fault = _fault(scene, goals[0], clearance)
        raise InvalidProblem(f"{several}goal {fault}, so no motion to it is free: {contacts}")
    errors = (failed.position_error, "m"), (failed.orientation_error, "rad")
    off = " and ".join(f"{error:.3g} {unit}" for error, unit in errors if np.isfinite(error))
    why = (
        f"In the one that collides least: {_listed(failed.contacts)}"
        if failed.contacts
        else f"It is off by {off}"
    )
    raise NotReached(f"{several}{failed.status} {why}", failed)


def _goals(chain: SerialChain, goal: Any) -> list[Array | Goal]:
    """Read one goal or several."""
    if isinstance(goal, Goal) and goal.shape:
        return [goal.at(target) for target in goal.target.reshape(-1, *goal.target.shape[len(goal.shape) :])]
    if isinstance(goal, np.ndarray | Sequence) and not isinstance(goal, str):
        numbers = _numbers(goal)
        if numbers is not None and not numbers.size:
            raise InvalidProblem(f"goal must be at least one goal, got {goal!r:.80}")
        if numbers is None or (numbers.ndim > 1 and numbers.shape != (4, 4)):
            return [one for each in goal for one in _goals(chain, each)]
    return [read_end(chain, goal)]


def _numbers(goal: Any) -> Array | None:
    """Return a goal as an array; None if it is a sequence of something else, or of arrays of different shapes."""
    try:
        return np.asarray(goal, dtype=np.float64)
    except (TypeError, ValueError):
        return None


def _of_one(
    scene: Scene, chain: SerialChain, begin: Array, goal: Array | Goal, clearance: float, deadline: Deadline
) -> Array | Solution | None:
    """Return free joint values of one goal, (k, n); if there are none, its solution, or None for joint values."""
    if not isinstance(goal, Goal):
        return goal[None] if scene.free(goal, clearance) else None
    problem = Problem(chain, goal, near=begin, time_limit=deadline.left)
    found = branches_of(problem, Selection(copies=True))
    assert isinstance(found, Branches)  # True for one target.
    q = found.q[np.asarray(scene.free(found.q, clearance), dtype=np.bool_)] if len(found.q) else found.q
    if len(q):
        return np.asarray(q[:MOST])
    # It samples more of a self-motion, moves away from contacts, and tries to prove that all solutions collide.
    solution = free_solution(problem, scene, clearance, None, None, None, None, prove=True)
    return np.asarray(solution.q)[None] if solution.success else solution


def _nearest_free(scene: Scene, chain: SerialChain, q: Array, clearance: float) -> Array | None:
    """Return free joint values near others that are not, (n,); None if none are found."""
    space = Space(chain, scene, clearance, q, q[None])
    around = 2.0 * (space.samples(0, AROUND) - space.lower) / (space.upper - space.lower) - 1.0
    for size in np.pi / 2.0 ** np.arange(9, -1, -1):
        tried = np.clip(q + size * around, space.lower, space.upper)
        if len(free := tried[space.free(tried)]):
            best = free[np.argmin(np.linalg.norm(free - q, axis=1))]
            shares = np.linspace(0.05, 1.0, 20)[:, None]
            line = q + shares * (best - q)
            return np.asarray(line[np.argmax(space.free(line))])
    return None


def _fault(scene: Scene, q: Any, clearance: float) -> str:
    return f"is nearer to a body than the clearance, {clearance:g} m" if scene.free(q) else "is in collision"


def _contacts(scene: Scene, q: Any, clearance: float) -> str:
    return _listed(scene.hits(q, clearance))


def _listed(contacts: Sequence[object]) -> str:
    more = f", and {len(contacts) - 3} more" if len(contacts) > 3 else ""
    return "; ".join(str(one) for one in contacts[:3]) + more


def _written(q: Array) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in q)}]"
