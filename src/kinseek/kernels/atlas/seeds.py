"""Starts of a descent: samples near the goal, and starts that do not depend on the goal."""

from __future__ import annotations

import math

from kinseek.kernels.arm.division import nearest_copy, product
from kinseek.kernels.arrays import Array, Limits
from kinseek.kernels.jit import inlined

from .lanes import LANES, Lanes
from .memory import ACTIVE, EMPTY, Scratch
from .samples import Divided, complete_seed, coordinates
from .task import OPEN, Task
from .tree import Neighbours, nearest, scan_beside, take_nearest

FIRST, MORE, RESTARTS, MORE_RESTARTS = 24, 40, 64, 256
"""Samples near a goal that are tried first; samples of a deeper look-up; restarts after both; and restarts if the
remaining error is small enough to be worth more work."""

TAKES = 2 * FIRST
"""Number of samples taken in two rounds, see `take_seed`."""

AT_ONCE = 4
"""Number of first samples that are refined in parallel: the first nearly always leads to a solution."""

MARGIN = 0.5
"""A sample is not tried if its first or last joint is farther beyond its limits than this [rad or m], see
`complete_seed`."""

CONVERGED = 30
"""Iterations after which the root of x^(n+1) = x + 1 is exact: each reduces the error to less than a third."""


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
    """Set the target of one lane, (3, 4)."""
    for r in range(3):
        for c in range(4):
            lanes.target[r, c, lane] = target[r, c]


@inlined
def load_seed(lanes: Lanes, lane: int, seed: Array) -> None:
    """Load a start, (n,), into one lane."""
    for i in range(len(seed)):
        lanes.q[i, lane] = seed[i]


@inlined
def load_seed_row(lanes: Lanes, lane: int, rows: Array) -> None:
    """Load a lane's own row of starts, (LANES, n), into it."""
    for i in range(rows.shape[1]):
        lanes.q[i, lane] = rows[lane, i]


@inlined
def see(task: Task, scratch: Scratch, target: Array) -> None:
    """Write a target, (3, 4), in the coordinates of the atlas into the scratch memory."""
    product(task.atlas.inverse_head, target, scratch.between)
    product(scratch.between, task.atlas.inverse_tip, scratch.seen)


@inlined
def look_up(task: Task, scratch: Scratch, target: Array, most: int) -> int:
    """Find at most `most` samples nearest to a target, (3, 4); return their number."""
    see(task, scratch, target)
    coordinates(scratch.seen, task.division, scratch.point)
    neighbours = Neighbours(scratch.distance, scratch.neighbour, scratch.stack, scratch.bound, scratch.leaf)
    return nearest(task.atlas.tree, scratch.point, most, neighbours)


@inlined
def complete(task: Task, scratch: Scratch, i: int, margin: float) -> bool:
    """Write sample i, completed for the goal in `seen`, into the seed of the scratch memory, see `complete_seed`."""
    limits = Limits(task.chain.lower, task.chain.upper)
    return complete_seed(Divided(task.atlas, task.division, limits, margin), scratch.seen, i, scratch.seed)


@inlined
def fill_from_lookup(task: Task, scratch: Scratch, begin: int, found: int) -> tuple[int, int]:
    """Load neighbours from index `begin` on into the lanes; return the next index and the number of lanes filled."""
    filled = 0
    while begin < found and filled < LANES:
        i = scratch.neighbour[begin]
        begin += 1
        if complete(task, scratch, i, MARGIN):
            load_seed(scratch.lanes, filled, scratch.seed)
            scratch.state[filled] = ACTIVE
            filled += 1
    for l in range(filled, LANES):
        scratch.state[l] = EMPTY
    return begin, filled


@inlined
def scan(task: Task, scratch: Scratch, target: Array, w: int) -> int:
    """Compute the distances of samples near a target, (3, 4), for `fill_from_scan`; return the leaf of the target."""
    see(task, scratch, target)
    coordinates(scratch.seen, task.division, scratch.point)
    return scan_beside(task.atlas.tree, scratch.point, scratch.beside, scratch.least, w)


