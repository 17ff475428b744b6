"""What the benchmark of maps compares ours with is what it says: a table of four coordinates, a solver, poses in cells."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinseek
from benchmarks.branches import eaik
from benchmarks.maps.cells import drawn, grid_around, inside, rings_around, work_of
from benchmarks.maps.certainty import two_phases
from benchmarks.maps.sampled import Table, filled, seeded
from kinseek.maps.block import BlockScratch

pytest.importorskip("xarray")

UR5E = kinseek.load("ur5e")


def turned(angles: np.ndarray) -> np.ndarray:
    T = np.tile(np.eye(4), (len(angles), 1, 1))
    T[:, :3, :3] = Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])).as_matrix()
    return T


def test_a_table_of_four_coordinates_takes_turns_of_the_first_and_the_last_axis_for_one() -> None:
    table, rng = Table(1.3, 0.05, 36), np.random.default_rng(0)
    q = UR5E.sample(2000, seed=1)
    same = q.copy()
    same[:, [0, -1]] = rng.uniform(-3.0, 3.0, (len(q), 2))
    other = q.copy()
    other[:, 1:4] = UR5E.sample(2000, seed=2)[:, 1:4]
    cells = np.stack(table.cells_of(UR5E.fk(q)), axis=1)
    assert (cells >= 0).all()
    assert (cells < table.shape).all()
    assert (np.stack(table.cells_of(UR5E.fk(same)), axis=1) == cells).all(
        axis=1
    ).mean() > 0.999  # Rounding at edges.
    assert (np.stack(table.cells_of(UR5E.fk(other)), axis=1) == cells).all(axis=1).mean() < 0.01


def test_a_table_that_is_filled_knows_what_fills_it() -> None:
    said, vectors = filled(UR5E, Table(1.3, 0.1, 18), 0.05)
    assert said(UR5E.fk(UR5E.sample(2000, seed=0))).mean() > 0.9
    assert vectors > 0
    assert not said(np.array([kinseek.pose([1.25, 0.0, 0.0])])).any()
    assert not said(np.array([kinseek.pose([5.0, 0.0, 0.0])])).any()


def test_the_seeded_solver_finds_most_and_nothing_out_of_reach() -> None:
    assert seeded(UR5E, UR5E.fk(UR5E.sample(200, seed=3))).mean() > 0.8
    assert not seeded(UR5E, np.array([kinseek.pose([1.3, 0.0, 0.3])])).any()


def test_the_judge_of_cells_that_are_proved_empty_is_asked_about_the_arm_of_the_rings() -> None:
    pytest.importorskip("eaik")
    arm = BlockScratch(work_of(UR5E, rings_around(UR5E, 0.1, 576))).arm
    assert np.abs(arm.fk(np.zeros(6)) - UR5E.fk(np.zeros(6))).max() > 0.1
    solve, T = eaik(arm), arm.fk(arm.sample(100, seed=4))
    assert all(len(solve(pose)) for pose in T)


@pytest.mark.parametrize("make", [grid_around, rings_around])
def test_poses_drawn_inside_of_cells_lie_there(make: type) -> None:
    grid, rng = make(UR5E, 0.1, 576), np.random.default_rng(1)
    cells = drawn(grid, 1000)
    cells[:100, -1], cells[100:200, -1] = 0, len(grid.orientations) - 1
    poses = turned(rng.uniform(-3.0, 3.0, 1000)) @ inside(grid, cells, rng) if make is rings_around else None
    T = inside(grid, cells, rng) if poses is None else poses
    assert (np.stack(grid.cells_of(T), axis=1) == cells).all()


def test_a_mean_from_deep_looks_at_a_part_is_as_exact_as_it_says() -> None:
    """Two standard errors hold the mean of everything in about 95 of 100 draws, and are not wider than they need be."""
    rng, hits, errors = np.random.default_rng(0), 0, list[float]()
    rare = rng.random(200_000) < 0.06
    shallow = np.where(rare, 1.0, 0.3 * rng.random(len(rare)))
    deep = np.where(rare, rng.exponential(50.0, len(rare)), shallow)
    for _ in range(400):
        some = rng.integers(len(rare), size=1000)
        groups = [np.flatnonzero(rare[some]), np.flatnonzero(~rare[some])]
        looks = [(each, deep[some[each[:most]]]) for each, most in zip(groups, (30, 40), strict=True)]
        mean, error = two_phases(shallow[some], looks)
        hits += abs(mean - deep.mean()) <= error
        errors.append(error)
    assert 0.9 < hits / 400 < 0.98
    assert np.mean(errors) < 0.5 * deep.mean()


def test_a_deep_look_at_all_that_was_drawn_is_a_plain_mean() -> None:
    values = np.random.default_rng(1).random(50)
    mean, error = two_phases(np.zeros(50), [(np.arange(50), values), (np.arange(0), values[:0])])
    assert mean == pytest.approx(values.mean())
    assert error == pytest.approx(2 * values.std(ddof=1) / np.sqrt(50))
