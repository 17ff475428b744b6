"""One person's goal, answered: what a page shows, without the page."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.deadline import Deadline
from kinseek.errors import KinseekError
from kinseek.goal import Goal
from kinseek.problem import Problem
from kinseek.proof.certificate import Certificate, Verdict
from kinseek.solution import Solution, Status
from kinseek.trace import Trace
from kinseek.turns import TURN
from kinseek.units import FAR

from .options import ViewerOptions, first_selection
from .searches import DEFAULT, make_search, needs_start, takes_seconds

Array = NDArray[np.float64]

PATIENCE = 2.0
"""[s] that a search may take for one goal, the default apart, which takes microseconds."""

PROOF_PATIENCE = 20.0
"""[s] after which a proof ends with what is known."""

FIRST_LOOK = 100_000
"""Boxes that a proof looks at, some tenths of a second, to decide whether any pose reaches the goal."""

GAPS = (0.2, 0.05, 0.01)
"""After that it goes on until it knows the least error to within these parts of it."""

BEGINNINGS = 64
"""Poses looked at for the one to begin with."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What became of one goal."""

    options: ViewerOptions
    """What was asked for."""
    q: Array
    """Joint values to show, (n,), [rad] or [m]."""
    solution: Solution | None = None
    """None where the question was refused."""
    seconds: float = 0.0
    """What the search took, on the clock."""
    refused: str = ""
    """Why the question was refused."""

    @property
    def reached(self) -> bool:
        """Are both tolerances met?"""
        return self.solution is not None and bool(self.solution.success)

    @property
    def status(self) -> str:
        """The sentence to show."""
        return self.refused if self.solution is None else str(self.solution.status)

    @property
    def trace(self) -> Trace | None:
        """What the search did, if it says so."""
        kept = None if self.solution is None else self.solution._trace
        return kept if isinstance(kept, Trace) else None


@dataclass(frozen=True)
class Proof:
    """What is proved of a goal that was missed."""

    certificate: Certificate | None = None
    """About the goal."""
    place: Certificate | None = None
    """About its position alone, with any orientation: its errors are metres."""
    refused: str = ""
    """Why nothing can be proved."""

    @property
    def unreachable(self) -> bool:
        """Is it proved that nothing reaches the goal?"""
        return self.certificate is not None and self.certificate.verdict is Verdict.UNREACHABLE

    def sentences(self) -> list[str]:
        """What is proved, in words."""
        if self.certificate is None:
            return [self.refused] if self.refused else []
        lower, upper = self.certificate.lower_bound, self.certificate.upper_bound
        found, said = self.certificate, []
        if found.verdict is Verdict.REACHABLE:
            return ["Proved reachable: other joint values meet both tolerances."]
        if found.verdict is Verdict.UNDECIDED:  # What is unreachable the status says.
            said.append(str(found.verdict))
        goal = found.problem.goal
        if goal.columns == 0:
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


class Until(Deadline):
    """A deadline that also passes when somebody says so."""

    def __init__(self, stopped: Callable[[], bool], time_limit: float | None = None) -> None:
        """Begin to count now.

        Args:
            stopped: Is the work no longer wanted?
            time_limit: [s]; None never ends by itself.
        """
        super().__init__(time_limit)
        self._stopped = stopped

    @property
    def passed(self) -> bool:
        """Is the time up, or the work no longer wanted?"""
        return self._stopped() or super().passed


