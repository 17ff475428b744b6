"""Maps: the grid of orientations, the first joint divided out, whole cells, what is read from a map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinseek
from chains import beside
from kinseek import maps
from kinseek.maps.cell import whole_cell
from kinseek.maps.cells import EMPTY, REACHED, UNDECIDED, Judge
from kinseek.maps.grid import grid_of
from kinseek.maps.orientations import ball
from kinseek.maps.search import reached, ruled_out
from kinseek.maps.whole import around, whole_share

pytest.importorskip("xarray")
pytest.importorskip("zarr")
pytest.importorskip("distributed")

UR5E = kinseek.load("ur5e")
WIDE = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.5, 1.0, 0.5), maps.orientations(12))


def angles(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    return np.asarray(Rotation.from_matrix(np.swapaxes(A, -1, -2) @ B).magnitude())


@pytest.mark.parametrize("count", [1, 2, 5, 72, 100, 577, 4608])
def test_orientations_cover_with_cells_of_equal_volume(count: int) -> None:
    grid = maps.orientations(count)
    R = Rotation.random(20_000, random_state=count).as_matrix()
    cell = grid.nearest(R)
    off = angles(grid.matrices[cell], R)
    assert (off <= grid.half_angles[cell] + 1e-9).all()
    assert grid.covering_radius <= 1.06 * off.max() or count < 5
    assert (grid.nearest(grid.matrices) == np.arange(len(grid))).all()
    hits = np.bincount(cell, minlength=len(grid))
    assert hits.std() < 1.3 * np.sqrt(hits.mean())  # As of independent draws.


def test_the_grid_of_a_map_is_made_again_of_its_description() -> None:
    """For 3 orientations a grid has 4, and for 4 it has 6: the number of orientations alone does not tell the grid."""
    for count in range(1, 140):
        wanted = maps.Grid((0, 1, 1), (0, 1, 1), (0, 1, 1), maps.orientations(count))
        again = grid_of(wanted.description())
        assert np.array_equal(again.orientations.regions, wanted.orientations.regions)
        assert again.orientations.arcs == wanted.orientations.arcs


def test_orientations_are_as_even_as_their_number_allows() -> None:
    """No cell can be smaller than a ball of its volume; Ω - sin Ω over π is the share of SO(3) in a ball."""
    for count in (72, 576, 4608):
        grid = maps.orientations(count)
        assert len(grid) == count
        radius = grid.covering_radius
        assert 1.0 < (radius - np.sin(radius)) / np.pi * len(grid) < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("rolls", [False, True])
def test_a_part_of_a_cell_lies_in_its_ball(rolls: bool) -> None:
    rng = np.random.default_rng(2)
    for index in ((0, 1, 1, 0), (2, 3, 0, 5), (3, 2, 2, 11)):
        cell = whole_cell(WIDE, index, rolls)
        parts = [cell]
        for _ in range(5):
            parts = [half for part in parts for half in part.halves(0.3)]
        assert len(parts) == 32
        for part in rng.permutation(np.array(parts, dtype=object))[:8]:
            T, half, angle = part.ball()
            P = part.sample(300)
            cells = np.stack(WIDE.cells_of(P), axis=1)
            assert (cells[:, :3] == index[:3]).all()
            arcs = WIDE.orientations.arcs
            assert (
                (cells[:, 3] // arcs == index[3] // arcs).all() if rolls else (cells[:, 3] == index[3]).all()
            )
            assert (np.linalg.norm(P[:, :3, 3] - T[:3, 3], axis=1) <= half).all()
            if not rolls:
                assert (angles(T[:3, :3], P[:, :3, :3]) <= angle).all()
                continue
            # Turned about their own z axes as well as can be.
            back = np.swapaxes(P[:, :3, :3], -1, -2) @ T[:3, :3]
            best = np.arctan2(back[:, 1, 0] - back[:, 0, 1], back[:, 0, 0] + back[:, 1, 1])
            turned = P[:, :3, :3] @ Rotation.from_rotvec(np.outer(best, [0, 0, 1])).as_matrix()
            assert (angles(T[:3, :3], turned) <= angle).all()
            assert angles(T[:3, :3], turned).max() > 0.5 * angle


def test_poses_all_over_a_cell_are_spread_evenly_and_the_nearest_of_them_is_found() -> None:
    cell = whole_cell(WIDE, (2, 3, 0, 5))
    P = cell.sample(4000)
    share = (P[:, :3, 3] - cell.box[:, 0]) / (cell.box[:, 1] - cell.box[:, 0])
    for axis in range(3):
        assert np.abs(np.histogram(share[:, axis], 10, (0, 1))[0] - 400).max() < 20
    assert (
        abs((P[:, 2, 2] > np.cos(cell.region[:2]).mean()).mean() - 0.5) < 0.01
    )  # Half of the region's area.
    for T in P[::400]:
        assert np.abs(cell.nearest(T) - T).max() < 5e-3  # A little inside.
    far = kinseek.pose([5.0, -5.0, -5.0], rpy=[0.3, 1.0, -2.0])
    near = cell.nearest(far)
    assert tuple(int(i) for i in WIDE.cells_of(near)) == (2, 3, 0, 5)
    assert (
        np.linalg.norm(near[:3, 3] - far[:3, 3])
        <= np.linalg.norm(P[:, :3, 3] - far[:3, 3], axis=1).min() + 2e-3
    )


def test_a_ball_of_swing_and_turn() -> None:
    turned = Rotation.from_rotvec([0.3, 0.0, 0.0]) * Rotation.from_rotvec([0.0, 0.0, 0.4])
    assert ball(0.3, 0.4) == pytest.approx(turned.magnitude())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "panda", "irb120", "scara4", "cylindrical3"])
def test_the_gate_of_many_poses_is_that_of_one(name: str) -> None:
    arm = kinseek.load(name)
    goal = kinseek.Goal.pose(WIDE.poses([slice(None)] * 4).reshape(-1, 4, 4)[::3])
    closed = ruled_out(arm, goal)
    assert closed.any()
    for T, out in list(zip(goal.target, closed, strict=True))[::20]:
        certificate = arm.prove(T)
        assert not out or certificate.verdict is kinseek.Verdict.UNREACHABLE
        if certificate.verdict is kinseek.Verdict.UNREACHABLE and certificate.boxes == 0:
            assert out
    at_home = arm.fk(arm.sample(2000, seed=3))
    assert not ruled_out(arm, kinseek.Goal.pose(at_home)).any()


@pytest.mark.parametrize("name", ["ur5e", "irb120", "puma560"])
def test_reached_is_what_ik_says(name: str) -> None:
    arm = kinseek.load(name)
    T = np.concatenate([WIDE.poses([slice(None)] * 4).reshape(-1, 4, 4)[::5], arm.fk(arm.sample(300))])
    assert (reached(arm, kinseek.Goal.pose(T)) == arm.ik(T).success).all()
    assert reached(arm, kinseek.Goal.pose(T[-300:])).all()


@pytest.mark.slow
def test_a_map_says_what_the_arm_says() -> None:
    what = ("reached", "branches", "dexterity", "limit_distance")
    m = maps.reach(UR5E, WIDE, what)
    assert m.reached.dims == ("x", "y", "z", "orientation")
    assert m.attrs["Conventions"].startswith("CF-")
    assert m.attrs["kinseek"]["name"] == "ur5e"
    T = WIDE.poses([slice(None)] * 4)
    for index in np.argwhere(m.reached.values == 1)[::7]:
        place = tuple(index)
        answers = UR5E.branches(T[place])
        assert m.branches.values[place] == len(answers)
        assert m.dexterity.values[place] == pytest.approx(UR5E.manipulability(answers.q).max(), rel=1e-5)
        assert 0.0 <= m.limit_distance.values[place] <= 1.0
    assert np.isnan(m.dexterity.values[m.reached.values == 0]).all()
    read = maps.at(m, T)
    assert (read["reached"] == m.reached.values).all()
    assert read["inside"].all()
    outside = maps.at(m, kinseek.pose([3.0, 0.0, 0.0]))
    assert [int(outside[name]) for name in ("inside", "reached", "branches")] == [0, -1, -1]
    assert np.isnan([outside["dexterity"], outside["limit_distance"]]).all()
    share = maps.capability(m)
    assert share.values == pytest.approx((m.reached.values == 1).mean(axis=-1))


@pytest.mark.parametrize("kind", ["boxes", "rings"])
def test_a_map_is_asked_for_poses_and_nothing_else(kind: str) -> None:
    turns = maps.orientations(24)
    rings = maps.Rings((0.0, 1.2, 0.6), (-0.6, 0.9, 0.5), turns)
    m = maps.reach(
        UR5E, rings if kind == "rings" else maps.Grid((-1, 1, 0.5), (-1, 1, 0.5), (0, 1, 0.5), turns)
    )
    T = UR5E.fk(np.zeros(6))
    for wrong in (np.full((4, 4), np.nan), np.diag([1, 1, -1, 1]), T[:3], [0.4, 0, 0.4, 1, 0, 0, 0], "abc"):
        with pytest.raises(kinseek.InvalidGoal):
            maps.at(m, wrong)
    far = maps.at(m, [T, kinseek.pose([0.0, 0.0, 99.0])])
    assert far["inside"].tolist() == [True, False]
    assert far["reached"].tolist() == [1, -1] or far["reached"].tolist() == [0, -1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "irb120", "puma560", "scara4"])
def test_a_ring_is_what_the_plain_way_says_all_around(name: str) -> None:
    """Poses of the ring, turned anywhere about the first axis: the table of one plane and `ik` of each agree."""
    arm = kinseek.load(name)
    rings = maps.Rings((0.0, 1.2, 0.3), (-0.6, 0.9, 0.3), maps.orientations(24))
    m = maps.reach(arm, rings)
    place = np.array(m.attrs["kinseek"]["first_frame"])
    T = rings.poses([slice(None)] * 3).reshape(-1, 4, 4)
    turns = np.random.default_rng(4).uniform(-np.pi, np.pi, len(T))
    turned = np.tile(np.eye(4), (len(T), 1, 1))
    turned[:, :3, :3] = Rotation.from_rotvec(np.outer(turns, [0, 0, 1])).as_matrix()
    poses = place @ turned @ T
    plain, read = arm.ik(poses).success, maps.at(m, poses)["reached"]
    assert (plain == (read == 1)).all()
    assert plain.any()
    if name == "irb120":  # Its first joint leaves a gap, and some poses lie in it.
        whole = m.turn_to - m.turn_from > 2 * np.pi - 1e-9
        assert int(((m.reached == 1) & ~whole).sum()) > 0


def test_rings_of_an_arm_with_joints_to_spare_claim_nothing_false() -> None:
    arm = kinseek.load("panda")
    rings = maps.Rings((0.2, 0.8, 0.2), (0.0, 0.8, 0.4), maps.orientations(12))
    m = maps.reach(arm, rings)
    some = np.argwhere(m.reached.values == 1)
    T = rings.poses([slice(None)] * 3)[tuple(some.T)]
    turns = m.turn_from.values[tuple(some.T)] + 1e-6
    turned = np.tile(np.eye(4), (len(T), 1, 1))
    turned[:, :3, :3] = Rotation.from_rotvec(np.outer(turns, [0, 0, 1])).as_matrix()
    assert arm.ik(np.array(m.attrs["kinseek"]["first_frame"]) @ turned @ T).success.all()


@pytest.mark.slow
def test_rings_expand_to_a_grid() -> None:
    rings = maps.Rings((0.0, 1.5, 0.1), (-0.6, 1.0, 0.1), maps.orientations(72))
    grid = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.5, 0.5, 0.25), maps.orientations(72))
    wide = maps.expand(maps.reach(UR5E, rings), grid)
    plain = maps.reach(UR5E, grid)
    assert (wide.reached >= 0).all()
    near = (wide.reached == plain.reached).mean()
    assert near > 0.85  # The nearest cell of the ring is another pose: at the edge of reach they differ.
    middle = maps.capability(plain).values > 0.9
    assert (wide.reached.values == 1)[middle].mean() > 0.85


def known_of(judge: Judge, index: np.ndarray) -> int:
    """What is known of a cell whose middle is not reached."""
    *place, number = map(int, index)
    (told,) = judge.row(tuple(place), (number,), np.array([False]))
    return told.known


@pytest.mark.slow
def test_what_is_proved_empty_holds_no_pose() -> None:
    """Cells that a pose of the arm lies in, stretched out and at limits too, are never called empty."""
    grid = maps.Grid((-1.2, 1.2, 0.05), (-1.2, 1.2, 0.05), (-1.2, 1.5, 0.05), maps.orientations(4608))
    q = UR5E.sample(150, seed=5)
    q[::3, 2] = 0.0  # The elbow: the edge of reach.
    q[1::5] = np.where(np.random.default_rng(1).random(q[1::5].shape) < 0.5, UR5E.lower, UR5E.upper)
    cells = np.stack(grid.cells_of(UR5E.fk(q)), axis=1)
    judge = Judge(UR5E, grid, 0, 300)
    known = [known_of(judge, index) for index in cells[(cells >= 0).all(axis=1)]]
    assert len(known) > 120
    assert EMPTY not in known
    others = np.random.default_rng(2).integers(grid.shape, size=(150, 4))
    verdicts = [known_of(judge, index) for index in others]
    assert verdicts.count(EMPTY) > 40


@pytest.mark.slow
def test_what_is_reached_within_tolerances_is_not_proved_empty() -> None:
    """Poses that a stretched arm misses by 15 cm: their cells are empty, and not so where 16 cm count as reached."""
    grid = maps.Grid((-1.2, 1.2, 0.02), (-1.2, 1.2, 0.02), (-1.2, 1.2, 0.02), maps.orientations(40_000))
    wide = kinseek.Goal.pose(np.eye(4), position_tolerance=0.16, orientation_tolerance=0.01)
    q = UR5E.sample(12, seed=1)
    q[:, 2:4] = 0.0
    T = UR5E.fk(q)
    way = T[:, :3, 3] - [0.0, 0.0, 0.1625]  # From the shoulder.
    T[:, :3, 3] += 0.15 * way / np.linalg.norm(way, axis=1, keepdims=True)
    cells = np.stack(grid.cells_of(T), axis=1)
    exact = [known_of(Judge(UR5E, grid, 0, 3000), index) for index in cells]
    assert exact.count(EMPTY) > 3
    assert EMPTY not in [known_of(Judge(UR5E, grid, 0, 3000, wide), index) for index in cells]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "irb120", "panda"])
def test_every_pose_of_a_ball_that_is_proved_is_reached(name: str) -> None:
    arm = kinseek.load(name)
    T = arm.fk(arm.sample(60, seed=8))
    size, proved = np.ones(len(T)), np.zeros(len(T), dtype=bool)
    for scale in (0.02, 0.005, 0.001):
        held = around(arm, T, np.full(len(T), scale), np.full(len(T), 2.0 * scale))
        size = np.where(held & ~proved, scale, size)
        proved |= held
    assert proved.sum() > 20
    for seed in range(10):
        for scale in np.unique(size[proved]):
            inside = beside(T[proved & (size == scale)], scale, 2.0 * scale, seed)
            assert reached(arm, kinseek.Goal.pose(inside), patience=None).all()


@pytest.mark.slow
def test_a_ball_that_reaches_beyond_the_arm_or_its_limits_is_never_proved() -> None:
    q = UR5E.sample(60, seed=9)
    q[:, 2] = np.linspace(-0.02, 0.02, len(q))  # A stretched elbow: often the edge of reach.
    T = UR5E.fk(q)
    held = around(UR5E, T, np.full(len(q), 1e-3), np.full(len(q), 1e-3))
    balls = [
        reached(UR5E, kinseek.Goal.pose(beside(T, 1e-3, 1e-3, seed)), patience=None) for seed in range(30)
    ]
    beyond = ~np.all(balls, axis=0)
    assert beyond.sum() > 5
    assert held.sum() > 5
    assert not (held & beyond).any()
    arm = kinseek.load("irb120")
    q = arm.sample(60, seed=10)
    q[:, 1] = arm.upper[1] - 1e-4
    T = arm.fk(q)
    lone = np.array([len(each) == 1 for each in arm.branches(T)])
    assert lone.sum() > 3
    radii = np.full(int(lone.sum()), 1e-3)
    assert not around(arm, T[lone], radii, radii).any()
    assert around(arm, T[lone], radii * 1e-3, radii * 1e-3).any()


@pytest.mark.slow
def test_all_of_a_cell_that_is_proved_to_be_reached_is() -> None:
    grid = maps.Grid((0.1, 0.7, 0.02), (-0.3, 0.3, 0.02), (0.0, 0.6, 0.02), maps.orientations(500_000))
    cells = np.stack(grid.cells_of(UR5E.fk(UR5E.sample(400, seed=11))), axis=1)
    whole = 0
    for number, index in enumerate(cells[(cells >= 0).all(axis=1)][:12]):
        cell = whole_cell(grid, tuple(int(i) for i in index), rolls=True)
        share = whole_share(UR5E, cell, 4)
        assert 0.0 <= share <= 1.0
        inside = cell.sample(1000)
        found = reached(UR5E, kinseek.Goal.pose(inside), patience=None)
        assert found.mean() >= share - 0.05
        whole += share == 1.0
        assert share < 1.0 or found.all(), number
    assert whole >= 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_cells_that_differ_by_a_turn_of_the_last_joint_are_judged_as_one(name: str) -> None:
    """A pose of the arm lies in a stack of cells: it is never empty, nor is the cell of the pose itself."""
    arm = kinseek.load(name)
    half = float(np.ceil(arm.chain.reach / 0.1) * 0.1)
    grid = maps.Grid((-half, half, 0.05), (-half, half, 0.05), (-half, half, 0.05), maps.orientations(4608))
    judge, arcs = Judge(arm, grid, 1, 300), grid.orientations.arcs
    assert judge.last is not None
    assert judge.last.free == (name == "ur5e")
    for index in np.stack(grid.cells_of(arm.fk(arm.sample(12, seed=12))), axis=1):
        place, number = tuple(int(i) for i in index[:-1]), int(index[-1])
        first = number // arcs * arcs
        told = judge.row(place, range(first, first + arcs), np.zeros(arcs, dtype=bool))
        assert told[number - first].known != EMPTY
        assert not judge.last.free or EMPTY not in [each.known for each in told]


def test_poses_that_the_last_joint_turns_into_each_other_are_asked_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from kinseek.maps import search

    grid = maps.Grid((-1.0, 1.0, 0.5), (-1.0, 1.0, 0.5), (-0.9, 1.1, 0.5), maps.orientations(288))
    goal = kinseek.Goal.pose(grid.poses([slice(None)] * 4).reshape(-1, 4, 4))
    once = reached(UR5E, goal)
    asked = list[int]()
    plain = search._reached

    def counted(arm: kinseek.Arm, goal: kinseek.Goal, patience: int | None) -> np.ndarray:
        asked.append(len(goal.targets))
        return plain(arm, goal, patience)

    monkeypatch.setattr(search, "_reached", counted)
    assert (reached(UR5E, goal) == once).all()
    assert sum(asked) == len(once) // grid.orientations.arcs
    assert (plain(UR5E, goal, 1000) == once).all()
    assert 0.2 < once.mean() < 0.9


@pytest.mark.slow
def test_a_proved_map_bounds_the_volume() -> None:
    arm = kinseek.load("irb120")
    grid = maps.Grid((0.4, 0.8, 0.1), (-0.05, 0.05, 0.1), (0.3, 0.4, 0.1), maps.orientations(576))
    m = maps.reach(arm, grid, prove=True, depth=0, budget=300)
    cell = m.cell.values
    assert set(np.unique(cell)) == {UNDECIDED, REACHED, EMPTY}
    assert (cell[m.reached.values == 1] == REACHED).all()
    assert ((cell == EMPTY) == (m.empty_share.values == 1.0)).all()
    inside = maps.at(m, arm.fk(arm.sample(500_000, seed=5)))
    found = inside["cell"][inside["inside"]]
    assert len(found) > 300
    assert (found != EMPTY).all()
    poses, places = maps.volume(m), maps.volume(m, "positions")
    assert 0.0 <= poses.least < poses.touched < poses.most < grid.volume
    assert poses.touched < places.touched <= places.most <= grid.volume * (1 + 1e-12)


@pytest.mark.slow
def test_proved_rings_hold_no_pose() -> None:
    arm = kinseek.load("irb120")
    rings = maps.Rings((0.4, 0.8, 0.2), (0.2, 0.6, 0.2), maps.orientations(288))
    m = maps.reach(arm, rings, prove=True, depth=0, budget=300)
    inside = maps.at(m, arm.fk(arm.sample(200_000, seed=6)))
    found = inside["cell"][inside["inside"]]
    assert len(found) > 1000
    assert (found != EMPTY).all()
    assert (m.cell.values == EMPTY).any()
    T = np.tile(np.eye(4), (5000, 1, 1))  # Anywhere in the cells, not in their middles.
    T[:, :3, :3] = Rotation.random(5000, random_state=7).as_matrix()
    turn, radius, height = np.random.default_rng(8).uniform([-3.1, 0.4, 0.2], [3.1, 0.8, 0.6], (5000, 3)).T
    T[:, :3, 3] = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    T = np.array(m.attrs["kinseek"]["first_frame"]) @ T
    read = maps.at(m, T)
    empty = T[read["inside"] & (read["cell"] == EMPTY)]
    assert len(empty) > 100
    assert not reached(arm, kinseek.Goal.pose(empty)).any()
    assert reached(arm, kinseek.Goal.pose(T)).any()
    assert maps.volume(m).most < rings.volume


def test_loose_tolerances_find_what_the_arm_finds() -> None:
    """Of 600 poses the map had 341 and `Arm.ik` 365, and bases were ranked by the smaller numbers."""
    arm = kinseek.load("iiwa14")
    T = arm.fk(arm.sample(300))
    T[:, :3, 3] *= 1.1
    goal = kinseek.Goal.pose(T, position_tolerance=0.01, orientation_tolerance=0.2)
    found = arm.ik(goal).success
    assert found.sum() - reached(arm, goal).sum() > 10
    ranked = maps.best_base(arm, goal, np.eye(4)[None])
    assert int(ranked.reached[0]) == found.sum()
    assert maps.make.options_of({"position_tolerance": 0.01})["patience"] is None
    assert maps.make.options_of({"goal": goal.at(np.eye(4))})["patience"] is None
    assert maps.make.options_of({"position_tolerance": 0.01, "patience": 7})["patience"] == 7
    assert maps.make.options_of({})["patience"] == 1000


def test_the_best_base_reaches_most() -> None:
    poses = UR5E.fk(np.array([[0.0, -1.2, 1.4, -1.8, -1.5, 0.0], [0.5, -1.0, 1.2, -1.8, -1.5, 0.0]]))
    candidates = [
        kinseek.pose([2.0, 0.0, 0.0]),
        kinseek.pose([0.0, 0.0, 0.0]),
        kinseek.pose([-0.6, 0.0, 0.0]),
    ]
    ranked = maps.best_base(UR5E, poses, candidates)
    assert int(ranked.number[0]) == 1
    assert ranked.reached.values.tolist() == sorted(ranked.reached.values, reverse=True)
    assert int(ranked.reached[0]) == 2
    last = int(ranked.limiting[-1])
    assert not UR5E.ik(np.linalg.inv(ranked.base.values[-1]) @ poses[last]).success


FINE = ((-1, 1, 1 / 33),) * 3


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: maps.orientations(0), "whole number from 1"),
        (lambda: maps.Grid((-1, 1, 1e-4), (-1, 1, 1e-4), (-1, 1, 1e-4), maps.orientations(72)), "too large"),
        (lambda: maps.Grid((0, 1e7, 1e-3), (0, 1, 1), (0, 1, 1), maps.orientations(72)), "along one axis"),
        (lambda: maps.reach(UR5E, WIDE, block=2**27), "block must be a whole number from 1 to 67,108,864"),
        (
            lambda: maps.reach(UR5E, maps.Grid(*FINE, maps.orientations(12)), block=12),
            "has 287,496 blocks, expected at most 262,144: give a larger block=",
        ),
        (lambda: maps.reach(UR5E, WIDE, prove="no"), "prove must be True or False, got 'no'"),  # type: ignore[arg-type]
        (lambda: maps.reach(UR5E, WIDE, 5), "what must be some of reached, "),  # type: ignore[arg-type]
        (lambda: maps.reach(UR5E, WIDE, [["reached"]]), "unknown measure"),  # type: ignore[list-item]
        (lambda: maps.best_base(UR5E, np.eye(4), np.eye(4), by=["both"]), "by must be"),  # type: ignore[arg-type]
        (lambda: maps.Grid((-1, 1, 0.3), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "must divide"),
        (lambda: maps.Grid((1, -1, 0.1), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "from < to"),
        (
            lambda: maps.Grid((1e17, 1e17 + 100, 1), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)),
            "x must lie within 1e",
        ),
        (lambda: maps.Grid("abc", (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "from, to, step"),  # type: ignore[arg-type]
        (lambda: maps.Rings((-1, 1, 0.5), (-1, 1, 0.5), maps.orientations(72)), "radius begins"),
        (lambda: maps.reach(UR5E, WIDE, ("reach",)), "unknown measure 'reach'"),
        (lambda: maps.reach(UR5E, WIDE, depth=-1), "depth must be"),
        (lambda: maps.reach(UR5E, WIDE, position_tolerance=-1.0), "position_tolerance"),
        (lambda: maps.reach(UR5E, (0, 1)), "must be a maps.Grid"),  # type: ignore[arg-type]
        (lambda: maps.reach("ur5e", WIDE), "a map needs an Arm, as kinseek.load gives it, got str"),  # type: ignore[arg-type]
        (lambda: maps.estimate("ur5e", WIDE), "needs an Arm"),  # type: ignore[arg-type]
        (lambda: maps.best_base("ur5e", np.eye(4), np.eye(4)), "of bases needs an Arm"),  # type: ignore[arg-type]
        (lambda: maps.reach(kinseek.load("cylindrical3").with_locked({}), WIDE, "branch"), "unknown measure"),
        (lambda: maps.best_base(UR5E, np.eye(4), np.eye(4), by="speed"), "by must be"),
        (lambda: maps.volume(maps.reach(UR5E, WIDE)), "prove=True"),
        (lambda: maps.open("no_such.zarr"), "no map in"),
    ],
)
def test_misuse_is_told(wrong: object, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(kinseek.KinseekError, match=told):
        wrong()  # type: ignore[operator]
    assert list(tmp_path.iterdir()) == []


def test_rings_need_a_first_joint_that_turns() -> None:
    rings = maps.Rings((0.0, 1.0, 0.5), (0.0, 1.0, 0.5), maps.orientations(12))
    narrow = UR5E.with_limits({UR5E.joint_names[0]: (-1.0, 1.0)})
    with pytest.raises(kinseek.InvalidMap, match="half a turn"):
        maps.reach(narrow, rings)
    slide = kinseek.Arm.from_dh([[0, 0, 0, 0], [0.5, 0, 0, 0]], [0, -3], [1, 3], kinds="PR")
    with pytest.raises(kinseek.InvalidMap, match="turns"):
        maps.reach(slide, rings)
    with pytest.raises(kinseek.InvalidMap, match="has black-box kinematics"):
        maps.reach(kinseek.Arm.from_fk(lambda q: np.eye(4), [0.0], [1.0], vectorized=False), rings)


@pytest.mark.parametrize("edited", ["reached", "branches", "more dimensions", "text", "renamed"])
def test_an_edited_map_is_rejected(edited: str) -> None:
    even = maps.orientations(12)
    grid = maps.Grid((0.2, 0.6, 0.2), (0.0, 0.2, 0.2), (0.0, 0.2, 0.2), even)
    m = maps.reach(kinseek.load("ur5e"), grid, what=("reached", "branches"))
    reads: list[Callable[[Any], object]] = [
        lambda d: maps.at(d, np.eye(4)),
        lambda d: maps.expand(d, grid),
    ]
    if edited == "more dimensions":
        m = m.expand_dims(time=2)
    elif edited == "text":
        m = m.assign(reached=m.reached.astype(str))
        reads.append(maps.capability)
    elif edited == "renamed":
        m, reads = m.rename(orientation="turn"), [maps.capability]
    else:
        m = m.drop_vars(edited)
        reads += [maps.capability] if edited == "reached" else []
    for read in reads:
        with pytest.raises(kinseek.InvalidMap, match=r"as maps\.open returns it"):
            read(m)
