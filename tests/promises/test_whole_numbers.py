"""Whole numbers: every parameter that is one takes any integer, and no bool and no float, by one reader."""

from __future__ import annotations

import ast
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import KinseekError, maps
from kinseek.maps.orientations import orientations
from kinseek.problem import Problem
from kinseek.support.validation import as_integer
from verbs import arm_of, asked, scene_of

ARM = kinseek.load("planar2")
T = ARM.fk([0.3, 0.4])
FAR = T + np.array([[0, 0, 0, 9.0], [0] * 4, [0] * 4, [0] * 4])
BATCH = np.array([T] * 3)


def ahead(looks: Any) -> Any:
    """How far a tracker sees after two steps."""
    tracker = ARM.track([0.3, 0.4])
    for _ in range(2):
        tracker.step(T)
    return tracker.foresee(0.1, looks=looks)


CALLS: dict[str, tuple[Callable[[Any], Any], int]] = {
    "sample, n": (ARM.sample, 3),
    "sample, seed": (lambda value: ARM.sample(2, value), 3),
    "ik, threads": (lambda value: ARM.ik(BATCH, threads=value), 2),
    "ik of one, threads": (lambda value: ARM.ik(T, threads=value), 2),
    "ik preferred, threads": (lambda value: ARM.ik(BATCH, threads=value, prefer="limits"), 2),
    "branches, count": (lambda value: ARM.branches(T, count=value), 3),
    "branches of a batch, count": (lambda value: ARM.branches(BATCH, count=value), 3),
    "branches, threads": (lambda value: ARM.branches(BATCH, threads=value), 2),
    "follow, threads": (lambda value: ARM.follow(BATCH, threads=value), 2),
    "follow_stream, window": (lambda value: list(ARM.follow_stream(BATCH, window=value)), 3),
    "follow_stream, look_ahead": (lambda value: list(ARM.follow_stream(BATCH, look_ahead=value)), 1),
    "follow_stream, threads": (lambda value: list(ARM.follow_stream(BATCH, threads=value)), 1),
    "prove, budget": (lambda value: ARM.prove(FAR, budget=value), 50),
    "prove, threads": (lambda value: ARM.prove(FAR, budget=50, threads=value), 2),
    "problem, budget": (lambda value: Problem(ARM.mechanism, kinseek.Goal.pose(T), budget=value), 9),
    "Atlas, samples": (lambda value: ARM.ik(T, solver=kinseek.Atlas(samples=value)), 64),
    "Atlas, threads": (lambda value: ARM.ik(BATCH, solver=kinseek.Atlas(threads=value)), 2),
    "BruteForce, branching_factor": (
        lambda value: ARM.ik(T, solver=kinseek.BruteForce(branching_factor=value)),
        8,
    ),
    "BruteForce, seed": (lambda value: ARM.ik(T, solver=kinseek.BruteForce(8, seed=value)), 3),
    "BruteForce, most_nodes": (lambda value: ARM.ik(T, solver=kinseek.BruteForce(8, most_nodes=value)), 999),
    "BlindSearch, most_steps": (lambda value: ARM.ik(T, solver=kinseek.BlindSearch(most_steps=value)), 5),
    "CoordinateDescent, most_sweeps": (
        lambda value: ARM.ik(T, solver=kinseek.CoordinateDescent(most_sweeps=value)),
        5,
    ),
    **{
        f"DivideAndConquer, {name}": (
            lambda value, name=name: ARM.ik(T, solver=kinseek.DivideAndConquer(**{name: value})),  # type: ignore[misc]
            good,
        )
        for name, good in {
            "branching_factor": 90,
            "divisions": 3,
            "beam": 2,
            "children": 3,
            "node_budget": 2000,
            "most_nodes": 10**6,
        }.items()
    },
    "orientations, count": (orientations, 12),
    "map, depth": (lambda value: a_map(depth=value), 3),
    "map, budget": (lambda value: a_map(budget=value), 100),
    "map, patience": (lambda value: a_map(patience=value), 100),
    "estimate, cores": (lambda value: a_map(cores=value), 1),
    "foresee, looks": (ahead, 4),
}


