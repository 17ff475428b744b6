"""Sample the self-motion curves of an arm with a closed form distal to one joint, by sweeping that joint.

Each value of the joint leaves at most eight candidates, one in each lane, see `structure.candidates`. Over the values,
the solutions of a lane form curves, where the discriminants of its three equations are positive and all joints are
inside their limits. A curve ends at a fold, where a discriminant is zero and another lane continues it, or at a limit.

Many curves are narrower than any grid. The discriminants are smooth functions of the value, though, and so are the joints
away from folds. Between two values of a grid there is therefore a search

- for the fold, if a discriminant is negative at one of them and a curve may pass through the fold that the other does not
  show;
- for a positive peak between them, if a discriminant is negative at both;
- for a part within all limits, if there are angles at both that are beyond limits at one of them or far apart.

If one of these is possible, a value is inserted, and the same tests are made on both sides of it.
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
"""Turns per radian, see `joint_gap`."""


GRID = 48
"""Values of the grid. With a few inserted values it was enough for Panda, iiwa14 and Gen3. Not examined further."""


SPARE = 96
"""Largest number of inserted values, in addition to one for each requested solution."""


CLOSE = 2e-4
"""Values closer than this fraction of the range are not separated further."""


ANGLES, UNDER, LEAST, ROOM = 0, 6, 9, 10
"""Rows of the report on a value: six angles, relative to the middle of their ranges; three discriminants; the smallest of
these; and the smallest distance of an angle to its limits [rad], negative beyond one."""


REPORT = 11
"""Number of these rows."""


BEYOND = 0.3
"""Angles between two values without solutions are unknown. Peaks are sought if the angles there are at most this far
beyond limits [rad]."""


FOLDED = 0.15
"""The same near a fold, where the angles are those of the fold."""


AHEAD = 0.05
"""Distance of the inserted value from a fold, as a fraction of the way to the next value."""


SURE = 1.3
"""Safety factor for the height of a peak above the straight line, relative to the cubic through two values."""


BEND = 0.25
"""Largest deviation of an angle from the straight line between two values, as a fraction of its change."""


TINY_CHANGE = 1e-9
"""An angle whose change is smaller counts as constant [rad]."""


FAR = 0.5
"""Solutions farther apart than this in a joint [rad] may belong to two curves."""


STEEP = 0.1
"""If a discriminant is smaller by this factor at one of two values, the angles change mostly there."""


HALVINGS = 12
"""Largest number of times that the steps along the curves are halved if there are too few solutions."""


@inlined
def swept_range(task: Task, D: Array) -> tuple[float, float]:
    """Values of the swept joint to cover: its range, limited to one turn, or to the reach of the arm."""
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
    """Write the report on a value of the swept joint.

    Args:
        task: The task.
        D: Displacement of all joints, (3, 4).
        value: Value of the swept joint.
        halves: Receives half the range of each angle, infinite if it turns fully, (6,).
        rest: Scratch memory, (3, 4).
        work: Scratch memory, `candidates.WORK`.
        report: Receives the report, (REPORT, LANES).
        w: LANES.
    """
    dof = len(task.lower)
    taken_off(task.structure, D, value, rest)
    candidates(task.structure, rest, np.inf, work, w)
    for l in range(w):
        a, b, c = work[ROOTS, l], work[ROOTS + 1, l], work[ROOTS + 2, l]
        report[UNDER, l], report[UNDER + 1, l], report[UNDER + 2, l] = a, b, c
        report[LEAST, l], report[ROOM, l] = min(a, b, c), np.inf
    for row in range(dof - 1):
        i = joint_of(task.structure, row, dof)
        low, high = task.chain.lower[i], task.chain.upper[i]
        half, centre = np.inf if turns_fully(task, i) else 0.5 * (high - low), 0.5 * (low + high)
        halves[row] = half
        for l in range(w):
            angle = joint_gap(work[row, l], centre, TURN)
            report[ANGLES + row, l] = angle
            report[ROOM, l] = min(report[ROOM, l], half - abs(angle))


@inlined
def is_answer(report: Array, k: int, l: int) -> bool:
    """Return True if a lane has a solution at value k."""
    there: bool = report[k, LEAST, l] >= 0.0 and report[k, ROOM, l] >= 0.0
    return there


@inlined
def farthest(report: Array, a: int, b: int, l: int) -> float:
    """Largest change of an angle of a lane from value a to b, the shorter way [rad]."""
    far = 0.0
    for row in range(ANGLES, UNDER):
        far = max(far, abs(joint_gap(report[b, row, l], report[a, row, l], TURN)))
    return far


@inlined
def slope(values: Array, report: Array, before: int, k: int, after: int, row: int, l: int) -> float:
    """Slope of a row at value k, from the parabola through its neighbours."""
    left, right = values[k] - values[before], values[after] - values[k]
    down = (report[k, row, l] - report[before, row, l]) / left
    up = (report[after, row, l] - report[k, row, l]) / right
    there: float = (down * right + up * left) / (left + right)
    return there


@inlined
def peak(values: Array, report: Array, left: int, a: int, b: int, right: int, l: int) -> float:
    """Position between two values, as a fraction, where all discriminants of a lane may be positive; else -1.

    Some discriminant is negative at each of the two values. Slopes come from their neighbours on either side, -1 where there
    is none.
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
        # Height of the cubic with these slopes above the straight line.
        bulge = t * (1.0 - t) * ((1.0 - t) * (up - end + begin) - t * (down - end + begin))
        if begin + t * (end - begin) + SURE * bulge < 0.0:
            return -1.0
        at = t
    # If two discriminants are negative at one end each, both may be positive in between.
    return 0.5 if at < 0.0 else at


@inlined
def fold(values: Array, report: Array, a: int, b: int, l: int, far: float) -> float:
    """Position near a fold between two values, one of which has no solution, as a fraction; else -1."""
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
    """Position between two values with angles where limits may allow an unknown solution, as a fraction; else -1."""
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
        # An angle that takes the other way round enters the range at its end.
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
    """Next position between two values, as a fraction that is at least `close` from both ends; -1 if there is none."""
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
    """Insert values wherever curves may be missed or solutions are far apart; return the number of values."""
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
    """Return True if solutions of a lane at two values seem to belong to one curve, without a limit between them."""
    for row in range(ANGLES, UNDER):
        if (
            abs(report[a, row, l] + joint_gap(report[b, row, l], report[a, row, l], TURN))
            > halves[row] + 1e-9
        ):
            return False
    return is_answer(report, b, l)


@inlined
def step_length(report: Array, values: Array, a: int, b: int, l: int) -> float:
    """Distance of the solutions of a lane at two values [rad], including the swept joint."""
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
    """Append solutions of every curve to seeds, (k, n); return their number and the total length of the curves [rad].

    Solutions are taken at distances of `apart` [rad] from the start of each curve. If `apart` is 0, the middle of each
    curve is taken.
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
    """Number of solutions at all values."""
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
    """Write solutions of every curve into seeds, first one of each; return the number of these and of all.

    Args:
        task: The task, of an arm with a swept joint.
        scratch: Its memory.
        target: (4, 4), lengths in [m].
        number: Number of requested solutions.
        values: Scratch memory, (k,); k is the largest number of values of the swept joint.
        report: Scratch memory, (k, REPORT, LANES).
        next_one: Scratch memory, (k,).
        work: Scratch memory, `candidates.WORK`.
        halves: Scratch memory, (6,).
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
