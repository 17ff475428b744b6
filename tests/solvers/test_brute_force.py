"""Brute force: the best node of the whole grid, its counts, its orders, its stop, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

import kinseek
from experiments.arms import equation_1
from kinseek import BruteForce
from kinseek.errors import InvalidSolver
from kinseek.problem import Problem
from reference import exhaustive

ORDERS = ["paper", "low-discrepancy", "random"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size"), [("planar2", 30), ("cylindrical3", 9), ("scara4", 5), ("irb5400", 3)]
)
@pytest.mark.parametrize("order", ORDERS)
def test_finds_the_best_node_of_the_grid(name: str, size: int, order: str) -> None:
    arm = kinseek.load(name)
    goal = kinseek.Goal.pose(arm.fk(np.random.default_rng(7).uniform(arm.lower, arm.upper)))
    plain = exhaustive(arm.chain, goal, size, [list(range(size))] * arm.dof)
    solution = arm.ik(goal, solver=BruteForce(branching_factor=size, order=order))
    assert solution.weighted_error == pytest.approx(plain.error, rel=1e-9)
    np.testing.assert_allclose(solution.q, plain.q, atol=1e-12)
    assert solution.evaluations == size**arm.dof
    assert solution.nodes_expanded == plain.expanded == equation_1(size, arm.dof)
    assert solution.nodes_created == size * arm.dof


@pytest.mark.parametrize("order", ORDERS)
def test_stops_below_an_error(order: str) -> None:
    arm = kinseek.load("scara4")
    goal = kinseek.Goal.pose(arm.fk([4.0, 5.0, 0.2, 1.0]))
    everything = arm.ik(goal, solver=BruteForce(branching_factor=20, order=order))
    stopped = arm.ik(goal, solver=BruteForce(branching_factor=20, order=order, stop_below=0.4))
    assert everything.weighted_error <= stopped.weighted_error < 0.4
    assert stopped.evaluations < everything.evaluations
    assert stopped.nodes_expanded < everything.nodes_expanded


def test_other_orders_stop_sooner_on_average() -> None:
    arm = kinseek.load("scara4")
    Ts = arm.fk(np.random.default_rng(8).uniform(arm.lower, arm.upper, (20, 4)))
    work = {
        order: arm.ik(
            Ts, solver=BruteForce(branching_factor=20, order=order, stop_below=0.3)
        ).evaluations.mean()
        for order in ORDERS
    }
    assert work["low-discrepancy"] < work["paper"]
    assert work["random"] < work["paper"]


def test_orders_are_fixed() -> None:
    arm = kinseek.load("scara4")
    T = arm.fk(arm.lower + 0.2)
    solve = [
        arm.ik(
            T, solver=BruteForce(branching_factor=12, order="random", seed=seed, stop_below=0.5)
        ).evaluations
        for seed in (0, 0, 1)
    ]
    assert solve[0] == solve[1] != solve[2]


@pytest.mark.parametrize("budget", [1, 100, 4**4 - 1, 4**4, 10**6])
def test_a_budget_is_kept(budget: int) -> None:
    arm = kinseek.load("scara4")
    problem = Problem(arm.chain, kinseek.Goal.pose(arm.fk(arm.lower + 0.2)), budget=budget)
    assert BruteForce(branching_factor=4).solve(problem).evaluations == min(budget, 4**4)


def test_one_node_a_joint() -> None:
    arm = kinseek.load("cylindrical3")
    solution = arm.ik(np.eye(4), solver=BruteForce(branching_factor=1))
    np.testing.assert_array_equal(solution.q, arm.lower)
    assert solution.nodes_expanded == 3


def test_too_much_memory_is_said_before_it_is_tried() -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidSolver, match=r"2,000,000,000,000 nodes need .* GiB, this machine has"):
        arm.ik(np.eye(4), solver=BruteForce(branching_factor=10**12))


def test_more_leaves_than_64_bits_can_count() -> None:
    arm = kinseek.load("elbow6")
    with pytest.raises(InvalidSolver, match=r"7200\^6 leaves cannot be counted in 64 bits"):
        arm.ik(np.eye(4), solver=BruteForce(branching_factor=7200))
