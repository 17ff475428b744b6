"""Divide and conquer against a literal Algorithm 1 and 2, counts against closed formulas, and the beam."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import random_poses, serial_chains
from kinseek import DivideAndConquer
from kinseek.errors import InvalidSolver
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solvers.divide_and_conquer import tuned_breadth
from kinseek.solvers.nodes import evenly_spaced_nodes, window_around
from reference import PaperSearch, fk, node_values, weighted_error


def agrees_with_the_paper(
    chain: SerialChain, goal: kinseek.Goal, size: int, divisions: int, breadth: list[int]
) -> None:
    plain = PaperSearch(chain, goal, size, divisions, breadth).solve()
    solver = DivideAndConquer(branching_factor=size, divisions=divisions, breadth=tuple(breadth))
    solution = solver.solve(Problem(chain, goal))
    assert plain.best_assignment is not None
    rows = [[node] for node in plain.best_assignment]
    q = np.array(node_values(chain, size, rows)).ravel()
    if not np.allclose(solution.q, q, atol=1e-12):  # A tie, which rounding may decide either way.
        assert solution.weighted_error == pytest.approx(plain.best_error, rel=1e-6, abs=1e-9)
        return
    assert solution.weighted_error == pytest.approx(plain.best_error, rel=1e-9, abs=1e-9)
    assert solution.nodes_expanded == plain.expanded


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "size", "divisions"),
    [
        *product(("planar2", "cylindrical3", "scara4"), (1, 3, 10, 7200), (3,)),
        *product(("planar2", "cylindrical3", "scara4"), (100,), (4,)),
        *product(("planar2", "cylindrical3"), (2,), (5,)),
        *product(("planar2", "cylindrical3", "scara4", "irb5400"), (50,), (2,)),
        *product(("scara4", "irb5400"), (9,), (3,)),
    ],
)
def test_agrees_with_the_papers_algorithms(name: str, size: int, divisions: int) -> None:
    arm = kinseek.load(name)
    dof, count = arm.dof, 1 if name == "irb5400" else 2
    for T in random_poses(arm, count):
        breadth = [1 + (i < 2 and dof < 5) for i in range(dof)]
        agrees_with_the_paper(arm.chain, kinseek.Goal.pose(T), size, divisions, breadth)


@pytest.mark.slow
@given(serial_chains(most=3), st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(2, 5))
@settings(max_examples=30)
def test_random_chains_agree_with_the_papers_algorithms(
    chain: SerialChain, seed: int, size: int, divisions: int
) -> None:
    rng = np.random.default_rng(seed)
    goal = kinseek.Goal.pose(fk(chain, rng.uniform(chain.lower, chain.upper)))
    agrees_with_the_paper(chain, goal, size, divisions, [int(b) for b in rng.integers(1, 3, chain.dof)])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "scara4", "elbow6", "irb5400"])
@pytest.mark.parametrize("breadth", [1, 2, "tuned"])
@pytest.mark.parametrize("beam", [1, 3])
def test_static_and_dynamic_trees_give_the_same_bits(name: str, breadth: int | str, beam: int) -> None:
    arm = kinseek.load(name)
    solver = DivideAndConquer(branching_factor=720, breadth=breadth, beam=beam, node_budget=500)
    Ts = random_poses(arm, 3)
    dynamic, static = arm.ik(Ts, solver=solver), arm.ik(Ts, solver=replace(solver, tree="static"))
    np.testing.assert_array_equal(dynamic.q, static.q)
    np.testing.assert_array_equal(dynamic.nodes_expanded, static.nodes_expanded)
    np.testing.assert_array_equal(static.nodes_created, 720 * arm.dof)
    np.testing.assert_array_equal(dynamic.nodes_created, dynamic.nodes_expanded)


@pytest.mark.parametrize(("divisions", "breadth"), [(3, 1), (3, 2), (4, 1), (5, 3), (2, 1)])
@pytest.mark.parametrize("size", [7200, 10**9])
def test_node_counts_are_the_closed_formulas(divisions: int, breadth: int, size: int) -> None:
    arm = kinseek.load("planar2")
    solver = DivideAndConquer(branching_factor=size, divisions=divisions, breadth=breadth)
    solution = arm.ik(random_poses(arm, 1)[0], solver=solver)
    spacing, passes = size // divisions, 0
    while spacing > 1:
        spacing, passes = max(spacing // divisions, 1), passes + 1
    later = 2 * (divisions // 2 + breadth) - 1
    assert solution.evaluations == divisions**2 + passes * later**2
    assert solution.nodes_expanded == divisions + divisions**2 + passes * (later + later**2)


def test_one_pass_over_everything_is_equation_1() -> None:
    arm = kinseek.load("scara4")
    T = random_poses(arm, 1)[0]
    solution = arm.ik(T, solver=DivideAndConquer(branching_factor=7, divisions=7))
    brute = arm.ik(T, solver=kinseek.BruteForce(branching_factor=7))
    assert solution.nodes_expanded == brute.nodes_expanded == 7 + 7**2 + 7**3 + 7**4
    assert brute.nodes_created == 4 * 7


def test_breadth_one_number_per_joint_or_tuned() -> None:
    arm = kinseek.load("scara4")
    T = random_poses(arm, 1)[0]
    constant = arm.ik(T, solver=DivideAndConquer(breadth=2))
    np.testing.assert_array_equal(constant.q, arm.ik(T, solver=DivideAndConquer(breadth=(2, 2, 2, 2))).q)
    tuned = DivideAndConquer(breadth="tuned", node_budget=1000)
    widths = tuned.breadths(Problem(arm.chain, kinseek.Goal.pose(T)))
    assert np.prod([2 * (1 + b) - 1 for b in widths]) <= 1000
    np.testing.assert_array_equal(
        arm.ik(T, solver=tuned).q, arm.ik(T, solver=replace(tuned, breadth=widths)).q
    )


@pytest.mark.slow
def test_tuned_breadth_follows_the_arm_and_the_weights() -> None:
    elbow = kinseek.load("elbow6").chain
    position = kinseek.Goal.position([0.0, 0.0, 0.0])
    for_position = tuned_breadth(elbow, position, 3, 2500)
    assert sum(for_position[:3]) > sum(for_position[3:])
    assert for_position[5] == 1  # The last axis goes through the tip.
    assert tuned_breadth(elbow, position, 3, 1) == (1,) * 6
    assert for_position != tuned_breadth(elbow, kinseek.Goal.pose(np.eye(4)), 3, 2500)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "budget"), [("cylindrical3", 130), ("scara4", 700), ("elbow6", 2500)])
def test_tuned_breadth_beats_constant_breadth_within_the_same_window(name: str, budget: int) -> None:
    arm = kinseek.load(name)
    constant = 1
    while (2 * (constant + 1) + 1) ** arm.dof <= budget:
        constant += 1
    Ts = random_poses(arm, 100, seed=1)
    tuned = arm.ik(Ts, solver=DivideAndConquer(breadth="tuned", node_budget=budget))
    plain = arm.ik(Ts, solver=DivideAndConquer(breadth=constant))
    assert tuned.weighted_error.mean() < 0.8 * plain.weighted_error.mean()


def test_dynamic_memory_does_not_grow_with_the_branching_factor() -> None:
    arm = kinseek.load("scara4")
    T = random_poses(arm, 1)[0]
    small = arm.ik(T, solver=DivideAndConquer(branching_factor=3))
    large = arm.ik(T, solver=DivideAndConquer(branching_factor=10**9, breadth=2))
    assert small.success is False
    assert large.nodes_created < 10**5
    with pytest.raises(InvalidSolver, match=r"4,000,000,000,000 nodes need .* GiB"):
        arm.ik(T, solver=DivideAndConquer(branching_factor=10**12, tree="static"))


@pytest.mark.parametrize("size", [1, 2, 3, 5, 2**62])
def test_extreme_branching_factors_answer(size: int) -> None:
    arm = kinseek.load("cylindrical3")
    solution = arm.ik(random_poses(arm, 1)[0], solver=DivideAndConquer(branching_factor=size, divisions=4))
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()


@given(st.integers(2, 200), st.integers(2, 6), st.integers(1, 3), st.data())
def test_windows_slide_at_limits_and_wrap_where_the_joint_does(
    size: int, divisions: int, breadth: int, data: st.DataObject
) -> None:
    count = 2 * (divisions // 2 + breadth) - 1
    spacing = data.draw(st.integers(1, max(size // divisions, 1)))
    offset = data.draw(st.sampled_from([Fraction(0), Fraction(1, 2), Fraction(0.3)]))
    first = evenly_spaced_nodes(size, min(divisions, size), offset)
    assert len(set(first.tolist())) == min(divisions, size)
    assert first.min() >= 0
    assert first.max() < size
    centre = [data.draw(st.integers(0, size - 1)) for _ in range(3)]
    wraps = (True, False, False)
    windows = window_around(wraps, size, centre, spacing, np.full(3, count), False)
    for nodes, middle, wrap in zip(windows, centre, wraps, strict=True):
        assert middle in nodes
        assert nodes.min() >= 0
        assert nodes.max() < size
        assert len(set(nodes.tolist())) == len(nodes)
        room = (size - 1 - middle % spacing) // spacing + 1
        if not wrap:  # As many as the paper's formula says, as long as the range has room for them.
            assert len(nodes) == min(count, room, (size - 1) // spacing + 1)


def test_wrapping_reaches_across_the_seam() -> None:
    arm = kinseek.load("planar2")
    T = arm.fk([2 * np.pi - 1e-3, 1.0])
    across = arm.ik(T, solver=DivideAndConquer(breadth=2))
    assert across.position_error < 1e-3
    walled = arm.ik(T, solver=DivideAndConquer(breadth=2, wrap=False))
    assert walled.position_error >= across.position_error


def test_a_beam_never_loses_to_its_own_first_cell() -> None:
    arm = kinseek.load("elbow6")
    Ts = random_poses(arm, 10)
    errors = [
        arm.ik(Ts, solver=DivideAndConquer(beam=beam, children=children)).weighted_error.mean()
        for beam, children in ((1, None), (8, None), (8, 2))
    ]
    assert errors[1] < errors[0]
    assert errors[2] < errors[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count"), [("planar2", 100), ("cylindrical3", 100), ("scara4", 30), ("elbow6", 30)]
)
def test_a_beam_reaches_a_millimetre(name: str, count: int) -> None:
    """The 1,000 targets of the elbow are in benchmarks/test_searches.py."""
    arm = kinseek.load(name)
    solver = DivideAndConquer(10**6, breadth="tuned", node_budget=5000, beam=64, children=2)
    solution = arm.ik(random_poses(arm, count, seed=2024), solver=solver)
    assert (solution.position_error < 1e-3).mean() >= 0.99


@pytest.mark.parametrize("budget", [1, 10, 82, 1000])
def test_a_budget_is_kept_and_the_best_so_far_counts(budget: int) -> None:
    arm = kinseek.load("scara4")
    T = random_poses(arm, 1)[0]
    solver = DivideAndConquer(beam=4)
    solution = solver.solve(Problem(arm.chain, kinseek.Goal.pose(T), budget=budget))
    assert solution.evaluations == budget
    assert solution.weighted_error == pytest.approx(
        weighted_error(fk(arm.chain, solution.q), kinseek.Goal.pose(T))
    )
    assert solution.nodes_expanded >= budget


def test_a_fraction_of_a_breadth_is_the_mean_over_the_later_passes() -> None:
    arm = kinseek.load("planar2")
    T = arm.fk([1.0, 2.0])
    solution = arm.ik(T, solver=DivideAndConquer(3**8, breadth=(2.5, 1.25)), trace=True)
    counts = np.array([each.counts for each in solution.trace[1:]])
    breadths = (counts + 1) / 2 - 1  # A window has 2(⌊3/2⌋ + Br) - 1 values.
    np.testing.assert_array_equal(breadths[:, 0], [3, 3, 3, 3, 2, 2, 2])
    np.testing.assert_array_equal(breadths[:, 1], [2, 2, 1, 1, 1, 1, 1])
    untraced = arm.ik(T, solver=DivideAndConquer(3**8, breadth=(2.5, 1.25)))
    for field in ("q", "evaluations", "nodes_expanded", "nodes_created"):
        np.testing.assert_array_equal(getattr(solution, field), getattr(untraced, field))
    assert untraced.evaluations == 9 + int(counts.prod(axis=1).sum())


def test_a_whole_breadth_is_the_same_in_every_way_to_write_it() -> None:
    assert (
        DivideAndConquer(breadth=2.0)
        == DivideAndConquer(breadth=np.float64(2))
        == DivideAndConquer(breadth=2)
    )
    assert repr(DivideAndConquer(breadth=(2.0, 3.5)).breadth) == "(2, 3.5)"


@pytest.mark.parametrize(
    "options", [{"beam": 3}, {"beam": 3, "children": 2}, {"tree": "static"}, {"ties": "first"}]
)
def test_a_fraction_lies_between_its_whole_breadths_with_every_option(options: dict[str, Any]) -> None:
    arm = kinseek.load("scara4")
    targets = random_poses(arm, 20)
    low, middle, high = (
        arm.ik(targets, solver=DivideAndConquer(720, breadth=b, **options)) for b in (1, 1.5, 2)
    )
    assert (low.evaluations < middle.evaluations).all()
    assert (middle.evaluations < high.evaluations).all()
    assert high.weighted_error.mean() <= middle.weighted_error.mean() < low.weighted_error.mean()


def test_a_fraction_on_a_function_visits_the_same_nodes() -> None:
    arm = kinseek.load("scara4")
    function = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds=arm.chain.kinds)
    T, solver = random_poses(arm, 1)[0], DivideAndConquer(720, breadth=1.5)
    ours, theirs = arm.ik(T, solver=solver), function.ik(T, solver=solver)
    np.testing.assert_allclose(ours.weighted_error, theirs.weighted_error, atol=1e-9)


def test_breadth_of_the_wrong_length_names_the_joints() -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidSolver, match=r"one number or 2, one per joint \(joint1, joint2\); got 3"):
        arm.ik(np.eye(4), solver=DivideAndConquer(breadth=(1, 2, 3)))


def test_a_breadth_is_any_kind_of_number() -> None:
    breadth: Any
    for breadth, kept in ((np.int64(2), 2), (np.float32(2.5), 2.5), (2.0, 2), ([np.int32(2), 3.0], (2, 3))):
        read = DivideAndConquer(breadth=breadth).breadth
        assert read == kept
        assert type(read) is type(kept)


@pytest.mark.parametrize("name", ["planar2", "cylindrical3", "scara4"])
@pytest.mark.parametrize(
    "options",
    [{"beam": 4}, {"beam": 4, "children": 2}, {"beam": 4, "children": 2, "stop_below": 0.3}, {"breadth": 2}],
)
@pytest.mark.parametrize("budget", [None, 300])
def test_a_function_is_searched_in_the_order_of_the_compiled_search(
    name: str, options: dict[str, Any], budget: int | None
) -> None:
    arm = kinseek.load(name)
    function = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds=arm.chain.kinds)
    goal, solver = kinseek.Goal.pose(random_poses(arm, 10)), DivideAndConquer(500, **options)
    ours = solver.solve(Problem(arm.chain, goal, budget=budget))
    # One pose of the budget of a function is for evaluating the solution.
    theirs = solver.solve(Problem(function.mechanism, goal, budget=budget and budget + 1))
    np.testing.assert_array_equal(ours.q, theirs.q)
    if "stop_below" not in options:  # A call of the function may go beyond the leaf that ends the search.
        np.testing.assert_array_equal(ours.evaluations + 1, theirs.evaluations)
        np.testing.assert_array_equal(ours.nodes_expanded, theirs.nodes_expanded)
