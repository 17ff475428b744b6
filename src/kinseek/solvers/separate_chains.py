"""Separate chains: joints that leave a point of the hand at rest are searched after those that move it.

The paper ends with this idea (Sec. 5): "break up the manipulator into separate chains", for instance "run the solver on the
first 3 joints on the SCARA robot and then run the solver for the last joint". These joints, and the point w of the hand that
they leave at rest, are found by forward kinematics alone, see `chain_split`.

The first chain is searched for the position of w alone, the second for the whole goal with the first chain fixed. With three
joints in each these are two trees of depth three in place of one of depth six: their sizes add instead of multiplying.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidSolver
from kinseek.goal import Goal
from kinseek.problem import Problem
from kinseek.robots.mechanism import Mechanism
from kinseek.solution import Solution, with_traces
from kinseek.support.deadline import Deadline
from kinseek.support.validation import arrays_equal

from .base import Found, solve_each, watch_each
from .breadth_tuning import window_leaves
from .chain_split import Joints, Split, known_of, middle, parts
from .divide_and_conquer import _MOST_CELLS, DivideAndConquer, _OutOfTimeError
from .nodes import require_patience
from .recording import Recorder, Region, require_room
from .traits import Near, Traits, require

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SeparateChains(DivideAndConquer):
    """Divide and conquer, chain by chain (the paper, Sec. 5): first what moves the wrist's centre, then the other joints.

    It has the parameters of `DivideAndConquer`, which searches each chain; parameters for each joint refer to the joints of
    the whole arm. `split` returns the chains. If there is only one, the whole arm is searched as by `DivideAndConquer`.

    The split is computed once for an arm and a kind of goal, by some hundred poses (`Split.evaluations`). As for an atlas,
    they are not part of a solution's evaluations.

    Raises:
        InvalidSolver: As `DivideAndConquer`; or `again` is not a number of at least 0.
    """

    breadth: float | tuple[float, ...] | str = 4
    """Br: later passes try 2(⌊D/2⌋ + Br) - 1 values a joint. One number, one a joint, or ``"tuned"``."""
    again: float = 1e-3
    """Weighted error, expressed as a position error [m], above which the chains are searched again if a tolerance is missed.
    Each chain is searched with a beam four times as wide, and if this is not enough, once more for the whole goal with the
    other chain fixed. The best solution counts. Infinity disables this; a result below `stop_below` is not searched again
    either. In the wider beam rounding decides ties."""

    traits: ClassVar[Traits] = Traits(
        source="the paper, Sec. 5",
        finds="the same, first for the joints that move the wrist's centre, then for the others",
        work="proportional to log B, for two small trees instead of a large one",
        near=Near.TURN,
    )

    def __post_init__(self) -> None:
        """Check the parameters."""
        super().__post_init__()
        try:
            fine = not isinstance(self.again, bool) and float(self.again) >= 0
        except (TypeError, ValueError, OverflowError):
            fine = False
        if not fine:
            raise InvalidSolver(f"again must be a distance in metres of at least 0, got {self.again!r}")

    def split(self, problem: Problem) -> Split:
        """Return which joints are searched first, which afterwards, and why.

        Raises:
            InvalidProblem: The goal has free axes or ranges.
        """
        return known_of(problem.mechanism, problem.goal).split

    def solve(self, problem: Problem) -> Solution:
        """Return the best node found, chain after chain, or on the whole arm if it cannot be split."""
        require(self, problem)
        chain, split, deadline = problem.mechanism, self.split(problem), Deadline(problem.time_limit)
        if split.whole or (chain.axes is None and self.breadth == "tuned"):
            # This call rejects tuning for black-box kinematics.
            return _noted(super().solve(problem), split.sentence)
        try:
            plan = self._chain_plan(problem, split, deadline)
        except _OutOfTimeError:
            return solve_each(problem, lambda one, _: Found(one.start, 0, out_of_time=True), deadline)
        # For one target each chain announces and shows its own progress.
        batch = len(problem.goal.targets) > 1
        if batch:
            change = "a smaller breadth, beam or number of divisions"
            require_patience(
                problem, plan.nodes, None, change, lambda one, until: self._chains(one, plan, until)
            )
        shown = self.progress and batch
        return watch_each(problem, lambda one, *_: self._chains(one, plan, deadline), 1, shown, deadline)

    def _chain_plan(self, problem: Problem, split: Split, deadline: Deadline) -> _Plan:
        """Return the search of each chain, with breadths as numbers.

        Raises:
            InvalidSolver: A parameter does not fit the arm, or a chain needs too long a search. It is raised before any
                work.
        """
        if not isinstance(self.breadth, str):
            self.breadths(problem)
        self._offsets(problem.mechanism.wraps)
        require_room(problem, ROUNDS * (int(np.log(self.branching_factor) / np.log(self.divisions)) + 2))
        # A goal without targets: the searches below are only checked and planned with it.
        goal = problem.goal.at(problem.goal.target.reshape(-1, 4, 4)[:0])
        known = known_of(problem.mechanism, problem.goal)
        first, second = known.first, known.second
        if first is None:
            first, second = parts(problem.mechanism, problem.goal, split)
        searches, leaves, nodes = [], [], 0
        for joints, chain, chain_goal in (
            (split.first, first, split.first_goal(goal)),
            (split.second, second, goal),
        ):
            search = self._of(joints)
            if chain is not None:
                nothing = Problem(chain, chain_goal, budget=problem.budget, time_limit=problem.time_limit)
                breadths = search.breadths(nothing, deadline)
                search = replace(search, breadth=breadths)
                for each in (search, _wider(search)) if np.isfinite(self.again) else (search,):
                    # A search that would take too long is rejected here.
                    replace(each, progress=False).solve(nothing)
                nodes += search._plan(nothing, deadline).nodes
                if len(problem.goal.targets) > 1:
                    search = replace(search, progress=False)
                leaves.append(window_leaves(breadths, self.divisions))
            searches.append(search)
        return _Plan(split, first, searches[0], searches[1], leaves[0] / sum(leaves), nodes)

    def _of(self, joints: Joints) -> DivideAndConquer:
        """Return the search of some of the joints."""
        values = {field.name: getattr(self, field.name) for field in fields(DivideAndConquer)}
        mine: dict[str, Any] = {
            name: tuple(value[i] for i in joints) if isinstance(value, tuple) else value
            for name, value in values.items()
        }
        return DivideAndConquer(**mine)

    def _chains(self, problem: Problem, plan: _Plan, deadline: Deadline) -> Found:
        """Search the chains of one target, one after the other."""
        goal, split = problem.goal, plan.split
        account = _Account(problem, self, deadline)
        account.note(split.sentence)
        chain_goal = split.first_goal(goal)
        most = None if problem.budget is None else int(np.ceil(problem.budget * plan.share))
        place = account.search("place", plan.first, split.first, chain_goal, plan.chain, most)
        if not split.second:
            return account.found()
        account.search("goal", plan.second, split.second, goal)
        if account.goes_on:
            # The paper's search dives if the best coarse cell is the wrong one; more cells correct this.
            if place is not None and place.position_error > self.again:
                account.search("place, wider", _wider(plan.first), split.first, chain_goal, plan.chain)
            account.search("goal, wider", _wider(plan.second), split.second, goal)
        if account.goes_on:
            # The second chain may be at its limits: the first one can compensate this in part.
            account.search("first again", plan.first, split.first, goal)
            account.search("second again", plan.second, split.second, goal)
        return account.found()


ROUNDS = 6
"""Most searches of a chain for one target."""


class _Plan(NamedTuple):
    """Data that is the same for every target of a batch."""

    split: Split
    chain: Mechanism
    """The first chain; its tip is the point if there is a second chain."""
    first: DivideAndConquer
    second: DivideAndConquer
    share: float
    """Fraction of a budget that the first chain may use."""
    nodes: int
    """Nodes that both searches visit for one target, if none is repeated."""


def _noted(solution: Solution, sentence: str) -> Solution:
    """Return a solution whose traces, if it has any, begin with a sentence."""
    if not solution.problem.trace:
        return solution
    traces = [replace(one.trace, notes=(sentence, *one.trace.notes)) for one in solution.each()]
    return with_traces(solution, traces)


def _wider(search: DivideAndConquer) -> DivideAndConquer:
    """Return the search that is tried if another one dived: it follows `WIDER` times the cells, and keeps them apart.

    A rule for ties applies to one cell only: with more of them rounding decides.
    """
    return replace(search, beam=min(WIDER * search.beam, _MOST_CELLS), children=1, ties="rounding")


WIDER = 4
"""Factor on the number of cells, and so on the cost. Not examined further."""


class _Account:
    """Connects searches: each starts from the result of the one before, and their work is added up.

    All share one budget and one time limit.
    """

    def __init__(self, problem: Problem, solver: SeparateChains, deadline: Deadline) -> None:
        self.problem, self.deadline = problem, deadline
        self.enough = max(solver.again * problem.goal.position_weight, solver.stop_below)
        self.recorder = Recorder(problem, solver) if problem.trace else None
        self.left, self.memory = problem.budget, 0
        self.work, self.late = np.zeros(3, dtype=np.int64), False
        self.q = middle(problem.mechanism)
        """Result of the last search for its joints, and of earlier searches for the others, (n,)."""
        self.best, self.missed, self.least = problem.start, True, np.inf
        """The best joint values for the goal, (n,); whether they miss a tolerance; and their weighted error."""

    @property
    def goes_on(self) -> bool:
        """Whether more work may improve the result."""
        return self.missed and self.least > self.enough

    def note(self, sentence: str) -> None:
        """Record a sentence, if a trace is requested."""
        if self.recorder:
            self.recorder.note(sentence)

    def search(
        self,
        name: str,
        search: DivideAndConquer,
        joints: Joints,
        goal: Goal,
        chain: Mechanism | None = None,
        most: int | None = None,
    ) -> Solution | None:
        """Search for some of the joints; return None if no budget or time is left.

        Args:
            name: Name of the search, for the trace.
            search: The search.
            joints: Indices of the joints; the others are fixed.
            goal: The problem's goal, or a position.
            chain: The arm in which only these joints move; built if it is not given.
            most: Most evaluations; the default is the rest of the budget.
        """
        budget = self.left if most is None or self.left is None else min(most, self.left)
        self.late |= self.deadline.passed
        if budget == 0 or self.late:
            return None
        chain = self.problem.mechanism.part(joints, self.q, None) if chain is None else chain
        limit, trace = self.deadline.left, self.problem.trace
        found = search.solve(Problem(chain, goal, budget=budget, time_limit=limit, trace=trace))
        if self.recorder:
            self._record(self.recorder, name, joints, found)
        self.work += (found.evaluations, found.nodes_created, found.nodes_expanded)
        self.late |= found.out_of_time
        if self.left is not None:
            self.left -= found.evaluations
        # A copy, because `best` may be the array of an earlier search.
        self.q = self.q.copy()
        self.q[list(joints)] = found.q
        # Until the whole goal has been searched, the joint values of the last search are the best known.
        if self.least == np.inf:
            self.best = self.q
        if goal is self.problem.goal and (not found.success, found.weighted_error) < (
            self.missed,
            self.least,
        ):
            self.best, self.missed, self.least = self.q, not found.success, found.weighted_error
        return found

    def _record(self, recorder: Recorder, name: str, joints: Joints, found: Solution) -> None:
        """Record the passes of a search for some of the joints as those of the whole arm, with the others unmoved."""
        chosen, work = list(joints), self.work.copy()
        for each in found.trace:
            q, counts = self.q.copy(), np.ones(len(self.q), dtype=np.int64)
            spacing = np.full(len(q), np.nan)
            q[chosen] = each.q
            lower, upper = q.copy(), q.copy()
            spacing[chosen], counts[chosen] = each.spacing, each.counts
            lower[chosen], upper[chosen] = each.lower, each.upper
            work += (each.evaluations, each.nodes_created, each.nodes_expanded)
            window = Region(spacing, lower, upper, counts)
            what, self.memory = f"{name}: {each.name}", each.memory
            recorder.add(what, q, *work.tolist(), memory=each.memory, window=window, cells=each.cells)

    def found(self) -> Found:
        """Return the final result."""
        evaluations, created, expanded = self.work.tolist()
        found = Found(self.best, evaluations, created, expanded, self.late)
        if self.recorder is None:
            return found
        if evaluations and not arrays_equal(self.best, self.q):
            self.recorder.add(
                "the best of all", self.best, evaluations, created, expanded, memory=self.memory
            )
        self.recorder.note_end(found)
        return found._replace(trace=self.recorder.finish())
