"""Solutions and proofs for one person's goal, independent of the page."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.collision import Scene
from kinseek.collision.pairs import Contact
from kinseek.errors import KinseekError, NotReached
from kinseek.goal import Goal
from kinseek.paths.tracker import Tracker
from kinseek.problem import Problem
from kinseek.proof.certificate import Certificate, Verdict
from kinseek.solution import Solution, Status, conclude
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN
from kinseek.support.units import FAR
from kinseek.timing.trajectory import Trajectory
from kinseek.trace import Trace

from .options import ViewerOptions, first_selection
from .searches import DEFAULT, make_search, needs_start, takes_seconds

Array = NDArray[np.float64]

PATIENCE = 2.0
"""Maximum time of a search for one goal [s], except for the default search, which takes microseconds."""

PROOF_PATIENCE = 20.0
"""Time after which a proof ends with its current bounds [s]."""

PLAN_PATIENCE = 5.0
"""Time after which the planning of a motion ends [s]."""

CURVE_POINTS = 400
"""Number of places of the tip through which the line of a motion is drawn."""

MOMENT, MOST_PIECES = 0.005, 50
"""Time between the moments at which a motion is checked [s], and the maximum number of them for each of those places."""
NAMING = 2.0
"""Time for naming the bodies that are hit on the ways between two moments, which are taken in any order [s]."""
OTHERS = "perhaps others for a short time"
"""In place of further names if that was too short."""

POSTURES = 9
"""Number of postures that are drawn along a motion."""

FIRST_BOXES = 100_000
"""Number of boxes, some tenths of a second, with which a proof decides whether any pose reaches the goal."""

GAPS = (0.2, 0.05, 0.01)
"""Relative gaps of the bounds on the least error to which the proof then continues."""

SERVO_PERIOD = 0.002
"""Period of a tracker [s]."""

SERVO_SPEED = 1.0
"""Speed limit of a joint while servoing and in planned motions, if the robot's file gives none [rad/s] or [m/s]."""

_PROVED = (Status.PROVED_BLOCKED, Status.PROVED_UNREACHABLE)

BEGINNINGS = 64
"""Number of poses from which the initial one is chosen."""


@dataclass(frozen=True, eq=False)
class GoalResult:
    """The result for one goal."""

    options: ViewerOptions
    """The options that were used."""
    q: Array
    """Joint values to show, (n,), [rad] or [m]."""
    solution: Solution | None = None
    """None if the goal was rejected."""
    seconds: float = 0.0
    """Wall-clock time of the search [s]."""
    refused: str = ""
    """Why the goal was rejected."""
    near: Array | None = None
    """What the search was to stay near to, or where it began, (n,)."""
    call: str = ""
    """The same call in Python, with this array as q."""
    collides: bool = False
    """Does a solution hit something, although it was chosen by a person, or by a search that does not know the scene?"""

    @property
    def reached(self) -> bool:
        """Are both tolerances met?"""
        return self.solution is not None and bool(self.solution.success)

    @property
    def blocked(self) -> bool:
        """Does every solution found hit something?"""
        return self.solution is not None and self.solution.status in (Status.BLOCKED, Status.PROVED_BLOCKED)

    @property
    def status(self) -> str:
        """The sentence to show."""
        return self.refused if self.solution is None else str(self.solution.status)

    @property
    def trace(self) -> Trace | None:
        """The trace of the search, if it has one."""
        trace = None if self.solution is None else self.solution._trace
        return trace if isinstance(trace, Trace) else None


class Posture(NamedTuple):
    """The arm at joint values, as it is drawn."""

    q: Array
    """Joint values, (n,)."""
    tip: Array
    """Pose of the tip, (4, 4)."""
    contacts: tuple[Contact, ...]
    """What touches, or comes too near."""


