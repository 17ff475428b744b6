"""One goal, from its nearest samples to an answer.

The answer to a goal is what its nearest sample converges to; where that one fails, the next nearest, and so on. So the
answer depends on the goal alone, not on how many are solved beside it. A goal that no sample leads to gets deeper
lookups and low-discrepancy restarts; what is then still missed is out of reach, or as good as, and gets the best pose
found, see `ending`. Every answer is judged by plain forward kinematics.
"""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, is_rigid, weighted_error
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.jit import hidden, kernel, routine, view
from kinseek.kernels.pointers import call, part1, part2

from .descent import (
    DEEP_STEPS,
    ENDING,
    FIRST_STEPS,
    PERSIST_STEPS,
    RESTART_STEPS,
    SEARCH,
    descend_lanes,
    goal_of,
    iterate_routine,
    keep_best,
    lowest,
    lowest_row,
    make_stubborn,
    reset_weights,
    start,
)
from .ending import ENDGAME, ending_routine, find_nearest_pose, promise
from .lanes import LANES
from .memory import DEEP, Desk, desk_size, make_desk
from .seeds import (
    FIRST,
    MORE,
    MORE_RESTARTS,
    RESTARTS,
    copy_joints,
    fill_from_lookup,
    fill_from_scan,
    into_limits,
    kick,
    load_seed,
    load_seed_row,
    look_up,
    middle,
    restart,
    scan,
)
from .task import WANTED, Job, Task, handle_at, lanes_of, plain_wanted, routine_at, task_of

PASSES = FIRST + MORE + DEEP + MORE_RESTARTS // LANES + 3
"""Passes of a search at most: each takes at least one sample of a scan or a lookup, eight restarts, or one of the two
persistent ones; and a last one that ends it."""


@view
def solve_target(
    handle: Indices, wanted: Array, memory: Array, target: Array, budget: float, q: Array, w: int
) -> int:
    """Answer one target, (3, 4), within a budget; write q, (n,), and return the FK evaluations spent.

    Returns -1 where it takes a routine that the task lacks yet, see `add_ending`, and there is no answer.
    """
    at = (handle.ctypes.data, wanted.ctypes.data, memory.ctypes.data, target.ctypes.data)
    spent: int = call(routine_at(handle, SEARCH), (*at, budget, q.ctypes.data, w))
    return spent


@routine("int64(int64, int64, int64, int64, float64, int64, int64)")
def search_routine(
    handle_address: int,
    wanted_address: int,
    memory_address: int,
    target_address: int,
    budget: float,
    q_address: int,
    w: int,
) -> int:
    """See `solve_target`."""
    handle, wanted = handle_at(handle_address), part1(wanted_address, 0, WANTED)
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = part1(memory_address, 0, desk_size(dof, joints))
    target, q = part2(target_address, 0, 3, 4), part1(q_address, 0, dof)
    desk, job = make_desk(memory, dof, joints), Job(handle, wanted, memory)
    lanes = desk.lanes
    start(task, desk, target)
    spent, rounds, looked, begin, found, persisted, number = 0, 0, 0, 0, 0, 0, 0
    restarts, patience, most, taken = RESTARTS, DEEP_STEPS, MORE, 0
    leaf = scan(task, desk, target)
    for _ in range(PASSES):
        if taken == FIRST and begin == found and looked < most:
            looked = most
            begin, found = 0, look_up(task, desk, target, most)
        if taken < FIRST:
            taken, filled = fill_from_scan(task, desk, leaf, taken)
            if filled == 0:
                continue
            steps = FIRST_STEPS
        elif begin < found:
            begin, filled = fill_from_lookup(task, desk, begin, found)
            if filled == 0:
                continue
            steps = patience
        elif persisted == 0 or (persisted == 1 and number >= restarts):
            persisted += 1
            if persisted == 2 and spent + ENDGAME * LANES <= budget:
                if routine_at(handle, ENDING) == 0:
                    return -1
                spent += find_nearest_pose(handle, wanted, memory, target, w)
                reset_weights(task, desk)
            if lowest(desk.best_error) > promise(task):
                continue
            if persisted == 1:
                # What looked promising may be a mirror image of the answer; this time nobody is called back early.
                restarts, patience, most, begin, found = MORE_RESTARTS, PERSIST_STEPS, DEEP, 0, 0
            for l in range(LANES):
                desk.state[l] = 0 if desk.best_error[l] < np.inf else 2
                load_seed_row(lanes, l, desk.best)
            make_stubborn(lanes, 1.0)
            steps = PERSIST_STEPS
        elif number < restarts:
            for l in range(LANES):
                restart(task, number + l, desk.seed)
                if restarts == MORE_RESTARTS and number % (2 * LANES) == 0:
                    kick(task, desk.best, l, 0.5 if number % (4 * LANES) == 0 else 1.5, desk.seed)
                load_seed(lanes, l, desk.seed)
                desk.state[l] = 0
            number += LANES
            steps = RESTART_STEPS
        else:
            break
        if spent + (steps + 1) * LANES > budget:
            break
        lane, made = descend_lanes(job, task, desk, steps, False, w)
        make_stubborn(lanes, 0.0)
        spent += (made + 1) * LANES
        if lane >= 0:
            copy_joints(desk.found, lane, q)
            return spent
        keep_best(task, desk, target)
        rounds += 1
    if rounds == 0:
        middle(task, q)
        return spent
    copy_joints(desk.best, lowest_row(desk.best_error), q)
    return spent


