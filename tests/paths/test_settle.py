"""Newton's method on the weighted error itself, and on the squared one: its derivatives, its promises, and where it ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import kinseek
from chains import serial_chains
from kinseek import Goal
from kinseek.kernels.arrays import Limits
from kinseek.kernels.atlas import newton
from kinseek.kernels.jit import exposed
from kinseek.robots.chain import SerialChain
from reference import fk, weighted_error

pytestmark = pytest.mark.jit

Array = NDArray[np.float64]

minimise: Any = exposed(newton.minimise)
derivatives, damped_step = exposed(newton.derivatives), exposed(newton.damped_step)


def far_goal(chain: SerialChain, rng: np.random.Generator, far: float = 1.0) -> Goal:
    """A pose beside one that the arm has, mostly out of reach."""
    T = fk(chain, rng.uniform(chain.lower, chain.upper))
    T[:3, 3] += far * rng.normal(size=3)
    T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    return Goal.pose(T, position_weight=rng.uniform(0.5, 3), orientation_weight=rng.uniform(0, 2))


def squared_error(T: Array, goal: Goal) -> float:
    """Half the squared distance, and ``1 - c·c_g`` of each column, weighted."""
    asked = goal.arrays
    gap, weights = T[:3] - asked.target, (*asked.axis_weights, asked.position_weight)
    return float(0.5 * (gap**2).sum(axis=0) @ weights)


@pytest.mark.slow
@settings(max_examples=60)
@given(chain=serial_chains(), seed=st.integers(0, 2**32 - 1), squared=st.booleans())
def test_derivatives_agree_with_differences(chain: SerialChain, seed: int, squared: bool) -> None:
    rng = np.random.default_rng(seed)
    goal, q, n, m = far_goal(chain, rng), rng.uniform(-2, 2, chain.dof), chain.dof, len(chain.leader)

    def at(values: Array) -> tuple[Array, Array]:
        g, H = np.empty(n), np.empty((n, n))
        rest = np.empty((3, 4)), np.empty((m, 6)), np.empty((m, 3))
        derivatives(chain.arrays, goal.arrays, squared, values, newton.Model(*rest, g, H, np.empty((n, 3))))
        return g, np.tril(H) + np.tril(H, -1).T

    g, H = at(q)
    step, size = 1e-6, 1.0 + np.abs(H).max()
    error = squared_error if squared else weighted_error
    if not squared and np.linalg.norm(fk(chain, q)[:3, 3] - goal.target[:3, 3]) < 1e-2:
        return  # At the kink differences tell nothing.
    for i in range(n):
        ahead, behind = q + step * np.eye(n)[i], q - step * np.eye(n)[i]
        slope = (error(fk(chain, ahead), goal) - error(fk(chain, behind), goal)) / (2 * step)
        assert g[i] == pytest.approx(slope, abs=1e-6 * size)
        np.testing.assert_allclose(H[i], (at(ahead)[0] - at(behind)[0]) / (2 * step), atol=1e-4 * size)


@pytest.mark.slow
@settings(max_examples=60)
@given(chain=serial_chains(), seed=st.integers(0, 2**32 - 1), squared=st.booleans())
def test_it_stays_inside_the_limits_and_is_never_worse(chain: SerialChain, seed: int, squared: bool) -> None:
    rng = np.random.default_rng(seed)
    goal, start = far_goal(chain, rng), rng.uniform(chain.lower, chain.upper)
    q = start.copy()
    steps = newton.VALLEY_STEPS if squared else newton.WALK_STEPS
    limits = Limits(chain.lower, chain.upper)
    spent = minimise(chain.arrays, goal.arrays, limits, newton.Walk(squared, steps, 0.0), q)
    assert 1 <= spent <= (steps + 1 if squared else newton.WALK)
    assert ((q >= chain.lower) & (q <= chain.upper)).all()
    error = squared_error if squared else weighted_error
    before, after = (error(fk(chain, each), goal) for each in (start, q))
    assert after <= before + 1e-12


@pytest.mark.parametrize("name", ["panda", "ur5e", "scara4", "cylindrical3"])
def test_out_of_reach_it_ends_at_a_minimum_as_another_method_does(name: str) -> None:
    """Where the position is met and the orientation is not, the error has a kink, and steps along it are short."""
    chain, rng = kinseek.load(name).chain, np.random.default_rng(2)
    for _ in range(10):
        goal, q = far_goal(chain, rng, 10.0), rng.uniform(chain.lower, chain.upper)
        spent = minimise(chain.arrays, goal.arrays, Limits(chain.lower, chain.upper), newton.DOWNHILL, q)
        assert spent < newton.WALK
        found = weighted_error(fk(chain, q), goal)
        limits = list(zip(chain.lower, chain.upper, strict=True))
        theirs = minimize(lambda each, goal=goal: weighted_error(fk(chain, each), goal), q, bounds=limits)
        assert found <= theirs.fun + 1e-7


def test_a_step_solves_the_system_of_the_joints_that_are_free() -> None:
    rng = np.random.default_rng(0)
    for n in (1, 2, 4, 7):
        A = rng.normal(size=(n, n))
        H, g, held = A @ A.T + np.eye(n), rng.normal(size=n), rng.random(n) < 0.3
        L, step = np.zeros((n, n)), np.zeros(n)
        assert damped_step(np.tril(H), g, held, 0.1, L, step)
        free = ~held
        np.testing.assert_array_equal(step[held], 0.0)
        if free.any():
            expected = np.linalg.solve((H + 0.1 * np.eye(n))[np.ix_(free, free)], -g[free])
            np.testing.assert_allclose(step[free], expected, atol=1e-9)
    assert not damped_step(
        -np.eye(2), np.ones(2), np.zeros(2, dtype=bool), 0.1, np.zeros((2, 2)), np.zeros(2)
    )
