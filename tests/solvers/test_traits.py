"""What searches say of themselves is so, and what is said of them elsewhere is made of it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import ALL_SOLVERS, Goal, InvalidProblem, InvalidSolver, Problem, Solver
from kinseek.cli import main
from kinseek.cli.searches import searches, searches_in_words
from kinseek.solvers.traits import Near, OwnSolver, named, summary, table
from places import ROOT

Array = NDArray[np.float64]
SMALL: dict[str, Solver] = {
    "BruteForce": kinseek.BruteForce(4),
    "Polished": kinseek.Polished(kinseek.BruteForce(4), kinseek.CoordinateDescent(most_sweeps=2)),
    "BlindSearch": kinseek.BlindSearch(most_steps=5),
    "CoordinateDescent": kinseek.CoordinateDescent(most_sweeps=5),
}
every = pytest.mark.parametrize("cls", ALL_SOLVERS, ids=lambda cls: cls.__name__)


def make(cls: type[OwnSolver]) -> Solver:
    return SMALL.get(cls.__name__) or cls()


def arms() -> tuple[kinseek.Arm, kinseek.Arm]:
    arm = kinseek.load("scara4")
    return arm, kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper, kinds=arm.kinds, name="box")


@every
def test_a_search_needs_axes_if_and_only_if_it_says_so(cls: type[OwnSolver]) -> None:
    arm, box = arms()
    problem = Problem(box.mechanism, Goal.pose(arm.fk(arm.lower + 0.1)))
    if not cls.traits.axes:
        assert make(cls).solve(problem).q.shape == (arm.dof,)
        return
    with pytest.raises(
        InvalidSolver, match=f"{cls.__name__} needs the axes.*'box' has black-box kinematics"
    ) as caught:
        make(cls).solve(problem)
    for other in ALL_SOLVERS:
        assert (
            other.__name__ in str(caught.value).split("Searches that support it")[1]
        ) is not other.traits.axes


@every
def test_a_search_takes_ranges_if_and_only_if_it_says_so(cls: type[OwnSolver]) -> None:
    arm, _ = arms()
    problem = Problem(arm.mechanism, Goal.pose(arm.fk(arm.lower + 0.1), free="rz", box={"x": (-0.1, 0.1)}))
    if cls.traits.ranges:
        assert make(cls).solve(problem).success
        return
    with pytest.raises(InvalidProblem, match="does not support a goal with free axes") as caught:
        make(cls).solve(problem)
    taken = str(caught.value).split("Searches that support it")[1]
    assert [other.__name__ for other in ALL_SOLVERS if other.__name__ in taken] == named(lambda t: t.ranges)


@every
def test_a_search_needs_joints_that_turn_or_slide_if_and_only_if_it_says_so(cls: type[OwnSolver]) -> None:
    def crank(q: Array) -> Array:
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, 0, 3] = q[:, 0] ** 3
        return T

    problem = Problem(kinseek.Arm.from_fk(crank, [0.1], [2.0]).mechanism, Goal.position([1.0, 0.0, 0.0]))
    if cls.traits.axes or cls.traits.made_of:
        return
    if not cls.traits.plain_joints:
        assert make(cls).solve(problem).q.shape == (1,)
        return
    with pytest.raises(InvalidSolver, match="needs joints that turn") as caught:
        make(cls).solve(problem)
    for other in ALL_SOLVERS:
        works = other.__name__ in str(caught.value).split("Searches that support it")[1]
        assert works is not (other.traits.axes or other.traits.plain_joints)


@every
def test_near_is_to_a_search_what_it_says(cls: type[OwnSolver]) -> None:
    arm, _ = arms()
    goal = Goal.position(arm.fk(np.array([0.5, 0.7, 0.1, 0.0]))[:3, 3])
    starts = [0.4, 0.6, 0.05, 2.0], [0.4, 0.6, 0.05, 4.5]  # The last joint does not move the tip.
    first, second = (make(cls).solve(Problem(arm.mechanism, goal, np.array(near))).q for near in starts)
    assert np.array_equal(first, second) is (cls.traits.near is Near.TURN)
    if cls.traits.near is not Near.TURN:
        assert first[3] < 3.0 < second[3]


def test_the_documentation_has_the_table_that_is_made_of_the_traits() -> None:
    assert f"\n{table()}\n" in (ROOT / "docs" / "which_search.md").read_text()
    assert len(table().splitlines()) == len(ALL_SOLVERS) + 2


def test_help_tells_of_every_search_what_it_says_of_itself(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    said = searches_in_words()
    for name, cls in searches().items():
        assert f"{name}: {summary(cls)}" in said
        assert ("needs axes" in summary(cls)) is cls.traits.axes
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit):
        main(["solve", "--help"])
    shown = "".join(capfd.readouterr().out.replace("│", " ").split())
    assert "".join(said.split()) in shown
