"""Find one continuous motion through many poses: the implementation of `Arm.follow`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import freedom
from kinseek.errors import PathInterrupted
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.threads import progress_bar
from kinseek.timing.obstacles import unchanged

from .arguments import goals_of, read
from .branches import SAME
from .bridge import bridged
from .graph import LayerGraph, best_allowed
from .joints import Turning
from .judge import Plan, checked, judged
from .layers import fill_missed, inside_limits, isolated_layers, with_ends
from .path import Path
from .proofs import with_proofs
from .request import PathRequest
from .runs import follow_runs

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
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
    scene = None if request.valid is None else request.valid.scene
    with unchanged(scene, "follow"):
        with progress_bar(progress, len(goal.targets)) as advance:
            path = (follow if request.limits is None else fastest)(request, threads, advance)
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
    part, own = request.without_ranges()
    take = len(request) if take is None else take
    taken = request.part(0, take)
    if freedom(part.problem) > 0:
        q = _with_ends(part, follow_runs(part, threads, advance))[:take, own]
        return judged(taken, checked(taken, q))
    plan = _isolated(part, threads, advance)
    q = _with_ends(part, plan.q)[:take, own]
    # Solutions for an arm with joints for ranges do not explain the path of the arm itself.
    layers = plan.layers if part is request else None
    return judged(taken, plan._replace(q=q, layers=layers))


def fastest(request: PathRequest, threads: int | None, advance: Advance) -> Path:
    """Find the path with the shortest duration; see `fastest_of`."""
    from .fastest import fastest_of

    return fastest_of(request, lambda one, report: follow(one, threads, report), advance)


def _isolated(request: PathRequest, threads: int | None, advance: Advance) -> Plan:
    """Follow a path whose solutions are isolated."""
    problem, deadline = request.problem, request.deadline
    has_callbacks = request.cost is not None or request.valid is not None
    search = deadline.share(FIRST_PART) if has_callbacks else deadline
    wide = isolated_layers(problem, request.longest.max(axis=0, initial=0.0), threads, advance, search)
    layers, missed = fill_missed(problem, inside_limits(problem, wide), threads, deadline)
    if not len(layers):
        return Plan(np.zeros((0, problem.chain.dof)), np.zeros(0, dtype=np.int64), missed, wide)
    request = request.part(0, len(layers))
    layers, ends = with_ends(request, layers)
    missed = missed & ~_reached_by_ends(request)
    graph = LayerGraph(request, layers, missed)
    q, breaks = best_allowed(graph, ends)
    # Without rules the errors alone decide: the way over missed poses may reach one of them, by rounding.
    refused = graph.unreachable if request.valid is not None else np.zeros(len(q), dtype=np.bool_)
    return Plan(bridged(request.part(0, len(q)), q, missed[: len(q)]), breaks, refused, wide)


def _reached_by_ends(request: PathRequest) -> Flags:
    """Return flags of the poses that the given start or end reaches, (N,); the search may miss these, by rounding."""
    reached, goal = np.zeros(len(request), dtype=np.bool_), request.problem.goal
    for fixed_q, i in ((request.start, 0), (request.end, -1)):
        if fixed_q is not None:
            one = goal.at(goal.target[[i]])
            reached[i] |= one.met(one.measure(request.problem.arrays, fixed_q[None]))[0]
    return reached


def _with_ends(request: PathRequest, q: Array) -> Array:
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
