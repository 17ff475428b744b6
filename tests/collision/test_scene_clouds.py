"""Point clouds and occupancy grids in a scene, against distances that NumPy computes point by point."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from kinseek import InvalidScene, Scene
from kinseek.collision import Box, Points, Voxels
from kinseek.collision.clouds import GRAIN
from kinseek.collision.spheres import covers_of_cloud, neighbours
from kinseek.kernels.collision.gaps import FREE, TOUCH

ARM = kinseek.Arm.from_dh(
    [[0.0, np.pi / 2, 0.2, 0.0], [0.4, 0.0, 0.0, 0.0], [0.4, 0.0, 0.0, 0.0]], [-3.0] * 3, [3.0] * 3
)
RADIUS = 0.05
"""Radius of the capsules around the links of the arm [m]."""


def gaps(q: np.ndarray, places: np.ndarray, half: float, radius: float) -> np.ndarray:
    """Distances of the arm from cubes about points, made thicker, (k, n) -> (k,) [m].

    The distance of a point of a segment from a cube is convex along the segment, so that thirds close in on the least one.
    """
    found = []
    for one in q:
        c, s = np.cos(one[0]), np.sin(one[0])
        rise = np.cumsum([0.0, *one[1:]])[1:]
        legs = 0.4 * np.column_stack([c * np.cos(rise), s * np.cos(rise), np.sin(rise)])
        corners = np.cumsum([[0.0, 0.0, 0.0], [0.0, 0.0, 0.2], *legs], axis=0)
        a, b = corners[:-1, None], corners[1:, None]
        low, high = np.zeros((3, len(places), 1)), np.ones((3, len(places), 1))

        def away(t: np.ndarray, a: np.ndarray = a, b: np.ndarray = b) -> np.ndarray:
            off = np.abs(a + t * (b - a) - places) - half
            return np.asarray(np.linalg.norm(np.maximum(off, 0.0), axis=2, keepdims=True))

        for _ in range(36):
            third, other = low + (high - low) / 3, high - (high - low) / 3
            left = away(third) <= away(other)
            low, high = np.where(left, low, third), np.where(left, other, high)
        found.append(float(away((low + high) / 2).min()) - radius - RADIUS)
    return np.array(found)


def room(count: int, seed: int = 0) -> np.ndarray:
    """Points of a wall, a shelf and a few that fly, (count, 3) [m]."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.9, 0.9, (count, 3))
    points[: count // 2, 0] = 0.55 + rng.normal(0.0, 1e-3, count // 2)
    points[count // 2 : count - 20, 2] = -0.25
    return np.asarray(points[np.linalg.norm(points, axis=1) > 0.4])


def grid() -> np.ndarray:
    """A wall, a block and single cells of 4 cm around the arm, (i, j, k) bool."""
    occupied = np.zeros((48, 40, 40), dtype=bool)
    occupied[36:38, 10:30, 5:25] = True
    occupied[10:18, 32:38, 10:20] = True
    occupied[np.random.default_rng(1).uniform(size=occupied.shape) < 2e-4] = True
    occupied[17:31, 13:27, 13:32] = False
    return occupied


CORNER = kinseek.pose([-0.96, -0.8, -0.8])
SHAPES: dict[str, tuple[Any, Any, np.ndarray, float, float]] = {
    "points": (Points(room(1000), 0.01), None, room(1000), 0.0, 0.01),
    "few points": (Points(room(1000)[:9], 0.1), None, room(1000)[:9], 0.0, 0.1),
    "voxels": (
        Voxels(grid(), 0.04),
        CORNER,
        (np.argwhere(grid()) + 0.5) * 0.04 + CORNER[:3, 3],
        0.02,
        0.0,
    ),
}


def scene_of(name: str) -> Scene:
    scene = Scene.of(ARM, capsules=RADIUS)
    scene.add("cloud", *SHAPES[name][:2])
    scene.allow("link1", "link3")  # The links among themselves are not the subject.
    return scene


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_distances_are_those_of_numpy(name: str) -> None:
    scene, q = scene_of(name), ARM.sample(100, seed=2)
    truth = gaps(q, *SHAPES[name][2:])
    assert 20 < (truth > 0).sum() < 100
    measured, engine = scene.distance(q), scene._engine
    apart = truth > 0
    np.testing.assert_allclose(measured[apart], truth[apart], atol=1.5e-5)
    assert (measured[~apart] < 2e-5).all()
    for clearance in (0.0, 0.03):
        clear = np.abs(truth - clearance) > 3e-5
        hit = np.array([len(scene.hits(one, clearance)) > 0 for one in q])
        assert (hit == (truth <= clearance))[clear].all()
        verdicts = engine.broad.verdicts(q, clearance, 1e-6)[0]
        assert (truth[verdicts == FREE] > clearance).all()
        assert not engine.exactly_free(q[verdicts == TOUCH], clearance).any()
        assert (scene.free(q, clearance) == engine.exactly_free(q, clearance)).all()
    for one, least in zip(q, truth, strict=True):
        lower = scene.margins.distances(one).min()
        assert lower < 0 or lower <= least + 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["points", "voxels"])
def test_a_motion_around_them_is_free_at_every_sample(name: str) -> None:
    scene = scene_of(name)
    q = ARM.sample(400, seed=4)
    q = q[scene.free(q, 0.01)][:25]
    motions = scene.free_motion(q[:-1], q[1:])
    assert 3 < motions.sum() < len(motions) - 3
    part = np.linspace(0.0, 1.0, 20)[:, None]
    for k in np.flatnonzero(motions)[:3]:
        assert gaps(q[k] + part * (q[k + 1] - q[k]), *SHAPES[name][2:]).min() > 0
    k = int(np.flatnonzero(~motions)[0])
    path = scene.plan(q[k], q[k + 1], time_limit=20.0)
    assert path.success
    assert scene.free_motion(path.q[:-1], path.q[1:]).all()
    assert gaps(path.q[:: max(len(path.q) // 20, 1)], *SHAPES[name][2:]).min() > 0


@pytest.mark.slow
@settings(max_examples=40)
@given(
    st.integers(1, 700), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01]), st.sampled_from([1, 0.0])
)
def test_covers_contain_every_piece_and_lie_in_some(count: int, seed: int, half: float, flat: float) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3)).round(1) * [1.0, 1.0, flat]
    if half:
        cells = np.unique(np.round((points - points.min(axis=0)) * 10).astype(int), axis=0)
        occupied = np.zeros(cells.max(axis=0) + 1, dtype=bool)
        occupied[tuple(cells.T)] = True
        cloud: Points | Voxels = Voxels(occupied, 2 * half)
    else:
        cloud = Points(points, 0.02)
    covers = covers_of_cloud(cloud)
    held = np.zeros(len(cloud.places), dtype=int)
    cube = cloud.half * np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
    for cover in covers:
        box = np.abs(cloud.places - cover.core[:3, 3]) + cloud.half <= cover.half + 1e-9
        held |= box.all(axis=1)
        for centre, radius in zip(cover.inner[:3].T, cover.inner[3], strict=True):
            assert np.linalg.norm(cloud.places - centre, axis=1).min() < 1e-9
            assert radius == (cloud.half or 0.02)
    assert held.all()
    far = cloud.places[:, None, None] + cube[:, None]
    for some in ([cover.rough for cover in covers], [cover.outer for cover in covers]):
        spheres = np.concatenate(some, axis=1)
        gap = spheres[3] - np.linalg.norm(far - spheres[:3].T, axis=3).max(axis=1)
        assert (gap.max(axis=1) >= cloud.thickness - 1e-9).all()
    for cover in covers:
        assert np.linalg.norm(cover.corners - cover.ball[:3], axis=1).max() <= cover.ball[3] + 1e-9


