"""Exact coordinate descent: it needs forward kinematics only, no derivative and no step size, and never gets worse.

Along one joint the squared chordal error is a sinusoid or a parabola, so three FK evaluations determine its exact minimiser
within the limits. Along two joints nine evaluations determine a bilinear form (see `kernels.grid.sinusoid`). A joint that
drives mimic joints has no such form: a coarse scan and a golden-section search are used for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np

from kinseek.errors import InvalidSolver
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import chordal_error, errors
from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.grid.sinusoid import TURN, Motion, fit_of, minimise_pair, minimiser
from kinseek.kernels.jit import entry, inlined_with_wrapper, kernel
from kinseek.problem import Problem
from kinseek.solution import Solution
from kinseek.support.deadline import Deadline

from .base import Found, require_whole, watch_each
from .recording import Recorder, bytes_of, require_room
from .threads import unwatched
from .traits import Near, Traits, require

SCANS, SECTIONS = 24, 30
"""Samples of a range, and golden sections after them, for a joint without a closed form."""

PART = 1 << 16
"""FK evaluations between two checks of the clock and of signals: some ten milliseconds."""


@dataclass(frozen=True)
class CoordinateDescent:
    """Minimise along single joints and pairs of joints alternately, from `problem.start`.

    The convergence is linear: the search takes tens to hundreds of sweeps, and it may stay in a local minimum.

    Raises:
        InvalidSolver: A parameter is out of its range.
    """

    traits: ClassVar[Traits] = Traits(
        source="kinseek",
        finds="a local minimum, exact along each joint and pair of joints",
        work="3 FK evaluations per joint, 9 per pair",
        near=Near.START,
        plain_joints=True,
    )

    most_sweeps: int = 200
    """Most sweeps over all joints and pairs."""
    pairs: bool = True
    """Whether to minimise over pairs of joints too: sweeps cost more, but far fewer are needed."""
    stall: float = 1e-6
    """Stop if a sweep lowers the squared error by less than this fraction of it."""
    progress: bool = False
    """Show a progress bar of the largest possible number of sweeps."""

    def __post_init__(self) -> None:
        """Check the parameters."""
        require_whole(self, "most_sweeps", 1)
        if not 0 <= self.stall < 1:
            raise InvalidSolver(f"stall must be in [0, 1), got {self.stall}")

    def solve(self, problem: Problem) -> Solution:
        """Return the lowest point of the descent from `problem.start`."""
        require(self, problem)
        require_room(problem, self.most_sweeps + 2)
        return watch_each(problem, self._search, self.most_sweeps, self.progress)

    def _search(
        self, problem: Problem, deadline: Deadline, watch: Callable[[int], object] = unwatched
    ) -> Found:
        goal = problem.goal
        if problem.axes is None:
            from .black_box.coordinates import answer

            recorder = Recorder(problem, self) if problem.trace else None
            found = answer(
                problem.mechanism, problem, deadline, self.most_sweeps, self.pairs, self.stall, recorder
            )
            return found if recorder is None else self._report(recorder, found, "a sweep cut short")
        # Squared weights, and half of K_A², so that near the goal the sum is (K_P |Δp|)² + (K_A Δφ)².
        turn_weight = goal.orientation_weight**2 / 2
        columns = (np.arange(3) < goal.columns).astype(float)
        squared = GoalArrays(goal.targets[0], goal.position_weight**2, turn_weight * columns)
        q = problem.start.copy()
        budget = np.iinfo(np.int64).max if problem.budget is None else problem.budget
        tolerances = goal.position_tolerance, goal.orientation_tolerance
        rules = Rules(*tolerances, self.most_sweeps, self.stall, self.pairs, int(budget))
        progress = np.zeros(2, dtype=np.int64)
        given = problem.arrays, squared, goal.arrays, rules
        recorder = Recorder(problem, self) if problem.trace else None
        if recorder:
            recorder.add("start", q, 1, memory=bytes_of(q))
        # A trace needs every sweep, so each call ends with the sweep that exhausts its part of the budget.
        part = 1 if recorder else PART
        done, swept = sweep_down(*given, part, progress, q), 0
        while not done and not deadline.passed:
            watch(int(progress[SWEEPS]))
            if recorder:
                swept += 1
                recorder.add(f"sweep {swept}", q, int(progress[SPENT]), memory=bytes_of(q))
            done = sweep_down(*given, part, progress, q)
        found = Found(q, int(progress[SPENT]), out_of_time=not done)
        return found if recorder is None else self._report(recorder, found, f"sweep {swept + 1}")

    @staticmethod
    def _report(recorder: Recorder, found: Found, last: str) -> Found:
        """Add the trace to the result; work that is not recorded yet becomes the pass `last`."""
        recorder.add_rest(last, found)
        recorder.note_end(found)
        return found._replace(trace=recorder.finish())


SPENT, SWEEPS = range(2)
"""Progress of a descent: FK evaluations spent, and sweeps made."""

REVOLUTE, PRISMATIC, NEITHER = range(3)
"""Kinds of joints: along one that drives several the error is no sinusoid and no parabola."""


class Rules(NamedTuple):
    """When a descent ends."""

    position_tolerance: float
    """It ends within both tolerances, [m]."""
    orientation_tolerance: float
    """[rad]"""
    most_sweeps: int
    stall: float
    """It ends if a sweep lowers the squared error by less than this fraction of it."""
    pairs: bool
    """Whether to minimise over pairs of joints too."""
    budget: int
    """Largest number of FK evaluations."""


class State(NamedTuple):
    """The arm at its present joint values."""

    chain: ChainArrays
    squared: GoalArrays
    """The goal with the weights of the chordal error."""
    kinds: Indices
    """Kind of each joint, (n,)."""
    q: Array
    """Joint values, (n,), [rad] or [m]."""
    T: Array
    """Pose of the tip at the values evaluated last, (3, 4)."""


@entry
def sweep_down(
    chain: ChainArrays,
    squared: GoalArrays,
    goal: GoalArrays,
    rules: Rules,
    part: int,
    progress: Annotated[Indices, 2, OUT],
    q: Annotated[Array, "n", OUT],
) -> bool:
    """Descend in place; return whether the descent is done.

    Args:
        chain: The arm.
        squared: The goal with the weights of the chordal error.
        goal: The original goal.
        rules: When to end.
        part: FK evaluations after which this call ends, at the end of a sweep.
        progress: Progress of the descent, see `SPENT`: zeros at its beginning.
        q: Start inside the limits, and then the result, (n,).
    """
    dof = len(q)
    state = State(chain, squared, joint_kinds(chain), q, np.empty((3, 4)))
    error = error_at(state)
    progress[SPENT] = max(progress[SPENT], 1)
    end = progress[SPENT] + part
    while progress[SWEEPS] < rules.most_sweeps:
        position, orientation = errors(state.T, goal)
        if position <= rules.position_tolerance and orientation <= rules.orientation_tolerance:
            break
        before = error
        for i in range(dof):
            # Two samples and the check of the result; or the scan, two values per section and the check.
            cost = 3 if state.kinds[i] != NEITHER else SCANS + 2 * SECTIONS + 1
            if progress[SPENT] + cost > rules.budget:
                return True
            error = descend_one(state, i, error) if state.kinds[i] != NEITHER else scan_one(state, i, error)
            progress[SPENT] += cost
        if rules.pairs:
            for i in range(dof - 1):
                for j in range(i + 1, dof):
                    # Three fits with two samples each, two values of the other joint, and the check of the result.
                    if progress[SPENT] + 9 > rules.budget:
                        return True
                    if state.kinds[i] != NEITHER and state.kinds[j] != NEITHER:
                        error = descend_two(state, i, j, error)
                        progress[SPENT] += 9
        if progress[SPENT] >= rules.budget:
            return True
        error = error_at(state)
        progress[SPENT] += 1
        progress[SWEEPS] += 1
        if before - error <= rules.stall * before:
            break
        if progress[SPENT] >= end:
            return False
    return True


@kernel
def joint_kinds(chain: ChainArrays) -> Indices:
    """Return the kind of each joint, (n,)."""
    kinds = np.full(len(chain.lower), -1)
    for k in range(len(chain.leader)):
        i = chain.leader[k]
        # With another multiplier the sinusoid has another period than 2π.
        single = kinds[i] == -1 and abs(chain.multiplier[k]) == 1.0
        kinds[i] = (PRISMATIC if chain.prismatic[k] else REVOLUTE) if single else NEITHER
    return kinds


@kernel
def error_at(state: State) -> float:
    """Return the chordal error at the present joint values."""
    forward(state.chain, state.q, state.T)
    return chordal_error(state.T, state.squared)


@kernel
def error_with(state: State, i: int, value: float) -> float:
    """Move joint i to a value; return the chordal error there."""
    state.q[i] = value
    return error_at(state)


@inlined_with_wrapper
def sample_step(state: State, i: int) -> tuple[float, float]:
    """Return the step of a joint for its samples, and its `slide`: 0 or that step."""
    if state.kinds[i] == PRISMATIC:
        step = max(0.5 * (state.chain.upper[i] - state.chain.lower[i]), 1e-3)
        return step, step
    return TURN / 3.0, 0.0


@kernel
def fit_along(state: State, i: int, f0: float) -> Vector:
    """Fit the error along joint i, whose value is restored; f0 is the error there."""
    value = state.q[i]
    step, slide = sample_step(state, i)
    f1, f2 = error_with(state, i, value + step), error_with(state, i, value - step)
    state.q[i] = value
    return fit_of(f0, f1, f2, slide)


@inlined_with_wrapper
def motion_of(state: State, i: int) -> Motion:
    """Return the motion that joint i can make."""
    value, chain = state.q[i], state.chain
    return Motion(chain.lower[i] - value, chain.upper[i] - value, state.kinds[i] == REVOLUTE)


@kernel
def accept(state: State, i: int, new: float, error: float) -> float:
    """Set joint i to a new value, clipped to the limits, if FK confirms an improvement; return the resulting error."""
    old = state.q[i]
    value = error_with(state, i, min(max(new, state.chain.lower[i]), state.chain.upper[i]))
    if value < error:
        return value
    state.q[i] = old
    return error


@kernel
def descend_one(state: State, i: int, error: float) -> float:
    """Minimise along joint i in place; return the resulting error."""
    delta = minimiser(fit_along(state, i, error), motion_of(state, i))
    return accept(state, i, state.q[i] + delta, error)


@kernel
def scan_one(state: State, i: int, error: float) -> float:
    """Minimise along a joint whose error is not a single sinusoid: scan its range, then use golden sections."""
    old, low, high = state.q[i], state.chain.lower[i], state.chain.upper[i]
    span, best, least = high - low, old, error
    for k in range(SCANS):
        value = error_with(state, i, low + span * (k + 0.5) / SCANS)
        if value < least:
            best, least = state.q[i], value
    left, right = max(best - span / SCANS, low), min(best + span / SCANS, high)
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(SECTIONS):
        first, second = right - ratio * (right - left), left + ratio * (right - left)
        if error_with(state, i, first) < error_with(state, i, second):
            right = second
        else:
            left = first
    state.q[i] = old
    value = accept(state, i, 0.5 * (left + right), error)
    if least < value:
        state.q[i] = best
        value = least
    return value


@kernel
def descend_two(state: State, i: int, j: int, error: float) -> float:
    """Minimise over joints i and j at once, in place; return the resulting error."""
    q, value_j = state.q, state.q[j]
    step, slide = sample_step(state, j)
    middle = fit_along(state, i, error)
    above = fit_along(state, i, error_with(state, j, value_j + step))
    below = fit_along(state, i, error_with(state, j, value_j - step))
    q[j] = value_j
    M = np.empty((3, 3))
    for u in range(3):
        # Each coefficient of the fit along joint i is a sinusoid or a parabola in joint j.
        row = fit_of(middle[u], above[u], below[u], slide)
        M[u, 0], M[u, 1], M[u, 2] = row.x, row.y, row.z
    first, second = minimise_pair(M, motion_of(state, i), motion_of(state, j))
    q[j] = min(max(value_j + second, state.chain.lower[j]), state.chain.upper[j])
    value = accept(state, i, q[i] + first, error)
    if value >= error:
        q[j] = value_j
    return value
