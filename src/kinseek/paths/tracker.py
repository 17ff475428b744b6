"""Servoing: each period takes one target and returns one set of joint values, with a bounded amount of work.

There are two layers. The reference is a set of joint values that tracks the target as fast as the velocity limits allow
(`kernels.paths.servo`). The joints follow the reference within all limits and can always stop in time (`limited`). Without
limits of acceleration and jerk and without a scene, the joints are at the reference.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, KinseekError, suggest
from kinseek.goal import Goal
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.kernels.paths import servo
from kinseek.kernels.paths.limited import POSITION, VELOCITY, track_step
from kinseek.kernels.paths.servo import LAGGING, LIMIT, SINGULAR, State, servo_step
from kinseek.kernels.paths.towards import move_towards
from kinseek.poses import as_pose, plain_array
from kinseek.problem import Problem, as_joints
from kinseek.robots.mechanism import RATES, Mechanism
from kinseek.support.validation import as_flag, as_float_array, as_number
from kinseek.timing.limits import positive

from .drift import ANYWHERE, Drift, DriftOptions
from .joints import Turning
from .limited import KINDS, NOTHING, Around, LimitedJoints, Rates, Restriction, StraightWay, straight_way
from .past import TIMES, PastPoses
from .recovery import ELSEWHERE, Recovery, is_away, solutions_of
from .tracked_goal import TrackedGoal, has_gaps

Array = NDArray[np.float64]

FASTER, AFTER = 10.0, 0.5
"""If joints that are `FASTER` times as fast still track the poses `AFTER` seconds later, only the hand is too fast, and its
branch does not end. Not examined further."""

SINGULAR_RATIO = 1e-3
"""Ratio of the least to the largest singular value of the Jacobian up to which a direction counts as lost."""

AXES = ("base", "tool")
"""Axes of a twist."""

MOST_PERIODS = 1_000_000
"""Most periods of a motion to another branch."""

ARRIVED = 1e-9
"""A switch ends where every joint is this close to its end [rad or m]."""

AT_REST = 0.01
"""If a body holds the joints and none is faster than this, the reference begins again where they are [rad/s] or [m/s]. Not
examined further."""

LEASH = (1e-4, 1e-3)
"""How far the target that a twist moves may be ahead of the hand [m], [rad]. Not examined further."""

HELD = (2e-3, 2e-2)
"""The same for a position or an orientation that the twist does not change."""

BESIDE = 0.2
"""Time for which the hand goes straight after a body has held it [s]. Not examined further."""

CATCH_UP = 0.1
"""Fraction of what the hand is behind by which it catches up in a step. Not examined further."""

WAYS = 4
"""Ways back that are checked for collisions: each takes some tenths of a millisecond."""

ARRIVING = 0.05
"""A recovery that is this close to its end is not broken off [rad] or [m]. Not examined further."""


class TrackStatus(Enum):
    """Outcome of one step of a tracker; the value is the sentence to show."""

    TRACKING = "Tracking: the pose is reached within this period."
    LAGGING = "Lagging: the joints move as fast as they may, and the pose is farther away."
    LIMIT = "At a limit: a joint is at its limit, and the hand cannot come nearer on this branch."
    SINGULAR = "Singular or out of reach: no joint is at its limit, and no motion of the joints brings the hand nearer."
    SWITCHED = "Switched: the joints are moving to another branch, because switch() was called."
    RECOVERING = "Recovering: the pose was lost, and the joints are moving to values that reach it again."
    BRAKING = "Braking: a body is near, and the joints move only as fast as they can stop before it."
    STOPPING = "Stopping: there is no target, or it contains NaN, infinity or a velocity beyond 1e7."

    def __str__(self) -> str:
        """Return the sentence."""
        return self.value


_ENDED = (TrackStatus.TRACKING, TrackStatus.LAGGING, TrackStatus.LIMIT, TrackStatus.SINGULAR)


class Step(NamedTuple):
    """Result of one period."""

    q: Array
    """Joint values at its end, (n,), [rad] or [m]."""
    status: TrackStatus
    position_error: float
    """Distance from the pose [m], by plain forward kinematics; NaN without a pose."""
    orientation_error: float
    """Angle from the pose [rad], by plain forward kinematics; NaN without a pose."""
    velocity: Array
    """Velocities of the joints, (n,), [rad/s] or [m/s]: their motion in this period by its duration."""
    acceleration: Array
    """Accelerations, (n,), [rad/s²] or [m/s²]: the change of the velocities by the duration."""
    limited: tuple[str, str] | None = None
    """The joint that is farthest from where it ought to be, and the limit that keeps it from there: ``"position"``,
    ``"velocity"``, ``"acceleration"`` or ``"jerk"``."""
    obstacle: tuple[str, str, float] | None = None
    """The two bodies that make the joints slower (BRAKING), and a lower bound of their distance [m]."""


class Foresight(NamedTuple):
    """Prediction for poses that continue as they came."""

    status: TrackStatus
    """LIMIT or SINGULAR if this branch ends there, LAGGING if only a joint is too slow, TRACKING if nothing happens."""
    seconds: float
    """Time after which the hand begins to fall behind [s]; infinite if nothing happens."""
    joint: str | None
    """The joint that stops at its limit or is too slow."""


class Return(NamedTuple):
    """The motion to joint values that reach a lost pose."""

    there: State
    """The state of a tracker that already follows the pose from these joint values."""
    way: StraightWay | None
    """None until the joints have come to rest."""


class Tracker:
    """Track poses that arrive one at a time; created by `Arm.track`.

    No step exceeds a limit of position, velocity, acceleration or jerk, and after every step the joints can brake to rest
    within all of them, and with a scene without touching anything. A step depends only on the steps before it, so the same
    targets give the same bits.

    If the pose cannot be reached, the arm comes to rest at the nearest pose of its branch. A pose counts as lost if the
    hand's error exceeds 1 mm or 0.01 rad; it stays lost until a pose is reached. With `recover`, the tracker looks for a
    lost pose again every 0.05 s. The joints move straight and as fast as they may to the solution (RECOVERING) if a limit or
    a singularity holds the arm, and either the solution is close to the joint values that last reached a pose, or a pose has
    been out of reach of every branch since then. They also do so if the target has rested for 0.2 s, and for 0.4 s if the
    arm only lags. Otherwise the arm stays on its branch; `switch` leaves it. In a scene, the way there must be free.
    """

    def __init__(
        self,
        arm: Mechanism,
        q0: ArrayLike,
        period: float,
        limits: tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None],
        recover: bool = True,
        goal: Goal | None = None,
        around: Around = NOTHING,
        prefer: DriftOptions = ANYWHERE,
    ) -> None:
        """Start at joint values, at rest.

        Args:
            arm: The arm.
            q0: See `Arm.track`, as the others.
            period: Time between two steps [s].
            limits: Of velocity, acceleration and jerk; None for those of the arm.
            recover: Whether lost poses are looked for.
            goal: What counts of each pose.
            around: The scene.
            prefer: Of a redundant arm.
        """
        if arm.axes is None:
            raise InvalidProblem(f"{arm.name!r} has black-box kinematics: a tracker needs the axes of an arm")
        period = as_number("period, in seconds,", period, *TIMES, InvalidProblem)
        recover = as_flag("recover", recover)
        start = as_joints(arm, q0, "q0")
        if start.shape != (arm.dof,):
            raise InvalidProblem(f"q0 must have shape ({arm.dof},), got {start.shape}")
        self.period = period
        """Period [s]."""
        self.velocity, self.acceleration, self.jerk = (
            np.where(np.isnan(known := getattr(arm, name)), np.inf, known)
            if given is None
            else positive(arm, name, given, unit)
            for (name, unit), given in zip(RATES.items(), limits, strict=True)
        )
        """Limits of the joints, (n,) each, [rad/s], [rad/s²] and [rad/s³] or the same with [m]; infinite if neither the
        caller nor the robot's file gives one."""
        self._goal = TrackedGoal(arm, goal, start)
        # From here on the joints are those of the arm and of the ranges of the goal.
        chain, self._own = self._goal.arm, self._goal.own
        self._mechanism, self._turning = arm, Turning(chain)
        if around.scene is not None and (hits := around.scene.hits(start, around.clearance)):
            raise InvalidProblem(f"q0 is in collision, so no motion from there is free: {hits[0]}")
        start = self._goal.start
        nothing, ends = np.zeros(chain.dof), (self._turning.open_lower, self._turning.open_upper)
        rates = np.full((3, chain.dof), np.inf)
        rates[:, self._own] = self.velocity, self.acceleration, self.jerk
        self._rates = Rates(*rates)
        self._around = around
        self._joints = LimitedJoints(*ends, self._rates, start, self._own, around)
        rows = *ends, rates[0] * period, start, nothing, nothing, nothing, start, nothing
        self._state = State(*(np.array(row, dtype=np.float64) for row in rows))
        """Of the reference."""
        self._duration = period
        """Of the present step [s]."""
        self._past = PastPoses(self.period)
        self._way: list[Array] = []
        self._recover = recover and bool(np.isfinite(self.velocity).all())
        self._recovery = Recovery(self._goal.problem, self._turning, self._own)
        self._return: Return | None = None
        self._carried: Array | None = None
        """The target that a twist moves, (4, 4)."""
        self._beside = 0
        """Periods in which the hand still goes straight, since a body has held it."""
        self._moved_since_rest = np.zeros(2, dtype=np.bool_)
        """Whether a twist has moved the hand, and has turned it, since the joints were last at rest."""
        self._prefer_speed = as_number("prefer_speed", prefer.speed, *TIMES, InvalidProblem)
        self.prefer(prefer.what)

    def __repr__(self) -> str:
        """The arm, the period and the joint values."""
        values = ", ".join(f"{value:.4g}" for value in self.q)
        return f"Tracker({self._mechanism.name!r}, period={self.period:g} s, q=[{values}])"

    @property
    def q(self) -> Array:
        """Current joint values, (n,), [rad] or [m]."""
        return self._joints.motion.q[self._own].copy()

    def prefer(self, what: Any) -> None:
        """Change the preference of a redundant arm, see `Arm.track`; None for no preference.

        Raises:
            InvalidProblem: An unknown preference, or the goal leaves the arm no choice.
        """
        problem = Problem(self._mechanism, self._goal.given.at(self._goal.pose_at(self.q)))
        self._drift = None if what is None else Drift(problem, what, self._prefer_speed)
        self._state.drift[:] = 0.0

    def step(
        self,
        T: Any = None,
        *,
        dt: float | None = None,
        twist: ArrayLike | None = None,
        axes: Literal["base", "tool"] = "base",
        velocity: ArrayLike | None = None,
    ) -> Step:
        """Move towards a target as far as one period allows.

        Without a target, or if it contains NaN, infinity or a velocity beyond 1e7 in its unit, the joints brake.

        Args:
            T: A pose, (4, 4), or an object that carries one: the target of the goal that the tracker was started with. For a
                goal of a position also (3,) [m].
            dt: Duration of this period [s], if it is not `period`: the time since the step before.
            twist: Velocity of the hand instead of a pose, (6,): linear [m/s] and angular [rad/s].
            axes: Axes of the twist: ``"base"``, or those of the hand, ``"tool"``.
            velocity: Velocities of the joints instead of a pose, (n,), [rad/s] or [m/s].

        Raises:
            InvalidGoal: `T` is not one pose.
            InvalidProblem: Several targets, or another argument that is not as described.
        """
        before = self._duration
        if dt is not None or before != self.period:
            self._set_duration(dt)
        try:
            if twist is not None or velocity is not None or T is None or axes != "base":
                return self._without_pose(T, twist, axes, velocity)
            return self._with_pose(T)
        except KinseekError:
            self._set_duration(before)
            raise

    def _with_pose(self, T: Any) -> Step:
        """Do one step towards a pose."""
        target = (
            plain_array(T, (4, 4)) if self._goal.plain and not self._way and self._return is None else None
        )
        if target is None:
            if has_gaps(T):
                # What was on its way would go on from where the joints are not any more.
                self._way.clear()
                self._forget_loss()
                return self._stopped()
            target = self._goal.target(T)
        if self._way:
            step = self._along(target)
        elif self._return is not None:
            step = self._recovered(target, *self._return)
        else:
            step = self._tracked(target)
        self._carried = None
        return step

    def _set_duration(self, dt: float | None) -> None:
        """Set the duration of this step.

        Raises:
            InvalidProblem: It is not a time.
        """
        self._duration = self.period if dt is None else as_number("dt", dt, *TIMES, InvalidProblem)
        self._state.reach[self._own] = self.velocity * self._duration

    def _tracked(self, target: Array) -> Step:
        """Do one step towards a pose as kernels take it, (4, 4)."""
        joints, state, aim = self._joints, self._state, target
        joints.look()
        if self._beside > 0 and not has_gaps(target):
            if self._goal.plain:
                target = self._goal.target(target)
            self._beside -= 1
            aim = self._ahead(target)
        drifted = None if self._drift is None else self._drift.state
        if self._drift is not None:
            self._set_drift(self._drift)
        position, orientation, ended, *found = track_step(
            self._goal.index.address,
            self._goal.tolerances,
            aim,
            self._goal.memory,
            state,
            joints.motion,
            joints.room,
            self._duration,
        )
        if ended == servo.NO_POSE:
            # The kernel has moved nothing. Checking in Python repairs a pose that is nearly valid, or raises an error.
            if self._drift is not None and drifted is not None:
                self._drift.state = drifted
            return self._stopped() if has_gaps(target) else self._tracked(self._goal.target(target))
        restriction = Restriction(*found)
        if held := restriction.pair >= 0:
            restriction = joints.with_room(restriction, self._duration)
        ranges = self._goal.given.ranges is not None
        if held or aim is not target or ranges:
            # The kernel compares the reference with `aim`, and with one point of ranges: the values of their joints now.
            position, orientation = self._goal.errors(joints.motion.q, target)
            met = self._goal.met(position, orientation)
            if not met and (aim is not target or ended == servo.TRACKING):
                ended = LAGGING
            if ranges and ended in (LAGGING, LIMIT, SINGULAR) and met:
                ended = servo.TRACKING
        self._store(target)
        if ended == servo.TRACKING:
            if self._recovery.lost_for:
                self._forget_loss()
        elif (
            # A lost pose stays lost until one is reached.
            self._recover
            and (self._recovery.lost_for or is_away(position, orientation))
            and self._recovery.is_due(self._duration)
        ):
            self._look_for(target, ended)
        return self._reported(
            _ENDED[self._reached(position, orientation, ended, restriction)],
            position,
            orientation,
            restriction,
        )

    def _ahead(self, target: Array) -> Array:
        """Return a pose a little ahead of the hand on the straight way to a target, (4, 4), as kernels take them.

        The reference is nearest to the target in every period, which leads the hand the shortest way only if it is near.
        """
        return _towards(self._goal.target(self._goal.pose_at(self.q)), target, HELD, 1.0, np.zeros(6))

    def _reached(self, position: float, orientation: float, ended: int, restriction: Restriction) -> int:
        """Return the outcome of a step of the joints: that of the reference, unless they are elsewhere."""
        if restriction.joint < 0:
            return ended
        if self._goal.met(position, orientation):
            return servo.TRACKING
        return LIMIT if self._is_at_limit(restriction) else LAGGING

    def _is_at_limit(self, restriction: Restriction) -> bool:
        """Return whether the joint that is kept from what was desired has arrived at the end of its range."""
        motion, joint = self._joints.motion, restriction.joint
        arrived = not motion.lower[joint] < motion.q[joint] < motion.upper[joint]
        return restriction.limit == POSITION and (arrived or abs(motion.velocity[joint]) < AT_REST)

    def _reported(
        self, status: TrackStatus, position: float, orientation: float, restriction: Restriction
    ) -> Step:
        """Describe the step that the joints have made."""
        motion, own = self._joints.motion, self._own
        limited: tuple[str, str] | None = None
        obstacle: tuple[str, str, float] | None = None
        if restriction.pair >= 0:
            status, obstacle = TrackStatus.BRAKING, self._joints.obstacle(restriction.pair)
            if np.abs(motion.velocity[own]).max() < AT_REST:
                # The reference is not to run away while the joints stand.
                self._restart()
                self._beside = max(1, round(BESIDE / self.period))
        elif restriction.joint >= 0:
            limited = self._mechanism.joint_names[restriction.joint - own.start], KINDS[restriction.limit]
        elif status in (TrackStatus.LIMIT, TrackStatus.LAGGING):
            joint = self._limiting_joint(self._state, LIMIT if status is TrackStatus.LIMIT else LAGGING)
            if joint is not None:
                limited = joint, KINDS[POSITION if status is TrackStatus.LIMIT else VELOCITY]
        now = self._joints.state.copy()
        if not self._goal.plain:
            now = now[:, own]
        # Indices, since taking the rows of an array by iteration is three times as slow.
        return Step(now[0], status, position, orientation, now[1], now[2], limited, obstacle)

    def _restart(self) -> None:
        """Let the reference begin again where the joints are."""
        self._state.now[:] = self._joints.motion.q
        self._state.last[:] = 0.0
        self._joints.restart()

    def _store(self, target: Array) -> None:
        """Store the pose of this period for predictions; of a longer one several times."""
        self._past.store(target)
        if self._duration != self.period:
            for _ in range(1, min(round(self._duration / self.period), self._past.capacity)):
                self._past.store(target)

    def _set_drift(self, drift: Drift) -> None:
        """Set by how much the preference moves the joints in this step."""
        self._state.drift[self._own] = drift.step(self._state.now[self._own], self._duration)

    def _without_pose(self, T: Any, twist: ArrayLike | None, axes: str, velocity: ArrayLike | None) -> Step:
        """Do one step with a twist, with velocities of the joints, or without a target."""
        given = [
            name
            for name, one in (("a pose", T), ("twist=", twist), ("velocity=", velocity))
            if one is not None
        ]
        if len(given) > 1:
            raise InvalidProblem(f"step() takes one target, got {' and '.join(given)}")
        if axes not in AXES:
            raise InvalidProblem(suggest(str(axes), AXES, "axes of a twist"))
        if T is not None:
            raise InvalidProblem(f"axes={axes!r} is for twist=, got a pose")
        numbers = np.zeros(0)
        if twist is not None:
            numbers = _numbers("twist", twist, 6, "[m/s, m/s, m/s, rad/s, rad/s, rad/s]")
        if velocity is not None:
            numbers = _numbers("velocity", velocity, self._mechanism.dof, "[rad/s] or [m/s]")
        self._way.clear()
        self._forget_loss()
        if not given or not (np.abs(numbers) <= LARGEST).all():  # It may be NaN.
            return self._stopped()
        if twist is not None:
            return self._moved_by_twist(numbers, axes)
        self._carried = None
        restriction = self._go(numbers)
        status = TrackStatus.TRACKING
        if restriction.joint >= 0:
            status = TrackStatus.LIMIT if self._is_at_limit(restriction) else TrackStatus.LAGGING
        return self._reported(status, np.nan, np.nan, restriction)

    def _stopped(self) -> Step:
        """Brake for one period."""
        self._carried = None
        return self._reported(
            TrackStatus.STOPPING, np.nan, np.nan, self._go(np.zeros(self._mechanism.dof))._replace(joint=-1)
        )

    def _go(self, velocity: Array) -> Restriction:
        """Change to velocities of the arm's joints, (n,); the reference goes with the joints."""
        joints, all_of_them = self._joints, np.zeros(self._goal.arm.dof)
        all_of_them[self._own] = velocity
        restriction = joints.go(all_of_them, self._duration)
        self._state.now[:] = joints.motion.q
        self._state.last[:] = joints.motion.velocity * self._duration
        return restriction

    def _moved_by_twist(self, twist: Array, axes: str) -> Step:
        """Move the target by a twist, (6,), and the joints with it.

        The target moves from where the hand is, so that it never runs away. What the twist does not change, the position or
        the orientation, stays as it was when the hand was at rest.
        """
        h, hand = self._duration, self._goal.pose_at(self.q)
        target = hand.copy() if self._carried is None else self._carried
        moving = np.array([twist[:3].any(), twist[3:].any()])
        if not self._joints.motion.velocity.any():
            self._moved_since_rest[:] = False
        self._moved_since_rest |= moving
        most = np.where(self._moved_since_rest, LEASH, HELD)
        moved = twist if axes == "base" else (twist.reshape(2, 3) @ hand[:3, :3].T).reshape(6)
        self._carried = _towards(hand, target, most, 1.0, h * moved)
        aim = self._goal.target(_towards(hand, target, most, CATCH_UP, h * moved))
        self._state.now[:] = self._joints.motion.q
        if self._drift is not None:
            self._set_drift(self._drift)
        *_, ended = servo_step(
            self._goal.index.address, self._goal.tolerances, aim, self._goal.memory, self._state
        )
        wanted = (self._state.now - self._joints.motion.q)[self._own] / h
        restriction = self._go(wanted)
        aim = self._goal.target(self._carried)
        position, orientation = self._goal.errors(self._joints.motion.q, aim)
        self._store(aim)
        return self._reported(
            _ENDED[self._reached(position, orientation, ended, restriction)],
            position,
            orientation,
            restriction,
        )

    def _forget_loss(self) -> None:
        """Clear the state of a lost pose."""
        self._return = None
        self._recovery.forget()

    def _look_for(self, target: Array, ended: int) -> None:
        """Begin to return to a lost pose, if joint values that reach it were found and no body is on the way there."""
        found = self._recovery.solutions(target, self._state, ended == LAGGING)
        (scene, clearance), here = self._around, self.q
        for step in self._by_time(self._ways(found))[:WAYS]:
            there = (self._state.now + step)[self._own]
            if scene is None or scene.free_motion(here, there, clearance):
                self._return = Return(self._standing(1, step), None)
                return

    def _recovered(self, T: Array, there: State, way: StraightWay | None) -> Step:
        """Make one period of the motion to joint values that reach the pose; these values track the pose meanwhile.

        The motion ends early if the pose can be reached from the current joint values, e.g. when the hand is to stop.
        """
        state, joints = self._state, self._joints
        there.reach[:] = state.reach
        here = _copied(state)
        *_, at_once = self._goal.step(T, here)
        position, orientation, ended = self._goal.step(T, there)
        if (at_once == servo.TRACKING and np.abs(here.now - there.now).max() > ARRIVING) or (
            ended in (LIMIT, SINGULAR) and is_away(position, orientation)
        ):
            self._return = None
            return self._tracked(T)
        self._store(T)
        if way is None:
            restriction = self._go(np.zeros(self._mechanism.dof))
            if not joints.motion.velocity.any():
                self._return = Return(there, StraightWay(state.now.copy(), self._rates))
            return self._reported(TrackStatus.RECOVERING, *self._goal.errors(joints.motion.q, T), restriction)
        q = way.step(there.now, self._duration)
        state.last[:], state.now[:] = q - state.now, q
        restriction = joints.follow(q, self._duration)
        position, orientation = self._goal.errors(joints.motion.q, T)
        if (q != there.now).any():
            if restriction.pair >= 0 and np.abs(joints.motion.velocity).max() < AT_REST:
                self._return = None  # A body holds the joints, while the way would end without them.
            return self._reported(TrackStatus.RECOVERING, position, orientation, restriction)
        there.last[:] = state.last
        self._state = there
        self._forget_loss()
        return self._reported(
            _ENDED[self._reached(position, orientation, ended, restriction)],
            position,
            orientation,
            restriction,
        )

    def singular_direction(self) -> Array | None:
        """Return the twist that the hand loses first at the current joint values, or None if it can move in all directions.

        Returns:
            The unit vector of a twist, (6,), linear [m/s] and angular [rad/s], in axes of the base: the singular vector of
            the Jacobian with the least singular value. None if that is more than a thousandth of the largest one.
        """
        J = jacobian_many(Problem(self._mechanism, self._goal.given).arrays, self.q[None])[0]
        U, values, _ = np.linalg.svd(J)
        lost = len(values) < len(U) or values[-1] <= SINGULAR_RATIO * values[0]
        return U[:, -1].copy() if lost else None

    def switch(self, to: ArrayLike | None = None) -> Array:
        """Move to another branch of the last pose: the nearest other one, or a given one.

        The following steps lead there, whatever their poses are, as fast as the slowest joint allows. Their status is
        SWITCHED.

        Args:
            to: Joint values inside the limits, (n,), that reach the last pose, e.g. from `continuing`; by default the
                nearest other branch is searched.

        Returns:
            The motion, one row per period, (k, n), unless a body holds the joints. The hand follows no pose during it. It is
                linear in the joints from where they were to be, which they reach on the way.

        Raises:
            InvalidProblem: No pose was given yet, the pose has no other branch inside the limits, `to` does not reach it, or
                a joint speed limit is unknown.
        """
        if not self._past.count:
            raise InvalidProblem("switch() needs a pose: call step(T) first")
        target = self._past.pose()
        if not np.isfinite(self.velocity).all():
            raise InvalidProblem(
                "switch() needs a speed limit for every joint: give arm.track(..., velocity=)"
            )
        steps = self._others(target) if to is None else self._given_branch(target, to)[None]
        if not len(steps):
            raise InvalidProblem("the last pose has no other branch inside the limits")
        step = steps[0]
        needed = self._time_of(step) / self.period * (1 + 1e-9)
        way, now = None, self._state.now.copy()
        if needed <= MOST_PERIODS:
            way = straight_way(now, now + step, self._rates, self.period, MOST_PERIODS)
        if way is None:
            raise InvalidProblem(
                f"the motion to the other branch takes {max(needed, MOST_PERIODS):.3g} periods or more, expected at most "
                f"{MOST_PERIODS:,}: give arm.track a higher velocity= or a longer period="
            )
        self._way, rows = list(way), list[Array]()
        joints = self._joints.alone()
        # Joints that are not at the reference, or move, follow the way later.
        for _ in range(MOST_PERIODS):
            joints.follow(self._way[len(rows)], self.period)
            rows.append(joints.motion.q[self._own].copy())
            if len(rows) == len(self._way):
                if np.abs(joints.motion.q - way[-1]).max() <= ARRIVED:
                    break
                self._way.append(way[-1])
        self._forget_loss()
        return np.array(rows)

    def continuing(self, seconds: float = 1.5, looks: int = 75) -> Array | None:
        """Find another branch of the last pose on which the extrapolated motion of the hand can continue.

        The search and the look-ahead take some tenths of a millisecond per branch. Call this when `foresee` reports a
        problem, not in every period.

        Args:
            seconds: How long the hand must be able to continue.
            looks: See `foresee`.

        Returns:
            Joint values for `switch`, (n,): the branch that is reached in the shortest time. None if no branch that was
            found continues.

        Raises:
            InvalidProblem: See `foresee`.
        """
        poses, at_once, _ = self._past.coming(seconds, looks)
        for step in self._others(self._past.pose()):
            state = self._standing(at_once, step)
            if self._goal.look_ahead(poses, state)[2] == servo.TRACKING:
                return np.asarray((self._state.now + step)[self._own])
        return None

    def _others(self, target: Array) -> Array:
        """Return the joint motions to the other branches of a pose inside the limits, shortest time first, (k, n)."""
        steps = self._ways(solutions_of(self._goal.problem, target[:3]))
        return self._by_time(steps[np.abs(steps[:, self._own]).max(axis=1, initial=0.0) > ELSEWHERE])

    def _by_time(self, steps: Array) -> Array:
        """Sort joint motions, (k, n), by the time that they take."""
        # Stable: equal times keep the order of the search, so the result has the same bits everywhere.
        return np.asarray(steps[np.argsort([self._time_of(step) for step in steps], kind="stable")])

    def _ways(self, found: Array) -> Array:
        """Return the joint motions to joint values, (k, n), without full turns if the limits allow that."""
        here = self._state.now
        steps = self._turning.step(found - here)
        there = here + steps
        lower, upper = self._turning.open_lower, self._turning.open_upper
        inside = np.asarray((there >= lower) & (there <= upper)).all(axis=1, keepdims=True)
        return np.asarray(np.where(inside, steps, found - here))

    def _given_branch(self, target: Array, to: ArrayLike) -> Array:
        """Return the joint motion to given joint values that reach a pose, (n,)."""
        q = as_joints(self._mechanism, to, "to")
        if q.shape != (self._mechanism.dof,):
            raise InvalidProblem(f"to must have shape ({self._mechanism.dof},), got {q.shape}")
        q = self._goal.with_virtual(q, target)
        position, orientation = self._goal.errors(q, target)
        if is_away(position, orientation):
            raise InvalidProblem(
                f"the joint values given to switch() must reach the last pose: the hand would be {position:.3g} m and "
                f"{orientation:.3g} rad away from it"
            )
        if ((q < self._turning.open_lower) | (q > self._turning.open_upper)).any():
            raise InvalidProblem(
                "the joint values given to switch() must lie inside the limits of the joints"
            )
        return np.asarray(self._turning.way(q - self._state.now))

    def _time_of(self, step: Array) -> float:
        """Time that the joints need for a motion [s]; the size of the motion if no speed is known."""
        own = step[self._own]
        return float(np.abs(own / np.where(np.isfinite(self.velocity), self.velocity, 1.0)).max())

    def _along(self, T: Array) -> Step:
        """Make one step of the motion to another branch."""
        self._store(T)
        return self._moved(self._way.pop(0), T, TrackStatus.SWITCHED)

    def _moved(self, q: Array, T: Array, status: TrackStatus) -> Step:
        """Move to joint values, (n,), that do not follow the pose of the period."""
        state = self._state
        state.last[:], state.now[:] = q - state.now, q
        restriction = self._joints.follow(q, self._duration)
        return self._reported(status, *self._goal.errors(self._joints.motion.q, T), restriction)

    def foresee(self, seconds: float = 1.0, looks: int = 50, poses: ArrayLike | None = None) -> Foresight:
        """Predict whether the hand will lose its pose, by more than 1 mm or 0.01 rad, if it continues as it came.

        The extrapolation continues the rotation and the curvature of the hand's motion over the last four tenths of a
        second.

        Args:
            seconds: How far to look ahead; at most five times the time for which poses have come.
            looks: Number of steps of the look-ahead; each is a whole number of periods.
            poses: The poses to come, if they are known, one per period, (k, 4, 4); nothing is extrapolated then.

        Raises:
            InvalidProblem: Fewer than two poses were given to `step`, or `seconds` or `looks` is invalid.
            InvalidGoal: `poses` are not poses.
        """
        if poses is None:
            coming, at_once, near = self._past.coming(seconds, looks, AFTER)
        else:
            given = as_pose(poses).reshape(-1, 4, 4)
            coming, at_once = np.array([self._goal.target(T) for T in given]).reshape(-1, 4, 4), 1
            near = len(coming)
        state = self._standing(at_once)
        tracked, lost, ended = self._goal.look_ahead(coming[:near], state)
        if ended == servo.TRACKING:
            return Foresight(TrackStatus.TRACKING, np.inf, None)
        joint = self._limiting_joint(state, ended)
        if ended == LAGGING:
            # If much faster joints keep up for a while, the speed is the cause and not the end of the branch.
            state = self._standing(at_once)
            state.reach[:] *= FASTER
            while_after = round(AFTER / self.period / at_once)
            _, _, truly = self._goal.look_ahead(coming[: lost + 1 + while_after], state)
            if truly != servo.TRACKING:
                ended = LIMIT if truly == LIMIT else SINGULAR
                joint = self._limiting_joint(state, ended)
        return Foresight(_ENDED[ended], (tracked + 1) * at_once * self.period, joint)

    def _standing(self, at_once: int, away: Array | None = None) -> State:
        """Return the current state, or one at rest `away` from it, (n,), for steps of `at_once` periods each."""
        state = _copied(self._state)
        periods = at_once * (self.period / self._duration)
        state.reach[:] *= periods
        state.last[:] *= periods
        if away is not None:
            state.now[:] += away
            state.last[:] = 0.0
        return state

    def _limiting_joint(self, state: State, ended: int) -> str | None:
        at_limit = (state.now <= state.lower) | (state.now >= state.upper)
        fast = np.abs(state.last) >= state.reach * (1 - 1e-9)
        some = np.flatnonzero((at_limit if ended == LIMIT else fast & ~at_limit)[self._own])
        names = self._mechanism.joint_names
        return names[int(some[0])] if len(some) and ended != SINGULAR else None


def _copied(state: State) -> State:
    """Copy a state, so that steps do not change the original."""
    return State(*(row.copy() for row in state))


def _numbers(name: str, values: ArrayLike, count: int, unit: str) -> Array:
    """Read some numbers, which may be NaN, (count,).

    Raises:
        InvalidProblem: Not so many numbers.
    """
    try:
        numbers = as_float_array(values)
    except (TypeError, ValueError, OverflowError):
        numbers = np.zeros(0)
    if numbers.shape != (count,):
        raise InvalidProblem(f"{name} must be {count} numbers {unit}, got {values!r:.80}")
    return numbers


def _towards(hand: Array, target: Array, most: ArrayLike, share: float, twist: Array) -> Array:
    """Return a pose on the way to another one, moved by a twist; see `move_towards`."""
    moved = np.empty((4, 4))
    move_towards(hand, target, np.asarray(most, dtype=np.float64), share, twist, moved)
    return moved
