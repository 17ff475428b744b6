"""What the benchmark of maps compares ours with is what it says: a table of four coordinates, a solver, poses in cells."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.maps.cells import drawn, grid_around, inside, rings_around
from benchmarks.maps.sampled import Table, filled, seeded
from scipy.spatial.transform import Rotation

import kinseek

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


@pytest.mark.parametrize("make", [grid_around, rings_around])
def test_poses_drawn_inside_of_cells_lie_there(make: type) -> None:
    grid, rng = make(UR5E, 0.1, 576), np.random.default_rng(1)
    cells = drawn(grid, 1000)
    cells[:100, -1], cells[100:200, -1] = 0, len(grid.orientations) - 1
    poses = turned(rng.uniform(-3.0, 3.0, 1000)) @ inside(grid, cells, rng) if make is rings_around else None
    T = inside(grid, cells, rng) if poses is None else poses
    assert (np.stack(grid.cells_of(T), axis=1) == cells).all()
