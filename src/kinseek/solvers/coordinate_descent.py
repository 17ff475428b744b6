"""Exact coordinate descent: it needs forward kinematics only, no derivative and no step size, and never gets worse.

Along one joint the squared chordal error is a sinusoid or a parabola, so three FK evaluations determine its exact minimiser
within the limits. Along two joints nine evaluations determine a bilinear form (see `kernels.grid.sinusoid`). A joint that
drives mimic joints has no such form: a coarse scan and a golden-section search are used for it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from kinseek.deadline import Deadline
from kinseek.errors import InvalidSolver
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import chordal_error, errors
from kinseek.kernels.arrays import Array, ChainArrays, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.grid.sinusoid import TURN, coefficients, minimise_pair, minimiser
from kinseek.kernels.jit import entry, inlined_with_wrapper, kernel
from kinseek.problem import Problem
from kinseek.solution import Solution

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
        limits = np.array(
            [goal.position_tolerance, goal.orientation_tolerance, float(self.most_sweeps), self.stall]
        )
        q = problem.start.copy()
        budget = np.iinfo(np.int64).max if problem.budget is None else problem.budget
        at = np.zeros(2, dtype=np.int64)
        given = problem.arrays, squared, goal.arrays, limits, self.pairs, int(budget)
        recorder = Recorder(problem, self) if problem.trace else None
        if recorder:
            recorder.add("start", q, 1, memory=bytes_of(q))
        # A trace needs every sweep, so each call ends with the sweep that exhausts its part of the budget.
        part = 1 if recorder else PART
        done, swept = sweep_down(*given, part, at, q), 0
        while not done and not deadline.passed:
            watch(int(at[SWEEPS]))
            if recorder:
                swept += 1
                recorder.add(f"sweep {swept}", q, int(at[SPENT]), memory=bytes_of(q))
            done = sweep_down(*given, part, at, q)
        found = Found(q, int(at[SPENT]), out_of_time=not done)
        return found if recorder is None else self._report(recorder, found, f"sweep {swept + 1}")

    @staticmethod
    def _report(recorder: Recorder, found: Found, last: str) -> Found:
        """Add the trace to the result; work that is not recorded yet becomes the pass `last`."""
        recorder.add_rest(last, found)
        recorder.note_end(found)
        return found._replace(trace=recorder.finish())


SPENT, SWEEPS = range(2)
"""Progress of a descent: FK evaluations spent, and sweeps made."""


@kernel
def error_at(chain: ChainArrays, squared: GoalArrays, q: Array, T: Array) -> float:
    """Return the chordal error at q; T, (3, 4), receives the pose."""
    forward(chain, q, T)
    return chordal_error(T, squared)


@inlined_with_wrapper
def samples(chain: ChainArrays, i: int, kinds: Array) -> tuple[float, float]:
    """Return the step of a joint for its samples, and its `slide`: 0 or that step."""
    if kinds[i] == 1:
        step = max(0.5 * (chain.upper[i] - chain.lower[i]), 1e-3)
        return step, step
    return TURN / 3.0, 0.0


@kernel
def joint_kinds(chain: ChainArrays) -> Array:
    """Return the kind of each variable: 0 revolute, 1 prismatic, 2 neither, since it drives more than one joint, (n,)."""
    kinds = -np.ones(len(chain.lower))
    for k in range(len(chain.leader)):
        i = chain.leader[k]
        single = kinds[i] == -1.0 and abs(chain.multiplier[k]) == 1.0
        kinds[i] = (1.0 if chain.prismatic[k] else 0.0) if single else 2.0
    return kinds


@entry
def sweep_down(
    chain: ChainArrays,
    squared: GoalArrays,
    goal: GoalArrays,
    limits: Annotated[Array, 4],
    pairs: bool,
    budget: int,
    part: int,
    at: Annotated[Indices, 2, OUT],
    q: Annotated[Array, "n", OUT],
) -> bool:
    """Descend in place; return whether the descent is done.

    Args:
        chain: The arm.
        squared: The goal with the weights of the chordal error.
        goal: The original goal.
        limits: Position tolerance [m], orientation tolerance [rad], most sweeps, stall, (4,).
        pairs: Whether to minimise over pairs of joints too.
        budget: Largest number of FK evaluations.
        part: FK evaluations after which this call ends, at the end of a sweep.
        at: Progress of the descent, see `SPENT`: zeros at its beginning.
        q: Start inside the limits, and then the result, (n,).
    """
    dof, T, kinds = len(q), np.empty((3, 4)), joint_kinds(chain)
    error = error_at(chain, squared, q, T)
    at[SPENT] = max(at[SPENT], 1)
    end = at[SPENT] + part
    while at[SWEEPS] < limits[2]:
        position, orientation = errors(T, goal)
        if position <= limits[0] and orientation <= limits[1]:
            break
        before = error
        for i in range(dof):
            if at[SPENT] + (3 if kinds[i] < 2 else SCANS + 2 * SECTIONS + 1) > budget:
                return True
            cost, error = descend_one(chain, squared, kinds, i, error, q, T)
            at[SPENT] += cost
        if pairs:
            for i in range(dof - 1):
                for j in range(i + 1, dof):
                    if at[SPENT] + 9 > budget:
                        return True
                    if kinds[i] < 2 and kinds[j] < 2:
                        error = descend_two(chain, squared, kinds, i, j, error, q, T)
                        at[SPENT] += 9
        if at[SPENT] >= budget:
            return True
        error = error_at(chain, squared, q, T)
        at[SPENT] += 1
        at[SWEEPS] += 1
        if before - error <= limits[3] * before:
            break
        if at[SPENT] >= end:
            return False
    return True


@kernel
def descend_one(
    chain: ChainArrays, squared: GoalArrays, kinds: Array, i: int, error: float, q: Array, T: Array
) -> tuple[int, float]:
    """Minimise along joint i in place; return the FK evaluations spent and the resulting error."""
    if kinds[i] == 2:
        return scan_one(chain, squared, i, error, q, T)
    here = q[i]
    step, slide = samples(chain, i, kinds)
    q[i] = here + step
    f1 = error_at(chain, squared, q, T)
    q[i] = here - step
    f2 = error_at(chain, squared, q, T)
    a, b, c = coefficients(error, f1, f2, slide)
    delta = minimiser(a, b, c, chain.lower[i] - here, chain.upper[i] - here, kinds[i] == 0)
    return 3, accept(chain, squared, i, here, here + delta, error, q, T)


@kernel
def accept(
    chain: ChainArrays,
    squared: GoalArrays,
    i: int,
    old: float,
    new: float,
    error: float,
    q: Array,
    T: Array,
) -> float:
    """Set joint i to a new value, clipped to the limits, if FK confirms an improvement; otherwise restore the old one."""
    q[i] = min(max(new, chain.lower[i]), chain.upper[i])
    value = error_at(chain, squared, q, T)
    if value < error:
        return value
    q[i] = old
    return error


@kernel
def scan_one(
    chain: ChainArrays, squared: GoalArrays, i: int, error: float, q: Array, T: Array
) -> tuple[int, float]:
    """Minimise along a joint whose error is not a single sinusoid: scan its range, then use golden sections."""
    old, low, span = q[i], chain.lower[i], chain.upper[i] - chain.lower[i]
    best, best_value = old, error
    for k in range(SCANS):
        q[i] = low + span * (k + 0.5) / SCANS
        value = error_at(chain, squared, q, T)
        if value < best_value:
            best, best_value = q[i], value
    left, right = max(best - span / SCANS, low), min(best + span / SCANS, chain.upper[i])
    ratio = (math.sqrt(5.0) - 1.0) / 2.0
    for _ in range(SECTIONS):
        first, second = right - ratio * (right - left), left + ratio * (right - left)
        q[i] = first
        f1 = error_at(chain, squared, q, T)
        q[i] = second
        f2 = error_at(chain, squared, q, T)
        if f1 < f2:
            right = second
        else:
            left = first
    q[i] = old
    middle = 0.5 * (left + right)
    value = accept(chain, squared, i, old, middle, error, q, T)
    if best_value < value:
        q[i] = best
        value = best_value
    return SCANS + 2 * SECTIONS + 1, value


@kernel
def descend_two(
    chain: ChainArrays, squared: GoalArrays, kinds: Array, i: int, j: int, error: float, q: Array, T: Array
) -> float:
    """Minimise over joints i and j at once, in place; return the resulting error."""
    here_i, here_j = q[i], q[j]
    step_i, slide_i = samples(chain, i, kinds)
    step_j, slide_j = samples(chain, j, kinds)
    rows, M = np.empty((3, 3)), np.empty((3, 3))
    for v in range(3):
        q[j] = here_j + (0.0, step_j, -step_j)[v]
        q[i] = here_i
        f0 = error if v == 0 else error_at(chain, squared, q, T)
        q[i] = here_i + step_i
        f1 = error_at(chain, squared, q, T)
        q[i] = here_i - step_i
        f2 = error_at(chain, squared, q, T)
        rows[0, v], rows[1, v], rows[2, v] = coefficients(f0, f1, f2, slide_i)
    for u in range(3):
        M[u, 0], M[u, 1], M[u, 2] = coefficients(rows[u, 0], rows[u, 1], rows[u, 2], slide_j)
    low, high, delta, revolute = np.empty(2), np.empty(2), np.zeros(2), np.empty(2, dtype=np.bool_)
    low[0], low[1] = chain.lower[i] - here_i, chain.lower[j] - here_j
    high[0], high[1] = chain.upper[i] - here_i, chain.upper[j] - here_j
    revolute[0], revolute[1] = kinds[i] == 0, kinds[j] == 0
    minimise_pair(M, low, high, revolute, delta)
    q[j] = min(max(here_j + delta[1], chain.lower[j]), chain.upper[j])
    value = accept(chain, squared, i, here_i, here_i + delta[0], error, q, T)
    if value >= error:
        q[j] = here_j
    return value
