"""Follow a path of a redundant arm: many branches side by side, the best path through them, then smoothing of all poses.

The path is planned on some of the poses, chosen by how far the hand moves, and interpolated between them. At the first pose
solutions are sampled over the whole self-motion. Each is followed with the least motion of the joints from layer to layer.
At each layer further solutions beside them, along the self-motion, keep the set well spread, and a few fresh samples are
added. So the best path through all of them (see `kernels.paths.viterbi`) follows branches, and changes between them sideways
by small steps. The remaining corners are smoothed, first on the poses of the plan, then on all poses. Where a step is still
too large or collides, that part of the path is planned again with a finer resolution. If this does not help, the whole path
is planned again: at last with a layer at every pose, and once more without the places where that plan broke. Where the
allowed steps are much smaller than the distance between sampled solutions, only some of the poses are planned on.

In a scene, points of the edges are checked while a plan is made, and the steps of the path that results are proved free. A
step that is not counts like one that is too large.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import index_of
from kinseek.branches.order import cost_of
from kinseek.solvers.atlas.index import tolerances_of
from kinseek.solvers.threads import GoOn, parallel_for
from kinseek.support.deadline import TimeUp

from .joints import Turning
from .plan import Effort, ForbiddenEdges, Lessons, Planner, between_rows, path_parameter, stride_of
from .request import PathRequest
from .smooth import Row, Smoother
from .steps import avoidable, faulty, short_steps

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]
Advance = Callable[[int], object]

COARSE = Effort(0.25, 3, 100, 4, 200, 0.1)
EACH = Effort(0.0, 4, 150, 4, 400, 0.08)
"""Resolution with all poses as rows: near a singularity, poses between two rows cannot be interpolated well enough."""

STEP = Effort(0.0, 1, 150, 4, 400, 0.08)
"""Resolution with all poses as layers. Nothing lies between two layers that a sideways motion could miss, e.g. a singularity
at which curves of solutions separate and join differently."""

Plans = tuple[tuple[Effort, Effort], ...]

BLOCKED: Plans = ((COARSE, EACH), (EACH, STEP), (EACH, STEP))
"""Like `PLANS`, in a scene, where layers are close only near the breaks of the plans before. Most breaks are real there: no
way leads around a body, and with a layer at every pose of a long path it takes seconds to find the same breaks again."""

PLANS: Plans = ((COARSE, EACH), (EACH, STEP), (STEP, STEP), (STEP, STEP))
"""Resolutions of each plan of the whole path, and of its parts around breaks; they are tried until no breaks are left. Of 54
made paths of twelve arms on which the first plan breaks, the first three follow all, and the first and the third alone 48.
The program of this trial is not in the repository; a test of a gen3 needs the fourth."""

AROUND = 3.0
"""Motion of the hand, before and after a break, that is planned again; see `Effort.way` for the unit. A second attempt with
8.0 was tried on 54 made paths of twelve arms on which the first plan breaks: all were followed with and without it. The
program of this trial is not in the repository."""

HARD = 5.0
"""Like `AROUND`, for the parts in which every pose is a layer of the next plan in a scene. With 3.0 one of six paths of
`python -m benchmarks.paths.scenes` has one break more, with 8.0 none has fewer."""

FIRST_PASSES, LAST_PASSES = 10, 4
"""Most smoothing passes on the rows of the plan, and on all poses."""

POWERS, POWER_PASSES, EASED = (6, 12), 20, 4.0
"""Smoothing where steps are still too large: the powers of the step lengths whose sum is minimised, the most passes, and the
motion of the hand before and after such a step that is smoothed."""


LOOKED_AT = 100
"""Solutions of a pose that are sampled before it is reported that none is allowed."""


class Draft(NamedTuple):
    """A path that may still be improved."""

    q: Array
    """Joint values of every pose, or of the first ones if the time was up, (N, n)."""
    faulty: Flags
    """Flags of the steps that are breaks or collide, (N - 1,)."""
    cost: float
    refused: Flags
    """Flags of the poses at which none of the examined solutions is allowed, (N,)."""
    breaks: int = 0
    """Breaks of the plan that it was made from: at this resolution no path has fewer."""

    @classmethod
    def of(cls, request: PathRequest, q: Array, refused: Flags | None = None, breaks: int = 0) -> Draft:
        """Check and evaluate joint values of a path, (N, n), with all poses allowed unless some are `refused`."""
        none = np.zeros(len(q), dtype=np.bool_)
        cost = _cost(request, q, np.ones((len(q) - 1, 1)))
        return cls(q, faulty(request, q), cost, none if refused is None else refused, breaks)

    @property
    def order(self) -> tuple[int, float]:
        """Return what is compared: the faulty steps count first."""
        return int(self.faulty.sum()), self.cost


def follow_samples(
    request: PathRequest, threads: int | None, advance: Advance, plans: Plans = PLANS
) -> tuple[Array, Flags]:
    """Follow a path of a redundant arm with the given plans.

    Returns:
        Joint values for every pose, (N, n), and flags of the poses at which none of the examined solutions is allowed, (N,).
        If there are such poses, the plan is poor, and the path has to be planned without them. If the time is up, only the
        first poses are returned.
    """
    open_way = _open_way(request.as_open(), threads, advance, plans)
    q, refused = open_way.q, open_way.refused
    # A path with a given start that repeats its first pose at the end ends at that start, so it is closed already.
    there = request.end is not None or len(q) == 1
    if not request.closed or there or refused.any() or len(q) < len(request):
        return q, refused
    best: Draft | None = None
    # Close the path at the beginning of the open path, or at its end.
    for start in [q[0], q[-1]] if request.start is None else [request.start]:
        # A closed path seldom has fewer breaks than an open one, and where bodies break all ways, plans take long.
        if best is not None and _in_scene(request) and 0 < best.order[0] <= open_way.order[0]:
            break
        row = start[None].copy()
        with suppress(TimeUp):
            request.deadline.check()
            Smoother(request).project(row, np.ascontiguousarray(request.problem.goal.targets[:1]))
            round_trip = replace(request.returning(0, row[0]), start=row[0])
            way = _open_way(round_trip, threads, silent, plans)
            if len(way.q) == len(round_trip) and (best is None or way.order < best.order):
                best = way
    return (q if best is None else best.q[: len(request)]), refused


def silent(done: int) -> None:
    """Report no progress."""


def _open_way(request: PathRequest, threads: int | None, advance: Advance, plans: Plans) -> Draft:
    """Return the best of several plans, each tried if the ones before it break; parts around breaks are planned again.

    If there are refused poses, the plan is poor; if the time is up, it is only for the first poses.

    Raises:
        TimeUp: The time was up before anything was planned.
    """
    best = _planned(request, plans[0][0], threads, advance)
    if len(best.q) < len(request) or best.refused.any():
        return best
    lessons, can_be_mended, in_scene = Lessons(), avoidable(request), _in_scene(request)
    parameter = path_parameter(request.problem)
    with suppress(TimeUp):
        for number, (effort, finer) in enumerate(BLOCKED[: len(plans)] if in_scene else plans):
            new = _planned(request, effort, threads, silent, lessons) if number else best
            if len(new.q) < len(request):
                break
            grazed = _grazed(request, new)
            lessons.grazed += np.flatnonzero(grazed).tolist()
            if effort is STEP or (in_scene and number):
                hits = [ForbiddenEdges(int(i), new.q[i]) for i in np.flatnonzero(new.faulty & ~grazed)]
                lessons.forbidden_edges += hits
            # No path through these layers has fewer breaks than the plan, with fewer edges neither.
            least = new.breaks if in_scene and number else 0
            if new.order[0] > least:
                new = _mended(request, new, finer, threads, lessons)
            if new.order < best.order:
                best = new
            if not (best.faulty & can_be_mended).any() or best.order[0] <= least:
                break
            if in_scene:
                lessons.hard += _around(request, best, parameter, HARD)
    return best


def _in_scene(request: PathRequest) -> bool:
    return request.valid is not None and request.valid.scene is not None


def _refused(request: PathRequest, q: Array) -> Flags:
    """Return flags of poses at which neither a plan, (N, n), nor any other examined solution is allowed, (N,)."""
    refused = np.zeros(len(q), dtype=np.bool_)
    if request.valid is None:
        return refused
    problem = request.problem
    index, tolerances, turning = index_of(problem), tolerances_of(problem.goal), Turning(problem.chain)
    for i in np.flatnonzero(~request.valid.each(q)):
        others = index.solutions(tolerances, problem.goal.targets[i], LOOKED_AT)
        others = np.clip(others, turning.open_lower, turning.open_upper)
        refused[i] = not request.valid.each(others).any()
    return refused


def _grazed(request: PathRequest, draft: Draft) -> Flags:
    """Return flags of the steps of a draft, (N - 1,), that collide although both of their poses are free."""
    hits = np.asarray(draft.faulty & short_steps(request, draft.q[:-1], draft.q[1:]))
    if request.valid is not None and hits.any():
        hits[hits] = request.valid.free(draft.q[:-1][hits])
        hits[hits] = request.valid.free(draft.q[1:][hits])
    return hits


def _mended(
    request: PathRequest, draft: Draft, effort: Effort, threads: int | None, lessons: Lessons
) -> Draft:
    """Plan the parts of a path around its breaks again, and keep them where this removes the breaks."""
    q = draft.q
    windows = _around(request, draft, path_parameter(request.problem), AROUND)
    parts = [_part(request, q, first, last) for first, last in windows]
    made: list[Draft | None] = [None] * len(parts)

    def plan(first: int, end: int, go_on: GoOn) -> None:
        for k in range(first, end):
            with suppress(TimeUp):
                told = lessons.of_part(*windows[k])
                made[k] = new = _planned(parts[k], effort, 1, silent, told)
                # Poses that were left out may not be interpolated well enough.
                if new.faulty.any() and stride_of(parts[k], effort) > 1:
                    other = _planned(parts[k], effort._replace(skips=False), 1, silent, told)
                    made[k] = min(new, other, key=lambda draft: draft.order)

    parallel_for(plan, len(parts), 1, threads, request.deadline)
    for (first, last), part, new in zip(windows, parts, made, strict=True):
        old = q[first : last + 1]
        # A shorter part means that the time was up.
        if new is not None and len(new.q) == len(old) and new.order < Draft.of(part, old).order:
            # If an endless joint has turned the other way round, the rest of the path is shifted with it.
            q = np.concatenate([q[:first], new.q, q[last + 1 :] + (new.q[-1] - old[-1])])
    return draft if q is draft.q else Draft.of(request, q)


def _part(request: PathRequest, q: Array, first: int, last: int) -> PathRequest:
    """Return the request for a part of a path; its ends are fixed, except for open ends of the whole path."""
    part = request.part(first, last + 1)
    return replace(
        part,
        start=part.start if first == 0 else q[first],
        end=part.end if last == len(q) - 1 else q[last],
    )


def _smoothed(request: PathRequest, smoother: Smoother, q: Array, row: Row, passes: int) -> Array:
    """Smooth a path; with a user's cost, only as long as the sum of cost and squared steps decreases."""
    if request.cost is None:
        return smoother.smooth(q, row, passes, 2)
    for _ in range(passes):
        better = smoother.smooth(q, row, 1, 2)
        if _cost(request, better, row.spans) >= _cost(request, q, row.spans):
            break
        q = better
    return q


