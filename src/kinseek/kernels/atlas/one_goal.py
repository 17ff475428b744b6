"""From the atlas to an answer: take the nearest samples, refine eight at a time, judge by plain forward kinematics.

The answer to a goal is what its nearest sample converges to; where that one fails, the next nearest, and so on. So the
answer depends on the goal alone, not on how many are solved beside it. A goal that no sample leads to gets deeper
lookups and low-discrepancy restarts; what is then still missed is out of reach, or as good as, and gets the best pose
found, polished under the goal's weights.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, is_rigid, weighted_error
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.jit import hidden, kernel, routine, spliced, view
from kinseek.kernels.pointers import call, part1, part2

from .lanes import (
    LANES,
    Lanes,
    lanes_forward,
    lanes_gram,
    lanes_hold,
    lanes_jacobian,
    lanes_move,
    lanes_residual,
    lanes_solve,
)
from .newton import STEPS as NEWTON_STEPS
from .newton import settle
from .samples import complete_seed, coordinates, nearest_copy, product
from .task import (
    DEEP,
    OPEN,
    WANTED,
    Desk,
    Job,
    Task,
    desk_size,
    handle_at,
    lanes_of,
    make_desk,
    plain_wanted,
    routine_at,
    task_of,
)
from .tree import nearest, scan_beside, take_nearest

FIRST, MORE, RESTARTS, MORE_RESTARTS = 8, 40, 64, 256
AT_ONCE = 4
"""Of the first samples, so many are refined side by side: the first nearly always leads to an answer."""

FIRST_STEPS, DEEP_STEPS, RESTART_STEPS, POLISH_STEPS = 10, 20, 30, 20
STALL, NEARLY = 6, 0.03
"""A descent is given up when no lane has halved its squared error in so many steps, unless one is as near as that."""

ENDGAME = 2 * (POLISH_STEPS + NEWTON_STEPS + 1) + (DEEP // LANES + 1) * (DEEP_STEPS + 1)
"""FK evaluations that the search for the nearest pose takes at most, a lane."""

PASSES = FIRST + MORE + DEEP + MORE_RESTARTS // LANES + 3
"""Passes of a search at most: each takes at least one sample of a scan or a lookup, eight restarts, or one of the two
persistent ones; and a last one that ends it."""

PERSIST_STEPS = 100
"""At a singular answer every step only halves the joint error, and a joint at its limit slows it down further."""

PROMISING = 0.02
"""Goals with a smaller error left, relative to the arm, are worth that many steps, and `MORE_RESTARTS`."""

HOPELESS = 1.1
"""A configuration whose error, nearly at its minimum, is so many times the best is not walked to the end."""

ALIKE = 0.3
"""Two configurations closer than this in every joint [rad or m] lead to the same end."""

MARGIN = 0.5
DAMPING = 0.1
LONGEST = 0.8


@hidden
def copy_joints(rows: Array, row: int, q: Array) -> None:
    """Copy one row of joint values."""
    for i in range(len(q)):
        q[i] = rows[row, i]


@hidden
def load_target(lanes: Lanes, lane: int, target: Array) -> None:
    """Give one lane its target, (3, 4)."""
    for r in range(3):
        for c in range(4):
            lanes.target[(4 * r + c) * LANES + lane] = target[r, c]


@hidden
def load_seed(lanes: Lanes, lane: int, seed: Array) -> None:
    """Put one lane at a start, (n,)."""
    for i in range(len(seed)):
        lanes.q[i, lane] = seed[i]


@hidden
def make_stubborn(lanes: Lanes, stubborn: float) -> None:
    """Make every other lane stubborn, or none, see `lanes_hold`; nothing is known of a last step."""
    for l in range(LANES):
        lanes.work[3 * LANES + l] = stubborn * (l % 2)
        for i in range(lanes.step.shape[0]):
            lanes.step[i, l] = 0.0


@hidden
def lowest(values: Array) -> float:
    """The least of some values."""
    least: float = values[0]
    for i in range(1, len(values)):
        least = min(least, values[i])
    return least


@hidden
def lowest_row(values: Array) -> int:
    """The first row that holds the least value."""
    row = 0
    for i in range(1, len(values)):
        if values[i] < values[row]:
            row = i
    return row


@hidden
def load_seed_row(lanes: Lanes, lane: int, rows: Array) -> None:
    """Put one lane at the start in its row, (LANES, n)."""
    for i in range(rows.shape[1]):
        lanes.q[i, lane] = rows[lane, i]


@hidden
def reset_weights(task: Task, desk: Desk) -> None:
    """Scale residuals so that metres and radians compare."""
    lanes = desk.lanes
    for c in range(3):
        desk.mode[c] = task.columns[c]
    desk.mode[3] = DAMPING
    for l in range(LANES):
        desk.floor[l] = 1e-11
        lanes.weight[l] = 1.0 / task.length
        lanes.weight[LANES + l] = 1.0 if task.columns[0] > 0.0 else 0.0


@view
def goal_of(task: Task, target: Array) -> GoalArrays:
    """A target, (3, 4), with the weights of the task."""
    return GoalArrays(target, task.wanted[2], task.axis_weights)


@hidden
def free_turn(task: Task) -> float:
    """Return 1 if a turn about the tool's x axis does not count, else 0."""
    return 1.0 if task.columns[0] > 0.0 and task.columns[1] == 0.0 else 0.0


