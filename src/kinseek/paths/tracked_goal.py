"""The goal of a tracker as kernels take it: its targets, the joints that reach them, and the errors that are left."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arm.pose_error import judge
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.paths import servo
from kinseek.kernels.paths.servo import LAGGING, LIMIT, SINGULAR, State, look_ahead, servo_step
from kinseek.kinds import POSITION
from kinseek.poses import matrix_of, one_pose
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.support.transforms import inverse, transform
from kinseek.support.validation import as_float_array
from kinseek.virtual_joints import extended

from .recovery import AWAY
from .request import require_inside

Array = NDArray[np.float64]


class TrackedGoal:
    """What a tracker tracks: one goal, whose target every step replaces.

    Each range of the goal is a joint of its own, which moves the pose within the range. Kernels see the arm with these
    joints.
    """

    def __init__(self, mechanism: Mechanism, goal: Goal | None, start: Array) -> None:
        """Prepare a goal, by default a pose, for joint values to start at, (n,).

        Raises:
            InvalidProblem: Not one goal, ranges along axes that a moving target would turn, or a start outside the limits.
        """
        self.mechanism, self.given = mechanism, _one_goal(Goal(np.eye(4)) if goal is None else goal)
        more = extended(Problem(mechanism, self.given.at(self.pose_at(start))), inside=True)
        require_inside(more)
        self.arm, self.goal = more.problem.chain, more.problem.goal
        """The arm with the joints of the ranges, and the goal of all these joints, without ranges."""
        self.own = more.own
        """The joints of the arm among all."""
        self.start = more.with_virtual(start[None])[0]
        """The joint values to start at, with those of the ranges."""
        self.arrays = more.problem.arrays
        self.plain = goal is None
        self.index, self.tolerances = atlas_of(self.arm, self.goal), tolerances_of(self.goal)
        self.memory = np.zeros(LAYOUT.count.of(dof=self.arm.dof, joints=len(self.arm.leader)))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the atlas out of pickles and copies: it holds addresses of its own arrays in this process."""
        return {name: value for name, value in vars(self).items() if name != "index"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Build the atlas again."""
        vars(self).update(state)
        self.index = atlas_of(self.arm, self.goal)

    @property
    def problem(self) -> Problem:
        """The arm and the goal as kernels take them, with any target."""
        return Problem(self.arm, self.goal)

    def target(self, T: Any) -> Array:
        """Read one pose, and return it as kernels take it, (4, 4): in the arm's base, with the rotation of the tip.

        Raises:
            InvalidGoal: The argument is not one pose.
        """
        if self.given.form is POSITION and isinstance(T, list | tuple | np.ndarray) and len(T) == 3:
            T = transform(np.eye(3), as_float_array(T))
        target = np.ascontiguousarray(one_pose(T, "the pose of a step"))
        if self.plain:
            return target
        if self.given.base is not None:
            target = np.vstack([inverse(self.given.base) @ target, np.eye(4)[3:]])
        target[:3, :3] = target[:3, :3] @ self.goal.tip_rotation
        return np.ascontiguousarray(target)

    def goal_at(self, target: Array) -> Goal:
        """Return the goal that the caller gave, with a target as kernels take it."""
        T, goal = target.copy(), self.given
        T[:3, :3] = T[:3, :3] @ self.goal.tip_rotation.T
        return goal.at(T if goal.base is None else goal.base @ T)

    def pose_at(self, q: Array) -> Array:
        """Return the target that joint values of the arm, (n,), reach, (4, 4)."""
        T, goal = self.mechanism.forward(q[None])[0], self.given
        T = T if goal.tool is None else T @ goal.tool
        return T if goal.base is None else np.asarray(goal.base @ T)

    def with_virtual(self, q: Array, target: Array) -> Array:
        """Add the joints of the ranges to joint values of the arm, (n,), at a target as kernels take it."""
        if self.given.ranges is None:
            return q
        one = Problem(self.mechanism, self.goal_at(target))
        return np.asarray(extended(one, inside=True).with_virtual(q[None])[0])

    def errors(self, q: Array, target: Array) -> tuple[float, float]:
        """Pose errors of joint values [m], [rad]: what lies outside the ranges of the goal."""
        if self.given.ranges is None:
            measured = judge(self.arrays, q[None], target[None, :3], self.goal.arrays)
        else:
            goal = self.goal_at(target)
            own = np.ascontiguousarray(q[None, self.own])
            measured = goal.measure(Problem(self.mechanism, goal).arrays, own)
        position, orientation, _ = measured[0]
        return float(position), float(orientation)

    def met(self, position: float, orientation: float) -> bool:
        """Return whether errors are within the tolerances of the goal."""
        return bool(
            position <= self.given.position_tolerance and orientation <= self.given.orientation_tolerance
        )

    def step(self, target: Array, state: State) -> tuple[float, float, int]:
        """Do one step of `servo_step`; a pose that the goal accepts counts as reached."""
        position, orientation, ended = servo_step(
            self.index.address, self.tolerances, target, self.memory, state
        )
        if ended in (LAGGING, LIMIT, SINGULAR) and self.given.ranges is not None:
            # The kernel compares the pose with one point of the ranges: the values of their joints in this period.
            position, orientation = self.errors(state.now, target)
            if self.met(position, orientation):
                ended = servo.TRACKING
        return position, orientation, ended

    def look_ahead(self, targets: Array, state: State) -> tuple[int, int, int]:
        """Follow targets as `kernels.paths.servo.look_ahead` does; the state is changed."""
        return look_ahead(self.index.address, self.tolerances, targets, *AWAY, self.memory, state)


def has_gaps(T: object) -> bool:
    """Return whether a pose contains NaN or infinity; what is no pose has none."""
    try:
        return not np.isfinite(matrix_of(T)).all()
    except (InvalidGoal, TypeError, ValueError):
        return False


def _one_goal(goal: Goal) -> Goal:
    """Check the goal of a tracker.

    Raises:
        InvalidProblem: Not one goal, or ranges along axes that a moving target would turn.
    """
    if not isinstance(goal, Goal) or goal.shape != ():
        raise InvalidProblem(
            f"goal must be a Goal with one target, which every step replaces, got {goal!r:.80}"
        )
    if goal.ranges is not None and goal.frame != "tool":
        raise InvalidProblem(
            "a tracker supports ranges and cones with axes of the tool, since the target may turn: use Goal.pose with "
            "frame='tool'"
        )
    return goal
