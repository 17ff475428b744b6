"""Plan a motion around obstacles: the implementation of `Scene.plan`."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.paths.path import Path
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.support.deadline import Deadline
from kinseek.timing.obstacles import Obstacles

from .along import Along
from .shorten import dense, refined, rounded, shortened
from .space import Space
from .trees import search

Array = NDArray[np.float64]


class Ends(NamedTuple):
    """Joint values at which a motion may end."""

    q: Array
    """Joint values that are free, (k, n), [rad] or [m]."""
    tool: Array | None = None
    """Pose of the tool at the tip, (4, 4), to which the poses of the path refer."""


def plan(
    chain: SerialChain,
    scene: Obstacles,
    begin: Array,
    ends: Ends,
    *,
    smooth: bool,
    clearance: float,
    deadline: Deadline,
    along: Goal | None = None,
) -> Path:
    """Plan a motion from joint values, (n,), to one of several ends, all of them free; see `Scene.plan`."""
    held = None if along is None else Along(chain, along)
    if held is not None:
        held.require(begin, "q0")
        if len(ends.q) and not (holds := held.holds(ends.q)).all():
            held.require(ends.q[np.argmax(holds)], "the goal")
            ends = ends._replace(q=ends.q[holds])
    space = Space(chain, scene, clearance, begin, ends.q, held)
    if not len(ends.q):
        why = "pose 1 is not planned: the time limit was reached before a solution of the goal was found"
        nothing = _path(space, ends, np.stack([begin, begin]), True, why)
        flags = np.array([True, False])
        return replace(nothing, breaks=np.zeros(0, dtype=np.int64), reached=flags, planned=flags)
    order = np.argsort(np.linalg.norm(space.way(ends.q - begin), axis=1), kind="stable")
    # Not the begin plus the way, which rounding may move out of the limits.
    roots = ends.q[order] - space.turns(ends.q[order] - begin)
    way = _straight(space, begin, roots)
    if way is None:
        found = search(space, begin, roots, deadline)
        if found.way is None:
            late = " within the time limit" if deadline.passed else ""
            report = (
                f"between poses 0 and 1: no way was found{late}, which does not prove that there is none; {found.samples:,} "
                f"samples were tried, and {found.nodes:,} joint values are connected with one of the ends"
            )
            return _path(space, ends, np.stack([begin, roots[0]]), deadline.passed, report)
        way = found.way
        if smooth:
            way = shortened(space, way, deadline)
            way = rounded(space, way, deadline) if held is None else way
    way = dense(space, way) if held is None else refined(space, held, way)
    return _path(space, ends, way, smooth and deadline.passed, None)


def _straight(space: Space, begin: Array, roots: Array) -> Array | None:
    """Return the first straight way to one of some roots, (k, n), that is free, as (N, n)."""
    rows, reached = space.advance(np.tile(begin, (len(roots), 1)), roots - begin)
    for i in np.flatnonzero(reached):
        way = np.concatenate([begin[None], rows[i][:-1], roots[i : i + 1]])
        if space.proved(way[:-1], way[1:]).all():
            return way
    return None


def _path(space: Space, ends: Ends, q: Array, out_of_time: bool, why: str | None) -> Path:
    """Return joint values as a path; with a reason it has a break after its first pose."""
    chain = space.chain
    origin = Problem(chain, Goal.pose(np.eye(4), tool=ends.tool))
    # The poses are those of the joint values, so the path reaches them.
    goal = Goal.pose(forward_many(origin.arrays, q), tool=ends.tool)
    errors = goal.measure(origin.arrays, q)
    return Path(
        q=q,
        breaks=np.zeros(0 if why is None else 1, dtype=np.int64),
        why=() if why is None else (why,),
        reached=np.ones(len(q), dtype=np.bool_),
        position_error=errors[:, 0].copy(),
        orientation_error=errors[:, 1].copy(),
        problem=Problem(chain, goal),
        closed=False,
        planned=np.ones(len(q), dtype=np.bool_),
        out_of_time=out_of_time,
        scene=space.scene,
        clearance=space.clearance,
    )
