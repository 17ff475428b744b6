"""The input of a solver: an arm, a goal, a start, and limits on the work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidProblem
from .goal import Goal
from .kernels.arm.pose_error import LARGEST
from .kernels.arrays import ChainArrays
from .robots.chain import SerialChain
from .robots.mechanism import Mechanism, no_axes
from .robots.named import in_order
from .support.deadline import Deadline
from .support.interrupts import chunks
from .support.lazy import Lazy, Made, lazy
from .support.turns import TURN, nearest_turns
from .support.validation import as_float_array, as_integer

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Problem(Lazy):
    """One inverse-kinematics problem, or a batch of problems that differ in their targets.

    Raises:
        InvalidProblem: `near` of a wrong shape or not finite, a budget below one, or an invalid time limit.
    """

    mechanism: Mechanism
    goal: Goal
    near: Array | None = None
    """Joint values to start from and to stay close to, (n,) or (..., n), [rad] or [m]."""
    budget: int | None = None
    """Maximum number of FK evaluations per target; None leaves it to the search's own parameters."""
    time_limit: float | None = None
    """Seconds after which a search begins no further part of its work and returns its best result; None sets no limit.

    What an arm needs once, its atlas and the compiled kernels, is made in any case.
    """
    nearest: bool = True
    """Search for the nearest pose to a target that is missed? Searches without a separate step for that ignore it."""
    trace: bool = False
    """Record what the search does, pass by pass? The solutions are identical bit for bit; see `kinseek.trace.Trace`."""

    def __post_init__(self) -> None:
        """Validate the start against the arm."""
        if self.near is not None:
            near, batch = as_joints(self.mechanism, self.near, "near"), self.goal.shape
            fits = near.ndim - 1 <= len(batch) and all(
                have in (1, want) for have, want in zip(near.shape[-2::-1], batch[::-1], strict=False)
            )
            if not fits:
                one, many = (self.mechanism.dof,), (*batch, self.mechanism.dof)
                shapes, why = (f"{one} or {many}", "") if batch else (f"{one}", ": the goal is one target")
                raise InvalidProblem(f"near must have shape {shapes}, got {near.shape}{why}")
            object.__setattr__(self, "near", near)
        if self.budget is not None:
            object.__setattr__(self, "budget", as_integer("budget", self.budget, 1, error=InvalidProblem))
        if self.time_limit is not None:
            Deadline(self.time_limit)

    @property
    def axes(self) -> SerialChain | None:
        """The arm with its axes and links; None for black-box kinematics."""
        return self.mechanism.axes

    @property
    def chain(self) -> SerialChain:
        """The arm with its axes and links, for callers that require them.

        Raises:
            InvalidProblem: The arm has black-box kinematics.
        """
        axes = self.mechanism.axes
        if axes is None:
            raise InvalidProblem(no_axes(self.mechanism, "this needs the axes and links of an arm"))
        return axes

    @lazy
    def arrays(self) -> ChainArrays:
        """The chain as kernels take it, with its tip moved to the goal's tool and rotated as the goal requires."""
        arrays, tip = self.chain.arrays, self.goal.tip
        if tip is None:
            return arrays
        fixed = arrays.fixed.copy()
        fixed[-1, :, 3] += fixed[-1, :, :3] @ tip[:3, 3]
        fixed[-1, :, :3] = fixed[-1, :, :3] @ tip[:3, :3]
        return arrays._replace(fixed=fixed)

    @property
    def start(self) -> Array:
        """`near` inside the limits, else the middle of every range, (n,), [rad] or [m]."""
        arm = self.mechanism
        if self.near is None:
            return np.asarray((arm.lower + arm.upper) / 2)
        return within_limits(arm, self.near)

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits, (n,); for a continuous joint, which has none, π to either side of `near` or of 0."""
        arm = self.mechanism
        near = np.zeros(arm.dof) if self.near is None else self.near
        return np.where(arm.endless, near - np.pi, arm.lower), np.where(arm.endless, near + np.pi, arm.upper)

    def placed(self, q: Array) -> Array:
        """Choose the full turns of continuous joints, (..., n): within π of `near`, or of 0 if it is not given.

        A continuous joint has no limits: every number of full turns gives the same pose.
        """
        free = self.mechanism.endless
        if not free.any():
            return q
        centre = np.zeros(self.mechanism.dof) if self.near is None else self.near
        near = np.broadcast_to(centre, np.shape(q))
        # The result may lie beyond π by a rounding, so it is clipped.
        turned = q + nearest_turns(near - q)
        return np.where(free, np.clip(turned, near - np.pi, near + np.pi), q)

    def errors_of(self, q: Array) -> Array:
        """Return position [m], orientation [rad] and weighted error of joint values at the one target, (k, n) -> (k, 3)."""
        goals = self.goal.at(np.repeat(self.goal.target[None], len(q), axis=0))
        return goals.measure(self.arrays, np.ascontiguousarray(q))

    def at(self, target: Array) -> Problem:
        """Return the same problem with another target, or other targets."""
        return replace(self, goal=self.goal.at(target))

    def each(self) -> Iterator[Problem]:
        """Iterate over the targets, one problem each, in order."""
        if not self.goal.shape:
            yield self
            return
        rows = *self.goal.shape, self.mechanism.dof
        nears = None if self.near is None else np.broadcast_to(self.near, rows)
        for index in np.ndindex(self.goal.shape):
            near = None if nears is None else nears[index]
            yield replace(self, goal=self.goal.at(self.goal.target[index]), near=near)


class DeferredProblem(Made):
    """The field `problem` of a result, made when it is first read, because the fast paths of `Arm` leave it out.

    They store a `_question` instead: the arm, or the problem of another pose of a batch; a goal, a pose (4, 4), or its
    bytes; and the joint values to which the solution should be close, (n,), or None. A result that stores its problem does
    not use this descriptor, because an object's own value takes precedence.
    """

    def __get__(self, result: Any, owner: type) -> Problem:
        """Make the problem and store it in the result.

        Raises:
            AttributeError: Read from the class; `dataclasses` takes that for a field without a default.
        """
        question = None if result is None else result.__dict__.get("_question")
        if question is None:
            raise AttributeError(f"{owner.__name__!r} has its problem in each object alone")
        arm, target, near = question
        if isinstance(target, bytes):
            target = np.frombuffer(target).reshape(4, 4).copy()
        if isinstance(arm, Problem):
            problem = replace(arm, goal=arm.goal.at(target), near=near)
        else:
            problem = Problem(arm, target if isinstance(target, Goal) else Goal.pose(target), near)
        made: Problem = result.__dict__.setdefault(self.name, problem)
        return made

    def can_be_remade(self, state: Mapping[str, Any]) -> bool:
        """Return whether the result holds the data that the problem is made of."""
        return "_question" in state


FEW = 8192
"""Size of an array that BLAS multiplies on one thread: OpenBLAS uses several threads for more than 10,000 numbers."""


SQUARED = 2**20
"""Joint values that are checked at a time: a millisecond."""


def as_joints(arm: Mechanism, q: object, name: str = "q") -> Array:
    """Read joint values, (..., n), [rad] or [m], or by name, as `robots.named.in_order` takes them.

    Raises:
        InvalidProblem: Not numbers, a wrong shape, NaN or infinity, or unknown or missing names.
    """
    if not isinstance(q, np.ndarray | list | tuple):
        q = in_order(q, arm.joint_names, name, InvalidProblem)
    try:
        joints = as_float_array(q)
    except (TypeError, ValueError, OverflowError) as error:
        hint = "; give its q" if hasattr(q, "q") else ""
        what = f"got {type(q).__name__}{hint}" if hint else f"{error}"
        raise InvalidProblem(f"{name} must be numbers of shape (..., {arm.dof}): {what}") from error
    if joints.ndim == 0 or joints.shape[-1] != arm.dof:
        raise InvalidProblem(
            f"{name} must have shape ({arm.dof},) or (..., {arm.dof}), got {joints.shape}. "
            f"Joints: {', '.join(arm.joint_names)}"
        )
    # One dot product shows for most arrays that all values are finite and none is too large. For long ones BLAS would use
    # other threads, which costs microseconds, and tens of milliseconds while other work is running.
    if joints.size <= FEW:
        fine = bool(np.vdot(joints, joints) <= LARGEST**2)
    else:
        flat = joints.ravel()
        parts = (flat[some] for some in chunks(joints.size, SQUARED))
        fine = all(np.einsum("i,i->", some, some) <= LARGEST**2 for some in parts)
    if fine:
        return joints
    if not np.isfinite(joints).all():
        bad = np.argwhere(~np.isfinite(joints))[0]
        raise InvalidProblem(
            f"{name} contains NaN or infinity at index {tuple(int(i) for i in bad)} "
            f"(joint {arm.joint_names[bad[-1]]!r})"
        )
    if arm.axes is not None and (np.abs(joints) > LARGEST).any():
        bad = np.argwhere(np.abs(joints) > LARGEST)[0]
        raise InvalidProblem(
            f"{name} must lie within {LARGEST:g} rad or m, got {joints[tuple(bad)]:g} for joint "
            f"{arm.joint_names[bad[-1]]!r}: farther off, joint values are rounded by more than 1e-9"
        )
    return joints


def within_limits(arm: Mechanism, q: Array) -> Array:
    """Return the joint values inside the limits nearest to `q`, with full turns removed where that helps, (..., n)."""
    turns = np.where(arm.turns, TURN, np.inf)
    below, above = q < arm.lower, q > arm.upper
    up = np.where(below, np.ceil((arm.lower - q) / turns), 0.0)
    down = np.where(above, np.ceil((q - arm.upper) / turns), 0.0)
    # For a joint that does not turn, `turns` is infinite and the numbers of turns are 0. Their product is NaN, which
    # becomes 0.
    with np.errstate(invalid="ignore"):
        turned = q + np.nan_to_num((up - down) * turns, nan=0.0, posinf=0.0, neginf=0.0)
    fits = (turned >= arm.lower) & (turned <= arm.upper)
    return np.clip(np.where(fits, turned, q), arm.lower, arm.upper)
