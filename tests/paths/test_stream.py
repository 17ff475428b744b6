"""`Arm.follow_stream`: pieces that join, whatever the iterator does."""

from __future__ import annotations

import itertools
import tracemalloc
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, InvalidGoal, InvalidProblem, InvalidSolver
from kinseek.paths.path import Path
from test_paths import line, made

Array = NDArray[np.float64]


def joined(pieces: list[Path]) -> Array:
    for before, after in itertools.pairwise(pieces):
        assert (before.q[-1] == after.q[0]).all()
    return np.concatenate([pieces[0].q, *(piece.q[1:] for piece in pieces[1:])])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["irb120", "gen3", "panda"])
def test_pieces_join(name: str) -> None:
    arm = kinseek.load(name)
    T = arm.fk(made(arm, 300, 5))
    pieces = list(arm.follow_stream(iter(T), window=100, look_ahead=40))
    assert [len(piece) for piece in pieces] == [101, 101, 100]
    assert all(piece.success for piece in pieces)
    q = joined(pieces)
    assert np.abs(arm.fk(q) - T).max() < 2e-6
    assert np.abs(np.diff(q, axis=0)).max() < 0.3


def test_one_piece_is_the_path() -> None:
    arm = kinseek.load("irb120")
    T = arm.fk(made(arm, 60, 5))
    (piece,) = arm.follow_stream(T, window=60, look_ahead=0)
    assert (piece.q == arm.follow(T).q).all()


@pytest.mark.slow
def test_a_stream_of_goals() -> None:
    arm = kinseek.load("irb120")
    T = arm.fk(made(arm, 60, 5))
    goals = [Goal.pose(row, free="rz") for row in T]
    for given in (goals, Goal.pose(T, free="rz")):
        (piece,) = arm.follow_stream(given)
        assert (piece.q == arm.follow(Goal.pose(T, free="rz")).q).all()


def test_a_start_is_kept() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.2, 0.4]), np.array([0.4, 0.2, 0.4]), 40)
    start = arm.branches(T[0]).q[3]
    pieces = list(arm.follow_stream(T, window=15, look_ahead=5, start=start))
    assert (pieces[0].q[0] == start).all()
    assert np.abs(joined(pieces) - arm.follow(T, start=start).q).max() < 1e-8


def test_look_ahead_finds_the_branch_that_goes_on() -> None:
    two = kinseek.Arm.from_dh([(0.3, 0, 0, 0), (0.2, 0, 0, 0)], [-1, -2], [1, 2], name="two links")
    breaks = 0
    for way in (1, -1):  # One elbow reaches all places, the other those of the beginning alone.
        angles = way * np.linspace(-0.4, 1.3, 170)
        places = Goal.position(0.4 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1))
        assert two.follow(places).success
        assert all(piece.success for piece in two.follow_stream(places, window=20, look_ahead=100))
        breaks += sum(len(piece.breaks) for piece in two.follow_stream(places, window=20, look_ahead=0))
    assert breaks >= 1


def test_a_branch_that_continues_beyond_the_piece_explains_a_break() -> None:
    arm = kinseek.load("ur5e")
    T = kinseek.interpolate(arm.fk(arm.sample(2, seed=387)), step=0.01, turn=0.03)
    first = next(arm.follow_stream(T, window=25, look_ahead=50))
    assert len(first) == 26
    assert first.breaks.tolist() == [16]
    assert first.why[0].startswith("between poses 16 and 17: the branch before it ends with the path")


def test_where_a_pose_is_missed_the_stream_goes_on() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.2, 0.4]), np.array([0.4, 0.2, 0.4]), 60)
    T[18:23, 0, 3] = 3.0
    pieces = list(arm.follow_stream(T, window=20, look_ahead=5))
    assert joined(pieces).shape == (60, 6)
    assert [int((~piece.reached).sum()) for piece in pieces] == [3, 3, 0]
    assert "out of reach" in pieces[0].why[0]


def test_what_came_before_an_error_is_handed_out() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.2, 0.4]), np.array([0.4, 0.2, 0.4]), 60)

    def poses() -> Iterator[Array]:
        yield from T[:33]
        raise OSError("the network is down")

    found: list[Path] = []
    stream = arm.follow_stream(poses(), window=20, look_ahead=5)
    with pytest.raises(OSError, match="the network is down"):
        found.extend(stream)
    assert len(joined(found)) == 33
    T[45, 0, 0] = np.nan
    found, stream = [], arm.follow_stream(T, window=20, look_ahead=5)
    with pytest.raises(InvalidGoal, match="pose 45: a pose contains NaN"):
        found.extend(stream)
    assert len(joined(found)) == 45


@pytest.mark.parametrize("count", [1, 20, 21, 25, 26, 41])
def test_every_pose_is_handed_out_once(count: int) -> None:
    arm = kinseek.load("irb120")
    T = arm.fk(made(arm, 60, 5))[:count]
    assert len(joined(list(arm.follow_stream(T, window=20, look_ahead=5)))) == count


def test_misuse() -> None:
    arm = kinseek.load("ur5e")
    T = line(np.array([0.4, -0.2, 0.4]), np.array([0.4, 0.2, 0.4]), 4)
    with pytest.raises(InvalidSolver, match="window"):
        arm.follow_stream(T, window=0)
    with pytest.raises(InvalidSolver, match="look_ahead"):
        arm.follow_stream(T, look_ahead=-1)
    with pytest.raises(InvalidGoal, match="at least one pose"):
        next(arm.follow_stream(iter(())))
    wrong: list[Any] = [3, np.array(3), Goal.pose(T[0])]
    for each in wrong:
        with pytest.raises(InvalidGoal, match="a stream is"):
            next(arm.follow_stream(each))
    with pytest.raises(InvalidGoal, match="pose 0: "):
        next(arm.follow_stream(T[:, None]))
    with pytest.raises(InvalidProblem, match="start does not reach the first pose"):
        next(arm.follow_stream(T, start=np.zeros(6)))


@pytest.mark.slow
def test_memory_stays_the_same() -> None:
    arm = kinseek.load("irb120")
    T = arm.fk(made(arm, 6000, 0))
    most = []
    for count in (1500, 6000):
        tracemalloc.start()
        try:
            for piece in arm.follow_stream(T[:count], window=500, look_ahead=100, threads=1):
                assert piece.reached.all()
            most.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert most[1] < 1.2 * most[0]
