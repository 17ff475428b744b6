"""One solution of an arm with a closed form: the candidate nearest to the reference joint values."""

from __future__ import annotations

from kinseek.kernels.atlas.descent import FIRST_STEPS
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import scratch_of
from kinseek.kernels.atlas.one_goal import CORRECTIONS, NEAREST, OFFER
from kinseek.kernels.atlas.seeds import middle
from kinseek.kernels.atlas.task import Job, Joints, Target, task_at
from kinseek.kernels.pointers import routine

from .candidates import NONE, SWEPT_VALUES, displacement, read_structure
from .choice import first_that_converges, first_that_reaches, order_candidates, take_start
from .swept_joint import direction, end_value, given_value

ENOUGH = (CORRECTIONS + 1) * LANES
"""FK evaluations after which no further value of the swept joint is tried."""

MOST_REFINED = (FIRST_STEPS + 1) * LANES // ENOUGH
"""Largest number of values of the swept joint whose candidates are refined: about the time of one round of the search."""


@routine
def closed_routine(job: Job, target: Target, near: Joints, request: int, q: Joints) -> int:
    """Solve one target, (3, 4), by the first candidate that reaches it; write q, (n,).

    Args:
        job: The task and the memory of the call.
        target: The pose to reach.
        near: Current joint values, if the nearest solution is requested.
        request: MIDMOST: the solution nearest to the middle of the ranges comes first. NEAREST: the solution nearest to
            `near` comes first. OFFER + k, for an arm that nearly has its structure: write candidate k of those that are
            refined.
        q: Receives joint values.

    Returns:
        FK evaluations spent. The number is negated if no candidate reaches the target or another solution may be nearer;
        q is then the last candidate checked. 0 if there is no candidate. With OFFER, 1 if the candidate exists, else 0.
    """
    task, w = task_at(job), job.width
    scratch, S, close = scratch_of(job, task), task.structure, request == NEAREST
    s = read_structure(S)
    values, spent, value, refined, skip = int(s.swept), 0, 0.0, 0, request - OFFER
    # The closed form of a nearby arm may miss a solution at a limit, possibly the nearest; and a swept joint has many
    # values.
    if s.kind == NONE or (close and (task.exact == 0 or values > 0)):
        return 0
    if not close:
        middle(task, scratch.seed)
        near = scratch.seed
    displacement(S, target, scratch.displacement)
    towards = direction(s, scratch.displacement) if values > 0 else 0.0
    # The ends of its range come last: if few solutions remain, they are often there.
    for k in range(values + 2 if values > 0 else 1):
        if spent > ENOUGH or refined == MOST_REFINED:
            break
        if values > 0:
            value, inside = (
                end_value(task, k - values)
                if k >= values
                else given_value(task, towards + S[SWEPT_VALUES + k], near)
            )
            if not inside:
                continue
        sure = order_candidates(task, scratch, value, near, close, w)
        if request >= OFFER:
            offered = 0
            while offered < LANES and take_start(task, scratch, q):
                if skip == 0:
                    return 1
                offered, skip = offered + 1, skip - 1
            refined += 1 if offered > 0 else 0
            continue
        if task.exact == 0:
            more = first_that_converges(job, task, scratch, target, q)
            refined += 1 if more != 0 else 0
        else:
            more = first_that_reaches(task, scratch, target, near, q)
        if more > 0:
            spent += more
            # A rejected candidate may have a solution beside it.
            return -spent if close and not (sure and spent == 1) else spent
        spent -= more
    return 0 if request >= OFFER else -spent