def _cost(request: PathRequest, q: Array, spans: Array) -> float:
    """Return the sum of the squared steps and the user's cost of the poses."""
    squares = float((np.diff(q, axis=0) ** 2 / spans).sum())
    if request.cost is None:
        return squares
    return squares + float((cost_of(request.cost, q)[1:] * spans[:, 0]).sum())


def _planned(
    request: PathRequest,
    effort: Effort,
    threads: int | None,
    advance: Advance,
    lessons: Lessons | None = None,
) -> Draft:
    planner = Planner(request, effort, lessons)
    rows = planner.rows
    if len(rows) == 1:
        request.deadline.check()
        only = planner.layer(0, planner.sample(0, effort.samples), np.zeros((0, planner.dof)))[0][:1]
        q = only if request.start is None else request.start[None]
        return Draft.of(request, q, _refused(request, q))
    q = planner.plan(advance, threads)
    with suppress(TimeUp):
        if len(q) == len(rows):
            return _finished(request, planner, q)
    # The time is up: the plan is only interpolated, neither smoothed nor evaluated.
    begun = replace(request.part(0, int(rows[len(q) - 1]) + 1), valid=None)
    all_of_them = _row(begun, np.arange(len(begun)))
    return Draft.of(begun, _put(begun, Smoother(begun), between_rows(rows[: len(q)], q), all_of_them))


