"""Servoing: one pose in, one set of joint values out, with the same bounded work in every period."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.branches.index import index_of
from kinseek.branches.result import answers_of
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.paths.servo import LAST, LIMIT, LOWER, NO_POSE, NOW, REACH, SINGULAR, UPPER, servo_step
from kinseek.kernels.paths.servo import TRACKING as TRACKED
from kinseek.poses import as_pose, one_pose
from kinseek.problem import Problem, as_joints
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.atlas.index import PLAIN, atlas_of
from kinseek.transforms import inverse, square

from .asked import positive
from .joints import Turning

Array = NDArray[np.float64]

SPREAD = 60
"""Answers that are looked through for another branch where the arm has joints to spare."""

ELSEWHERE = 0.5
"""Another branch is farther than this from where the arm is, in some joint [rad or m]."""


class TrackStatus(Enum):
    """How one step of a tracker ended; the value is the sentence to show."""

    TRACKING = "Tracking: the pose is reached within this period."
    LAGGING = "Lagging: the joints go as fast as they may, and the pose is farther off."
    LIMIT = "At a limit: a joint stands at its limit, and this branch leads no nearer."
    SINGULAR = "Singular, or out of reach: no joint is held, and no motion of the joints leads nearer."
    SWITCHED = "Switched: on the way to another branch, as was asked for."

    def __str__(self) -> str:
        """The sentence."""
        return self.value


_ENDED = (TrackStatus.TRACKING, TrackStatus.LAGGING, TrackStatus.LIMIT, TrackStatus.SINGULAR)


class Step(NamedTuple):
    """What one period brought."""

    q: Array
    """Joint values at its end, (n,), [rad] or [m]."""
    status: TrackStatus
    position_error: float
    """[m], by plain forward kinematics."""
    orientation_error: float
    """[rad], by plain forward kinematics."""


class Foresight(NamedTuple):
    """What comes if the poses go on as between the last two."""

    status: TrackStatus
    """LIMIT, SINGULAR or LAGGING if that comes first; TRACKING if nothing does."""
    seconds: float
    """After which time; infinite if nothing does."""
    joint: str | None
    """Which joint stops at its limit, or is too slow."""


class Tracker:
    """Follows poses that come one at a time; made by `Arm.track`.

    A step never goes farther than a joint may within one period, and never out of the limits; what it does depends on
    nothing but the steps before it, so the same poses give the same bits. It looks for no other branch: `switch` does.
    """

    def __init__(self, arm: Mechanism, q0: ArrayLike, period: float, velocity: ArrayLike | None) -> None:
        """Stand at joint values; see `Arm.track`."""
        if arm.axes is None:
            raise InvalidProblem(f"{arm.name!r} is a function: a tracker works along axes, and it has none")
        if isinstance(period, bool) or not isinstance(period, int | float) or not 0 < period < np.inf:
            raise InvalidProblem(f"period must be a number of seconds above 0, got {period!r}")
        start = as_joints(arm, q0, "q0")
        if start.shape != (arm.dof,):
            raise InvalidProblem(f"q0 must have shape ({arm.dof},), got {start.shape}")
        self.period = float(period)
        """[s]"""
        self.velocity = (
            np.where(np.isnan(arm.velocity), np.inf, arm.velocity)
            if velocity is None
            else positive(arm, "velocity", velocity, "rad/s or m/s")
        )
        """Of the joints, (n,), [rad/s] or [m/s]; infinite where neither the caller nor the robot's file says anything."""
        self._arm, self._turning = arm.axes, Turning(arm.axes)
        self._index = atlas_of(arm.axes)
        _ = self._index.handle  # Asking for it adds the routines that are still lacking.
        self._state = np.zeros((7, arm.dof))
        self._state[LOWER], self._state[UPPER] = self._turning.open_lower, self._turning.open_upper
        self._state[REACH], self._state[NOW] = self.velocity * self.period, start
        self._memory = np.zeros(LAYOUT.count.of(dof=arm.dof, joints=len(arm.axes.leader)))
        self._target: Array | None = None
        self._before: Array | None = None
        self._way: list[Array] = []

    @property
    def q(self) -> Array:
        """Where the joints are, (n,), [rad] or [m]."""
        return np.asarray(self._state[NOW].copy())

    def step(self, T: Array) -> Step:
        """Go towards a pose, (4, 4), as far as one period allows.

        Raises:
            InvalidGoal: Not one pose.
        """
        if self._way:
            return self._along(T)
        state = self._state
        if (
            type(T) is not np.ndarray
            or T.shape != (4, 4)
            or T.dtype != np.float64
            or not T.flags.c_contiguous
        ):
            T = _one(T)
        position, orientation, ended = servo_step(self._index.address, PLAIN, T, self._memory, state)
        if ended == NO_POSE:
            T = _one(T)
            position, orientation, ended = servo_step(self._index.address, PLAIN, T, self._memory, state)
        self._before, self._target = self._target, T.copy()
        return Step(state[NOW].copy(), _ENDED[ended], position, orientation)

    def switch(self) -> Array:
        """Turn to another branch of the last pose: the nearest that is not where the arm is.

        The steps that follow go there, whatever their poses are, as fast as the slowest joint allows, and are SWITCHED.

        Returns:
            The way there, one row a period, (k, n); straight in the joints, and so not along any pose.

        Raises:
            InvalidProblem: No pose was given yet, the pose has no other branch inside the limits, or no speed is known.
        """
        if self._target is None:
            raise InvalidProblem("switch() needs a pose: call step(T) first")
        if not np.isfinite(self.velocity).all():
            raise InvalidProblem("switch() goes as fast as the joints may: say arm.track(..., velocity=)")
        index = index_of(Problem(self._arm, Goal.pose(self._target)))
        rows = index.search(PLAIN, self._target, index.view, SPREAD if index.freedom else 0)
        found = answers_of(rows, self._arm.dof).q
        here = self._state[NOW]
        steps = self._turning.step(found - here)
        there = here + steps
        inside = ((there >= self._turning.open_lower) & (there <= self._turning.open_upper)).all(axis=1)
        steps = np.where(inside[:, None], steps, found - here)
        other = np.abs(steps).max(axis=1, initial=0.0) > ELSEWHERE
        if not other.any():
            raise InvalidProblem("the last pose has no other branch inside the limits")
        steps = steps[other]
        time = np.abs(steps / self.velocity).max(axis=1)
        step = steps[int(np.argmin(time))]
        periods = int(np.ceil(time.min() / self.period * (1 + 1e-9)))
        parts = np.arange(1, periods + 1)[:, None] / periods
        way = here + parts * step
        self._way = list(way)
        return np.asarray(way)

    def _along(self, T: Array) -> Step:
        """One step of the way to another branch."""
        pose, q = _one(T), self._way.pop(0)
        self._state[LAST] = q - self._state[NOW]
        self._state[NOW] = q
        self._before, self._target = self._target, pose
        problem = Problem(self._arm, Goal.pose(pose))
        position, orientation, _ = problem.goal.measure(problem.arrays, q[None])[0]
        return Step(q.copy(), TrackStatus.SWITCHED, float(position), float(orientation))

    def foresee(self, seconds: float = 0.5, looks: int = 25) -> Foresight:
        """Look ahead: what comes if the hand goes on as between the last two poses?

        Args:
            seconds: How far ahead.
            looks: Steps in which that is looked at, each of as many whole periods as it takes.

        Raises:
            InvalidProblem: Fewer than two poses were given.
        """
        if self._before is None or self._target is None:
            raise InvalidProblem("foresee() needs two poses: call step(T) twice first")
        state, pose = self._state.copy(), self._target
        at_once = max(1, round(seconds / looks / self.period))
        state[REACH], state[LAST] = state[REACH] * at_once, state[LAST] * at_once
        # The same screw again and again: a line where the hand does not turn, an arc where it does.
        screw = np.linalg.matrix_power(square(inverse(self._before)) @ self._target, at_once)
        for k in range(1, int(np.ceil(seconds / self.period / at_once - 1e-9)) + 1):
            pose = as_pose(pose @ screw)
            _, _, ended = servo_step(self._index.address, PLAIN, pose, self._memory, state)
            if ended != TRACKED:
                return Foresight(_ENDED[ended], k * at_once * self.period, self._held(state, ended))
        return Foresight(TrackStatus.TRACKING, np.inf, None)

    def _held(self, state: Array, ended: int) -> str | None:
        at_limit = (state[NOW] <= state[LOWER]) | (state[NOW] >= state[UPPER])
        fast = np.abs(state[LAST]) >= state[REACH] * (1 - 1e-9)
        some = np.flatnonzero(at_limit if ended == LIMIT else fast & ~at_limit)
        return self._arm.joint_names[int(some[0])] if len(some) and ended != SINGULAR else None


def _one(T: object) -> Array:
    """Read one pose.

    Raises:
        InvalidGoal: It is none.
    """
    return np.ascontiguousarray(one_pose(T, "the pose of a step"))
