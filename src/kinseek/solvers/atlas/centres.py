"""Solve goals with ranges at the centre of the ranges, where they are goals without any.

The centre is usually the target itself. Goals without ranges are found much faster, and most goals are met this way. If the
direction of one axis counts, three searches follow each other, each limited to one pass:

1. the whole pose, by the closed form, if the arm has one and its last joint turns far enough to reach most of such poses. A
   last joint that turns about the axis itself may take any value, so its limits do not matter;
2. the position and the direction of the axis;
3. with a cone, the position alone, from the joint values at which the second search ended. They are near the position, and
   point as closely in the direction as the arm can, which is often close enough. An arm of five joints usually needs this.

The ranges themselves decide whether the result is a success.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.goal import Goal
from kinseek.kernels.arm.division import TURN
from kinseek.kernels.arm.range_error import judge_ranges
from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.atlas.batch import solve_many, solve_some
from kinseek.kernels.atlas.descent import DEEP_STEPS, FIRST_STEPS
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.near import solve_goal
from kinseek.kernels.atlas.task import OPEN, REPORT
from kinseek.kinds import POINTING, POSE, POSITION
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.geometry import divide, open_limits
from kinseek.solution import Solution, quick_solution
from kinseek.support.caching import WeakCache
from kinseek.support.transforms import transform
from kinseek.support.turns import shortest

from .index import MOST_CACHED, SAMPLES, AtlasIndex, atlas_of
from .quick import tolerances_as

Flags = NDArray[np.bool_]

Axis = tuple[float, float, float]

ONE_PASS, ONE_WALK = float((FIRST_STEPS + 1) * LANES), float((DEEP_STEPS + 1) * LANES)
"""Budgets: of a closed form or of one pass from the nearest samples, and of one walk from given joint values."""

WIDE = 1.5 * math.pi
"""Range of the last joint [rad] from which on its limits seldom matter. Of the arms with closed forms in the section "Cones"
of `benchmarks.partial_goals`, those with a range of 5.8 rad or more reach nearly every pose whose direction they reach;
puma560, with a range of π, reaches half of them."""

ALONG = 1e-9
"""Largest distance of a last axis from the tool [m], and of their directions, at which it counts as the axis of the tool."""


_Key = tuple[Axis, bytes | None, int]
"""The axis, the tool, and the number of samples."""


class CentralIndices:
    """The atlases that searches for the centre of a goal about one axis of the tool use, each made when it is needed."""

    def __init__(self, chain: SerialChain, goal: Goal, key: _Key) -> None:
        """Make the one that every such goal needs."""
        axis, _, samples = self.key = key
        self.pose = atlas_of(chain, goal, samples)
        """That of whole poses. Its arm has its tip at the tool."""
        self.first: AtlasIndex | None = None
        """That of the first search; None if it is not made."""
        self.last: tuple[float, float] | None = None
        """Limits of the last joint if the first search ignores them."""
        if self.pose.structure.word != "none":
            low, high = float(chain.lower[-1]), float(chain.upper[-1])
            if high - low >= WIDE:
                self.first = self.pose
            elif _turns_about(chain, self.pose, axis):
                self.first, self.last = atlas_of(_freed(chain), goal, samples), (low, high)
        direction = Goal(np.eye(4), POINTING.name, axis, tool=goal.tool)
        self.turn = transform(direction.tip_rotation, np.zeros(3))
        """Rotation of the tip that maps the axis to x, (4, 4)."""
        lower, _ = open_limits(chain)
        self._middle, self._limits = (chain.lower + chain.upper) / 2, (chain.lower, chain.upper)
        self._most = np.where(lower <= -OPEN, math.pi, np.inf)
        self._goals = direction, Goal(np.eye(4), POSITION.name, tool=goal.tool)
        self._samples = samples
        self._pointing: AtlasIndex | None = None
        self._position: AtlasIndex | None = None

    def pointing(self, chain: SerialChain) -> AtlasIndex:
        """Return the atlas of directions of the axis."""
        if self._pointing is None:
            self._pointing = atlas_of(chain, self._goals[0], self._samples)
        return self._pointing

    def position(self, chain: SerialChain) -> AtlasIndex:
        """Return the atlas of positions."""
        if self._position is None:
            self._position = atlas_of(chain, self._goals[1], self._samples)
        return self._position

    def placed(self, q: Array) -> Array:
        """Return joint values, (..., n), with full turns near the middle of the limits, as searches without `near` do."""
        gap = q - self._middle
        beyond = np.abs(gap) > self._most
        if not beyond.any():
            return q
        return np.where(beyond, np.clip(self._middle + shortest(gap), *self._limits), q)


def _turns_about(chain: SerialChain, index: AtlasIndex, axis: Axis) -> bool:
    """Return whether the last joint, and no other, turns the tool about an axis of it."""
    tool = index.arrays.fixed[-1]
    across, slant = tool[:2, 3], tool[:2, :3] @ np.array(axis)
    near = max(float(np.linalg.norm(across)), float(np.linalg.norm(slant))) <= ALONG
    return near and divide(chain, POSE).tail == TURN


def _freed(chain: SerialChain) -> SerialChain:
    """Return an arm whose last joint turns by half a turn to either side of the middle of its limits."""
    lower, upper = chain.lower.copy(), chain.upper.copy()
    middle = (lower[-1] + upper[-1]) / 2
    lower[-1], upper[-1] = middle - math.pi, middle + math.pi
    return replace(chain, lower=lower, upper=upper)


_central: WeakCache[SerialChain, _Key, CentralIndices] = WeakCache(MOST_CACHED)


def central_indices(
    chain: SerialChain, goal: Goal, samples: int = SAMPLES, last: CentralIndices | None = None
) -> CentralIndices | None:
    """Return the atlases for a goal about one axis of the tool, made at the first call; None for another goal.

    Args:
        chain: The arm.
        goal: The goal.
        samples: Number of samples of each.
        last: The result of the last call for this arm, which is returned if it fits, since that is faster.
    """
    if goal.swing is None or goal.frame != "tool":
        return None
    key = (goal.swing, None if goal.tool is None else goal.tool.tobytes(), samples)
    if last is not None and last.key == key:
        return last
    return _central.of(chain).get(key, lambda: CentralIndices(chain, goal, key))


def is_central(goal: Goal, near: Array | None) -> bool:
    """Return whether this is one goal with ranges that accept its target itself, to be solved without `near`."""
    ranged = type(goal) is Goal and goal.target.ndim == 2 and goal.ranges is not None
    return ranged and near is None and goal.accepts_target


def solve_central(chain: SerialChain, goal: Goal, indices: CentralIndices | None) -> Solution | None:
    """Solve the target of a goal with ranges itself, for which `is_central`; the bits are those of `solve_centres`.

    Args:
        chain: The arm.
        goal: The goal.
        indices: Its `central_indices`.

    Returns:
        None if the fast searches do not find it.
    """
    if indices is not None:
        index, found = indices.pose, _find_axis(chain, indices, goal)
    else:
        index = atlas_of(chain, goal)
        found = _find_whole(chain, index, goal)
    if found is None:
        return None
    q, spent = found
    weights = float(goal.position_weight), float(goal.orientation_weight)
    (errors,) = judge_ranges(index.arrays, q[None], goal.questions, *weights).tolist()
    if errors[0] > goal.position_tolerance or errors[1] > goal.orientation_tolerance:
        return None
    return quick_solution(chain, goal, None, q, (errors[0], errors[1], errors[2], spent, True))


def _find_axis(chain: SerialChain, indices: CentralIndices, goal: Goal) -> tuple[Array, int] | None:
    """Search as `_find_axes` for one target: return joint values, (n,), and FK evaluations; None if nothing is found."""
    q, target, total, met = np.empty(chain.dof), goal.targets[0], 0, False
    if indices.first is not None:
        tolerances = tolerances_as(goal, POSE, ONE_PASS)
        *_, total, met = solve_goal(indices.first.address, tolerances, target, q, False, q)
        if indices.last is not None:
            q[-1] = min(max(q[-1], indices.last[0]), indices.last[1])
    if not met:
        address, tolerances = indices.pointing(chain).address, tolerances_as(goal, POINTING, ONE_PASS)
        *_, spent, met = solve_goal(address, tolerances, (goal.targets @ indices.turn)[0], q, False, q)
        total += spent
    if not met and goal.cone:
        near, q = q, np.empty(chain.dof)
        address, tolerances = indices.position(chain).address, tolerances_as(goal, POSITION, ONE_WALK)
        *_, spent, met = solve_goal(address, tolerances, target, near, True, q)
        q, total = indices.placed(q), total + spent
    return (q, total) if met else None


def _find_whole(chain: SerialChain, index: AtlasIndex, goal: Goal) -> tuple[Array, int] | None:
    """Search as `_find_wholes` for one target: return joint values, (n,), and FK evaluations; None if nothing is found."""
    row, left = np.empty((1, chain.dof + REPORT)), np.empty(1, dtype=np.int64)
    tolerances = tolerances_as(goal, goal.seeded_as)
    missed = solve_many(index.handle, tolerances, goal.targets, row, left, 0, 1, LANES)
    return None if missed else (row[0, : chain.dof], int(row[0, -1]))


def solve_centres(
    problem: Problem, samples: int, poses: Array, some: Indices, results: Array, done: Flags
) -> None:
    """Solve poses at the centres of ranges, as far as the fast searches for goals without ranges reach them.

    Args:
        problem: The problem.
        samples: Number of samples of the atlases.
        poses: The centres, (m, 3, 4).
        some: Indices of their targets, (m,).
        results: Receives the rows of the solutions, as from `solve_ranged`, (k, n + 4).
        done: Receives which targets are solved, (k,).
    """
    goal, chain = problem.goal, problem.chain
    if (indices := central_indices(chain, goal, samples)) is not None:
        index, (rows, found) = indices.pose, _find_axes(chain, indices, goal, poses)
    else:
        index = atlas_of(chain, goal, samples)
        rows, found = _find_wholes(chain, index, goal, poses)
    rows, some = rows[found], some[found]
    weights = float(goal.position_weight), float(goal.orientation_weight)
    rows[:, chain.dof : -1] = judge_ranges(index.arrays, rows[:, : chain.dof], goal.questions[some], *weights)
    results[some], done[some] = rows, goal.met(rows[:, chain.dof :])


def _find_axes(chain: SerialChain, indices: CentralIndices, goal: Goal, poses: Array) -> tuple[Array, Flags]:
    """Search for directions as the module says.

    Args:
        chain: The arm.
        indices: Its atlases for the goal.
        goal: The goal.
        poses: The targets, (k, 3, 4).

    Returns:
        Rows as from `solve_some`, (k, n + 4), and which are found, (k,).
    """
    dof, rows = chain.dof, np.empty((len(poses), chain.dof + REPORT))
    total, left, none = np.zeros(len(poses)), np.arange(len(poses)), np.empty((0, dof))
    if indices.first is not None:
        tolerances = tolerances_as(goal, POSE, ONE_PASS)
        solve_some(indices.first.handle, tolerances, poses, none, rows, left, LANES)
        if indices.last is not None:
            rows[:, dof - 1] = np.clip(rows[:, dof - 1], *indices.last)
        total[left] += rows[left, -1]
        left = left[~goal.met(rows[left, dof:])]
    if len(left):
        handle, tolerances = indices.pointing(chain).handle, tolerances_as(goal, POINTING, ONE_PASS)
        solve_some(handle, tolerances, poses @ indices.turn, none, rows, left, LANES)
        total[left] += rows[left, -1]
        left = left[~goal.met(rows[left, dof:])]
    if len(left) and goal.cone:
        handle, tolerances = indices.position(chain).handle, tolerances_as(goal, POSITION, ONE_WALK)
        solve_some(handle, tolerances, poses, rows[:, :dof].copy(), rows, left, LANES)
        rows[left, :dof] = indices.placed(rows[left, :dof])
        total[left] += rows[left, -1]
        left = left[~goal.met(rows[left, dof:])]
    rows[:, -1], found = total, np.ones(len(poses), dtype=np.bool_)
    found[left] = False
    return rows, found


def _find_wholes(chain: SerialChain, index: AtlasIndex, goal: Goal, poses: Array) -> tuple[Array, Flags]:
    """Search for whole poses, or positions if every orientation is accepted.

    Args:
        chain: The arm.
        index: Its atlas for the goal.
        goal: The goal.
        poses: The poses, (k, 3, 4).

    Returns:
        Rows as from `solve_some`, (k, n + 4), and which are found, (k,).
    """
    rows, left = np.empty((len(poses), chain.dof + REPORT)), np.empty(len(poses), dtype=np.int64)
    tolerances, found = tolerances_as(goal, goal.seeded_as), np.ones(len(poses), dtype=np.bool_)
    count = solve_many(index.handle, tolerances, poses, rows, left, 0, len(poses), LANES)
    found[left[:count]] = False
    return rows, found
