"""Motions that are called free are free at every point of them that is looked at, and those that are free are called so."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from cells import write_arm
from inlined import inlined
from kinseek import Scene
from kinseek.collision import motion
from kinseek.collision.motion import Speeds
from kinseek.kernels.collision.gaps import FREE, TOUCH
from kinseek.kernels.collision.motions import motion_of_pair

pytest.importorskip("pinocchio")


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> tuple[kinseek.Arm, Scene]:
    folder: Path = tmp_path_factory.mktemp("motion")
    arm = kinseek.load(write_arm(folder), tip="tip")
    scene = Scene.of(arm, [folder / "packages"], joints={"grip": 0.04})
    scene.add_box("plate", (0.6, 0.6, 0.001), kinseek.pose([0.5, 0.0, 0.6], rpy=[0.2, 0.1, 0.0]))
    scene.add_capsule("pole", 0.02, 1.5, kinseek.pose([-0.4, 0.3, 0.6]))
    scene.add_points("cloud", np.random.default_rng(0).uniform([-1, -1, 0], [1, 1, 1.5], (30, 3)), 0.01)
    return arm, scene


def along(a: np.ndarray, b: np.ndarray, count: int) -> np.ndarray:
    return np.asarray(a + np.linspace(0.0, 1.0, count)[:, None] * (b - a))


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    length=st.sampled_from([0.05, 0.3, 1.0]),
    clearance=st.sampled_from([0.0, 0.02]),
)
@settings(max_examples=30)
def test_a_motion_called_free_is_free_and_one_that_is_free_is_called_so(
    cell: tuple[kinseek.Arm, Scene], seed: int, length: float, clearance: float
) -> None:
    arm, scene = cell
    q = arm.sample(50, seed=seed)
    a = q[np.argmax(scene.free(q, clearance))]
    b = a + length * (q[-1] - a)
    points = scene.free(along(a, b, 200), clearance)
    if scene.free_motion(a, b, clearance):
        assert points.all()
    elif (
        points.all()
    ):  # Then it came near to touching between two points: it is not free with a little more clearance.
        assert not scene.free(along(a, b, 200), clearance + 0.01).all()


@pytest.mark.slow
def test_ten_thousand_points_of_free_motions_do_not_touch(cell: tuple[kinseek.Arm, Scene]) -> None:
    arm, scene = cell
    ends = arm.sample(80, seed=4).reshape(2, 40, arm.dof)
    free = scene.free_motion(ends[0], ends[0] + 0.4 * (ends[1] - ends[0]))
    assert free.shape == (40,)
    assert free.sum() >= 3
    for number in np.flatnonzero(free)[:3]:
        a, b = ends[0, number], ends[0, number] + 0.4 * (ends[1, number] - ends[0, number])
        assert scene.free(along(a, b, 10_000)).all()


@pytest.mark.slow
def test_motions_called_free_do_not_touch_by_an_outside_check(cell: tuple[kinseek.Arm, Scene]) -> None:
    """MuJoCo has the same shapes and pairs, its own forward kinematics and its own collisions."""
    pytest.importorskip("mujoco")
    from benchmarks.outside import Outside

    arm, scene = cell
    outside = Outside(scene, arm)
    q = arm.sample(2000, seed=11)
    assert np.array_equal(outside.depths(q) > 0, ~scene.free(q))  # It can tell what touches.
    q = q[scene.free(q)][:400]
    a = q[:200]
    b = a + np.random.default_rng(0).uniform(0.0, 0.5, (200, 1)) * (q[200:] - a)
    free = scene.free_motion(a, b)
    assert 40 < free.sum() < 200
    for one, other in zip(a[free], b[free], strict=True):
        assert outside.depths(along(one, other, 200)).max() == 0.0
    touching = sum(
        bool(outside.depths(along(*ends, 200)).max()) for ends in zip(a[~free], b[~free], strict=True)
    )
    assert (
        touching > 0.9 * (~free).sum()
    )  # And what is not called free does touch, but for what comes very near.


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [0.0, 0.01])
def test_the_broad_phase_alone_agrees_with_the_pairs_one_by_one(deviation: float) -> None:
    arm = kinseek.load("ur5e")
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("table", (1.0, 1.6, 0.04), kinseek.pose([0.55, 0.0, -0.06]))
    scene.add_sphere("ball", 0.2, kinseek.pose([0.4, 0.2, 0.5]))
    speeds, engine = scene._made.speeds, scene._engine
    q = arm.sample(600, seed=5)
    q = q[scene.free(q)][:240]
    a = q[:120]
    b = a + np.random.default_rng(1).uniform(0.0, 0.6, (120, 1)) * (q[120:240] - a)
    for clearance in (0.0, 0.01):
        rates = speeds.of(a, b)
        least = motion._least(speeds, a, b, clearance, np.full_like(a, deviation))
        verdicts, _, _ = engine.broad.free_motions(a, b - a, speeds.levers(a, b), least)
        slowly = np.isnan(motion._stops_of(engine, rates, a, b, least))
        decided = np.isin(verdicts, (FREE, TOUCH))
        assert np.array_equal(verdicts[decided] == FREE, slowly[decided])
        assert decided.sum() > 110
        assert slowly.sum() > 10
        assert (~slowly).sum() > 10


def test_a_thin_plate_is_not_jumped_over() -> None:
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    scene = Scene.of(arm, capsules=0.001)
    scene.add_box("plate", (0.3, 1e-4, 0.3), kinseek.pose([0.9, 0.0, 0.0]))
    a, b = np.array([-1.3, 0.0]), np.array([1.0, 0.0])
    assert scene.free(along(a, b, 8)).all()  # A few samples miss it.
    assert not scene.free_motion(a, b)
    assert scene.free_motion(a, [-0.2, 0.0])
    assert scene.free_motion([a, a], [b, [-0.2, 0.0]]).tolist() == [False, True]
    assert scene.free_motion(a, a)
    (hit,) = scene.hits_between(a, b)
    assert hit.b == "plate"
    assert scene.hits_between(a, [-0.2, 0.0]) == ()
    with pytest.raises(kinseek.InvalidProblem, match="do not broadcast"):
        scene.free_motion(np.zeros((2, 2)), np.zeros((3, 2)))


def test_samples_are_counted_up_to_the_first_that_is_not_free(cell: tuple[kinseek.Arm, Scene]) -> None:
    arm, scene = cell
    a, b = arm.sample(400, seed=3).reshape(2, 200, -1)
    counts = np.random.default_rng(2).integers(1, 30, 200)
    for clearance in (0.0, 0.02):
        found = scene.free_samples(a, b, counts, clearance)
        for one, other, count, free in zip(a, b, counts, found, strict=True):
            shares = np.arange(1, count + 1)[:, None] / count
            first = np.argmin(np.append(scene.free(one + shares * (other - one), clearance), False))
            assert free == first
    assert len(np.unique(found)) > 5
    assert (found == counts).any()
    assert scene.free_samples(a[0], a[0], 3) == 3 * scene.free(a[0])
    for wrong in (np.zeros(200, dtype=int), counts[:-1], counts + 0.5, counts + 2**40):
        with pytest.raises(kinseek.InvalidProblem, match="counts must be integers from 1 to 1,000,000"):
            scene.free_samples(a, b, wrong)


def test_no_point_moves_faster_than_said(cell: tuple[kinseek.Arm, Scene]) -> None:
    arm, scene = cell
    engine = scene._engine
    a, b = arm.sample(2, seed=9)
    b = a + 0.3 * (b - a)
    rates = Speeds(arm.chain, engine).of(a[None], b[None])[0]
    steps = 40
    distances = np.array([[near.distance for near in engine.near(q)] for q in along(a, b, steps + 1)])
    apart = (distances[1:] > 1e-4) & (distances[:-1] > 1e-4)
    changed = np.where(apart, np.abs(np.diff(distances, axis=0)), 0.0)
    assert (changed <= rates / steps + 2e-6).all()
    assert (
        changed.max(axis=0).sum() > 0.05 * rates.sum() / steps
    )  # The bound is not a hundred times too large.


@pytest.mark.parametrize("name", ["panda", "scara4", "ur10e_rail"])
def test_no_point_bends_more_than_said(name: str) -> None:
    arm = kinseek.load(name)
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("wall", (0.1, 2.0, 2.0), kinseek.pose([9.0, 0.0, 0.0]))
    engine, moments = scene._engine, np.linspace(0.0, 1.0, 201)
    closest = 0.0
    for a, b in arm.sample(20, seed=3).reshape(10, 2, -1):
        q = along(a, b, 201)
        travel = np.abs(arm.chain.multiplier * (b - a)[arm.chain.leader])
        levers = Speeds(arm.chain, engine).levers(a[None], b[None])[0]
        places = []
        for one in q:
            engine.place(one)
            places.append([place.homogeneous.copy() for place in engine._placed.oMg])
        for n, pair in enumerate(engine.pairs):
            first, last = sorted(pair, key=lambda i: engine.solids[i].joint)
            point = np.append(engine.solids[last].shape.corners[0], 1.0)
            x = np.array([np.linalg.solve(each[first], each[last] @ point)[:3] for each in places])
            bends = np.linalg.norm(np.diff(x, 2, axis=0), axis=1) / (moments[1] - moments[0]) ** 2
            bound = inlined(motion_of_pair)(travel, levers[n])
            assert np.linalg.norm(np.diff(x, axis=0), axis=1).sum() <= bound.rate + 1e-9
            assert bends.max() <= bound.bend + 1e-6
            closest = max(closest, bends.max() / bound.bend if bound.bend else 0.0)
    assert closest > 0.3  # The bound is not a hundred times too large.


def test_every_motion_near_a_free_one_is_free() -> None:
    arm = kinseek.load("ur5e")
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("wall", (0.1, 2.0, 2.0), kinseek.pose([0.75, 0.0, 0.0]))
    rng = np.random.default_rng(6)
    q0 = rng.uniform(-1.5, 1.5, (200, 6))
    q1 = q0 + rng.uniform(-0.2, 0.2, (200, 6))
    around = rng.uniform(0.0, 0.05, (200, 6))
    free = scene.free_motion(q0, q1, 0.01, around)
    assert 20 < free.sum() < scene.free_motion(q0, q1, 0.01).sum()
    share = np.linspace(0.0, 1.0, 12)[:, None]
    for i in np.flatnonzero(free):
        off = rng.choice([-1.0, 1.0], (12, 6)) * around[i]
        assert scene.free(q0[i] + share * (q1[i] - q0[i]) + off, 0.01).all()
    np.testing.assert_array_equal(
        scene.free_motion(q0, q1, 0.01, np.zeros(6)), scene.free_motion(q0, q1, 0.01)
    )
    with pytest.raises(kinseek.InvalidProblem, match="around must be one deviation of each joint"):
        scene.free_motion(q0[0], q1[0], 0.0, -around[0])
