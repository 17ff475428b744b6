"""Where a descent starts: samples beside the goal, and starts that owe nothing to it."""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import nearest_copy, product
from kinseek.kernels.arrays import Array
from kinseek.kernels.jit import inlined

from .lanes import LANES, Lanes
from .memory import Scratch
from .samples import complete_seed, coordinates
from .task import OPEN, Task
from .tree import nearest, scan_beside, take_nearest

FIRST, MORE, RESTARTS, MORE_RESTARTS = 24, 40, 64, 256
"""Samples beside a goal that are tried first, samples of a deeper lookup, restarts after both, and restarts where what is
left is so little that more work is worth it."""


TAKES = 2 * FIRST
"""How often a sample is taken in two rounds, see `take_seed`."""


AT_ONCE = 4
"""Of the first samples, so many are refined side by side: the first nearly always leads to an answer."""


MARGIN = 0.5
"""A sample whose first or last joint comes out farther beyond its limits [rad or m] is not tried, see `complete_seed`."""


CONVERGED = 30
"""Turns after which the root of x^(n+1) = x + 1 stands: each leaves less than a third of what it is off."""


@inlined
def copy_joints(rows: Array, row: int, q: Array) -> None:
    """Copy one row of joint values."""
    for i in range(len(q)):
        q[i] = rows[row, i]


@inlined
def keep_joints(rows: Array, row: int, q: Array) -> None:
    """Overwrite one row of joint values."""
    for i in range(len(q)):
        rows[row, i] = q[i]


@inlined
def load_target(lanes: Lanes, lane: int, target: Array) -> None:
    """Give one lane its target, (3, 4)."""
    for r in range(3):
        for c in range(4):
            lanes.target[(4 * r + c) * LANES + lane] = target[r, c]


@inlined
def load_seed(lanes: Lanes, lane: int, seed: Array) -> None:
    """Put one lane at a start, (n,)."""
    for i in range(len(seed)):
        lanes.q[i, lane] = seed[i]


@inlined
def load_seed_row(lanes: Lanes, lane: int, rows: Array) -> None:
    """Put one lane at the start in its row, (LANES, n)."""
    for i in range(rows.shape[1]):
        lanes.q[i, lane] = rows[lane, i]


@inlined
def see(task: Task, scratch: Scratch, target: Array) -> None:
    """Write a target, (3, 4), as the atlas sees it into the scratch memory."""
    product(task.atlas.inverse_head, target, scratch.between)
    product(scratch.between, task.atlas.inverse_tip, scratch.seen)


@inlined
def look_up(task: Task, scratch: Scratch, target: Array, most: int) -> int:
    """Find the samples nearest to a target, (3, 4), so many at most; return how many."""
    see(task, scratch, target)
    coordinates(scratch.seen, task.division, scratch.point)
    return nearest(
        task.atlas.tree,
        scratch.point,
        most,
        scratch.distance,
        scratch.neighbour,
        scratch.stack,
        scratch.bound,
    )


@inlined
def fill_from_lookup(task: Task, scratch: Scratch, begin: int, found: int) -> tuple[int, int]:
    """Put neighbours into the lanes from number `begin` on; return the next number and the lanes filled."""
    filled = 0
    while begin < found and filled < LANES:
        i = scratch.neighbour[begin]
        begin += 1
        if complete_seed(
            task.atlas,
            task.division,
            scratch.seen,
            i,
            task.chain.lower,
            task.chain.upper,
            MARGIN,
            scratch.seed,
        ):
            load_seed(scratch.lanes, filled, scratch.seed)
            scratch.state[filled] = 0
            filled += 1
    for l in range(filled, LANES):
        scratch.state[l] = 2
    return begin, filled


@inlined
def scan(task: Task, scratch: Scratch, target: Array, w: int) -> int:
    """Measure the samples beside a target, (3, 4), for `fill_from_scan`; return the leaf it lies in."""
    see(task, scratch, target)
    coordinates(scratch.seen, task.division, scratch.point)
    return scan_beside(task.atlas.tree, scratch.point, scratch.distance, scratch.bound, w)


