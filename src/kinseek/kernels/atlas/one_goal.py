"""Solve one goal, starting from its nearest samples.

The solution is the one that the nearest sample converges to. If that sample fails, the next nearest is used, and so on.
The solution therefore depends on the goal alone, not on the other goals of a batch. A goal that no sample leads to gets
deeper look-ups and low-discrepancy restarts. A goal that is still missed is unreachable, or nearly so, and gets the
nearest pose found if that is wanted, see `ending`. Every solution is judged by plain forward kinematics.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, is_rigid, weighted_error
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, kernel
from kinseek.kernels.pointers import call, part1, routine

from . import descent, seeds
from .ending import ENDGAME, ending_routine, find_nearest_pose, promise
from .far import MOST as FAR_MOST
from .far import far_routine, is_far, nearest_to_far
from .lanes import LANES
from .memory import ACTIVE, DEEP, EMPTY, Scratch, scratch_of, scratch_size
from .task import (
    EVALUATIONS,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    REPORT,
    TOLERANCES,
    WEIGHTED_ERROR,
    Handle,
    Job,
    Joints,
    Routines,
    Target,
    Task,
    handle_at,
    lanes_of,
    plain_tolerances,
    routines_of,
    task_at,
    task_of,
)

PASSES = seeds.TAKES + seeds.MORE + DEEP + seeds.MORE_RESTARTS // LANES + 3
"""Largest number of passes of a search. Each uses at least one sample of a scan or a look-up, eight restarts, or one of
the two persistent passes; a last one ends the search. A goal with ranges needs at most two passes per pose instead of
samples."""

KICK, WIDE_KICK = 0.5, 1.5
"""Distances from the best configuration [rad or m] at which restarts begin, alternately: close to it, and in the wider
surroundings."""


@inlined
def solve_target(job: Job, target: Array, budget: float, q: Array) -> int:
    """Solve one target, (3, 4), within a budget; write q, (n,), and return the FK evaluations spent.

    Closed forms come first, see `structure.one_answer`, and far targets are not searched, see `far`. The memory may hold
    anything.
    """
    far = budget >= FAR_MOST and is_far(job, target)
    tried = 0 if far else closed_answer(job, target, budget, q, MIDMOST, q)
    if tried > 0:
        return tried
    if far and task_at(job).nearest == 0.0:
        seeds.middle(task_at(job), q)
        return 0
    # The memory is cleared so that no bit of a result depends on what it held.
    for k in range(len(job.memory)):
        job.memory[k] = 0.0
    if far:
        return nearest_to_far(job, target, q)
    # Here `tried` is minus the number of evaluations that the closed form has spent.
    return search_near(job, target, budget + tried, q, False, q) - tried


MIDMOST, NEAREST, OFFER = 0, 1, 2
"""Requests to `structure.one_answer.closed_routine`: the solution nearest to the middle of the ranges; the solution
nearest to the current joint values; and from OFFER on, a candidate to refine."""

CORRECTIONS = 4
"""Largest number of steps from a candidate of a nearby arm."""


@inlined
def closed_answer(job: Job, target: Array, budget: float, near: Array, request: int, q: Array) -> int:
    """Return the result of `structure.one_answer.closed_routine`; 0 if the arm has no closed form."""
    tried, closed = 0, routines_of(job.handle).closed
    if closed != 0 and budget >= (descent.FIRST_STEPS + 1) * LANES:
        tried = call(closed, (job, target, near, request, q))
    return tried


@inlined
def search_near(job: Job, target: Array, budget: float, near: Array, close: bool, q: Array) -> int:
    """Do the same as `solve_target`; with `close` choose the solution nearest to `near`, (n,), for a goal with ranges."""
    spent: int = call(routines_of(job.handle).search, (job, target, budget, near, close, q))
    return spent


@inlined
def fill_from_ranges(job: Job, near: Array, close: bool, begin: int, most: int) -> int:
    """Load the samples nearest to poses of the ranges, from index `begin` on, into the lanes; return the next index.

    At most `most` samples are read for each pose. With `close` the first lane starts from `near`, (n,).
    """
    following: int = call(routines_of(job.handle).starts, (job, near, close, begin, most))
    return following


@routine
def search_routine(job: Job, target: Target, budget: float, near: Joints, close: bool, q: Joints) -> int:
    """See `solve_target` and `search_near`."""
    task, w = task_at(job), job.width
    scratch, dof = scratch_of(job, task), len(task.lower)
    lanes = scratch.lanes
    descent.start(task, scratch, target)
    spent, rounds, depth, begin, found, persisted, number = 0, 0, 0, 0, task.poses, 0, 0
    restarts, patience, most, taken, leaf, closest = (
        seeds.RESTARTS,
        descent.DEEP_STEPS,
        seeds.MORE,
        0,
        0,
        np.inf,
    )
    ranges = task.poses > 0
    if ranges:
        # Samples are looked up at poses of the ranges, not at the target itself.
        taken, depth = seeds.TAKES, DEEP
    else:
        leaf = seeds.scan(task, scratch, target, w)
    for _ in range(PASSES):
        if taken == seeds.TAKES and begin == found and depth < most:
            depth = most
            begin, found = 0, seeds.look_up(task, scratch, target, most)
        if taken < seeds.TAKES:
            taken, filled = seeds.fill_from_scan(task, scratch, leaf, taken, w)
            if filled == 0:
                continue
            steps = descent.FIRST_STEPS
        elif begin < found:
            if ranges:
                begin = fill_from_ranges(job, near, close, begin, most)
            else:
                begin, filled = seeds.fill_from_lookup(task, scratch, begin, found)
                if filled == 0:
                    continue
            steps = patience
        elif persisted == 0 or (persisted == 1 and number >= restarts):
            # The persistent pass is made before the restarts, and again after all of them.
            persisted += 1
            # What may still be a solution is refined in any case.
            refined = task.nearest > 0.0 or descent.lowest(scratch.best_error) <= promise(task)
            most_refined = (descent.POLISH_STEPS if ranges else ENDGAME) * LANES
            if persisted == 2 and refined and spent + most_refined <= budget:
                spent += find_nearest_pose(job, target)
                descent.reset_weights(task, scratch)
            if descent.lowest(scratch.best_error) > promise(task):
                continue
            if persisted == 1:
                # A promising lane may lead to a mirror image of the solution, so this pass does not stop early.
                restarts, patience, most, begin, found = (
                    seeds.MORE_RESTARTS,
                    descent.PERSIST_STEPS,
                    DEEP,
                    0,
                    task.poses,
                )
            for l in range(LANES):
                scratch.state[l] = ACTIVE if scratch.best_error[l] < np.inf else EMPTY
                seeds.load_seed_row(lanes, l, scratch.best)
            descent.make_stubborn(lanes, 0.0 if ranges else 1.0)
            steps = descent.PERSIST_STEPS
        elif number < restarts:
            root = seeds.generalized_golden_ratio(dof)
            for l in range(LANES):
                seeds.low_discrepancy_start(task, root, number + l, scratch.seed)
                if restarts == seeds.MORE_RESTARTS and number % (2 * LANES) == 0:
                    seeds.kick(
                        task, scratch.best, l, KICK if number % (4 * LANES) == 0 else WIDE_KICK, scratch.seed
                    )
                seeds.load_seed(lanes, l, scratch.seed)
                scratch.state[l] = ACTIVE
            number += LANES
            steps = descent.RESTART_STEPS
        else:
            break
        if spent + (steps + 1) * LANES > budget:
            break
        lane, made = descent.descend_lanes(job, task, scratch, steps, close)
        descent.make_stubborn(lanes, 0.0)
        spent += (made + 1) * LANES
        if close:
            closest = descent.keep_closest(task, scratch, near, closest, q)
            if closest < np.inf and begin == found:
                return spent
        elif lane >= 0:
            seeds.copy_joints(scratch.found, lane, q)
            return spent
        descent.keep_best(job, task, scratch, target)
        rounds += 1
    if closest < np.inf:
        return spent
    if rounds == 0:
        # The budget did not suffice for a single pass.
        seeds.middle(task, q)
        return spent
    seeds.copy_joints(scratch.best, descent.lowest_row(scratch.best_error), q)
    return spent


@inlined
def finish(task: Task, scratch: Scratch, goal: GoalArrays, near: Array, q: Array, report: Array) -> None:
    """Clamp q to the limits and judge it by plain FK: errors [m], [rad] and weighted into `report`, (4,)."""
    seeds.into_limits(task, q, near)
    forward(task.chain, q, scratch.pose)
    report[POSITION_ERROR], report[ORIENTATION_ERROR] = errors(scratch.pose, goal)
    report[WEIGHTED_ERROR] = weighted_error(scratch.pose, goal)


@inlined
def conclude(job: Job, target: Array, near: Array, close: bool, q: Array, report: Array) -> None:
    """Judge a solution q, (n,): write errors [m], [rad] and weighted into report, (4,).

    Full turns are chosen near a reference, (n,), with `close`, else near the middle of the ranges.
    """
    task = task_at(job)
    scratch = scratch_of(job, task)
    if not close:
        seeds.middle(task, scratch.seed)
        near = scratch.seed
    finish(task, scratch, descent.goal_of(task, target), near, q, report)


def routines() -> Routines:
    """The routines of a pose.

    The routines of goals with ranges are in `kernels.ranges.search.range_routines`. The routine of an arm with a closed
    form is `structure.one_answer.closed_routine`.
    """
    step, search = descent.iterate_routine.address, search_routine.address
    return Routines(step, search, ending_routine.address, far_routine.address)


@entry
def search_within(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    memory: Annotated[Array, "*", OUT],
    target: Annotated[Array, 3, 4],
    budget: float,
    q: Annotated[Array, "n", OUT],
    w: int,
) -> int:
    """Do the same as `solve_target`, (3, 4), in the caller's memory, which stays readable, see `memory.LAYOUT`."""
    return solve_target(Job(handle, tolerances, memory, w), target, budget, q)


