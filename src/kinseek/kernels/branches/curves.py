"""The self-motion of an arm with a closed form behind one joint: that joint is swept, and its curves are sampled.

Each value of the joint leaves eight candidates at most, one a lane, see `structure.candidates`. Followed over the values a
lane has its curves: where what stands under the roots of its three equations is above zero, and every joint between its
limits. A curve ends at a fold, where a root is zero and another lane goes on, or at a limit.

Many curves are narrower than any grid. But what stands under the roots is smooth in the value, and so are the joints away
from folds. So between two values of a grid it is looked

- where a root is below zero at one of them, for the fold, if there is a curve through it that the other does not tell of;
- where it is below zero at both, for a peak above zero between them;
- where there are angles at both, beyond limits at least at one of them, or far apart, for a part that all limits allow.

If one of these may be, a value is put in between, and on both sides of it the same is asked again.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Scratch
from kinseek.kernels.atlas.seeds import turns_fully
from kinseek.kernels.atlas.task import Task
from kinseek.kernels.jit import inlined
from kinseek.kernels.structure.candidates import (
    ROOTS,
    SIZE,
    SLIDES,
    candidates,
    displacement,
    joint_of,
    row_of,
)
from kinseek.kernels.structure.swept_joint import direction, swept_joint, taken_off

from .refine_all import joint_gap

TURN = 0.5 / math.pi
"""Turns a radian, see `joint_gap`."""


GRID = 48
"""Values of the grid: with a few more that are put between them, enough by trial on Panda, iiwa14 and Gen3."""


SPARE = 96
"""Values that may be put between them, besides one for each answer that is wanted."""


CLOSE = 2e-4
"""Values closer than this part of the range have nothing between them."""


ANGLES, UNDER, LEAST, ROOM = 0, 6, 9, 10
"""Rows of what is told of a value: six angles, from the middle of their ranges; what stands under three roots; the least of
these; and the least room that an angle has inside its limits [rad], less than 0 beyond one."""


REPORT = 11
"""Rows of these."""


BEYOND = 0.3
"""Between values where no root is, angles are unknown: peaks are looked for where they are at most that far beyond limits
[rad]."""


FOLDED = 0.15
"""The same beside a fold, where the angles are those of the fold."""


AHEAD = 0.05
"""What is looked at instead of a fold lies so far from it, in parts of the way to the next value."""


SURE = 1.3
"""A peak may be so many times as high above the straight line as the cubic through two values says."""


BEND = 0.25
"""An angle may be off the straight line between two values by so much of its change."""


TINY_CHANGE = 1e-9
"""An angle that changes less stays where it is [rad]."""


FAR = 0.5
"""Answers farther apart than that in a joint [rad] may belong to two curves."""


STEEP = 0.1
"""Where a root is so much less at one of two values, the angles change mostly there."""


HALVINGS = 12
"""How often steps along the curves are halved at most, where there are too few answers."""


@inlined
def swept_range(task: Task, D: Array) -> tuple[float, float]:
    """Values of the joint in front that are looked at: its range, but one turn at most, or as far as the arm reaches."""
    i, S = swept_joint(task.structure, len(task.lower)), task.structure
    low, high = task.chain.lower[i], task.chain.upper[i]
    if S[SLIDES] > 0.0:
        centre, far = direction(S, D), S[SIZE]
        return max(low, centre - far), min(high, centre + far)
    if high - low > 2.0 * math.pi:
        centre = 0.5 * (low + high)
        return centre - math.pi, centre + math.pi
    return low, high


@inlined
def report_samples(
    task: Task, D: Array, value: float, halves: Array, rest: Array, work: Array, report: Array, w: int
) -> None:
    """Write what there is at a value of the joint in front.

    Args:
        task: The task.
        D: What all joints make, (3, 4).
        value: Of the joint in front.
        halves: Receives half the range of each angle, infinite where it turns fully, (6,).
        rest: Memory, (3, 4).
        work: Memory, (WORK,).
        report: Receives it, (REPORT, LANES).
        w: LANES.
    """
    W, dof = LANES, len(task.lower)
    taken_off(task.structure, D, value, rest)
    candidates(task.structure, rest, np.inf, work, w)
    for l in range(w):
        a, b, c = work[ROOTS * W + l], work[(ROOTS + 1) * W + l], work[(ROOTS + 2) * W + l]
        report[UNDER, l], report[UNDER + 1, l], report[UNDER + 2, l] = a, b, c
        report[LEAST, l], report[ROOM, l] = min(a, b, c), np.inf
    for row in range(dof - 1):
        i = joint_of(task.structure, row, dof)
        low, high = task.chain.lower[i], task.chain.upper[i]
        half, centre = np.inf if turns_fully(task, i) else 0.5 * (high - low), 0.5 * (low + high)
        halves[row] = half
        for l in range(w):
            angle = joint_gap(work[row * W + l], centre, TURN)
            report[ANGLES + row, l] = angle
            report[ROOM, l] = min(report[ROOM, l], half - abs(angle))


@inlined
def is_answer(report: Array, k: int, l: int) -> bool:
    """Is there an answer in a lane at value k?"""
    there: bool = report[k, LEAST, l] >= 0.0 and report[k, ROOM, l] >= 0.0
    return there


@inlined
def farthest(report: Array, a: int, b: int, l: int) -> float:
    """Largest change of an angle of a lane from value a to b, the short way round [rad]."""
    far = 0.0
    for row in range(ANGLES, UNDER):
        far = max(far, abs(joint_gap(report[b, row, l], report[a, row, l], TURN)))
    return far


@inlined
def slope(values: Array, report: Array, before: int, k: int, after: int, row: int, l: int) -> float:
    """Slope of a row at value k, by the parabola through its neighbours."""
    left, right = values[k] - values[before], values[after] - values[k]
    down = (report[k, row, l] - report[before, row, l]) / left
    up = (report[after, row, l] - report[k, row, l]) / right
    there: float = (down * right + up * left) / (left + right)
    return there


@inlined
def peak(values: Array, report: Array, left: int, a: int, b: int, right: int, l: int) -> float:
    """Where all roots of a lane may be above zero between two values where some are not, in parts of the way; else -1.

    Of what is next to them on either side, -1 where there is nothing, slopes are taken.
    """
    width, at = values[b] - values[a], -1.0
    if max(report[a, ROOM, l], report[b, ROOM, l]) < -BEYOND:
        return -1.0
    for row in range(UNDER, LEAST):
        begin, end = report[a, row, l], report[b, row, l]
        if begin >= 0.0 or end >= 0.0:
            continue
        up = slope(values, report, left, a, b, row, l) * width if left >= 0 else 0.0
        down = slope(values, report, a, b, right, row, l) * width if right >= 0 else 2.0 * (end - begin) - up
        up = up if left >= 0 else 2.0 * (end - begin) - down
        if up <= 0.0 or down >= 0.0:
            return -1.0
        t = min(max(up / (up - down), 0.05), 0.95)
        # The cubic with these slopes, by how much it is above the straight line.
        bulge = t * (1.0 - t) * ((1.0 - t) * (up - end + begin) - t * (down - end + begin))
        if begin + t * (end - begin) + SURE * bulge < 0.0:
            return -1.0
        at = t
    # Of two roots each below zero at one end both may be above between.
    return 0.5 if at < 0.0 else at


@inlined
def fold(values: Array, report: Array, a: int, b: int, l: int, far: float) -> float:
    """Where between two values, one of which has no root, it is looked beside the fold, in parts of the way; else -1."""
    here, there = (a, b) if report[b, LEAST, l] >= 0.0 else (b, a)
    if report[here, ROOM, l] < -FOLDED or (
        report[there, ROOM, l] >= 0.0 and farthest(report, a, b, l) <= far
    ):
        return -1.0
    way = 0.0
    for row in range(UNDER, LEAST):
        less, more = report[here, row, l], report[there, row, l]
        if less < 0.0:
            way = max(way, less / (less - more))
    way = min(way + AHEAD * (1.0 - way), 1.0 - AHEAD)
    return way if here == a else 1.0 - way


@inlined
def allowed(report: Array, halves: Array, a: int, b: int, l: int, far: float) -> float:
    """Where between two values with angles limits may allow an answer that these do not tell of, in parts; else -1."""
    known = is_answer(report, a, l) or is_answer(report, b, l)
    if known and farthest(report, a, b, l) <= far:
        return -1.0
    begin, end = 0.0, 1.0
    for row in range(ANGLES, UNDER):
        angle = report[a, row, l]
        change = joint_gap(report[b, row, l], angle, TURN)
        room = halves[row] + BEND * abs(change)
        inside = abs(report[b, row, l]) <= room
        if abs(angle) <= room and inside:
            continue
        if abs(change) < TINY_CHANGE:
            return -1.0
        # An angle that goes once round the other way comes in where it ends.
        angle = report[b, row, l] - change if inside else angle
        low, high = (-room - angle) / change, (room - angle) / change
        begin, end = max(begin, min(low, high)), min(end, max(low, high))
    if begin > end:
        return -1.0
    one, other = report[a, LEAST, l], report[b, LEAST, l]
    share = 0.25 if one < STEEP * other else 0.75 if other < STEEP * one else 0.5
    return min(max(begin + share * (end - begin), 0.05), 0.95)


@inlined
def between(
    values: Array,
    report: Array,
    halves: Array,
    left: int,
    a: int,
    b: int,
    right: int,
    far: float,
    close: float,
) -> float:
    """Where between two values it is looked next, in parts of the way, not as close as that to one; -1 if nowhere."""
    for l in range(LANES):
        one, other = report[a, LEAST, l] < 0.0, report[b, LEAST, l] < 0.0
        if one and other:
            t = peak(values, report, left, a, b, right, l)
        elif one or other:
            t = fold(values, report, a, b, l, far)
        else:
            t = allowed(report, halves, a, b, l, far)
        if close <= t <= 1.0 - close:
            return t
    return -1.0


@inlined
def refine_sweep(
    task: Task,
    D: Array,
    values: Array,
    report: Array,
    next_one: Indices,
    count: int,
    far: float,
    halves: Array,
    rest: Array,
    work: Array,
    w: int,
) -> int:
    """Put values between those there are, wherever curves may hide or answers are far apart; return how many there are."""
    close = CLOSE * (values[GRID - 1] - values[0])
    left, a = -1, 0
    for _ in range(2 * len(values)):
        b = next_one[a]
        if b < 0 or count == len(values):
            break
        gap, t = values[b] - values[a], -1.0
        if gap > close:
            t = between(values, report, halves, left, a, b, next_one[b], far, 0.25 * close / gap)
        if t <= 0.0:
            left, a = a, b
            continue
        values[count] = values[a] + t * gap
        report_samples(task, D, values[count], halves, rest, work, report[count], w)
        next_one[a], next_one[count] = count, b
        count += 1
    return count


@inlined
def goes_on(report: Array, halves: Array, a: int, b: int, l: int) -> bool:
    """Do answers of a lane at two values belong to one curve, as far as is seen: no limit lies between them?"""
    for row in range(ANGLES, UNDER):
        if (
            abs(report[a, row, l] + joint_gap(report[b, row, l], report[a, row, l], TURN))
            > halves[row] + 1e-9
        ):
            return False
    return is_answer(report, b, l)


@inlined
def step_length(report: Array, values: Array, a: int, b: int, l: int) -> float:
    """Distance of the answers of a lane at two values [rad], the joint in front included."""
    total = (values[b] - values[a]) * (values[b] - values[a])
    for row in range(ANGLES, UNDER):
        gap = joint_gap(report[b, row, l], report[a, row, l], TURN)
        total += gap * gap
    return math.sqrt(total)


@inlined
def write_answer(task: Task, value: float, report: Array, k: int, l: int, q: Array) -> None:
    """Write the joint values of a lane at value k, (n,)."""
    dof = len(q)
    for i in range(dof):
        q[i] = value
        if i != swept_joint(task.structure, dof):
            row = row_of(task.structure, i, dof)
            q[i] = 0.5 * (task.chain.lower[i] + task.chain.upper[i]) + report[k, ANGLES + row, l]


@inlined
def take_along(
    task: Task,
    values: Array,
    report: Array,
    next_one: Indices,
    halves: Array,
    apart: float,
    seeds: Array,
    many: int,
) -> tuple[int, float]:
    """Append answers of every curve to seeds, (k, n); return how many there are then, and how long all curves are [rad].

    Of each curve those are taken that lie `apart` of one another [rad], from its beginning on; its middle if that is 0.
    """
    total = 0.0
    for l in range(LANES):
        a = 0
        for _ in range(len(values)):
            if a < 0:
                break
            if not is_answer(report, a, l):
                a = next_one[a]
                continue
            length, last = 0.0, a
            while next_one[last] >= 0 and goes_on(report, halves, last, next_one[last], l):
                length += step_length(report, values, last, next_one[last], l)
                last = next_one[last]
            k, done, due = a, 0.0, 0.5 * length if apart == 0.0 else 0.0
            while many < len(seeds):
                if done >= due or k == last:
                    if done >= due:
                        write_answer(task, values[k], report, k, l, seeds[many])
                        many += 1
                        due = done + apart if apart > 0.0 else np.inf
                    if k == last:
                        break
                done += step_length(report, values, k, next_one[k], l)
                k = next_one[k]
            total += length
            a = next_one[last]
    return many, total


@inlined
def answers_among(report: Array, count: int) -> int:
    """How many answers there are at all values."""
    many = 0
    for k in range(count):
        for l in range(LANES):
            many += 1 if is_answer(report, k, l) else 0
    return many


@inlined
def swept_starts(
    task: Task,
    scratch: Scratch,
    target: Array,
    number: int,
    values: Array,
    report: Array,
    next_one: Indices,
    work: Array,
    halves: Array,
    seeds: Array,
    w: int,
) -> tuple[int, int]:
    """Write answers of every curve into seeds, first one of each; return how many these are, and how many all.

    Args:
        task: The task, of an arm with a joint in front of its structure.
        scratch: Its memory.
        target: (4, 4), lengths in [m].
        number: How many answers are wanted.
        values: Memory, (k,): at most so many values of the joint in front are looked at.
        report: Memory, (k, REPORT, LANES).
        next_one: Memory, (k,).
        work: Memory, (WORK,).
        halves: Memory, (6,).
        seeds: Receives joint values, (most, n).
        w: LANES.
    """
    D, rest = scratch.between, scratch.spare
    displacement(task.structure, target, D)
    low, high = swept_range(task, D)
    if not low < high:
        low, high = 0.5 * (low + high) - 1e-9, 0.5 * (low + high) + 1e-9
    for k in range(GRID):
        values[k], next_one[k] = low + (high - low) * k / (GRID - 1), k + 1
        report_samples(task, D, values[k], halves, rest, work, report[k], w)
    next_one[GRID - 1] = -1
    count, far = refine_sweep(task, D, values, report, next_one, GRID, FAR, halves, rest, work, w), FAR
    for _ in range(HALVINGS):
        many = answers_among(report, count)
        if many == 0 or many >= number + number // 2 or count == len(values):
            break
        far *= 0.5
        count = refine_sweep(task, D, values, report, next_one, count, far, halves, rest, work, w)
    first, length = take_along(task, values, report, next_one, halves, 0.0, seeds, 0)
    apart = length / max(number + number // 2 - first, number // 2 + 1)
    many, _ = take_along(task, values, report, next_one, halves, max(apart, 1e-9), seeds, first)
    return first, many
