"""Evaluate a black-box function within a budget and a deadline: compute the relevant features of its poses, and count."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal
from kinseek.kinds import PLAIN_KINDS
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import Deadline

Array = NDArray[np.float64]

NO_BUDGET = 2**62


class Evaluator:
    """Evaluates the function for one target, converts poses into features, and counts the evaluations.

    The features of a pose are its position and the columns of its rotation that matter, (3 + 3c,). Their differences from
    the target's are smooth everywhere. Along one joint of a serial arm they are sinusoids or straight lines.
    """

    def __init__(self, box: Mechanism, problem: Problem, deadline: Deadline) -> None:
        """Take one target; one pose of the budget is reserved for evaluating the solution.

        When the time is up, nothing is left of the budget.

        Raises:
            InvalidGoal: This kind of goal is not supported here.
        """
        goal = problem.goal
        if goal.form.ranges:
            raise InvalidGoal(
                f"{goal.form.noun} is not supported for {box.name!r}, which has black-box kinematics; valid: "
                f"{', '.join(kind.noun for kind in PLAIN_KINDS)}"
            )
        self.box, self.goal = box, goal
        self.columns = tuple(range(goal.columns))
        self.tip = goal.tip
        self.target = features(np.asarray(goal.targets[:1]), None, self.columns)[0]
        self.deadline, self.out_of_time = deadline, False
        self._left = (NO_BUDGET if problem.budget is None else problem.budget) - 1
        self.spent = 1

    @property
    def left(self) -> int:
        """Number of poses that may still be evaluated."""
        if self._left > 0 and self.deadline.passed:
            self._left, self.out_of_time = 0, True
        return self._left

    def differences(self, q: Array) -> Array:
        """Return features minus the target's at joint values inside the limits, (k, n) -> (k, m); NaN without a pose."""
        self.spent += len(q)
        self._left -= len(q)
        return np.asarray(features(self.box.forward(q), self.tip, self.columns) - self.target)

    def errors(self, away: Array) -> tuple[Array, Array]:
        """Return position errors [m] and orientation errors [rad] of differences, (k, m) -> (k,), (k,); NaN stays NaN."""
        position = np.sqrt((away[:, :3] ** 2).sum(axis=1))
        if not self.columns:
            return position, np.zeros(len(away))
        # A rotation φ changes the columns together by longest_chord · sin(φ/2).
        chord = np.sqrt((away[:, 3:] ** 2).sum(axis=1))
        return position, 2.0 * np.arcsin(np.minimum(chord / self.goal.form.longest_chord, 1.0))

    def within(self, away: Array) -> NDArray[np.bool_]:
        """Return for each whether both tolerances are met, (k,)."""
        position, orientation = self.errors(away)
        goal = self.goal
        return np.asarray((position <= goal.position_tolerance) & (orientation <= goal.orientation_tolerance))

    def weighted(self, away: Array) -> Array:
        """Return the paper's weighted error of differences, (k, m) -> (k,); infinite without a pose."""
        error = self.goal.position_weight * np.sqrt((away[:, :3] ** 2).sum(axis=1))
        weights = self.goal.arrays.axis_weights
        for i, column in enumerate(self.columns):
            chord = (away[:, 3 + 3 * i : 6 + 3 * i] ** 2).sum(axis=1)
            error = error + weights[column] * chord / 2.0  # 1 - c·c_g = |c - c_g|² / 2.
        return np.where(np.isnan(error), np.inf, error)


def features(poses: Array, tip: Array | None, columns: tuple[int, ...]) -> Array:
    """Return position and some rotation columns of what is at the tip, (k, 4, 4) or (k, 3, 4) -> (k, 3 + 3c)."""
    there = poses[:, :3] if tip is None else poses[:, :3, :3] @ tip[:3]
    if tip is not None:
        there[:, :, 3] += poses[:, :3, 3]
    return np.concatenate([there[:, :, 3], *(there[:, :, c] for c in columns)], axis=1)
