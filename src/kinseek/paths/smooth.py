"""A whole path made short at once: all joints of all poses move along what the goal leaves open.

Each pass does two things. It solves the Gauss-Newton system of all poses together, with steps x[i+1] - x[i] as residuals and
J[i] dx[i] = 0 as heavy ones: one block a pose and one beside it, so that the work grows with the number of poses alone. And
it puts every pose half-way between its neighbours, every other pose first, which mends what the Jacobian does not see near
singularities. Everything is brought back onto its target, and kept only where it makes the path better: where the sum of
what the joints move from pose to pose, each to a power, is less. The square makes a path short, a higher power makes its
largest steps small.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import constraint_jacobian
from kinseek.deadline import Deadline, TimeUp
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.band import solve_band
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.problem import Problem
from kinseek.robots.geometry import RADIAN_PART, arm_length
from kinseek.solvers import Atlas
from kinseek.solvers.atlas.index import atlas_of, tolerances_of

from .allowed import Allowed
from .joints import Turning

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STIFF = 1e4
"""μ: how much more leaving the pose costs than a step of the same size; what it leaves is mended after each pass."""

HELD = 1e8
"""Weight that keeps a joint where it is, relative to that of a step."""

TRUST = 0.4
"""No joint moves farther in one pass [rad or m]: beyond, the Jacobian says nothing."""

TRIES, SHORTER = 5, 0.4
"""How often a Gauss-Newton step is tried until the path is better, each time so much shorter."""

KEPT, TORN = 0.9, 1.2
"""A path is torn where a step becomes larger than before and than this part of what is allowed; while the largest steps are
made small, by so much larger."""

HOLD = 4
"""Where a step tears the path so many more rows, to each side, are held back at each try."""

LIGHTEST, HEAVIEST = 0.5, 4.0
"""Steps count as no shorter and no longer than this beside the usual one, where a higher power weighs them."""

SETTLED = 1e-14
"""Squared scaled error up to which a pose counts as reached again: 1e-7 of the arm's length."""

MEND = 12
"""Steps at most that bring a pose back onto its target."""

ACTIVE = 3
"""How often joints that would leave their limits are held there, and the system solved again."""

ENOUGH = 1e-3
"""A pass that makes the sum smaller by less than this part of it is the last."""


class Row(NamedTuple):
    """Poses in a row, all of a path or some of them."""

    targets: Array
    """(k, 3, 4)"""
    fixed: Flags
    """Which of them stay where they are, (k,)."""
    spans: Array
    """Steps from one to the next, (k - 1, 1): between them others may lie."""
    longest: Array
    """How far each joint may go from one to the next, (k - 1, n), [rad] or [m]."""


