"""Many goals at once: each lane refines its own goal and takes the next one when it is done."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import counted, entry, inlined

from .descent import FIRST_STEPS, is_hopeless, iterate, reset_weights, within
from .lanes import LANES, Lanes
from .memory import Scratch, make_scratch, scratch_size
from .near import walk_near
from .one_goal import CORRECTIONS, MIDMOST, OFFER, closed_answer, conclude, finish, solve_target
from .seeds import FIRST, TAKES, load_seed, middle, scan, take_seed
from .task import EVALUATIONS, TOLERANCES, Handle, Job, Task, routines_of, task_of
from .tree import take_nearest

MOST_STARTS = max(2 * LANES, TAKES)
"""Largest number of starts for one target: candidates for two values of a swept joint, or samples."""


class Block(NamedTuple):
    """Targets of a batch, and what becomes of them."""

    targets: Array
    """(k, 3, 4), lengths in [m]."""
    results: Array
    """Results as from `solve_pose`, (k, n + 4)."""
    left: Indices
    """Indices of the targets that are left, (at least as many as are solved together,)."""


class Queue(NamedTuple):
    """State of the lanes of a batch."""

    target: Indices
    """Index of the target of each lane; -1 before the first target, -2 when none is left, (LANES,)."""
    next: Indices
    """Number of starts used, (LANES,)."""
    steps: Indices
    """Steps made from the current start, (LANES,)."""
    spent: Indices
    """FK evaluations spent on the target, (LANES,)."""


@inlined
def stand_still(lanes: Lanes, l: int) -> None:
    """Clear lane l: without pose, axes and error its next step is zero."""
    for k in range(lanes.axes.shape[0]):
        for r in range(6):
            lanes.axes[k, r, l] = 0.0
    for r in range(3):
        for c in range(4):
            lanes.pose[r, c, l] = 0.0
    for r in range(6):
        lanes.residual[r, l] = 0.0
    for r in range(4):
        lanes.error[r, l] = 0.0


@inlined
def next_seed(task: Task, scratch: Scratch, queue: Queue, targets: Array, l: int, w: int) -> bool:
    """Load the next promising sample of its target into lane l; return False if there is none.

    A second sample is seldom needed, so the scan is repeated instead of being stored for every lane.
    """
    for r in range(3):
        for c in range(4):
            scratch.pose[r, c] = targets[queue.target[l], r, c]
    leaf = scan(task, scratch, scratch.pose, w)
    taken = queue.next[l]
    # The second round begins with a new scan, so only the samples of the current round are removed.
    for _ in range(taken % FIRST):
        take_nearest(task.atlas.tree, leaf, scratch.beside, scratch.least)
    for _ in range(TAKES):
        if taken == TAKES:
            break
        taken, promising = take_seed(task, scratch, leaf, taken, w)
        if promising:
            queue.next[l], queue.steps[l] = taken, 0
            load_seed(scratch.lanes, l, scratch.seed)
            stand_still(scratch.lanes, l)
            return True
    return False


@inlined
def next_candidate(job: Job, task: Task, scratch: Scratch, queue: Queue, targets: Array, l: int) -> bool:
    """Load the next candidate of a nearby arm for its target into lane l; return False if there is none."""
    target, q, request = targets[queue.target[l]], scratch.found[l], OFFER + queue.next[l]
    offered = closed_answer(job, target, task.budget, q, request, q)
    queue.next[l], queue.steps[l] = queue.next[l] + 1, 0
    if offered > 0:
        load_seed(scratch.lanes, l, q)
        stand_still(scratch.lanes, l)
    return offered > 0


@inlined
def take_target(task: Task, lanes: Lanes, queue: Queue, block: Block, number: int, l: int) -> None:
    """Assign a target to lane l."""
    queue.target[l], queue.next[l] = number, 0
    queue.spent[l] = int(block.results[number, len(task.lower) + EVALUATIONS])
    for r in range(3):
        for c in range(4):
            lanes.target[r, c, l] = block.targets[number, r, c]


@entry
def solve_many(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 3, 4],
    results: Annotated[Array, "k", "width", OUT],
    left: Annotated[Indices, "*", OUT],
    begin: int,
    end: int,
    w: int,
) -> int:
    """Solve targets begin … end-1, one in each lane; a lane that is done takes the next target.

    The steps for a target are the same as in `solve_pose`, so the results agree bit by bit. Targets that neither the
    closed form nor the first samples solve are left for `solve_pose`, because each of these may take milliseconds.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        targets: Rigid transforms, (k, 3, 4), lengths in [m].
        results: Receives what `solve_pose` returns, (k, n + 4).
        left: Receives the indices of the targets that are left, (end - begin,).
        begin: First target.
        end: One past the last target.
        w: LANES.

    Returns:
        The number of targets left.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    count, job, block = 0, Job(handle, tolerances, memory, w), Block(targets, results, left)
    closed = routines_of(handle).closed != 0
    if closed and task.exact == 1:
        count = run_closed(job, task, scratch, block, begin, end)
    else:
        for i in range(begin, end):
            left[count], results[i, dof + EVALUATIONS] = i, 0.0
            count += 1
    # Candidates of a nearby arm come before samples. A loop, because Numba compiles a function again for every call in
    # the source.
    for nearby in (True, False):
        if not nearby or (closed and task.exact == 0):
            count = run_lanes(job, task, scratch, block, count, nearby)
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return count