@dataclass(frozen=True)
class Proof:
    """What is proved about a missed goal."""

    certificate: Certificate | None = None
    """Certificate of the goal."""
    place: Certificate | None = None
    """Certificate of its position alone, with any orientation: its errors are in metres."""
    refused: str = ""
    """Why nothing can be proved."""
    call: str = ""
    """The Python call that finds the pose of the certificate; empty if the time was up."""

    @property
    def unreachable(self) -> bool:
        """Is it proved that nothing reaches the goal?"""
        return self.certificate is not None and self.certificate.verdict is Verdict.UNREACHABLE

    def sentences(self) -> list[str]:
        """The proved statements as sentences."""
        if self.certificate is None:
            return [self.refused] if self.refused else []
        lower, upper = self.certificate.lower_bound, self.certificate.upper_bound
        found, said = self.certificate, []
        if found.verdict is Verdict.REACHABLE:
            return ["Proved reachable: other joint values meet both tolerances."]
        if found.verdict is Verdict.UNDECIDED:  # The status reports unreachable goals.
            said.append(str(found.verdict))
        goal = found.problem.goal
        if goal.form.columns == 0:
            lower, upper = lower / goal.position_weight, upper / goal.position_weight
            said.append(
                f"Proved: the tip stays at least {lower:.4g} m away. The nearest pose found is {upper:.4g} m away."
            )
        else:
            said.append(
                f"Proved: every pose has a weighted error of at least {lower:.4g}. The nearest pose found has {upper:.4g}: "
                f"{found.position_error:.4g} m and {found.orientation_error:.4g} rad."
            )
        if self.place is not None and self.place.verdict is Verdict.UNREACHABLE:
            said.append(
                f"Proved: whatever its orientation, the tip stays at least {self.place.lower_bound:.4g} m away."
            )
        said.append(f"{found.boxes:,} boxes examined." + (" The time was up." if found.out_of_time else ""))
        return said


class Swept(NamedTuple):
    """What a motion passes."""

    places: Array
    """Places of the tip, (k, 3) [m]."""
    free: NDArray[np.bool_]
    """Whether the arm is free of collision from each place to the next, (k - 1,)."""
    q: Array
    """Some joint values on the way, (l, n), [rad] or [m]."""
    hit: tuple[str, ...]
    """Names of the bodies that touch, or come too near, and `OTHERS` if not all of them are known."""


@dataclass(frozen=True)
class Planned:
    """A motion to a goal, or the reason why there is none."""

    said: str
    """The sentence to show."""
    news: str
    """Its kind, as of `status_of`."""
    motion: Trajectory | None = None


class Until(Deadline):
    """A deadline that also passes when a function says so."""

    def __init__(self, stopped: Callable[[], bool], time_limit: float | None = None) -> None:
        """Start the time limit now.

        Args:
            stopped: Returns whether the work is no longer needed.
            time_limit: [s]; None sets no limit.
        """
        super().__init__(time_limit)
        self._stopped = stopped

    @property
    def passed(self) -> bool:
        """Is the time up, or the work no longer needed?"""
        return self._stopped() or super().passed