def test_neighbours_are_all_points() -> None:
    points = np.random.default_rng(0).normal(size=(1000, 3))
    groups = neighbours(points, 64)
    assert groups.shape == (64, 16, 3)
    assert {tuple(point) for point in groups.reshape(-1, 3)} == {tuple(point) for point in points}
    assert np.ptp(groups, axis=1).prod(axis=1).sum() < 0.3 * np.ptp(points, axis=0).prod()


def test_the_work_of_a_check_does_not_grow_with_the_points() -> None:
    pairs = []
    for count in (20_000, 100_000):
        scene = Scene.of(ARM, capsules=RADIUS)
        scene.add_points("cloud", room(count), 0.01)
        broad = scene._engine.broad
        pairs.append(broad._pairs)
        q = ARM.sample(200, seed=1)
        assert (broad.verdicts(q, 0.0, 1e-6)[0] == FREE).sum() > 0.7 * scene.free(q).sum()
    assert pairs[0] == pairs[1] <= 128 * 3 + 3


@given(st.integers(1, 300), st.integers(0, 2**32 - 1), st.sampled_from([1e-4, 0.01, 0.3]))
def test_merged_balls_contain_the_balls(count: int, seed: int, tolerance: float) -> None:
    points = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3))
    merged = Points.merged(points, 0.02, tolerance)
    assert 0.02 <= merged.radius <= 0.02 + tolerance + 1e-12
    away = np.linalg.norm(points[:, None] - merged.places, axis=2).min(axis=1)
    assert (away + 0.02 <= merged.radius + 1e-12).all()
    assert len(merged.places) <= count
    assert len(merged.places) < 100 or tolerance < 0.3


