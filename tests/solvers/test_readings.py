"""What the paper leaves to the reader: each choice of `DivideAndConquer` against a plain program that chose the same."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import kinseek
from experiments import choices, claims
from experiments.judges import Results
from experiments.mirror import arm_with_lattice
from experiments.readings import Reading, errors_of, search
from kinseek import BlindSearch, BruteForce, DivideAndConquer, Goal
from kinseek.errors import InvalidSolver
from kinseek.problem import Problem
from kinseek.solvers import grid_search
from kinseek.solvers.breadth_tuning import Walk
from kinseek.solvers.nodes import evenly_spaced_nodes, joint_grid, tie_of, window_around
from reference import PaperSearch, node_values


def random_joints(arm: kinseek.Arm, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(arm.lower, arm.upper, (count, arm.dof))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["planar2", "cylindrical3"])
@pytest.mark.parametrize("first", ["D", "formula"])
@pytest.mark.parametrize(("ends", "wrap"), [("turns wrap", True), ("clip", False)])
@pytest.mark.parametrize(("divisions", "breadth"), [(3, 1), (3, 3), (4, 2)])
def test_the_letter_agrees_with_a_plain_program(
    name: str, first: str, ends: str, wrap: bool, divisions: int, breadth: int
) -> None:
    """Neither where joints begin nor where windows end is left to chance: B is a power of D and no spacing is rounded."""
    arm, size = kinseek.load(name), divisions**7
    goals = arm.fk(random_joints(arm, 40))
    q = search(arm, goals, Reading(first=first, ends=ends), size, divisions, breadth)
    solver = DivideAndConquer(
        size, divisions, breadth, limited="letter", first=first, wrap=wrap, ties="first"
    )
    solution = arm.ik(goals, solver=solver)
    position, turn = errors_of(arm, q, goals)
    same = np.abs(solution.q - q).max(axis=1) < 1e-9
    # The plain program lets rounding decide between leaves that are equally good.
    assert same.mean() > 0.8
    np.testing.assert_allclose(solution.weighted_error[same], (position + turn)[same], rtol=1e-9, atol=1e-9)
    plain = arm.ik(goals, solver=DivideAndConquer(size, divisions, breadth))
    if name == "cylindrical3" or not wrap:
        assert not np.allclose(plain.q, solution.q)


def test_no_choice_is_what_it_was() -> None:
    arm = kinseek.load("cylindrical3")  # One joint turns fully, two have limits.
    goals = arm.fk(random_joints(arm, 20))
    chosen = DivideAndConquer(720, offset=(0.0, 0.5, 0.5), first="D", limited="middles", ties="rounding")
    plain, same = (arm.ik(goals, solver=each) for each in (DivideAndConquer(720), chosen))
    for field in ("q", "weighted_error", "nodes_expanded", "evaluations"):
        np.testing.assert_array_equal(getattr(plain, field), getattr(same, field))
    others: tuple[dict[str, Any], ...] = (
        {"offset": 0.25},
        {"limited": "letter"},
        {"first": "formula", "breadth": 2},
    )
    for one in others:
        other = arm.ik(goals, solver=DivideAndConquer(720, **one))
        assert not np.array_equal(plain.q, other.q), one


@pytest.mark.parametrize("divisions", [4, 5])
def test_a_turned_lattice_is_that_of_an_arm_whose_joint_begins_elsewhere(divisions: int) -> None:
    size = divisions**5
    plain, turned = arm_with_lattice(0.0), arm_with_lattice(np.pi / divisions)
    goals = Goal.pose(plain.fk(random_joints(plain, 50)), position_weight=20.0)
    if size % (2 * divisions):
        size *= 2 * divisions  # Half a cell has to be a whole number of nodes.
    solver = DivideAndConquer(size, divisions, 3, offset=(0.0, 0.5), ties="first")
    ours = plain.ik(goals, solver=solver)
    theirs = turned.ik(goals, solver=DivideAndConquer(size, divisions, 3, ties="first"))
    np.testing.assert_allclose(ours.weighted_error, theirs.weighted_error, rtol=1e-9, atol=1e-11)
    assert not np.allclose(
        ours.weighted_error, plain.ik(goals, solver=DivideAndConquer(size, divisions, 3)).weighted_error
    )


def test_half_a_cell_at_the_elbow_ends_the_spike_at_four() -> None:
    """Orientation weighs little, D is 4 and Br is 4: question 6 of docs/paper_questions.md."""
    arm = kinseek.load("planar2")
    goal = Goal.pose(arm.fk(random_joints(arm, 400)), position_weight=20.0)
    spike, turned, reach = (
        arm.ik(goal, solver=solver).position_error.mean()
        for solver in (
            DivideAndConquer(7200, 4, 4),
            DivideAndConquer(7200, 4, 4, offset=(0.0, 0.5)),
            DivideAndConquer(7200, 4, "reach"),
        )
    )
    assert spike > 2e-3
    assert turned < 0.3 * spike
    assert reach < 0.3 * spike


@pytest.mark.parametrize("size", [1, 2, 7, 7200, 2**62])
@pytest.mark.parametrize("offset", [0.0, 0.3, 0.5, 1 - 2**-53])
def test_every_cell_has_one_node(size: int, offset: float) -> None:
    for divisions in (1, 2, 3, 7):
        count = min(divisions, size)
        nodes = evenly_spaced_nodes(size, count, Fraction(offset)).tolist()
        exact = [(i + Fraction(offset)) * size / count for i in range(count)]
        assert nodes == [number.numerator // number.denominator for number in exact]
        assert nodes[0] >= 0
        assert nodes[-1] < size
        assert all(a < b for a, b in pairwise(nodes))


def test_an_offset_for_another_number_of_joints_is_refused() -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidSolver, match="offset must be one number or 2, one per joint; got 3"):
        arm.ik(np.eye(4), solver=DivideAndConquer(offset=(0.1, 0.2, 0.3)))


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"beam": 6}, {"beam": 6, "children": 2, "divisions": 2}])
@pytest.mark.parametrize("part", [1, 50, 1 << 22])
def test_a_stop_ends_the_search_at_the_first_good_leaf(
    options: dict[str, Any], part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grid_search, "PART", part)
    arm = kinseek.load("scara4")
    goals = arm.fk(random_joints(arm, 20))
    whole = arm.ik(goals, solver=DivideAndConquer(breadth=2, **options))
    some = arm.ik(goals, solver=DivideAndConquer(breadth=2, stop_below=0.1, **options))
    good = whole.weighted_error < 0.1
    assert good.any()
    assert (some.weighted_error[good] < 0.1).all()
    assert (some.evaluations[good] < whole.evaluations[good]).all()
    assert (some.nodes_expanded[good] < whole.nodes_expanded[good]).all()
    np.testing.assert_array_equal(some.q[~good], whole.q[~good])
    for one, leaves in zip(goals[good], some.evaluations[good], strict=True):
        # With one leaf less it is not there yet, and with as many it is.
        before, there = (
            DivideAndConquer(breadth=2, **options).solve(Problem(arm.chain, Goal.pose(one), budget=int(n)))
            for n in (leaves - 1, leaves)
        )
        assert before.weighted_error >= 0.1
        assert there.weighted_error < 0.1


def test_a_stop_in_a_search_of_one_pass_is_that_of_brute_force() -> None:
    arm = kinseek.load("scara4")
    goals = arm.fk(random_joints(arm, 20))
    one_pass = arm.ik(goals, solver=DivideAndConquer(6, 6, stop_below=0.8, offset=0.0, limited="middles"))
    grid = joint_grid(arm.chain, 6)
    assert not grid.wraps.all()
    brute = arm.ik(goals, solver=BruteForce(6, stop_below=0.8))
    for field in ("q", "evaluations", "nodes_expanded"):
        np.testing.assert_array_equal(getattr(one_pass, field), getattr(brute, field))
    assert (brute.evaluations < 6**4).any()


@pytest.mark.slow
@pytest.mark.parametrize(("size", "divisions"), [(9, 3), (3, 3), (8, 2)])
def test_the_elbow_agrees_with_the_papers_algorithms_once_ties_have_a_rule(size: int, divisions: int) -> None:
    """Its wrist makes many leaves equally good; rounding decides otherwise in the two programs."""
    arm = kinseek.load("elbow6")
    box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds="revolute")
    for number, T in enumerate(arm.fk(random_joints(arm, 3, seed=[size, divisions]))):  # type: ignore[arg-type]
        problem = Problem(arm.chain, Goal.pose(T))
        tie = tie_of(problem, "first")
        plain = PaperSearch(arm.chain, problem.goal, size, divisions, [1] * 6, tie=tie).solve()
        assert plain.best_assignment is not None
        q = np.ravel(node_values(arm.chain, size, [[node] for node in plain.best_assignment]))
        for chain in (arm, box) if number == 0 else (arm,):
            solution = chain.ik(T, solver=DivideAndConquer(size, divisions, ties="first"))
            np.testing.assert_allclose(solution.q, q, atol=1e-12)
            assert solution.nodes_expanded == plain.expanded


def test_of_equal_leaves_the_first_is_taken_whatever_rounding_says() -> None:
    """The goal is as far from two nodes: exactly, but not in the last bits."""
    arm = kinseek.Arm.from_dh([[0.3, 0, 0, 0], [0.2, 0, 0, 0]], [-np.pi] * 2, [np.pi] * 2)
    for solver in (BruteForce(12, ties="first"), DivideAndConquer(12, 12, ties="first")):
        for i in range(12):
            between = arm.fk([2 * np.pi * (i + 0.5) / 12 - np.pi, 0.0])
            q = arm.ik(Goal.position(between[:3, 3]), solver=solver).q
            nodes = np.rint((q + np.pi) / (2 * np.pi / 12)).astype(int) % 12
            everything = arm.fk(
                np.stack(np.meshgrid(*[np.arange(12) * np.pi / 6 - np.pi] * 2, indexing="ij"), -1)
            )
            errors = np.linalg.norm(everything[..., :3, 3] - between[:3, 3], axis=-1)
            first = np.argmax(errors.ravel() <= errors.min() + 1e-13)
            assert np.ravel_multi_index(tuple(nodes), (12, 12)) == first, (solver, i)


KINDS = {
    "turns": (True, False, Fraction(0)),
    "middles": (False, False, Fraction(1, 2)),
    "a third in": (False, False, Fraction(1, 3)),
    "letter": (False, True, Fraction(0)),
    "letter, middles": (False, True, Fraction(1, 2)),
}
"""Does the joint wrap, do windows end at a limit, and where in a cell are the first nodes?"""


def passes_of(size: int, divisions: int) -> list[int]:
    spacings = [max(size // divisions, 1)]
    while spacings[-1] > 1:
        spacings.append(max(spacings[-1] // divisions, 1))
    return spacings


def walk_of(size: int, divisions: int, kind: str) -> Walk:
    wraps, clips, offset = KINDS[kind]
    first = evenly_spaced_nodes(size, min(divisions, size), offset)
    return Walk(passes_of(size, divisions)[1:], size, wraps, clips, first)


def arrives_everywhere(walk: Walk, divisions: int, breadth: int) -> bool:
    """Walk from every first node into every window node, pass after pass: is every node of the grid arrived at?"""
    counts = np.array([2 * (divisions // 2 + breadth) - 1])
    for first in walk.first.tolist():
        at = {first}
        for spacing in walk.spacings:
            windows = (
                window_around([walk.wraps], walk.size, [node], spacing, counts, walk.clips)[0] for node in at
            )
            at = {node for window in windows for node in window.tolist()}
        if len(at) < walk.size:
            return False
    return True


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("divisions", [2, 3, 4, 5, 7])
def test_the_breadth_to_reach_arrives_at_every_node_and_one_less_does_not(divisions: int, kind: str) -> None:
    sizes = {*range(divisions, 40, 3), divisions**2, divisions**3 if divisions < 5 else 60}
    tried = 0
    for size in sorted(sizes):
        walk = walk_of(size, divisions, kind)
        breadth = walk.breadth(divisions)
        if walk.spacings:
            assert arrives_everywhere(walk, divisions, breadth), (size, breadth)
            assert breadth == 1 or not arrives_everywhere(walk, divisions, breadth - 1), (size, breadth)
            tried += breadth > 1
    assert tried > 3


@pytest.mark.parametrize(
    ("divisions", "turns", "middles", "letter"),
    [(2, 2, 2, 3), (3, 4, 4, 7), (4, 6, 6, 12), (5, 10, 10, 20), (6, 14, 15, 29)],
)
@pytest.mark.parametrize("power", [0, 8])
def test_breadths_that_reach(divisions: int, turns: int, middles: int, letter: int, power: int) -> None:
    """On a grid of powers of D and on the paper's the same: the series of spacings ends at one."""
    size = divisions**power if power else 7200
    assert walk_of(size, divisions, "turns").breadth(divisions) == turns
    assert walk_of(size, divisions, "middles").breadth(divisions) == middles
    assert walk_of(size, divisions, "letter").breadth(divisions) == letter


