"""Search for the nearest pose to a goal that seems unreachable, from the best configurations found."""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.division import nearest_copy
from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, weighted_error
from kinseek.kernels.arm.range_error import range_weighted
from kinseek.kernels.arrays import Array, GoalArrays, Limits
from kinseek.kernels.jit import inlined
from kinseek.kernels.pointers import call, routine

from . import descent, seeds
from .lanes import DISTANCE2, LANES, SINE2
from .memory import ACTIVE, DEEP, EMPTY, Scratch, scratch_of
from .newton import DOWNHILL, VALLEY_STEPS, WALK, Walk, minimise
from .task import Job, Target, Task, read_tolerances, routines_of, task_at

BALANCES, BEARABLE, SMALL = 8, 10.0, 1e-30
"""Largest number of times that the two tolerances are rebalanced; the multiple of a tolerance beyond which this is
useless; and the smallest divisor."""

ENDGAME = (
    2 * (descent.POLISH_STEPS + WALK)
    + (DEEP // LANES + 1) * (descent.DEEP_STEPS + 1)
    + BALANCES * (VALLEY_STEPS + 1)
)
"""Largest number of FK evaluations of the search for the nearest pose, per lane."""

PROMISING = 0.02
"""Remaining error, relative to the arm, below which the search follows valleys, looks up more samples and uses
`MORE_RESTARTS`."""

HOPELESS = 1.1
"""A configuration is not refined further if its error, nearly at its minimum, exceeds the best by this factor."""

POLISH_FLOOR, LEAST = 0.1, 1e-9
"""Initial and smallest damping of polishing, relative to the weights."""

LESS, MORE_DAMPING = 0.3, 4.0
"""Factors of the damping after a successful step and after an unsuccessful one."""

SHARED = 2
"""Two flips this many joints apart share one joint, which makes a full turn and so does not move."""

NEAREST = 1e-9
"""Distance [m] below which the weight K_P/|Δp| of the squared distance is constant; it would be infinite at 0."""


@inlined
def flip(q: Array, i: int) -> None:
    """Flip the joint values, (n,), at joint i."""
    q[i - 1] += math.pi
    q[i] *= -1.0
    q[i + 1] += math.pi


@inlined
def fill_from_flips(task: Task, scratch: Scratch) -> int:
    """Load flips of the best configuration, ``(q_i + π, -q_{i+1}, q_{i+2} + π)``, into the lanes; return the lanes filled.

    If three axes intersect, as in a shoulder or a wrist, a flip keeps the pose of the hand; otherwise it is only a start.
    The remaining lanes get two flips at once, of neighbours that share a joint.
    """
    chain, best, filled = task.chain, descent.lowest_row(scratch.best_error), 0
    for apart in (0, SHARED):
        for i in range(1, len(task.lower) - 1 - apart):
            if filled == LANES:
                break
            seeds.copy_joints(scratch.best, best, scratch.seed)
            flip(scratch.seed, i)
            if apart > 0:
                flip(scratch.seed, i + apart)
            for j in range(i - 1, i + 2 + apart):
                low, high = chain.lower[j], chain.upper[j]
                value = nearest_copy(scratch.seed[j], low, high, 0.5 * (low + high))
                scratch.seed[j] = min(max(value, low), high)
            seeds.load_seed(scratch.lanes, filled, scratch.seed)
            scratch.state[filled] = ACTIVE
            filled += 1
    for l in range(filled, LANES):
        scratch.state[l] = EMPTY
    return filled


@inlined
def find_nearest_pose(job: Job, target: Array) -> int:
    """Refine the eight best to the nearest pose to an unreachable target, (3, 4); return FK evaluations."""
    spent: int = call(routines_of(job.handle).ending, (job, target))
    return spent


@routine
def ending_routine(job: Job, target: Target) -> int:
    """See `find_nearest_pose`."""
    task, spent = task_at(job), 0
    scratch = scratch_of(job, task)
    for turn in range(2):
        if turn > 0:
            spent += try_other_starts(job, task, scratch, target)
        spent += polish(job, task, scratch, target)
    if descent.lowest(scratch.best_error) <= promise(task):
        spent += follow_valleys(task, scratch, target)
    return spent


@inlined
def reweigh(job: Job, task: Task, scratch: Scratch, target: Array, steps: int) -> int:
    """Minimise the weighted error from the eight best by a number of reweighted steps; return FK evaluations.

    ``K_P |Δp| + ½ Σ K_c |c - c_g|²`` is not smooth at Δp = 0, unlike a sum of squares. The squared distance is therefore
    weighted by K_P/|Δp|, updated in every step (Weiszfeld 1937). A lane whose step does not help returns to its best and
    increases its damping.
    """
    goal, lanes, dof, floor = descent.goal_of(task, target), scratch.lanes, len(task.lower), scratch.floor
    largest = max(goal.axis_weights[0], goal.axis_weights[1], goal.axis_weights[2])
    for l in range(LANES):
        # K_P is read again for each lane. If it were kept in a register, its product would not be fused with the sum, and
        # the last bits of solutions would change.
        floor[l] = POLISH_FLOOR * (read_tolerances(job.tolerances).position_weight * task.length + largest)
        scratch.paused[l] = 0
        seeds.load_seed_row(lanes, l, scratch.best)
        lanes.weight[1, l] = math.sqrt(largest)
    for c in range(3):
        scratch.columns[c] = goal.axis_weights[c]
    # A damping proportional to the squared error would stay large: the error of an unreachable goal does not vanish.
    scratch.damping[0] = 0.0
    for step in range(steps):
        descent.iterate(job, step > 0)
        for l in range(LANES):
            gap = math.sqrt(lanes.error[DISTANCE2, l])
            far = math.sqrt(goal.position_weight / max(gap, NEAREST))
            scale_p, scale_o = far / lanes.weight[0, l], 1.0
            if task.poses > 0:
                turn = math.sqrt(lanes.error[SINE2, l])
                error = range_weighted(goal.position_weight, largest, gap, turn)
            else:
                for r in range(3):
                    for c in range(4):
                        scratch.pose[r, c] = lanes.pose[r, c, l]
                error = weighted_error(scratch.pose, goal)
                # Rows are scaled by the roots of the weights. The orientation rows hold K_A times √K_A at this point.
                scale_o = 1.0 / largest if largest > 0.0 else 0.0
            lanes.weight[0, l] = far
            if error <= scratch.best_error[l]:
                if scratch.paused[l] == 0:
                    floor[l] = max(LESS * floor[l], LEAST)
                scratch.paused[l] = 0
                scratch.best_error[l] = error
                for i in range(dof):
                    scratch.best[l, i] = lanes.q[i, l]
            else:
                floor[l] *= MORE_DAMPING
                scratch.paused[l] = 1
                seeds.load_seed_row(lanes, l, scratch.best)
                scale_p, scale_o = 0.0, 0.0  # This lane pauses for one step and continues from its best.
            for r in range(3):
                lanes.residual[r, l] *= scale_p
                lanes.residual[3 + r, l] *= scale_o
    return steps * LANES


@inlined
def walk_down(task: Task, scratch: Scratch, target: Array, row: int) -> int:
    """Walk from one of the eight best to a minimum, see `newton`, and replace it if that is better; return evaluations."""
    goal, limits = descent.goal_of(task, target), Limits(task.lower, task.upper)
    seeds.copy_joints(scratch.best, row, scratch.seed)
    spent: int = minimise(task.chain, goal, limits, DOWNHILL, scratch.seed)
    forward(task.chain, scratch.seed, scratch.pose)
    error = weighted_error(scratch.pose, goal)
    if error < scratch.best_error[row]:
        scratch.best_error[row] = error
        seeds.keep_joints(scratch.best, row, scratch.seed)
    return spent


@inlined
def polish(job: Job, task: Task, scratch: Scratch, target: Array) -> int:
    """Minimise the weighted error from the eight best; return FK evaluations.

    After the reweighted steps Newton's method refines each lane.
    """
    spent = reweigh(job, task, scratch, target, descent.POLISH_STEPS)
    limit = HOPELESS * descent.lowest(scratch.best_error)
    for l in range(LANES):
        if scratch.best_error[l] <= limit:
            spent += walk_down(task, scratch, target, l)
    return spent


@inlined
def follow_valleys(task: Task, scratch: Scratch, target: Array) -> int:
    """Follow the valleys of the eight best until one leads to a solution, the new best; return FK evaluations.

    The nearest pose by the weights may miss one tolerance although a solution close to it meets both. Here a sum of
    squares is minimised in which each tolerance counts as one. If its minimum still misses one tolerance, that one gets a
    larger weight.
    """
    goal, limits, spent = descent.goal_of(task, target), Limits(task.lower, task.upper), 0
    near, level = task.position_tolerance, task.orientation_tolerance
    both = near > 0.0 and level > 0.0
    # Half the sum of squares of a pose that meets both tolerances exactly, both counted in radians.
    least = 0.5 * level * level if both else 0.0
    for l in range(LANES):
        if scratch.best_error[l] == np.inf:
            continue
        weight = 0.0
        if task.position_weight > 0.0:
            weight = (level / near) ** 2 if both else 1.0 / (task.length * task.length)
        seeds.copy_joints(scratch.best, l, scratch.seed)
        for _ in range(BALANCES):
            squares = GoalArrays(target, weight, task.columns)
            walk = Walk(True, VALLEY_STEPS, least)
            spent += minimise(task.chain, squares, limits, walk, scratch.seed)
            forward(task.chain, scratch.seed, scratch.pose)
            position, orientation = errors(scratch.pose, goal)
            if position <= near and orientation <= level:
                scratch.best_error[0] = 0.0
                seeds.keep_joints(scratch.best, 0, scratch.seed)
                return spent
            # If one tolerance is missed by far, or both are missed, rebalancing does not lead to a solution.
            one = (position <= near) != (orientation <= level)
            if not (both and one and max(position / near, orientation / level) < BEARABLE):
                break
            # The new weight is the old one times the ratio of both errors, each as a multiple of its tolerance.
            weight *= position * level / max(orientation * near, SMALL)
            # `least` is valid for the first weight only.
            least = 0.0
    return spent


@inlined
def promise(task: Task) -> float:
    """Weighted error below which a goal is worth more work."""
    limit: float = PROMISING * (task.position_weight * task.length + 1.0)
    return limit


@inlined
def try_other_starts(job: Job, task: Task, scratch: Scratch, target: Array) -> int:
    """Reach the best pose found from other starts, one of which may lead to a better pose; return FK evaluations.

    The nearest poses to an unreachable goal often occur as mirror images, equally near except for the limits.
    """
    pose, spent, begin = scratch.pose, 0, -1
    seeds.copy_joints(scratch.best, descent.lowest_row(scratch.best_error), scratch.seed)
    forward(task.chain, scratch.seed, pose)
    descent.reset_weights(task, scratch)
    for l in range(LANES):
        seeds.load_target(scratch.lanes, l, pose)
    promising = descent.lowest(scratch.best_error) <= promise(task)
    found = seeds.look_up(task, scratch, pose, DEEP if promising else seeds.MORE)
    for _ in range(DEEP + 1):  # The flips, then passes that each use at least one sample.
        if begin == found:
            break
        if begin < 0:
            begin, filled = 0, fill_from_flips(task, scratch)
        else:
            begin, filled = seeds.fill_from_lookup(task, scratch, begin, found)
        if filled > 0:
            _, made = descent.descend_lanes(
                job, task, scratch, descent.DEEP_STEPS if promising else descent.FIRST_STEPS, True
            )
            spent += (made + 1) * LANES
            descent.keep_best(job, task, scratch, target)
    for l in range(LANES):
        seeds.load_target(scratch.lanes, l, target)
    return spent
