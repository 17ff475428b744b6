"""Shorten a whole path at once: all joints of all poses move within what the goal leaves free.

Each pass has two parts. It solves the Gauss-Newton system of all poses, with the steps x[i+1] - x[i] as residuals and J[i]
dx[i] = 0 as residuals with a large weight. The system has one block per pose and one coupling to the next, so the work grows
linearly with the number of poses. Then each pose is moved half-way between its neighbours, every other pose first. This
corrects errors that the Jacobian does not show near singularities. All poses are projected back onto their targets, and a
change is kept only if it improves the path: the sum of the joints' steps, each to a power, must decrease. The square makes a
path short; a higher power makes its largest steps small.

In a scene each pass checks the poses, and the steps between them are proved only at the end. If a changed step is then not
free, all passes are made again, and check points of the steps near it; then, if this was not enough, the poses near it stay
where they are.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import constraint_jacobian
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.kernels.arrays import Limits
from kinseek.kernels.paths.band import solve_band
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.problem import Problem
from kinseek.robots.geometry import RADIAN_PART
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import TimeUp

from .joints import Turning
from .request import PathRequest

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

STIFF = 1e4
"""μ: weight of leaving the pose, relative to a step of the same size; the remaining error is corrected after each pass. Not
examined further."""

PINNED = 1e8
"""Weight that keeps a joint at its value, relative to that of a step."""

TRUST = 0.4
"""Largest motion of any joint in one pass [rad or m]: the linearisation is not valid beyond it. Not examined further."""

TRIES, SHORTER = 5, 0.4
"""Most attempts of a Gauss-Newton step until the path improves, and the factor that shortens each further attempt. Not
examined further."""

TORN, LOOSER = 0.9, 1.2
"""A path is torn if a step grows and exceeds `TORN` times its largest allowed length. If the largest steps are minimised,
this bound is `LOOSER` times as large. Not examined further."""

TORN_ROWS = 4
"""Rows on each side of a torn step that are held back, multiplied by the number of the attempt. Not examined further."""

LIGHTEST, HEAVIEST = 0.5, 4.0
"""Bounds of a step's length, relative to the root mean square of all, when a higher power weights it. Not examined
further."""

ON_POSE = 1e-14
"""Squared scaled error up to which a pose counts as reached again; it corresponds to 1e-7 of the arm's length."""

MEND = 12
"""Most steps that bring a pose back onto its target. Not examined further."""

ACTIVE = 3
"""How often the system is solved with the joints that would leave their limits held there. Not examined further."""

ENOUGH = 1e-3
"""Smoothing ends after a pass that reduces the sum by less than this fraction. Not examined further."""


BESIDE = 8
"""Steps before and after one that is not free that are checked in every pass when the smoothing is repeated, and poses that
are held still after that. Not examined further."""

SLACK, MARGIN = 1e-4, 5e-4
"""A smoothed step stays free if joints deviate from it by the first [rad or m], since it takes long to prove that steps are
free which graze a body; points of it keep the second more than the clearance [m]. Not examined further."""

TRIALS = 4
"""How often a path is smoothed in a scene: without checks of steps, with checks near those that collide, and, where these
still do, without the poses near them. Not examined further."""


class Row(NamedTuple):
    """Consecutive poses: all of a path or some of them."""

    targets: Array
    """Targets, (k, 3, 4)."""
    fixed: Flags
    """Flags of the poses that stay where they are, (k,)."""
    spans: Array
    """Number of steps of the path from one to the next, (k - 1, 1)."""
    longest: Array
    """Largest motion of each joint from one to the next, (k - 1, n), [rad] or [m]."""


Check = Callable[[Array, Array], Flags]
"""Returns which steps, (k, n) to (k, n), are free, (k,)."""


