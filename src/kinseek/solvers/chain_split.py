"""Find the joints that leave a point of the hand at rest, by forward kinematics alone.

Moving a joint from q to q' takes a point w of the hand from R w + p to R' w + p'. The point rests if (R - R') w = p' - p,
for all values of the other joints: a small least-squares problem. For a wrist whose axes intersect, w is its centre. Since
the goal determines the pose of the hand, it determines the position of this centre.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.goal import Goal
from kinseek.robots.mechanism import Mechanism
from kinseek.support.caching import WeakCache

Array = NDArray[np.float64]
Joints = tuple[int, ...]


class Split(NamedTuple):
    """The chains in which an arm is searched for a kind of goal."""

    first: Joints
    """Indices of the joints that are searched first: for the position of `point`, or for the goal if there is no second
    chain."""
    second: Joints
    """Indices of the joints that leave `point` at rest; they are searched afterwards, for the goal."""
    idle: Joints
    """Indices of the joints that do not affect the goal; they stay in the middle of their ranges."""
    point: tuple[float, float, float]
    """The point in the frame of the tip, or of the goal's tool [m]."""
    sentence: str
    """A sentence that describes and explains the split."""
    evaluations: int
    """FK evaluations for finding the split, once."""

    @property
    def whole(self) -> bool:
        """Whether the whole arm is one chain."""
        return not (self.second or self.idle)

    def first_goal(self, goal: Goal) -> Goal:
        """Return the goal of the first chain."""
        if not self.second:
            return goal
        return Goal.position(
            goal.target[..., :3, :3] @ np.array(self.point) + goal.target[..., :3, 3],
            base=goal.base,
            position_weight=goal.position_weight,
            position_tolerance=goal.position_tolerance,
        )


def middle(chain: Mechanism) -> Array:
    """Return the middle of every joint's range, (n,), [rad] or [m]."""
    return np.asarray(chain.lower + (chain.upper - chain.lower) / 2)


SETTINGS = 12
"""Configurations at which each joint is moved. Not examined further."""
STILL = 1e-6
"""Largest motion of a point that counts as resting, relative to the arm's reach; rounded numbers in descriptions cause
more."""
STEP, FREEDOM = 1e-3, 1e-4
"""For counting degrees of freedom: the step, relative to a joint's range, and the fraction of the largest singular value
below which another counts as zero."""


def find_split(chain: Mechanism, goal: Goal) -> Split:
    """Find the chains by forward kinematics alone: move every joint separately, at several configurations of the others."""
    probe = _Probe(chain, goal)
    movers = tuple(j for j in range(chain.dof) if probe.moves(j)) or tuple(range(chain.dof))
    idle = tuple(j for j in range(chain.dof) if j not in movers)
    freedom = probe.freedom(movers)
    why = "no joint leaves a point of the hand at rest whose position follows from the goal"
    for joints, point in reversed(_resting(probe, movers)):
        first = tuple(j for j in movers if j not in joints)
        place = probe.freedom(first, point)
        if first and freedom - place <= len(joints):
            where = ", ".join(f"{x:.4g}" for x in np.round(point, 6) + 0.0)
            why = (
                f"moving {_list(chain, joints)} leaves the point ({where}) m of the hand at rest, so "
                f"{_list(chain, first)} {_are(first)} searched for its position, then {_list(chain, joints)} for the "
                "goal"
            )
            at = (float(point[0]), float(point[1]), float(point[2]))
            return Split(first, joints, idle, at, why + _idly(chain, idle), probe.evaluations)
        why = (
            f"moving {_list(chain, joints)} leaves a point of the hand at rest, but its position fixes only {place} "
            f"of the {freedom} degrees of freedom of the hand, and these joints cannot fix the others"
        )
    sentence = f"{_list(chain, movers)} {_are(movers)} searched as one chain: {why}" + _idly(chain, idle)
    return Split(movers, (), idle, (0.0, 0.0, 0.0), sentence, probe.evaluations)


def _resting(probe: _Probe, movers: Joints) -> list[tuple[Joints, Array]]:
    """Return growing sets of joints, from the last joint on, that leave a point at rest, and that point [m], (3,)."""
    found: list[tuple[Joints, Array]] = []
    for j in reversed(movers):
        joints = (j, *(found[-1][0] if found else ()))
        point = probe.point_at_rest(joints)
        if point is not None:
            found.append((joints, point))
    return found


def _list(chain: Mechanism, joints: Joints) -> str:
    return ", ".join(chain.joint_names[j] for j in joints)


def _are(joints: Joints) -> str:
    return "is" if len(joints) == 1 else "are"


def _idly(chain: Mechanism, idle: Joints) -> str:
    return f"; moving {_list(chain, idle)} changes nothing that the goal constrains" if idle else ""