def test_the_largest_grid_has_a_breadth_to_reach() -> None:
    for kind in KINDS:
        assert walk_of(2**62, 3, kind).breadth(3) in (3, 4, 5, 6, 7)


def test_reach_is_a_breadth_a_joint_and_less_is_noted() -> None:
    arm = kinseek.load("cylindrical3")
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    assert DivideAndConquer(breadth="reach").breadths(problem) == (4, 4, 4)
    assert DivideAndConquer(breadth="reach", wrap=False).breadths(problem) == (4, 4, 4)
    assert DivideAndConquer(breadth="reach", limited="letter").breadths(problem) == (4, 7, 7)
    assert DivideAndConquer(breadth="reach").reach_notes(problem) == ()
    assert DivideAndConquer(breadth=4).reach_notes(problem) == ()
    notes = DivideAndConquer(breadth=(4, 4, 3)).reach_notes(problem)
    assert len(notes) == 1
    assert notes[0].startswith(f"{arm.chain.joint_names[2]}: ")
    assert "a breadth of 3" in notes[0]
    assert "4 can" in notes[0]
    same = [
        arm.ik(arm.fk([1.0, 0.1, 0.5]), solver=DivideAndConquer(breadth=b)).q for b in ("reach", (4, 4, 4))
    ]
    np.testing.assert_array_equal(same[0], same[1])