@kernel
def solve_pose(handle: Indices, tolerances: Array, target: Array, w: int) -> Array:
    """Solve one target.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        target: A rigid transform, (4, 4), lengths in [m].
        w: LANES.

    Returns:
        Joint values, position error [m], orientation error [rad], weighted error, and FK evaluations, (n + 4,).
    """
    task = task_of(handle, tolerances)
    dof = len(task.lower)
    result = np.empty(dof + REPORT)
    memory = np.empty(scratch_size(dof, len(task.chain.leader)))
    job = Job(handle, tolerances, memory, w)
    address = result.ctypes.data
    q, report = part1(address, 0, dof), part1(address, dof, REPORT)
    report[EVALUATIONS] = solve_target(job, target, task.budget, q)
    conclude(job, target, q, False, q, report)
    memory[0] = 0.0  # Views do not keep the memory alive: Numba frees it after its last use.
    return result


@inlined
def outcome(
    job: Job, target: Array, near: Array, close: bool, spent: int, q: Array
) -> tuple[float, float, float, int, bool]:
    """Judge a solution as `conclude` does, and return what `solve_plain` returns."""
    task = task_at(job)
    report = scratch_of(job, task).report
    conclude(job, target, near, close, q, report)
    position, orientation = report[POSITION_ERROR], report[ORIENTATION_ERROR]
    met = position <= task.position_tolerance and orientation <= task.orientation_tolerance
    return position, orientation, report[WEIGHTED_ERROR], spent, met


@entry
def solve_plain(
    address: int, target: Annotated[Array, 4, 4], q: Annotated[Array, "n"]
) -> tuple[float, float, float, int, bool]:
    """Solve one pose with the default tolerances and weights, with little overhead on the side of Python.

    Args:
        address: Address of the handle of the task, see `task_of`.
        target: (4, 4), lengths in [m].
        q: Receives the joint values, (n,).

    Returns:
        Position error [m], orientation error [rad], weighted error, FK evaluations, and whether the tolerances are met.
        Evaluations are -1 if the target is not a rigid transform; the other values are then invalid.
    """
    if not is_rigid(target):
        return 0.0, 0.0, 0.0, -1, False
    handle = handle_at(address)
    tolerances = plain_tolerances(handle)
    task = task_of(handle, tolerances)
    memory = np.empty(scratch_size(len(task.lower), len(task.chain.leader)))
    job = Job(handle, tolerances, memory, lanes_of(handle))
    # Called here and not one level deeper: Numba compiles the callees of a function again at every level.
    spent = solve_target(job, target, task.budget, q)
    status = outcome(job, target, q, False, spent, q)
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return status
