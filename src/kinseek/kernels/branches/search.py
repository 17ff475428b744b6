"""Search for all solutions of a goal: many starts in parallel, and from each solution the way to its siblings.

The sources of starts are tried in order, until the solutions are complete as far as is known:

1. the closed form of the arm (`structure.closed`), or the search of one joint (`one_joint`);
2. poses around the target, nearer ones and then farther ones, if the arm nearly has three parallel axes (`around`);
3. the nearest samples of a coarse atlas, and then more of them (`seeding`);
4. one start that the fine atlas leads to, if none was found.

A coarse atlas is better here: the nearest sixty of a thousand samples lie all over the joint space, but those of sixteen
thousand crowd around the solutions that are closest to a singularity, where many joint values have nearly one pose. After
each source the siblings of the new solutions are refined, see `twins`. They cost almost nothing, and close to a singularity
no start would distinguish a solution from its twin. Mirror images are those of a spherical wrist, which has every pose at
(…, q_4 + π, -q_5, q_6 + π) too. They are found once per arm (see `branches.find`).

Three cases call for more samples: a solution that is found late, a solution close to a singularity, and an odd number of
solutions if all joints turn fully. Away from singularities solutions appear and vanish in pairs, and only limits make
their number odd.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arm.pose_error import is_rigid
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.descent import start
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import Scratch, make_scratch, scratch_of, scratch_size
from kinseek.kernels.atlas.seeds import copy_joints, into_limits, keep_joints, turns_fully
from kinseek.kernels.atlas.task import (
    ORIENTATION_ERROR,
    POSITION_ERROR,
    TOLERANCES,
    Handle,
    Job,
    Task,
    lanes_of,
    task_at,
    task_of,
)
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import counted, entry, inlined, noinline
from kinseek.kernels.structure.candidates import LOOSE, NUMBERS, PARALLEL, ROUNDING, read_structure
from kinseek.kernels.structure.closed import closed_starts, serves

from . import one_joint_residual
from .around import least_lean, write_starts_around
from .distance import MOST_JOINTS, squared_gap
from .one_joint import write_searched_starts
from .refine_all import (
    ANSWERS,
    CONTINUA,
    LATE,
    SEEDED,
    SIBLING,
    TALLY,
    WEAKEST,
    Batch,
    Search,
    metric_of,
    refine_all,
    refine_stranded,
    report_solutions,
)
from .sample import sample_branches, write_atlas_start
from .seeding import DEEP_STARTS, ROOM, Round, write_sampled_starts
from .twins import WEAK, refine_siblings

SURELY = 0.6
"""If a start after this fraction of the starts leads to a new solution, more may be missing. Not examined further."""

ROWS = 64
"""Largest number of solutions. Six joints have at most sixteen isolated ones (Primrose 1986); more form a continuum."""

NEAR_POSES, FAR_POSES, NEAR_SAMPLES, FAR_SAMPLES = 0, 1, 2, 3
"""Sources of starts after the geometry of the arm, in the order in which they are tried."""

COMPLETE, TWINS, SIBLINGS, POSES, NEAREST, SAMPLES = 0, 1, 2, 3, 4, 5
"""What is left to do after the geometry of the arm: nothing; twins, if a solution is close to a singularity; siblings of
the solutions; all sources, from poses around the target on; samples, but more than the nearest only if these led to a new
solution; or all from samples on. An arm with a skewed wrist has no poses tried, because they find fewer of the solutions
that the nearby arm has lost. Not examined further."""

BENT, OPEN, FAINT = 0.01, 1e-3, 5e-4
"""Thresholds for the smallest singular value at the solutions of an arm that nearly has three parallel axes. Below the
first, poses around the target are tried. Below the second, farther ones and samples may follow these. Below the third,
more samples follow. Not examined further."""

HARDLY, ASIDE, LITTLE = 0.02, 0.0025, 0.15
"""Thresholds for the angle of axis 6 to the parallel axes below which the search may follow, see `around.least_lean` and
`may_hide`. HARDLY applies to any target. ASIDE is the possible error of joint 1 of the nearby arm, times the root of
the distance of its equation from a double root. The angle is uncertain by that much, but LITTLE is the upper limit.
Elsewhere an odd number shows that poses around the target missed solutions. Not examined further."""


HARDLY_BEYOND, TURNED = 10.0, 1e-12
"""Largest distance of a solution beyond a limit, as a multiple of the tolerances, with which it is refined with that limit;
and the smallest [rad], which is more than full turns change by rounding."""


class ArmTables(NamedTuple):
    """Data of an arm and a kind of goal."""

    handle: Handle
    """The task with the coarse atlas, see `task_of`."""
    fine: Handle
    """The task with the fine atlas, for a target that no coarse sample leads to."""
    mirrors: Annotated[Array, "*", 3, "n"]
    """Mirror images, see `twins.SIGNS`, (k, 3, n)."""
    structure: Annotated[Array, NUMBERS]
    """See `structure.candidates.STRUCTURE`, (NUMBERS,)."""
    joint: Annotated[Array, one_joint_residual.NUMBERS]
    """Numbers of an arm with one searched joint, see `one_joint_residual.BEGIN`, (one_joint_residual.NUMBERS,)."""
    table: Annotated[Array, one_joint_residual.PLACES, "*"]
    """See `one_joint_residual.HEIGHT`, (PLACES, SAMPLES); without columns for other arms."""
    steps: Annotated[Array, "*", 6, LANES]
    """See `seeding.fill_steps`, (samples of the coarse atlas, 6, LANES)."""


class Plan(NamedTuple):
    """What the geometry of the arm has given, and what is left to do."""

    left: int
    """See `COMPLETE`."""
    found: int
    """Number of solutions."""
    tried: int
    """Number of starts that led to them."""
    sure: int
    """How many of these starts must have become solutions."""
    unsure: bool
    """Whether there may be solutions that no start leads to, for a reason other than a singularity."""
    lost: bool
    """Whether the nearby arm may have lost solutions of this arm."""
    folded: float
    """See `closed.Closed.folded`."""
    lean: float
    """Sine of the smallest angle of axis 6 to three nearly parallel axes at any start, see `around.least_lean`."""


@noinline
def find_branches(arm: ArmTables, tolerances: Array, target: Array, view: Array, result: Array) -> int:
    """Find all solutions of one target, for an arm that is not redundant for the goal.

    Args:
        arm: The arm.
        tolerances: See `task_of`.
        target: (4, 4), lengths in [m].
        view: Rows of a `refine_all.Metric`, (3, n).
        result: See `refine_all.report_solutions`, (at least ROWS + 1, n + ANSWER).

    Returns:
        The number of rows; 0 if the target is not a rigid transform.
    """
    task = task_of(arm.handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    if not is_rigid(target):
        return 0
    memory, starts = np.zeros(scratch_size(dof, joints)), np.empty((DEEP_STARTS, dof))
    scratch, tally = make_scratch(memory, dof, joints), np.zeros(TALLY)
    job = Job(arm.handle, tolerances, memory, lanes_of(arm.handle))
    tally[WEAKEST] = np.inf
    search = Search(job, target, metric_of(view), starts, np.empty((ROWS, dof)), np.empty(ROWS), tally)
    start(task, scratch, target)
    plan = Plan(SAMPLES, 0, 0, 0, False, False, 0.0, 1.0)
    if serves(task, arm.structure):
        plan = try_closed_form(arm, task, scratch, search)
    elif arm.table.shape[1] > 0 and max(task.position_tolerance, task.orientation_tolerance) <= LOOSE:
        plan = try_one_joint(arm, search)
    count = plan.found
    if plan.left != COMPLETE:
        count = refine_siblings(search, arm.mirrors, 0, count, plan.left == TWINS)
        known, before, kept = np.empty((MOST_JOINTS, ROOM)), 0, 0
        for source in range(NEAR_POSES if plan.left == POSES else NEAR_SAMPLES, FAR_SAMPLES + 1):
            if count >= ROWS or not is_worth_trying(source, arm, search, plan, count, before):
                break
            before, late = count, DEEP_STARTS
            if source <= FAR_POSES:
                many = write_starts_around(search, arm.structure, source == FAR_POSES, count)
            else:
                first = source == NEAR_SAMPLES
                thin = first or not (plan.unsure or tally[WEAKEST] < WEAK)
                many = write_sampled_starts(search, arm.steps, known, Round(not first, kept, thin))
                kept += many
                late = int(SURELY * many) if first else DEEP_STARTS
            count = refine_stranded(search, refine_all(search, Batch(0, many, late, SEEDED), count))
            count = refine_siblings(search, arm.mirrors, before, count, False)
        count = return_to_limits(arm, search, count)
    rows = report_solutions(search, search.rows, count, tally[CONTINUA] > 0.0 or count == ROWS, result)
    if plan.left != COMPLETE and result[rows - 1, ANSWERS] == 0.0:
        # Found are at most solutions beyond limits that the search ignores.
        count = try_fine_atlas(arm, search)
        count = refine_siblings(search, arm.mirrors, 0, count, False)
        rows = report_solutions(search, search.rows, count, tally[CONTINUA] > 0.0, result)
    memory[0] = 0.0  # Its last use, see `one_goal.solve_pose`.
    return rows


@inlined
def try_closed_form(arm: ArmTables, task: Task, scratch: Scratch, search: Search) -> Plan:
    """Refine the candidates of the closed form, see `structure.closed`.

    They are complete if all that must be solutions are found and no angle is undetermined. For an arm that only nearly has
    its structure, equations without solutions prove nothing: its own may have solutions. Where two solutions nearly
    merge, the nearby equations may have neither; those of this arm lead to one of them, and the other is its twin.
    """
    structure, starts = arm.structure, search.starts
    closed = closed_starts(task, structure, search.target, scratch, starts, search.job.width)
    tried, sure, unsure = closed.tried, closed.sure, closed.unsure
    count = refine_all(search, Batch(0, tried, tried, SIBLING), 0)
    axes = read_structure(structure)
    exact, left, lean = axes.deviation <= ROUNDING, SAMPLES, 1.0
    if not unsure and count >= sure and (count > 0 or (exact and tried == 0)):
        left = COMPLETE if exact else NEAREST if closed.swaying else TWINS
    elif not exact and tried > 0 and axes.kind == PARALLEL:
        left, lean = POSES, least_lean(structure, starts, tried)
    # In an arm that only nearly has its structure, an angle is seldom undetermined, and solutions next to its candidates
    # are found early.
    return Plan(left, count, tried, sure, unsure and exact, closed.lost, closed.folded, lean)


@inlined
def try_one_joint(arm: ArmTables, search: Search) -> Plan:
    """Refine the starts that the search of one joint leads to, see `one_joint`."""
    starts = write_searched_starts(search, arm.joint, arm.table)
    count = refine_all(search, Batch(0, starts.number, starts.number, SIBLING), 0)
    unsure = starts.unsure or count == 0
    left = SIBLINGS if count < starts.number or starts.close else COMPLETE
    return Plan(SAMPLES if unsure else left, count, starts.number, 0, unsure, False, 0.0, 1.0)


@inlined
def is_worth_trying(source: int, arm: ArmTables, search: Search, plan: Plan, count: int, before: int) -> bool:
    """Return True if solutions may be missing that a source of starts leads to.

    Args:
        source: See `NEAR_POSES`.
        arm: The arm.
        search: The search.
        plan: What the geometry of the arm has given.
        count: Number of solutions.
        before: Their number before the previous source was tried.
    """
    task, weakest = task_of(search.job.handle, search.job.tolerances), search.tally[WEAKEST]
    endless, gained = search.tally[CONTINUA] > 0.0, count > before
    short, doubtful = count < plan.tried, is_suspicious(task, count)
    if source == NEAR_POSES:
        return short or weakest < BENT or plan.lost or count < plan.sure or endless
    if source == FAR_POSES:
        lean = min(plan.lean, least_lean(arm.structure, search.rows, count))
        hidden = may_hide(lean, plan.folded) and (short or weakest < OPEN or gained)
        return hidden or doubtful or count < plan.sure or endless
    if source == NEAR_SAMPLES:
        return endless or plan.left >= POSES
    if plan.left != SAMPLES:
        return gained or weakest < FAINT or doubtful
    return plan.unsure or search.tally[LATE] > 0.0 or weakest < WEAK or doubtful


@inlined
def may_hide(lean: float, folded: float) -> bool:
    """Return True if there may be solutions that are not near any of the poses around the target.

    Args:
        lean: Sine of the angle of axis 6, see `around.least_lean`.
        folded: See `closed.Closed.folded`.
    """
    return lean < LITTLE and (lean - HARDLY) * math.sqrt(folded) < ASIDE


@inlined
def is_suspicious(task: Task, count: int) -> bool:
    """Return True for a suspicious number of solutions: zero, or odd if all joints turn fully."""
    full = True
    for i in range(len(task.lower)):
        full = full and turns_fully(task, i)
    return count == 0 or (full and count % 2 == 1)


@counted
def within_limits(arm: ArmTables, search: Search) -> Search:
    """The same search, but with all limits, see `branches.index.GAP`."""
    job = Job(arm.fine, search.job.tolerances, search.job.memory, search.job.width)
    return Search(job, search.target, search.metric, search.starts, search.rows, search.left, search.tally)


@counted
def return_to_limits(arm: ArmTables, search: Search, count: int) -> int:
    """Refine once more, with limits, the solutions that lie hardly beyond one; return the number of solutions.

    Within the tolerances there may be a solution inside the limits. Those far beyond a limit are left to
    `report_solutions`, which removes them.
    """
    task, many = task_at(search.job), 0
    far = HARDLY_BEYOND * max(task.position_tolerance / task.length, task.orientation_tolerance)
    scratch = scratch_of(search.job, task)
    for j in range(count):
        copy_joints(search.rows, j, scratch.seed)
        into_limits(task, scratch.seed, search.metric.centre)
        beyond = math.sqrt(squared_gap(search.metric.rates, search.rows, j, scratch.seed))
        if TURNED < beyond < far:
            keep_joints(search.starts, many, scratch.seed)
            keep_joints(search.rows, j, scratch.seed)
            search.left[j] = np.inf
            many += 1
    if many > 0:
        count = refine_all(within_limits(arm, search), Batch(0, many, many, SIBLING), count)
    return count


@counted
def try_fine_atlas(arm: ArmTables, search: Search) -> int:
    """Refine the solution that the fine atlas leads to; return the number of solutions, 0 or 1."""
    starts = search.starts
    task, dof = task_at(search.job), starts.shape[1]
    found = write_atlas_start(search, arm.fine)
    count = refine_all(within_limits(arm, search), Batch(0, 1, 1, SIBLING), 0)
    reached = found[dof + POSITION_ERROR] <= task.position_tolerance
    if count == 0 and reached and found[dof + ORIENTATION_ERROR] <= task.orientation_tolerance:
        # At the boundary of the workspace steps may lead away from a solution that is not exact.
        search.left[0], count = np.inf, 1
        for i in range(dof):
            search.rows[0, i] = found[i]
    return count


@entry
def many_branches(
    arm: ArmTables,
    tolerances: Annotated[Array, TOLERANCES],
    targets: Annotated[Array, "k", 4, 4],
    views: Annotated[Array, "*", 3, "n"],
    number: int,
    results: Annotated[Array, "k", "*", "width", OUT],
    counts: Annotated[Indices, "k", OUT],
) -> None:
    """Run `find_branches`, or `sample_branches` if `number` > 0, for each target.

    Args:
        arm: The arm.
        tolerances: See `task_of`.
        targets: Rigid transforms, (k, 4, 4), lengths in [m].
        views: One for all or one for each, (1 or k, 3, n).
        number: Number of solutions in a sample, or 0 for all solutions.
        results: Receives the rows of each target, (k, most + 1, n + ANSWER).
        counts: Receives the number of rows, including the last one, (k,).
    """
    for t in range(len(targets)):
        view, result = views[t if len(views) > 1 else 0], results[t]
        if number > 0:
            counts[t] = sample_branches(arm.fine, tolerances, targets[t], view, number, result)
        else:
            counts[t] = find_branches(arm, tolerances, targets[t], view, result)
