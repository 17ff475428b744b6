"""The paper's searches on the paper's arms: nodes a second, time of a solution, growth with the branching factor, errors.

Compares kinseek with the targets in benchmarks/README.md, on one core, after the kernels are loaded. The last two tests
print errors: how many random reachable targets the beam reaches within 1 mm; and of tuned and constant breadth with the same
budget of leaves in a window (the paper's BT and CB).
Run: pytest benchmarks/test_searches.py --benchmark-only -s
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import kinseek
from kinseek import BruteForce, DivideAndConquer, Goal, Polished, Problem, Solver

BEAM = DivideAndConquer(10**6, breadth="tuned", node_budget=5000, beam=64, children=2)
BREADTHS = {"planar2": (1, 2, 3, 5), "cylindrical3": (1, 2, 3), "scara4": (1, 2, 3), "elbow6": (1, 2)}


def run(benchmark: BenchmarkFixture, name: str, solver: Solver) -> kinseek.Solution:
    arm = kinseek.load(name)
    T = arm.fk(np.random.default_rng(1).uniform(arm.lower, arm.upper))
    solution = arm.ik(T, solver=solver)
    benchmark(arm.ik, T, solver=solver)
    nodes = solution.nodes_expanded
    benchmark.extra_info["nodes_expanded"] = nodes
    if benchmark.stats is not None:
        benchmark.extra_info["nodes_per_second"] = nodes / benchmark.stats.stats.median
    return solution


def test_grid_search_of_the_elbow(benchmark: BenchmarkFixture) -> None:
    assert run(benchmark, "elbow6", BruteForce(branching_factor=14)).nodes_expanded == 8_108_730


def test_brute_force_of_the_scara(benchmark: BenchmarkFixture) -> None:
    assert run(benchmark, "scara4", BruteForce(branching_factor=60)).nodes_expanded == 13_179_660


@pytest.mark.parametrize("breadth", [1, 2, 3])
def test_constant_breadth_on_the_elbow(benchmark: BenchmarkFixture, breadth: int) -> None:
    run(benchmark, "elbow6", DivideAndConquer(branching_factor=7200, divisions=3, breadth=breadth))


@pytest.mark.parametrize("size", [7_200, 1_000_000, 34_000_000_000])
def test_growth_with_the_branching_factor(benchmark: BenchmarkFixture, size: int) -> None:
    run(benchmark, "elbow6", DivideAndConquer(branching_factor=size, divisions=3, breadth=2))


@pytest.mark.parametrize("name", ["planar2", "cylindrical3", "scara4", "elbow6", "panda"])
def test_beam_and_coordinate_descent(benchmark: BenchmarkFixture, name: str) -> None:
    run(benchmark, name, Polished())


@pytest.mark.parametrize("name", BREADTHS)
def test_reach_of_the_beam(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    targets = arm.fk(np.random.default_rng(2024).uniform(arm.lower, arm.upper, (1000, arm.dof)))
    arm.ik(targets[0], solver=BEAM)  # Compiles and tunes.
    error = benchmark.pedantic(arm.ik, (targets,), {"solver": BEAM}, rounds=1).position_error
    within = f"{(error < 1e-3).mean():.1%} within 1 mm"
    print(f"\n{name}: {within}, mean {1e3 * error.mean():.4f} mm, worst {1e3 * error.max():.3f} mm")


@pytest.mark.parametrize(("name", "breadth"), [(name, b) for name, each in BREADTHS.items() for b in each])
def test_tuned_against_constant_breadth(benchmark: Any, name: str, breadth: int) -> None:
    arm = kinseek.load(name)
    targets = arm.fk(np.random.default_rng(99).uniform(arm.lower, arm.upper, (500, arm.dof)))
    leaves = (2 * (1 + breadth) - 1) ** arm.dof
    tuned = DivideAndConquer(breadth="tuned", node_budget=max(leaves, 3**arm.dof + 1))
    benchmark.pedantic(arm.ik, (targets,), {"solver": tuned}, rounds=1)
    for solver in (DivideAndConquer(breadth=breadth), tuned):
        shown, solution = (
            solver.breadths(Problem(arm.chain, Goal.pose(targets[0]))),
            arm.ik(targets, solver=solver),
        )
        mean, nodes = 1e3 * solution.position_error.mean(), solution.nodes_expanded.mean()
        print(f"\n{name}, {leaves} leaves, breadth {shown}: mean {mean:.3f} mm, {nodes:,.0f} nodes")