class Smoother:
    """Shorten paths of one request."""

    def __init__(self, request: PathRequest) -> None:
        """Build what the arm needs once.

        Rejected joint values and steps are not used. Smoothing ends at the deadline, with the path as smooth as it is then.
        """
        self.deadline, self.problem, self.valid = request.deadline, request.problem, request.valid
        self.weights = request.step_weights / request.step_weights.max()
        turning = Turning(self.problem.chain)
        self.lower, self.upper = turning.open_lower, turning.open_upper
        self.limits = Limits(self.lower, self.upper)
        self.index, self.tolerances = (
            atlas_of(self.problem.chain, self.problem.goal),
            tolerances_of(self.problem.goal),
        )
        self.scale = self.problem.chain.length / RADIAN_PART

    def project(self, q: Array, targets: Array) -> Flags:
        """Project joint values, (k, n), onto targets, (k, 3, 4), in place.

        Returns:
            Flags of the rows that arrived and are allowed, (k,).
        """
        left = np.empty(len(q))
        np.clip(q, self.lower, self.upper, out=q)
        project_onto_poses(self.index.job(self.tolerances), targets, self.limits, MEND, q, left)
        there = left < ON_POSE
        if self.valid is not None:
            there[there] = self.valid.each(q[there])
        return there

    def onto(self, q: Array, targets: Array) -> None:
        """Like `project`, but replace rows that do not arrive by what the atlas finds, at worst the nearest pose."""
        begin = q.copy()
        lost = np.flatnonzero(~self.project(q, targets))
        if not len(lost):
            return
        goal = self.problem.goal
        near = Problem(
            self.problem.mechanism,
            goal.at(goal.target[lost]),
            np.clip(begin[lost], -LARGEST, LARGEST),
            time_limit=self.deadline.left,
        )
        q[lost] = Atlas(threads=1).solve(near).q

    def smooth(self, q: Array, row: Row, passes: int, power: int) -> Array:
        """Improve a path, (k, n).

        Args:
            q: Joint values inside the limits, endless joints unwrapped.
            row: The targets and bounds of the poses.
            passes: Most passes.
            power: Power of the joints' steps in the sum.
        """
        if len(q) < 3:
            return q
        careful, every = np.zeros(len(q) - 1, dtype=np.bool_), np.ones(len(q) - 1, dtype=np.bool_)
        # Between poses that are not adjacent the path does not go straight, so a proof would be of no use.
        check = self._proved if (row.spans <= 1.0).all() else self._sampled
        with suppress(TimeUp):
            for tries in range(TRIALS):
                moved = self._passes(q, row, passes, power, careful)
                hits = self._hits(q, moved, every, check)
                if not len(hits):
                    return moved
                beside = np.zeros(len(q), dtype=np.bool_)
                for i in hits.tolist():
                    careful[max(i - BESIDE, 0) : i + 1 + BESIDE] = True
                    beside[max(i - BESIDE, 0) : i + 2 + BESIDE] = True
                if tries:
                    row = row._replace(fixed=row.fixed | beside)
            self._put_back(q, moved, every, check)
            bounds = np.maximum(np.abs(np.diff(q, axis=0)), row.longest)
            if (np.abs(np.diff(moved, axis=0)) <= bounds * (1 + 1e-9)).all():
                return moved
        return q

    def _passes(self, q: Array, row: Row, passes: int, power: int, careful: Flags) -> Array:
        """Make the passes of `smooth`; points of changed steps that are `careful`, (k - 1,), are checked in each of them."""
        before = self._sum(q, row, power)
        with suppress(TimeUp):
            for _ in range(passes):
                q = self._gauss_newton(q, row, power, careful)
                q = self._relax_each(q, row, power, careful)
                now = self._sum(q, row, power)
                # Further passes would cost as much time and change almost nothing.
                if now > before * (1 - ENOUGH):
                    break
                before = now
        return q

    def _hits(self, q: Array, moved: Array, which: Flags, check: Check) -> Indices:
        """Return those of some steps of a moved path, (k, n) both, that changed and are not free."""
        if self.valid is None or self.valid.scene is None:
            return np.zeros(0, dtype=np.int64)
        off = (moved != q).any(axis=1)
        # Steps between unchanged poses are as free as before.
        steps = np.flatnonzero((off[:-1] | off[1:]) & which)
        return steps[~check(moved[steps], moved[steps + 1])]

    def _proved(self, a: Array, b: Array) -> Flags:
        """Return which steps, (k, n) to (k, n), are proved free, (k,)."""
        assert self.valid is not None
        return self.valid.free_ways(a, b, SLACK)

    def _sampled(self, a: Array, b: Array) -> Flags:
        """Return which steps, (k, n) to (k, n), are free at some points, (k,)."""
        assert self.valid is not None
        return self.valid.probably_free(a, b, MARGIN)

    def _of_steps(self, steps: Array, spans: Array, power: int) -> Array:
        """Return for each step, (k, n), the sum of the joints' motions, each to a power, (k,)."""
        lengths = steps * self.weights / spans
        powers = lengths * lengths
        if power > 2:
            powers = powers * powers * powers
        if power > 6:
            powers = powers * powers
        return np.asarray((powers * spans).sum(axis=1))

    def _sum(self, q: Array, row: Row, power: int) -> float:
        return float(self._of_steps(np.diff(q, axis=0), row.spans, power).sum())

    def _gauss_newton(self, q: Array, row: Row, power: int, careful: Flags) -> Array:
        """Make one Gauss-Newton step of all poses, held back where it would tear the path.

        Raises:
            TimeUp: The time is up; the path is unchanged.
        """
        self.deadline.check()
        step = self._step(q, row, power)
        before, share = self._sum(q, row, power), np.ones(len(q))
        bounds = np.maximum(np.abs(np.diff(q, axis=0)), TORN * row.longest)
        if power > 2:
            bounds *= LOOSER
        for tries in range(TRIES):
            self.deadline.check()
            moved = q + share[:, None] * step
            # Poses that do not return to their target stay where they were; the others keep the improvement.
            lost = ~self.project(moved, row.targets) | row.fixed
            moved[lost] = q[lost]
            self._put_back(q, moved, careful, self._sampled)
            torn = np.flatnonzero((np.abs(np.diff(moved, axis=0)) > bounds * (1 + 1e-9)).any(axis=1))
            if not len(torn):
                if self._sum(moved, row, power) < before:
                    return moved
                share *= SHORTER
            # Shortening all steps would stop the smoothing everywhere because of one place.
            for i in torn.tolist():
                reach = TORN_ROWS * (1 + tries)
                first, last = max(i - reach, 0), min(i + 2 + reach, len(q))
                away = np.abs(np.arange(first, last) - i - 0.5) - 0.5
                share[first:last] = np.minimum(share[first:last], away / reach)
        return q

    def _step(self, q: Array, row: Row, power: int) -> Array:
        """Return the Gauss-Newton step of all poses, (k, n)."""
        J = constraint_jacobian(self.problem, q)
        J[:, :3] /= self.scale
        steps = np.diff(q, axis=0)
        lengths = np.abs(steps * self.weights) / row.spans
        usual = np.sqrt((lengths.max(axis=1) ** 2).mean() + 1e-18)
        # Iteratively reweighted least squares: weights that are too different make the system badly conditioned.
        heavy = np.clip(lengths / usual, LIGHTEST, HEAVIEST) ** (power - 2)
        coupling = np.zeros_like(q)
        coupling[:-1] = heavy * self.weights**2 / row.spans
        blocks = np.matmul(np.swapaxes(J, 1, 2), J)
        del J  # It is as large as the blocks, which exist twice below.
        blocks *= STIFF * heavy.max() * float((self.weights**2).mean())
        diagonal = np.arange(q.shape[1])
        beside = coupling.copy()
        beside[1:] += coupling[:-1]
        blocks[:, diagonal, diagonal] += beside
        pull = np.zeros_like(q)
        pull[:-1] += coupling[:-1] * steps
        pull[1:] -= coupling[:-1] * steps
        pinned = np.repeat(row.fixed[:, None], q.shape[1], axis=1)
        move, firm = np.zeros_like(q), PINNED * heavy.max() * self.weights**2
        step, system = move, np.empty_like(blocks)
        for _ in range(ACTIVE):
            system[:], step = blocks, np.where(pinned, firm * move, pull)
            system[:, diagonal, diagonal] += np.where(pinned, firm, 0.0)
            solve_band(system, coupling, step)
            # Active set method: joints that would leave their limits are pinned there, and the others are computed again.
            beyond = ~pinned & ((q + step < self.lower - 1e-9) | (q + step > self.upper + 1e-9))
            if not beyond.any():
                break
            pinned |= beyond
            move = np.where(beyond, np.clip(q + step, self.lower, self.upper) - q, move)
        step *= np.minimum(1.0, TRUST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        step[row.fixed] = 0.0
        return step

    def _put_back(self, q: Array, moved: Array, which: Flags, check: Check) -> None:
        """Restore rows of a moved path, (k, n) both, until none of some steps, (k - 1,), changed and collides."""
        now = which
        while len(hits := self._hits(q, moved, now, check)):
            off = (moved != q).any(axis=1)
            rows = np.union1d(hits, hits + 1)
            rows = rows[off[rows]]
            moved[rows] = q[rows]
            # Only steps beside the restored rows are different now.
            beside = np.union1d(rows[rows > 0] - 1, rows[rows < len(q) - 1])
            now = np.zeros_like(which)
            now[beside] = which[beside]

    def _relax_each(self, q: Array, row: Row, power: int, careful: Flags) -> Array:
        """Move each pose between its neighbours if this improves its two steps."""
        q = q.copy()
        # Every other pose: neighbours do not move at the same time, so each comparison stays valid.
        for first in (1, 2):
            self.deadline.check()
            some = np.arange(first, len(q) - 1, 2)
            some = some[~row.fixed[some]]
            if not len(some):
                continue
            before, here, after = q[some - 1], q[some], q[some + 1]
            span_before, span_after = row.spans[some - 1], row.spans[some]
            middle = (before * span_after + after * span_before) / (span_after + span_before)
            there = self.project(middle, np.ascontiguousarray(row.targets[some]))
            now = self._of_steps(here - before, span_before, power) + self._of_steps(
                after - here, span_after, power
            )
            then = self._of_steps(middle - before, span_before, power) + self._of_steps(
                after - middle, span_after, power
            )
            better = there & (then < now)
            if self.valid is not None and self.valid.scene is not None:
                # A break at a body stays one: two shorter ones have a smaller sum of squares.
                for old, new, longest in (
                    (here - before, middle - before, row.longest[some - 1]),
                    (after - here, after - middle, row.longest[some]),
                ):
                    better &= (np.abs(new) <= np.maximum(np.abs(old), longest)).all(axis=1)
                doubtful = np.flatnonzero(better & (careful[some - 1] | careful[some]))
                free = self._sampled(before[doubtful], middle[doubtful])
                free[free] = self._sampled(middle[doubtful][free], after[doubtful][free])
                better[doubtful] = free
            q[some[better]] = middle[better]
        return q
