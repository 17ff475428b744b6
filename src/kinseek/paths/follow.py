"""Find one continuous motion through many poses: the implementation of `Arm.follow`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import freedom
from kinseek.errors import PathInterrupted
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.threads import progress_bar

from .arguments import goals_of, read
from .ends import best_valid, fill_missed, inside_limits, refusals, with_ends
from .joints import Turning
from .layers import SAME, Layers, isolated_layers
from .nodes import GRACE, LayerGraph
from .path import Path
from .proofs import with_proofs
from .request import ROUNDING, PathRequest
from .runs import bridged, follow_runs
from .steps import short_steps, steps_of
from .virtual_joints import with_virtual_joints
from .why import reasons

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Advance = Callable[[int], object]

FIRST_PART = 0.35
"""Fraction of a time limit for finding solutions: the calls of the user's functions and the search for the path take about
as long again."""


def follow_poses(
    arm: Mechanism, Ts: Any, options: dict[str, Any], prove: bool, threads: int | None, progress: bool
) -> Path:
    """Read the poses and the options, and follow the poses; see `Arm.follow` for what is raised."""
    goal, broken = goals_of(Ts)
    if broken is not None:
        # The given times and the given end belong to all poses, so they do not apply to the poses that were read.
        options = options | {"end": None, "times": None, "closed": False}
    request = read(arm, goal, **options)
    with progress_bar(progress, len(goal.targets)) as advance:
        path = follow(request, threads, advance)
    if prove:
        path = with_proofs(request, path, threads)
    if broken is not None:
        raise PathInterrupted(
            f"the iterator raised {type(broken).__name__} after {len(path)} poses: {broken}; the path through them is "
            f"in the error's .path",
            path,
        ) from broken
    return path


def follow(request: PathRequest, threads: int | None, advance: Advance, take: int | None = None) -> Path:
    """Find joint values for every pose, with as few breaks as possible; see `Arm.follow`.

    Args:
        request: The path.
        threads: Threads that share the poses; None uses every core.
        advance: Called with the number of poses that were completed since the last call.
        take: Number of poses of the returned path; the others only serve as look-ahead. None returns all.
    """
    part, own = with_virtual_joints(request)
    take = len(request) if take is None else take
    if freedom(part.problem) > 0:
        q = follow_runs(part, threads, advance)
        planned = _ended(part, q)[:take, own]
        request = request.part(0, take)
        if request.valid is not None:
            deadline = request.deadline.at_least(GRACE)
            request = replace(request, valid=replace(request.valid, deadline=deadline))
        refused, forbidden_edges, count = refusals(request, planned)
        return _judged(request, planned[:count], forbidden_edges, None, refused)
    q, breaks, wide, unreachable = _isolated(part, threads, advance)
    q = _ended(part, q)
    known = wide if part.problem is request.problem else None
    return _judged(request.part(0, take), q[:take, own], breaks, known, unreachable)


def _isolated(
    request: PathRequest, threads: int | None, advance: Advance
) -> tuple[Array, Indices, Layers, set[int]]:
    """Follow a path whose solutions are isolated.

    Returns:
        Joint values for every pose, (N, n), or for the first poses if the time is up; breaks; the solutions that were found;
        and the indices of missed poses.
    """
    none = np.zeros((0, request.problem.chain.dof)), np.zeros(0, dtype=np.int64)
    problem, deadline = request.problem, request.deadline
    has_callbacks = request.cost is not None or request.valid is not None
    search = deadline.share(FIRST_PART) if has_callbacks else deadline
    wide = isolated_layers(problem, request.longest.max(axis=0, initial=0.0), threads, advance, search)
    if not len(wide):
        return *none, wide, set()
    layers, missed = fill_missed(problem, inside_limits(problem, wide), threads, deadline)
    if not len(layers):
        return *none, wide, set()
    request = request.part(0, len(layers))
    layers, ends = with_ends(request, layers)
    graph = LayerGraph(request, layers, missed)
    q, breaks = best_valid(graph, ends)
    return bridged(request.part(0, len(q)), q, missed[: len(q)]), breaks, wide, graph.unreachable


def _ended(request: PathRequest, q: Array) -> Array:
    """Insert the given ends into a path, (N, n), exactly; full turns of endless joints follow the first of them.

    A closed path that repeats its first pose at the end gets the joint values of that pose there.
    """
    turning, free = Turning(request.problem.chain), True
    for fixed_q, i in ((request.start, 0), (request.end, -1)):
        if fixed_q is None or not len(q) or (i < 0 and len(q) < len(request)):
            continue
        turns = turning.whole_turns(fixed_q - q[i])
        if free:
            q += turns
        q[i] = fixed_q if free else fixed_q - turns
        # Only the first given end may choose the full turns; the second has to fit the path.
        free = False
    back = len(q) == len(request) and request.closed and request.ends_where_it_begins
    if back and (np.abs(turning.way(q[0] - q[-1])) <= SAME).all():
        q[-1] = q[0] + turning.whole_turns(q[-1] - q[0])
    return q


def _judged(
    request: PathRequest, rows: Array, breaks: Indices, wide: Layers | None, unreachable: set[int]
) -> Path:
    """Evaluate joint values for the first poses, (M, n), by plain forward kinematics; explain breaks and missed poses."""
    problem, turning = request.problem, Turning(request.problem.chain)
    goal, chain = problem.goal, problem.chain
    planned = np.arange(len(request)) < len(rows)
    stay = rows[-1] if len(rows) else request.start
    if stay is None:
        stay = np.clip((chain.lower + chain.upper) / 2, turning.open_lower, turning.open_upper)
    q = np.concatenate([rows, np.repeat(stay[None], len(request) - len(rows), axis=0)])
    errors = goal.measure(problem.arrays, np.ascontiguousarray(q))
    reached = goal.met(errors) & planned
    reached[[i for i in unreachable if i < len(q)]] = False
    # A step that is too large is a break, whatever was planned.
    begin, end = steps_of(request, q)
    torn = ~short_steps(request, begin, end)
    if request.closed and request.ends_where_it_begins:
        torn[-1] |= (np.abs(end[-1] - begin[-1]) > ROUNDING).any()
    torn[breaks[breaks < len(torn)]] = True
    # A step to or from a missed pose is never a break.
    torn &= reached[: len(torn)] & np.roll(reached, -1)[: len(torn)]
    path = Path(
        q=q,
        breaks=np.flatnonzero(torn),
        why=(),
        reached=reached,
        position_error=errors[:, 0].copy(),
        orientation_error=errors[:, 1].copy(),
        problem=problem,
        closed=request.closed,
        planned=planned,
        out_of_time=request.deadline.passed or not bool(planned.all()),
    )
    return path if path.success else replace(path, why=reasons(request, path, wide))
