"""The main class, `Arm`, and its inverse kinematics; its forward kinematics are in `kinematics`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from math import hypot
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Never, Self, TypedDict, Unpack, cast, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidProblem
from .goal import Goal
from .invalid_targets import without_invalid
from .kernels.atlas.near import solve_goal
from .kernels.atlas.one_goal import solve_plain
from .kinematics import ForwardArm
from .poses import plain_array
from .problem import Problem, as_joints
from .proof.certificate import Certificate, Verdict
from .robots import Mechanism, SerialChain, read
from .solution import Solution, Status, quick_solution
from .solvers.atlas.centres import CentralIndices, central_indices, is_central, solve_central
from .solvers.atlas.index import BRIEF, SAMPLES, AtlasIndex, atlas_of
from .solvers.atlas.quick import can_solve_quickly, solve_quickly
from .solvers.atlas.solver import Atlas
from .solvers.base import Solver
from .solvers.black_box.samples import Samples, samples_of
from .solvers.checks import as_solver, warn_if_far, with_progress
from .support.deadline import Deadline
from .support.shapes import Joints, ManyGoals, OneGoal, UnshapedGoal
from .support.units import warn_of_distance, warn_of_period
from .support.validation import as_flag, as_integer, is_finite_number
from .unknown_arguments import unknown_argument

if TYPE_CHECKING:
    from .branches.index import BranchIndex
    from .branches.order import Cost, Order, Preferred, Valid
    from .branches.result import Branches, BranchesBatch
    from .collision.scene import Scene
    from .paths.path import Path as Motion
    from .paths.tracker import Tracker
    from .robots.calibration import Calibration
    from .timing.move import Move
    from .timing.trajectory import Trajectory

Array = NDArray[np.float64]


Flags = NDArray[np.bool_]
Counts = NDArray[np.int64]
States = NDArray[np.object_]


class IkOptions(TypedDict, total=False):
    """Keyword arguments of `Arm.ik`, which documents them."""

    near: Joints | None
    solver: Solver | None
    threads: int | None
    progress: bool
    prove: bool
    prefer: Preferred | None
    cost: Cost | None
    valid: Valid | None
    scene: Scene | None
    clearance: float
    nearest: bool
    time_limit: float | None
    trace: bool
    bad: Literal["error", "skip"]


class BranchesOptions(TypedDict, total=False):
    """Keyword arguments of `Arm.branches`, which documents them."""

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

    A subclass keeps its own attributes in copies, in pickles and in the arms that `with_tool`, `with_locked` and
    `with_limits` return. These methods copy the arm and do not call ``__init__``.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Wrap the mechanism that a reader returned."""
        super().__init__(mechanism)
        self._index: AtlasIndex | None = None
        self._place_index: AtlasIndex | None = None
        self._central: CentralIndices | None = None
        self._branch_index: BranchIndex | None = None

    def __getstate__(self) -> Any:
        """Copy and pickle everything but the atlas, which is rebuilt when it is needed."""
        state = super().__getstate__()
        attributes, slots = state if isinstance(state, tuple) else (state, None)
        attributes = {
            **cast("dict[str, Any]", attributes),
            "_index": None,
            "_place_index": None,
            "_central": None,
            "_branch_index": None,
        }
        return attributes if slots is None else (attributes, slots)

    def _with(self, mechanism: Mechanism) -> Self:
        """Return a copy of this arm with another mechanism."""
        arm = super()._with(mechanism)
        arm._index = arm._place_index = arm._central = arm._branch_index = None
        return arm

    @property
    def atlas(self) -> AtlasIndex | Samples:
        """The sorted samples in which `ik` looks up poses, built at the first call.

        For black-box kinematics they are `kinseek.solvers.black_box.samples.Samples`, which reports the same figures.
        """
        return samples_of(self._mechanism, SAMPLES) if self._axes is None else self._atlas_along(self._axes)

    def _atlas_along(self, axes: SerialChain) -> AtlasIndex:
        if self._index is None:
            self._index = atlas_of(axes)
        return self._index

    def _atlas_for(self, axes: SerialChain, goal: Goal) -> AtlasIndex:
        """Return the atlas for a goal; that of goals for the tip, the most frequent case, is cached."""
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
        prefer: Preferred | None = None,
        cost: Cost | None = None,
        valid: Valid | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        nearest: bool = True,
        time_limit: float | None = None,
        trace: bool = False,
        bad: Literal["error", "skip"] = "error",
        **unknown: Never,
    ) -> Solution:
        """Find joint values that reach a goal; if none are found, return the closest that the search found.

        Args:
            goal: A pose, (4, 4) or (..., 4, 4); an object that carries one (SciPy, pinocchio, spatialmath);
                or a `Goal`.
            near: Joint values to which the solution should be close, (n,) or (..., n), [rad] or [m], or by name as in `fk`.
                They may lie outside the limits.
            solver: One of `kinseek.solvers`; by default the `Atlas`.
            threads: Number of threads for a batch with the default solver; by default every core.
            progress: Show a progress bar. The default solver shows one for a batch; another `solver` shows one if it has
                one.
            prove: Try to prove that each missed pose is out of reach, see `Arm.prove`. If the arm is not redundant, also try
                to prove that every solution of a blocked pose collides.
            prefer: Which solution to return: ``"mid-range"``, ``"limits"`` (far from them) or ``"dexterity"``, as `order` in
                `Arm.branches`. If the arm is redundant, the best one along the self-motion. Or a posture by name, such as
                ``{"elbow": "up"}`` or ``{"arm_angle": 0.5}``, see docs/postures.md: the solution with the most of these
                names; among several the one nearest to `near`, of the lowest `cost`, or else in the middle of the ranges.
            cost: Alternative to `prefer`: a function from joint values, (k, n), to costs, (k,). The solution with the lowest
                cost is returned.
            valid: A function from joint values, (n,), to a bool. It is called for one solution after the other until it
                returns True. If it never does, `success` is False, and `rejected` is the number of solutions for which it
                returned False.
            scene: The collision scene, see docs/collisions.md. The first collision-free solution in order of preference is
                returned. If the arm is redundant, the self-motion is sampled more and more densely. If every solution found
                collides, the status is `Status.BLOCKED`, and `contacts` lists the colliding pairs.
            clearance: Minimum distance between bodies of the scene [m].
            nearest: Search for the nearest pose to a goal that is missed. With False the default solver skips this
                search: the joint values of such a goal are arbitrary. Solutions of goals that are reached are the same.
            time_limit: [s], after which no further part of the work is begun. The solution is the best so far, and
                `out_of_time` reports for each target whether its search was cut short. The atlas and the compiled kernels,
                which an arm needs once, are made in any case.
            trace: Keep what the search does, pass by pass, as `Solution.trace`. The solution is identical bit for bit.
            bad: How to treat a matrix that is not a pose: ``"error"`` rejects the batch and names the first such matrix;
                ``"skip"`` marks them `Status.INVALID` with NaN joint values and solves the others, bit for bit as without
                them.

        Returns:
            Joint values inside the limits, their errors recomputed by FK, and whether the errors meet the tolerances.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: `near` does not fit the arm, an unknown preference, two of them, a preference with a
                `solver` or `trace`, a `cost` or `valid` that fails, or a clearance without a scene.
            InvalidScene: The scene belongs to another arm, the clearance is not a length, or another thread changed the
                scene during a proof.
            InvalidUse: Traces of more targets than fit into memory.
            InvalidSolver: The solver's parameters do not fit the arm, or `threads` is not an integer of at least 1.
        """
        if unknown:
            raise unknown_argument(Arm.ik, unknown)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        selects = prefer is not None or cost is not None or valid is not None or scene is not None
        plain = not (solver is not None or selects or prove or time_limit is not None or trace or clearance)
        if nearest is not True:
            nearest = as_flag("nearest", nearest, hint="; joint values to stay close to are given as near=")
        if plain and (quick := self._one_pose(goal, near, nearest)) is not None:
            return quick
        _require_scene(scene, clearance)
        if bad != "error" and not isinstance(goal, Goal):  # A goal has no invalid matrices.
            solve = partial(
                self.ik,
                solver=solver,
                threads=threads,
                progress=progress,
                prove=prove,
                prefer=prefer,
                cost=cost,
                valid=valid,
                scene=scene,
                clearance=clearance,
                nearest=nearest,
                time_limit=time_limit,
                trace=trace,
            )
            return without_invalid(bad, goal, near, self._mechanism, solve)
        deadline = Deadline(time_limit)
        if prove:
            self._require_axes(_NO_PROOF)
        requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
        start = None if near is None else as_joints(self._mechanism, near, "near")
        if plain and nearest and (quick := self._one_goal(requested, start)) is not None:
            if not quick.success:
                warn_if_far(quick)
            return quick
        problem = Problem(
            self._mechanism, requested, start, time_limit=time_limit, nearest=nearest, trace=trace
        )
        if selects:
            _require_choice(problem, solver)
            if scene is not None:
                from .collision.solutions import free_solution
                from .timing.obstacles import unchanged

                with unchanged(scene if prove else None, "ik"):
                    solution = free_solution(problem, scene, clearance, prefer, cost, valid, threads, prove)
            else:
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

    def _one_pose(self, goal: Any, near: Any, nearest: bool) -> Solution | None:
        """Solve one plain pose by the shortest way; None for anything else, and for a pose that this does not reach."""
        if (axes := self._axes) is None or (T := plain_array(goal, (4, 4))) is None:
            return None
        # The kernel itself rejects a matrix that is not a rigid transform.
        q, index, start = np.empty(axes.dof), self._index or self._atlas_along(axes), None
        origin: SerialChain | Problem = axes
        if near is not None and (start := plain_array(near, q.shape)) is None:
            return None
        if not nearest:
            origin = Problem(axes, _any_pose(), nearest=nearest)
            report = solve_goal(index.address, BRIEF, T, q if start is None else start, start is not None, q)
        elif start is None:
            report = solve_plain(index.address, T, q)
        else:
            report = solve_goal(index.address, index.plain, T, start, True, q)
        if report[3] < 0:
            return None
        if not report[4]:
            warn_of_distance(hypot(*T[:3, 3]), axes.reach, 3)
        return quick_solution(origin, T.tobytes(), start, q, report)

    def _one_goal(self, goal: Goal, near: Array | None) -> Solution | None:
        """Solve one goal without the checks that only other goals need; None for those."""
        if (axes := self._axes) is None:
            return None
        if can_solve_quickly(goal, near):
            return solve_quickly(axes, self._atlas_for(axes, goal), goal, near)
        if not is_central(goal, near):
            return None
        central = central_indices(axes, goal, last=self._central)
        self._central = central or self._central
        return solve_central(axes, goal, central)

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
        **unknown: Never,
    ) -> Branches | BranchesBatch:
        """Find every distinct solution of a goal; if the arm is redundant, a well-spread sample of the solutions.

        Args:
            goal: As in `ik`: a pose, (4, 4) or (..., 4, 4), an object that carries one, or a `Goal`.
            near: Joint values, (n,) or (..., n), [rad] or [m], or by name: solutions are sorted by their distance from them.
            order: Sort order unless `near` or `cost` is given: ``"mid-range"`` (nearest to the middle of the ranges, each
                joint measured in half its range), ``"limits"`` (farthest from the limits, by the same measure) or
                ``"dexterity"`` (highest manipulability, Yoshikawa 1985).
            cost: A function from joint values, (k, n), to costs, (k,): the lowest comes first.
            valid: A function from joint values, (n,), to a bool: solutions for which it returns False are left out and
                counted.
            scene: The collision scene: solutions that collide are left out, and counted with those that `valid` rejects.
            clearance: Minimum distance between bodies of the scene [m].
            copies: Add copies of every solution shifted by full turns, as far as the limits allow. Without it no two
                solutions are equal modulo 2π.
            count: Maximum number of solutions, 1 to 100,000. If the arm is redundant, at most 2,000, by default 50;
                otherwise the default is all.
            threads: Number of threads for a batch; by default every core.
            prove: Prove by branch and bound that there is no other solution, and find the missing ones. `complete` then
                reports whether the proof succeeded. See docs/proof.md.
            time_limit: [s], after which no further part of the work is begun; `out_of_time` then reports that solutions, or
                the proof, may be missing. Goals of a batch that the time did not suffice for have no solutions.

        Returns:
            The solutions of one goal, each inside the limits and within the tolerances by plain FK; for a batch a sequence
            of these. For an unreachable goal they are empty.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: `near` does not fit the arm, an unknown order, two orders at once, or a `cost` or `valid`
                that fails; the message names q.
            InvalidScene: As for `ik`.
            InvalidSolver: `threads` is not an integer of at least 1.
        """
        if unknown:
            raise unknown_argument(Arm.branches, unknown)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        plain = (
            near is None and order == "mid-range" and cost is None and valid is None and not (copies or prove)
        )
        plain = plain and time_limit is None and scene is None and not clearance
        plain = plain and count is None
        if plain and (axes := self._axes) is not None and (T := plain_array(goal, (4, 4))) is not None:
            # A short path for one plain pose: the kernel itself rejects a matrix that is not a rigid transform.
            found = self._branches.plain(axes, T)
            if found is not None:
                return found
        from .branches.find import branches_of
        from .branches.order import Selection

        _require_scene(scene, clearance)
        requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
        start = None if near is None else as_joints(self._mechanism, near, "near")
        selection = Selection(order, cost, valid, copies, count, prove)
        problem = Problem(self._mechanism, requested, start, time_limit=time_limit)
        if scene is None:
            return branches_of(problem, selection, threads)
        from .collision.solutions import free_branches
        from .timing.obstacles import unchanged

        with unchanged(scene if prove else None, "branches"):
            return free_branches(problem, selection, scene, clearance, threads)

    @property
    def _branches(self) -> BranchIndex:
        if self._branch_index is None:
            from .branches.index import index_of

            self._branch_index = index_of(Problem(self._mechanism, _any_pose()))
        return self._branch_index

    def prove(
        self,
        goal: Any,
        *,
        gap: float | None = None,
        budget: int = 2_000_000,
        threads: int | None = None,
        time_limit: float | None = None,
        **unknown: Never,
    ) -> Certificate:
        """Decide by branch and bound whether any joint values inside the limits reach a goal.

        Args:
            goal: One pose, or an object that carries one, or a `Goal`.
            gap: If given, continue until the bounds on the least weighted error are this close, relative to the upper one.
            budget: Maximum number of boxes of joint values to examine; 0 gives valid but wide bounds.
            threads: Number of threads that share the boxes; by default every core. The certificate does not depend on it.
            time_limit: [s], after which no further boxes are begun; the bounds computed by then are valid.

        Returns:
            The verdict, a witness or the best pose found, and bounds on the error of every pose.

        Raises:
            InvalidGoal: Not a pose.
            InvalidProblem: A batch, a gap or budget out of its range, or an arm with black-box kinematics.
            InvalidSolver: `threads` is not an integer of at least 1.
        """
        if unknown:
            raise unknown_argument(Arm.prove, unknown)
        self._require_axes(_NO_PROOF)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        from .proof.branch_and_bound import prove

        deadline = Deadline(time_limit)
        requested = goal if isinstance(goal, Goal) else Goal.pose(goal)
        problem = Problem(self._mechanism, requested, time_limit=time_limit)
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
        cost: Cost | Literal["time"] | None = None,
        acceleration: ArrayLike | None = None,
        valid: Valid | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        prove: bool = False,
        threads: int | None = None,
        progress: bool = False,
        time_limit: float | None = None,
        **unknown: Never,
    ) -> Motion:
        """Find one continuous motion through many poses: first the fewest breaks, then the lowest cost.

        Args:
            Ts: Poses, (N, 4, 4); or a `Goal` with N targets, which may leave axes free; or a sequence or iterator of poses
                or goals.
            start: Joint values at the first pose, (n,), [rad] or [m]; they must reach it.
            end: Joint values at the last pose, (n,); they must reach it.
            closed: Does the last pose lead back to the first? The full turns of each joint then return to their start, too.
                If the last pose equals the first one, the last row equals the first one bit for bit, except for full turns
                of joints without limits.
            max_step: Maximum motion of each joint from pose to pose, one number or (n,), [rad] or [m]; more is a break.
            times: Time of each pose, (N,), [s]. No joint exceeds its speed limit between poses: `velocity`, or by default
                the limit in the robot's file, see `velocity` of an arm.
            velocity: Speed limit of each joint, one number or (n,), [rad/s] or [m/s]. The cost is then the duration of the
                motion.
            weights: Weight of each joint in the cost, (n,).
            cost: A function from joint values, (k, n), to costs, (k,), summed over all poses, in place of distance or time.
                If the arm is redundant, the squared steps are added to it. Or ``"time"``: the cost is the duration of the
                motion that `Path.timed` makes within `velocity` and `acceleration`. It is never longer than that of the
                shortest path, see docs/paths.md.
            acceleration: With ``cost="time"``: limit of the acceleration of each joint, one number or (n,), [rad/s²] or
                [m/s²]; by default that of the arm.
            valid: A function from joint values, (n,), to a bool, called at the poses and at points between them.
            scene: The collision scene, see docs/collisions.md. Poses are free of collision, and so is the whole motion
                between consecutive poses, with every joint moving linearly; this is proved, not sampled. If that is
                impossible, there is a break or a missed pose, and `why` names the bodies.
            clearance: Minimum distance between bodies of the scene [m].
            prove: Try to prove of every step that one unbroken branch inside the limits connects its poses
                (`Path.certified`), and of missed poses that they are out of reach. Where solutions are isolated, try to
                prove that no continuous motion continues. There is one budget for the whole path, so some steps and poses
                may stay undecided, see docs/paths.md.
            threads: Number of threads that share the poses; by default every core. The path does not depend on it.
            progress: Show a progress bar.
            time_limit: [s], after which no further part of the work is begun. Poses that were not planned by then are missed
                (`Path.planned`), poses at which `cost` was not called cost 0, breaks are not replanned, and steps and poses
                stay unproved. `Path.out_of_time` reports that the time was up. An iterator is read to its end, and what an
                arm needs once is made, whatever time that takes.

        Returns:
            Joint values inside the limits for every pose, judged by plain FK, the breaks, and the reason for each.

        Raises:
            InvalidGoal: No poses, or an invalid one; the message names the first invalid one.
            InvalidProblem: An argument does not fit: for example, `start` misses the first pose, or `times` do not increase.
            InvalidScene: The scene belongs to another arm, or the clearance is not a length, or another thread changed it.
            InvalidSolver: `threads` is not an integer of at least 1.
            PathInterrupted: An iterator raised; the error carries the path through the poses before it.
        """
        if unknown:
            raise unknown_argument(Arm.follow, unknown)
        from .paths.follow import follow_poses

        deadline = Deadline(time_limit)
        clearance = self._clearance(scene, clearance)
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
        request |= {"acceleration": acceleration}
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
        **unknown: Never,
    ) -> Iterator[Motion]:
        """Follow a stream of poses with memory that does not depend on their number.

        When joint values are yielded, at most `look_ahead` later poses are known. So there may be more breaks than with
        `follow`, which knows all poses.

        Args:
            poses: An iterator of poses, (4, 4), or of goals; or an array (N, 4, 4), or a `Goal` with N targets.
            window: Number of poses from the beginning of one piece to the beginning of the next.
            look_ahead: Number of poses beyond the end of a piece that are considered.
            start: Joint values at the first pose, (n,), [rad] or [m]; they must reach it.
            max_step: Maximum motion of each joint from pose to pose, one number or (n,), [rad] or [m]; more is a break.
            velocity: Speed limit of each joint, one number or (n,), [rad/s] or [m/s]. The cost is then the duration of the
                motion.
            weights: Weight of each joint in the cost, (n,).
            cost: As in `follow`.
            valid: As in `follow`.
            threads: As in `follow`.

        Yields:
            Pieces of the path. Each begins with the last pose of the previous piece, at the same joint values; all rows but
            the first are new. `breaks` and `why` count from the beginning of the piece.

        Raises:
            InvalidGoal: No poses; or an invalid pose, named by its number, after the pieces of all poses before it.
            InvalidProblem: As `follow`.
            InvalidSolver: `window`, `look_ahead` or `threads` is not an integer, or is too small.
            Exception: Any error that the iterator raises, after the pieces of all poses before it.
        """
        if unknown:
            raise unknown_argument(Arm.follow_stream, unknown)
        from .paths.stream import stream

        window, look_ahead = as_integer("window", window, 1), as_integer("look_ahead", look_ahead, 0)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        request: dict[str, Any] = {"start": start, "end": None, "closed": False, "max_step": max_step}
        request |= {"times": None, "velocity": velocity, "weights": weights, "cost": cost, "valid": valid}
        return stream(self._mechanism, poses, window, look_ahead, request, threads)

    def move(
        self,
        q0: Joints,
        goal: Any,
        velocity: ArrayLike | None = None,
        acceleration: ArrayLike | None = None,
        jerk: ArrayLike | None = None,
        *,
        scene: Scene | None = None,
        clearance: float = 0.0,
        time_limit: float | None = None,
        **unknown: Never,
    ) -> Trajectory:
        """Move from joint values to a goal in the shortest time, from rest to rest, each joint inside its limits.

        All joints begin and end at the same time; the tip does not move on a straight line. Of all solutions of the goal,
        with all full turns, the one with the shortest motion is the end; if the arm is redundant, the best that is found
        along the self-motion. Needs Ruckig: ``pip install 'kinseek[motion]'``.

        Args:
            q0: Joint values at the start, (n,), [rad] or [m], or by name as in `fk`.
            goal: Joint values, (n,) or by name; they are reached with the full turns that are given. Or a pose, (4, 4), an
                object that carries one, or a `Goal`.
            velocity: Speed limit of each joint, one number or (n,), [rad/s] or [m/s]; by default that of the arm.
            acceleration: Limit of the acceleration of each joint, one number or (n,), [rad/s²] or [m/s²]; by default that of
                the arm.
            jerk: Limit of the jerk of each joint, one number or (n,), [rad/s³] or [m/s³]; None for no limit.
            scene: The collision scene, see docs/collisions.md. The solutions of the goal are tried with all full turns, in
                order of duration, until a motion is proved free as a whole.
            clearance: Minimum distance between bodies of the scene [m].
            time_limit: [s], after which no further motion is tried. One is tried in any case.

        Returns:
            The motion in time. `pose_times` are those of its begin and its end.

        Raises:
            NotReached: No solution of the goal is found, or none is free of collision; the error carries the closest one.
            InvalidGoal: Not a pose.
            InvalidProblem: Joint values that are not n finite numbers inside the limits, more than one goal, a limit that is
                not a finite number above 0 or that the arm does not have, or no motion is proved free.
            InvalidScene: The scene belongs to another arm, the clearance is not a length, or another thread changed the
                scene during the call.
            MissingExtra: Ruckig is not installed.
        """
        if unknown:
            raise unknown_argument(Arm.move, unknown)
        from .timing.limits import read_limits
        from .timing.move import Move, fastest_free, inside_limits, read_end
        from .timing.obstacles import unchanged

        deadline = Deadline(time_limit)
        clearance = self._clearance(scene, clearance)
        begin = inside_limits(self._mechanism, q0, "q0")
        limits = read_limits(self._mechanism, velocity, acceleration, jerk)
        move = Move(self._mechanism, begin, limits, scene, clearance)
        end = read_end(self._mechanism, goal)
        with unchanged(scene, "move"):
            if not isinstance(end, Goal):
                return fastest_free(move, end[None], deadline)
            ends = self._ends(move, end, scene, deadline)
            return fastest_free(move._replace(tool=end.tool), ends, deadline)

    def _clearance(self, scene: Scene | None, clearance: float) -> float:
        """Read the clearance in a scene [m].

        Raises:
            InvalidProblem: A clearance without a scene.
            InvalidScene: The scene belongs to another arm, or the clearance is not a length.
        """
        _require_scene(scene, clearance)
        if scene is None:
            return clearance
        from .collision.solutions import judge_of

        return judge_of(scene, self._mechanism, clearance, None).clearance

    def _ends(self, move: Move, goal: Goal, scene: Scene | None, deadline: Deadline) -> Array:
        """Return the solutions of a goal to which the arm may move, (k, n): the best, and in a scene all others too.

        Raises:
            NotReached: There are none.
        """
        near: IkOptions = {"scene": scene, "clearance": move.clearance, "time_limit": deadline.left}
        least: IkOptions = {**near, "cost": move.cost}
        near["near"] = move.begin
        found = self.ik(goal, **near)
        if self._axes is not None:
            cheapest = self.ik(goal, **least)
            # The search for the least cost begins at samples, and may overlook a solution beside the begin.
            costs = move.cost(np.stack([found.q, cheapest.q]))
            if not found.success or (cheapest.success and 1.01 * costs[0] >= costs[1]):
                found = cheapest
        best = np.asarray(found.require().q)[None]
        if scene is None:
            return move.nearest(best)
        others: BranchesOptions = {"scene": scene, "clearance": move.clearance, "time_limit": deadline.left}
        others |= {"cost": move.cost, "copies": True}
        return move.both_ways(np.concatenate([best, self.branches(goal, **others).q]))

    def track(
        self,
        q0: ArrayLike,
        period: float = 0.002,
        velocity: ArrayLike | None = None,
        recover: bool = True,
        goal: Goal | None = None,
        *,
        acceleration: ArrayLike | None = None,
        jerk: ArrayLike | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
        prefer: Preferred | ArrayLike | None = None,
        prefer_speed: float = 0.2,
        **unknown: Never,
    ) -> Tracker:
        """Start servoing from joint values, at rest: each step takes one target and returns joint values, with bounded work.

        After every step the joints can brake to rest within all limits and, with a scene, without touching anything that
        rests (*Berscheid & Kröger 2021* for limits; Lipschitz bounds of distances for the scene).

        Args:
            q0: Current joint values, (n,), [rad] or [m]. A joint outside its limits returns as fast as it may.
            period: Time between two steps [s].
            velocity: Speed limit of each joint, one number or (n,), [rad/s] or [m/s], never exceeded. By default the limits
                in the robot's file; a joint without one is not limited in speed.
            recover: Return to the pose after a time out of reach, if necessary on another branch, see `Tracker`. This needs
                the speed limit of every joint. False: the arm stays on its branch until `switch` is called.
            goal: What counts of each pose: a goal whose target every step replaces, such as
                ``Goal.pose(np.eye(4), free="rz", cone=0.17, tool=gripper)``. By default the whole pose of the tip.
            acceleration: Limit of the acceleration of each joint, as `velocity`, [rad/s²] or [m/s²].
            jerk: Limit of the jerk of each joint, as `velocity`, [rad/s³] or [m/s³].
            scene: The collision scene, see docs/collisions.md. The arm stops before it touches anything.
            clearance: Minimum distance between bodies of the scene [m].
            prefer: Where a redundant arm moves its joints while its hand follows the target: ``"mid-range"``, ``"limits"``
                (away from them), ``"dexterity"``, ``{"arm_angle": angle}``, or joint values, (n,).
            prefer_speed: Largest velocity of a joint for that [rad/s] or [m/s].

        Raises:
            InvalidProblem: An argument does not fit the arm, the arm has black-box kinematics, or q0 is in collision.
            InvalidScene: The scene belongs to another arm, or the clearance is not a length.
        """
        if unknown:
            raise unknown_argument(Arm.track, unknown)
        from .paths.drift import DriftOptions
        from .paths.limited import Around
        from .paths.tracker import Tracker

        tracker = Tracker(
            self._mechanism,
            q0,
            period,
            (velocity, acceleration, jerk),
            recover,
            goal,
            Around(scene, self._clearance(scene, clearance)),
            DriftOptions(prefer, prefer_speed),
        )
        warn_of_period(tracker.period, 2)
        return tracker

    def _with_proofs(self, solution: Solution, deadline: Deadline) -> Solution:
        from .proof.branch_and_bound import prove

        shape = solution.problem.goal.shape
        missed = np.atleast_1d(~(np.asarray(solution.success) | (np.asarray(solution.blocked) > 0)))
        unreachable = np.zeros(missed.shape, dtype=np.bool_)
        for i in np.ndindex(missed.shape):
            if deadline.passed:
                break
            if missed[i]:
                one = solution[i] if shape else solution
                verdict = prove(one.problem, solution=one, deadline=deadline).verdict
                unreachable[i] = verdict is Verdict.UNREACHABLE
        proved = unreachable if shape else bool(unreachable[0])
        late = solution.out_of_time
        if deadline.passed:
            late = late | ~(np.asarray(solution.success) | proved | np.asarray(solution.proved_blocked))
        return replace(solution, proved_unreachable=proved, out_of_time=late if shape else bool(late))


