"""What is given in the wrong place is named, with what was expected there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot, InvalidSolver
from kinseek.robots import read


class Model:
    """Stands for the model of another library."""


Model.__module__ = "pinocchio.pinocchio_pywrap"
T = np.eye(4)


@pytest.mark.parametrize(
    ("source", "said"),
    [
        (None, "got NoneType"),
        (7, "got int"),
        (b"panda", "got bytes"),
        (["panda"], "got list"),
        (Model(), r"got pinocchio.pinocchio_pywrap.Model; give the file that it was read from"),
        (Path, "got type"),
    ],
)
def test_load_takes_names_and_paths(source: Any, said: str) -> None:
    with pytest.raises(InvalidRobot, match=f"source must be the name of a bundled arm, a path.*{said}"):
        kinseek.load(source)


def test_load_of_an_arm() -> None:
    with pytest.raises(InvalidRobot, match="it is an arm already"):
        kinseek.load(kinseek.load("planar2"))


def test_an_empty_model_of_pinocchio() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    with pytest.raises(InvalidRobot, match="the pinocchio model has no joints"):
        kinseek.load(pinocchio.Model())


@pytest.mark.parametrize("name", ["base", "tip"])
def test_links_are_named(name: str) -> None:
    with pytest.raises(InvalidRobot, match=f"{name} must be the name of a link, got 3"):
        kinseek.load("planar2", **{name: 3})  # type: ignore[arg-type]


@pytest.mark.parametrize("path", ["", "~nobody-is-called-so/r.urdf", "a\0b.urdf", "x" * 5000 + ".urdf"])
def test_odd_paths(path: str) -> None:
    with pytest.raises(InvalidRobot):
        read(path)


@pytest.mark.parametrize(
    ("chain", "said"),
    [
        ("panda", r"write kinseek.load\('panda'\)"),
        (Path("r.urdf"), "kinseek.load"),
        (None, "NoneType. Ways to make an arm: kinseek.load"),
    ],
)
def test_arm_takes_a_chain(chain: Any, said: str) -> None:
    with pytest.raises(InvalidRobot, match=f"Arm takes a SerialChain, got .*{said}"):
        kinseek.Arm(chain)
    with pytest.raises(InvalidRobot, match="got an Arm"):
        kinseek.Arm(kinseek.load("planar2"))  # type: ignore[arg-type]


WRONG_SOLVERS = [
    ("brute-force", r"got 'brute-force' \(str\); write solver=kinseek.BruteForce\(\)"),
    ("atlas", r"got 'atlas' \(str\); write solver=kinseek.Atlas\(\)"),
    ("frob", r"got 'frob' \(str\)\. Valid: Atlas\(\), BruteForce\(\)"),
    (kinseek.BruteForce, r"got the class BruteForce; write solver=BruteForce\(\)"),
    (dict, "got the class dict"),
    (3, r"got 3 \(int\)"),
    ("", r"got '' \(str\)"),
    (0, r"got 0 \(int\)"),
    (False, r"got False \(bool\)"),
]


@pytest.mark.parametrize(("solver", "said"), WRONG_SOLVERS)
def test_a_solver_is_a_search(solver: Any, said: str) -> None:
    with pytest.raises(
        InvalidSolver, match=f"solver must be a search, an object with a method solve, {said}"
    ):
        kinseek.load("planar2").ik(T, solver=solver)


def test_polished_takes_two_searches() -> None:
    with pytest.raises(
        InvalidSolver, match=r"search must be a search.*class BlindSearch; write search=BlindSearch\(\)"
    ):
        kinseek.Polished(kinseek.BlindSearch, 3)  # type: ignore[arg-type]
    with pytest.raises(InvalidSolver, match=r"finish must be a search.*got 3 \(int\)"):
        kinseek.Polished(kinseek.BlindSearch(), 3)  # type: ignore[arg-type]


def test_any_object_that_solves_is_a_search() -> None:
    class Mine:
        def solve(self, problem: kinseek.Problem) -> kinseek.Solution:
            return kinseek.Atlas().solve(problem)

    arm = kinseek.load("planar2")
    assert arm.ik(arm.fk([0.1, 0.2]), solver=Mine()).success


ODD: list[Any] = [
    None,
    3,
    2.5,
    b"x",
    [None],
    [[1]],
    object(),
    1 + 2j,
    [1 + 2j, 2],
    [[], []],
    np.array(3),
    True,
    10**400,
]
ROWS = [[0.1, 0.0, 0.0, 0.0], [0.2, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize("odd", ODD, ids=[type(odd).__name__ + str(i) for i, odd in enumerate(ODD)])
def test_tables_limits_and_names_that_are_none(odd: Any) -> None:
    from_dh, from_fk = kinseek.Arm.from_dh, kinseek.Arm.from_fk

    def still(q: Any) -> Any:
        return np.tile(np.eye(4), (len(q), 1, 1))

    calls: list[Callable[[], Any]] = [
        lambda: from_dh(odd, [-1, -1], [1, 1]),
        lambda: from_dh(ROWS, odd, [1, 1]),
        lambda: from_fk(odd, [-1, -1], [1, 1]),
        lambda: from_fk(still, odd, [1, 1]),
        lambda: kinseek.pose(odd),
        lambda: kinseek.load("planar2").with_limits({"joint1": odd}),
        lambda: kinseek.load("planar2").with_locked(odd),
    ]
    if odd is not None:
        calls += [
            lambda: from_dh(ROWS, [-1, -1], [1, 1], kinds=odd),
            lambda: from_dh(ROWS, [-1, -1], [1, 1], names=odd),
            lambda: from_fk(still, [-1, -1], [1, 1], names=odd),
            lambda: from_fk(still, [-1, -1], [1, 1], kinds=odd),
        ]
    for call in calls:
        with pytest.raises(kinseek.KinseekError):
            call()
