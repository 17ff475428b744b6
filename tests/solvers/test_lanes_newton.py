"""Newton's method in lanes: its derivatives against finite differences, and its damped steps against NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from inlined import inlined
from kinseek import Goal
from kinseek.kernels.arm.links import links_of
from kinseek.kernels.arrays import Limits
from kinseek.kernels.atlas import lanes_newton as newton
from kinseek.kernels.atlas.lanes import LANES, lanes_forward
from kinseek.kernels.atlas.memory import make_scratch, scratch_size

Array = NDArray[np.float64]

forward, derivatives = inlined(lanes_forward), inlined(newton.lanes_derivatives)
errors, newton_step = inlined(newton.lanes_errors), inlined(newton.lanes_newton)

ARMS = ("ur5e", "gen3", "scara4", "baxter_left", "pr2_left")


class Eight:
    """Eight configurations of an arm towards a goal, and the model of their errors."""

    def __init__(self, arm: kinseek.Arm, goal: Goal) -> None:
        chain, n = arm.chain.arrays, arm.dof
        m, pairs = len(chain.leader), n * (n + 1) // 2
        self.leader, self.links, self.goal = chain.leader, links_of(chain), goal.arrays
        self.memory = np.zeros(scratch_size(n, m))
        self.room = np.full(newton.model_size(n, m, pairs), np.nan)
        self.lanes: Any = make_scratch(self.memory, n, m).lanes
        self.model: Any = newton.lay_model(self.room.ctypes.data, n, m, pairs)

    def at(self, q: Array) -> tuple[Array, Array, Array]:
        """Errors, (8,), gradients, (8, n), and Hessians, (8, n, n), at joint values, (8, n)."""
        n = q.shape[1]
        self.lanes.q[:] = q.T
        forward(self.leader, self.links, self.lanes, LANES)
        errors(self.goal, self.lanes, self.model.now, LANES)
        derivatives(self.leader, self.links, self.goal, self.lanes, self.model, LANES)
        H = np.zeros((LANES, n, n))
        rows, columns = np.tril_indices(n)
        H[:, rows, columns] = H[:, columns, rows] = self.model.hessian.T
        return self.model.now.copy(), self.model.gradient.T.copy(), H


def eight(name: str, seed: int = 0) -> tuple[kinseek.Arm, Eight, Array]:
    """A goal that is not in reach, and eight configurations at random."""
    arm, rng = kinseek.load(name), np.random.default_rng(seed)
    low, high = np.maximum(arm.lower, -3.0), np.minimum(arm.upper, 3.0)
    q = rng.uniform(low, high, (LANES, arm.dof))
    T = arm.fk(rng.uniform(low, high))
    T[:3, 3] += 1.5 * arm.chain.reach * np.array([0.6, -0.64, 0.48])
    return arm, Eight(arm, Goal.pose(T, orientation_weight=0.7)), q


@pytest.mark.parametrize("name", ARMS)
def test_the_derivatives_are_those_of_the_weighted_error(name: str) -> None:
    arm, lanes, q = eight(name)
    found, gradients, hessians = lanes.at(q)
    h = 1e-4
    for i, ahead in enumerate(h * np.eye(arm.dof)):
        (after, up, _), (before, down, _) = lanes.at(q + ahead), lanes.at(q - ahead)
        np.testing.assert_allclose(gradients[:, i], (after - before) / (2.0 * h), atol=1e-6)
        np.testing.assert_allclose(hessians[:, i], (up - down) / (2.0 * h), atol=1e-6)
    goal = Goal.pose(np.vstack([lanes.goal.target, [0.0, 0.0, 0.0, 1.0]]), orientation_weight=0.7)
    gaps = arm.fk(q) - goal.target
    by_hand = np.linalg.norm(gaps[:, :3, 3], axis=1) + 0.35 * (gaps[:, :3, :2] ** 2).sum(axis=(1, 2))
    np.testing.assert_allclose(found, by_hand, rtol=1e-12)


@pytest.mark.parametrize("name", ARMS)
def test_a_step_solves_the_damped_system_of_the_joints_that_are_free(name: str) -> None:
    """Where the Hessian is positive definite, which much damping makes sure of; else the step leads downhill."""
    arm, lanes, q = eight(name, 1)
    q[::2, 0] = arm.lower[0] if np.isfinite(arm.lower[0]) else q[::2, 0]
    for damping in (0.0, 20.0):
        _, gradients, hessians = lanes.at(q)
        lanes.model.damping[:] = damping
        newton_step(Limits(arm.lower, arm.upper), lanes.lanes, lanes.model, LANES)
        steps = lanes.lanes.step.T
        for l in range(LANES):
            g, held = gradients[l], (q[l] <= arm.lower) & (gradients[l] > 0.0)
            assert (steps[l][held] == 0.0).all()
            free = np.flatnonzero(~held)
            assert g @ steps[l] < 0.0
            H = hessians[l][np.ix_(free, free)]
            H = H + damping * np.abs(np.diag(hessians[l])).max() * np.eye(len(free))
            if np.linalg.eigvalsh(H)[0] > 1e-6:
                np.testing.assert_allclose(H @ steps[l][free], -g[free], atol=1e-9 * np.abs(H).max())
                assert lanes.model.convex[l] == 1.0
                assert lanes.model.predicted[l] == pytest.approx(-0.5 * g @ steps[l])
            elif np.linalg.eigvalsh(H)[0] < -1e-6:
                assert lanes.model.convex[l] == 0.0
    assert lanes.model.convex.all()
