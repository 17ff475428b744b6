"""Maps: the grid of orientations, the first joint divided out, whole cells, what is read from a map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import maps
from kinseek.maps.cell import whole_cell
from kinseek.maps.cells import EMPTY, REACHED, UNDECIDED, judged
from kinseek.maps.orientations import ball
from kinseek.maps.search import reached, ruled_out

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


def test_orientations_are_as_even_as_their_number_allows() -> None:
    """No cell can be smaller than a ball of its volume; Ω - sin Ω over π is the share of SO(3) in a ball."""
    for count in (72, 576, 4608):
        grid = maps.orientations(count)
        assert len(grid) == count
        radius = grid.covering_radius
        assert 1.0 < (radius - np.sin(radius)) / np.pi * len(grid) < 4.0


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
            P = part.spread(300)
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
    P = cell.spread(4000)
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
    assert not maps.at(m, kinseek.pose([3.0, 0.0, 0.0]))["inside"]
    share = maps.capability(m)
    assert share.values == pytest.approx((m.reached.values == 1).mean(axis=-1))


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


def test_what_is_proved_empty_holds_no_pose() -> None:
    """Cells that a pose of the arm lies in, stretched out and at limits too, are never called empty."""
    grid = maps.Grid((-1.2, 1.2, 0.05), (-1.2, 1.2, 0.05), (-1.2, 1.5, 0.05), maps.orientations(4608))
    q = UR5E.sample(150, seed=5)
    q[::3, 2] = 0.0  # The elbow: the edge of reach.
    q[1::5] = np.where(np.random.default_rng(1).random(q[1::5].shape) < 0.5, UR5E.lower, UR5E.upper)
    cells = np.stack(grid.cells_of(UR5E.fk(q)), axis=1)
    known = [
        judged(UR5E, grid, tuple(int(i) for i in index), 0, 300)[0]
        for index in cells[(cells >= 0).all(axis=1)]
    ]
    assert len(known) > 120
    assert EMPTY not in known
    others = np.random.default_rng(2).integers(grid.shape, size=(150, 4))
    verdicts = [judged(UR5E, grid, tuple(int(i) for i in index), 0, 300)[0] for index in others]
    assert verdicts.count(EMPTY) > 40


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
    assert 0.0 < poses.touched < poses.most < grid.volume
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


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda: maps.orientations(0), "whole number from 1"),
        (lambda: maps.Grid((-1, 1, 1e-4), (-1, 1, 1e-4), (-1, 1, 1e-4), maps.orientations(72)), "too large"),
        (lambda: maps.Grid((-1, 1, 0.3), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "must divide"),
        (lambda: maps.Grid((1, -1, 0.1), (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "from < to"),
        (lambda: maps.Grid("abc", (-1, 1, 0.1), (-1, 1, 0.1), maps.orientations(72)), "from, to, step"),  # type: ignore[arg-type]
        (lambda: maps.Rings((-1, 1, 0.5), (-1, 1, 0.5), maps.orientations(72)), "radius begins"),
        (lambda: maps.reach(UR5E, WIDE, ("reach",)), "unknown measure 'reach'"),
        (lambda: maps.reach(UR5E, WIDE, depth=-1), "depth must be"),
        (lambda: maps.reach(UR5E, WIDE, position_tolerance=-1.0), "position_tolerance"),
        (lambda: maps.reach(UR5E, (0, 1)), "must be a maps.Grid"),  # type: ignore[arg-type]
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
    with pytest.raises(kinseek.InvalidMap, match="is a function"):
        maps.reach(kinseek.Arm.from_fk(lambda q: np.eye(4), [0.0], [1.0], vectorized=False), rings)