def test_fixed_changes_end_where_none_helps() -> None:
    arm = kinseek.load("scara4")
    q = random_joints(arm, 10)
    near = q + 0.03
    fixed = arm.ik(arm.fk(q), near=near, solver=BlindSearch(step=0.01, shrink=None))
    stopped = arm.ik(arm.fk(q), near=near, solver=BlindSearch(step=0.01, smallest_step=0.01))
    for field in ("q", "evaluations", "weighted_error"):
        np.testing.assert_array_equal(getattr(fixed, field), getattr(stopped, field))
    shrinking = arm.ik(arm.fk(q), near=near, solver=BlindSearch(step=0.01))
    assert (shrinking.weighted_error <= fixed.weighted_error).all()
    assert (shrinking.weighted_error < 0.01 * fixed.weighted_error).any()
    tiny = arm.ik(arm.fk(q[0]), near=near[0], solver=BlindSearch(step=1e-10, shrink=None, most_steps=5))
    assert tiny.evaluations > 3**4
    moved = (fixed.q - np.clip(near, arm.lower, arm.upper)) / 0.01
    inside = (
        (fixed.q > arm.lower + 0.01) & (fixed.q < arm.upper - 0.01) & (near > arm.lower) & (near < arm.upper)
    )
    np.testing.assert_allclose(moved[inside], np.rint(moved[inside]), atol=1e-6)