class Smoother:
    """Makes paths of one arm and one kind of goal shorter."""

    def __init__(
        self,
        problem: Problem,
        weights: Array,
        valid: Allowed | None = None,
        deadline: Deadline | None = None,
    ) -> None:
        """Build what the arm needs once.

        Args:
            problem: The arm and its goal.
            weights: Of each joint in the length, (n,).
            valid: What the user and the scene allow; what they refuse is not taken, and no step that is not free.
            deadline: When it has passed, a path stays as smooth as it is by then.
        """
        self.deadline = Deadline() if deadline is None else deadline
        self.problem, self.weights, self.valid = problem, weights, valid
        turning = Turning(problem.chain)
        self.lower, self.upper = turning.open_lower, turning.open_upper
        self.handle, self.tolerances = (
            atlas_of(problem.chain, problem.goal).handle,
            tolerances_of(problem.goal),
        )
        self.scale = arm_length(problem.chain) / RADIAN_PART

    def settle(self, q: Array, targets: Array) -> Flags:
        """Bring joint values, (k, n), onto targets, (k, 3, 4), in place; which of them are there and allowed, (k,)."""
        left = np.empty(len(q))
        np.clip(q, self.lower, self.upper, out=q)
        project_onto_poses(
            self.handle, self.tolerances, targets, self.lower, self.upper, MEND, q, left, LANES
        )
        there = left < SETTLED
        if self.valid is not None:
            there[there] = self.valid.each(q[there])
        return there

    def onto(self, q: Array, targets: Array) -> None:
        """As `settle`; what does not get there from where it is becomes what the atlas finds, the nearest pose at worst."""
        begin = q.copy()
        lost = np.flatnonzero(~self.settle(q, targets))
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
        """Make a path better, (k, n).

        Args:
            q: Joint values inside the limits, endless joints unwrapped.
            row: Where they must stay.
            passes: How many at most.
            power: Of what the joints move.
        """
        if len(q) < 3:
            return q
        before = self._sum(q, row, power)
        with suppress(TimeUp):
            for _ in range(passes):
                q = self._together(q, row, power)
                q = self._one_by_one(q, row, power)
                now = self._sum(q, row, power)
                if now > before * (1 - ENOUGH):
                    break
                before = now
        return q

    def _of_steps(self, steps: Array, spans: Array, power: int) -> Array:
        """Of each step, (k, n), the sum of what the joints move, each to a power, (k,)."""
        lengths = steps * self.weights / spans
        powers = lengths * lengths
        if power > 2:
            powers = powers * powers * powers
        if power > 6:
            powers = powers * powers
        return np.asarray((powers * spans).sum(axis=1))

    def _sum(self, q: Array, row: Row, power: int) -> float:
        return float(self._of_steps(np.diff(q, axis=0), row.spans, power).sum())

    def _together(self, q: Array, row: Row, power: int) -> Array:
        """One Gauss-Newton step of all poses, held back where it would tear the path.

        Raises:
            TimeUp: The time is up; the path stays as it was.
        """
        self.deadline.check()
        step = self._step(q, row, power)
        before, share = self._sum(q, row, power), np.ones(len(q))
        bounds = np.maximum(np.abs(np.diff(q, axis=0)), KEPT * row.longest)
        if power > 2:
            bounds *= TORN
        for tries in range(TRIES):
            self.deadline.check()
            moved = q + share[:, None] * step
            lost = ~self.settle(moved, row.targets) | row.fixed
            moved[lost] = q[lost]
            self._put_back(q, moved)
            torn = np.flatnonzero((np.abs(np.diff(moved, axis=0)) > bounds * (1 + 1e-9)).any(axis=1))
            if not len(torn):
                if self._sum(moved, row, power) < before:
                    return moved
                share *= SHORTER
            for i in torn.tolist():
                reach = HOLD * (1 + tries)
                first, last = max(i - reach, 0), min(i + 2 + reach, len(q))
                away = np.abs(np.arange(first, last) - i - 0.5) - 0.5
                share[first:last] = np.minimum(share[first:last], away / reach)
        return q

    def _step(self, q: Array, row: Row, power: int) -> Array:
        """Where the Gauss-Newton step of all poses leads from here, (k, n)."""
        J = constraint_jacobian(self.problem, q)
        J[:, :3] /= self.scale
        steps = np.diff(q, axis=0)
        lengths = np.abs(steps * self.weights) / row.spans
        usual = np.sqrt((lengths.max(axis=1) ** 2).mean() + 1e-18)
        heavy = np.clip(lengths / usual, LIGHTEST, HEAVIEST) ** (power - 2)
        coupling = np.zeros_like(q)
        coupling[:-1] = heavy * self.weights**2 / row.spans
        blocks = np.matmul(np.swapaxes(J, 1, 2), J)
        del J  # It is as large as the blocks, which are there twice below.
        blocks *= STIFF * heavy.max() * float((self.weights**2).mean())
        diagonal = np.arange(q.shape[1])
        beside = coupling.copy()
        beside[1:] += coupling[:-1]
        blocks[:, diagonal, diagonal] += beside
        pull = np.zeros_like(q)
        pull[:-1] += coupling[:-1] * steps
        pull[1:] -= coupling[:-1] * steps
        held = np.repeat(row.fixed[:, None], q.shape[1], axis=1)
        move, firm = np.zeros_like(q), HELD * heavy.max() * self.weights**2
        step, system = move, np.empty_like(blocks)
        for _ in range(ACTIVE):
            system[:], step = blocks, np.where(held, firm * move, pull)
            system[:, diagonal, diagonal] += np.where(held, firm, 0.0)
            solve_band(system, coupling, step)
            beyond = ~held & ((q + step < self.lower - 1e-9) | (q + step > self.upper + 1e-9))
            if not beyond.any():
                break
            held |= beyond
            move = np.where(beyond, np.clip(q + step, self.lower, self.upper) - q, move)
        step *= np.minimum(1.0, TRUST / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
        step[row.fixed] = 0.0
        return step

    def _put_back(self, q: Array, moved: Array) -> None:
        """Put rows of a moved path back to where they were, (k, n) both, until no step hits what it did not hit before."""
        if self.valid is None or self.valid.scene is None:
            return
        off = (moved != q).any(axis=1)
        steps = np.flatnonzero(off[:-1] | off[1:])
        while len(steps):
            hits = steps[~self.valid.free_ways(moved[steps], moved[steps + 1])]
            rows = np.union1d(hits, hits + 1)
            rows = rows[off[rows]]
            moved[rows], off[rows] = q[rows], False
            beside = np.union1d(rows[rows > 0] - 1, rows[rows < len(q) - 1])
            steps = beside[off[beside] | off[beside + 1]]

    def _one_by_one(self, q: Array, row: Row, power: int) -> Array:
        """Put each pose between its neighbours, where that makes its two steps better."""
        q = q.copy()
        for first in (1, 2):
            self.deadline.check()
            some = np.arange(first, len(q) - 1, 2)
            some = some[~row.fixed[some]]
            if not len(some):
                continue
            before, here, after = q[some - 1], q[some], q[some + 1]
            behind, ahead = row.spans[some - 1], row.spans[some]
            middle = (before * ahead + after * behind) / (ahead + behind)
            there = self.settle(middle, np.ascontiguousarray(row.targets[some]))
            now = self._of_steps(here - before, behind, power) + self._of_steps(after - here, ahead, power)
            then = self._of_steps(middle - before, behind, power) + self._of_steps(
                after - middle, ahead, power
            )
            better = there & (then < now)
            if self.valid is not None:
                free = self.valid.free_ways(before[better], middle[better])
                free[free] = self.valid.free_ways(middle[better][free], after[better][free])
                better[better] = free
            q[some[better]] = middle[better]
        return q
