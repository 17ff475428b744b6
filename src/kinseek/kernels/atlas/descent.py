"""Descent of eight configurations at once, and the best of those that did not converge."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import weighted_error
from kinseek.kernels.arrays import Array, GoalArrays
from kinseek.kernels.jit import inlined
from kinseek.kernels.pointers import call, part2, routine

from .lanes import (
    COSINE,
    DISTANCE2,
    LANES,
    RESIDUAL2,
    SINE2,
    Lanes,
    lanes_forward,
    lanes_gram,
    lanes_hold,
    lanes_jacobian,
    lanes_move,
    lanes_residual,
    lanes_solve,
)
from .memory import ACTIVE, CONVERGED, EMPTY, GIVEN_UP, Scratch, scratch_of
from .seeds import copy_joints, keep_joints, load_target, turns_fully
from .task import WEIGHTED_ERROR, Job, Task, routines_of, task_at

FIRST_STEPS, DEEP_STEPS, RESTART_STEPS, POLISH_STEPS = 10, 20, 30, 20
"""Largest numbers of steps: from one of the first samples, from a sample of a deeper look-up, from a restart, and towards
an unreachable goal."""

STALL, NEARLY = 6, 0.03
"""A descent stops if no lane has halved its squared error in STALL steps and no lane has a residual below NEARLY."""

HOPELESS, LEAST_HOPE = 3, 1e-6
"""A descent from one of the first samples is given up if, after HOPELESS steps or more, a step has not halved its squared
error and that error exceeds LEAST_HOPE. Nine in ten descents that lead nowhere end so. Of the nearest samples that
would have led to a solution, one to five in a hundred end so; the next sample replaces them."""

PERSIST_STEPS = 100
"""Largest number of persistent steps. At a singular solution every step only halves the joint error, and a joint at its
limit slows convergence further."""

ALMOST_RIGHT = 1.5
"""Angle [rad] up to which the sine measures an orientation error. It is below π/2, beyond which the sine decreases."""

ALIKE = 0.3
"""Two configurations closer than this in every joint [rad or m] converge to the same result."""

DAMPING = 0.1
"""Damping of a step relative to the squared error, which is scaled to make metres and radians comparable."""

FLOOR = 1e-11
"""Smallest damping of a step, see `lanes.lanes_gram`."""

LONGEST = 0.8
"""Largest step of a joint [rad or m]; beyond it the linearization does not predict the motion of the hand."""


@inlined
def make_stubborn(lanes: Lanes, stubborn: float) -> None:
    """Make every second lane stubborn, or none, see `lanes_hold`; clear their last steps."""
    for l in range(LANES):
        lanes.stubborn[l] = stubborn * (l % 2)
        for i in range(lanes.step.shape[0]):
            lanes.step[i, l] = 0.0


@inlined
def lowest(values: Array) -> float:
    """Smallest of the values."""
    least: float = values[0]
    for i in range(1, len(values)):
        least = min(least, values[i])
    return least


@inlined
def lowest_row(values: Array) -> int:
    """First index of the smallest value."""
    row = 0
    for i in range(1, len(values)):
        if values[i] < values[row]:
            row = i
    return row


@inlined
def reset_weights(task: Task, scratch: Scratch) -> None:
    """Set the scales of the residuals so that metres and radians are comparable."""
    lanes = scratch.lanes
    for c in range(3):
        scratch.columns[c] = task.columns[c]
    scratch.damping[0] = DAMPING
    for l in range(LANES):
        scratch.floor[l] = FLOOR
        lanes.weight[0, l] = 1.0 / task.length
        lanes.weight[1, l] = 1.0 if task.columns[0] > 0.0 else 0.0


@inlined
def goal_of(task: Task, target: Array) -> GoalArrays:
    """View a target, (3, 4), with the weights of the task."""
    return GoalArrays(part2(target.ctypes.data, 0, 3, 4), task.position_weight, task.axis_weights)


@inlined
def free_turn(task: Task) -> float:
    """Return 1 if rotation about the tool's x axis is unconstrained, else 0."""
    return 1.0 if task.columns[0] > 0.0 and task.columns[1] == 0.0 else 0.0