def test_the_page_tells_what_was_measured() -> None:
    """The sentences below the tables of the pages about the paper hold."""
    rows = Results(claims.ROOT / "experiments" / "results")("choices")

    def error(choice: str, dof: int, breadth: int, divisions: int = 3, weight: float = 1.0) -> float:
        (row,) = [
            row
            for row in rows
            if (row["choice"], row["dof"], row["divisions"], row["position_weight"])
            == (choice, dof, divisions, weight)
            and row["breadth"] == breadth
        ]
        return float(row["position_mean_mm"])

    built, limit = error("as built", 3, 3), error("first node at the lower limit", 3, 3)
    letter = error("limited joints to the letter", 3, 3)
    assert 3.5 < limit / built < 4.5
    assert 1.7 < letter / limit < 2.1
    assert error("as built", 4, 3) == pytest.approx(error("limited joints to the letter", 4, 3), rel=0.01)
    turned = "all lattices half a cell on"
    assert error(turned, 2, 2) > 2 * error("as built", 2, 2)
    assert error(turned, 4, 3) < error("as built", 4, 3) / 2
    for breadth in (1, 2):
        assert 0.7 < error("the wrist's half a cell on", 6, breadth) / error("as built", 6, breadth) < 1
    assert error("no wrap, letter, formula", 2, 1) > 100
    heavy = choices.HEAVY
    assert error("as built", 2, 4, 4, heavy) > 5 * error("the elbow's half a cell on", 2, 4, 4, heavy)
    assert error("as built", 2, 4, 4, heavy) > 5 * error(choices.REACH, 2, 6, 4, heavy)
    assert (
        error(choices.REACH, 2, 4, 3, heavy)
        == error("as built", 2, 4, 3, heavy)
        == pytest.approx(0.77, abs=0.005)
    )
    assert max(error(choices.REACH, 2, b, d, heavy) for d, b in ((5, 10), (6, 14))) < 0.1
    work = {
        (row["choice"], row["dof"], row["breadth"]): row["evaluations_mean"]
        for row in rows
        if row["divisions"] == 3
    }
    for threshold, low, high in (("0.01", 0.3, 0.61), ("0.001", 0.1, 0.34)):
        for dof in (2, 3, 4, 6):
            for breadth in (2, 3):
                whole, some = (
                    work[choice, dof, breadth] for choice in ("as built", f"stop below {threshold}")
                )
                assert low < 1 - float(some) / float(whole) < high, (threshold, dof, breadth)