@view
def iterate(handle: Indices, wanted: Array, memory: Array, move: bool, w: int) -> int:
    """One damped step of every lane, if `move`, and the poses, residuals and errors where it ends."""
    at = (handle.ctypes.data, wanted.ctypes.data, memory.ctypes.data)
    done: int = call(routine_at(handle, ITERATE), (*at, int(move), w))
    return done


@routine("int64(int64, int64, int64, int64, int64)")
def iterate_routine(handle_address: int, wanted_address: int, memory_address: int, move: int, w: int) -> int:
    """See `iterate`."""
    handle, wanted = handle_at(handle_address), part1(wanted_address, 0, WANTED)
    task = task_of(handle, wanted)
    memory = part1(memory_address, 0, desk_size(len(task.lower), len(task.chain.leader)))
    desk = make_desk(memory, len(task.lower), len(task.chain.leader))
    lanes, mode = desk.lanes, desk.mode  # The columns' weights and the damping.
    if move:
        lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
        lanes_hold(task.lower, task.upper, lanes, w)
        lanes_gram(mode[3], desk.floor, lanes, w)
        lanes_solve(lanes, w)
        lanes_move(task.lower, task.upper, LONGEST, lanes, w)
    lanes_forward(task.chain.leader, task.links, lanes, w)
    lanes_residual(lanes, mode, w)
    return 0


@hidden
def within(task: Task, lanes: Lanes, l: int) -> bool:
    """Is lane l inside both tolerances?"""
    position, orientation = task.wanted[0], task.wanted[1]
    if lanes.error[l] > position * position:
        return False
    if task.columns[0] == 0.0:
        return True
    # The weighted cosine of a pose is (1 + 2 cos φ)/2, of a direction cos φ.
    cosine = lanes.error[2 * LANES + l]
    ahead = cosine > 0.5 if task.columns[1] > 0.0 else cosine > 0.0
    # sin φ ≤ sin t where φ < t < π/2; for small t the sine is t less t³/6, on the safe side.
    bound = min(orientation, 1.5)
    bound -= bound * bound * bound / 6.0
    small: bool = lanes.error[LANES + l] <= bound * bound
    return ahead and small


@hidden
def see(task: Task, desk: Desk, target: Array) -> None:
    """Write a target, (3, 4), as the atlas sees it into the desk."""
    product(task.atlas.inverse_head, target, desk.between)
    product(desk.between, task.atlas.inverse_tip, desk.seen)


@hidden
def look_up(task: Task, desk: Desk, target: Array, wanted: int) -> int:
    """Find the samples nearest to a target, (3, 4); return how many."""
    see(task, desk, target)
    coordinates(desk.seen, task.division, desk.point)
    return nearest(task.atlas.tree, desk.point, wanted, desk.distance, desk.neighbour, desk.stack, desk.bound)


@hidden
def descend_lanes(job: Job, task: Task, desk: Desk, steps: int, everyone: bool, w: int) -> tuple[int, int]:
    """Refine the eight lanes; return the first lane that converged, or -1, and the steps made.

    The nearest seed has the first say: a later lane's answer counts only once all before it have had their steps. With
    `everyone`, every lane gets its steps. All stop where none has come much nearer for a while: such a goal is out of reach,
    or another seed is needed.
    """
    lanes, dof = desk.lanes, len(task.lower)
    for made in range(steps + 1):
        iterate(job.handle, job.wanted, job.memory, made > 0, w)
        waiting, first = 0, -1
        for l in range(LANES):
            if desk.state[l] == 0 and within(task, lanes, l):
                desk.state[l] = 1
                for i in range(dof):
                    desk.found[l, i] = lanes.q[i, l]
            if desk.state[l] == 0:
                waiting += 1
            elif desk.state[l] == 1 and first < 0:
                first = l
                if waiting == 0 and not everyone:
                    return first, made
        if waiting == 0 or made == steps:
            return first, made
        if made % STALL == 0 and steps > FIRST_STEPS:
            moving = made == 0
            for l in range(LANES):
                error = lanes.error[3 * LANES + l]
                hopeful = error < 0.5 * lanes.work[LANES + l] or error < NEARLY * NEARLY
                moving = moving or (desk.state[l] == 0 and hopeful)
                lanes.work[LANES + l] = error
            if not moving:
                return first, made
    return -1, steps  # Never: the last step returns.