@inlined
def iterate(job: Job, move: bool) -> int:
    """Make one damped step of every lane if `move`; then compute poses, residuals and errors.

    The step is that of the task: `iterate_routine` for a pose, another for a goal with ranges.
    """
    done: int = call(routines_of(job.handle).iterate, (job, move))
    return done


@routine
def iterate_routine(job: Job, move: bool) -> int:
    """See `iterate`."""
    task, w = task_at(job), job.width
    scratch = scratch_of(job, task)
    lanes = scratch.lanes
    if move:
        lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
        lanes_hold(task.lower, task.upper, lanes, w)
        lanes_gram(scratch.damping[0], scratch.floor, lanes, w)
        lanes_solve(lanes, w)
        lanes_move(task.lower, task.upper, LONGEST, lanes, w)
    lanes_forward(task.chain.leader, task.links, lanes, w)
    lanes_residual(lanes, scratch.columns, w)
    return 0


@inlined
def within(task: Task, lanes: Lanes, l: int) -> bool:
    """Return True if lane l is within both tolerances."""
    position, orientation = task.position_tolerance, task.orientation_tolerance
    if lanes.error[DISTANCE2, l] > position * position:
        return False
    if task.poses > 0:
        # The step of a goal with ranges stores squared angles, not sines.
        near: bool = lanes.error[SINE2, l] <= orientation * orientation
        return near
    if task.columns[0] == 0.0:
        return True
    # The weighted cosine of a pose is (1 + 2 cos φ)/2, of a direction cos φ.
    cosine = lanes.error[COSINE, l]
    ahead = cosine > 0.5 if task.columns[1] > 0.0 else cosine > 0.0
    # sin φ ≤ sin t where φ < t < π/2. For small t, t - t³/6 is a lower bound of sin t.
    bound = min(orientation, ALMOST_RIGHT)
    bound -= bound * bound * bound / 6.0
    small: bool = lanes.error[SINE2, l] <= bound * bound
    return ahead and small


@inlined
def is_hopeless(lanes: Lanes, made: int, l: int) -> bool:
    """Return True if lane l, one of the first samples, is to be given up; must be called after every step."""
    error, before = lanes.error[RESIDUAL2, l], lanes.before[l]
    lanes.before[l] = error
    return made >= HOPELESS and error > LEAST_HOPE and error > 0.5 * before


@inlined
def descend_lanes(job: Job, task: Task, scratch: Scratch, steps: int, everyone: bool) -> tuple[int, int]:
    """Refine the eight lanes; return the first lane that converged, or -1, and the number of steps made.

    The nearest seed has precedence: the solution of a later lane counts only after all earlier lanes have made their
    steps. With `everyone`, every lane makes its steps. All lanes stop if none has made progress for a while: such a goal
    is unreachable, or needs another seed. With ranges every lane makes all its steps.
    """
    lanes, dof, patient = scratch.lanes, len(task.lower), steps <= FIRST_STEPS or task.poses > 0
    first_ones = steps == FIRST_STEPS and task.poses == 0 and not everyone
    for made in range(steps + 1):
        iterate(job, made > 0)
        waiting, first = 0, -1
        for l in range(LANES):
            if scratch.state[l] == ACTIVE and within(task, lanes, l):
                scratch.state[l] = CONVERGED
                for i in range(dof):
                    scratch.found[l, i] = lanes.q[i, l]
            if scratch.state[l] == ACTIVE and first_ones and is_hopeless(lanes, made, l):
                scratch.state[l] = GIVEN_UP
            if scratch.state[l] == ACTIVE:
                waiting += 1
            elif scratch.state[l] == CONVERGED and first < 0:
                first = l
                if waiting == 0 and not everyone:
                    return first, made
        if waiting == 0 or made == steps:
            return first, made
        if made % STALL == 0 and not patient:
            # Before the first step there is no earlier error to compare with.
            moving = made == 0
            for l in range(LANES):
                error = lanes.error[RESIDUAL2, l]
                hopeful = error < 0.5 * lanes.before[l] or error < NEARLY * NEARLY
                moving = moving or (scratch.state[l] == ACTIVE and hopeful)
                lanes.before[l] = error
            if not moving:
                return first, made
    return -1, steps  # Not reached: the last step returns.


