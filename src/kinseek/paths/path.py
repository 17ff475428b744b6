"""The result of `Arm.follow`: joint values for every pose, with breaks, missed poses and their reasons."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, NotReached
from kinseek.problem import Problem
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.validation import as_number
from kinseek.timing.limits import read_limits
from kinseek.timing.obstacles import Obstacles, unchanged

from .between import deviation_between
from .joints import Turning

if TYPE_CHECKING:
    from kinseek.timing.trajectory import Trajectory

Array = NDArray[np.float64]


def intervals(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return the first and last index of each run of set flags, (N,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True))


class PathStatus(Enum):
    """Outcome of a path; the value is the sentence to show."""

    CONTINUOUS = "Continuous: one motion reaches every pose, and no joint jumps."
    BROKEN = "Broken: every pose is reached, but not in one continuous motion; breaks says where it is interrupted."
    BLOCKED = "Blocked: at some poses each solution found hits something or is rejected by valid; the path continues there."
    OUT_OF_TIME = (
        "Out of time: the time limit ended the planning; poses that were not planned by then are missed."
    )
    UNREACHABLE = "Unreachable: some poses are not reached; there the path holds the nearest pose found."

    def __str__(self) -> str:
        """Return the sentence."""
        return self.value


@dataclass(frozen=True, eq=False)
class PathProof:
    """Proofs for a path of N poses, about the straight motion of the hand from each pose to the next.

    This motion is a line and one rotation about a fixed axis. Along a proved step there is a continuous function q(s), 0 <=
    s <= 1, that puts the hand exactly on this motion and stays inside the limits. There are no other solutions near it. It
    passes within `within` of the joint values of both poses, which are reached only up to the tolerances. A redundant arm is
    held to a straight line along the self-motion. From one step to the next it may have to move while the hand rests, within
    `within` of those joint values.
    """

    steps: NDArray[np.bool_]
    """Flags of the proved steps from pose i to pose i + 1, (N - 1,); (N,) for a closed path."""
    within: Array
    """Largest distance between the joint values and the branch, (N,), [rad] or [m]; infinite at a pose without a proved
    step."""
    out_of_reach: NDArray[np.bool_]
    """Flags of the poses that no joint values inside the limits reach, (N,)."""
    undecided: NDArray[np.bool_]
    """Flags of the missed poses that are not proved out of reach, (N,). Either the budget for proofs was not enough, or
    other joint values reach the pose; `Path.why` gives the reason."""
    impossible: tuple[tuple[int, int], ...]
    """Pairs (i, j): no continuous motion inside the limits keeps the hand exactly on the motion from pose i to pose j. No
    two pairs share a step."""
    out_of_time: bool
    """Whether the time limit ended the proofs early."""


class Deviation(NamedTuple):
    """Deviation of the hand, between two poses, from the straight motion from one to the other."""

    distance: float
    """Distance [m]."""
    turn: float
    """Angle [rad]."""


@dataclass(frozen=True, eq=False, repr=False)
class Path(Lazy):
    """Joint values for N consecutive poses, evaluated by plain forward kinematics.

    Attributes:
        q: Joint values inside the limits, (N, n), [rad] or [m].
        breaks: Indices i, (k,), of the steps from pose i to pose i + 1 that the arm cannot move along, though both poses are
            reached. Steps to and from a missed pose are not counted as breaks.
        why: A sentence for each break and each run of missed poses that gives the reason. It refers to poses by their index,
            starting at 0.
        reached: Whether pose i meets both tolerances, is free in the `scene`, and is accepted by `valid`, (N,) bool.
        position_error: [m], (N,).
        orientation_error: [rad], (N,).
        problem: The problem with all poses.
        closed: Whether the motion continues from the last pose to the first.
        planned: Whether pose i was planned before the `time_limit`, (N,) bool. If not, it is missed, and `q` stays constant.
        out_of_time: Whether the time was up before the path was planned. A continuous path may then cost more than with more
            time.
        proof: Proofs for the path, see `PathProof`; None without `prove=True`.
        scene: The collision scene in which it is free, or None.
        clearance: Minimum distance of bodies in the scene [m].
    """

    q: Array
    breaks: NDArray[np.int64]
    why: tuple[str, ...]
    reached: NDArray[np.bool_]
    position_error: Array
    orientation_error: Array
    problem: Problem
    closed: bool
    planned: NDArray[np.bool_]
    out_of_time: bool
    proof: PathProof | None = None
    scene: Obstacles | None = None
    clearance: float = 0.0

    @property
    def success(self) -> bool:
        """Whether every pose is reached by one continuous motion."""
        return self.status is PathStatus.CONTINUOUS

    @property
    def status(self) -> PathStatus:
        """Outcome of the path."""
        if self.out_of_time and not (self.reached.all() and not len(self.breaks)):
            return PathStatus.OUT_OF_TIME
        if not self.reached.all():
            return PathStatus.UNREACHABLE if (~met(self))[~self.reached].any() else PathStatus.BLOCKED
        return PathStatus.BROKEN if len(self.breaks) else PathStatus.CONTINUOUS

    @property
    def certified(self) -> bool:
        """Whether it is proved that one continuous branch leads through all poses, and between them, inside the limits.

        False without `prove=True`. The proof covers the straight motion of the hand from pose to pose; see `PathProof`.
        """
        return self.success and self.proof is not None and bool(self.proof.steps.all())

    @property
    def proved(self) -> NDArray[np.bool_]:
        """Flags of the steps from pose i to pose i + 1 for which this is proved, (N - 1,); (N,) for a closed path."""
        if self.proof is None:
            return np.zeros(len(self.steps), dtype=np.bool_)
        return self.proof.steps

    @property
    def impossible(self) -> tuple[tuple[int, int], ...]:
        """Pairs (i, j) for which it is proved that no continuous motion inside the limits leads from pose i to pose j."""
        return () if self.proof is None else self.proof.impossible

    @property
    def missed(self) -> tuple[tuple[int, int], ...]:
        """First and last index of each run of missed poses."""
        return tuple(intervals(~self.reached))

    @property
    def _apart(self) -> NDArray[np.int64]:
        """Indices of the steps that do not count: breaks, and steps to and from a missed pose, (k,)."""
        beside = np.flatnonzero(~(self.reached & np.roll(self.reached, -1)))
        count = len(self) if self.closed else len(self) - 1
        return np.union1d(self.breaks, beside[beside < count])

    @lazy
    def steps(self) -> Array:
        """Joint motion from pose to pose, (N - 1, n), [rad] or [m]; NaN across breaks and to and from missed poses.

        For a closed path the last row is the step from the last pose to the first, (N, n).
        """
        rows = np.concatenate([self.q, self.q[:1]]) if self.closed else self.q
        steps = np.diff(rows, axis=0)
        if self.closed and len(steps):
            steps[-1] = Turning(self.problem.chain).way(steps[-1])
        steps[self._apart] = np.nan
        return steps

    @property
    def largest_step(self) -> Array:
        """Largest step of each joint from one reached pose to the next, without breaks, (n,), [rad] or [m]."""
        whole = self.steps[~np.isnan(self.steps).any(axis=1)]
        return np.asarray(np.abs(whole).max(axis=0, initial=0.0))

    @property
    def length(self) -> float:
        """Length of the path in joint space: the sum of the Euclidean lengths of the `steps` that are not NaN [rad or m]."""
        return float(np.nansum(np.linalg.norm(self.steps, axis=1)))

    @lazy
    def deviation(self) -> Deviation:
        """Largest deviation of the hand from straight motion between two reached poses, without breaks.

        The straight motion is a line for the position and one rotation about a fixed axis for the orientation. The hand's
        motion follows from linear motion of the joints; it is evaluated at 3 points between two poses. If the goal leaves
        axes free, the straight motion is the one between the reached poses.
        """
        return Deviation(*deviation_between(self.problem, self.q, self._apart))

    def timed(
        self,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        jerk: ArrayLike | None = None,
        tool_speed: float | None = None,
        *,
        start_velocity: float = 0.0,
        end_velocity: float = 0.0,
        tolerance: float | None = None,
    ) -> Trajectory:
        """Return the fastest motion through the joint values of all poses that keeps limits everywhere, not at samples only.

        The joints move along cubic splines that pass the rows of `q` within `tolerance`, with continuous velocities;
        `Trajectory.deviation` says how far the tip is from the straight lines between the poses. The limits are kept by
        bounds of the polynomials between the points at which the speed is chosen (docs/trajectories.md). The arm stops at
        breaks, and moves across them with every joint moving linearly. In a scene the motion is proved free of collision;
        where the spline is not, the arm moves linearly from pose to pose, and stops at both.

        Args:
            velocity: Speed limit of each joint, one number or (n,), [rad/s] or [m/s]; by default that of the arm.
            acceleration: Limit of the acceleration of each joint, one number or (n,), [rad/s²] or [m/s²]; by default that
                of the arm.
            jerk: Limit of the jerk of each joint, one number or (n,), [rad/s³] or [m/s³]; None for no limit.
            tool_speed: Largest speed of the tip, or of the tool of the goal [m/s]. It is kept constant where the other
                limits permit it.
            start_velocity: Speed of the tip at the first pose [m/s].
            end_velocity: Speed of the tip at the last pose [m/s].
            tolerance: How far the tip may pass the joint values of a pose, [m] and as many [rad]; by default the tolerances
                of the goal. Poses with rounding errors, as from a file with few decimals, need a larger one: a spline that
                passes many close poses exactly follows each error.

        Raises:
            NotReached: Some poses are missed; the error carries the path.
            InvalidProblem: A limit is not a finite number above 0, or the arm has none for a joint; the speed at an end
                cannot be kept; or in a scene the linear motion across a break is not free, or a step is not, because the
                scene has changed since.
            InvalidScene: Another thread changed the scene during the call.
        """
        from kinseek.timing.timed import Way, timed

        if not self.reached.all():
            raise NotReached(
                f"a path with missed poses has no motion in time. {self.status} {'; '.join(self.why[:3])}",
                self,
            )
        problem = self.problem
        limits = read_limits(problem.mechanism, velocity, acceleration, jerk, tool_speed)
        q = self.q
        if self.closed:
            q = np.concatenate([q, q[-1:] + Turning(problem.chain).way(q[:1] - q[-1:])])
        goal = problem.goal
        near = (goal.position_tolerance, goal.orientation_tolerance)
        if tolerance is not None:
            near = (as_number("tolerance", tolerance, 0.0, np.inf, InvalidProblem),) * 2
        way = Way(problem.mechanism, goal.tool, q, self.breaks, self.scene, self.clearance, near)
        with unchanged(self.scene, "timed"):
            trajectory = timed(way, limits, (start_velocity, end_velocity))
        return replace(trajectory, _places=trajectory._places[: len(self)])

    def require(self) -> Path:
        """Return the path if it is a success.

        Raises:
            NotReached: It is not; the error carries the path.
        """
        if self.success:
            return self
        reasons = "; ".join(self.why[:3]) + (f"; and {len(self.why) - 3} more" if len(self.why) > 3 else "")
        raise NotReached(f"{self.status} Of {len(self)} poses, counted from 0: {reasons}", self)

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.q)

    def __repr__(self) -> str:
        """Return a short representation for a shell."""
        missed = int((~self.reached).sum())
        parts = [f"{len(self)} poses", self.status.name.lower()]
        if len(self.breaks):
            parts.append(f"{len(self.breaks)} break{'s' if len(self.breaks) > 1 else ''}")
        if missed:
            runs = len(self.missed)
            parts.append(f"{missed} missed" + (f" in {runs} runs" if runs > 1 else ""))
        return f"Path({', '.join(parts)}, length {self.length:.4g}, largest step {self.largest_step.max(initial=0.0):.3g})"


def met(path: Path) -> NDArray[np.bool_]:
    """Return flags of the poses whose errors are within the tolerances, also if `valid` rejects them, (N,)."""
    goal = path.problem.goal
    return np.asarray(
        (path.position_error <= goal.position_tolerance)
        & (path.orientation_error <= goal.orientation_tolerance)
    )
