"""Search for all solutions of a goal: many starts in parallel, and from each solution the way to its siblings.

An arm with a closed form, or with one joint that can be searched, gets its starts from there, see `structure.closed` and
`one_joint`. The rest of this text is about goals that these leave undecided, and about other arms.

The starts are the nearest samples of a coarse atlas, see `seeding`. A coarse atlas is better here: the nearest sixty of a
thousand samples lie all over the joint space, but those of sixteen thousand crowd around the solutions where the map is
steep. Two kinds of siblings are found from a solution itself, at almost no cost:

- its *twin* across a singularity. Let v be the weakest direction of the Jacobian, u the direction of its image and σ the
  singular value. Along v the pose moves by ``σ t + ½ t² u·H(v, v)`` to second order, which is zero again at
  ``t = -2 σ / u·H(v, v)``. Close to a singularity no start would distinguish the two.
- its *mirror images*. An arm with a spherical wrist has every pose at (…, q_4 + π, -q_5, q_6 + π) too. Such images are
  found once per arm (see `branches.find`).

Three cases call for more starts: a solution that is found late, a solution close to a singularity, and an odd number of
solutions if all joints turn fully. Away from singularities solutions appear and vanish in pairs, and only limits make
their number odd.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arm.pose_error import is_rigid
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import start
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.one_goal import solve_pose
from kinseek.kernels.atlas.samples import coordinates
from kinseek.kernels.atlas.seeds import see, turns_fully
from kinseek.kernels.atlas.task import (
    EVALUATIONS,
    ORIENTATION_ERROR,
    POSITION_ERROR,
    TOLERANCES,
    Handle,
    Task,
    task_of,
)
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined, noinline
from kinseek.kernels.structure.candidates import DEVIATION, KIND, LOOSE, NUMBERS, PARALLEL, ROUNDING, WORK
from kinseek.kernels.structure.closed import FOLDED, LOST, REPORT, SURE, TRIED, UNSURE, closed_starts, serves

from . import one_joint, one_joint_residual
from .around import FINAL, FIRST, least_lean, starts_around
from .refine_all import (
    ANSWERS,
    CENTRE,
    CONTINUA,
    CONTINUUM,
    EVALUATED,
    LATE,
    RATES,
    SCALE,
    SEEDED,
    SIBLING,
    SPENT,
    TALLY,
    WEAKEST,
    refine_all,
    sorted_rows,
)
from .sample import sample_branches
from .seeding import BUCKETS, MOST_JOINTS, measure_samples, radius, sort_samples, spread_starts
from .twins import WEAK, images, twins

STARTS, DEEP_STARTS = 128, 512
"""Number of samples for every goal, and for a goal that may have more solutions."""


SURELY = 0.6
"""If a start after this fraction of the starts leads to a new solution, more may be missing."""


FIRST_ROOM = STARTS + STARTS // 10
"""Largest number of samples in the first round, see `seeding.radius`."""


ROOM = (FIRST_ROOM + DEEP_STARTS + LANES - 1) // LANES * LANES
"""Largest number of starts that are compared for likeness, a multiple of LANES."""


ROWS = 64
"""Largest number of solutions. Six joints have at most sixteen isolated ones (Primrose 1986); more form a continuum."""


SETTLED = -1
"""Value of `rounds` if no round of starts is needed, except for twins."""


PLAIN, NARROW, BROAD = 0, 1, 2
"""What is left to try for an arm that nearly has three parallel axes, before the search: nothing; poses around the
target; poses nearer and farther. An arm with a skewed wrist is searched at once, because these poses find fewer of the
solutions that the nearby arm has lost. Not examined further."""


BENT, OPEN, FAINT = 0.01, 1e-3, 5e-4
"""Thresholds for the smallest singular value at the solutions of such an arm. Below the first, poses around the target
are tried. Below the second, the search may follow these. Below the third, its second round follows the first. Not
examined further."""


HARDLY, ASIDE, LITTLE = 0.02, 0.0025, 0.15
"""Thresholds for the angle of axis 6 to the parallel axes below which the search may follow, see `around.least_lean` and
`may_hide`. HARDLY applies to any target. ASIDE is the possible error of joint 1 of the nearby arm, times the root of
the distance of its equation from a double root. The angle is uncertain by that much, but LITTLE is the upper limit.
Elsewhere an odd number shows that poses around the target missed solutions. Not examined further."""


@inlined
def may_hide(leans: float, folded: float) -> bool:
    """Return True if there may be solutions that are not near any of the poses around the target.

    Args:
        leans: Sine of the angle of axis 6, see `around.least_lean`.
        folded: See `closed.FOLDED`.
    """
    return leans < LITTLE and (leans - HARDLY) * math.sqrt(folded) < ASIDE


@inlined
def in_doubt(task: Task, count: int) -> bool:
    """Return True if the number of solutions is suspicious: zero, or odd if all joints turn fully."""
    full = True
    for i in range(len(task.lower)):
        full = full and turns_fully(task, i)
    return count == 0 or (full and count % 2 == 1)


@noinline
def find_branches(
    handle: Indices,
    fine: Indices,
    tolerances: Array,
    mirrors: Array,
    structure: Array,
    joint: Array,
    table: Array,
    steps: Array,
    target: Array,
    view: Array,
    result: Array,
    w: int,
) -> int:
    """Find all solutions of one target, for an arm that is not redundant for the goal.

    Args:
        handle: The task with the coarse atlas, see `task_of`.
        fine: The task with the fine atlas, for a target that no coarse sample leads to.
        tolerances: See `task_of`.
        mirrors: Mirror images, see `twins.SIGNS`, (k, 3, n).
        structure: See `structure.candidates.KIND`, (NUMBERS,).
        joint: Numbers of an arm with one searched joint, see `one_joint_residual.BEGIN`, (one_joint_residual.NUMBERS,).
        table: See `one_joint.HEIGHT`, (PLACES, SAMPLES); without columns for other arms.
        steps: See `seeding.fill_steps`, (samples of the coarse atlas, 6, LANES).
        target: (4, 4), lengths in [m].
        view: See `refine_all.CENTRE`, (3, n); solutions are sorted by weighted distance.
        result: Receives joint values, position error [m], orientation error [rad] and squared distance of each solution,
            and a last row, see `refine_all.ANSWERS`, (at least ROWS + 1, n + ANSWER).
        w: LANES.

    Returns:
        The number of rows; 0 if the target is not a rigid transform.
    """
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return 0
    memory = np.zeros(scratch_size(dof, joints))
    scratch = make_scratch(memory, dof, joints)
    rows, seeds = np.empty((ROWS, dof)), np.empty((DEEP_STARTS, dof))
    tally, image, left, asked = np.zeros(TALLY), np.empty(dof), np.empty(ROWS), np.empty(REPORT)
    starts_reported = np.zeros(3, dtype=np.int64)
    tally[WEAKEST] = np.inf
    start(task, scratch, target)
    count, explored, rounds, kept, done, unsure, reached, settling = 0, 0, 0, 0, False, False, False, False
    left_to_try, tried, known_before, leans = PLAIN, 0, 0, 1.0
    if serves(task, structure):
        closed_starts(task, structure, target, scratch.spare, np.empty(WORK), seeds, asked, w)
        many = int(asked[TRIED])
        count = refine_all(
            handle,
            tolerances,
            memory,
            target,
            seeds,
            many,
            many,
            rows,
            left,
            0,
            view[RATES],
            SIBLING,
            tally,
            w,
        )
        # The closed form is complete if all candidates that must be solutions are found and no angle is undetermined. For
        # an arm that only nearly has its structure, equations without solutions prove nothing: its own may have
        # solutions.
        exact = structure[DEVIATION] <= ROUNDING
        done = asked[UNSURE] == 0.0 and count >= asked[SURE] and (count > 0 or (exact and many == 0))
        # In such an arm an angle is seldom undetermined, and solutions next to its candidates are found early.
        unsure = asked[UNSURE] > 0.0 and exact
        if done and not exact:
            # Where two solutions nearly merge, the nearby equations may have neither; those of this arm lead to one of
            # them.
            settling, done, rounds = True, False, SETTLED
        elif not exact and many > 0 and structure[KIND] == PARALLEL:
            left_to_try, tried, leans = NARROW, many, least_lean(structure, seeds, many)
    elif table.shape[1] > 0 and max(task.position_tolerance, task.orientation_tolerance) <= LOOSE:
        one_joint.searched_starts(handle, tolerances, joint, table, target, seeds, starts_reported, w)
        many = starts_reported[one_joint.MANY]
        count = refine_all(
            handle,
            tolerances,
            memory,
            target,
            seeds,
            many,
            many,
            rows,
            left,
            0,
            view[RATES],
            SIBLING,
            tally,
            w,
        )
        unsure = starts_reported[one_joint.UNSURE] > 0 or count == 0
        done = not unsure and count == many and starts_reported[one_joint.TWINS] == 0
        rounds = 0 if unsure else SETTLED
    samples, room = (0, 0) if done else (len(steps), ROOM)
    distance, near = np.empty(samples), np.empty(samples + 1, dtype=np.int64)
    order, known = np.empty(samples + BUCKETS + 1, dtype=np.int64), np.empty((MOST_JOINTS + 1, room))
    begin, end = 0.0, 0.0
    # Each pass explores around at least one solution, or continues with the next of six kinds of starts.
    for _ in range(ROWS + 6):
        if done or count >= ROWS:
            break
        mode, surely = SEEDED, DEEP_STARTS
        if explored < count:
            last = min(count, explored + LANES)
            many = twins(handle, tolerances, memory, rows, explored, last, seeds, tally, w)
            if settling and tally[WEAKEST] >= WEAK and last == count:
                break
            many = images(task, mirrors, view[RATES], rows, explored, last, seeds, many, image)
            mode, explored = SIBLING, last
            rounds = 0 if rounds == SETTLED and tally[CONTINUA] > 0.0 else rounds
        elif left_to_try != PLAIN:
            first = left_to_try == NARROW
            short, weakest = count < tried, tally[WEAKEST]
            if first:
                ahead = short or weakest < BENT or asked[LOST] > 0.0
            else:
                leans = min(leans, least_lean(structure, rows, count))
                ahead = may_hide(leans, asked[FOLDED]) and (short or weakest < OPEN or count > known_before)
                ahead = ahead or in_doubt(task, count)
            if not (ahead or count < asked[SURE] or tally[CONTINUA] > 0.0):
                break
            begun, ended = (0, FIRST) if first else (FIRST, FINAL)
            many = starts_around(
                handle,
                tolerances,
                memory,
                structure,
                target,
                view[RATES],
                rows,
                count,
                begun,
                ended,
                seeds,
                w,
            )
            known_before, left_to_try = count, BROAD if first else PLAIN
        elif rounds == 0 or (
            rounds == 1
            and (
                (count > known_before or tally[WEAKEST] < FAINT or in_doubt(task, count))
                if tried > 0
                else (unsure or tally[LATE] > 0.0 or tally[WEAKEST] < WEAK or in_doubt(task, count))
            )
        ):
            known_before = count
            if rounds == 0 and samples > 0:
                see(task, scratch, target)
                coordinates(scratch.seen, task.division, scratch.point)
                measure_samples(task.atlas.tree.points, scratch.point, distance)
            most, limit = (STARTS, FIRST_ROOM) if rounds == 0 else (DEEP_STARTS, DEEP_STARTS)
            begin, end = end, radius(distance, most)
            found = sort_samples(distance, begin, end, limit, near, order)
            thin = rounds == 0 or not (unsure or tally[WEAKEST] < WEAK)
            many = spread_starts(task, scratch, steps, order, found, view[RATES], thin, known, kept, seeds, w)
            surely = int(SURELY * many) if rounds == 0 else surely
            kept, rounds = kept + many, rounds + 1
        elif rounds == 2 and count == 0:
            other = solve_pose(fine, tolerances, target, w)
            tally[EVALUATED] += other[dof + EVALUATIONS]
            for i in range(dof):
                seeds[0, i] = other[i]
            mode, many, rounds = SIBLING, 1, 3
            reached = other[dof + POSITION_ERROR] <= task.position_tolerance
            reached = reached and other[dof + ORIENTATION_ERROR] <= task.orientation_tolerance
        else:
            break
        count = refine_all(
            handle,
            tolerances,
            memory,
            target,
            seeds,
            surely,
            many,
            rows,
            left,
            count,
            view[RATES],
            mode,
            tally,
            w,
        )
        # At the boundary of the workspace steps may lead away from a solution that is not exact.
        if reached and count == 0:
            for i in range(dof):
                rows[0, i] = seeds[0, i]
            count, reached = 1, False
    result[count, ANSWERS] = sorted_rows(
        task, scratch, target, rows, count, view[CENTRE], view[SCALE], result
    )
    endless = tally[CONTINUA] > 0.0 or count == ROWS
    result[count, SPENT], result[count, CONTINUUM] = tally[EVALUATED], 1.0 if endless else 0.0
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return count + 1


@entry
def many_branches(
    handle: Handle,
    fine: Handle,
    tolerances: Annotated[Array, TOLERANCES],
    mirrors: Annotated[Array, "*", 3, "n"],
    structure: Annotated[Array, NUMBERS],
    joint: Annotated[Array, one_joint_residual.NUMBERS],
    table: Annotated[Array, one_joint_residual.PLACES, "*"],
    steps: Annotated[Array, "*", 6, LANES],
    targets: Annotated[Array, "k", 4, 4],
    views: Annotated[Array, "*", 3, "n"],
    number: int,
    begin: int,
    end: int,
    results: Annotated[Array, "*", "*", "width", OUT],
    counts: Annotated[Indices, "*", OUT],
    w: int,
) -> None:
    """Run `find_branches`, or `sample_branches` if `number` > 0, for targets begin … end-1, (k, 4, 4).

    Args:
        handle: See `find_branches`.
        fine: See `find_branches`.
        tolerances: See `task_of`.
        mirrors: See `find_branches`.
        structure: See `find_branches`.
        joint: See `find_branches`.
        table: See `find_branches`.
        steps: See `find_branches`; without samples if `number` > 0.
        targets: Rigid transforms, (k, 4, 4), lengths in [m].
        views: One for all or one for each, (1 or k, 3, n).
        number: Number of solutions in a sample, or 0 for all solutions.
        begin: First target.
        end: One past the last target.
        results: Receives the rows of each target, (end - begin, most + 1, n + ANSWER).
        counts: Receives the number of rows, including the last one, (end - begin,).
        w: LANES.
    """
    for t in range(begin, end):
        view = views[t if len(views) > 1 else 0]
        result = results[t - begin]
        if number > 0:
            counts[t - begin] = sample_branches(fine, tolerances, targets[t], view, number, result, w)
        else:
            counts[t - begin] = find_branches(
                handle, fine, tolerances, mirrors, structure, joint, table, steps, targets[t], view, result, w
            )