@hidden
def farthest_joint(rows: Array, row: int, q: Array) -> float:
    """The largest difference of a joint between a row and q, (n,), [rad or m]."""
    far = 0.0
    for i in range(len(q)):
        far = max(far, abs(rows[row, i] - q[i]))
    return far


@hidden
def keep_seed(desk: Desk, error: float) -> None:
    """Put the desk's seed among the eight best if its weighted error is less than the worst's, or its twin's.

    No two of the eight are alike: eight copies of one configuration would all be polished to the same end.
    """
    worst, twin = 0, -1
    for k in range(LANES):
        if desk.best_error[k] > desk.best_error[worst]:
            worst = k
        if desk.best_error[k] < np.inf and farthest_joint(desk.best, k, desk.seed) < ALIKE:
            twin = k
    worst = twin if twin >= 0 else worst
    if error < desk.best_error[worst]:
        desk.best_error[worst] = error
        for i in range(len(desk.seed)):
            desk.best[worst, i] = desk.seed[i]


@hidden
def keep_best(task: Task, desk: Desk, target: Array) -> None:
    """Remember the eight best configurations seen, no two alike, for a goal that may be out of reach."""
    dof, goal = len(task.lower), goal_of(task, target)
    for l in range(LANES):
        if desk.state[l] == 2:
            continue
        for i in range(dof):
            desk.seed[i] = desk.lanes.q[i, l]
        forward(task.chain, desk.seed, desk.spare)
        keep_seed(desk, weighted_error(desk.spare, goal))


@hidden
def fill_from_lookup(task: Task, desk: Desk, begin: int, found: int) -> tuple[int, int]:
    """Put neighbours into the lanes from number `begin` on; return the next number and the lanes filled."""
    filled = 0
    while begin < found and filled < LANES:
        i = desk.neighbour[begin]
        begin += 1
        if complete_seed(
            task.atlas, task.division, desk.seen, i, task.chain.lower, task.chain.upper, MARGIN, desk.seed
        ):
            load_seed(desk.lanes, filled, desk.seed)
            desk.state[filled] = 0
            filled += 1
    for l in range(filled, LANES):
        desk.state[l] = 2
    return begin, filled


@hidden
def fill_from_flips(task: Task, desk: Desk) -> int:
    """Put flips of the best into the lanes, ``(q_i + π, -q_{i+1}, q_{i+2} + π)``; return the lanes filled.

    Where three axes meet, a shoulder or a wrist, that is another way to hold the hand just so; elsewhere it is a start.
    """
    chain, best, filled = task.chain, lowest_row(desk.best_error), 0
    for i in range(1, len(task.lower) - 1):
        if filled == LANES:
            break
        copy_joints(desk.best, best, desk.seed)
        desk.seed[i - 1] += math.pi
        desk.seed[i] *= -1.0
        desk.seed[i + 1] += math.pi
        for j in range(i - 1, i + 2):
            low, high = chain.lower[j], chain.upper[j]
            value = nearest_copy(desk.seed[j], low, high, 0.5 * (low + high))
            desk.seed[j] = min(max(value, low), high)
        load_seed(desk.lanes, filled, desk.seed)
        desk.state[filled] = 0
        filled += 1
    for l in range(filled, LANES):
        desk.state[l] = 2
    return filled


@hidden
def scan(task: Task, desk: Desk, target: Array) -> int:
    """Measure the samples beside a target, (3, 4), for `fill_from_scan`; return the leaf it lies in."""
    see(task, desk, target)
    coordinates(desk.seen, task.division, desk.point)
    return scan_beside(task.atlas.tree, desk.point, desk.distance, desk.bound)


