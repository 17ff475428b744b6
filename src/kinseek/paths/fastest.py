"""Choose the path whose motion in time is shortest: several plans, each timed, and the best improved along the self-motion.

The plans are the shortest path, the path that is shortest in the time of the slowest joint, paths that spare the joints
which cap the speed of the best path so far, and, if solutions are isolated, the shortest paths on other branches.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import index_of
from kinseek.derivatives import freedom
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.support.deadline import TimeUp
from kinseek.timing.limits import Limits
from kinseek.timing.trajectory import Trajectory

from .joints import Turning
from .judge import checked, judged
from .path import Path
from .quicken import quickened
from .request import PathRequest

Array = NDArray[np.float64]
Advance = Callable[[int], object]
Follow = Callable[[PathRequest, Advance], Path]

BRANCHES = 12
"""Most solutions of the first pose from which a path is planned if solutions are isolated. On 28 paths of redundant arms,
four other starts shortened the mean duration by 0.2 percent, and took up to 490 times as long as the shortest path."""

SPARED = (0.2, 0.1)
"""Weights of a joint that caps the speed nowhere, relative to one that caps it everywhere, of the paths that spare joints.
On 28 paths they shortened the mean duration by 1.2 percent."""

IMPROVED = 2
"""Plans with the shortest durations that are improved along the self-motion. On 28 paths one instead of two lengthened the
mean duration by 0.5 percent."""


class Timed(NamedTuple):
    """A continuous path and its motion."""

    path: Path
    trajectory: Trajectory


def fastest_of(request: PathRequest, follow: Follow, advance: Advance) -> Path:
    """Return the path with the shortest duration among those tried; it is never longer than that of the shortest path.

    A path with breaks or missed poses is the shortest path.

    Args:
        request: The path, with limits of the motion.
        follow: Plans a path, and reports the number of poses that were completed.
        advance: Called with that number for the shortest path.
    """
    limits = request.limits
    assert limits is not None
    plain = replace(request, limits=None)
    shortest = follow(plain, advance)
    if not shortest.success or len(shortest) < 2:
        return shortest
    candidates, late = [_timed(shortest, limits)], shortest.out_of_time
    with suppress(TimeUp):
        for other in _others(plain, candidates, limits):
            request.deadline.check()
            path = follow(other, _silent)
            late = late or path.out_of_time
            if path.success:
                candidates.append(_timed(path, limits))
    candidates.sort(key=_duration)
    for path, _ in candidates[:IMPROVED] if _has_self_motion(plain) else []:
        if request.deadline.passed:
            break
        q = quickened(plain, path.q, limits)
        better = judged(plain, checked(plain, q))
        if better.success:
            candidates.append(_timed(better, limits))
    best = min(candidates, key=_duration).path
    return replace(best, out_of_time=late or request.deadline.passed)


def _has_self_motion(request: PathRequest) -> bool:
    """Return whether the arm, with joints for the ranges of the goal, is redundant."""
    return freedom(request.without_ranges()[0].problem) > 0


def _silent(done: int) -> None:
    """Report no progress."""


def _timed(path: Path, limits: Limits) -> Timed:
    return Timed(path, path.timed(limits.velocity, limits.acceleration))


def _duration(candidate: Timed) -> float:
    return candidate.trajectory.duration


def _others(request: PathRequest, candidates: list[Timed], limits: Limits) -> Iterator[PathRequest]:
    """Yield requests for other plans; `candidates` grows in the meantime."""
    yield replace(request, velocity=limits.velocity)
    q = candidates[0].path.q[0]
    for least in SPARED:
        caps = _caps(min(candidates, key=_duration).trajectory)
        yield replace(request, weights=(least + caps) / limits.velocity)
    if request.start is None and not _has_self_motion(request):
        for start in _starts(request, q):
            back = request.closed and request.ends_where_it_begins
            yield replace(request, start=start, end=start if back else request.end)


def _caps(trajectory: Trajectory) -> Array:
    """Return the fraction of the duration in which a limit of each joint caps the speed, (n,)."""
    names = list(trajectory.mechanism.joint_names)
    caps = np.zeros(len(names))
    for cap in trajectory.bottleneck:
        if cap.joint is not None:
            caps[names.index(cap.joint)] += cap.end - cap.begin
    return caps / max(trajectory.duration, 1e-300)


def _starts(request: PathRequest, q: Array) -> Array:
    """Return isolated solutions of the first pose, (k, n), in the full turns nearest to q, (n,)."""
    part, own = request.without_ranges()
    problem, turning = part.problem, Turning(request.problem.chain)
    found = index_of(problem).solutions(tolerances_of(problem.goal), problem.goal.targets[0])[:, own]
    near = q + turning.step(found - q)
    outside = np.any((near < turning.open_lower) | (near > turning.open_upper), axis=1)
    starts = np.clip(
        np.where(np.expand_dims(outside, 1), found, near), turning.open_lower, turning.open_upper
    )
    allowed = starts if request.valid is None else starts[request.valid.each(starts)]
    return np.asarray(allowed[:BRANCHES])