class Session:
    """Solutions of an arm for one person; all other state between two calls is in `ViewerOptions`."""

    def __init__(self, arm: Arm, scene: Scene | None = None, clearance: float = 0.0) -> None:
        """Take an arm with its scene, and compute what it needs once, so that no drag waits for it."""
        self.arm, self.clearance = arm, clearance
        self.scene = None if scene is None else scene._of(arm.chain)
        """Bodies that solutions avoid. It is replaced, and never changed, so that threads may work with the one before."""
        q = beginning(arm, lambda q: self.scene is None or self.scene.free(q, clearance))
        self.begin = first_selection(arm.mechanism, q, arm.fk(q))
        # A bare pose takes a shortcut through `ik` and a `Goal` does not; the first call of each is slow.
        for goal in (self.begin.target, self.begin.goal):
            arm.ik(goal, near=q)
        self.branches(self.begin)

    def visit(self) -> Self:
        """Return the session of one person, whose changes of the scene are their own."""
        return copy.copy(self)

    def edited(self, change: Callable[[Scene], object]) -> Scene:
        """Return a changed copy of the scene.

        Raises:
            KinseekError: As `change`.
        """
        assert self.scene is not None
        scene = copy.copy(self.scene)
        change(scene)
        return scene

    def posture(self, q: Array) -> Posture:
        """Return what is to be drawn at joint values, (n,).

        FK, or the first check after a change of the scene, may take long.
        """
        return Posture(q, self.arm.fk(q), self.contacts(q))

    def contacts(self, q: Array) -> tuple[Contact, ...]:
        """Return what touches, or comes too near, at joint values, (n,)."""
        if self.scene is None or self.scene.free(q, self.clearance):
            return ()
        return self.scene.hits(q, self.clearance)

    def solve(self, options: ViewerOptions) -> GoalResult:
        """Solve a goal by the chosen search. If the goal is rejected, the result says why, and the arm does not move."""
        call = call_of(options, self.scene is not None, self.clearance)
        if far := self._far(options):
            return GoalResult(options, options.q, refused=far, call=call)
        try:
            goal, search = self._goal(options), make_search(options.search, options.parameters)
            near = options.q if options.follow or needs_start(options.search) else None
            extra = self._around()
            if takes_seconds(options.search):
                extra = {"solver": search, "time_limit": PATIENCE, "trace": True}
            began = time.perf_counter()
            solution = self.arm.ik(goal, near=near, **extra)
            seconds = time.perf_counter() - began
        except KinseekError as error:
            return GoalResult(options, options.q, refused=str(error), call=call)
        hits = takes_seconds(options.search) and len(self.contacts(solution.q)) > 0
        return GoalResult(
            options.but(q=solution.q), solution.q, solution, seconds, near=near, call=call, collides=hits
        )

    def _around(self) -> dict[str, Any]:
        """Return the arguments of `Arm.ik` for a scene: a redundant arm may take long to find a free solution."""
        if self.scene is None:
            return {}
        return {"scene": self.scene, "clearance": self.clearance, "time_limit": PATIENCE}

    def blocked(self, result: GoalResult) -> GoalResult:
        """Try to prove that every solution of a blocked goal hits something."""
        near = result.options.q if result.options.follow else None
        solution = self.arm.ik(self._goal(result.options), near=near, prove=True, **self._around())
        call = call_of(result.options, scene=True, clearance=self.clearance, prove=True)
        options = result.options.but(q=solution.q)
        return replace(result, options=options, q=solution.q, solution=solution, near=near, call=call)

    def nearer(self, result: GoalResult, proof: Proof) -> GoalResult:
        """Return the result with the pose that a proof found, which is nearer than that of the search."""
        assert result.solution is not None
        assert proof.certificate is not None
        q, work = proof.certificate.q, np.array([[int(result.solution.evaluations), 0, 0]])
        solution = conclude(result.solution.problem, q[None], work)
        options = result.options.but(q=q)
        return replace(result, options=options, q=q, solution=solution, call=proof.call)

    def _far(self, options: ViewerOptions) -> str:
        """Return a message for a goal so far away that its units may be wrong: `Arm.ik` would warn."""
        far = float(np.linalg.norm(options.target[:3, 3]))
        if self.arm.axes is None or far <= FAR * self.arm.axes.reach:
            return ""
        return (
            f"The goal is {far:.4g} m from the base, but the arm reaches {self.arm.axes.reach:.3g} m at most: lengths "
            "are in metres."
        )

    def traced(self, result: GoalResult) -> Trace | None:
        """Return the trace of the default search for a goal; other searches return their trace with the solution.

        In a scene all branches are solved, which records no passes.
        """
        if self._far(result.options) or self.scene is not None or result.options.search != DEFAULT:
            return None
        try:
            trace = self.arm.ik(self._goal(result.options), near=result.near, trace=True).trace
        except KinseekError:
            return None
        return trace if isinstance(trace, Trace) else None

    def branches(self, options: ViewerOptions) -> Branches | str:
        """Return every solution, or the reason why there are none to show."""
        if far := self._far(options):
            return far
        try:
            found = self.arm.branches(self._goal(options), time_limit=PATIENCE)
        except KinseekError as error:
            return str(error)
        assert isinstance(found, Branches)
        return found

    def picked(self, options: ViewerOptions, q: Array) -> GoalResult:
        """Show one of the known solutions, (n,). If the goal has changed since, the result says so."""
        if far := self._far(options):
            return GoalResult(options, options.q, refused=far)
        try:
            solution = self.arm.ik(self._goal(options), near=q)
        except KinseekError as error:  # The goal has changed since.
            return GoalResult(options, options.q, refused=str(error))
        call = f"arm.ik({_goal_in_python(options)}, near=q)"
        hits = len(self.contacts(solution.q)) > 0
        return GoalResult(options.but(q=solution.q), solution.q, solution, near=q, call=call, collides=hits)

    def proofs(
        self, options: ViewerOptions, stopped: Callable[[], bool], threads: int | None = 1
    ) -> Iterator[Proof]:
        """Prove bounds on the least error of a missed goal: first whether any pose reaches it, then ever closer bounds.

        Args:
            options: The options that were used.
            stopped: Returns whether the proof is no longer needed; called between chunks of some hundredths of a second.
            threads: Number of threads that share the boxes.
        """
        from kinseek.proof.branch_and_bound import prove

        if self.arm.axes is None:
            yield Proof(refused="Nothing can be proved about an arm with black-box kinematics.")
            return
        until, place, goal = Until(stopped, PROOF_PATIENCE), None, _goal_in_python(options)
        try:
            problem = Problem(self.arm.mechanism, options.goal)
            best = prove(problem, budget=FIRST_BOXES, threads=threads, deadline=until)
            call = "" if until.passed else f"arm.prove({goal}, budget={FIRST_BOXES}).q"
            yield Proof(best, call=call)
            if best.verdict is Verdict.REACHABLE or until.passed:
                return
            if problem.goal.form.columns and not {"x", "y", "z"} & set(options.free):
                spot = Problem(self.arm.mechanism, Goal.position(options.target[:3, 3]))
                place = prove(spot, gap=GAPS[-1], budget=FIRST_BOXES, threads=threads, deadline=until)
            for gap in GAPS:
                known = prove(problem, gap=gap, threads=threads, deadline=until)
                # A proof that ran out of time may have the weaker bound.
                if known.lower_bound >= best.lower_bound:
                    best, call = known, "" if until.passed else f"arm.prove({goal}, gap={gap}).q"
                yield Proof(best, place, call=call)
                if best.verdict is Verdict.REACHABLE or until.passed:
                    return
        except KinseekError as error:
            yield Proof(refused=str(error))

    def track(self, options: ViewerOptions, limits: Mapping[str, float]) -> Tracker:
        """Return a tracker for goals with these options that starts where the arm is shown, at rest.

        Args:
            options: The options; the target is that of a later step.
            limits: Of ``"acceleration"`` [rad/s²] or [m/s²] and ``"jerk"`` [rad/s³] or [m/s³], the same for all joints.

        Raises:
            InvalidGoal: Every axis is free.
        """
        return self.arm.track(
            options.q,
            SERVO_PERIOD,
            self._speeds,
            goal=options.goal if options.free else None,
            acceleration=limits["acceleration"],
            jerk=limits["jerk"],
            scene=self.scene,
            clearance=self.clearance,
        )

    def plan(
        self, options: ViewerOptions, start: Array, acceleration: float, stopped: Callable[[], bool]
    ) -> Planned:
        """Plan a motion around the bodies of the scene, from joint values to a goal, as `Scene.plan` does.

        Args:
            options: Options with the goal.
            start: Joint values at the start, (n,), [rad] or [m].
            acceleration: Limit of all joints [rad/s²] or [m/s²].
            stopped: Returns whether the plan is no longer needed.
        """
        from kinseek.collision.ends import free_begin, free_ends
        from kinseek.planning.plan import plan

        scene, least, until = self.scene, self.clearance, Until(stopped, PLAN_PATIENCE)
        assert scene is not None
        try:
            q0 = free_begin(scene, start, least)
            ends = free_ends(scene, q0, self._goal(options), least, until)
            path = plan(self.arm.chain, scene, q0, ends, smooth=True, clearance=least, deadline=until)
            if not path.success:
                why = path.why[0].partition(": ")[2]
                return Planned(f"{why[0].upper()}{why[1:]}.", "open")
            seconds = time.monotonic() - until.begin
            motion = path.timed(self._speeds, acceleration)
        except NotReached as error:
            solution = error.solution
            proved = isinstance(solution, Solution) and solution.status in _PROVED
            return Planned(f"No motion. {error}", "bad" if proved else "open")
        except KinseekError as error:
            return Planned(str(error), "refused")
        if motion.duration == 0.0:
            return Planned("The arm is at the goal: move the goal.", "good")
        return Planned(
            f"A motion of {motion.duration:.2f} s, proved free, planned in {seconds * 1e3:.0f} ms.",
            "good",
            motion,
        )

    def swept(
        self, motion: Trajectory, proved: bool = False, stopped: Callable[[], bool] = lambda: False
    ) -> Swept:
        """Return what a motion passes, evenly in time; one that is proved to be free is not checked."""
        pieces = int(np.clip(np.ceil(motion.duration / MOMENT / (CURVE_POINTS - 1)), 1, MOST_PIECES))
        q = motion.q(np.linspace(0.0, motion.duration, (CURVE_POINTS - 1) * pieces + 1))
        hits, hit, others = np.zeros(len(q) - 1, dtype=np.bool_), set[str](), False
        if self.scene is not None and not proved:
            # The straight ways between moments, since a thin body is passed between two of them.
            hits = ~np.asarray(self.scene.free_motion(q[:-1], q[1:], self.clearance, thorough=False))
            began = time.monotonic()
            for i in np.random.default_rng(0).permutation(np.flatnonzero(hits)):
                if others := stopped() or time.monotonic() - began > NAMING:
                    break
                found = self.scene.hits_between(q[i], q[i + 1], self.clearance)
                hits[i] = len(found) > 0
                hit |= {name for one in found for name in (one.a, one.b)}
        free, q = np.logical_not(hits.reshape(-1, pieces).max(axis=1)), q[::pieces]
        shown = np.linspace(0, len(q) - 1, POSTURES).round().astype(int)
        return Swept(
            self.arm.fk(q)[:, :3, 3], free, q[shown], (*sorted(hit), *([OTHERS] if others and hit else []))
        )

    @property
    def _speeds(self) -> Array:
        """Speed limits of the joints, (n,), [rad/s] or [m/s]."""
        return np.where(np.isnan(self.arm.velocity), SERVO_SPEED, self.arm.velocity)

    def _goal(self, options: ViewerOptions) -> Any:
        """Return the goal, or a bare pose if possible, which is the fastest to solve."""
        return options.goal if options.free else options.target


