"""A path request: its poses, ends, bounds and costs."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import Cost
from kinseek.errors import InvalidProblem
from kinseek.problem import Problem
from kinseek.support.deadline import Deadline
from kinseek.timing.limits import Limits
from kinseek.virtual_joints import Extended, extended

from .allowed import Allowed

Array = NDArray[np.float64]

LIGHT = 0.02
"""Weight of a joint that stands for a free axis, relative to 1 for a joint of the arm: it moves at almost no cost, but
smoothly. Not examined further."""

ROUNDING = 1e-9
"""Poses closer than this, relative to the arm's reach and in [rad], count as equal up to rounding."""


@dataclass(frozen=True)
class PathRequest:
    """A requested path, checked against the arm."""

    problem: Problem
    start: Array | None
    """Joint values at the first pose, (n,)."""
    end: Array | None
    closed: bool
    longest: Array
    """Largest step of each joint from pose to pose, (N - 1, n), [rad] or [m]. A closed path has one more row, for the step
    from the last pose to the first."""
    velocity: Array | None
    """Largest joint speeds, (n,), [rad/s] or [m/s]."""
    weights: Array
    """Weight of each joint in the distance, (n,)."""
    cost: Cost | None
    valid: Allowed | None
    """Checks of the user's `valid` and the scene; None if neither is given."""
    deadline: Deadline = field(default_factory=Deadline)
    limits: Limits | None = None
    """Limits of the motion whose duration is the cost; None for another cost."""

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.problem.goal.target)

    @property
    def step_weights(self) -> Array:
        """Return the weight of each joint in the cost of a step, (n,): with `velocity`, the step's time is the cost."""
        return self.weights if self.velocity is None else self.weights / self.velocity

    @property
    def ends_where_it_begins(self) -> bool:
        """Return whether the last pose equals the first, up to rounding."""
        first, last = self.problem.goal.target[0], self.problem.goal.target[-1]
        apart = np.abs(last - first)
        apart[:3, 3] /= max(self.problem.chain.reach, 1e-300)
        return len(self) > 1 and bool((apart <= ROUNDING).all())

    def without_ranges(self) -> tuple[PathRequest, slice]:
        """Return the same path for an arm with a virtual joint for each range of the goal, and the slice of its own joints.

        Raises:
            InvalidProblem: Ranges along and about axes that change from pose to pose, or ranges of several rotations that
                are too wide for ranges of angles.
        """
        if self.problem.goal.ranges is None:
            return self, slice(None)
        more = extended(self.problem, inside=True)
        require_inside(more)
        own, dof = more.own, more.problem.chain.dof
        longest = np.full((len(self.longest), dof), np.inf)
        longest[:, own] = self.longest
        weights = np.full(dof, LIGHT)
        weights[own] = self.weights
        velocity = self.velocity
        if velocity is not None:
            velocity = np.full(dof, velocity.max())
            velocity[own] = self.velocity
        ends = []
        for q, i in ((self.start, 0), (self.end, -1)):
            one = extended(self.problem.at(self.problem.goal.target[[i]]), inside=True)
            ends.append(None if q is None else one.with_virtual(q[None])[0])
        valid, cost = self.valid, self.cost
        part = replace(
            self,
            problem=more.problem,
            longest=longest,
            weights=weights,
            velocity=velocity,
            start=ends[0],
            end=ends[1],
            valid=None if valid is None else replace(valid, own=own),
            cost=None if cost is None else _of_the_arm(cost, own),
        )
        return part, own

    def part(self, begin: int, end: int) -> PathRequest:
        """Return the request for poses `begin` up to `end`; start and end stay with the first and the last pose.

        A part is open, except for the whole path.
        """
        if begin == 0 and end >= len(self):
            return self
        end = min(end, len(self))
        part = self._open(self.problem.goal.target[begin:end], self.longest[begin : end - 1])
        return replace(
            part, start=self.start if begin == 0 else None, end=self.end if end == len(self) else None
        )

    def as_open(self) -> PathRequest:
        """Return the request without the step from the last pose of a closed path to the first."""
        return self._open(self.problem.goal.target, self.longest[: len(self) - 1])

    def returning(self, begin: int, q: Array) -> PathRequest:
        """Return the request for a closed path from pose `begin` on, back to the first pose at joint values q, (n,)."""
        targets = self.problem.goal.target
        if not self.ends_where_it_begins:
            targets = np.concatenate([targets, targets[:1]])
        part = self._open(targets[begin:], self.longest[begin : len(targets) - 1])
        return replace(part, start=self.start if begin == 0 else None, end=q)

    def backward(self) -> PathRequest:
        """Return the request for the same poses in the opposite order, of an open path."""
        turned = self._open(self.problem.goal.target[::-1], np.ascontiguousarray(self.longest[::-1]))
        return replace(turned, start=self.end, end=self.start)

    def _open(self, targets: Array, longest: Array) -> PathRequest:
        """Return the request for an open path through other targets."""
        problem = Problem(self.problem.mechanism, self.problem.goal.at(targets))
        return replace(self, problem=problem, closed=False, longest=longest)


def _of_the_arm(cost: Cost, own: slice) -> Cost:
    """Return the user's cost as a function of all joints that only uses the joints of the arm."""
    return lambda q: cost(q[:, own])


def require_inside(more: Extended) -> None:
    """Check that ranges of several rotations are ranges of angles, of which every motion is accepted.

    Raises:
        InvalidProblem: They are too wide.
    """
    if not more.inside:
        raise InvalidProblem(
            f"a path turns ranges about several axes into ranges of angles, and too little is left of these: "
            f"{more.original.goal.within} rad. Give smaller ranges, or ranges about fewer axes"
        )
