"""One solution of an arm with a closed form: the candidate nearest to the reference joint values."""

from __future__ import annotations

from kinseek.kernels.atlas.descent import FIRST_STEPS
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import make_scratch, scratch_size
from kinseek.kernels.atlas.one_goal import CORRECTIONS, NEAREST, OFFER
from kinseek.kernels.atlas.seeds import middle
from kinseek.kernels.atlas.task import TOLERANCES, Job, handle_at, task_of
from kinseek.kernels.jit import routine
from kinseek.kernels.pointers import part1, part2

from .candidates import KIND, NONE, SWEPT, SWEPT_VALUES, displacement
from .choice import first_that_converges, first_that_reaches, order_candidates, take_start
from .swept_joint import direction, end_value, given_value

ENOUGH = (CORRECTIONS + 1) * LANES
"""FK evaluations after which no further value of the swept joint is tried."""


LED = (FIRST_STEPS + 1) * LANES // ENOUGH
"""Largest number of values of the swept joint whose candidates are refined: about the time of one round of the search."""


@routine("int64(int64, int64, int64, int64, int64, int64, int64, int64)")
def closed_routine(
    handle_address: int,
    tolerances_address: int,
    memory_address: int,
    target_address: int,
    near_address: int,
    asked: int,
    q_address: int,
    w: int,
) -> int:
    """Solve one target, (3, 4), by the first candidate that reaches it; write q, (n,).

    Args:
        handle_address: As `one_goal.search_routine`.
        tolerances_address: As there.
        memory_address: As there; the scratch memory is as a look-up leaves it.
        target_address: As there.
        near_address: Current joint values, (n,), if the nearest solution is requested.
        asked: MIDMOST: the solution nearest to the middle of the ranges comes first. NEAREST: the solution nearest to
            `near` comes first. OFFER + k, for an arm that nearly has its structure: write candidate k of those that are
            refined.
        q_address: Receives joint values, (n,).
        w: LANES.

    Returns:
        FK evaluations spent. The number is negated if no candidate reaches the target or another solution may be nearer;
        q is then the last candidate checked. 0 if there is no candidate. With OFFER, 1 if the candidate exists, else 0.
    """
    handle, tolerances = handle_at(handle_address), part1(tolerances_address, 0, TOLERANCES)
    task = task_of(handle, tolerances)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = part1(memory_address, 0, scratch_size(dof, joints))
    target, q, near = part2(target_address, 0, 3, 4), part1(q_address, 0, dof), part1(near_address, 0, dof)
    scratch, S, close = make_scratch(memory, dof, joints), task.structure, asked == NEAREST
    values, spent, value, led, skip = int(S[SWEPT]), 0, 0.0, 0, asked - OFFER
    # The closed form of a nearby arm may miss a solution at a limit, possibly the nearest; and a swept joint has many
    # values.
    if S[KIND] == NONE or (close and (task.exact == 0 or values > 0)):
        return 0
    if not close:
        middle(task, scratch.seed)
        near = scratch.seed
    displacement(S, target, scratch.between)
    ahead = direction(S, scratch.between) if values > 0 else 0.0
    # The ends of its range come last: if few solutions remain, they are often there.
    for k in range(values + 2 if values > 0 else 1):
        if spent > ENOUGH or led == LED:
            break
        if values > 0:
            value, inside = (
                end_value(task, k - values)
                if k >= values
                else given_value(task, ahead + S[SWEPT_VALUES + k], near)
            )
            if not inside:
                continue
        sure = order_candidates(task, scratch, value, near, close, w)
        if asked >= OFFER:
            offered = 0
            while offered < LANES and take_start(task, scratch, q):
                if skip == 0:
                    return 1
                offered, skip = offered + 1, skip - 1
            led += 1 if offered > 0 else 0
            continue
        if task.exact == 0:
            job = Job(handle, tolerances, memory, w)
            more = first_that_converges(job, task, scratch, target, q)
            led += 1 if more != 0 else 0
        else:
            more = first_that_reaches(task, scratch, target, near, q)
        if more > 0:
            spent += more
            # A rejected candidate may have a solution beside it.
            return -spent if close and not (sure and spent == 1) else spent
        spent -= more
    return 0 if asked >= OFFER else -spent
