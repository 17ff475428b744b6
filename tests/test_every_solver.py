"""What every search in `ALL_SOLVERS` promises, on arms of every kind. Being listed is being tested."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

import kinseek
from kinseek import ALL_SOLVERS, BlindSearch, BruteForce, CoordinateDescent, Goal, Problem, Solver
from reference import chordal_error, errors, fk, weighted_error

ARMS = ("planar2", "cylindrical3", "scara4", "elbow6", "panda", "irb5400")
SMALL: dict[type[Solver], Solver] = {
    BruteForce: BruteForce(branching_factor=4),
    BlindSearch: BlindSearch(most_steps=30),
}
"""Instead of the defaults, where those take too long on seven joints."""
CASES = [pytest.param(cls, name, id=f"{cls.__name__}-{name}") for cls in ALL_SOLVERS for name in ARMS]


def make(cls: type[Solver]) -> Solver:
    return SMALL.get(cls) or cls()


def asked(name: str, kind: str = "pose", count: int = 3) -> tuple[kinseek.Arm, Problem]:
    arm = kinseek.load(name)
    q, near = np.random.default_rng(11).uniform(arm.lower, arm.upper, (2, count, arm.dof))
    T = arm.fk(q)
    goal = {
        "pose": Goal.pose(T, orientation_weight=0.5),
        "position": Goal.position(T[:, :3, 3]),
        "pointing": Goal.pointing(T[:, :3, 3], T[0, :3, 2], (0.0, 0.6, 0.8)),
    }[kind]
    return arm, Problem(arm.chain, goal, near)


@pytest.mark.parametrize(("cls", "name"), CASES)
@pytest.mark.parametrize("kind", ["pose", "position", "pointing"])
def test_errors_are_those_of_plain_fk_and_limits_are_kept(cls: type[Solver], name: str, kind: str) -> None:
    arm, problem = asked(name, kind)
    solution = make(cls).solve(problem)
    assert solution.problem is problem
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert (solution.evaluations > 0).all()
    goal = problem.goal
    for i, (q, target) in enumerate(zip(solution.q, goal.target, strict=True)):
        T = fk(arm.chain, q)
        position, orientation = errors(T, goal, target)
        assert solution.position_error[i] == pytest.approx(position, rel=1e-9, abs=1e-12)
        assert solution.orientation_error[i] == pytest.approx(orientation, rel=1e-7, abs=1e-8)
        assert solution.weighted_error[i] == pytest.approx(
            weighted_error(T, goal, target), rel=1e-9, abs=1e-12
        )
        met = solution.position_error[i] <= goal.position_tolerance
        assert solution.success[i] == (met and solution.orientation_error[i] <= goal.orientation_tolerance)


@pytest.mark.parametrize(("cls", "name"), CASES)
def test_same_bits_twice_from_two_threads_and_in_any_batch(cls: type[Solver], name: str) -> None:
    _, problem = asked(name)
    solver = make(cls)
    first = solver.solve(problem)
    with ThreadPoolExecutor(2) as pool:
        others = list(pool.map(solver.solve, [problem, problem]))
    for other in others:
        np.testing.assert_array_equal(first.q, other.q)
        np.testing.assert_array_equal(first.evaluations, other.evaluations)
    assert problem.near is not None
    part = Problem(problem.chain, problem.goal.at(problem.goal.target[1:]), problem.near[1:])
    np.testing.assert_array_equal(first.q[1:], solver.solve(part).q)


@pytest.mark.parametrize(("cls", "name"), CASES)
def test_never_worse_than_its_start(cls: type[Solver], name: str) -> None:
    """By the measure it minimises; a search without a start has only to answer."""
    arm, problem = asked(name)
    solution = make(cls).solve(problem)
    if cls not in (BlindSearch, CoordinateDescent):
        assert np.isfinite(solution.weighted_error).all()
        return
    assert problem.near is not None
    for start, q, one in zip(problem.near, solution.q, problem.each(), strict=True):
        measure = weighted_error if cls is BlindSearch else chordal_error
        assert measure(fk(arm.chain, q), one.goal) <= measure(fk(arm.chain, start), one.goal) + 1e-12


@pytest.mark.parametrize(("cls", "name"), CASES)
@pytest.mark.parametrize("budget", [1, 100, 5000])
def test_a_budget_is_kept(cls: type[Solver], name: str, budget: int) -> None:
    arm, problem = asked(name, count=1)
    solution = make(cls).solve(Problem(problem.chain, problem.goal, problem.near, budget))
    assert (solution.evaluations <= budget).all()
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()


@pytest.mark.parametrize("cls", ALL_SOLVERS)
def test_a_solver_is_a_frozen_value(cls: type[Solver]) -> None:
    solver = make(cls)
    again = pickle.loads(pickle.dumps(solver))
    assert again == solver
    assert hash(again) == hash(solver)
    assert repr(solver).startswith(cls.__name__)
    for field in fields(cls):  # type: ignore[arg-type]
        with pytest.raises(FrozenInstanceError):
            setattr(solver, field.name, 1)