@cache
def _any_pose() -> Goal:
    return Goal.pose(np.eye(4))


_NO_PROOF = "nothing can be proved without axes"


def _require_choice(problem: Problem, solver: Solver | None) -> None:
    """Reject what cannot be combined with a choice among all branches."""
    if problem.trace:
        raise InvalidProblem(
            "trace=True cannot be combined with prefer=, cost=, valid= or scene=: these choose among all "
            "branches, a search that records no trace"
        )
    if solver is not None:
        raise InvalidProblem(
            "solver= cannot be combined with prefer=, cost=, valid= or scene=: these choose among all branches"
        )


def _require_scene(scene: Scene | None, clearance: float) -> None:
    if scene is None and not (is_finite_number(clearance) and clearance == 0):
        raise InvalidProblem(f"clearance= needs a scene: give scene=, got clearance={clearance!r}")


def load(
    source: Any,
    base: str | None = None,
    tip: str | None = None,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
    calibration: Calibration | None = None,
    srdf: str | Path | bytes | None = None,
    group: str | None = None,
    limits: Mapping[str, tuple[float, float]] | str | Path | None = None,
    **unknown: Never,
) -> Arm:
    """Load an arm.

    Args:
        source: Name of a bundled arm (`kinseek robots` lists them); a path to a .urdf, .xacro or MJCF .xml file; the text of
            a URDF; a model of yourdfpy (``URDF``), pinocchio (``Model``) or MuJoCo (``MjModel``); or, if the package
            robot_descriptions is installed, a name of one of its descriptions, such as ``"panda_description"``.
        base: Link in which poses are given; by default that of the `group`, or the root of the file.
        tip: Link whose pose is controlled; by default that of the `group`, or the only leaf of the file. Any two links can
            be base and tip: the chain goes up from the base to their common ancestor and then down.
        args: For a .xacro file: values of its arguments, by name.
        packages: For a .xacro file: folders of the ROS packages in which it finds files, by name.
        trusted: For a .xacro file: pass False if its origin is not trusted. xacro lets Python evaluate the expressions of a
            file; with False kinseek evaluates them itself, and rejects expressions other than arithmetic, comparisons and a
            list of functions.
        calibration: Measured origins of joints, which replace those of a URDF: a calibration file of a Universal Robots arm,
            as ur_calibration writes it; or a mapping from joints, or from the links that they move, to poses in the link
            before, (4, 4), lengths in [m]. Joints that it does not name keep their origins. See docs/calibrated.md.
        srdf: For a URDF: the SRDF file of the robot, .srdf or .xacro, or its text. `Arm.states` has its named joint values,
            and `Scene.of` does not check the pairs that it disables.
        group: Name of the group of the SRDF that is the arm. It must be one serial chain.
        limits: Lower and upper limits of joints by name, [rad] or [m]: those of the slides of planar and floating joints of
            a URDF, such as ``{"base/x": (-2, 2), "base/y": (-2, 2)}`` (docs/arms.md), and narrower ones of other joints. Or,
            for a URDF, the path of a joint_limits.yaml of MoveIt, whose limits of positions, velocity, acceleration and jerk
            replace those of the URDF; wider ones raise a `LimitWarning`. See docs/limits.md.

    Raises:
        InvalidRobot: Unknown name, missing or broken file, unknown links, bad joints, arguments that the
            file does not declare, a calibration or limits that do not fit, or a group that is not one serial chain.
        MissingExtra: MuJoCo is not installed, and the source is an MJCF file.
    """
    if unknown:
        raise unknown_argument(load, unknown)
    mechanism = read(
        source,
        base,
        tip,
        args=args,
        packages=packages,
        trusted=trusted,
        calibration=calibration,
        srdf=srdf,
        group=group,
        limits=limits,
    )
    return Arm(mechanism)