@entry
def solve_some(
    handle: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 3, 4],
    near: Annotated[Array, "*", "n"],
    results: Annotated[Array, "k", "n+4", OUT],
    some: Annotated[Indices, "*"],
    w: int,
) -> None:
    """Solve some targets one after the other.

    Args:
        handle: The task, see `task_of`.
        tolerances: See `task_of`.
        targets: Rigid transforms, (k, 3, 4), lengths in [m].
        near: Reference joint values for each, to choose the nearest solution, (k, n), or none, (0, n).
        results: Receives results as from `solve_pose`, (k, n + 4).
        some: Indices of the targets to solve.
        w: LANES.
    """
    task, close = task_of(handle, tolerances), len(near) > 0
    dof = len(task.lower)
    memory = np.zeros(scratch_size(dof, len(task.chain.leader)))
    job = Job(handle, tolerances, memory, w)
    for k in range(len(some)):
        i = some[k]
        q, report = results[i, :dof], results[i, dof:]
        if close:
            # The memory is cleared between targets, so that results do not depend on the rest of the batch, bit by bit.
            for m in range(len(memory)):
                memory[m] = 0.0
            report[EVALUATIONS] = walk_near(job, targets[i], near[i], q)
            conclude(job, targets[i], near[i], True, q, report)
        else:
            report[EVALUATIONS] = solve_target(job, targets[i], task.budget, q)
            conclude(job, targets[i], q, False, q, report)
    memory[0] = 0.0  # Its last use, see `solve_pose`.


@inlined
def run_closed(job: Job, task: Task, scratch: Scratch, block: Block, begin: int, end: int) -> int:
    """Solve targets begin … end-1 in closed form; write the indices of the others into `left` and return their number.

    For the targets left, `results` receives the evaluations spent so far.
    """
    leftover, dof = 0, len(task.lower)
    for t in range(begin, end):
        q, report = block.results[t, :dof], block.results[t, dof:]
        tried = closed_answer(job, block.targets[t], task.budget, q, MIDMOST, q)
        if tried > 0:
            for k in range(EVALUATIONS):  # It is judged already.
                report[k] = scratch.report[k]
            report[EVALUATIONS] = tried
        else:
            block.left[leftover], report[EVALUATIONS] = t, -tried
            leftover += 1
    return leftover


@counted
def run_lanes(job: Job, task: Task, scratch: Scratch, block: Block, count: int, nearby: bool) -> int:
    """Process `count` targets with indices in `block.left`; write the unsolved ones back there and return their number.

    The starts are samples, or with `nearby` candidates of the nearby arm.
    """
    lanes, dof, steps = scratch.lanes, len(task.lower), CORRECTIONS if nearby else FIRST_STEPS
    queue = Queue(
        np.full(LANES, -1),
        np.zeros(LANES, dtype=np.int64),
        np.zeros(LANES, dtype=np.int64),
        np.zeros(LANES, dtype=np.int64),
    )
    reset_weights(task, scratch)
    leftover, number, active = 0, 0, LANES
    # An upper bound: every target has a limited number of steps, and one lane might process all targets in sequence.
    for turn in range(1 + count * MOST_STARTS * (FIRST_STEPS + 1)):
        if active == 0:
            break
        if turn > 0:
            iterate(job, True)
        for l in range(LANES):
            if queue.target[l] == -2:
                continue
            busy, more = queue.target[l] >= 0, False
            if busy:
                queue.spent[l] += 1
                if within(task, lanes, l):
                    write_result(task, scratch, queue, block, l)
                    busy = False
                elif queue.steps[l] == steps or (not nearby and is_hopeless(lanes, queue.steps[l], l)):
                    more = True
                else:
                    queue.steps[l] += 1
            while more or (not busy and number < count):
                if not more:
                    # Unsolved targets are written at places that have been read already.
                    take_target(task, lanes, queue, block, block.left[number], l)
                    number += 1
                if nearby:
                    busy = next_candidate(job, task, scratch, queue, block.targets, l)
                else:
                    busy = next_seed(task, scratch, queue, block.targets, l, job.width)
                more = False
                if not busy:
                    target = queue.target[l]
                    block.left[leftover], block.results[target, dof + EVALUATIONS] = target, queue.spent[l]
                    leftover += 1
            if not busy:
                queue.target[l] = -2
                active -= 1
    return leftover


@inlined
def write_result(task: Task, scratch: Scratch, queue: Queue, block: Block, l: int) -> None:
    """Judge lane l by plain FK and write its row of the results."""
    i, dof, results = queue.target[l], len(task.lower), block.results
    for j in range(dof):
        results[i, j] = scratch.lanes.q[j, l]
    goal = GoalArrays(block.targets[i], task.position_weight, task.axis_weights)
    middle(task, scratch.seed)
    finish(task, scratch, goal, scratch.seed, results[i, :dof], results[i, dof:])
    results[i, dof + EVALUATIONS] = queue.spent[l]
