"""What comes back: joint values, and an honest account of what they reach."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from .errors import NotReached
from .goal import Goal
from .kernels.deviation import judge_boxes
from .kernels.pose_error import judge, judge_poses
from .problem import Problem
from .robots.blackbox import BlackBox
from .robots.chain import SerialChain

Array = NDArray[np.float64]


class Status(Enum):
    """How a search ended; the value is the sentence to show."""

    SOLVED = "Solved: both errors are within their tolerances."
    BEST_EFFORT = "Best effort: the nearest pose found; a tolerance is missed."
    REJECTED = "Rejected: answers were found, and the user's `valid` refused every one."
    PROVED_UNREACHABLE = "Proved unreachable: no joint values within the limits meet the tolerances."

    def __str__(self) -> str:
        """The sentence."""
        return self.value


@dataclass(frozen=True, eq=False)
class Solution:
    """The answer to one target, or to a batch of them; then every field has the batch's leading shape.

    Errors are recomputed from `q` by plain forward kinematics, never taken from a search's own residual.
    """

    q: Array
    """Joint values inside the limits, (..., n), [rad] or [m]."""
    success: Any
    """Are both tolerances met, and did `valid`, where there is one, agree? bool, or (...) bool."""
    position_error: Any
    """[m], float or (...)."""
    orientation_error: Any
    """[rad], float or (...)."""
    weighted_error: Any
    """The paper's K_P |p - p_g| + K_A [(1 - x·x_g) + (1 - y·y_g)] (Sec. 2.2), float or (...)."""
    evaluations: Any
    """FK evaluations spent, the deterministic measure of work, int or (...)."""
    nodes_created: Any
    """Nodes of the search tree that were made, int or (...); 0 where the search grows no tree."""
    nodes_expanded: Any
    """Nodes of the search tree that were visited, int or (...); 0 where the search grows no tree."""
    problem: Problem
    """What was asked."""
    proved_unreachable: Any = False
    """Is it proved that no joint values inside the limits reach the goal? bool or (...) bool."""
    rejected: Any = 0
    """How many answers the user's `valid` refused, int or (...); without success, every answer that was found."""

    def __getattr__(self, name: str) -> Any:
        """Make `problem` when it is first asked for: the fast way of `Arm.ik` leaves it out."""
        question = self.__dict__.get("_question")
        if name != "problem" or question is None:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        chain, target, near = question
        problem = Problem(chain, Goal.pose(target), near)
        self.__dict__["problem"] = problem
        return problem

    @property
    def status(self) -> Any:
        """`Status`, or an object array of them, (...)."""
        if isinstance(self.success, bool):
            if self.success:
                return Status.SOLVED
            if self.proved_unreachable:
                return Status.PROVED_UNREACHABLE
            return Status.REJECTED if self.rejected else Status.BEST_EFFORT
        names = np.array([*Status], dtype=object)  # Solved, best effort, rejected, proved unreachable.
        proved = np.broadcast_to(self.proved_unreachable, self.success.shape)
        missed = np.where(proved, 3, np.where(np.broadcast_to(self.rejected, self.success.shape) > 0, 2, 1))
        return names[np.where(self.success, 0, missed)]

    def each(self) -> Iterator[Solution]:
        """One solution a target, in order."""
        if not self.problem.goal.shape:
            yield self
            return
        names = [each.name for each in fields(self) if each.name not in ("q", "problem")]
        columns = {name: np.broadcast_to(getattr(self, name), self.problem.goal.shape) for name in names}
        for index, problem in zip(np.ndindex(self.problem.goal.shape), self.problem.each(), strict=True):
            row = {name: column[index].item() for name, column in columns.items()}
            yield replace(self, q=self.q[index], problem=problem, **row)

    def require(self) -> Self:
        """Return self if every target is reached.

        Raises:
            NotReached: A tolerance is missed; the error carries this solution.
        """
        if np.all(self.success):
            return self
        goal = self.problem.goal
        missed = np.atleast_1d(~np.asarray(self.success))
        worst = f"{np.max(self.position_error):.3g} m, {np.max(self.orientation_error):.3g} rad"
        count = "" if missed.size == 1 else f"{missed.sum()} of {missed.size} targets not reached; "
        refused = int(np.sum(np.where(missed, self.rejected, 0)))
        refusals = f"; `valid` refused {refused} answers" if refused else ""
        raise NotReached(
            f"{count}errors up to {worst}, tolerances {goal.position_tolerance:g} m, "
            f"{goal.orientation_tolerance:g} rad{refusals}",
            self,
        )

    def __repr__(self) -> str:
        """Short enough to print in a shell."""
        if isinstance(self.success, bool):
            return (
                f"Solution({self.status.name}, q={np.array2string(self.q, precision=4, separator=', ')}, "
                f"position_error={self.position_error:.2e} m, "
                f"orientation_error={self.orientation_error:.2e} rad, evaluations={self.evaluations})"
            )
        return f"Solution({int(self.success.sum())} of {self.success.size} solved, q{self.q.shape})"