def a_map(**options: Any) -> Any:
    """What a small map will take."""
    pytest.importorskip("xarray")
    grid = maps.Grid((0.0, 0.2, 0.1), (0.0, 0.2, 0.1), (0.0, 0.1, 0.1), orientations(12))
    return maps.estimate(ARM, grid, seconds=0.01, **{"cores": 1} | options)


class Number:
    """An integer of another library."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __index__(self) -> int:
        return self.value


def bits(answer: Any) -> Any:
    """Joint values, where there are any."""
    return np.asarray(getattr(answer, "q", 0.0)).tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", CALLS)
def test_any_integer_is_taken_and_nothing_else(name: str) -> None:
    call, good = CALLS[name]
    answer = bits(call(good))
    for value in (np.int64(good), np.uint8(good) if good < 256 else np.int32(good), Number(good)):
        assert bits(call(value)) == answer
    for bad in (
        True,
        False,
        np.True_,
        float(good),
        np.float64(good),
        Fraction(good),
        str(good),
        -1,
        object(),
    ):
        with pytest.raises(KinseekError, match=r"must be a (whole )?number"):
            call(bad)


@pytest.mark.slow
def test_scenes_take_any_integer_and_nothing_else() -> None:
    pytest.importorskip("coal")
    scene = scene_of("ur5e")
    q = arm_of("ur5e").sample(3000)
    free = scene.free(q, threads=2)
    assert np.array_equal(scene.free(q, threads=np.int64(2)), free)
    wrong: list[Any] = [True, 2.0, 0]
    ten: Any = np.int64(10)
    for bad in wrong:
        with pytest.raises(KinseekError, match="threads must be a whole number of at least 1"):
            scene.free(q, threads=bad)
        with pytest.raises(KinseekError, match="samples must be a whole number from 1 to 1,000,000"):
            kinseek.Scene.of(arm_of("ur5e"), capsules=0.02, samples=bad)
    kinseek.Scene.of(arm_of("ur5e"), capsules=0.02, samples=ten)


@pytest.mark.parametrize("n", [10**13, np.int64(10**13), 10**40])
def test_a_sample_that_does_not_fit_into_memory_is_refused(n: Any) -> None:
    with pytest.raises(
        KinseekError, match=r"n must be .*10,000,000,000,000|n must be a whole number"
    ) as caught:
        ARM.sample(n)
    if n < 2**62:
        assert "149,012 GiB" in str(caught.value)


def test_the_bounds_belong_to_the_range() -> None:
    assert [as_integer("n", value, 2, 4) for value in (2, 3, 4)] == [2, 3, 4]
    for value in (1, 5):
        with pytest.raises(kinseek.InvalidSolver, match=f"n must be a whole number from 2 to 4, got {value}"):
            as_integer("n", value, 2, 4)


@pytest.mark.slow
def test_there_is_one_reader() -> None:
    """Whether something is an integer is asked in one place: `isinstance(x, int)` is true of bools and false of NumPy's."""
    package = Path(kinseek.__file__).parent
    rooms = ("solvers", "branches", "paths", "proof", "plots", "maps", "collision", "viewer")
    files = [path for room in rooms for path in (package / room).rglob("*.py")]
    files += [package / name for name in ("arm.py", "kinematics.py", "problem.py")]
    found = set()
    for path in files:
        text = path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if "isinstance" in text else ():
            if not (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Name)
                and node.func.id == "isinstance"
            ):
                continue
            kinds = ast.unparse(node.args[1])
            if kinds in ("int", "int | np.integer", "Integral", "np.integer"):
                found.add((path.relative_to(package).as_posix(), ast.unparse(node.args[0])))
    assert found == {("viewer/door.py", "value")}  # A message of a page, which is no call.


@pytest.mark.slow
def test_verbs_take_counts_of_numpy() -> None:
    """Lengths of arrays and `shape` are integers of Python, but results of NumPy's functions are not."""
    for name in ("ur5e", "panda"):
        arm = arm_of(name)
        poses = asked(arm, seed=1)
        few: Any = np.argmax(np.arange(3))
        for pose in poses[:2]:
            assert len(arm.branches(pose, count=few)) <= few
        assert arm.ik(poses, threads=few).q.tobytes() == arm.ik(poses, threads=2).q.tobytes()