@inlined
def stands_at_limit(q: Array, lower: Array, upper: Array) -> bool:
    """Does the first joint or the last stand at a limit?"""
    last = len(q) - 1
    first_does: bool = q[0] <= lower[0] or q[0] >= upper[0]
    last_does: bool = q[last] <= lower[last] or q[last] >= upper[last]
    return first_does or last_does


@inlined
def take_seed(task: Task, scratch: Scratch, leaf: int, taken: int, w: int) -> tuple[int, bool]:
    """Put the next sample of a scan into the scratch memory's seed.

    Return how many are taken by now, and whether it is worth a try.

    There are two rounds: first those whose first and last joint come out inside their limits, for most of the others fail;
    then those that are within the margin, and stand at a limit now.
    """
    chain, worth = task.chain, False
    i = take_nearest(task.atlas.tree, leaf, scratch.distance, scratch.bound)
    if i >= 0:
        margin = MARGIN if taken >= FIRST else 0.0
        worth = complete_seed(
            task.atlas, task.division, scratch.seen, i, chain.lower, chain.upper, margin, scratch.seed
        )
        worth = worth and (taken < FIRST or stands_at_limit(scratch.seed, chain.lower, chain.upper))
        taken += 1
    else:
        taken = FIRST if taken < FIRST else TAKES
    if taken == FIRST:
        scan_beside(task.atlas.tree, scratch.point, scratch.distance, scratch.bound, w)
    return taken, worth


@inlined
def fill_from_scan(task: Task, scratch: Scratch, leaf: int, taken: int, w: int) -> tuple[int, int]:
    """Put the next samples of a scan into lanes; return how many are taken by now and the lanes filled."""
    filled = 0
    for _ in range(TAKES):
        if taken == TAKES or filled == AT_ONCE:
            break
        taken, worth = take_seed(task, scratch, leaf, taken, w)
        if worth:
            load_seed(scratch.lanes, filled, scratch.seed)
            scratch.state[filled] = 0
            filled += 1
    for l in range(filled, LANES):
        scratch.state[l] = 2
    return taken, filled


@inlined
def turns_fully(task: Task, i: int) -> bool:
    """Does the range of joint i hold a full turn? Then its limits are open, infinitely so where it never ends."""
    full: bool = task.lower[i] <= -OPEN
    return full


@inlined
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


@inlined
def middle(task: Task, q: Array) -> None:
    """Write the middle of every range into q, (n,)."""
    for i in range(len(q)):
        q[i] = 0.5 * (task.chain.lower[i] + task.chain.upper[i])


@inlined
def restart(task: Task, number: int, q: Array) -> None:
    """Write start `number` of a low-discrepancy sequence over the limits (Roberts 2018, R_d)."""
    spread_start(task, spread_root(len(q)), number, q)


@inlined
def spread_root(dof: int) -> float:
    """The root of x^(n+1) = x + 1, which takes longer to find than a start does."""
    g = 2.0
    for _ in range(CONVERGED):
        g = (1.0 + g) ** (1.0 / (dof + 1))
    return g


@inlined
def spread_start(task: Task, g: float, number: int, q: Array) -> None:
    """As `restart`, with the root of `spread_root`."""
    step = 1.0
    for i in range(len(q)):
        step /= g
        low, high = task.chain.lower[i], task.chain.upper[i]
        q[i] = low + ((0.5 + (number + 1) * step) % 1.0) * (high - low)


@inlined
def kick(task: Task, rows: Array, row: int, size: float, q: Array) -> None:
    """Turn a start that is spread over the limits, (n,), into one around a row, brought back to the limits.

    Answers hide in the corners of the limits, where a start inside leads past them; here many starts lie in one.
    """
    for i in range(len(q)):
        low, high = task.chain.lower[i], task.chain.upper[i]
        share = (q[i] - low) / max(high - low, 1e-12) - 0.5
        q[i] = min(max(rows[row, i] + size * share * min(high - low, 1.0), low), high)
