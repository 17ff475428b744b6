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
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.seeds import turns_fully
from kinseek.kernels.atlas.task import Task, task_at
from kinseek.kernels.jit import inlined, kernel
from kinseek.kernels.structure.candidates import (
    ROOTS,
    candidates,
    displacement,
    joint_of,
    read_structure,
    row_of,
)
from kinseek.kernels.structure.swept_joint import direction, swept_joint, taken_off

from .distance import joint_gap
from .refine_all import Search

TURN = 0.5 / math.pi
"""Turns per radian, see `joint_gap`."""

GRID = 48
"""Values of the grid. With a few inserted values it was enough for Panda, iiwa14 and Gen3. Not examined further."""

MOST_INSERTED = 96
"""Largest number of inserted values, in addition to one for each requested solution."""

CLOSE = 2e-4
"""Values closer than this fraction of the range are not separated further."""

JOINTS, EQUATIONS = 6, 3
"""Number of joints that the closed form solves, and of its quadratic equations."""

BEYOND = 0.3
"""Angles between two values without solutions are unknown. Peaks are sought if the angles there are at most this far
beyond limits [rad]. Not examined further."""

FOLDED = 0.15
"""The same near a fold, where the angles are those of the fold. Not examined further."""

AHEAD = 0.05
"""Distance of the inserted value from a fold, as a fraction of the way to the next value."""

SURE = 1.3
"""Safety factor for the height of a peak above the straight line, relative to the cubic through two values."""

BEND = 0.25
"""Largest deviation of an angle from the straight line between two values, as a fraction of its change."""

TINY_CHANGE = 1e-9
"""An angle whose change is smaller counts as constant [rad]."""

FAR = 0.5
"""Solutions farther apart than this in a joint [rad] may belong to two curves. Not examined further."""

STEEP = 0.1
"""If a discriminant is smaller by this factor at one of two values, the angles change mostly there."""

HALVINGS = 12
"""Largest number of times that the steps along the curves are halved if there are too few solutions."""

NOWHERE = -1.0
"""Position between two values if nothing has to be inserted there."""


class Sweep(NamedTuple):
    """Values of the swept joint, in a linked list, and the candidates at each."""

    values: Array
    """[rad] or [m], (most,)"""
    following: Indices
    """Index of the next larger value, -1 after the last, (most,)."""
    angles: Array
    """Angles of the other joints, relative to the middle of their ranges [rad], (most, JOINTS, LANES)."""
    discriminants: Array
    """See `candidates.ROOTS`, (most, EQUATIONS, LANES)."""
    least: Array
    """The smallest discriminant, (most, LANES)."""
    room: Array
    """Smallest distance of an angle to its limits [rad], negative beyond one, (most, LANES)."""
    halves: Array
    """Half the range of each angle, infinite if it turns fully, (JOINTS,)."""
    D: Array
    """Displacement of all joints, see `candidates.displacement`, (3, 4)."""
    rest: Array
    """That of the joints other than the swept one, (3, 4)."""
    work: Array
    """Memory of `candidates`, see `candidates.WORK`."""


class Gap(NamedTuple):
    """Two consecutive values, and the values beside them; -1 where there is none."""

    left: int
    a: int
    b: int
    right: int


