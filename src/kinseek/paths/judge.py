"""Judge planned joint values: which poses they reach, which steps are breaks, and why."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.support.deadline import TimeUp

from .graph import GRACE
from .joints import Turning
from .layers import Layers
from .path import Path
from .request import ROUNDING, PathRequest
from .steps import short_steps, steps_of
from .why import reasons

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Plan(NamedTuple):
    """What a planner found."""

    q: Array
    """Joint values of all poses, or of the first ones if the time was up, (M, n)."""
    breaks: Indices
    """Poses from which the step to the next is not allowed, (k,)."""
    refused: Flags
    """Flags of the poses at which no solution is allowed, (M or more,)."""
    layers: Layers | None
    """All isolated solutions; None for a redundant arm."""


def checked(request: PathRequest, q: Array) -> Plan:
    """Check joint values, (M, n), against the scene and the user's `valid`, for `GRACE` at least, see there."""
    nowhere = np.zeros(0, dtype=np.int64)
    if request.valid is None or not len(q):
        return Plan(q, nowhere, np.zeros(len(q), dtype=np.bool_), None)
    valid, breaks = request.valid.at_least(GRACE), [nowhere]
    goal, refused = request.problem.goal, np.zeros(len(q), dtype=np.bool_)
    begin, end = steps_of(request, q)
    # Steps to and from a missed pose are not checked, nor are steps that are breaks in any case.
    short = short_steps(request, begin, end)
    goal = goal.at(goal.target[: len(q)])
    there = goal.met(goal.measure(request.problem.arrays, np.ascontiguousarray(q)))
    size = valid.at_once(len(q))
    for first in range(0, len(q), size):
        try:
            some = first + np.flatnonzero(there[first : first + size])
            refused[some] = ~valid.each(q[some])
            ways = np.arange(max(first - 1, 0), min(first + size, len(q)) - 1)
            if len(begin) == len(q) and first + size >= len(q):
                ways = np.append(ways, len(q) - 1)
            fine = np.asarray(there & ~refused)
            ways = ways[short[ways] & fine[ways] & fine[(ways + 1) % len(q)]]
            breaks.append(ways[~valid.ways(begin[ways], end[ways])])
        except TimeUp:
            return Plan(q[:first], np.concatenate(breaks), refused[:first], None)
    return Plan(q, np.concatenate(breaks), refused, None)


def judged(request: PathRequest, plan: Plan) -> Path:
    """Evaluate a plan by plain forward kinematics; explain breaks and missed poses."""
    problem, turning = request.problem, Turning(request.problem.chain)
    goal, chain = problem.goal, problem.chain
    rows, planned = plan.q, np.arange(len(request)) < len(plan.q)
    stay = rows[-1] if len(rows) else request.start
    if stay is None:
        stay = np.clip((chain.lower + chain.upper) / 2, turning.open_lower, turning.open_upper)
    q = np.concatenate([rows, np.repeat(stay[None], len(request) - len(rows), axis=0)])
    errors = goal.measure(problem.arrays, np.ascontiguousarray(q))
    reached = goal.met(errors) & planned
    reached[: len(plan.refused)] &= ~plan.refused[: len(q)]
    # A step that is too large is a break, whatever was planned.
    begin, end = steps_of(request, q)
    torn = ~short_steps(request, begin, end)
    if request.closed and request.ends_where_it_begins:
        torn[-1] |= (np.abs(end[-1] - begin[-1]) > ROUNDING).any()
    torn[plan.breaks[plan.breaks < len(torn)]] = True
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
        scene=None if request.valid is None else request.valid.scene,
        clearance=0.0 if request.valid is None else request.valid.clearance,
    )
    return path if path.success else replace(path, why=reasons(request, path, plan.layers))