@inlined
def farthest_joint(rows: Array, row: int, q: Array) -> float:
    """Largest difference of a joint between a row and q, (n,), [rad or m]."""
    far = 0.0
    for i in range(len(q)):
        far = max(far, abs(rows[row, i] - q[i]))
    return far


@inlined
def keep_seed(scratch: Scratch, error: float) -> None:
    """Store the seed among the eight best if its weighted error is less than that of the worst, or of its twin.

    No two of the eight are alike: copies of one configuration would all be polished to the same result.
    """
    worst, twin = 0, -1
    for k in range(LANES):
        if scratch.best_error[k] > scratch.best_error[worst]:
            worst = k
        if scratch.best_error[k] < np.inf and farthest_joint(scratch.best, k, scratch.seed) < ALIKE:
            twin = k
    worst = twin if twin >= 0 else worst
    if error < scratch.best_error[worst]:
        scratch.best_error[worst] = error
        keep_joints(scratch.best, worst, scratch.seed)


@inlined
def judge_by_ranges(job: Job, q: Array, report: Array) -> int:
    """Judge joint values, (n,), by plain FK against ranges: write errors [m], [rad] and weighted into a report."""
    done: int = call(routines_of(job.handle).judge, (job, q, report))
    return done


@inlined
def keep_best(job: Job, task: Task, scratch: Scratch, target: Array) -> None:
    """Store the eight best configurations found, no two alike, for a goal that may be unreachable."""
    dof, goal = len(task.lower), goal_of(task, target)
    for l in range(LANES):
        if scratch.state[l] == EMPTY:
            continue
        for i in range(dof):
            scratch.seed[i] = scratch.lanes.q[i, l]
        if task.poses > 0:
            judge_by_ranges(job, scratch.seed, scratch.report)
            keep_seed(scratch, scratch.report[WEIGHTED_ERROR])
        else:
            forward(task.chain, scratch.seed, scratch.pose)
            keep_seed(scratch, weighted_error(scratch.pose, goal))


@inlined
def start(task: Task, scratch: Scratch, target: Array) -> None:
    """Initialize the scratch memory for a target, (3, 4)."""
    for l in range(LANES):
        load_target(scratch.lanes, l, target)
        scratch.best_error[l] = np.inf
    reset_weights(task, scratch)


@inlined
def joint_distance(task: Task, q: Array, near: Array) -> float:
    """Squared distance of two joint vectors; continuous joints are measured the shorter way."""
    total = 0.0
    for i in range(len(q)):
        gap = q[i] - near[i]
        if math.isinf(task.lower[i]):
            gap -= 2.0 * math.pi * np.round(gap / (2.0 * math.pi))
        elif turns_fully(task, i):
            gap = nearest_copy(q[i], task.chain.lower[i], task.chain.upper[i], near[i]) - near[i]
        total += gap * gap
    return total


@inlined
def keep_closest(task: Task, scratch: Scratch, near: Array, closest: float, q: Array) -> float:
    """Write the converged lane nearest to `near`, (n,), into q if it is nearer than `closest`.

    Returns:
        The squared distance of q afterwards; `closest` is squared too.
    """
    for l in range(LANES):
        if scratch.state[l] == CONVERGED:
            copy_joints(scratch.found, l, scratch.seed)
            far = joint_distance(task, scratch.seed, near)
            if far < closest:
                closest = far
                copy_joints(scratch.found, l, q)
    return closest
