"""Blind search: local by nature, never worse than its start, 3^n leaves a step."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import kinseek
from kinseek import BlindSearch
from kinseek.problem import Problem
from reference import fk, weighted_error


def test_one_step_takes_the_best_of_all_combinations() -> None:
    arm = kinseek.load("scara4")
    start, step = np.array([1.0, 2.0, 0.1, 3.0]), 0.05
    goal = kinseek.Goal.pose(arm.fk(start + np.array([0.3, -0.3, 0.2, 0.0])))
    neighbours = [start + step * np.array(signs) for signs in product((-1, 0, 1), repeat=4)]
    best = min(neighbours, key=lambda q: weighted_error(fk(arm.chain, q), goal))
    solution = arm.ik(goal, near=start, solver=BlindSearch(step=step, most_steps=1))
    np.testing.assert_allclose(solution.q, best, atol=1e-15)
    assert solution.evaluations == 1 + 3**4
    assert solution.nodes_expanded == 3 + 9 + 27 + 81


@pytest.mark.parametrize("name", ["planar2", "cylindrical3", "scara4", "elbow6", "irb5400"])
def test_from_nearby_it_arrives_and_from_afar_it_is_no_worse(name: str) -> None:
    arm = kinseek.load(name)
    rng = np.random.default_rng(0)
    q = rng.uniform(arm.lower, arm.upper, (10, arm.dof))
    goal = kinseek.Goal.pose(arm.fk(q), position_tolerance=1e-3, orientation_tolerance=1e-2)
    near = np.clip(q + rng.normal(0, 1e-3, q.shape), arm.lower, arm.upper)
    assert arm.ik(goal, near=near, solver=BlindSearch(step=1e-3)).success.mean() >= 0.9
    far = rng.uniform(arm.lower, arm.upper, q.shape)
    solution = arm.ik(goal, near=far, solver=BlindSearch())
    before = [weighted_error(fk(arm.chain, each), goal, T) for each, T in zip(far, goal.target, strict=True)]
    assert (solution.weighted_error <= np.array(before) + 1e-12).all()
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()


def test_a_full_turn_is_crossed_at_its_seam() -> None:
    arm = kinseek.load("planar2")
    goal = kinseek.Goal.pose(arm.fk([0.2, 1.0]), position_tolerance=1e-6, orientation_tolerance=1e-5)
    solution = arm.ik(goal, near=[2 * np.pi - 0.2, 1.0], solver=BlindSearch())
    assert solution.position_error < 1e-4
    np.testing.assert_allclose(solution.q, [0.2, 1.0], atol=1e-3)


@pytest.mark.parametrize("budget", [1, 81, 82, 200])
def test_a_budget_is_kept(budget: int) -> None:
    arm = kinseek.load("scara4")
    problem = Problem(arm.chain, kinseek.Goal.pose(arm.fk(arm.lower + 0.2)), budget=budget)
    assert BlindSearch().solve(problem).evaluations == 1 + (budget - 1) // 81 * 81