def _finished(request: PathRequest, planner: Planner, q: Array) -> Draft:
    """Extend the rows of a plan, (rows, n), to all poses, (N, n), and smooth them.

    Raises:
        TimeUp: The time was up.
    """
    smoother, rows = planner.smoother, planner.rows
    some, all_of_them = _row(request, rows), _row(request, np.arange(rows[-1] + 1))
    q = _put(request, smoother, q, some)
    q = _smoothed(request, smoother, q, some, FIRST_PASSES)
    if len(rows) < len(all_of_them.targets):
        q = _put(request, smoother, between_rows(rows, q), all_of_them)
    refused = _refused(request, q)
    if refused.any():
        # The path is planned again without these poses.
        return Draft.of(request, q, refused)
    q = _smoothed(request, smoother, q, all_of_them, LAST_PASSES)
    draft = Draft.of(request, q, breaks=planner.breaks)
    # High powers come last: they reduce the largest steps, but need a path that is short already. They do not lead around a
    # body that every way of the plan meets.
    for power in () if planner.breaks and _in_scene(request) else POWERS:
        windows = _around(request, draft, planner.parameter, EASED)
        for first, last in windows:
            part = _row(_part(request, q, first, last), np.arange(last + 1 - first))
            q[first : last + 1] = smoother.smooth(q[first : last + 1], part, POWER_PASSES, power)
        if windows:
            draft = Draft.of(request, q, breaks=planner.breaks)
    return draft