@hidden
def finish(task: Task, desk: Desk, goal: GoalArrays, near: Array, q: Array, report: Array) -> None:
    """Bring q inside the limits and judge it by plain FK: errors [m], [rad] and weighted into `report`, (4,)."""
    into_limits(task, q, near)
    forward(task.chain, q, desk.spare)
    report[0], report[1] = errors(desk.spare, goal)
    report[2] = weighted_error(desk.spare, goal)


@view
def conclude_answer(
    handle: Indices, wanted: Array, memory: Array, target: Array, q: Array, report: Array
) -> None:
    """Judge an answer, q, (n,): errors [m], [rad] and weighted into report, (4,)."""
    task = task_of(handle, wanted)
    desk = make_desk(memory, len(task.lower), len(task.chain.leader))
    middle(task, desk.seed)
    finish(task, desk, goal_of(task, target), desk.seed, q, report)


def routines() -> Indices:
    """Addresses of the routines that every goal needs, for `task_arrays`; `add_ending` adds the other."""
    return np.array([iterate_routine.address, search_routine.address, 0], dtype=np.int64)


def add_ending(addresses: Indices) -> None:
    """Add the routine that only a goal out of reach needs: it is a quarter of all there is to compile."""
    addresses[ENDING] = ending_routine.address


@kernel
def solve_pose(handle: Indices, wanted: Array, target: Array, w: int) -> Array:
    """Answer one target.

    Args:
        handle: The task, see `task_of`.
        wanted: See `task_of`.
        target: A rigid transform, (4, 4), lengths in [m].
        w: LANES.

    Returns:
        Joint values, position error [m], orientation error [rad], weighted error, and FK evaluations, (n + 4,).
    """
    task = task_of(handle, wanted)
    dof = len(task.lower)
    result, memory = np.empty(dof + 4), np.zeros(desk_size(dof, len(task.chain.leader)))
    address = result.ctypes.data
    q, report = part1(address, 0, dof), part1(address, dof, 4)
    report[3] = solve_target(handle, wanted, memory, target, wanted[3], q, w)
    conclude_answer(handle, wanted, memory, target, q, report)
    memory[0] = 0.0  # Views do not keep it alive: without a last use Numba would have freed it by now.
    return result


@kernel
def solve_plain(address: int, target: Array, q: Array) -> tuple[float, float, float, int, bool]:
    """Answer one pose under the default tolerances and weights, with as little between Python and the answer as can be.

    Args:
        address: Where the handle of the task stands, see `task_of`.
        target: (4, 4), lengths in [m].
        q: Receives the joint values, (n,).

    Returns:
        Position error [m], orientation error [rad], weighted error, FK evaluations, and whether the tolerances are met;
        evaluations -1 where the target is no rigid transform, or `solve_target` lacks a routine, and nothing else holds.
    """
    if not is_rigid(target):
        return 0.0, 0.0, 0.0, -1, False
    handle = handle_at(address)
    wanted = plain_wanted(handle)
    task = task_of(handle, wanted)
    size = desk_size(len(task.lower), len(task.chain.leader))
    memory = np.zeros(size + 4)
    report = part1(memory.ctypes.data, size, 4)
    # Called here and not one floor below: Numba compiles what a function calls anew for every floor above it.
    report[3] = solve_target(handle, wanted, memory, target, wanted[3], q, lanes_of(handle))
    conclude_answer(handle, wanted, memory, target, q, report)
    position, orientation, weighted, spent = report[0], report[1], report[2], int(report[3])
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return position, orientation, weighted, spent, position <= wanted[0] and orientation <= wanted[1]
