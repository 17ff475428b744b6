"""Trace the atlas search for one target, round by round.

The compiled search does not report its progress. But the steps that it makes within a budget are the first steps of the
search without a budget. So the rounds are reconstructed by repeated searches, each with room for one more round. They run
the same machine code, so the solution has the same bits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.division import NONE
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.batch import solve_some
from kinseek.kernels.atlas.descent import DEEP_STEPS, FIRST_STEPS, RESTART_STEPS
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.one_goal import PASSES, search_within
from kinseek.kernels.atlas.seeds import RESTARTS
from kinseek.kernels.atlas.task import TOLERANCE
from kinseek.problem import Problem, within_limits
from kinseek.solution import Solution, with_traces
from kinseek.solvers.base import Found
from kinseek.solvers.recording import Recorder
from kinseek.trace import Trace

from .index import AtlasIndex, tolerances_of

MOST_PASSES = PASSES + 1
"""Most passes of one target: the look-up, and every round."""


class Round(NamedTuple):
    """Number of evaluations that a kind of round needs to begin."""

    evaluations: int
    name: str


ROOMS = (
    Round((FIRST_STEPS + 1) * LANES, "nearest samples"),
    Round((DEEP_STEPS + 1) * LANES, "more samples"),
    Round((RESTART_STEPS + 1) * LANES, "restarts"),
)
"""The kinds of rounds, from the least room on. A round that begins with less room than the next kind needs is not followed
by another."""


def traced(solution: Solution, index: AtlasIndex) -> Solution:
    """Return a solution with the traces of its targets."""
    return with_traces(solution, [_trace_of(one, index) for one in solution.each()])


def _trace_of(solution: Solution, index: AtlasIndex) -> Trace:
    """Return the trace of one target."""
    problem = solution.problem
    recorder = Recorder(problem, "Atlas")
    found = Found(solution.q, solution.evaluations, out_of_time=solution.out_of_time)
    _note_samples(recorder, index)
    if found.out_of_time:
        recorder.note("The time limit passed before this target was begun.")
    elif problem.near is not None or problem.goal.form.ranges:
        what = "near a start" if problem.near is not None else "with free axes or ranges"
        recorder.note(f"Rounds {what} are reported as one: the compiled search does not report them.")
        recorder.add("all rounds", found.q, found.evaluations, memory=_bytes_of(index))
        recorder.note_end(found)
    else:
        _record_rounds(recorder, index, found)
        recorder.note_end(found)
    return recorder.finish()


def _record_rounds(recorder: Recorder, index: AtlasIndex, found: Found) -> None:
    """Record the look-up and every round. What follows the last restart is one round, or a patient search before it."""
    problem, memory_bytes = recorder.problem, _bytes_of(index)
    tolerances, restarts, spent = tolerances_of(problem.goal, problem.budget, problem.nearest), 0, 0
    most = TOLERANCE.value(tolerances).budget
    if index.is_far(tolerances, problem.goal.targets[0]):
        what = "only the nearest pose" if problem.nearest else "nothing"
        recorder.note(f"The target is farther away than the arm is long: {what} was searched.")
        recorder.add(
            "nearest pose" if problem.nearest else "no search",
            found.q,
            found.evaluations,
            memory=memory_bytes,
        )
        return
    if index.structure.word != "none" and most >= ROOMS[0].evaluations:
        # Steps before the first round take some of its room: the search then computes what the geometry gives.
        row = _result_within(index, problem, tolerances, ROOMS[0].evaluations)
        spent = int(row[-1])
        if spent:
            recorder.add("closed form", row[:-4], spent, memory=memory_bytes)
        if spent == found.evaluations:
            return
    seeds = _seeds(index, problem, tolerances, 0)
    errors = [recorder.judged(seed)[2] for seed in seeds]
    # If no round fits into the budget, the solution is not even the best sample.
    none = not seeds or found.evaluations == 0
    best = found.q if none else within_limits(problem.chain, seeds[int(np.argmin(errors))])
    recorder.add("look-up", best, spent, memory=memory_bytes, spacing=_spacing(index, problem))
    while spent < found.evaluations:
        seeds = _seeds(index, problem, tolerances, spent)
        for room in ROOMS if restarts < RESTARTS else ():
            if spent + room.evaluations > most:
                continue
            row = _result_within(index, problem, tolerances, spent + room.evaluations)
            if row[-1] > spent:
                errors = [recorder.judged(seed)[2] for seed in seeds]
                start = seeds[int(np.argmin(errors))]
                spent, restarts = int(row[-1]), restarts + LANES * (room is ROOMS[2])
                name = f"{len(seeds)} {room.name}"
                recorder.add(name, row[:-4], spent, memory=memory_bytes, start=start)
                break
        else:
            name = "nearest pose" if restarts >= RESTARTS else "patient search"
            recorder.add(name, found.q, found.evaluations, memory=memory_bytes)
            break


def _result_within(index: AtlasIndex, problem: Problem, tolerances: Array, budget: int) -> Array:
    """Return the result of the search within a budget: joint values, three errors, FK evaluations, (n + 4,)."""
    dof, less = problem.chain.dof, TOLERANCE.value(tolerances)._replace(budget=budget)
    results, first = np.empty((1, dof + 4)), np.zeros(1, dtype=np.int64)
    none = np.empty((0, dof))
    solve_some(index.handle, TOLERANCE.numbers(less), problem.goal.targets[:1], none, results, first, LANES)
    row: Array = results[0]
    return row


def _seeds(index: AtlasIndex, problem: Problem, tolerances: Array, budget: int) -> list[Array]:
    """Return the starts of the round that does not fit into a budget: the joint values already in its lanes, each (n,)."""
    dof, joints = problem.chain.dof, len(problem.chain.leader)
    memory, q = np.zeros(LAYOUT.count.of(dof=dof, joints=joints)), np.empty(dof)
    target = np.ascontiguousarray(problem.goal.targets[0])
    search_within(index.handle, tolerances, memory, target, float(budget), q, LANES)
    return filled_lanes(memory, dof, joints)


def filled_lanes(memory: Array, dof: int, joints: int) -> list[Array]:
    """Return the joint values of the active lanes of a scratch memory, each (n,)."""
    lanes, state = (LAYOUT.view(path, memory, dof=dof, joints=joints) for path in ("lanes.q", "state"))
    return [np.array(lane) for lane, now in zip(lanes.T, state, strict=True) if now == 0]


def _bytes_of(index: AtlasIndex) -> int:
    """Return the memory of the samples and of a call [bytes]."""
    dof = index.sorted.middle.shape[1] + 2
    return index.memory + 8 * LAYOUT.count.of(dof=dof, joints=dof)


def _sampled(index: AtlasIndex) -> slice:
    """Return the joints that are sampled; the others are computed from the pose."""
    first = int(index.division.head != NONE)
    return slice(first, first + index.sorted.middle.shape[1])


def _spacing(index: AtlasIndex, problem: Problem) -> Array:
    """Return the mean distance of neighbouring samples along each joint if they were a grid, (n,); NaN without samples."""
    spacing, joints = np.full(problem.chain.dof, np.nan), _sampled(index)
    middle = index.sorted.middle
    if middle.shape[1]:
        width = middle.max(axis=0) - middle.min(axis=0)
        spacing[joints] = width / len(middle) ** (1 / middle.shape[1])
    return spacing


def _note_samples(recorder: Recorder, index: AtlasIndex) -> None:
    """Add a note about what is sampled."""
    names = recorder.problem.chain.joint_names
    sampled = names[_sampled(index)]
    others = [name for name in names if name not in sampled]
    rest = f"; {' and '.join(others)} follow{'s' * (len(others) == 1)} from the goal" if others else ""
    recorder.note(f"{index.samples:,} samples of {', '.join(sampled) or 'no joint'}{rest}.")
