"""A whole path made short at once: all joints of all poses move along what the goal leaves open.

The sum of the squared steps is least where no pose can move along its self-motion and make it less. Each pass solves the
Gauss-Newton system of all poses together, ``min Σ |W (x[i+1] - x[i])|² + μ Σ |J[i] dx[i]|²``: one block a pose and one
beside it, so the work grows with the number of poses alone. Then every pose is brought back onto its target.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.index import constraint_jacobian
from kinseek.branches.order import Valid, is_valid
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.band import solve_band
from kinseek.kernels.paths.settle import settle_many
from kinseek.problem import Problem
from kinseek.robots.geometry import arm_length
from kinseek.solvers.atlas.index import atlas_of, wanted_of

from .joints import Turning

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

STIFF = 1e5
"""μ: how much more leaving the pose costs than a step of the same size; what it leaves is mended after each pass."""

HELD = 1e8
"""Weight that keeps a joint where it is, relative to that of a step."""

TRUST = 0.4
"""No joint moves farther in one pass [rad or m]: beyond, the Jacobian says nothing."""

SETTLED = 1e-14
"""Squared scaled error up to which a pose counts as reached again: 1e-7 of the arm's length."""

MEND = 12
"""Steps at most that bring a pose back onto its target."""

ACTIVE = 3
"""How often joints that would leave their limits are held there, and the system solved again."""


@dataclass(frozen=True)
class Smoother:
    """What smoothing needs of an arm and a goal."""

    problem: Problem
    weights: Array
    """Of each joint, (n,)."""
    valid: Valid | None = None
    """What the user allows; rows that it refuses after a pass stay where they were."""

    def settle(self, q: Array, targets: Array) -> Array:
        """Bring joint values, (k, n), onto targets, (k, 3, 4), in place; squared scaled error that is left, (k,)."""
        turning, left = Turning(self.problem.chain), np.empty(len(q))
        np.clip(q, turning.open_lower, turning.open_upper, out=q)
        index = atlas_of(self.problem.chain, self.problem.goal)
        wanted = wanted_of(self.problem.goal)
        limits = turning.open_lower, turning.open_upper
        settle_many(index.handle, wanted, targets, *limits, MEND, q, left, LANES)
        return left

    def smooth(self, q: Array, targets: Array, passes: int, fixed: Flags, enough: float = 1e-4) -> Array:
        """Make a path shorter, (k, n): each row stays on its target, (k, 3, 4), and rows that are `fixed`, (k,), stay.

        Args:
            q: Joint values inside the limits, endless joints unwrapped.
            targets: Where they must stay.
            passes: How many at most.
            fixed: Rows that stay.
            enough: When no joint moves farther in a pass [rad or m], it is done.
        """
        turning = Turning(self.problem.chain)
        lower, upper = turning.open_lower, turning.open_upper
        square, scale = self.weights**2, arm_length(self.problem.chain) / 3
        for _ in range(passes):
            J = constraint_jacobian(self.problem, q)
            J[:, :3] /= scale
            blocks = np.matmul(np.swapaxes(J, 1, 2), J)
            blocks *= STIFF * square.mean()
            diagonal = np.arange(q.shape[1])
            blocks[:, diagonal, diagonal] += 2 * square
            blocks[0, diagonal, diagonal] -= square
            blocks[-1, diagonal, diagonal] -= square
            pull = -2 * q
            pull[1:] += q[:-1]
            pull[:-1] += q[1:]
            pull[0] += q[0]
            pull[-1] += q[-1]
            pull *= square
            held = np.zeros(q.shape, dtype=np.bool_)
            held[fixed] = True
            move = np.zeros_like(q)
            for _ in range(ACTIVE):
                system, right = blocks.copy(), np.where(held, HELD * square * move, pull)
                system[:, diagonal, diagonal] += np.where(held, HELD * square, 0.0)
                solve_band(system, square, right)
                beyond = ~held & ((q + right < lower - 1e-9) | (q + right > upper + 1e-9))
                if not beyond.any():
                    break
                held |= beyond
                move = np.where(beyond, np.clip(q + right, lower, upper) - q, move)
            right *= np.minimum(1.0, TRUST / np.maximum(np.abs(right).max(axis=1, keepdims=True), 1e-300))
            right[fixed] = 0.0
            moved = q + right
            left = self.settle(moved, targets)
            lost = ~(left < SETTLED) | fixed
            if self.valid is not None:
                lost |= ~np.array([is_valid(self.valid, row) for row in moved])
            moved[lost] = q[lost]
            gone = np.abs(moved - q).max(initial=0.0)
            q = moved
            if gone < enough:
                break
        return q
