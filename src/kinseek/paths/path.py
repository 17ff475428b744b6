"""What `Arm.follow` brings back: joint values for every pose, and an honest account of where the arm cannot go on."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import NotReached
from kinseek.lazy import Lazy, lazy
from kinseek.problem import Problem

from .between import deviation_between
from .intervals import intervals
from .joints import Turning

Array = NDArray[np.float64]


class PathStatus(Enum):
    """How a path came out; the value is the sentence to show."""

    CONTINUOUS = "Continuous: one motion reaches every pose, and no joint jumps."
    BROKEN = "Broken: every pose is reached, and the arm must be placed anew between some of them."
    BLOCKED = "Blocked: every answer found to some poses hits something, or valid refuses it; the path goes on through them."
    OUT_OF_TIME = (
        "Out of time: the time limit ended the planning; poses that were not planned by then are missed."
    )
    UNREACHABLE = "Unreachable: some poses are missed; there the path holds the nearest pose found."

    def __str__(self) -> str:
        """The sentence."""
        return self.value


@dataclass(frozen=True, eq=False)
class PathProof:
    """What is proved of a path of N poses: of the hand's straight way from each to the next, a line and one turn.

    Along a proved step there are joint values q(s), 0 <= s <= 1, that change without a jump, have the hand exactly on that
    way, and stay inside the limits; near them there are no others. They pass the joint values of both poses, which are
    reached to a tolerance only, by `within` at most. With joints to spare they are held to a straight way along the
    self-motion, and from one step to the next the arm may have to move, within `within` of those joint values, with its hand
    at rest.
    """

    steps: NDArray[np.bool_]
    """Which steps, from pose i to pose i + 1, are proved, (N - 1,); of a closed path (N,)."""
    within: Array
    """(N,), [rad] or [m]; infinite at a pose beside no step that is proved."""
    out_of_reach: NDArray[np.bool_]
    """Which poses no joint values inside the limits reach, (N,)."""
    undecided: NDArray[np.bool_]
    """Which poses the hand misses and are not proved out of reach, (N,): what a path spends on proofs was not enough, or
    there are joint values that reach them, elsewhere; `Path.why` says which."""
    impossible: tuple[tuple[int, int], ...]
    """Pairs (i, j): no continuous motion inside the limits has the hand exactly on that way from pose i to pose j. No two
    share a step."""
    out_of_time: bool
    """Did the time limit end the proofs early?"""


class Deviation(NamedTuple):
    """How far the hand is, between two poses, from the straight way from one to the other."""

    distance: float
    """[m]"""
    turn: float
    """[rad]"""


@dataclass(frozen=True, eq=False, repr=False)
class Path(Lazy):
    """Joint values for a row of N poses, judged by plain forward kinematics.

    Attributes:
        q: Joint values inside the limits, (N, n), [rad] or [m].
        breaks: Numbers i where the arm must be placed anew between pose i and pose i + 1, which are both reached, (k,). To
            and from a missed pose there is no break.
        why: Of each break, and of each run of missed poses, a sentence that says what stands in the way; it calls poses
            by their index, from 0 on.
        reached: Does pose i meet both tolerances, is it free in the `scene`, and did `valid` agree? (N,) bool.
        position_error: [m], (N,).
        orientation_error: [rad], (N,).
        problem: What was asked.
        closed: Does the motion go on from the last pose to the first?
        planned: Was pose i planned before the `time_limit`? (N,) bool. If not it is missed, and `q` stays where it is.
        out_of_time: Was the time up before the path was planned? A continuous path may then cost more than with more time.
        proof: What is proved of it, see `PathProof`; None without `prove=True`.
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

    @property
    def success(self) -> bool:
        """Is every pose reached, by one continuous motion?"""
        return self.status is PathStatus.CONTINUOUS

    @property
    def status(self) -> PathStatus:
        """How the path came out."""
        if self.out_of_time and not (self.reached.all() and not len(self.breaks)):
            return PathStatus.OUT_OF_TIME
        if not self.reached.all():
            return PathStatus.UNREACHABLE if self._far[~self.reached].any() else PathStatus.BLOCKED
        return PathStatus.BROKEN if len(self.breaks) else PathStatus.CONTINUOUS

    @property
    def _far(self) -> NDArray[np.bool_]:
        """Which poses the hand is farther from than the tolerances, (N,)."""
        goal = self.problem.goal
        there = (self.position_error <= goal.position_tolerance) & (
            self.orientation_error <= goal.orientation_tolerance
        )
        return np.asarray(~there)

    @property
    def certified(self) -> bool:
        """Is it proved that one unbroken branch leads through all poses, and between them, inside the limits?

        False without `prove=True`. What is proved is about the hand's straight way from pose to pose; see `PathProof`.
        """
        return self.success and self.proof is not None and bool(self.proof.steps.all())

    @property
    def proved(self) -> NDArray[np.bool_]:
        """Of which steps, from pose i to pose i + 1, that is proved, (N - 1,); of a closed path (N,)."""
        if self.proof is None:
            return np.zeros(len(self.steps), dtype=np.bool_)
        return self.proof.steps

    @property
    def impossible(self) -> tuple[tuple[int, int], ...]:
        """Pairs (i, j) of which it is proved that no continuous motion inside the limits leads from pose i to pose j."""
        return () if self.proof is None else self.proof.impossible

    @property
    def missed(self) -> tuple[tuple[int, int], ...]:
        """The first and the last pose of each run of missed poses."""
        return tuple(intervals(~self.reached))

    @property
    def _apart(self) -> NDArray[np.int64]:
        """Numbers of the steps that do not count: breaks, and those to and from a missed pose, (k,)."""
        beside = np.flatnonzero(~(self.reached & np.roll(self.reached, -1)))
        count = len(self) if self.closed else len(self) - 1
        return np.union1d(self.breaks, beside[beside < count])

    @lazy
    def steps(self) -> Array:
        """What each joint moves from pose to pose, (N - 1, n), [rad] or [m]; NaN across breaks and to and from missed poses.

        Of a closed path the last row is the step from the last pose to the first, (N, n).
        """
        rows = np.concatenate([self.q, self.q[:1]]) if self.closed else self.q
        steps = np.diff(rows, axis=0)
        if self.closed and len(steps):
            steps[-1] = Turning(self.problem.chain).way(steps[-1])
        steps[self._apart] = np.nan
        return steps

    @property
    def largest_step(self) -> Array:
        """Of each joint the largest step from one reached pose to the next that is no break, (n,), [rad] or [m]."""
        whole = self.steps[~np.isnan(self.steps).any(axis=1)]
        return np.asarray(np.abs(whole).max(axis=0, initial=0.0))

    @property
    def length(self) -> float:
        """Length of the way of the joints: the sum of the Euclidean lengths of the `steps` that are not NaN [rad or m]."""
        return float(np.nansum(np.linalg.norm(self.steps, axis=1)))

    @lazy
    def deviation(self) -> Deviation:
        """The farthest that the hand comes from the straight way between two reached poses, breaks left out.

        The straight way is a line for the place and one turn about a fixed axis for the orientation; the hand's is what
        straight motion of the joints makes of it, looked at in 3 points between two poses. For a goal that leaves axes free,
        the straight way between the poses that are reached.
        """
        return Deviation(*deviation_between(self.problem, self.q, self._apart))

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
        """Short enough to print in a shell."""
        missed = int((~self.reached).sum())
        parts = [f"{len(self)} poses", self.status.name.lower()]
        if len(self.breaks):
            parts.append(f"{len(self.breaks)} break{'s' if len(self.breaks) > 1 else ''}")
        if missed:
            runs = len(self.missed)
            parts.append(f"{missed} missed" + (f" in {runs} runs" if runs > 1 else ""))
        return f"Path({', '.join(parts)}, length {self.length:.4g}, largest step {self.largest_step.max(initial=0.0):.3g})"
