"""The front door: an `Arm` and its inverse kinematics; its forward kinematics are in `kinematics`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self, TypedDict, Unpack, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .deadline import Deadline
from .errors import InvalidProblem
from .goal import Goal
from .invalid_targets import without_invalid
from .kernels.atlas.near import solve_plain_near
from .kernels.atlas.one_goal import solve_plain
from .kinematics import ForwardArm
from .poses import plain_array
from .problem import Problem, as_joints
from .proof.certificate import Certificate, Verdict
from .robots import Mechanism, SerialChain, read
from .shapes import Joints, ManyGoals, OneGoal, UnshapedGoal
from .solution import Solution, Status, quick_solution
from .solvers import Atlas, Solver
from .solvers.atlas.index import SAMPLES, AtlasIndex, atlas_of
from .solvers.atlas.quick import answers_quickly, quick_answer
from .solvers.black_box.samples import Samples, samples_of
from .solvers.checks import as_solver, warn_if_far, with_progress
from .units import warn_of_distance
from .validation import as_integer

if TYPE_CHECKING:
    from .branches.index import BranchIndex
    from .branches.order import Cost, Order, Valid
    from .branches.result import Branches, BranchesBatch
    from .collision.scene import Scene
    from .paths.path import Path as Motion
    from .paths.tracker import Tracker

Array = NDArray[np.float64]


Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]
States = NDArray[np.object_]


class IkOptions(TypedDict, total=False):
    """What `Arm.ik` takes beside the goal; it is explained there."""

    near: Joints | None
    solver: Solver | None
    threads: int | None
    progress: bool
    prove: bool
    prefer: Order | None
    cost: Cost | None
    valid: Valid | None
    scene: Scene | None
    clearance: float
    time_limit: float | None
    trace: bool
    bad: Literal["error", "skip"]


class BranchesOptions(TypedDict, total=False):
    """What `Arm.branches` takes beside the goal; it is explained there."""

    near: Joints | None
    order: Order
    cost: Cost | None
    valid: Valid | None
    scene: Scene | None
    clearance: float
    copies: bool
    count: int | None
    threads: int | None
    prove: bool
    time_limit: float | None


class Arm(ForwardArm):
    """A serial arm. Make one with `kinseek.load`, `Arm.from_dh` or `Arm.from_fk`.

    A class derived from it keeps its own attributes in copies, in pickles and in the arms that `with_tool`, `with_locked`
    and `with_limits` make; these copy the arm and never call ``__init__``.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Wrap what a reader made."""
        super().__init__(mechanism)
        self._index: AtlasIndex | None = None
        self._place_index: AtlasIndex | None = None
        self._branch_index: BranchIndex | None = None

    def __getstate__(self) -> Any:
        """Copy and pickle everything but the atlas, which is rebuilt where it is needed."""
        state = super().__getstate__()
        attributes, slots = state if isinstance(state, tuple) else (state, None)
        attributes = {
            **cast("dict[str, Any]", attributes),
            "_index": None,
            "_place_index": None,
            "_branch_index": None,
        }
        return attributes if slots is None else (attributes, slots)

    def _with(self, mechanism: Mechanism) -> Self:
        """The same arm in all but its mechanism."""
        arm = super()._with(mechanism)
        arm._index = arm._place_index = arm._branch_index = None
        return arm

    @property
    def atlas(self) -> AtlasIndex | Samples:
        """The sorted samples that `ik` looks poses up in: built once, at the first call.

        Those of a function are `kinseek.solvers.black_box.samples.Samples`, with the same figures.
        """
        return samples_of(self._mechanism, SAMPLES) if self._axes is None else self._atlas_along(self._axes)

    def _atlas_along(self, axes: SerialChain) -> AtlasIndex:
        if self._index is None:
            self._index = atlas_of(axes)
        return self._index

    def _atlas_for(self, axes: SerialChain, goal: Goal) -> AtlasIndex:
        """That of a goal; of a place of the tip, which is asked for most, it is at hand."""
        if goal.tool is not None or goal.form.columns:
            return atlas_of(axes, goal)
        if self._place_index is None:
            self._place_index = atlas_of(axes, goal)
        return self._place_index

    @overload
    def ik(self, goal: UnshapedGoal, **options: Unpack[IkOptions]) -> Solution: ...
    @overload
    def ik(self, goal: OneGoal, **options: Unpack[IkOptions]) -> Solution[bool, float, int, Status]: ...
    @overload
    def ik(self, goal: ManyGoals, **options: Unpack[IkOptions]) -> Solution[Flags, Array, Counts, States]: ...
    @overload
    def ik(self, goal: object, **options: Unpack[IkOptions]) -> Solution: ...
    def ik(
        self,
        goal: Any,
        *,
        near: Joints | None = None,
        solver: Solver | None = None,
        threads: int | None = None,
        progress: bool = False,
        prove: bool = False,
        prefer: Order | None = None,
        cost: Cost | None = None,
        valid: Valid | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        time_limit: float | None = None,
        trace: bool = False,
        bad: Literal["error", "skip"] = "error",
    ) -> Solution:
        """Find joint values that reach a goal, or come as near to it as the search can.

        Args:
            goal: A pose, (4, 4) or (..., 4, 4); an object that carries one (SciPy, pinocchio, spatialmath);
                or a `Goal`.
            near: Joint values that the answer shall be near to, (n,) or (..., n), [rad] or [m], or by name as `fk` takes
                them; they may lie outside the limits.
            solver: One of `kinseek.solvers`; by default the `Atlas`.
            threads: Threads for a batch, of the default solver; every core unless given.
            progress: Show a progress bar, of the default solver for a batch, or of a `solver` that has one.
            prove: Try to prove of every missed pose that it is out of reach, see `Arm.prove`; and of one that is blocked,
                that every answer inside the limits hits something, where the arm has no joints to spare.
            prefer: Which of all answers: ``"mid-range"``, ``"limits"`` (far from them) or ``"dexterity"``, as
                `order` in `Arm.branches`. Where the arm has joints to spare, the best along the self-motion.
            cost: Instead of `prefer`, a function from joint values, (k, n), to numbers, (k,): the least is best.
            valid: A function from joint values, (n,), to a bool, asked of one answer after the other until it agrees.
                If it never does, the solution is no success, and `rejected` says how many it refused.
            scene: What the arm may hit, see docs/collisions.md: the first answer that is free in it, in order of preference;
                where the arm has joints to spare, more and more of the self-motion is looked at. If every answer found hits
                something, the status is `Status.BLOCKED`, and `contacts` says what is in the way.
            clearance: How far apart bodies of the scene have to be [m].
            time_limit: [s], after which no further part of the work is begun: the answer is the best so far, and
                `out_of_time` says of each target whether its search was cut short. What an arm needs once, its atlas and
                the compiled kernels, is made in any case.
            trace: Keep what the search does, pass by pass, as `Solution.trace`. The answer is the same bits.
            bad: What to do where a matrix is no pose: ``"error"`` refuses the batch and names the first of them; ``"skip"``
                answers the others with the same bits, and marks these, `Status.INVALID`, their joint values NaN.

        Returns:
            Joint values inside the limits, their errors recomputed by FK, and whether these meet the
            tolerances.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: `near` does not fit the arm, an unknown preference, two of them, a preference with a
                `solver` or `trace`, a `cost` or `valid` that fails, or a clearance without a scene.
            InvalidScene: A scene of another arm, or a clearance that is no length.
            InvalidUse: Traces of more targets than fit into memory.
            InvalidSolver: The solver's parameters do not fit the arm, or `threads` is no whole number of at least 1.
        """
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        selects = prefer is not None or cost is not None or valid is not None or scene is not None
        plain = (
            solver is None
            and not prove
            and not selects
            and time_limit is None
            and not trace
            and not clearance
        )
        if plain and (axes := self._axes) is not None and (T := plain_array(goal, (4, 4))) is not None:
            # The way of one plain pose, kept short: the kernel itself refuses what is not a rigid transform. It also
            # gives up on the first that is out of reach: what that takes is compiled on the other way.
            q, index = np.empty(axes.dof), self._index or self._atlas_along(axes)
            if near is None:
                report = solve_plain(index.address, T, q)
                if report[3] >= 0:
                    if not report[4]:
                        warn_of_distance(hypot(*T[:3, 3]), axes.reach, 2)
                    return quick_solution(axes, T.tobytes(), None, q, report)
            elif (start := plain_array(near, q.shape)) is not None:
                report = solve_plain_near(index.address, T, start, q)
                if report[3] >= 0:
                    if not report[4]:
                        warn_of_distance(hypot(*T[:3, 3]), axes.reach, 2)
                    return quick_solution(axes, T.tobytes(), start, q, report)
        _require_scene(scene, clearance)
        if bad != "error" and not isinstance(goal, Goal):  # A goal has no such poses.
            options: dict[str, Any] = {
                "solver": solver,
                "threads": threads,
                "progress": progress,
                "prove": prove,
            }
            options |= {
                "prefer": prefer,
                "cost": cost,
                "valid": valid,
                "scene": scene,
                "clearance": clearance,
                "time_limit": time_limit,
                "trace": trace,
            }
            return without_invalid(
                bad, goal, near, self._mechanism, lambda T, q: self.ik(T, near=q, **options)
            )
        deadline = Deadline(time_limit)
        if prove:
            self._require_axes(_NO_PROOF)
        asked = goal if isinstance(goal, Goal) else Goal.pose(goal)
        start = None if near is None else as_joints(self._mechanism, near, "near")
        if plain and (axes := self._axes) is not None and answers_quickly(asked, start):
            quick = quick_answer(axes, self._atlas_for(axes, asked), asked, start)
            if quick is not None:
                if not quick.success:
                    warn_if_far(quick)
                return quick
        problem = Problem(self._mechanism, asked, start, time_limit=time_limit, trace=trace)
        if selects and trace:
            raise InvalidProblem(
                "prefer, cost, valid and scene choose among all branches; there is no trace of that"
            )
        if selects and solver is not None:
            raise InvalidProblem(
                "prefer, cost, valid and scene choose among all branches; they take no solver"
            )
        if selects:
            asked.require_plain(
                "prefer, cost, valid and scene choose among all branches, and these are not found of"
            )
        if scene is not None:
            from .collision.answers import free_solution

            solution = free_solution(problem, scene, clearance, prefer, cost, valid, threads, prove)
        elif selects:
            from .branches.prefer import preferred

            solution = preferred(problem, prefer, cost, valid, threads)
        else:
            search = (
                Atlas(threads=threads, progress=progress)
                if solver is None
                else with_progress(as_solver(solver), progress)
            )
            solution = search.solve(problem)
            warn_if_far(solution)
        return self._with_proofs(solution, deadline) if prove else solution

    @overload
    def branches(  # type: ignore[overload-overlap]  # Wanted: of an array without a shape neither answer is promised.
        self, goal: UnshapedGoal, **options: Unpack[BranchesOptions]
    ) -> Branches | BranchesBatch: ...
    @overload
    def branches(self, goal: OneGoal, **options: Unpack[BranchesOptions]) -> Branches: ...
    @overload
    def branches(self, goal: ManyGoals, **options: Unpack[BranchesOptions]) -> BranchesBatch: ...
    @overload
    def branches(self, goal: object, **options: Unpack[BranchesOptions]) -> Branches | BranchesBatch: ...
    def branches(
        self,
        goal: Any,
        *,
        near: Joints | None = None,
        order: Order = "mid-range",
        cost: Cost | None = None,
        valid: Valid | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        copies: bool = False,
        count: int | None = None,
        threads: int | None = None,
        prove: bool = False,
        time_limit: float | None = None,
    ) -> Branches | BranchesBatch:
        """Find every distinct answer to a goal; where the arm has joints to spare, a well-spread sample of them.

        Args:
            goal: As in `ik`: a pose, (4, 4) or (..., 4, 4), an object that carries one, or a `Goal`.
            near: Joint values, (n,) or (..., n), [rad] or [m], or by name: answers come nearest to them first.
            order: What comes first unless `near` or `cost` say it: ``"mid-range"`` (nearest to the middle of the
                ranges, each joint measured in half its range), ``"limits"`` (farthest from the limits, by the same
                measure) or ``"dexterity"`` (most manipulability, Yoshikawa 1985).
            cost: A function from joint values, (k, n), to numbers, (k,): the least comes first.
            valid: A function from joint values, (n,), to a bool: answers that it refuses are left out and counted.
            scene: What the arm may hit: answers that hit something are left out, and counted with those that were refused.
            clearance: How far apart bodies of the scene have to be [m].
            copies: Add every answer turned by full turns, as far as the limits allow. Without it no two answers are
                equal modulo 2π.
            count: How many to return at most, 1 to 100,000; 50 where the arm has joints to spare, all of them elsewhere.
            threads: Threads for a batch; every core unless given.
            prove: Prove that there is no other answer, and find what is lacking, by branch and bound; `complete` then
                says whether the proof succeeded. See docs/proof.md.
            time_limit: [s], after which no further part of the work is begun; `out_of_time` then says that answers, or
                the proof, may be lacking.

        Returns:
            The answers to one goal, every one inside the limits and within the tolerances by plain FK; for a batch a
            sequence of them. An unreachable goal has none.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: `near` does not fit the arm, an unknown order, two orders at once, or a `cost` or `valid`
                that fails; the message names q.
            InvalidSolver: `threads` is no whole number of at least 1.
        """
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        plain = (
            near is None and order == "mid-range" and cost is None and valid is None and not (copies or prove)
        )
        plain = plain and time_limit is None and scene is None and not clearance
        plain = plain and count is None
        if plain and (axes := self._axes) is not None and (T := plain_array(goal, (4, 4))) is not None:
            # The way of one plain pose, kept short: the kernel itself refuses what is not a rigid transform.
            found = self._branches.plain(axes, T)
            if found is not None:
                return found
        from .branches.find import branches_of
        from .branches.order import Selection

        _require_scene(scene, clearance)
        asked = goal if isinstance(goal, Goal) else Goal.pose(goal)
        start = None if near is None else as_joints(self._mechanism, near, "near")
        selection = Selection(order, cost, valid, copies, count, prove)
        problem = Problem(self._mechanism, asked, start, time_limit=time_limit)
        if scene is None:
            return branches_of(problem, selection, threads)
        from .collision.answers import free_branches

        return free_branches(problem, selection, scene, clearance, threads)

    @property
    def _branches(self) -> BranchIndex:
        if self._branch_index is None:
            from .branches.index import index_of

            self._branch_index = index_of(Problem(self._mechanism, Goal.pose(np.eye(4))))
        return self._branch_index

    def prove(
        self,
        goal: Any,
        *,
        gap: float | None = None,
        budget: int = 2_000_000,
        threads: int | None = None,
        time_limit: float | None = None,
    ) -> Certificate:
        """Decide by branch and bound whether any joint values inside the limits reach a goal.

        Args:
            goal: One pose, or an object that carries one, or a `Goal`.
            gap: Unless None, go on until the bounds on the least weighted error are this close, relative to
                the upper one.
            budget: Boxes of joint values to examine; 0 gives valid, wide bounds.
            threads: Threads that share the boxes; every core unless given. The certificate has the same bits.
            time_limit: [s], after which no further boxes are begun; the bounds hold as far as they are then.

        Returns:
            The verdict, a witness or the best pose found, and bounds on the error of every pose.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: A batch, a gap or budget out of its range, or an arm that is a function.
            InvalidSolver: `threads` is no whole number of at least 1.
        """
        self._require_axes(_NO_PROOF)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        from .proof.branch_and_bound import prove

        deadline = Deadline(time_limit)
        asked = goal if isinstance(goal, Goal) else Goal.pose(goal)
        problem = Problem(self._mechanism, asked, time_limit=time_limit)
        return prove(problem, gap=gap, budget=budget, threads=threads, deadline=deadline)

    def follow(
        self,
        Ts: Any,
        *,
        start: ArrayLike | None = None,
        end: ArrayLike | None = None,
        closed: bool = False,
        max_step: ArrayLike = 0.3,
        times: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        cost: Cost | None = None,
        valid: Valid | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        prove: bool = False,
        threads: int | None = None,
        progress: bool = False,
        time_limit: float | None = None,
    ) -> Motion:
        """Find one continuous motion through many poses: as few breaks as possible, then the least cost.

        Args:
            Ts: Poses, (N, 4, 4); or a `Goal` with N targets, which may leave axes free; or a row of poses or goals, an
                iterator too.
            start: Joint values to begin with, (n,), [rad] or [m]; they must reach the first pose.
            end: Joint values to end with, (n,); they must reach the last pose.
            closed: Shall the last pose lead on to the first? The full turns of a joint come back as well. If the last pose
                is the first one again, the last row is the first one to the last bit, except for full turns of joints
                without limits.
            max_step: How far each joint may go from pose to pose, one number or (n,), [rad] or [m]; more is a break.
            times: When each pose is due, (N,), [s]: no joint goes faster from pose to pose than it may, by `velocity`, or
                without it by the robot's file, see `velocity` of an arm.
            velocity: Of the joints, one number or (n,), [rad/s] or [m/s]. The cost is then the time that the motion takes.
            weights: Of each joint in the cost, (n,).
            cost: In place of distance or time, a function from joint values, (k, n), to numbers, (k,), added up over all
                poses; where joints are to spare the squared steps are added to it.
            valid: A function from joint values, (n,), to a bool, asked of the poses and of points between them.
            scene: What the arm may hit, see docs/collisions.md: poses are free in it, and so is the whole way from each to
                the next, every joint moving straight, which is proved and not sampled. Where that cannot be, there is a
                break or a missed pose, and `why` names the bodies.
            clearance: How far apart bodies of the scene have to be [m].
            prove: Try to prove of every step that one unbroken branch leads on inside the limits (`Path.certified`), of
                missed poses that they are out of reach, and where answers are isolated that no continuous motion leads on;
                with a budget for the whole path, so that some may stay undecided, see docs/paths.md.
            threads: Threads that share the poses; every core unless given. The answer has the same bits.
            progress: Show a progress bar.
            time_limit: [s], after which no further part of the work is begun: poses that were not planned by then are
                missed (`Path.planned`), those at which `cost` was not called cost 0, breaks are not planned again, and
                steps and poses stay unproved. `Path.out_of_time` says that the time was up. Poses are read from an iterator
                whatever that takes, and what an arm needs once is made in any case.

        Returns:
            Joint values inside the limits for every pose, judged by plain FK, the breaks, and what is in the way at each.

        Raises:
            InvalidGoal: Not poses, or none; the message names the first that is wrong.
            InvalidProblem: Something does not fit: `start` misses the first pose, `times` do not increase, and so on.
            InvalidScene: A scene of another arm, or a clearance that is no length.
            InvalidSolver: `threads` is no whole number of at least 1.
            PathInterrupted: An iterator raised; the error carries the path through the poses that came before.
        """
        from .paths.front import follow_poses

        deadline = Deadline(time_limit)
        _require_scene(scene, clearance)
        if scene is not None:
            from .collision.answers import judge_of

            clearance = judge_of(scene, self._mechanism, clearance, None).clearance
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        request: dict[str, Any] = {
            "start": start,
            "end": end,
            "closed": closed,
            "max_step": max_step,
            "times": times,
        }
        request |= {"velocity": velocity, "weights": weights, "cost": cost, "valid": valid}
        request |= {"scene": scene, "clearance": clearance, "deadline": deadline}
        return follow_poses(self._mechanism, Ts, request, prove, threads, progress)

    def follow_stream(
        self,
        poses: Any,
        *,
        window: int = 2000,
        look_ahead: int = 500,
        start: ArrayLike | None = None,
        max_step: ArrayLike = 0.3,
        velocity: ArrayLike | None = None,
        weights: ArrayLike | None = None,
        cost: Cost | None = None,
        valid: Valid | None = None,
        threads: int | None = None,
    ) -> Iterator[Motion]:
        """Follow poses that come one after the other, with the same memory however many they are.

        Of the poses to come no more than `look_ahead` are known when joint values are handed out. So there may be more
        breaks than with `follow`, which knows all poses.

        Args:
            poses: An iterator of poses, (4, 4), or of goals; an array (N, 4, 4) or a `Goal` with N targets, too.
            window: Poses from the beginning of one piece to that of the next.
            look_ahead: Poses beyond the end of a piece that are looked at.
            start: Joint values to begin with, (n,), [rad] or [m]; they must reach the first pose.
            max_step: How far each joint may go from pose to pose, one number or (n,), [rad] or [m]; more is a break.
            velocity: Of the joints, one number or (n,), [rad/s] or [m/s]. The cost is then the time that the motion takes.
            weights: Of each joint in the cost, (n,).
            cost: As in `follow`.
            valid: As in `follow`.
            threads: As in `follow`.

        Yields:
            Pieces of the path. Each begins with the last pose of the one before, at the same joint values: its rows but the
            first are new. `breaks` and `why` count from the beginning of the piece.

        Raises:
            InvalidGoal: No poses; or one that is none, once the pieces of all before it are handed out; its number is named.
            InvalidProblem: As `follow`.
            InvalidSolver: `window`, `look_ahead` or `threads` is no whole number, or too small.
            Exception: What the iterator raises, once the pieces of all poses before it are handed out.
        """
        from .paths.stream import stream

        window, look_ahead = as_integer("window", window, 1), as_integer("look_ahead", look_ahead, 0)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        request: dict[str, Any] = {"start": start, "end": None, "closed": False, "max_step": max_step}
        request |= {"times": None, "velocity": velocity, "weights": weights, "cost": cost, "valid": valid}
        return stream(self._mechanism, poses, window, look_ahead, request, threads)

    def track(
        self,
        q0: ArrayLike,
        period: float = 0.002,
        velocity: ArrayLike | None = None,
        recover: bool = True,
    ) -> Tracker:
        """Begin to servo from joint values: one pose in, one set of joint values out, with bounded work.

        Args:
            q0: Where the arm is, (n,), [rad] or [m]; a joint outside its limits comes back as fast as it may.
            period: Time between two steps [s].
            velocity: Of the joints, one number or (n,), [rad/s] or [m/s]; no joint ever goes faster. Those of the robot's
                file unless given; where that says nothing, nothing bounds the speed.
            recover: Go back to the pose after a time out of reach, also by another branch, see `Tracker`. It needs the
                speed of every joint. False: the arm stays on its branch until `switch` is called.

        Raises:
            InvalidProblem: Something does not fit the arm, or the arm is a function.
        """
        from .paths.tracker import Tracker

        return Tracker(self._mechanism, q0, period, velocity, recover)

    def _with_proofs(self, solution: Solution, deadline: Deadline) -> Solution:
        from .proof.branch_and_bound import prove, refuse_ranges

        refuse_ranges(solution.problem.goal)
        missed = [
            not (one.success or one.blocked or deadline.passed)
            and prove(one.problem, answer=one, deadline=deadline).verdict is Verdict.UNREACHABLE
            for one in solution.each()
        ]
        shape = solution.problem.goal.shape
        proved = np.reshape(missed, shape) if shape else bool(missed[0])
        late = solution.out_of_time
        if deadline.passed:
            late = late | ~(np.asarray(solution.success) | proved | np.asarray(solution.proved_blocked))
        return replace(solution, proved_unreachable=proved, out_of_time=late if shape else bool(late))


_NO_PROOF = "nothing can be proved without axes"


def _require_scene(scene: Scene | None, clearance: float) -> None:
    if scene is None and clearance != 0.0:
        raise InvalidProblem(
            f"a clearance is kept from what a scene holds: give scene=, got clearance={clearance!r}"
        )


def load(
    source: Any,
    base: str | None = None,
    tip: str | None = None,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> Arm:
    """Load an arm.

    Args:
        source: Name of a bundled arm (`kinseek robots` lists them); a path to a .urdf, .xacro or MJCF .xml file; the text
            of a URDF; a model of yourdfpy (``URDF``), pinocchio (``Model``) or MuJoCo (``MjModel``); or, where the package
            robot_descriptions is installed, a name of it, such as ``"panda_description"``.
        base: Link that stays; the root of the file unless given.
        tip: Link whose pose is meant; the only leaf of the file unless given.
        args: Of a .xacro file: values of its arguments, by name.
        packages: Of a .xacro file: folders of the ROS packages that it finds files in, by name.
        trusted: Of a .xacro file: False where it may be anybody's. xacro lets Python evaluate expressions of the file; then
            they are computed without it, and those that are no plain sums are refused.

    Raises:
        InvalidRobot: Unknown name, missing or broken file, unknown or unconnected links, bad joints, arguments that the file
            does not ask for.
        MissingExtra: An MJCF file, and MuJoCo is not installed.
    """
    return Arm(read(source, base, tip, args=args, packages=packages, trusted=trusted))
