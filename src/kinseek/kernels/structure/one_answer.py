"""One answer of an arm with a closed form: of its candidates the one nearest to where it is wanted."""

from __future__ import annotations

from kinseek.kernels.atlas.descent import FIRST_STEPS
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import desk_size, make_desk
from kinseek.kernels.atlas.one_goal import NEAREST
from kinseek.kernels.atlas.seeds import middle
from kinseek.kernels.atlas.task import WANTED, handle_at, task_of
from kinseek.kernels.jit import routine
from kinseek.kernels.pointers import part1, part2

from .candidates import KIND, LEADS, NONE, SWEPT, displacement
from .choice import CORRECTIONS, first_that_reaches, order_candidates
from .front import direction, end_value, given_value

MOST = (FIRST_STEPS + 1) * LANES
"""Candidates judged at most: what one round of the search takes."""


@routine("int64(int64, int64, int64, int64, int64, int64, int64, int64)")
def closed_routine(
    handle_address: int,
    wanted_address: int,
    memory_address: int,
    target_address: int,
    near_address: int,
    asked: int,
    q_address: int,
    w: int,
) -> int:
    """Answer one target, (3, 4), by the candidate that comes first of those that reach it; write q, (n,).

    Args:
        handle_address: As `one_goal.search_routine`.
        wanted_address: As there.
        memory_address: As there; the desk is as a look-up leaves it.
        target_address: As there.
        near_address: Where the arm is, (n,), if the nearest answer is asked for.
        asked: MIDMOST: the answer nearest to the middle of the ranges comes first; NEAREST: that nearest to `near`.
        q_address: Receives joint values, (n,).
        w: LANES.

    Returns:
        FK evaluations spent. Where no candidate reaches the target, or another answer may be nearer, as many less than 0; q
        is then the last that was looked at. 0 where there is no candidate.
    """
    handle, wanted = handle_at(handle_address), part1(wanted_address, 0, WANTED)
    task = task_of(handle, wanted)
    dof, joints = len(task.lower), len(task.chain.leader)
    memory = part1(memory_address, 0, desk_size(dof, joints))
    target, q, near = part2(target_address, 0, 3, 4), part1(q_address, 0, dof), part1(near_address, 0, dof)
    desk, S, close = make_desk(memory, dof, joints), task.structure, asked == NEAREST
    values, judged, value = int(S[SWEPT]), 0, 0.0
    # Of a nearby arm the closed form may lack an answer at a limit, and with it the nearest; values of a joint are many.
    if S[KIND] == NONE or (close and (task.exact == 0 or values > 0)):
        return 0
    if not close:
        middle(task, desk.seed)
        near = desk.seed
    displacement(S, target, desk.between)
    ahead = direction(S, desk.between) if values > 0 else 0.0
    # Last come the ends of its range: where few answers are left, they often stand there.
    for k in range(values + 2 if values > 0 else 1):
        if judged + LANES * (1 + CORRECTIONS) > MOST:
            break
        if values > 0:
            value, inside = (
                end_value(task, k - values) if k >= values else given_value(task, ahead + S[LEADS + k], near)
            )
            if not inside:
                continue
        sure = order_candidates(task, desk, value, near, close, w)
        more = first_that_reaches(task, desk, target, near, value, q, w)
        if more > 0:
            judged += more
            # One that was refused may have an answer beside it.
            return -judged if close and not (sure and judged == 1) else judged
        judged -= more
    return -judged