def _around(request: PathRequest, draft: Draft, parameter: Array, way: float) -> list[tuple[int, int]]:
    """First and last pose of each part of a path around its breaks, extended to both sides by a motion of the hand."""
    parts: list[tuple[int, int]] = []
    for i in np.flatnonzero(draft.faulty & avoidable(request)).tolist():
        first = int(np.searchsorted(parameter, parameter[i] - way))
        last = min(int(np.searchsorted(parameter, parameter[i + 1] + way)), len(draft.q) - 1)
        if parts and first <= parts[-1][1]:
            first = parts.pop()[0]
        parts.append((first, last))
    return parts


def _row(request: PathRequest, rows: Indices) -> Row:
    """Return some poses of a path as a row, with the first and the last."""
    fixed = np.zeros(len(rows), dtype=np.bool_)
    fixed[0], fixed[-1] = request.start is not None, request.end is not None
    spans = np.diff(rows)
    longest = np.add.reduceat(request.longest, rows[:-1], axis=0)
    targets = np.ascontiguousarray(request.problem.goal.targets[rows])
    return Row(targets, fixed, spans.astype(np.float64)[:, None], longest)


def _put(request: PathRequest, smoother: Smoother, q: Array, row: Row) -> Array:
    """Project rows onto their targets; rows that are fixed get the requested joint values."""
    if request.start is not None:
        q[0] = request.start
    if request.end is not None:
        q[-1] = request.end + Turning(request.problem.chain).whole_turns(q[-1] - request.end)
    moved = q.copy()
    smoother.onto(moved, row.targets)
    moved[row.fixed] = q[row.fixed]
    return moved