def conclude(problem: Problem, q: Array, work: NDArray[np.int64]) -> Solution:
    """Judge joint values by plain FK.

    Args:
        problem: What was asked, a batch of k targets.
        q: What was found, (k, n).
        work: Evaluations, nodes created and nodes expanded of each, (k, 3).
    """
    goal, shape = problem.goal, problem.goal.shape
    joints = np.ascontiguousarray(q)
    if isinstance(problem.chain, BlackBox):
        measured = judge_function(problem.chain, goal, q)
    elif goal.kind == "box":
        weights = float(goal.position_weight), float(goal.orientation_weight)
        measured = judge_boxes(problem.arrays, joints, goal.questions, *weights)
    else:
        measured = judge(problem.arrays, joints, goal.targets, goal.arrays)
    success = (measured[:, 0] <= goal.position_tolerance) & (measured[:, 1] <= goal.orientation_tolerance)

    def field(column: NDArray[Any]) -> Any:
        return column.reshape(shape).copy() if shape else column[0].item()

    return Solution(
        q=q.reshape(*shape, problem.chain.dof),
        success=field(success),
        position_error=field(measured[:, 0]),
        orientation_error=field(measured[:, 1]),
        weighted_error=field(measured[:, 2]),
        evaluations=field(work[:, 0]),
        nodes_created=field(work[:, 1]),
        nodes_expanded=field(work[:, 2]),
        problem=problem,
    )


def judge_function(box: BlackBox, goal: Goal, q: Array) -> Array:
    """Ask a function for its poses anew, (k, n), and judge them: errors [m], [rad] and weighted, (k, 3).

    Infinite where the mechanism cannot be put together.
    """
    poses = box.poses(q)
    absent = np.isnan(poses).any(axis=(1, 2))
    poses[absent] = np.eye(4)
    if goal.tip is not None:
        poses = poses @ goal.tip
    measured = judge_poses(poses, goal.targets, goal.arrays)
    measured[absent] = np.inf
    return measured


def quick_solution(
    chain: SerialChain,
    target: Array,
    near: Array | None,
    q: Array,
    report: tuple[float, float, float, int, bool],
) -> Solution:
    """Make a solution of one pose under the default tolerances as fast as Python can.

    Args:
        chain: The arm.
        target: (4, 4).
        near: What the answer shall be near to, (n,).
        q: Joint values, (n,).
        report: Position error [m], orientation error [rad], weighted error, FK evaluations, success.
    """
    solution = object.__new__(Solution)
    # The caller may write the next question into the same arrays.
    question = chain, target.copy(), near if near is None else near.copy()
    position_error, orientation_error, weighted_error, evaluations, success = report
    solution.__dict__.update(
        q=q,
        success=success,
        position_error=position_error,
        orientation_error=orientation_error,
        weighted_error=weighted_error,
        evaluations=evaluations,
        nodes_created=0,
        nodes_expanded=0,
        _question=question,
    )
    return solution
