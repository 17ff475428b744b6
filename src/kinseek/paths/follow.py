"""One continuous motion through many poses: what `Arm.follow` does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import freedom
from kinseek.errors import InvalidProblem
from kinseek.problem import Problem

from .asked import Asked
from .ends import best_valid, fill_missed, inside_limits, refusals, with_ends
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


def follow(asked: Asked, threads: int | None, advance: Advance) -> Path:
    """Find joint values for every pose, with as few breaks as possible; see `Arm.follow`."""
    part, own = relaxed(asked)
    problem = part.problem
    if freedom(problem) > 0:
        refuse_cost(asked)
        q, breaks = _sampled(part, advance)
        refused, barred = refusals(asked, q[:, own], breaks)
        breaks = np.union1d(breaks, barred)
        return judged(asked, q[:, own], breaks, None, refused)
    wide: Layers | Windows
    hopeless: set[int] = set()
    if in_windows(part):
        wide = Windows(part, threads)
        q, breaks = best_in_windows(wide, advance)
    else:
        wide = isolated_layers(problem, part.longest.max(axis=0), threads, advance)
        layers = inside_limits(problem, wide)
        layers, ends = with_ends(part, fill_missed(problem, layers, threads))
        programme = Programme(part, layers)
        q, breaks = best_valid(programme, ends)
        hopeless = programme.hopeless
    for wanted, i in ((part.start, 0), (part.end, -1)):
        if wanted is not None:
            q[i] = wanted  # To the last bit.
    return judged(asked, q[:, own], breaks, wide if part is asked else None, hopeless)


def _sampled(asked: Asked, advance: Advance) -> tuple[Array, Indices]:
    """As `follow_samples`, which follows branches from the first pose on: from the last one where only the end is given."""
    if asked.end is None or asked.start is not None:
        return follow_samples(asked, advance)
    problem = asked.problem
    turned = replace(
        asked,
        problem=Problem(problem.mechanism, problem.goal.at(problem.goal.target[::-1])),
        start=asked.end,
        end=None,
        longest=np.ascontiguousarray(asked.longest[::-1]),
    )
    q, breaks = follow_samples(turned, advance)
    return np.ascontiguousarray(q[::-1]), len(q) - 2 - breaks[::-1]


def judged(
    asked: Asked, q: Array, breaks: Indices, wide: Layers | Windows | None, hopeless: set[int]
) -> Path:
    """Judge joint values by plain forward kinematics, and say what stands in the way."""
    problem = asked.problem
    goal = problem.goal
    errors = goal.measure(problem.arrays, np.ascontiguousarray(q))
    # Whatever was planned, a step that is too large is a break.
    breaks = np.union1d(breaks, np.flatnonzero(~unbroken(asked, q)))
    reached = (errors[:, 0] <= goal.position_tolerance) & (errors[:, 1] <= goal.orientation_tolerance)
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


def refuse_cost(asked: Asked) -> None:
    """Refuse a cost of the user where the whole self-motion is smoothed, which knows distances alone.

    Raises:
        InvalidProblem: There is one.
    """
    if asked.cost is not None:
        raise InvalidProblem(
            "cost= chooses among isolated answers; where joints are to spare, the path is made short along the self-motion: "
            "give weights= or velocity= instead"
        )