@inlined
def stands_at_limit(q: Array, lower: Array, upper: Array) -> bool:
    """Return True if the first or the last joint is at a limit."""
    last = len(q) - 1
    first_does: bool = q[0] <= lower[0] or q[0] >= upper[0]
    last_does: bool = q[last] <= lower[last] or q[last] >= upper[last]
    return first_does or last_does


@inlined
def take_seed(task: Task, scratch: Scratch, leaf: int, taken: int, w: int) -> tuple[int, bool]:
    """Write the next sample of a scan into the seed of the scratch memory.

    Return the number of samples taken so far, and whether this one is promising.

    There are two rounds. The first takes samples whose first and last joint are within their limits, because most of the
    others fail. The second takes those within the margin, which are now at a limit.
    """
    chain, promising = task.chain, False
    i = take_nearest(task.atlas.tree, leaf, scratch.beside, scratch.least)
    if i >= 0:
        margin = MARGIN if taken >= FIRST else 0.0
        promising = complete(task, scratch, i, margin)
        promising = promising and (taken < FIRST or stands_at_limit(scratch.seed, chain.lower, chain.upper))
        taken += 1
    else:
        taken = FIRST if taken < FIRST else TAKES
    if taken == FIRST:
        scan_beside(task.atlas.tree, scratch.point, scratch.beside, scratch.least, w)
    return taken, promising


@inlined
def fill_from_scan(task: Task, scratch: Scratch, leaf: int, taken: int, w: int) -> tuple[int, int]:
    """Load the next samples of a scan into lanes; return the samples taken so far and the number of lanes filled."""
    filled = 0
    for _ in range(TAKES):
        if taken == TAKES or filled == AT_ONCE:
            break
        taken, promising = take_seed(task, scratch, leaf, taken, w)
        if promising:
            load_seed(scratch.lanes, filled, scratch.seed)
            scratch.state[filled] = ACTIVE
            filled += 1
    for l in range(filled, LANES):
        scratch.state[l] = EMPTY
    return taken, filled


@inlined
def turns_fully(task: Task, i: int) -> bool:
    """Return True if the range of joint i holds a full turn.

    Its limits are then open in the refinement, and infinite for a continuous joint.
    """
    full: bool = task.lower[i] <= -OPEN
    return full


@inlined
def into_limits(task: Task, q: Array, near: Array) -> None:
    """Move every joint that turns fully into its limits by whole turns, near `near`, (n,).

    A continuous joint has no limits: it moves to within π of `near`. The middle of its range is 0, which gives [-π, π].
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
    """Write start `number` of a low-discrepancy sequence over the limits into q (Roberts 2018, R_d)."""
    low_discrepancy_start(task, generalized_golden_ratio(len(q)), number, q)


@inlined
def generalized_golden_ratio(dof: int) -> float:
    """Root of x^(n+1) = x + 1. Computing it takes longer than computing a start."""
    g = 2.0
    for _ in range(CONVERGED):
        g = (1.0 + g) ** (1.0 / (dof + 1))
    return g


@inlined
def low_discrepancy_start(task: Task, g: float, number: int, q: Array) -> None:
    """Do the same as `restart`, with the root from `generalized_golden_ratio`."""
    step = 1.0
    for i in range(len(q)):
        step /= g
        low, high = task.chain.lower[i], task.chain.upper[i]
        q[i] = low + ((0.5 + (number + 1) * step) % 1.0) * (high - low)


@inlined
def kick(task: Task, rows: Array, row: int, size: float, q: Array) -> None:
    """Replace a start that is spread over the limits, (n,), by one around a row, clamped to the limits.

    Solutions may lie in the corners of the limits, where starts in the interior miss them; here many starts lie in a
    corner.
    """
    for i in range(len(q)):
        low, high = task.chain.lower[i], task.chain.upper[i]
        share = (q[i] - low) / max(high - low, 1e-12) - 0.5
        q[i] = min(max(rows[row, i] + size * share * min(high - low, 1.0), low), high)
