"""Coordinate descent: exact along a joint and along a pair, never worse, inside the limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import kinseek
from kinseek import CoordinateDescent
from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.grid.sinusoid import Motion, fit_of, minimise_pair, minimiser, value_at
from reference import Array, chordal_error, fk

COEFFICIENT = st.floats(-10, 10, allow_subnormal=False)


def one_joint(name: str, joint: int, seed: int) -> tuple[kinseek.Arm, Array, kinseek.Goal, CoordinateDescent]:
    """An arm, a start, a goal, and a descent that can move nothing but one joint: the others have no room."""
    arm = kinseek.load(name)
    rng = np.random.default_rng(seed)
    start, other = rng.uniform(arm.lower, arm.upper, (2, arm.dof))
    goal = kinseek.Goal.pose(arm.fk(other), position_weight=3.0, orientation_weight=0.5)
    lower, upper = start.copy(), start.copy()
    lower[joint], upper[joint] = arm.lower[joint], arm.upper[joint]
    chain = kinseek.Arm(type(arm.chain)(**{**fields(arm), "lower": lower, "upper": upper}))
    return chain, start, goal, CoordinateDescent(most_sweeps=1, pairs=False)


def fields(arm: kinseek.Arm) -> dict[str, object]:
    return {name: getattr(arm.chain, name) for name in arm.chain.__dataclass_fields__}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "joint"),
    [
        ("elbow6", 0),
        ("elbow6", 4),
        ("scara4", 2),
        ("cylindrical3", 1),
        ("panda", 3),
        ("irb5400", 0),
        ("irb5400", 4),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_one_joint_is_minimised_exactly(name: str, joint: int, seed: int) -> None:
    arm, start, goal, solver = one_joint(name, joint, seed)
    solution = arm.ik(goal, near=start, solver=solver)
    low, high = arm.lower[joint], arm.upper[joint]
    for _ in range(2):  # 101 values of all, and then of what lies around the best of them.
        scan = np.repeat(start[None], 101, axis=0)
        scan[:, joint] = np.linspace(low, high, 101)
        scanned = [chordal_error(fk(arm.chain, q), goal) for q in scan]
        best = int(np.argmin(scanned))
        low, high = scan[max(best - 1, 0), joint], scan[min(best + 1, 100), joint]
    assert chordal_error(fk(arm.chain, solution.q), goal) <= min(scanned) + 1e-12


@pytest.mark.slow
@given(COEFFICIENT, COEFFICIENT, COEFFICIENT, st.floats(-8, 0), st.floats(0, 8), st.booleans())
@settings(max_examples=300)
def test_minimiser_agrees_with_a_dense_scan(
    a: float, b: float, c: float, low: float, high: float, revolute: bool
) -> None:
    fit = Vector(a, b, c)
    delta = minimiser(fit, Motion(low, high, revolute))
    assert low <= delta <= high
    dense = min(value_at(fit, float(x), revolute) for x in np.linspace(low, high, 500))
    assert value_at(fit, delta, revolute) <= dense + 1e-9


@given(COEFFICIENT, COEFFICIENT, COEFFICIENT, st.floats(0, 2))
def test_three_samples_give_the_coefficients(a: float, b: float, c: float, slide: float) -> None:
    slide = 0.0 if slide < 0.01 else slide
    step = slide or 2 * np.pi / 3
    fit = Vector(a, b, c)
    f0, f1, f2 = (value_at(fit, delta, slide == 0.0) for delta in (0.0, step, -step))
    assert fit_of(f0, f1, f2, slide) == pytest.approx((a, b, c), abs=1e-9)


# Least at one end, nearly so at the other.
@example([0.0, 0.0, -1.0, -1.0, 0.0, -3.0, 0.0, 2.5, 3.0], (False, True))
@given(st.lists(COEFFICIENT, min_size=9, max_size=9), st.tuples(st.booleans(), st.booleans()))
@settings(max_examples=50)
def test_a_pair_is_minimised_over_its_box(numbers: list[float], revolute: tuple[bool, bool]) -> None:
    M, low, high = np.reshape(numbers, (3, 3)), np.array([-2.0, -1.0]), np.array([1.5, 3.0])
    delta = np.array(
        minimise_pair(M, *(Motion(*each) for each in zip(low.tolist(), high.tolist(), revolute, strict=True)))
    )
    assert (delta >= low).all()
    assert (delta <= high).all()

    def bases(x: Array, turns: bool) -> Array:
        return np.stack([x**0, np.cos(x), np.sin(x)] if turns else [x**0, x, x * x])

    grids = [bases(np.linspace(low[i], high[i], 60), revolute[i]) for i in range(2)]
    found = bases(delta[:1], revolute[0]).T @ M @ bases(delta[1:], revolute[1])
    assert found[0, 0] <= (grids[0].T @ M @ grids[1]).min() + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "cylindrical3", "scara4", "elbow6", "panda", "irb5400"])
@pytest.mark.parametrize("pairs", [True, False])
def test_never_worse_and_inside_the_limits(name: str, pairs: bool) -> None:
    arm = kinseek.load(name)
    starts, others = np.random.default_rng(4).uniform(arm.lower, arm.upper, (2, 10, arm.dof))
    for start, T in zip(starts, arm.fk(others), strict=True):
        goal, before = kinseek.Goal.pose(T), np.inf
        for sweeps in (1, 2, 5, 50):
            solution = arm.ik(goal, near=start, solver=CoordinateDescent(most_sweeps=sweeps, pairs=pairs))
            error = chordal_error(fk(arm.chain, solution.q), goal)
            assert error <= min(before, chordal_error(fk(arm.chain, start), goal)) + 1e-15
            assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
            before = error


@pytest.mark.parametrize("name", ["planar2", "scara4", "elbow6", "panda", "irb5400"])
def test_from_nearby_it_arrives(name: str) -> None:
    arm = kinseek.load(name)
    rng = np.random.default_rng(5)
    q = rng.uniform(arm.lower + 0.05, arm.upper - 0.05, (20, arm.dof))
    goal = kinseek.Goal.pose(arm.fk(q), position_tolerance=1e-3, orientation_tolerance=1e-3)
    solution = arm.ik(goal, near=q + rng.normal(0, 0.01, q.shape), solver=CoordinateDescent(most_sweeps=500))
    assert solution.success.mean() >= 0.9


def test_pairs_need_fewer_sweeps() -> None:
    arm = kinseek.load("elbow6")
    q = np.random.default_rng(6).uniform(arm.lower, arm.upper, (10, 6))
    goal = kinseek.Goal.pose(arm.fk(q))
    with_pairs = arm.ik(goal, near=q + 0.05, solver=CoordinateDescent(most_sweeps=20))
    alone = arm.ik(goal, near=q + 0.05, solver=CoordinateDescent(most_sweeps=20, pairs=False))
    assert with_pairs.weighted_error.mean() < alone.weighted_error.mean()
