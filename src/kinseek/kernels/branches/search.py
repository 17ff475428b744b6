"""Every answer to a goal: many starts side by side, and from each answer found the way to its siblings.

The starts are the nearest of a coarse atlas. Coarse is better here: of a thousand samples the nearest sixty lie all over
the joint space, of sixteen thousand they crowd around the answers where the map is steep. Two kinds of siblings are found
from an answer itself, at hardly any cost:

- its *twin* across a singularity. Along the weakest direction v of the Jacobian, with u where it leads and σ how much,
  the pose moves by ``σ t + ½ t² u·H(v, v)`` to second order, which is zero again at ``t = -2 σ / u·H(v, v)``. Close to a
  singularity no start would tell the two apart.
- its *mirror images*. An arm with a spherical wrist has every pose at (…, q_4 + π, -q_5, q_6 + π) too. Such images are
  found once per arm (see `solvers.branching`).

What is found late, close to a singularity, or in an odd number where joints turn fully, calls for more starts: away
from singularities answers come and go in pairs, and only limits make their number odd.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arm.forward import forward
from kinseek.kernels.arm.pose_error import errors, is_rigid
from kinseek.kernels.arrays import Array, GoalArrays, Indices
from kinseek.kernels.atlas.batch import stand_still
from kinseek.kernels.atlas.lanes import (
    LANES,
    Lanes,
    lanes_forward,
    lanes_gram,
    lanes_jacobian,
    lanes_residual,
    lanes_solve,
)
from kinseek.kernels.atlas.one_goal import (
    MARGIN,
    free_turn,
    into_limits,
    iterate,
    kick,
    restart,
    see,
    solve_pose,
    start,
    within,
)
from kinseek.kernels.atlas.one_goal import turns_fully as turns
from kinseek.kernels.atlas.samples import complete_seed, coordinates, nearest_copy
from kinseek.kernels.atlas.task import Desk, Task, desk_size, make_desk, task_of
from kinseek.kernels.atlas.tree import nearest
from kinseek.kernels.jit import hidden, kernel

STARTS, MORE_STARTS, DEEP_STARTS = 80, 112, 448
"""Samples tried for every goal, for one whose starts came to an end soon, and for one that may have more answers."""

SOON = 320
"""FK evaluations up to which more starts cost little."""

WEAK = 0.02
"""Singular value of the scaled Jacobian at an answer below which others may hide beside it."""

LATE = 0.6
"""A new answer after this share of the starts casts doubt on the rest."""

ROWS = 64
"""Answers kept at most. Six joints have sixteen isolated ones at most (Primrose 1986): more is a continuum."""

SEEDED, SIBLING, SAMPLED = 0, 1, 2
"""How `refine_all` treats its starts: give up those that lead to what is known; never that; take what is good enough."""

STEPS, SIBLING_STEPS, MORE_STEPS = 12, 20, 20
"""Steps of a start, of a sibling, and more for one that is within the tolerances and not exact yet."""

EXACT = 1e-22
"""Squared scaled error to converge to, so that answers near a singularity can be told apart."""

EQUAL, ALIKE = 1e-4, 0.1
"""Answers this close [rad or m] are one. At a singularity, where a start may get no closer than the tolerances, so are
those alike that meet them half-way as well."""

PATIENCE, STRIKES, WORTH = 4, 3, 0.7
"""From this step on, that many steps which leave more than this share of the squared error end a start."""

NEAR, HEADING, WITHIN_SIGHT = 0.1, 0.5, 0.6
"""A start ends this close to a known answer, or within sight of it if the last step halved the distance."""

FAR = 2.0
"""Twins farther off than this [rad] are left to the starts: the second order does not reach there."""

SINGULAR = 0.1
"""How much of a step is left, where J makes nothing of it, for the Jacobian to count as singular to rounding."""

PROBE, FLAT = 0.05, 1e-6
"""Length of the probing step along the weakest direction, and the scaled error along it that tells a continuum."""


SAMPLE_ROUNDS, SAMPLE_KICK = 16, 1.5
"""Rounds of starts around what was found, and how far around [rad or m], where a sample comes out too small."""


@hidden
def joint_gap(a: float, b: float, rate: float) -> float:
    """Difference of two joint values, the short way round where `rate` is one over 2π and not 0."""
    gap: float = a - b
    gap -= 2.0 * math.pi * np.floor(gap * rate + 0.5)
    return gap


@hidden
def squared_gap(rates: Array, rows: Array, row: int, q: Array) -> float:
    """Squared distance between a row of joint values and q, modulo full turns."""
    total = 0.0
    for i in range(len(q)):
        gap = joint_gap(rows[row, i], q[i], rates[i])
        total += gap * gap
    return total


@hidden
def match(
    task: Task,
    desk: Desk,
    goal: GoalArrays,
    rates: Array,
    rows: Array,
    left: Array,
    count: int,
    error: float,
    q: Array,
    half: Array,
) -> int:
    """Return which of the first `count` rows q is, or -1.

    Args:
        task: The task.
        desk: Its memory.
        goal: The goal.
        rates: See `joint_gap`, (n,).
        rows: Answers, (capacity, n).
        left: Their squared scaled errors, (capacity,).
        count: How many there are.
        error: That of q.
        q: Joint values, (n,).
        half: Memory, (n,).
    """
    for j in range(count):
        gap = squared_gap(rates, rows, j, q)
        if gap < EQUAL * EQUAL:
            return j
        if gap < ALIKE * ALIKE and max(error, left[j]) > EXACT:
            for i in range(len(q)):
                half[i] = q[i] + 0.5 * joint_gap(rows[j, i], q[i], rates[i])
            forward(task.chain, half, desk.spare)
            position, orientation = errors(desk.spare, goal)
            if position <= task.wanted[0] and orientation <= task.wanted[1]:
                return j
    return -1


@hidden
def heads_for_known(lanes: Lanes, l: int, rates: Array, rows: Array, count: int) -> bool:
    """Is lane l at a known answer, or did its last step bring it much closer to one?"""
    for j in range(count):
        now, before = 0.0, 0.0
        for i in range(rows.shape[1]):
            gap = joint_gap(lanes.q[i, l], rows[j, i], rates[i])
            now += gap * gap
            gap -= lanes.work[l] * lanes.step[i, l]
            before += gap * gap
        if now < NEAR * NEAR or (now < WITHIN_SIGHT * WITHIN_SIGHT and now < HEADING * HEADING * before):
            return True
    return False


@kernel
def refine_all(
    handle: Indices,
    wanted: Array,
    memory: Array,
    target: Array,
    seeds: Array,
    first: int,
    last: int,
    rows: Array,
    left: Array,
    count: int,
    rates: Array,
    mode: int,
    spent: Array,
    w: int,
) -> int:
    """Refine seeds first … last-1, a lane that is done taking the next; append new answers; return how many there are.

    Args:
        handle: The task, see `task_of`.
        wanted: See `task_of`.
        memory: The desk, its target and weights set.
        target: (4, 4), lengths in [m].
        seeds: Joint values to start from, (k, n).
        first: First seed.
        last: One past the last seed.
        rows: Answers, (capacity, n).
        left: Their squared scaled errors, (capacity,).
        count: How many are known already.
        rates: See `joint_gap`, (n,).
        mode: SEEDED, SIBLING or SAMPLED.
        spent: Its first number is increased by the FK evaluations spent, (3,).
        w: LANES.
    """
    task = task_of(handle, wanted)
    dof = len(task.lower)
    desk = make_desk(memory, dof, len(task.chain.leader))
    goal, lanes = GoalArrays(target, task.wanted[2], task.axis_weights), desk.lanes
    busy, made = np.zeros(LANES, dtype=np.int64), np.zeros(LANES, dtype=np.int64)
    strikes, before, half = np.zeros(LANES, dtype=np.int64), np.zeros(LANES), np.zeros(dof)
    number, active, most = first, 0, SIBLING_STEPS if mode == SIBLING else STEPS
    exact = 1e300 if mode == SAMPLED else EXACT
    for l in range(LANES):
        stand_still(lanes, l)
    # Every start has so many steps at most, and in one lane they would be made one after the other.
    for _ in range((last - first) * (most + MORE_STEPS) + 1):
        for l in range(LANES):
            if busy[l] == 0 and number < last:
                for i in range(dof):
                    lanes.q[i, l] = seeds[number, i]
                stand_still(lanes, l)
                busy[l], made[l], strikes[l] = 1, 0, 0
                number += 1
                active += 1
        if active == 0 or count == len(rows):
            break
        iterate(handle, wanted, memory, True, w)
        for l in range(LANES):
            if busy[l] == 0:
                continue
            spent[0] += 1.0
            made[l] += 1
            error, done = lanes.error[3 * LANES + l], made[l] >= most
            if made[l] > 1 and error > WORTH * before[l]:
                strikes[l] += 1
            before[l] = error
            if within(task, lanes, l):
                done = error < exact or made[l] >= most + MORE_STEPS
                if done and count < len(rows):
                    for i in range(dof):
                        desk.seed[i] = lanes.q[i, l]
                    j = -1
                    if mode != SAMPLED:
                        j = match(task, desk, goal, rates, rows, left, count, error, desk.seed, half)
                    if j < 0:
                        j = count
                        count += 1
                        left[j] = np.inf
                    if error < left[j]:
                        left[j] = error
                        for i in range(dof):
                            rows[j, i] = desk.seed[i]
            elif not done:
                done = made[l] >= PATIENCE and strikes[l] >= STRIKES
                if mode == SEEDED and made[l] > 1 and not done:
                    done = heads_for_known(lanes, l, rates, rows, count)
            if done:
                busy[l] = 0
                active -= 1
    memory[0] += 0.0  # Its last use, see `solve_pose`.
    return count


@kernel
def twins(
    handle: Indices,
    wanted: Array,
    memory: Array,
    rows: Array,
    first: int,
    last: int,
    seeds: Array,
    spent: Array,
    w: int,
) -> int:
    """Write where the twins of answers first … last-1, at most LANES, should be into seeds; return how many.

    The second number of `spent` is increased by the answers that lie on a continuum of answers: those whose pose stays
    where it is along the weakest direction, to second order. The third becomes the least singular value of their
    scaled Jacobians, if it is less.
    """
    task = task_of(handle, wanted)
    dof = len(task.lower)
    desk = make_desk(memory, dof, len(task.chain.leader))
    lanes, W = desk.lanes, LANES
    U, e, J, work = lanes.gram, lanes.residual, lanes.jacobian, lanes.work
    way = np.empty(dof)
    for l in range(LANES):
        for i in range(dof):
            lanes.q[i, l] = rows[min(first + l, last - 1), i]
        desk.floor[l] = 1e-13 if dof >= 6 else 1e-9  # Rows that no joint can move make J Jᵀ singular.
        work[W + l] = 0.0
    for phase in range(3):
        lanes_forward(task.chain.leader, task.links, lanes, w)
        lanes_residual(lanes, desk.mode, w)
        if phase == 0:
            lanes_jacobian(task.chain.leader, task.links, lanes, free_turn(task), w)
            lanes_gram(0.0, desk.floor, lanes, w)
            for i in range(dof):
                for l in range(w):
                    lanes.step[i, l] = 1.0 - 0.27 * i
            # Inverse iteration, u → (J Jᵀ)⁻¹ u; where there are rows that no joint moves, v → Jᵀ (J Jᵀ)⁻² J v. Exactly at a
            # singularity Jᵀ u leads nowhere; there the last turn takes what J makes nothing of, v - Jᵀ (J Jᵀ)⁻¹ J v.
            for turn in range(6):
                if turn == 5 or (dof < 6 and turn not in (1, 3)):
                    fresh = 1.0 if turn in (0, 5) else 0.0
                    for r in range(6 * LANES):
                        e[r] = 0.0
                    for i in range(dof):
                        for r in range(6):
                            for l in range(w):
                                v = fresh * (1.0 - 0.27 * i) + (1.0 - fresh) * lanes.step[i, l]
                                e[r * W + l] += J[i, r * W + l] * v
                elif turn == 0:
                    for r in range(6):
                        for l in range(w):
                            e[r * W + l] = 1.0 - 0.27 * r
                lanes_solve(lanes, w)
                if turn < 5:
                    for l in range(w):
                        size = 1e-300
                        for r in range(6):
                            size += e[r * W + l] * e[r * W + l]
                        size = 1.0 / math.sqrt(size)
                        for r in range(6):
                            e[r * W + l] *= size
                if turn in (0, 2):
                    continue
                for l in range(w):
                    size = 1e-300
                    for i in range(dof):
                        d = 0.0
                        for r in range(6):
                            d += J[i, r * W + l] * e[r * W + l]
                        d = 1.0 - 0.27 * i - d if turn == 5 else d
                        size += d * d
                        way[i] = d
                    size = math.sqrt(size)
                    if turn == 5 and size < SINGULAR:
                        continue
                    work[l] = 0.0 if turn == 5 else size
                    for i in range(dof):
                        lanes.step[i, l] = way[i] / size
                if turn == 4:
                    for r in range(6 * LANES):
                        lanes.pose[r] = e[r]  # Kept there until the gram matrix gives way to it.
            for r in range(6 * LANES):
                U[r] = lanes.pose[r]
        else:
            for l in range(w):
                for r in range(6):
                    work[W + l] += e[r * W + l] * U[r * W + l]
        shift = -2.0 * PROBE if phase == 1 else PROBE
        for i in range(dof):
            for l in range(w):
                lanes.q[i, l] += shift * lanes.step[i, l]
    many = 0
    for l in range(LANES):
        desk.floor[l] = 1e-11
        if first + l >= last:
            continue
        spent[0] += 3.0
        spent[2] = min(spent[2], work[l])
        moved, bend = work[l] * PROBE, work[W + l]
        if moved < FLAT and abs(bend) < FLAT:
            spent[1] += 1.0
        if 2.0 * moved * PROBE < FAR * abs(bend):
            t = 2.0 * moved * PROBE / bend
            for i in range(dof):
                value = lanes.q[i, l] + t * lanes.step[i, l]
                seeds[many, i] = min(max(value, task.lower[i]), task.upper[i])
            many += 1
    memory[0] += 0.0  # Its last use, see `solve_pose`.
    return many


@hidden
def images(
    task: Task,
    mirrors: Array,
    rates: Array,
    rows: Array,
    first: int,
    last: int,
    seeds: Array,
    many: int,
    image: Array,
) -> int:
    """Append the mirror images of answers first … last-1 that are not known to seeds; return how many there are."""
    for j in range(first, last):
        for k in range(len(mirrors)):
            fits = many < len(seeds)
            for i in range(len(image)):
                low, high = task.chain.lower[i], task.chain.upper[i]
                value = mirrors[k, 0, i] * rows[j, i] + mirrors[k, 1, i]
                if mirrors[k, 2, i] > 0.0:
                    value = nearest_copy(value, low, high, 0.5 * (low + high))
                fits = fits and low - EQUAL <= value <= high + EQUAL
                image[i] = min(max(value, low), high)
            for c in range(last):
                fits = fits and squared_gap(rates, rows, c, image) > EQUAL * EQUAL
            if fits:
                for i in range(len(image)):
                    seeds[many, i] = image[i]
                many += 1
    return many


@hidden
def starts(
    task: Task,
    desk: Desk,
    wanted: int,
    begin: int,
    distance: Array,
    neighbour: Indices,
    seeds: Array,
) -> int:
    """Complete the samples from number `begin` to number `wanted` into seeds, nearest first; return how many."""
    found = nearest(task.atlas.tree, desk.point, wanted, distance, neighbour, desk.stack, desk.bound)
    lower, upper, many = task.chain.lower, task.chain.upper, 0
    for k in range(begin, found):
        if complete_seed(task.atlas, task.division, desk.seen, neighbour[k], lower, upper, MARGIN, desk.seed):
            for i in range(len(desk.seed)):
                seeds[many, i] = desk.seed[i]
            many += 1
    return many


@hidden
def in_doubt(task: Task, count: int) -> bool:
    """Is the number of answers suspicious: none, or odd where no joint has limits?"""
    full = True
    for i in range(len(task.lower)):
        full = full and turns(task, i)
    return count == 0 or (full and count % 2 == 1)


@hidden
def sorted_rows(
    task: Task, desk: Desk, target: Array, rows: Array, count: int, centre: Array, scale: Array, result: Array
) -> int:
    """Judge rows by plain FK, and write those that reach the target sorted by their distance from `centre`.

    Each row of the result is q, position error [m], orientation error [rad] and squared scaled distance, (n + 3,).
    """
    goal, dof, kept = GoalArrays(target, task.wanted[2], task.axis_weights), len(centre), 0
    for j in range(count):
        for i in range(dof):
            desk.seed[i] = rows[j, i]
        into_limits(task, desk.seed, centre)
        forward(task.chain, desk.seed, desk.spare)
        position, orientation = errors(desk.spare, goal)
        if position > task.wanted[0] or orientation > task.wanted[1]:
            continue
        score = 0.0
        for i in range(dof):
            gap = desk.seed[i] - centre[i]
            if math.isinf(task.lower[i]):
                gap = joint_gap(desk.seed[i], centre[i], 0.5 / math.pi)
            score += gap * gap * scale[i] * scale[i]
        at = kept
        while at > 0 and result[at - 1, dof + 2] > score:
            for i in range(dof + 3):
                result[at, i] = result[at - 1, i]
            at -= 1
        for i in range(dof):
            result[at, i] = desk.seed[i]
        result[at, dof], result[at, dof + 1], result[at, dof + 2] = position, orientation, score
        kept += 1
    return kept


@kernel
def find_branches(
    handle: Indices,
    fine: Indices,
    wanted: Array,
    mirrors: Array,
    target: Array,
    view: Array,
    w: int,
) -> Array:
    """Find all answers to one target, for an arm and a goal that leave no freedom.

    Args:
        handle: The task with the coarse atlas, see `task_of`.
        fine: The task with the fine atlas, for a target that no coarse sample leads to.
        wanted: See `task_of`.
        mirrors: Signs, shifts and 1 for joints that turn, of each mirror image, (k, 3, n).
        target: (4, 4), lengths in [m].
        view: Where the answers are seen from, the weight of each joint, and one over 2π for each that has the same pose
            after a full turn, else 0, (3, n): they come sorted by weighted distance.
        w: LANES.

    Returns:
        Joint values, position error [m], orientation error [rad] and squared distance of each answer; a last row with their
        number, FK evaluations, and 1 if they belong to a continuum, (k + 1, n + 3). No row if the target is no
        rigid transform.
    """
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return np.empty((0, dof + 3))
    memory = np.zeros(desk_size(dof, joints))
    desk = make_desk(memory, dof, joints)
    rows, seeds = np.empty((ROWS, dof)), np.empty((DEEP_STARTS, dof))
    distance, neighbour = np.empty(DEEP_STARTS), np.empty(DEEP_STARTS, dtype=np.int64)
    spent, image, left = np.zeros(3), np.empty(dof), np.empty(ROWS)
    spent[2] = np.inf
    start(task, desk, target)
    see(task, desk, target)
    coordinates(desk.seen, task.division, desk.point)
    count, told, rounds, begin, late = 0, 0, 0, STARTS, False
    # Each pass tells of an answer at least, or goes on to the next of five kinds of starts.
    for _ in range(ROWS + 5):
        if count >= ROWS:
            break
        mode, first, middle = SEEDED, count, 0
        if told < count:
            last = min(count, told + LANES)
            many = twins(handle, wanted, memory, rows, told, last, seeds, spent, w)
            many = images(task, mirrors, view[2], rows, told, last, seeds, many, image)
            mode, told = SIBLING, last
        elif rounds == 0:
            many = starts(task, desk, STARTS, 0, distance, neighbour, seeds)
            middle = int(LATE * many)
            rounds = 1
        elif rounds == 1 and (late or spent[2] < WEAK or in_doubt(task, count)):
            many = starts(task, desk, DEEP_STARTS, begin, distance, neighbour, seeds)
            rounds = 2
        elif rounds == 1 and begin == STARTS and spent[0] < SOON:
            many = starts(task, desk, MORE_STARTS, begin, distance, neighbour, seeds)
            begin = MORE_STARTS
        elif rounds == 2 and count == 0:
            other = solve_pose(fine, wanted, target, w)
            spent[0] += other[dof + 3]
            for i in range(dof):
                seeds[0, i] = other[i]
            mode, many, rounds = SIBLING, 1, 3
        else:
            break
        count = refine_all(
            handle, wanted, memory, target, seeds, 0, middle, rows, left, count, view[2], mode, spent, w
        )
        first = count
        count = refine_all(
            handle, wanted, memory, target, seeds, middle, many, rows, left, count, view[2], mode, spent, w
        )
        late = late or (middle > 0 and count > first)
    result = np.empty((count + 1, dof + 3))
    result[count, 0] = sorted_rows(task, desk, target, rows, count, view[0], view[1], result)
    result[count, 1], result[count, 2] = spent[0], 1.0 if spent[1] > 0.0 or count == ROWS else 0.0
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return result


@kernel
def sample_branches(handle: Indices, wanted: Array, target: Array, view: Array, number: int, w: int) -> Array:
    """Find a well-spread sample of the answers to one target that leaves the arm some freedom.

    Half as many starts again as answers are wanted, the nearest samples, are refined; if limits leave too few, more are
    tried around what was found. Of all these the farthest from those already chosen is chosen next (Gonzalez 1985).

    Args:
        handle: The task, see `task_of`.
        wanted: See `task_of`.
        target: (4, 4), lengths in [m].
        view: See `find_branches`.
        number: How many answers are wanted.
        w: LANES.

    Returns:
        As `find_branches`.
    """
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return np.empty((0, dof + 3))
    memory = np.zeros(desk_size(dof, joints))
    desk = make_desk(memory, dof, joints)
    most = max(number + number // 2, 4 * LANES)
    rows, chosen, seeds = np.empty((most, dof)), np.empty((number, dof)), np.empty((most, dof))
    columns, left = np.empty((dof, most)), np.empty(most)
    distance, neighbour, spent = np.empty(2 * most), np.empty(most, dtype=np.int64), np.zeros(3)
    start(task, desk, target)
    see(task, desk, target)
    coordinates(desk.seen, task.division, desk.point)
    many = starts(task, desk, most, 0, distance, neighbour, seeds)
    count = refine_all(
        handle, wanted, memory, target, seeds, 0, many, rows, left, 0, view[2], SAMPLED, spent, w
    )
    kept = 0
    for rounds in range(SAMPLE_ROUNDS + 1):
        kept = spread(view[2], rows, count, columns, chosen, distance)
        if kept == number or rounds == SAMPLE_ROUNDS or (kept == 0 and rounds > 0):
            break
        many, count = 4 * LANES, kept
        if count == 0:
            other = solve_pose(handle, wanted, target, w)
            spent[0] += other[dof + 3]
            for i in range(dof):
                seeds[0, i] = other[i]
            many = 1
        else:
            for k in range(count):
                for i in range(dof):
                    rows[k, i] = chosen[k, i]
            for k in range(many):
                restart(task, rounds * many + k, desk.seed)
                kick(task, rows, (rounds * many + k) % count, SAMPLE_KICK, desk.seed)
                for i in range(dof):
                    seeds[k, i] = desk.seed[i]
        count = refine_all(
            handle, wanted, memory, target, seeds, 0, many, rows, left, count, view[2], SAMPLED, spent, w
        )
    result = np.empty((kept + 1, dof + 3))
    result[kept, 0] = sorted_rows(task, desk, target, chosen, kept, view[0], view[1], result)
    result[kept, 1], result[kept, 2] = spent[0], 1.0
    memory[0] = 0.0  # Its last use, see `solve_pose`.
    return result


@hidden
def spread(rates: Array, rows: Array, count: int, columns: Array, chosen: Array, distance: Array) -> int:
    """Copy the rows that lie farthest from one another into `chosen`; return how many.

    Args:
        rates: See `joint_gap`, (n,).
        rows: Answers, (capacity, n).
        count: How many there are.
        columns: Memory, (n, capacity): joint by joint, so that the innermost loop runs over answers.
        chosen: Receives rows, (most, n).
        distance: Memory, (capacity,).
    """
    kept, last = 0, 0
    for j in range(count):
        distance[j] = np.inf
        for i in range(rows.shape[1]):
            columns[i, j] = rows[j, i]
    while kept < min(count, len(chosen)):
        for j in range(count):
            distance[count + j] = 0.0
        for i in range(rows.shape[1]):
            chosen[kept, i] = rows[last, i]
            here, rate = rows[last, i], rates[i]
            for j in range(count):
                gap = joint_gap(columns[i, j], here, rate)
                distance[count + j] += gap * gap
        kept += 1
        farthest = -1.0
        for j in range(count):
            distance[j] = min(distance[j], distance[count + j])
            if distance[j] > farthest:
                farthest, last = distance[j], j
        if farthest < EQUAL * EQUAL:
            break
    return kept


@kernel
def many_branches(
    handle: Indices,
    fine: Indices,
    wanted: Array,
    mirrors: Array,
    targets: Array,
    views: Array,
    number: int,
    begin: int,
    end: int,
    results: Array,
    counts: Indices,
    w: int,
) -> None:
    """`find_branches`, or `sample_branches` if `number` > 0, for targets begin … end-1, (k, 4, 4).

    Args:
        handle: See `find_branches`.
        fine: See `find_branches`.
        wanted: See `task_of`.
        mirrors: See `find_branches`.
        targets: Rigid transforms, (k, 4, 4), lengths in [m].
        views: One for all or one for each, (1 or k, 3, n).
        number: Answers wanted of a sample, else 0.
        begin: First target.
        end: One past the last target.
        results: Receives what comes back of each, (end - begin, most + 1, n + 3).
        counts: Receives the number of rows, the last one included, (end - begin,).
        w: LANES.
    """
    for t in range(begin, end):
        view = views[t if len(views) > 1 else 0]
        if number > 0:
            found = sample_branches(fine, wanted, targets[t], view, number, w)
        else:
            found = find_branches(handle, fine, wanted, mirrors, targets[t], view, w)
        counts[t - begin] = len(found)
        for j in range(len(found)):
            for i in range(found.shape[1]):
                results[t - begin, j, i] = found[j, i]