@hidden
def take_seed(task: Task, desk: Desk, leaf: int) -> tuple[bool, bool]:
    """Put the next sample of a scan into the desk's seed; say whether there was one, and whether it is worth a try."""
    i = take_nearest(task.atlas.tree, leaf, desk.distance, desk.bound)
    if i < 0:
        return False, False
    chain = task.chain
    return True, complete_seed(
        task.atlas, task.division, desk.seen, i, chain.lower, chain.upper, MARGIN, desk.seed
    )


@hidden
def fill_from_scan(task: Task, desk: Desk, leaf: int, taken: int) -> tuple[int, int]:
    """Put the next samples of a scan into lanes; return how many are taken by now and the lanes filled."""
    filled, more = 0, True
    while more and taken < FIRST and filled < AT_ONCE:
        more, worth = take_seed(task, desk, leaf)
        taken = taken + 1 if more else FIRST
        if worth:
            load_seed(desk.lanes, filled, desk.seed)
            desk.state[filled] = 0
            filled += 1
    for l in range(filled, LANES):
        desk.state[l] = 2
    return taken, filled


@hidden
def turns_fully(task: Task, i: int) -> bool:
    """Does the range of joint i hold a full turn? Then its limits are open, infinitely so where it never ends."""
    full: bool = task.lower[i] <= -OPEN
    return full


@hidden
def into_limits(task: Task, q: Array, near: Array) -> None:
    """Bring every joint that turns fully inside its limits by whole turns, near `near`, (n,).

    A continuous joint has no limits: it comes within π of `near`, whose middle of the range, 0, makes that [-π, π].
    """
    for i in range(len(q)):
        low, high = task.chain.lower[i], task.chain.upper[i]
        if turns_fully(task, i):
            if math.isinf(task.lower[i]):
                low, high = near[i] - math.pi, near[i] + math.pi
            q[i] = nearest_copy(q[i], low, high, near[i])
        q[i] = min(max(q[i], low), high)


@hidden
def middle(task: Task, q: Array) -> None:
    """Write the middle of every range into q, (n,)."""
    for i in range(len(q)):
        q[i] = 0.5 * (task.chain.lower[i] + task.chain.upper[i])


@hidden
def restart(task: Task, number: int, q: Array) -> None:
    """Write start `number` of a low-discrepancy sequence over the limits (Roberts 2018, R_d)."""
    dof = len(q)
    g = 2.0
    for _ in range(30):
        g = (1.0 + g) ** (1.0 / (dof + 1))
    step = 1.0
    for i in range(dof):
        step /= g
        low, high = task.chain.lower[i], task.chain.upper[i]
        q[i] = low + ((0.5 + (number + 1) * step) % 1.0) * (high - low)


@hidden
def kick(task: Task, rows: Array, row: int, size: float, q: Array) -> None:
    """Turn a start that is spread over the limits, (n,), into one around a row, brought back to the limits.

    Answers hide in the corners of the limits, where a start inside leads past them; here many starts lie in one.
    """
    for i in range(len(q)):
        low, high = task.chain.lower[i], task.chain.upper[i]
        share = (q[i] - low) / max(high - low, 1e-12) - 0.5
        q[i] = min(max(rows[row, i] + size * share * min(high - low, 1.0), low), high)


@hidden
def start(task: Task, desk: Desk, target: Array) -> None:
    """Clear the desk for a target, (3, 4)."""
    for l in range(LANES):
        load_target(desk.lanes, l, target)
        desk.best_error[l] = np.inf
    reset_weights(task, desk)


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


@view
def find_nearest_pose(handle: Indices, wanted: Array, memory: Array, target: Array, w: int) -> int:
    """Lead the eight best to the nearest pose to a target, (3, 4), that is out of reach; return FK evaluations."""
    at = (handle.ctypes.data, wanted.ctypes.data, memory.ctypes.data, target.ctypes.data)
    spent: int = call(routine_at(handle, ENDING), (*at, w))
    return spent


@routine("int64(int64, int64, int64, int64, int64)")
def ending_routine(
    handle_address: int, wanted_address: int, memory_address: int, target_address: int, w: int
) -> int:
    """See `find_nearest_pose`."""
    handle, wanted = handle_at(handle_address), part1(wanted_address, 0, WANTED)
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory, target = part1(memory_address, 0, desk_size(dof, joints)), part2(target_address, 0, 3, 4)
    desk, job = make_desk(memory, dof, joints), Job(handle, wanted, memory)
    spent = 0
    for turn in range(2):
        if turn > 0:
            spent += look_around(job, task, desk, target, w)
        spent += polish(job, task, desk, target, w)
    return spent