@kernel
def write_curve_starts(search: Search, number: int) -> tuple[int, int]:
    """Write solutions of every curve into the starts, first one of each; return the number of these and of all.

    Args:
        search: The search, of an arm with a swept joint.
        number: Number of requested solutions.
    """
    job, w, most = search.job, search.job.width, GRID + MOST_INSERTED + number
    task = task_at(job)
    scratch = scratch_of(job, task)
    sweep = Sweep(
        np.empty(most),
        np.empty(most, dtype=np.int64),
        np.empty((most, JOINTS, LANES)),
        np.empty((most, EQUATIONS, LANES)),
        np.empty((most, LANES)),
        np.empty((most, LANES)),
        np.empty(JOINTS),
        scratch.displacement,
        scratch.rest,
        scratch.candidates,
    )
    displacement(task.structure, search.target, sweep.D)
    low, high = swept_range(task, sweep.D)
    # The joint is fixed, or the target is too far away for any slide. The grid needs two different ends.
    if not low < high:
        low, high = 0.5 * (low + high) - 1e-9, 0.5 * (low + high) + 1e-9
    for k in range(GRID):
        sweep.values[k], sweep.following[k] = low + (high - low) * k / (GRID - 1), k + 1
        solve_at(task, sweep, k, w)
    sweep.following[GRID - 1] = -1
    count, far = GRID, FAR
    for _ in range(HALVINGS + 1):
        count = insert_values(task, sweep, count, far, w)
        many = solutions_among(sweep, count)
        if many == 0 or many >= number + number // 2 or count == most:
            break
        far *= 0.5
    first, length = take_along(task, sweep, search.starts, 0, 0.0)
    apart = length / max(number + number // 2 - first, number // 2 + 1)
    many, _ = take_along(task, sweep, search.starts, first, max(apart, 1e-9))
    return first, many


@inlined
def swept_range(task: Task, D: Array) -> tuple[float, float]:
    """Values of the swept joint to cover: its range, limited to one turn, or to the reach of the arm."""
    i, s = swept_joint(task.structure, len(task.lower)), read_structure(task.structure)
    low, high = task.chain.lower[i], task.chain.upper[i]
    if s.slides > 0.0:
        centre, far = direction(s, D), s.size
        return max(low, centre - far), min(high, centre + far)
    if high - low > 2.0 * math.pi:
        centre = 0.5 * (low + high)
        return centre - math.pi, centre + math.pi
    return low, high


@inlined
def solve_at(task: Task, sweep: Sweep, k: int, w: int) -> None:
    """Solve the other joints at value k."""
    dof, work = len(task.lower), sweep.work
    taken_off(task.structure, sweep.D, sweep.values[k], sweep.rest)
    candidates(task.structure, sweep.rest, np.inf, work, w)
    for l in range(w):
        a, b, c = work[ROOTS, l], work[ROOTS + 1, l], work[ROOTS + 2, l]
        sweep.discriminants[k, 0, l], sweep.discriminants[k, 1, l], sweep.discriminants[k, 2, l] = a, b, c
        sweep.least[k, l], sweep.room[k, l] = min(a, b, c), np.inf
    for row in range(dof - 1):
        i = joint_of(task.structure, row, dof)
        low, high = task.chain.lower[i], task.chain.upper[i]
        half, centre = np.inf if turns_fully(task, i) else 0.5 * (high - low), 0.5 * (low + high)
        sweep.halves[row] = half
        for l in range(w):
            angle = joint_gap(work[row, l], centre, TURN)
            sweep.angles[k, row, l] = angle
            sweep.room[k, l] = min(sweep.room[k, l], half - abs(angle))


@inlined
def is_solution(sweep: Sweep, k: int, l: int) -> bool:
    """Return True if a lane has a solution at value k."""
    there: bool = sweep.least[k, l] >= 0.0 and sweep.room[k, l] >= 0.0
    return there


@inlined
def solutions_among(sweep: Sweep, count: int) -> int:
    """Number of solutions at all values."""
    many = 0
    for k in range(count):
        for l in range(LANES):
            many += 1 if is_solution(sweep, k, l) else 0
    return many


@inlined
def change(sweep: Sweep, a: int, b: int, row: int, l: int) -> float:
    """Change of an angle of a lane from value a to b, the shorter way [rad]."""
    return joint_gap(sweep.angles[b, row, l], sweep.angles[a, row, l], TURN)


@inlined
def farthest(sweep: Sweep, a: int, b: int, l: int) -> float:
    """Largest change of an angle of a lane from value a to b [rad]."""
    far = 0.0
    for row in range(JOINTS):
        far = max(far, abs(change(sweep, a, b, row, l)))
    return far


@inlined
def insert_values(task: Task, sweep: Sweep, count: int, far: float, w: int) -> int:
    """Insert values wherever curves may be missed or solutions are farther apart than `far`; return the number of values."""
    close = CLOSE * (sweep.values[GRID - 1] - sweep.values[0])
    left, a = -1, 0
    for _ in range(2 * len(sweep.values)):
        b = sweep.following[a]
        if b < 0 or count == len(sweep.values):
            break
        width, t = sweep.values[b] - sweep.values[a], NOWHERE
        if width > close:
            t = position_between(sweep, Gap(left, a, b, sweep.following[b]), far, 0.25 * close / width)
        if t <= 0.0:
            left, a = a, b
            continue
        sweep.values[count] = sweep.values[a] + t * width
        solve_at(task, sweep, count, w)
        sweep.following[a], sweep.following[count] = count, b
        count += 1
    return count


@inlined
def position_between(sweep: Sweep, gap: Gap, far: float, close: float) -> float:
    """Next position between two values, as a fraction that is at least `close` from both ends, or NOWHERE."""
    for l in range(LANES):
        no_a, no_b = sweep.least[gap.a, l] < 0.0, sweep.least[gap.b, l] < 0.0
        if no_a and no_b:
            t = peak(sweep, gap, l)
        elif no_a or no_b:
            t = fold(sweep, gap.a, gap.b, l, far)
        else:
            t = allowed(sweep, gap.a, gap.b, l, far)
        if close <= t <= 1.0 - close:
            return t
    return NOWHERE


@inlined
def slope(sweep: Sweep, before: int, k: int, after: int, row: int, l: int) -> float:
    """Slope of a discriminant at value k, from the parabola through its neighbours."""
    values, y = sweep.values, sweep.discriminants
    left, right = values[k] - values[before], values[after] - values[k]
    down, up = (y[k, row, l] - y[before, row, l]) / left, (y[after, row, l] - y[k, row, l]) / right
    there: float = (down * right + up * left) / (left + right)
    return there


@inlined
def peak(sweep: Sweep, gap: Gap, l: int) -> float:
    """Position between two values, as a fraction, where all discriminants of a lane may be positive, or NOWHERE.

    Some discriminant is negative at each of the two values. It is followed by the cubic with its values and slopes there,
    which come from the values beside them.
    """
    a, b = gap.a, gap.b
    width, at = sweep.values[b] - sweep.values[a], NOWHERE
    if max(sweep.room[a, l], sweep.room[b, l]) < -BEYOND:
        return NOWHERE
    for row in range(EQUATIONS):
        begin, end = sweep.discriminants[a, row, l], sweep.discriminants[b, row, l]
        if begin >= 0.0 or end >= 0.0:
            continue
        up = slope(sweep, gap.left, a, b, row, l) * width if gap.left >= 0 else 0.0
        down = slope(sweep, a, b, gap.right, row, l) * width if gap.right >= 0 else 2.0 * (end - begin) - up
        up = up if gap.left >= 0 else 2.0 * (end - begin) - down
        if up <= 0.0 or down >= 0.0:
            return NOWHERE
        # The cubic is highest near the place where the slope, interpolated linearly, is 0.
        t = min(max(up / (up - down), 0.05), 0.95)
        # Height of the cubic with these slopes above the straight line.
        bulge = t * (1.0 - t) * ((1.0 - t) * (up - end + begin) - t * (down - end + begin))
        if begin + t * (end - begin) + SURE * bulge < 0.0:
            return NOWHERE
        at = t
    # If two discriminants are negative at one end each, both may be positive in between.
    return 0.5 if at < 0.0 else at


@inlined
def fold(sweep: Sweep, a: int, b: int, l: int, far: float) -> float:
    """Position near a fold between two values, one of which has no solution, as a fraction, or NOWHERE."""
    here, there = (a, b) if sweep.least[b, l] >= 0.0 else (b, a)
    seen = sweep.room[there, l] >= 0.0 and farthest(sweep, a, b, l) <= far
    if sweep.room[here, l] < -FOLDED or seen:
        return NOWHERE
    way = 0.0
    for row in range(EQUATIONS):
        less, more = sweep.discriminants[here, row, l], sweep.discriminants[there, row, l]
        if less < 0.0:
            way = max(way, less / (less - more))
    way = min(way + AHEAD * (1.0 - way), 1.0 - AHEAD)
    return way if here == a else 1.0 - way


@inlined
def allowed(sweep: Sweep, a: int, b: int, l: int, far: float) -> float:
    """Position between two values with angles where limits may allow an unknown solution, as a fraction, or NOWHERE."""
    known = is_solution(sweep, a, l) or is_solution(sweep, b, l)
    if known and farthest(sweep, a, b, l) <= far:
        return NOWHERE
    begin, end = 0.0, 1.0
    for row in range(JOINTS):
        angle, moved = sweep.angles[a, row, l], change(sweep, a, b, row, l)
        room = sweep.halves[row] + BEND * abs(moved)
        inside = abs(sweep.angles[b, row, l]) <= room
        if abs(angle) <= room and inside:
            continue
        if abs(moved) < TINY_CHANGE:
            return NOWHERE
        # An angle that takes the other way round enters the range at its end.
        angle = sweep.angles[b, row, l] - moved if inside else angle
        low, high = (-room - angle) / moved, (room - angle) / moved
        begin, end = max(begin, min(low, high)), min(end, max(low, high))
    if begin > end:
        return NOWHERE
    one, other = sweep.least[a, l], sweep.least[b, l]
    share = 0.25 if one < STEEP * other else 0.75 if other < STEEP * one else 0.5
    return min(max(begin + share * (end - begin), 0.05), 0.95)


@inlined
def goes_on(sweep: Sweep, a: int, b: int, l: int) -> bool:
    """Return True if solutions of a lane at two values seem to belong to one curve, without a limit between them."""
    for row in range(JOINTS):
        if abs(sweep.angles[a, row, l] + change(sweep, a, b, row, l)) > sweep.halves[row] + 1e-9:
            return False
    return is_solution(sweep, b, l)


@inlined
def step_length(sweep: Sweep, a: int, b: int, l: int) -> float:
    """Distance of the solutions of a lane at two values [rad], including the swept joint."""
    total = (sweep.values[b] - sweep.values[a]) * (sweep.values[b] - sweep.values[a])
    for row in range(JOINTS):
        gap = change(sweep, a, b, row, l)
        total += gap * gap
    return math.sqrt(total)


@inlined
def write_solution(task: Task, sweep: Sweep, k: int, l: int, q: Array) -> None:
    """Write the joint values of a lane at value k, (n,)."""
    dof = len(q)
    for i in range(dof):
        q[i] = sweep.values[k]
        if i != swept_joint(task.structure, dof):
            row = row_of(task.structure, i, dof)
            q[i] = 0.5 * (task.chain.lower[i] + task.chain.upper[i]) + sweep.angles[k, row, l]


@inlined
def take_along(task: Task, sweep: Sweep, starts: Array, many: int, apart: float) -> tuple[int, float]:
    """Append solutions of every curve to the starts, (k, n); return their number and the total length of the curves [rad].

    Solutions are taken at distances of `apart` [rad] from the start of each curve. If `apart` is 0, the middle of each
    curve is taken.
    """
    total, following = 0.0, sweep.following
    for l in range(LANES):
        a = 0
        for _ in range(len(sweep.values)):
            if a < 0:
                break
            if not is_solution(sweep, a, l):
                a = following[a]
                continue
            length, last = 0.0, a
            while following[last] >= 0 and goes_on(sweep, last, following[last], l):
                length += step_length(sweep, last, following[last], l)
                last = following[last]
            k, done, due = a, 0.0, 0.5 * length if apart == 0.0 else 0.0
            while many < len(starts):
                if done >= due:
                    write_solution(task, sweep, k, l, starts[many])
                    many += 1
                    due = done + apart if apart > 0.0 else np.inf
                if k == last:
                    break
                done += step_length(sweep, k, following[k], l)
                k = following[k]
            total += length
            a = following[last]
    return many, total
