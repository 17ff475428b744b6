"""A motion in time: joint values, velocities and accelerations at every time, with proved bounds of all of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import Mechanism, no_axes
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.validation import as_float_array, as_number

from .curve import Curve
from .law import Law, constant_acceleration
from .limits import LARGEST, Limits
from .shares import Shares, shares_of_limits
from .tip import chain_to_tip, line_distance, speed_bounds

if TYPE_CHECKING:
    from .languages import Language

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_SAMPLES = 5_000_000
"""Largest number of samples of a trajectory, such as 2.8 hours at 500 Hz: each takes some 400 bytes when it is written."""

SAME_TIME = 1e-9
"""Points closer together than this are one point [s]: it is the resolution of ROS."""

TINY = 1e-300
"""Prevents division by zero."""

LIMITING = 0.95
"""A limit counts as the one that caps the speed if this share of it is used."""


class Samples(NamedTuple):
    """A trajectory at equal times."""

    times: Array
    """[s], (k,); the last is the duration."""
    q: Array
    """Joint values, (k, n), [rad] or [m]."""
    velocity: Array
    """(k, n), [rad/s] or [m/s]."""
    acceleration: Array
    """(k, n), [rad/s²] or [m/s²]."""


class LimitsKept(NamedTuple):
    """Proved upper bounds of the largest share of each limit that a motion uses; at most 1."""

    velocity: Array
    """By joint, (n,)."""
    acceleration: Array
    """By joint, (n,)."""
    jerk: Array | None
    """By joint, (n,); None without a limit."""
    tool_speed: float | None
    """None without a limit."""


class ConstantSpeed(NamedTuple):
    """The greatest constant speed of the tip along a path, and what caps it."""

    speed: float
    """[m/s]; 0 if the tip rests somewhere while joints move."""
    limit: str
    """The limit that caps it, as in `Cap`; ``"tool_speed"`` where the tip rests."""
    joint: str | None
    """Name of the joint; None where the tip rests."""
    pose: int
    """Index of the pose after which it is reached."""


class Cap(NamedTuple):
    """A part of a motion in which one limit caps the speed."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    limit: str
    """The limit: ``"velocity"``, ``"acceleration"``, ``"jerk"`` or ``"tool_speed"``."""
    joint: str | None
    """Name of the joint; None for the speed of the tool."""


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Lazy):
    """Joint values at every time of a motion, inside limits everywhere; see `Path.timed`.

    Attributes:
        mechanism: The arm.
        limits: The limits that are kept.
        stops: Indices of the poses, between the first and the last, at which the arm stops, (k,): at breaks, and where a
            joint is kept inside its limits.
        tool: Pose of the tool of the path at the tip, (4, 4), or None.
    """

    mechanism: Mechanism
    limits: Limits
    stops: Indices
    tool: Array | None
    _curve: Curve = field(repr=False)
    _law: Law = field(repr=False)
    _places: Array = field(repr=False)
    """Position of each pose of the path on the curve, (N,); each piece of the curve is an interval of the law."""

    @lazy
    def pose_times(self) -> Array:
        """Time of each pose of the path, (N,), [s]."""
        return self._law.time_at(self._places)

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self._law.duration

    def q(self, t: ArrayLike) -> Array:
        """Return the joint values at times, (...), as (..., n), [rad] or [m].

        Raises:
            InvalidProblem: A time is not a number from 0 to the duration.
        """
        q, arm = self._at(t, 0), self.mechanism
        # Rounding errors may leave the limits.
        return np.where(arm.endless, q, np.clip(q, arm.lower, arm.upper))

    def velocity(self, t: ArrayLike) -> Array:
        """Return the joint velocities at times, (...), as (..., n), [rad/s] or [m/s].

        Raises:
            InvalidProblem: As `q`.
        """
        return self._at(t, 1)

    def acceleration(self, t: ArrayLike) -> Array:
        """Return the joint accelerations at times, (...), as (..., n), [rad/s²] or [m/s²]; where they jump, those after it.

        Raises:
            InvalidProblem: As `q`.
        """
        return self._at(t, 2)

    def jerk(self, t: ArrayLike) -> Array:
        """Return the jerks of the joints at times, (...), as (..., n), [rad/s³] or [m/s³].

        They are infinite where the acceleration jumps; the jerk after such a time is returned.

        Raises:
            InvalidProblem: As `q`.
        """
        return self._at(t, 3)

    def tip(self, t: ArrayLike) -> Array:
        """Return the poses of the tip, or of the path's tool, at times, (...), as (..., 4, 4), [m].

        Raises:
            InvalidProblem: As `q`; or the arm has no axes.
        """
        q = self.q(t)
        return forward_many(self._chain.arrays, _rows(q)).reshape(*q.shape[:-1], 4, 4)

    def tip_speed(self, t: ArrayLike) -> Array:
        """Return the speed of the tip, or of the path's tool, at times, (...), [m/s].

        Raises:
            InvalidProblem: As `q`; or the arm has no axes.
        """
        q, velocity = self.q(t), self.velocity(t)
        jacobians = jacobian_many(self._chain.arrays, _rows(q))[:, :3]
        speed = np.linalg.norm(np.einsum("kij,kj->ki", jacobians, _rows(velocity)), axis=1)
        return np.asarray(speed.reshape(q.shape[:-1]))

    def sample(self, period: float) -> Samples:
        """Return the motion at the times 0, `period`, 2 `period`, ..., and at its end.

        Raises:
            InvalidProblem: The period is not a number above 0, or gives more than `MOST_SAMPLES` samples.
        """
        period = as_number("period", period, self.duration / MOST_SAMPLES, LARGEST, InvalidProblem)
        if period <= 0.0:
            raise InvalidProblem(f"period must be above 0 [s], got {period:g}")
        # The last multiple is left out if it is the end up to rounding.
        multiples = int(np.ceil(self.duration / period - max(1e-9, SAME_TIME / period)))
        times = np.append(period * np.arange(max(multiples, int(self.duration > 0.0))), self.duration)
        return Samples(times, self.q(times), self.velocity(times), self.acceleration(times))

    def save(
        self,
        file: str | Path,
        period: float | None = None,
        *,
        language: str | Language | None = None,
        name: str | None = None,
        blend: float = 0.001,
        axes: Mapping[str, str] | None = None,
    ) -> None:
        """Write the motion to a file, completely or not at all: a table, or a program for a robot.

        No program was run on a controller; docs/trajectories.md says what each form keeps of the time.

        Args:
            file: Its ending selects the form: a table in a .csv, .npy or .parquet file, or a program in a .script
                (URScript), .src (KRL) or .mod (RAPID) file. With a `language`, the ending may be any other.
            period: Time between two points [s]; None takes a point at each pose of the path.
            language: Language of a program: ``"servoj"``, ``"movej"``, ``"movel"``, ``"krl"``, ``"rapid"``, or a `Language`.
            name: Name of a program; by default that of the file.
            blend: Largest radius in which the motion of a program may leave a point aside [m], where its language blends.
            axes: Name of the axis of each joint in a program, by joint; by default they are assigned in order.

        Raises:
            InvalidProblem: An unknown ending, a missing folder, a file that cannot be written, a name that is no identifier,
                or an arm that does not have the axes of the language.
            InvalidUse: An argument of programs for a table, or a template with an unknown field.
            MissingExtra: A .parquet file, and pyarrow is not installed.
        """
        from .formats import save

        save(self, file, period, language=language, name=name, blend=blend, axes=axes)

    def to_frame(self, period: float | None = None) -> Any:
        """Return a ``pandas.DataFrame`` with a row for each point: joint values, the time ``t``, velocities, accelerations.

        Args:
            period: Time between two points [s]; None takes a point at each pose of the path.

        Raises:
            MissingExtra: pandas is not installed.
        """
        from .formats import to_frame

        return to_frame(self, period)

    def to_ros(self, period: float | None = None, messages: Any = None) -> Any:
        """Return a ``trajectory_msgs/JointTrajectory`` of ROS 2, as a dict or as a message.

        Args:
            period: Time between two points [s]; None takes a point at each pose of the path.
            messages: The module ``trajectory_msgs.msg``, to get a message. kinseek imports nothing of ROS.

        Returns:
            The message, or a dict of its shape: ``joint_names`` and ``points``, each with ``positions``, ``velocities``,
            ``accelerations`` and ``time_from_start``, which has ``sec`` and ``nanosec``.
        """
        from .formats import to_ros

        return to_ros(self, period, messages)

    @lazy
    def limits_kept(self) -> LimitsKept:
        """Proved upper bounds of the largest share of each limit that the motion uses, between all samples too."""
        shares = self._shares
        return LimitsKept(
            shares.velocity.max(axis=0, initial=0.0),
            shares.acceleration.max(axis=0, initial=0.0),
            None if shares.jerk is None else shares.jerk.max(axis=0, initial=0.0),
            None if shares.tool_speed is None else float(shares.tool_speed.max(initial=0.0)),
        )

    @lazy
    def bottleneck(self) -> tuple[Cap, ...]:
        """The parts of the motion in which one limit caps the speed, in order of time."""
        names: list[tuple[str, str | None]] = []
        columns = []
        for limit, shares in zip(LimitsKept._fields, self._shares, strict=True):
            if shares is not None:
                columns.append(shares.reshape(len(shares), -1))
                joints: tuple[str | None, ...] = (None,) if shares.ndim == 1 else self.mechanism.joint_names
                names += [(limit, joint) for joint in joints]
        table = np.concatenate(columns, axis=1)
        if not len(table):
            return ()
        which = np.where(table.max(axis=1) >= LIMITING, table.argmax(axis=1), -1)
        begins = np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1])
        ends = np.append(begins[1:], len(which))
        times = self._law.times
        return tuple(
            Cap(float(times[i]), float(times[j]), *names[which[i]])
            for i, j in zip(begins, ends, strict=True)
            if which[i] >= 0
        )

    @lazy
    def constant_tool_speed(self) -> ConstantSpeed:
        """The greatest constant speed of the tip at which the path could be run inside the limits of the joints.

        It leaves out how the speed is reached at the start and left at the end.

        Raises:
            InvalidProblem: The arm has no axes.
        """
        curve = self._curve
        square = speed_bounds(self._chain, curve)[1]
        if not (square > 0.0).all():
            return ConstantSpeed(0.0, "tool_speed", None, self._pose_before(int(np.argmin(square))))
        limits = replace(self.limits, tool_speed=None)
        shares = shares_of_limits(curve, constant_acceleration(curve.knots, 1.0 / square), limits, None)
        # With the speed v the shares of velocity, acceleration and jerk grow as v, v² and v³.
        most = [
            (
                max(float(share.max()), TINY) ** (-1.0 / power),
                power,
                *np.unravel_index(share.argmax(), share.shape),
            )
            for power, share in enumerate((shares.velocity, shares.acceleration, shares.jerk), 1)
            if share is not None
        ]
        speed, power, row, joint = min(most)
        name = self.mechanism.joint_names[joint]
        return ConstantSpeed(speed, LimitsKept._fields[power - 1], name, self._pose_before(int(row)))

    def _pose_before(self, interval: int) -> int:
        """Return the last pose before an interval of the law."""
        return int(np.searchsorted(self._places, self._curve.knots[interval], side="right")) - 1

    @lazy
    def deviation(self) -> float:
        """Proved upper bound of the distance of the tip from the straight lines between the poses [m].

        A closed path returns to its first pose on a line as well. At most twice the true distance.

        Raises:
            InvalidProblem: The arm has no axes.
        """
        places = np.union1d(
            self._places, self._curve.knots[-1]
        )  # The end of a closed path is no pose of its own.
        if len(places) < 2:
            return 0.0
        curve = self._curve.cut(places)
        return float(line_distance(self._chain, curve, np.searchsorted(curve.knots, places)).max())

    @lazy
    def _shares(self) -> Shares:
        chain = None if self.limits.tool_speed is None else self._chain
        return shares_of_limits(self._curve, self._law, self.limits, chain)

    @lazy
    def _chain(self) -> SerialChain:
        chain = chain_to_tip(self.mechanism, self.tool)
        if chain is None:
            raise InvalidProblem(
                no_axes(self.mechanism, "the motion of the tip is computed from axes and links")
            )
        return chain

    def _at(self, t: ArrayLike, order: int) -> Array:
        """Return a derivative of the joint values with respect to time at times, (...), as (..., n).

        Raises:
            InvalidProblem: A time is not a number from 0 to the duration.
        """
        try:
            times = as_float_array(t)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidProblem(f"t must be a time or an array of times [s]: {error}") from None
        if not ((times >= 0.0) & (times <= self.duration)).all():
            bad = times[~((times >= 0.0) & (times <= self.duration))].ravel()[0]
            raise InvalidProblem(f"t must be from 0 to the duration, {self.duration:.9g} s, got {bad:.9g}")
        (s, v, a, j), piece = self._law.at(times.ravel())
        rates = [self._curve.at(s, piece, k) for k in range(order + 1)]
        v, a, j = v[:, None], a[:, None], j[:, None]
        if order == 0:
            (result,) = rates
        elif order == 1:
            result = rates[1] * v
        elif order == 2:
            result = rates[2] * v**2 + rates[1] * a
        else:
            result = rates[3] * v**3 + 3.0 * rates[2] * v * a + rates[1] * j
        return result.reshape(*times.shape, self.mechanism.dof)

    def __repr__(self) -> str:
        """Return a short representation for a shell."""
        stops = f", {len(self.stops)} stops" if len(self.stops) else ""
        return (
            f"Trajectory({self.mechanism.name!r}, {self.duration:.4g} s, {len(self.pose_times)} poses{stops})"
        )


def _rows(q: Array) -> Array:
    return np.ascontiguousarray(q.reshape(-1, q.shape[-1]))