def test_a_cloud_is_simplified_and_says_so() -> None:
    scene = Scene.of(ARM, capsules=RADIUS)
    rng = np.random.default_rng(0)
    cloud = np.column_stack([rng.uniform(-1, 1, (1_200_000, 2)), np.full(1_200_000, -0.5)])
    with pytest.raises(InvalidScene, match=r"at most 1,000,000 points, got 1,200,000: .* simplify=0\.002"):
        scene.add_points("cloud", cloud, 0.01)
    scene.add_points("cloud", cloud, 0.01, simplify=0.02)
    assert scene.notes[-1].startswith("'cloud' is simplified to ")
    shape = scene._bodies["cloud"].parts[0].shape
    assert isinstance(shape, Points)
    assert len(shape.places) < 10_000
    assert 0.01 < shape.radius <= 0.03
    scene.add_points("cloud", cloud[:10], 0.01, replace=True)
    assert not any("'cloud'" in note for note in scene.notes)


def test_a_cloud_is_replaced() -> None:
    scene = Scene.of(ARM, capsules=RADIUS)
    q = [0.0, 0.0, 0.0]  # Stretched out along x.
    scene.add_points("cloud", [[0.6, 0.0, 0.2]], 0.01, replace=True)
    assert not scene.free(q)
    scene.allow("cloud", "link3")
    before = [str(pair) for pair in scene.pairs]
    allowed = scene.free(q)
    scene.add_points("cloud", [[0.6, 0.0, 0.2], [0.9, 0.0, 0.2]], 0.01, replace=True)
    assert [str(pair) for pair in scene.pairs] == before
    assert scene.free(q) == allowed
    with pytest.raises(InvalidScene, match="'cloud' is a body of the scene already"):
        scene.add_points("cloud", [[0.6, 0.0, 0.2]], 0.01)
    with pytest.raises(InvalidScene, match="NaN"):
        scene.add_points("cloud", [[np.nan, 0.0, 0.2]], 0.01, replace=True)
    assert [str(pair) for pair in scene.pairs] == before
    scene.add_voxels("cloud", np.ones((2, 2, 2), dtype=bool), 0.05, kinseek.pose([3, 3, 3]), replace=True)
    assert scene.free(q)
    scene.attach("load", Box((0.1, 0.1, 0.1)), to=ARM.tip)
    scene.add_arm("other", Scene.of(ARM, capsules=RADIUS), q, kinseek.pose([5, 5, 0]))
    for name in ("link2", "other", next(b for b in scene.bodies if b.startswith("other/"))):
        with pytest.raises(InvalidScene, match="already"):
            scene.add_points(name, [[0.6, 0.0, 0.2]], 0.01, replace=True)


