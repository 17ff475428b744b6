"""The result of a search: joint values, and the errors that they leave."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Generic, Self, cast

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidUse, NotReached
from .goal import Goal
from .kernels.arm.pose_error import judge_poses
from .problem import DeferredProblem, Problem
from .robots.chain import SerialChain
from .robots.mechanism import Mechanism
from .robots.named import by_name
from .support.lazy import Lazy, Made
from .trace import Trace

if TYPE_CHECKING:  # Python 3.13 introduces defaults of type variables; type checkers always support them.
    from typing_extensions import TypeVar

    Flag = TypeVar("Flag", default=Any)
    Number = TypeVar("Number", default=Any)
    Count = TypeVar("Count", default=Any)
    State = TypeVar("State", default=Any)
else:
    from typing import TypeVar

    Flag, Number, Count, State = (TypeVar(name) for name in ("Flag", "Number", "Count", "State"))

Array = NDArray[np.float64]


class Status(Enum):
    """How a search ended; the value is the sentence to show."""

    SOLVED = "Solved: both errors are within their tolerances."
    BEST_EFFORT = "Best effort: the pose found misses a tolerance."
    REJECTED = "Rejected: solutions were found, and `valid` rejected each of them."
    PROVED_UNREACHABLE = "Proved unreachable: no joint values within the limits meet the tolerances."
    OUT_OF_TIME = "Out of time: the nearest pose found before the time limit; a tolerance is missed."
    INVALID = "Invalid: the target is not a pose, so it was not solved."
    BLOCKED = "Blocked: every solution found hits something or comes nearer than the clearance."
    PROVED_BLOCKED = (
        "Proved blocked: every solution within the limits hits something or comes nearer than the clearance."
    )

    def __str__(self) -> str:
        """The sentence."""
        return self.value


_NO: Any = False
_NONE: Any = 0


class _Reported(Made):
    """A field that is read from a kernel's report at its first use, because most callers read only q.

    If an object stores the field itself, its value takes precedence, as with `problem.DeferredProblem`.
    """

    def __init__(self, place: int) -> None:
        """Use the number at a position of the report, see `quick_solution`."""
        self.place = place

    def __get__(self, solution: Any, owner: type) -> Any:
        """Read the number from the report and store it in the solution.

        Raises:
            AttributeError: Read from the class; `dataclasses` takes that for a field without a default.
        """
        report = None if solution is None else solution.__dict__.get("_report")
        if report is None:
            raise AttributeError(f"{owner.__name__!r} has its {self.name} in each object alone")
        value = solution.__dict__[self.name] = report[self.place]
        return value

    def can_be_remade(self, state: Mapping[str, Any]) -> bool:
        """Return whether the solution holds its report."""
        return "_report" in state


@dataclass(frozen=True, eq=False)
class Solution(Lazy, Generic[Flag, Number, Count, State]):
    """The solution of one target, or of a batch; in a batch every field has the leading shape (...) of the batch.

    Errors are recomputed from `q` by plain forward kinematics, never taken from a search's own residual.

    A batch has a length, and can be iterated and indexed like its arrays: ``solution[3]``, ``solution[2:5]``,
    ``solution[~solution.success]``. A solution has no truth value; use ``solution.success``.

    Attributes:
        q: Joint values inside the limits, (..., n), [rad] or [m].
        success: Are both tolerances met? If there is a `scene` or a `valid`, is the solution also free of collision and
            accepted? bool, or (...) bool.
        position_error: [m], float or (...).
        orientation_error: [rad], float or (...).
        weighted_error: The paper's K_P |p - p_g| + K_A [(1 - x·x_g) + (1 - y·y_g)] (Sec. 2.2), no unit, float or (...).
        evaluations: Number of FK evaluations, the deterministic measure of work, int or (...).
        nodes_created: Number of search-tree nodes that were made, int or (...); 0 if the search builds no tree.
        nodes_expanded: Number of search-tree nodes that were visited, int or (...); 0 if the search builds no tree.
        problem: The problem that was solved.
        proved_unreachable: Is it proved that no joint values inside the limits reach the goal? bool or (...) bool.
        rejected: Number of solutions for which the user's `valid` returned False, int or (...); without success, every
            solution that was found.
        out_of_time: Did the time limit end the search before it was done? bool or (...) bool.
        invalid: Was the target skipped because it is not a pose? Then `q` and the errors are NaN, and `problem` has the
            identity in its place. bool or (...) bool; see ``bad=`` in `Arm.ik`.
        blocked: Number of solutions that collide in the `scene` or come closer than the clearance, int or (...); without
            success, every solution that was found, except those that `valid` rejected.
        proved_blocked: Is it proved that every solution inside the limits collides in the `scene`, or comes closer than the
            clearance? bool or (...) bool.
        trace: What the search did, pass by pass, if requested; see the property.
        contacts: The colliding pairs of bodies at `q` and their depth, if the status is `Status.BLOCKED` or
            `Status.PROVED_BLOCKED`.

    For type checkers this class is generic in the types of its flags, numbers, counts and status. `Arm.ik` sets them if the
    goal's type shows that it is one pose or a batch: then ``success`` is a bool or an array. Otherwise, and if `Solution` is
    written alone, they are ``Any``: code for one pose and code for a batch both pass, but a name that does not exist never
    does.
    """

    q: Array
    success: Flag
    if TYPE_CHECKING:
        position_error: Number
        orientation_error: Number
        weighted_error: Number
        evaluations: Count
        nodes_created: Count
        nodes_expanded: Count
        problem: Problem
    else:
        position_error: Number = _Reported(0)
        orientation_error: Number = _Reported(1)
        weighted_error: Number = _Reported(2)
        evaluations: Count = _Reported(3)
        nodes_created: Count = _Reported(5)
        nodes_expanded: Count = _Reported(5)
        problem: Problem = DeferredProblem()
    proved_unreachable: Flag = _NO
    rejected: Count = _NONE
    out_of_time: Flag = _NO
    invalid: Flag = _NO
    blocked: Count = _NONE
    proved_blocked: Flag = _NO
    _trace: Any = None
    """A `Trace`, or an object array of them, (...); None if no trace was requested."""
    _contacts: Any = None
    """A tuple of contacts, or an object array of them, (...); None without a scene."""

    def __post_init__(self) -> None:
        """Give every field the shape of the batch, including those left at their defaults."""
        if isinstance(self.success, np.ndarray):
            for name in _columns(self):
                if not isinstance(value := getattr(self, name), np.ndarray):
                    object.__setattr__(self, name, np.full(self.success.shape, value))

    @property
    def trace(self) -> Any:
        """What the search did, pass by pass: a `Trace`, or an object array of them, (...).

        Copies and pickles keep it, and so do solutions taken out of a batch.

        Raises:
            InvalidUse: It was not requested, or the search keeps none.
        """
        if self._trace is not None:
            return self._trace
        if self.problem.trace:
            raise InvalidUse(
                "the search recorded no trace; a search records one with solvers.recording.Recorder"
            )
        raise InvalidUse(
            "no trace was recorded; request it: arm.ik(..., trace=True), or Problem(..., trace=True)"
        )

    @property
    def contacts(self) -> Any:
        """The colliding pairs at `q` of a blocked target, the deepest pair first; empty for other targets.

        A tuple of contacts with `a`, `b` and `depth` [m], or an object array of them, (...).
        """
        solution: Solution = self
        if not isinstance(solution.success, np.ndarray):
            return self._contacts or ()
        result = np.empty(solution.success.shape, dtype=object)
        result.fill(())
        if self._contacts is not None:
            known = self._contacts != np.array(None)  # None for a target that is not a pose.
            result[known] = self._contacts[known]
        return result

    @property
    def joints(self) -> dict[str, Any]:
        """Joint values by name, base to tip: for each joint a float, or (...) for a batch, [rad] or [m].

        `Arm.fk` and ``near=`` accept it. For a ROS JointState: ``name=list(joints), position=list(joints.values())``.
        """
        return by_name(self.problem.mechanism.joint_names, self.q)

    @property
    def derivative(self) -> Array:
        """How the joint values move with the target: dq/dT by the implicit function theorem, (..., n, 6).

        Its columns are the six components of the target's twist, as in the rows of `Arm.jacobian`: translation of its origin
        [m], then rotation about its origin [rad], along the axes of the frame in which the goal is given (`base=`). So if
        the target (R, p) moves to (exp(w) R, p + v), q moves by ``derivative @ [v, w]`` to first order. With `tool=` the
        target is the pose of the tool.

        - Six joints and a whole pose: the inverse of the Jacobian.
        - A redundant arm: the motion with the least sum of squared joint motions (pseudo-inverse). All others are this one
          plus any in the `null_space`.
        - A position goal: the columns of rotations are 0. A pointing goal: so is a rotation about the tool axis.
        - An arm that can follow only some motions of the target, such as one with five joints: the derivative is exact for
          these. For others it is that of the nearest motion (least squares, with lengths relative to the arm's length).

        It is NaN where `success` is False, and where the solution is singular: where the smallest nonzero singular value
        of the Jacobian is at most 1e-6, with lengths relative to the arm's length. Joint limits are ignored.

        Raises:
            InvalidUse: The goal has free axes or ranges, or the arm has black-box kinematics.
        """
        from .derivatives import derivatives_of

        return derivatives_of(self.problem, self.q, self.success)

    @property
    def null_space(self) -> Array:
        """Directions in which joints move while the goal stays reached, as orthonormal columns, (..., n, r).

        r is the degree of redundancy, 0 for an arm without any. The signs of columns, and for r > 1 their choice, are
        arbitrary. It is NaN as in `derivative`.

        Raises:
            InvalidUse: As `derivative`.
        """
        from .derivatives import null_spaces_of

        return null_spaces_of(self.problem, self.q, self.success)

    @property
    def configuration(self) -> dict[str, Any]:
        """The posture by name, such as ``{"shoulder": "front", "elbow": "up", "wrist": "noflip"}``; see docs/postures.md.

        Arms with six revolute joints and a closed form have ``"shoulder"``, ``"elbow"`` and ``"wrist"``, which differ
        between all solutions of a pose. Arms with seven revolute joints have ``"arm_angle"`` [rad], NaN where it is
        undefined. If joints can turn more than once, ``"turns"`` maps their names to the number of full turns outside
        (-π, π]. In a batch every value has the shape (...) of the batch. ``prefer=`` of `Arm.ik` takes the same mapping.

        Raises:
            InvalidUse: Postures of this arm have no names.
        """
        from .postures import configuration_of

        return configuration_of(self.problem.mechanism, self.q)

    @property
    def status(self) -> State:
        """`Status`, or an object array of them, (...)."""
        solution: Solution = self
        if isinstance(solution.success, np.ndarray):
            # Solved, best effort, rejected, proved unreachable, late, invalid, blocked, proved blocked.
            names = np.array([*Status], dtype=object)
            missed = np.where(solution.rejected > 0, 2, np.where(solution.blocked > 0, 6, 1))
            missed = np.where(solution.out_of_time, 4, missed)
            missed = np.where(solution.proved_unreachable, 3, missed)
            missed = np.where(solution.proved_blocked, 7, missed)
            missed = np.where(solution.invalid, 5, missed)
            return cast("State", names[np.where(solution.success, 0, missed)])
        if solution.success:
            return cast("State", Status.SOLVED)
        reasons = (
            (solution.invalid, Status.INVALID),
            (solution.proved_blocked, Status.PROVED_BLOCKED),
            (solution.proved_unreachable, Status.PROVED_UNREACHABLE),
            (solution.out_of_time, Status.OUT_OF_TIME),
            (solution.rejected, Status.REJECTED),
            (solution.blocked, Status.BLOCKED),
        )
        return cast("State", next((status for given, status in reasons if given), Status.BEST_EFFORT))

    def __bool__(self) -> bool:
        """Raise an error: otherwise a solution that misses its goal would count as true.

        Raises:
            InvalidUse: Always.
        """
        raise InvalidUse(
            "a Solution has no truth value: use solution.success, or solution.success.all() for a batch"
        )

    def __len__(self) -> int:
        """Return the length of a batch: the first number of its shape.

        Raises:
            InvalidUse: The solution has one target.
        """
        return self._batch[0]

    def __iter__(self) -> Iterator[Solution]:
        """Iterate over a batch along its first dimension: one solution per target, or smaller batches."""
        return self.each() if len(self._batch) == 1 else (self[i] for i in range(len(self)))

    def __getitem__(self, index: Any) -> Solution:
        """Return the solution of one target of a batch, or of some, for a NumPy index: ``3``, ``2:5``, a mask.

        Raises:
            InvalidUse: The solution has one target, or the index is invalid.
            IndexError: Out of the batch's range.
        """
        shape = self._batch
        if (
            len(shape) == 1
            and isinstance(index, int | np.integer)
            and not isinstance(index, bool)
            and -shape[0] <= index < shape[0]
        ):
            return self._one(int(index) % shape[0])
        try:
            # NumPy decides what the index means: one target, or a smaller batch.
            chosen = np.arange(int(np.prod(shape))).reshape(shape)[index]
        except IndexError as error:
            if "only integers, slices" in str(error):
                raise InvalidUse(
                    f"a batch of solutions takes integers, slices and masks, got {index!r}"
                ) from None
            raise IndexError(f"{error} (a batch of solutions of shape {shape})") from None
        if isinstance(chosen, np.integer):
            return self._one(int(chosen))
        goal, problem = self.problem.goal, self.problem
        near = problem.near
        if near is not None:
            near = np.broadcast_to(near, (*shape, problem.mechanism.dof))[index]
        part = replace(problem, goal=goal.at(goal.target[index]), near=near)
        return replace(
            self,
            q=self.q[index],
            problem=part,
            _trace=None if self._trace is None else self._trace[index],
            _contacts=None if self._contacts is None else self._contacts[index],
            **{name: getattr(self, name)[index] for name in _columns(self)},
        )

    @property
    def _batch(self) -> tuple[int, ...]:
        """Shape of the batch.

        Raises:
            InvalidUse: The solution has one target.
        """
        if isinstance(self.success, np.ndarray):
            return tuple(self.success.shape)
        raise InvalidUse(
            "this is the solution for one target, which has no length and no items: its joint values are solution.q; "
            "a batch of targets gives a batch of solutions"
        )

    def _one(self, number: int) -> Solution:
        """Return the solution of one target of a batch, by its number in C order."""
        problem, shape = self.problem, self._batch
        at = np.unravel_index(number, shape)
        near = problem.near
        if near is not None:
            near = np.broadcast_to(near, (*shape, problem.mechanism.dof))[at]
        return replace(
            self,
            q=self.q[at],
            problem=replace(problem, goal=problem.goal.at(problem.goal.target[at]), near=near),
            _trace=None if self._trace is None else self._trace[at],
            _contacts=None if self._contacts is None else self._contacts[at],
            **{name: getattr(self, name)[at].item() for name in _columns(self)},
        )

    def each(self) -> Iterator[Solution[bool, float, int, Status]]:
        """Iterate over the solutions of all targets in C order; for one target, over the solution itself."""
        if not isinstance(self.success, np.ndarray):
            yield cast("Solution[bool, float, int, Status]", self)
            return
        for number in range(self.success.size):
            yield self._one(number)

    def require(self) -> Self:
        """Return self if every target is reached.

        Raises:
            NotReached: A tolerance is missed; the error carries this solution.
        """
        solution: Solution = self
        if np.all(solution.success):
            return self
        goal = self.problem.goal
        missed = np.atleast_1d(~np.asarray(solution.success))
        errors = [
            # Errors of targets that are no poses are NaN, which would hide the largest error.
            np.where(solution.invalid, 0.0, each)
            for each in (solution.position_error, solution.orientation_error)
        ]
        position, orientation = float(np.max(errors[0])), float(np.max(errors[1]))
        tolerances = f"tolerances {goal.position_tolerance:g} m, {goal.orientation_tolerance:g} rad"
        count = "" if missed.size == 1 else f"{missed.sum()} of {missed.size} targets not reached; "
        if skipped := int(np.sum(solution.invalid)):
            count += f"{skipped} {'target is not a pose' if skipped == 1 else 'targets are not poses'}; "
        refused = int(np.sum(np.where(missed, solution.rejected, 0)))
        hits = int(np.sum(np.where(missed, solution.blocked, 0)))
        reasons = []
        outside = position > goal.position_tolerance or orientation > goal.orientation_tolerance
        if outside or not (refused or hits or skipped):
            if missed.size == 1:
                away = f"{position:.3g} m and {orientation:.3g} rad away, {tolerances}"
                if not goal.form.columns:
                    away = f"{position:.3g} m away, tolerance {goal.position_tolerance:g} m"
                pose = "nearest pose" if self.problem.nearest else "pose"
                reasons.append(f"the {pose} found is {away}")
            else:
                reasons.append(f"errors up to {position:.3g} m, {orientation:.3g} rad, {tolerances}")
            if proved := int(np.sum(solution.proved_unreachable)):
                which = "the goal" if missed.size == 1 else f"{proved} of them"
                reasons.append(f"proved: no joint values inside the limits reach {which}")
        if refused:
            reasons.append(f"`valid` rejected {refused} {'solution' if refused == 1 else 'solutions'}")
        if hits:
            contacts = [contact for one in self.each() if not one.success for contact in one.contacts]
            where = f": {contacts[0]}" if contacts else ""
            reasons.append(
                f"{hits} {'solution was' if hits == 1 else 'solutions were'} found, and the arm hits something in "
                f"{'it' if hits == 1 else 'each of them'}{where}"
            )
        raise NotReached((count + "; ".join(reasons)).removesuffix("; "), self)

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` with a row per target: joint values by name, status, errors and evaluations.

        For a batch of several dimensions the row index has as many levels.

        Raises:
            MissingExtra: pandas is not installed.
        """
        from .tables import solution_table

        return solution_table(self).to_frame()

    def _repr_html_(self) -> str:
        """HTML for notebooks: a table and a picture; for a batch, of its first rows."""
        from .notebook.cards import solution_card

        return solution_card(self)

    def __repr__(self) -> str:
        """A summary short enough to print in a shell."""
        if not isinstance(self.success, np.ndarray):
            return (
                f"Solution({Status(self.status).name}, q={np.array2string(self.q, precision=4, separator=', ')}, "
                f"position_error={self.position_error:.2e} m, "
                f"orientation_error={self.orientation_error:.2e} rad, evaluations={self.evaluations})"
            )
        skipped = int(np.asarray(self.invalid).sum())
        invalid = f", {skipped} invalid" if skipped else ""
        return f"Solution({int(self.success.sum())} of {self.success.size} solved{invalid}, q{self.q.shape})"


_NO_COLUMNS = ("q", "problem", "_trace", "_contacts")


def _columns(solution: Solution) -> list[str]:
    """Names of the fields with one entry per target."""
    return [each.name for each in fields(solution) if each.name not in _NO_COLUMNS]


def conclude(
    problem: Problem, q: Array, work: NDArray[np.int64], out_of_time: NDArray[np.bool_] | None = None
) -> Solution:
    """Make a solution of joint values, with their errors by plain FK.

    Args:
        problem: The problem, a batch of k targets.
        q: Joint values found, (k, n).
        work: Evaluations, nodes created and nodes expanded of each, (k, 3).
        out_of_time: Was the search for it cut short? (k,); None: no search was.
    """
    return reported(problem, q, judge(problem, q), work, out_of_time)


def judge(problem: Problem, q: Array) -> Array:
    """Position error [m], orientation error [rad] and weighted error of joint values, one row per target, (k, 3)."""
    if problem.axes is None:
        return judge_function(problem.mechanism, problem.goal, q)
    return problem.goal.measure(problem.arrays, np.ascontiguousarray(q))


def with_traces(solution: Solution, traces: Sequence[Trace | None]) -> Solution:
    """Add the traces of its targets, in C order, to a solution; a search without traces leaves it unchanged."""
    if any(trace is None for trace in traces):
        return solution if solution._trace is None else replace(solution, _trace=None)
    shape = solution.problem.goal.shape
    if not shape:
        return replace(solution, _trace=traces[0])
    # Filled one by one: `np.array` would take sequences apart.
    recorded = np.empty(len(traces), dtype=object)
    for i, trace in enumerate(traces):  # One by one: NumPy would take a trace apart.
        recorded[i] = trace
    return replace(solution, _trace=recorded.reshape(shape))


def reported(
    problem: Problem,
    q: Array,
    measured: Array,
    work: NDArray[np.int64],
    out_of_time: NDArray[np.bool_] | None = None,
) -> Solution:
    """Make a solution of joint values whose errors are known.

    Args:
        problem: As in `conclude`.
        q: As in `conclude`.
        measured: Position error [m], orientation error [rad] and weighted error of each by plain FK, (k, 3).
        work: As in `conclude`.
        out_of_time: As in `conclude`.
    """
    goal, shape = problem.goal, problem.goal.shape
    success = goal.met(measured)

    def field(column: NDArray[Any]) -> Any:
        return column.reshape(shape).copy() if shape else column[0].item()

    return Solution(
        q=q.reshape(*shape, problem.mechanism.dof),
        success=field(success),
        position_error=field(measured[:, 0]),
        orientation_error=field(measured[:, 1]),
        weighted_error=field(measured[:, 2]),
        evaluations=field(work[:, 0]),
        nodes_created=field(work[:, 1]),
        nodes_expanded=field(work[:, 2]),
        problem=problem,
        out_of_time=_NO if out_of_time is None else field(out_of_time),
    )


def judge_function(box: Mechanism, goal: Goal, q: Array) -> Array:
    """Call black-box kinematics at q, (k, n), and return the errors [m], [rad] and weighted, (k, 3).

    They are infinite where the mechanism cannot be assembled.
    """
    poses = box.forward(q)
    absent = np.isnan(poses).any(axis=(1, 2))
    poses[absent] = np.eye(4)
    if goal.tip is not None:
        poses = poses @ goal.tip
    measured = judge_poses(poses, goal.targets, goal.arrays)
    measured[absent] = np.inf
    return measured


def quick_solution(
    origin: SerialChain | Problem,
    goal_or_bytes: bytes | Goal,
    near: Array | None,
    q: Array,
    report: tuple[float, float, float, int, bool],
) -> Solution:
    """Make a solution of one target with as little Python work as possible.

    Args:
        origin: The arm, or for a plain pose a problem with another pose.
        goal_or_bytes: The goal; or, for a plain pose, the bytes of its matrix, because the caller may overwrite the
            matrix, and bytes are copied faster than an array.
        near: Joint values to which the solution should be close, (n,).
        q: Joint values, (n,).
        report: Position error [m], orientation error [rad], weighted error, FK evaluations, success.
    """
    solution = object.__new__(Solution)
    result = solution.__dict__
    result["q"], result["success"], result["_report"] = (
        q,
        report[4],
        (*report, 0),
    )  # No nodes: this search builds no tree.
    result["_question"] = origin, goal_or_bytes, None if near is None else near.copy()
    return solution