def beginning(arm: Arm, free: Callable[[Array], Any] = lambda q: True) -> Array:
    """Return initial joint values, (n,): the most dexterous of a sample, if possible free and well above the ground."""
    q = arm.sample(BEGINNINGS)
    poses = arm.fk(q)
    there = np.isfinite(poses).all(axis=(1, 2))
    there = there & free(q) if (there & free(q)).any() else there
    if arm.axes is None:
        return np.asarray(q[int(np.argmax(there))])
    height = poses[:, 2, 3]
    score = np.asarray(arm.manipulability(q)) * np.where(height >= np.median(height[there]), 1.0, 1e-3)
    return np.asarray(q[int(np.argmax(np.where(there, score, -1.0)))])


def nearest_of(branches: Branches, q: Array) -> int:
    """Return the index of the solution nearest to q, (n,), ignoring full turns of revolute joints; -1 if there is none."""
    if not len(branches):
        return -1
    apart = branches.q - q
    turns = branches.problem.mechanism.turns
    apart = np.where(turns, apart - TURN * np.rint(apart / TURN), apart)
    return int(np.argmin(np.linalg.norm(apart, axis=1)))


def status_of(result: GoalResult, proof: Proof | None) -> tuple[str, str]:
    """Return the sentence to show and its kind: ``"good"``, ``"bad"``, ``"open"`` or ``"refused"``."""
    if result.refused:
        return result.refused, "refused"
    if result.collides and result.reached:
        return "This solution reaches the goal, but collides.", "bad"
    if result.reached:
        return result.status, "good"
    if result.solution is not None and result.solution.status is Status.PROVED_BLOCKED:
        return result.status, "bad"
    if proof is not None and proof.unreachable:
        return str(Status.PROVED_UNREACHABLE), "bad"
    return result.status, "open"


def call_of(options: ViewerOptions, scene: bool = False, clearance: float = 0.0, prove: bool = False) -> str:
    """Return the Python call with the same goal and options, in a scene or without one."""
    goal = _goal_in_python(options)
    near = ", near=q" if options.follow or needs_start(options.search) else ""
    limit = f", time_limit={PATIENCE:g}"
    if options.search == DEFAULT:
        around = f", scene=scene{f', clearance={clearance!r}' if clearance else ''}{limit}" if scene else ""
        return f"arm.ik({goal}{near}{around}{', prove=True' if prove else ''})"
    try:
        solver: object = make_search(options.search, options.parameters)
    except KinseekError:
        return ""
    given = {name: getattr(solver, name) for name in options.parameters}
    words = ", ".join(f"{name}={value!r}" for name, value in given.items())
    return f"arm.ik({goal}{near}, solver=kinseek.{options.search}({words}){limit})"


def _goal_in_python(options: ViewerOptions) -> str:
    return f"kinseek.Goal.pose(T, free={list(options.free)})" if options.free else "T"