@pytest.mark.parametrize(
    ("occupied", "size", "message"),
    [
        (np.ones((2, 2)), 0.1, r"occupied must be Boolean, with 3 dimensions, got float64 of shape \(2, 2\)"),
        (np.ones((2, 2, 2)), 0.1, r"got float64 of shape \(2, 2, 2\).* grid > 0\.5"),
        (np.ones((2, 2), dtype=bool), 0.1, r"with 3 dimensions, got bool of shape \(2, 2\)"),
        ([[[True], [True, False]]], 0.1, "occupied must be an array with 3 dimensions"),
        ("full", 0.1, "occupied must be Boolean"),
        (np.zeros((2, 2, 2), dtype=bool), 0.1, r"1 to 1,000,000 occupied cells, got 0 in a grid of shape"),
        (np.ones((101, 100, 100), dtype=bool), 0.1, "got 1,010,000 in a grid"),
        (np.ones((1, 1, 40_000), dtype=bool), 0.1, r"at most 32,768 cells along each axis, got shape"),
        (
            np.ones((1, 1, 10), dtype=bool),
            1e5 + 1e3,
            r"at most 1e\+06 m long along each axis, got 1\.01e\+06",
        ),
        (np.ones((2, 2, 2), dtype=bool), 0.0, "size must be a length above 0 m, got 0"),
        (np.ones((2, 2, 2), dtype=bool), np.nan, "size must be a length above 0 m, got nan"),
        (
            np.ma.masked_array(np.eye(2, dtype=bool)[None], mask=[[[False, True], [False, False]]]),
            0.1,
            "1 of 4 cells are masked",
        ),
    ],
)
def test_grids_that_are_none_are_rejected(occupied: Any, size: float, message: str) -> None:
    scene = Scene.of(ARM, capsules=RADIUS)
    with pytest.raises(InvalidScene, match=message):
        scene.add_voxels("grid", occupied, size)
    assert "grid" not in scene.bodies


@pytest.mark.parametrize(
    ("cloud", "options", "message"),
    [
        (np.zeros((0, 3)), {}, r"shape \(k, 3\) with k at least 1, got \(0, 3\); where .* remove the cloud"),
        (np.zeros((4, 2)), {}, r"got \(4, 2\)"),
        ([[0.0, np.inf, 0.0]], {}, "1 of 1 points hold NaN or infinity"),
        (
            np.ma.masked_array(np.zeros((2, 3)), mask=np.eye(2, 3, dtype=bool)),
            {},
            "2 of 6 numbers are masked",
        ),
        (np.full((1, 3), 1j), {}, "3 of 3 numbers have an imaginary part"),
        ([[0.0, 0.0, 1.0]], {"radius": 0.0}, "radius must be a length above 0 m, got 0"),
        ([[0.0, 0.0, 1.0]], {"radius": -0.1}, r"radius must be a length above 0 m, got -0\.1"),
        ([[0.0, 0.0, 1.0]], {"simplify": 0.0}, "simplify must be a length above 0 m, got 0"),
        (np.zeros((0, 3)), {"simplify": 0.01}, "with k at least 1"),
    ],
)
def test_clouds_that_are_none_are_rejected(cloud: Any, options: dict[str, Any], message: str) -> None:
    scene = Scene.of(ARM, capsules=RADIUS)
    with pytest.raises(InvalidScene, match=message):
        scene.add_points("cloud", cloud, **{"radius": 0.01, **options})
    with pytest.raises(InvalidScene, match="cloud or grid cannot be attached"):
        scene.attach("cloud", Points([[0.0, 0.0, 0.0]], GRAIN), to=ARM.tip)


def test_voxels_of_any_size_lie_where_they_should() -> None:
    occupied = np.zeros((3, 2, 32_768), dtype=bool)
    occupied[2, 1, 0] = occupied[0, 0, -1] = True
    for size in (1e-7, 0.013, 30.0):
        boxes = np.array(Voxels(occupied, size).geometry().toBoxes())[:, :3]
        expected = size * np.array([[0.5, 0.5, 32_767.5], [2.5, 1.5, 0.5]])
        np.testing.assert_allclose(sorted(boxes.tolist()), expected, rtol=1e-12)
