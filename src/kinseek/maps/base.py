"""Ranking of base placements of an arm, for a list of poses that it must reach, or a path that it must follow."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Never

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.collision.bodies import Body
from kinseek.collision.solutions import judge_of
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.poses import as_pose
from kinseek.printable import printable
from kinseek.robots.chain import Frame
from kinseek.solvers.threads import in_threads
from kinseek.support.transforms import inverse, square
from kinseek.support.validation import as_integer
from kinseek.unknown_arguments import unknown_argument

from .free import reached_freely
from .measures import DEXTERITY, LIMITS, all_solutions, limit_distance
from .search import axes_of, patience_of, reached

if TYPE_CHECKING:
    import xarray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]

BOTH = "both"

QUALITIES: dict[str, Callable[[Arm, Array], Array]] = {
    LIMITS: limit_distance,
    DEXTERITY: lambda arm, q: np.asarray(arm.manipulability(q)),
    BOTH: lambda arm, q: limit_distance(arm, q) * arm.manipulability(q),
}
"""Quality of joint values, (k, n) -> (k,): the greater the better."""

PIECE = 256
"""Number of poses that a thread takes at a time. Not examined further."""

FIRST = 32
"""Number of poses at which every candidate is judged before any is judged at all poses. Found by trial with
`python -m benchmarks.suites` and the grasps of RM4D, where 16 to 64 take the same time."""


def best_base(
    arm: Arm,
    poses: Any,
    candidates: Any,
    by: str = LIMITS,
    *,
    path: bool = False,
    scene: Scene | None = None,
    clearance: float = 0.0,
    top: int | None = None,
    threads: int | None = None,
    **unknown: Never,
) -> xarray.Dataset:
    """Rank base placements of an arm by how well it reaches the poses of a task, or follows them as a path.

    Placements that reach more poses come first; among equals, with `path`, those with fewer breaks; among equals, those
    whose worst pose has the higher quality. The quality of a pose is that of its best solution. With `path` it is that of
    the path's joint values, and for goals with ranges that of the solution that `Arm.ik` returns.

    Args:
        arm: An arm with axes.
        poses: Poses of the task, (n, 4, 4), lengths in [m]; or a `Goal` with n targets, which may have free axes, ranges,
            tolerances and a tool, but no base.
        candidates: Base poses in the frame of these poses, (k, 4, 4), lengths in [m].
        by: Quality of joint values: ``"limit_distance"`` d, the distance from the nearest limit divided by half the range;
            ``"dexterity"`` w, the manipulability (Yoshikawa 1985); or ``"both"``, their product d w. d is 0 at a limit, w
            is 0 at a singularity.
        path: Follow the poses in their order with one continuous motion, see `Arm.follow`.
        scene: Collision scene of the arm. Its obstacles stand in the frame of the poses and do not move with the base; the
            links do, and what is attached to a link that a joint moves. Links that no joint moves are not checked.
        clearance: Minimum distance of bodies of the scene [m].
        top: Number of best placements that must be ranked exactly; None: all. A placement is given up as soon as it cannot
            be among them. Not with `path`.
        threads: Number of threads; by default every core, in a scene one. The result does not depend on it.

    Returns:
        A dataset along ``candidate``, the best first: its number in `candidates`, ``base``, the number of poses reached, of
            ``breaks`` (0 without `path`) and of poses ``examined``, the quality of the worst pose reached, and ``limiting``,
            the number of the worst pose: one that is not reached, if there is one. Placements that were given up come last,
            in the order of an estimate: not all poses were examined, and the other values are for those that were.

    Raises:
        InvalidGoal: Not poses.
        InvalidMap: No poses, no candidates, an arm with black-box kinematics, an unknown quality, a goal with a base, or
            `top` with `path`.
        InvalidProblem: A scene for goals that `Arm.ik` does not solve in one, or a clearance without a scene.
        InvalidScene: The scene belongs to another arm.
    """
    if unknown:
        raise unknown_argument(best_base, unknown)
    goal = poses if isinstance(poses, Goal) else Goal.pose(as_pose(poses))
    goal, places = goal.at(goal.target.reshape(-1, 4, 4)), as_pose(candidates).reshape(-1, 4, 4)
    if not isinstance(by, str) or by not in QUALITIES:
        raise InvalidMap(f"by must be one of {', '.join(QUALITIES)}, got {by!r:.200}")
    axes_of(arm, "the ranking of bases")
    n = len(goal.target)
    if not n or not len(places):
        raise InvalidMap(f"at least one pose and one candidate are needed, got {n} and {len(places)}")
    if goal.base is not None:
        raise InvalidMap("the goal has a base=, but the candidates are the bases: give the goal without it")
    if top is not None:
        top = as_integer("top", top, 1, error=InvalidMap)
        if path:
            raise InvalidMap("top= is for poses, path=True for a path: give one of them")
    if threads is not None:
        threads = as_integer("threads", threads, 1)
    if scene is not None:
        clearance = judge_of(scene, arm.mechanism, clearance, None).clearance
        scene = copy.copy(scene)
    elif clearance:
        raise InvalidMap(f"clearance= needs a scene: give scene=, got clearance={clearance!r}")
    standing = [] if scene is None else scene._standing
    judge = _Judge(arm, goal, by, scene, standing, clearance, threads)
    results = judge.whole(places) if path else _race(judge, places, n, top or len(places))
    order = sorted(range(len(places)), key=lambda i: (results[i].examined < n, results[i].key, i))
    return _dataset(arm, by, places, [results[i] for i in order], order, n)


class _Result(NamedTuple):
    """What is known about one placement."""

    examined: int
    reached: int
    breaks: int
    worst: float
    """Least quality of a pose reached; infinity if there is none."""
    limiting: int

    @property
    def key(self) -> tuple[float, float, float]:
        """Sort key, the smaller the better: share of the poses that are missed, breaks, worst quality."""
        return (self.examined - self.reached) / self.examined, self.breaks, -self.worst


class _Judge(NamedTuple):
    """A task, and what is computed for it at each placement."""

    arm: Arm
    goal: Goal
    by: str
    scene: Scene | None
    """A copy, whose obstacles may be moved."""
    standing: list[Body]
    """Its obstacles, in the frame of the task."""
    clearance: float
    threads: int | None

    def at(self, place: Array) -> tuple[Goal, Scene | None]:
        """Return the goal and the scene for a base placement."""
        if self.scene is not None:
            seen = square(inverse(place))
            self.scene._stand(
                [replace(body, frame=Frame(0, seen @ body.frame.pose)) for body in self.standing]
            )
        if self.goal.form.ranges:  # They may be along the axes of the task's frame.
            return replace(self.goal, base=place), self.scene
        return self.goal.at(square(inverse(place)) @ self.goal.target), self.scene

    def poses(self, place: Array, which: Indices) -> tuple[Flags, Array]:
        """Return which of some poses are reached from a placement, (k,), and their quality, (k,), -inf for the others."""
        goal, scene = self.at(place)
        pieces = [which[first : first + PIECE] for first in range(0, len(which), PIECE)]

        def judged(some: Indices) -> tuple[Flags, Array]:
            return self._piece(goal.at(goal.target[some]), scene)

        # A scene is used by one thread at a time.
        found = in_threads(judged, pieces, self.threads if scene is None else 1)
        return np.concatenate([each[0] for each in found]), np.concatenate([each[1] for each in found])

    def _piece(self, goal: Goal, scene: Scene | None) -> tuple[Flags, Array]:
        quality = np.full(len(goal.target), -np.inf)
        if goal.form.ranges:
            solution = self.arm.ik(goal, scene=scene, clearance=self.clearance, threads=1)
            found = np.asarray(solution.success)
            quality[found] = QUALITIES[self.by](self.arm, solution.q[found])
            return found, quality
        patience = patience_of(goal.position_tolerance, goal.orientation_tolerance)
        found = (
            reached(self.arm, goal, patience)
            if scene is None
            else reached_freely(self.arm, goal, scene, self.clearance, patience)
        )
        if found.any():
            q, firsts, _ = all_solutions(self.arm, goal.at(goal.target[found]), scene, self.clearance)
            quality[found] = np.maximum.reduceat(QUALITIES[self.by](self.arm, q), firsts)
        return found, quality

    def whole(self, places: Array) -> list[_Result]:
        """Follow the whole path from every placement."""
        results = []
        for place in places:
            goal, scene = self.at(place)
            path = self.arm.follow(goal, scene=scene, clearance=self.clearance, threads=self.threads)
            found = np.asarray(path.reached)
            quality = np.where(found, QUALITIES[self.by](self.arm, path.q), -np.inf)
            everything = np.arange(len(found))
            results.append(_result(everything, found, quality, len(path.breaks)))
        return results


def _race(judge: _Judge, places: Array, n: int, top: int) -> list[_Result]:
    """Judge placements at all poses, and give up those that cannot be among the `top` best."""
    # Multiples of the golden ratio spread any first part of the order evenly over the list (Weyl 1916).
    order = np.argsort(np.arange(n) * ((np.sqrt(5.0) - 1.0) / 2.0) % 1.0, kind="stable")
    known = [judge.poses(place, order[:FIRST]) for place in places]
    results = [_result(order[:FIRST], *each) for each in known]
    best: list[tuple[float, float, float]] = []  # Keys of the best placements that were judged at all poses.
    for i in sorted(range(len(places)), key=lambda i: (results[i].key, i)):
        while results[i].examined < n and not (len(best) == top and _beaten(results[i], best[-1], n)):
            done = results[i].examined
            found, quality = judge.poses(places[i], order[done : done + done // 2])
            known[i] = np.append(known[i][0], found), np.append(known[i][1], quality)
            results[i] = _result(order[: done + len(found)], *known[i])
        if results[i].examined == n:
            best = sorted([*best, results[i].key])[:top]
    return results


def _beaten(result: _Result, key: tuple[float, float, float], n: int) -> bool:
    """Return whether a placement is worse than another one with a key, whatever the poses not yet examined give."""
    missed = (result.examined - result.reached) / n
    return (missed, 0.0, -result.worst) > key


def _result(which: Indices, found: Flags, quality: Array, breaks: int = 0) -> _Result:
    """Sum up poses with these numbers, (k,); a pose that is not reached limits most, and then the first in the list."""
    worst = float(np.where(found, quality, np.inf).min())
    limiting = int(which[np.lexsort((which, quality))[0]])
    return _Result(len(which), int(found.sum()), breaks, worst, limiting)


def _dataset(
    arm: Arm, by: str, places: Array, results: list[_Result], order: list[int], n: int
) -> xarray.Dataset:
    import xarray

    worst = np.array([each.worst if each.reached else np.nan for each in results])
    return xarray.Dataset(
        {
            "number": ("candidate", order, {"long_name": "as it was given"}),
            "base": (
                ("candidate", "row", "column"),
                places[order],
                {"long_name": "place of the base", "units": "m"},
            ),
            "reached": (
                "candidate",
                [each.reached for each in results],
                {"long_name": f"poses reached, of {n}", "units": "1"},
            ),
            "breaks": (
                "candidate",
                [each.breaks for each in results],
                {"long_name": "breaks of the path", "units": "1"},
            ),
            "worst": ("candidate", worst, {"long_name": f"least {by} of a pose reached", "units": "1"}),
            "limiting": (
                "candidate",
                [each.limiting for each in results],
                {"long_name": "number of the worst pose"},
            ),
            "examined": (
                "candidate",
                [each.examined for each in results],
                {"long_name": f"poses examined, of {n}", "units": "1"},
            ),
        },
        attrs={"title": f"Places for the base of {printable(arm.name)}", "by": by, "poses": n},
    )
