"""What every search in `ALL_SOLVERS` promises, on arms of every kind. Being listed is being tested."""

from __future__ import annotations

import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import FrozenInstanceError, fields
from functools import cache
from itertools import product

import numpy as np
import pytest

import kinseek
from kinseek import (
    ALL_SOLVERS,
    Atlas,
    BlindSearch,
    BruteForce,
    CoordinateDescent,
    DivideAndConquer,
    Goal,
    Polished,
    Problem,
    SeparateChains,
    Solver,
)
from kinseek.errors import InvalidSolver
from kinseek.robots.chain import SerialChain
from kinseek.solvers.traits import OwnSolver
from reference import chordal_error, errors, fk, weighted_error

ARMS = ("planar2", "cylindrical3", "scara4", "elbow6", "panda", "irb5400", "fk of planar2", "fk of scara4")
"""Bundled arms, and two of which a search knows their function alone."""
SMALL: dict[type[Solver], Solver] = {
    BruteForce: BruteForce(branching_factor=4),
    BlindSearch: BlindSearch(most_steps=30),
    SeparateChains: SeparateChains(breadth=2),
}
"""Instead of the defaults, where those take too long on seven joints."""

FROM_ITS_START = {Atlas: weighted_error, BlindSearch: weighted_error, CoordinateDescent: chordal_error}
"""Searches that never end worse than where they start, by the error that they look at."""
WITHOUT_A_START = (BruteForce, DivideAndConquer, SeparateChains, Polished)
"""Searches that look everywhere, and find the same wherever one would start."""

NEEDS_AXES = tuple(cls for cls in ALL_SOLVERS if cls.traits.axes)
"""Searches that a function alone does not do for."""

CASES = [
    pytest.param(cls, name, id=f"{cls.__name__}-{name}")
    for cls in ALL_SOLVERS
    for name in ARMS
    if not (cls in NEEDS_AXES and name.startswith("fk of "))
]


def make(cls: type[Solver]) -> Solver:
    return SMALL.get(cls) or cls()


def chain_of(name: str) -> SerialChain:
    """The chain behind an arm, by which answers are judged."""
    return loaded(name.removeprefix("fk of ")).chain


@cache
def loaded(name: str) -> kinseek.Arm:
    return kinseek.load(name)


@cache
def arm_of(name: str) -> kinseek.Arm:
    arm = loaded(name.removeprefix("fk of "))
    if not name.startswith("fk of "):
        return arm
    return kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds=arm.chain.kinds)


def asked(name: str, kind: str = "pose", count: int = 3) -> tuple[kinseek.Arm, Problem]:
    arm = arm_of(name)
    q, near = np.random.default_rng(11).uniform(arm.lower, arm.upper, (2, count, arm.dof))
    T = arm.fk(q)
    goal = {
        "pose": Goal.pose(T, orientation_weight=0.5),
        "position": Goal.position(T[:, :3, 3]),
        "pointing": Goal.pointing(T[:, :3, 3], T[0, :3, 2], (0.0, 0.6, 0.8)),
    }[kind]
    return arm, Problem(arm.mechanism, goal, near)


@pytest.mark.slow
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
        T = fk(chain_of(name), q)
        position, orientation = errors(T, goal, target)
        assert solution.position_error[i] == pytest.approx(position, rel=1e-9, abs=1e-12)
        assert solution.orientation_error[i] == pytest.approx(orientation, rel=1e-7, abs=1e-8)
        assert solution.weighted_error[i] == pytest.approx(
            weighted_error(T, goal, target), rel=1e-9, abs=1e-12
        )
        met = solution.position_error[i] <= goal.position_tolerance
        assert solution.success[i] == (met and solution.orientation_error[i] <= goal.orientation_tolerance)


@pytest.mark.slow
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
    part = Problem(problem.mechanism, problem.goal.at(problem.goal.target[1:]), problem.near[1:])
    np.testing.assert_array_equal(first.q[1:], solver.solve(part).q)


@pytest.mark.parametrize("cls", NEEDS_AXES)
def test_a_search_that_needs_axes_says_so(cls: type[Solver]) -> None:
    _, problem = asked("fk of planar2")
    with pytest.raises(InvalidSolver, match="needs the axes and links"):
        make(cls).solve(problem)


@pytest.mark.parametrize("cls", ALL_SOLVERS)
def test_every_search_says_what_a_start_is_to_it(cls: type[Solver]) -> None:
    assert (cls in FROM_ITS_START) != (cls in WITHOUT_A_START)


@pytest.mark.slow
@pytest.mark.parametrize(("cls", "name"), [case for case in CASES if case.values[0] in FROM_ITS_START])
def test_never_worse_than_its_start(cls: type[Solver], name: str) -> None:
    """Where it starts at an answer, the tolerances are all that it may lose."""
    arm, problem = asked(name)
    chain, measure = chain_of(name), FROM_ITS_START[cls]
    assert problem.near is not None
    at_the_answer = np.random.default_rng(11).uniform(arm.lower, arm.upper, (2, 3, arm.dof))[0]
    for near, more in ((problem.near, 1e-12), (at_the_answer, 1.5e-6)):
        solution = make(cls).solve(Problem(problem.mechanism, problem.goal, near))
        for start, q, one in zip(near, solution.q, problem.each(), strict=True):
            assert measure(fk(chain, q), one.goal) <= measure(fk(chain, start), one.goal) + more


@pytest.mark.slow
@pytest.mark.parametrize(("cls", "name"), [case for case in CASES if case.values[0] in WITHOUT_A_START])
def test_the_same_wherever_it_would_start(cls: type[Solver], name: str) -> None:
    _, problem = asked(name)
    first = make(cls).solve(problem)
    again = make(cls).solve(Problem(problem.mechanism, problem.goal))
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.evaluations, again.evaluations)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_polishing_never_spoils_what_is_polished(name: str) -> None:
    _, problem = asked(name)
    rough, fine = Polished().search.solve(problem), Polished().solve(problem)
    assert (fine.success >= rough.success).all()
    assert ((fine.weighted_error <= rough.weighted_error) | fine.success).all()


@pytest.mark.slow
@pytest.mark.parametrize(("cls", "name"), CASES)
@pytest.mark.parametrize("budget", [1, 8, 100, 5000])
def test_a_budget_is_kept(cls: type[OwnSolver], name: str, budget: int) -> None:
    """In reach, at the edge of it and far beyond, from a start and without one, with ranges where a search takes them."""
    arm, problem = asked(name)
    T = problem.goal.target * np.ones((3, 1, 1))
    T[1, :3, 3] *= 1.3
    T[2, :3, 3] *= 20.0
    goals = [Goal.pose(T)]
    if cls.traits.ranges and isinstance(problem.mechanism, SerialChain):
        goals.append(Goal.pose(T, free=("x", "rz"), box={"y": (0.0, 0.1)}))
    for goal, near in product(goals, (None, problem.near)):
        solution = make(cls).solve(Problem(problem.mechanism, goal, near, budget))
        assert (solution.evaluations >= (cls is not Atlas)).all()  # It may return its start.
        assert (solution.evaluations <= budget).all()
        assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
        assert np.isfinite(solution.weighted_error).all()


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
