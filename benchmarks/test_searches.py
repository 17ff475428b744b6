"""The paper's searches on the paper's arms: nodes a second, time of a solution, growth with the branching factor.

Compares kinseek with the targets in benchmarks/README.md, on one core, after the kernels are loaded.
Run: pytest benchmarks/test_searches.py --benchmark-only
"""

from __future__ import annotations

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import kinseek
from kinseek import BruteForce, DivideAndConquer, Polished, Solver


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


if __name__ == "__main__":
    from benchmarks.command import under_pytest

    under_pytest(__file__, __doc__)