class Session:
    """What an arm answers to one person; it keeps nothing between two questions but what `ViewerOptions` say."""

    def __init__(self, arm: Arm) -> None:
        """Take an arm, and make what it needs once, so that no drag waits for it."""
        self.arm = arm
        q = beginning(arm)
        self.begin = first_selection(arm.mechanism, q, arm.fk(q))
        for goal in (self.begin.target, self.begin.goal):
            arm.ik(goal, near=q)
        self.branches(self.begin)

    def answer(self, options: ViewerOptions) -> Answer:
        """Answer a goal by the search that was chosen; what is refused is said, and the arm stays where it is."""
        if far := self._far(options):
            return Answer(options, options.q, refused=far)
        try:
            goal, search = self._question(options), make_search(options.search, options.parameters)
            near = options.q if options.follow or needs_start(options.search) else None
            extra: dict[str, Any] = {}
            if takes_seconds(options.search):
                extra = {"solver": search, "time_limit": PATIENCE, "trace": True}
            began = time.perf_counter()
            solution = self.arm.ik(goal, near=near, **extra)
            seconds = time.perf_counter() - began
        except KinseekError as error:
            return Answer(options, options.q, refused=str(error))
        return Answer(options.but(q=solution.q), solution.q, solution, seconds)

    def _far(self, options: ViewerOptions) -> str:
        """What is said of a goal so far off that it is in other units, perhaps: `Arm.ik` would warn."""
        far = float(np.linalg.norm(options.target[:3, 3]))
        if self.arm.axes is None or far <= FAR * self.arm.axes.reach:
            return ""
        return (
            f"The goal is {far:.4g} m from the base, and the arm reaches {self.arm.axes.reach:.3g} m at most: "
            "lengths are in metres."
        )

    def traced(self, options: ViewerOptions) -> Trace | None:
        """What the default search does for a goal, pass by pass; others give their trace with the answer."""
        try:
            near = options.q if options.follow else None
            trace = self.arm.ik(self._question(options), near=near, trace=True).trace
        except KinseekError:
            return None
        return trace if isinstance(trace, Trace) else None

    def branches(self, options: ViewerOptions) -> Branches | str:
        """Every answer, or why there are none to be told."""
        try:
            found = self.arm.branches(self._question(options), time_limit=PATIENCE)
        except KinseekError as error:
            return str(error)
        assert isinstance(found, Branches)
        return found

    def picked(self, options: ViewerOptions, q: Array) -> Answer:
        """Show one of the answers that are known, (n,)."""
        solution = self.arm.ik(self._question(options), near=q)
        return Answer(options.but(q=solution.q), solution.q, solution)

    def proofs(
        self, options: ViewerOptions, stopped: Callable[[], bool], threads: int | None = 1
    ) -> Iterator[Proof]:
        """Prove how near any pose can come to a goal that was missed: first whether any reaches it, then ever closer.

        Args:
            options: What was asked for.
            stopped: Is it no longer wanted? Asked between chunks of some hundredths of a second.
            threads: That share the boxes.
        """
        from kinseek.proof.branch_and_bound import prove

        if self.arm.axes is None:
            yield Proof(refused="Nothing can be proved of an arm that is a function.")
            return
        until, place = Until(stopped, PROOF_PATIENCE), None
        try:
            asked = Problem(self.arm.mechanism, options.goal)
            best = prove(asked, budget=FIRST_LOOK, threads=threads, deadline=until)
            yield Proof(best)
            if best.verdict is Verdict.REACHABLE or until.passed:
                return
            if asked.goal.columns:
                spot = Problem(self.arm.mechanism, Goal.position(options.target[:3, 3]))
                place = prove(spot, gap=GAPS[-1], budget=FIRST_LOOK, threads=threads, deadline=until)
            for gap in GAPS:
                known = prove(asked, gap=gap, threads=threads, deadline=until)
                best = known if known.lower_bound >= best.lower_bound else best
                yield Proof(best, place)
                if best.verdict is Verdict.REACHABLE or until.passed:
                    return
        except KinseekError as error:
            yield Proof(refused=str(error))

    def _question(self, options: ViewerOptions) -> Any:
        """The goal; a bare pose where it is one, which is the fastest way."""
        return options.goal if options.free else options.target


def beginning(arm: Arm) -> Array:
    """Joint values to begin with, (n,): of some the most dexterous, well above the ground where it can be."""
    q = arm.sample(BEGINNINGS)
    poses = arm.fk(q)
    there = np.isfinite(poses).all(axis=(1, 2))
    if arm.axes is None:
        return np.asarray(q[int(np.argmax(there))])
    height = poses[:, 2, 3]
    worth = np.asarray(arm.manipulability(q)) * np.where(height >= np.median(height[there]), 1.0, 1e-3)
    return np.asarray(q[int(np.argmax(np.where(there, worth, -1.0)))])


def nearest_of(branches: Branches, q: Array) -> int:
    """The number of the answer nearest to joint values q, (n,), full turns of joints that turn left out; -1 without any."""
    if not len(branches):
        return -1
    apart = branches.q - q
    turns = branches.problem.mechanism.turns
    apart = np.where(turns, apart - TURN * np.rint(apart / TURN), apart)
    return int(np.argmin(np.linalg.norm(apart, axis=1)))


def status_of(answer: Answer, proof: Proof | None) -> tuple[str, str]:
    """The sentence to show and what kind of news it is: ``"good"``, ``"bad"``, ``"open"`` or ``"refused"``."""
    if answer.refused:
        return answer.refused, "refused"
    if answer.reached:
        return answer.status, "good"
    if proof is not None and proof.unreachable:
        return str(Status.PROVED_UNREACHABLE), "bad"
    return answer.status, "open"


def call_of(options: ViewerOptions) -> str:
    """The same question in Python."""
    goal = f"kinseek.Goal.pose(T, free={list(options.free)})" if options.free else "T"
    near = ", near=q" if options.follow or needs_start(options.search) else ""
    if options.search == DEFAULT:
        return f"arm.ik({goal}{near})"
    try:
        solver: object = make_search(options.search, options.parameters)
    except KinseekError:
        return ""
    given = {name: getattr(solver, name) for name in options.parameters}
    words = ", ".join(f"{name}={value!r}" for name, value in given.items())
    return f"arm.ik({goal}{near}, solver=kinseek.{options.search}({words}))"
