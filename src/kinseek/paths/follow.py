"""One continuous motion through many poses: what `Arm.follow` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import freedom
from kinseek.problem import Problem

from .asked import Asked
from .ends import best_valid, fill_missed, inside_limits, refusals, with_ends
from .joints import Turning
from .layers import Layers, isolated_layers
from .nodes import Programme
from .path import Path
from .relaxed import relaxed
from .spare import follow_samples, unbroken
from .why import reasons
from .windows import Windows, best_in_windows, in_windows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Advance = Callable[[int], object]

SAMPLED, AHEAD = 4000, 400
"""Where joints are to spare, poses that are followed together at most, and how far is looked ahead beyond them."""


def follow(asked: Asked, threads: int | None, advance: Advance, take: int | None = None) -> Path:
    """Find joint values for every pose, with as few breaks as possible; see `Arm.follow`.

    Args:
        asked: The path.
        threads: Threads that share the poses; None takes every core.
        advance: Told how many more poses are done.
        take: How many poses the path shall have that is given back, of those that were looked at; None means all.
    """
    part, own = relaxed(asked)
    take = len(asked) if take is None else take
    if freedom(part.problem) > 0:
        q, breaks = _sampled(part, threads, advance)
        _set_ends(part, q)
        q = q[:take, own]
        refused, barred = refusals(asked, q, breaks)
        return _judged(asked.part(0, take), q, np.union1d(breaks, barred), None, refused)
    wide: Layers | Windows
    hopeless: set[int] = set()
    if in_windows(part):
        wide = Windows(part, threads)
        q, breaks = best_in_windows(wide, advance)
    else:
        wide = isolated_layers(part.problem, part.longest.max(axis=0), threads, advance)
        layers = inside_limits(part.problem, wide)
        layers, ends = with_ends(part, fill_missed(part.problem, layers, threads))
        programme = Programme(part, layers)
        q, breaks = best_valid(programme, ends)
        hopeless = programme.hopeless
    _set_ends(part, q)
    known = wide if part.problem is asked.problem else None
    return _judged(asked.part(0, take), q[:take, own], breaks, known, hopeless)


def _set_ends(asked: Asked, q: Array) -> None:
    """Put wanted ends into a way, (N, n), to the last bit; the turns of endless joints are those of the first of them."""
    turning, free = Turning(asked.problem.chain), True
    for wanted, i in ((asked.start, 0), (asked.end, -1)):
        if wanted is None:
            continue
        turns = turning.whole_turns(wanted - q[i])
        if free:
            q += turns
        q[i] = wanted if free else wanted - turns
        free = False


def _sampled(asked: Asked, threads: int | None, advance: Advance) -> tuple[Array, Indices]:
    """As `follow_samples`, but a long path in windows, and one of which only the end is wanted from there on."""
    if asked.end is not None and asked.start is None:
        problem = asked.problem
        turned = replace(
            asked,
            problem=Problem(problem.mechanism, problem.goal.at(problem.goal.target[::-1])),
            start=asked.end,
            end=None,
            longest=np.ascontiguousarray(asked.longest[::-1]),
        )
        q, breaks = _sampled(turned, threads, advance)
        return np.ascontiguousarray(q[::-1]), len(q) - 2 - breaks[::-1]
    if len(asked) <= SAMPLED + AHEAD or asked.closed:
        return follow_samples(asked, threads, advance)
    q = np.empty((len(asked), asked.problem.chain.dof))
    for begin in range(0, len(asked), SAMPLED):
        # Each window begins where the one before ended, and looks ahead of where the next will begin.
        part = asked.part(begin, min(begin + SAMPLED + 1 + AHEAD, len(asked)))
        rows, _ = follow_samples(replace(part, start=q[begin]) if begin else part, threads, _silent)
        q[begin : begin + SAMPLED + 1] = rows[: SAMPLED + 1]
        advance(SAMPLED)
    return q, np.flatnonzero(~unbroken(asked, q))


def _silent(done: int) -> None:
    pass


def _judged(
    asked: Asked, q: Array, breaks: Indices, wide: Layers | Windows | None, hopeless: set[int]
) -> Path:
    """Judge joint values by plain forward kinematics, and say what stands in the way."""
    problem = asked.problem
    goal = problem.goal
    breaks, hopeless = breaks[breaks < len(q) - (not asked.closed)], {i for i in hopeless if i < len(q)}
    errors = goal.measure(problem.arrays, np.ascontiguousarray(q))
    # Whatever was planned, a step that is too large is a break.
    breaks = np.union1d(breaks, np.flatnonzero(~unbroken(asked, q)))
    reached = goal.met(errors)
    reached[list(hopeless)] = False
    path = Path(
        q=q,
        breaks=breaks,
        why=(),
        reached=reached,
        position_error=errors[:, 0].copy(),
        orientation_error=errors[:, 1].copy(),
        problem=problem,
        closed=asked.closed,
    )
    if path.success:
        return path
    return replace(path, why=reasons(asked, path, wide))