class _Probe:
    """Poses of the hand at some configurations, and after moving one joint alone."""

    def __init__(self, chain: Mechanism, goal: Goal) -> None:
        """Evaluate all poses that are needed.

        Raises:
            InvalidProblem: The goal has free axes or ranges.
        """
        self.axes = goal.tip_rotation[:, : goal.columns]
        """Directions whose image the goal determines, as columns, (3, c): all for a pose, the tool axis for a direction."""
        n, rng = chain.dof, np.random.default_rng(1)
        span = chain.upper - chain.lower
        step = STEP * chain.span
        settings = chain.lower + step + rng.random((SETTINGS, n)) * (span - 2 * step)
        moved = np.repeat(settings[None], n, axis=0)
        lower, upper = np.repeat(settings[None], n, axis=0), np.repeat(settings[None], n, axis=0)
        for j in range(n):
            moved[j, :, j] = chain.lower[j] + rng.random(SETTINGS) * span[j]
            lower[j, :, j] -= step[j]
            upper[j, :, j] += step[j]
        q = np.concatenate([settings[None], moved, lower, upper])
        inside = np.clip(q, chain.lower, chain.upper).reshape(-1, n)
        self.evaluations = len(inside)
        """Poses evaluated."""
        poses = _poses(chain, goal, inside).reshape(*q.shape[:2], 4, 4)
        self.settings, self.moved = poses[0], poses[1 : n + 1]
        self.lower, self.upper = poses[n + 1 : 2 * n + 1], poses[2 * n + 1 :]
        reach = float(np.nanmax(np.abs(poses[..., :3, 3]), initial=0.0))
        self.reach = max(reach, 1e-3)
        """Reach of the arm [m]."""
        self.still = (1e-5 if chain.single else STILL) * self.reach
        """Largest motion of a resting point [m]."""

    def moves(self, j: int) -> bool:
        """Return whether a joint moves any feature of the hand that the goal constrains."""
        turn, slide = self._between(j)
        rotated = turn @ self.axes * self.reach
        return bool(max(np.abs(slide).max(initial=0.0), np.abs(rotated).max(initial=0.0)) > self.still)

    def point_at_rest(self, joints: Joints) -> Array | None:
        """Return the point nearest to the tip that these joints leave at rest and the goal determines [m], (3,), or None."""
        turns, slides = zip(*(self._between(j) for j in joints), strict=True)
        A, b = np.concatenate(turns).reshape(-1, 3) @ self.axes, np.concatenate(slides).reshape(-1)
        if not len(b):
            return None
        point = np.zeros(3)
        if self.axes.size:
            point = self.axes @ np.linalg.lstsq(A, b, rcond=1e-6)[0]
        left = np.abs(np.concatenate(turns) @ point - np.concatenate(slides)).max()
        # If the joints hardly rotate, its square would be too large a number.
        near = math.hypot(*point) <= 2 * self.reach
        return point if near and left <= self.still else None

    def freedom(self, joints: Joints, point: Array | None = None) -> int:
        """Return the degrees of freedom with which some joints move the goal's features, or a point (3,) of the hand."""
        if not joints:
            return 0
        J = np.stack(
            [self._features(self.upper[j], point) - self._features(self.lower[j], point) for j in joints]
        )
        J = J[:, ~np.isnan(J).any(axis=(0, 2))]
        largest = np.abs(J).max(axis=(1, 2), initial=0.0)
        # A joint with a narrow range counts as much as one with a wide range.
        J = (J / np.where(largest > 0, largest, 1.0)[:, None, None]).transpose(1, 2, 0)
        values = np.linalg.svd(J, compute_uv=False)
        return int((values > FREEDOM * values.max(initial=1e-300)).sum(axis=1).max(initial=0))

    def _between(self, j: int) -> tuple[Array, Array]:
        """Return R - R' and p' - p for moves of a joint, (k, 3, 3) and (k, 3), as far as both poses exist."""
        before, after = self.settings, self.moved[j]
        there = ~np.isnan(before + after).any(axis=(1, 2))
        turn = before[there, :3, :3] - after[there, :3, :3]
        return turn, after[there, :3, 3] - before[there, :3, 3]

    def _features(self, poses: Array, point: Array | None) -> Array:
        """Return the goal's features, (k, 3 + 3c), or the position of a point, (k, 3), relative to the arm's reach."""
        if point is not None:
            return (poses[:, :3, :3] @ point + poses[:, :3, 3]) / self.reach
        columns = (poses[:, :3, :3] @ self.axes).reshape(len(poses), -1)
        return np.concatenate([poses[:, :3, 3] / self.reach, columns], axis=1)


def _poses(chain: Mechanism, goal: Goal, q: Array) -> Array:
    """Return poses of the goal's tool, or of the tip, (k, n) -> (k, 4, 4), lengths in [m]."""
    poses = chain.forward(q)
    return np.asarray(poses if goal.tool is None else poses @ goal.tool)


class _Known(NamedTuple):
    """Cached data of an arm for a kind of goal."""

    split: Split
    first: Mechanism | None
    """The first chain, with the others fixed in the middle; its tip is the point if there is a second chain. None means that
    it is built at each use, since a cached part of black-box kinematics would keep the function alive."""
    second: Mechanism | None
    """The second chain, with the first in the middle."""


MOST_CACHED = 16
"""Kinds of goal, tools and tool axes that are kept for an arm, the last ones used."""

_known: WeakCache[Mechanism, tuple[int, bytes | None], _Known] = WeakCache(MOST_CACHED)


def known_of(chain: Mechanism, goal: Goal) -> _Known:
    """Return the cached data of an arm for a kind of goal and a tool: computed at the first call, dropped with the arm."""

    def find_out() -> _Known:
        split = find_split(chain, goal)
        made_anew = split.whole or chain.axes is None
        return _Known(split, None, None) if made_anew else _Known(split, *parts(chain, goal, split))

    key = (goal.columns, None if goal.tip is None else goal.tip.tobytes())
    return _known.of(chain).get(key, find_out)


def parts(chain: Mechanism, goal: Goal, split: Split) -> tuple[Mechanism, Mechanism | None]:
    """Return both chains, with their other joints in the middle."""
    q = middle(chain)
    if not split.second:
        return chain.part(split.first, q, None), None
    tool = np.eye(4) if goal.tool is None else goal.tool.copy()
    tool[:3, 3] += tool[:3, :3] @ np.array(split.point)
    return chain.part(split.first, q, tool), chain.part(split.second, q, None)