@spliced
def polish(job: Job, task: Task, desk: Desk, target: Array, w: int) -> int:
    """Minimise the weighted error itself from the eight best, by reweighted steps; return FK evaluations.

    ``K_P |Δp| + ½ Σ K_c |c - c_g|²`` has in |Δp| a kink that least squares lacks: the squared distance is weighted by
    K_P/|Δp|, anew in every step (Weiszfeld 1937). A lane whose step does not help goes back and damps more. Newton's
    method, lane by lane, does the rest.
    """
    goal, lanes, dof, floor = goal_of(task, target), desk.lanes, len(task.lower), desk.floor
    largest = max(goal.axis_weights[0], goal.axis_weights[1], goal.axis_weights[2])
    for l in range(LANES):
        floor[l] = 0.1 * (goal.position_weight * task.length + largest)
        desk.state[l] = 0
        load_seed_row(lanes, l, desk.best)
        lanes.weight[LANES + l] = math.sqrt(largest)
    for c in range(3):
        desk.mode[c] = goal.axis_weights[c]
    desk.mode[3] = 0.0
    for step in range(POLISH_STEPS):
        iterate(job.handle, job.wanted, job.memory, step > 0, w)
        for l in range(LANES):
            for r in range(3):
                for c in range(4):
                    desk.spare[r, c] = lanes.pose[(4 * r + c) * LANES + l]
            error = weighted_error(desk.spare, goal)
            far = math.sqrt(goal.position_weight / max(math.sqrt(lanes.error[l]), 1e-9))
            # Rows are scaled by the roots of the weights. The orientation rows hold K_A times √K_A by now.
            scale_p, scale_o = far / lanes.weight[l], 1.0 / largest if largest > 0.0 else 0.0
            lanes.weight[l] = far
            if error <= desk.best_error[l]:
                if desk.state[l] == 0:
                    floor[l] = max(0.3 * floor[l], 1e-9)
                desk.state[l] = 0
                desk.best_error[l] = error
                for i in range(dof):
                    desk.best[l, i] = lanes.q[i, l]
            else:
                floor[l] *= 4.0
                desk.state[l] = 1
                load_seed_row(lanes, l, desk.best)
                scale_p, scale_o = 0.0, 0.0  # This lane stands still once, and steps anew from its best.
            for r in range(3):
                lanes.residual[r * LANES + l] *= scale_p
                lanes.residual[(3 + r) * LANES + l] *= scale_o
    spent, worth = POLISH_STEPS * LANES, HOPELESS * lowest(desk.best_error)
    for l in range(LANES):
        if desk.best_error[l] > worth:
            continue
        copy_joints(desk.best, l, desk.seed)
        spent += settle(task.chain, goal, task.lower, task.upper, desk.seed)
        forward(task.chain, desk.seed, desk.spare)
        error = weighted_error(desk.spare, goal)
        if error < desk.best_error[l]:
            desk.best_error[l] = error
            for i in range(dof):
                desk.best[l, i] = desk.seed[i]
    return spent


@hidden
def promise(task: Task) -> float:
    """A goal with a smaller weighted error left is worth more work."""
    limit: float = PROMISING * (task.wanted[2] * task.length + 1.0)
    return limit


@spliced
def look_around(job: Job, task: Task, desk: Desk, target: Array, w: int) -> int:
    """Reach the best pose found by other ways, for one of them may lead on to a better; return FK evaluations.

    The nearest poses to a goal out of reach often come in mirror images, as near as each other but for the limits.
    """
    pose, spent, begin = desk.spare, 0, -1
    copy_joints(desk.best, lowest_row(desk.best_error), desk.seed)
    forward(task.chain, desk.seed, pose)
    reset_weights(task, desk)
    for l in range(LANES):
        load_target(desk.lanes, l, pose)
    promising = lowest(desk.best_error) <= promise(task)
    found = look_up(task, desk, pose, DEEP if promising else MORE)
    for _ in range(DEEP + 1):  # The flips, then passes that each take at least one of the samples.
        if begin == found:
            break
        if begin < 0:
            begin, filled = 0, fill_from_flips(task, desk)
        else:
            begin, filled = fill_from_lookup(task, desk, begin, found)
        if filled > 0:
            _, made = descend_lanes(job, task, desk, DEEP_STEPS if promising else FIRST_STEPS, True, w)
            spent += (made + 1) * LANES
            keep_best(task, desk, target)
    for l in range(LANES):
        load_target(desk.lanes, l, target)
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


ITERATE, SEARCH, ENDING = range(3)
"""Places of the routines among those of a task, see `desk.task_arrays`."""


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
