"""The arguments of a path, read and checked: poses, ends, times and speeds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.branches.order import Cost, Valid
from kinseek.errors import InvalidGoal, InvalidProblem
from kinseek.goal import Goal
from kinseek.problem import Problem, as_joints
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import Deadline
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.validation import arrays_equal
from kinseek.timing.limits import Limits, positive, read_limits
from kinseek.timing.obstacles import Obstacles

from .allowed import Allowed
from .request import PathRequest

Array = NDArray[np.float64]


def goals_of(Ts: Any) -> tuple[Goal, Exception | None]:
    """Read poses: an array, a `Goal` with N targets, a list of poses or of goals, or an iterator of them.

    Returns:
        One goal with N targets, and the exception if an iterator raised one before its end.

    Raises:
        InvalidGoal: There are no poses, or one of them is invalid; the message names its index.
    """
    broken: Exception | None = None
    if isinstance(Ts, Goal):
        goal = Ts
    elif isinstance(Ts, np.ndarray) or hasattr(Ts, "as_matrix"):
        goal = Goal.pose(Ts)
    else:
        if not isinstance(Ts, Iterable):
            raise InvalidGoal(
                "a path is an array of poses (N, 4, 4), a Goal with N targets, or a sequence of poses or goals; got "
                f"{Ts!r:.80}"
            )
        rows: list[Any] = []
        source = iter(Ts)
        while True:
            try:
                rows.append(next(source))
            except StopIteration:
                break
            except Exception as error:
                raise_of_handler(error)
                broken = error
                break
        if not rows:
            raise InvalidGoal("a path needs at least one pose, got none") from broken
        goal = together(rows)
    _require_row(goal)
    if not len(goal.target):
        raise InvalidGoal("a path needs at least one pose, got none")
    return goal, broken


def _require_row(goal: Goal) -> Goal:
    if len(goal.shape) != 1:
        raise InvalidGoal(
            f"a path needs targets of shape (N, 4, 4), got shape {goal.target.shape}"
            + ("; for one pose use Arm.ik" if goal.shape == () else "")
        )
    return goal


def row_of_goals(poses: Any) -> Iterator[Any]:
    """Return an iterator of the poses in any container.

    Raises:
        InvalidGoal: The argument is not a container of poses.
    """
    if isinstance(poses, Goal) and len(poses.shape) == 1:
        return (poses.at(target) for target in poses.target)
    is_one = (
        isinstance(poses, np.ndarray) and not poses.ndim
    )  # An array without dimensions cannot be iterated.
    if isinstance(poses, Goal) or is_one or not isinstance(poses, Iterable):
        raise InvalidGoal(f"a stream is an iterator of poses (4, 4) or of goals, got {poses!r:.80}")
    return iter(poses)


def _report(row: Any) -> str:
    if isinstance(row, np.ndarray):
        return f"an array of shape {row.shape}"
    return f"a Goal of {math.prod(row.shape)} targets" if isinstance(row, Goal) else type(row).__name__


def together(rows: list[Any]) -> Goal:
    """Combine poses, or goals of the same kind, into one goal.

    Raises:
        InvalidGoal: One of them is invalid or of another kind; the message names its index.
    """
    if not any(isinstance(row, Goal) for row in rows):
        poses = np.array(rows) if all(isinstance(row, np.ndarray) for row in rows) else rows
        return _require_row(Goal.pose(poses))
    first = next(row for row in rows if isinstance(row, Goal))
    for i, row in enumerate(rows):
        if not isinstance(row, Goal) or row.shape != ():
            raise InvalidGoal(
                f"each item of a sequence must be a goal with one target, got {_report(row)} at index {i}; write a "
                "pose among goals as Goal.pose(T)"
            )
        for name in (each.name for each in fields(Goal)):
            mine, other = getattr(row, name), getattr(first, name)
            if name != "target" and not arrays_equal(mine, other):
                raise InvalidGoal(
                    f"the goals of a path may differ only in their targets: goal {i} has {name}={mine!r}, the goals "
                    f"before it have {other!r}"
                )
    return first.at(np.array([row.target for row in rows]))


def read(
    arm: Mechanism,
    goal: Goal,
    *,
    start: ArrayLike | None,
    end: ArrayLike | None,
    closed: bool,
    max_step: ArrayLike,
    times: ArrayLike | None,
    velocity: ArrayLike | None,
    weights: ArrayLike | None,
    cost: Cost | Literal["time"] | None,
    valid: Valid | None,
    acceleration: ArrayLike | None = None,
    scene: Obstacles | None = None,
    clearance: float = 0.0,
    deadline: Deadline | None = None,
) -> PathRequest:
    """Check the arguments of `Arm.follow`; see there.

    Raises:
        InvalidProblem: An argument does not fit the arm or the poses.
    """
    problem = Problem(arm, goal)
    if problem.axes is None:
        raise InvalidProblem(f"{arm.name!r} has black-box kinematics: a path needs the axes of an arm")
    count = len(goal.targets)
    limits = _limits_of_duration(arm, cost, velocity, acceleration, times)
    longest = np.tile(positive(arm, "max_step", max_step, "rad or m"), (count if closed else count - 1, 1))
    speed = None if velocity is None else positive(arm, "velocity", velocity, "rad/s or m/s")
    if times is not None:
        try:
            moments = np.asarray(times, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidProblem(f"times must be numbers [s], one per pose: {error}") from None
        if moments.shape != (count,) or not np.isfinite(moments).all():
            raise InvalidProblem(
                f"times must be {count} finite numbers [s], one per pose, got shape {moments.shape}"
            )
        with np.errstate(over="ignore"):  # A step may take infinitely long.
            gaps = np.diff(moments)
        if (gaps <= 0).any():
            i = int(np.flatnonzero(gaps <= 0)[0])
            raise InvalidProblem(
                f"times must increase: times[{i}] = {moments[i]:g} s and times[{i + 1}] = {moments[i + 1]:g} s"
            )
        if count > 1:
            with np.errstate(over="ignore"):
                reach = (_own_speeds(arm) if speed is None else speed) * gaps[:, None]
            # The step that closes a path has the bound of the last step.
            longest = np.minimum(longest, np.concatenate([reach, reach[-1:]])[: len(longest)])
    ends: list[Array | None] = []
    for name, value, i in (("start", start, 0), ("end", end, count - 1)):
        if value is None:
            ends.append(None)
            continue
        q = as_joints(arm, value, name)
        _check_end(problem, q, name, i)
        ends.append(q)
    if closed and end is not None:
        raise InvalidProblem(
            "a closed path ends where it begins: give start= or end=, not closed=True and end="
        )
    limit = Deadline() if deadline is None else deadline
    request = PathRequest(
        problem=problem,
        start=ends[0],
        end=ends[1],
        closed=closed,
        longest=longest,
        velocity=speed if limits is None else None,
        weights=np.ones(arm.dof) if weights is None else positive(arm, "weights", weights, "no unit"),
        cost=None if isinstance(cost, str) else cost,
        valid=None if valid is None and scene is None else Allowed(valid, scene, clearance, deadline=limit),
        deadline=limit,
        limits=limits,
    )
    # A closed path that repeats its first pose at the end returns to exactly the given joint values.
    return replace(request, end=request.start) if closed and request.ends_where_it_begins else request


def _limits_of_duration(
    arm: Mechanism,
    cost: Cost | Literal["time"] | None,
    velocity: ArrayLike | None,
    acceleration: ArrayLike | None,
    times: ArrayLike | None,
) -> Limits | None:
    """Return the limits of the motion whose duration is the cost, or None if the cost is another.

    Raises:
        InvalidProblem: The cost is unknown, a limit is not known, or an argument does not belong to the cost.
    """
    if not isinstance(cost, str):
        if acceleration is not None:
            raise InvalidProblem(
                'acceleration= limits the motion whose duration is the cost: give cost="time" too, or give acceleration= '
                "to Path.timed"
            )
        return None
    if cost != "time":
        raise InvalidProblem(
            f'cost must be "time" or a function from joint values, (k, n), to costs, (k,), got {cost!r:.80}'
        )
    if times is not None:
        raise InvalidProblem(
            'times= says when each pose is due, and with cost="time" the poses are passed as soon as possible: give one of '
            "them"
        )
    return read_limits(arm, velocity, acceleration, None)


def _own_speeds(arm: Mechanism) -> Array:
    """Return the joint speed limits of the robot's file, (n,).

    Raises:
        InvalidProblem: The file has no limit for some joint.
    """
    unsaid = np.flatnonzero(np.isnan(arm.velocity))
    if len(unsaid):
        raise InvalidProblem(
            f"times= needs the largest speeds of the joints, but the file of {arm.name!r} gives no speed above 0 for "
            f"{', '.join(arm.joint_names[i] for i in unsaid)}: give velocity=, [rad/s] or [m/s]"
        )
    return arm.velocity


def _check_end(problem: Problem, q: Array, name: str, i: int) -> None:
    """Check that joint values, (n,), reach the first or the last pose.

    Raises:
        InvalidProblem: They are not one row, they lie outside the limits, or they miss the pose.
    """
    arm, goal = problem.mechanism, problem.goal
    if q.ndim != 1:
        raise InvalidProblem(f"{name} must have shape ({arm.dof},), got {q.shape}")
    outside = ((q < arm.lower) | (q > arm.upper)) & ~arm.endless
    if outside.any():
        j = int(np.flatnonzero(outside)[0])
        raise InvalidProblem(
            f"{name} lies outside the limits: joint {arm.joint_names[j]!r} at {q[j]:g}, limits "
            f"[{arm.lower[j]:g}, {arm.upper[j]:g}]"
        )
    one = goal.at(goal.target[i])
    position, orientation = one.measure(Problem(arm, one).arrays, q[None])[0, :2]
    if position > goal.position_tolerance or orientation > goal.orientation_tolerance:
        which = "first" if i == 0 else "last"
        raise InvalidProblem(
            f"{name} does not reach the {which} pose: it is {position:.3g} m and {orientation:.3g} rad off"
        )
