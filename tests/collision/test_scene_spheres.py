"""The first pass of scenes: spheres, planes and points that prove what they say, against coal and against paper."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import kinseek
from cells import FACES, TETRAHEDRON, write_arm
from kinseek import Scene
from kinseek.collision import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere
from kinseek.collision.spheres import COUNT, FEW, Boxed, cover_of, cover_of_many, covers_of, halved
from kinseek.kernels.collision.gaps import DOUBT, FREE, TOUCH

pytest.importorskip("coal")
spatial = pytest.importorskip("scipy.spatial")

RNG = np.random.default_rng(0)
EGG = RNG.normal(size=(60, 3)) * [0.05, 0.1, 0.2] + [0.3, 0.2, 0.1]
SHAPES: list[Shape] = [
    Box((0.1, 0.5, 0.2)),
    Box((1.0, 1.0, 0.01)),
    Box((1.0, 1.0, 1e-8)),
    Sphere(0.2),
    Cylinder(0.1, 0.7),
    Capsule(0.1, 0.7),
    Mesh(TETRAHEDRON, FACES),
    Mesh(EGG, [[0, 1, 2]], name="egg"),  # type: ignore[arg-type]
    Mesh(TETRAHEDRON, FACES, hull=False),
    Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], hull=False),  # type: ignore[arg-type]
    Points(RNG.uniform(-0.3, 0.3, (50, 3)), 0.02),
]


def name_of(shape: Shape) -> str:
    return f"{type(shape).__name__}{len(shape.corners)}{'' if shape.is_hull else ' held'}"


def inside(shape: Shape) -> np.ndarray:
    """Points of a shape, many of them on its surface."""
    rng = np.random.default_rng(1)
    if isinstance(shape, Cylinder):
        angle, height = rng.uniform(0, 2 * np.pi, 4000), rng.uniform(-0.5, 0.5, 4000) * shape.length
        height[:2000] = np.sign(height[:2000]) * shape.length / 2
        return np.column_stack([shape.radius * np.cos(angle), shape.radius * np.sin(angle), height])
    if isinstance(shape, Points):
        corners = np.asarray(shape.cloud)
        shares = np.eye(len(corners))[rng.integers(0, len(corners), 4000)]
    else:
        corners = shape.corners
        shares = rng.dirichlet(np.full(len(corners), 2 / len(corners)), 4000)
    ways = rng.normal(size=(4000, 3))
    return np.asarray(shares @ corners + shape.thickness * ways / np.linalg.norm(ways, axis=1)[:, None])


@pytest.mark.slow
@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_outer_spheres_and_core_hold_the_shape(shape: Shape) -> None:
    cover, points = cover_of(shape), inside(shape)
    assert (cover.rough.shape, cover.outer.shape) == ((4, FEW), (4, COUNT))
    for spheres in (cover.rough, cover.outer):
        away = np.linalg.norm(points[:, None] - spheres[:3].T, axis=2) - spheres[3]
        assert away.min(axis=1).max() <= 1e-12
    local = (points - cover.core[:3, 3]) @ cover.core[:3, :3]
    beyond = np.linalg.norm(np.maximum(np.abs(local) - cover.half, 0), axis=1)
    assert beyond.max() <= shape.thickness + 1e-12
    assert cover.solid == shape.is_hull
    if len(points := shape.corners) > 4:  # No sphere is larger than one around all.
        assert (
            cover.outer[3].max()
            <= np.linalg.norm(points - points.mean(axis=0), axis=1).max() + shape.thickness + 1e-9
        )


@pytest.mark.parametrize("shape", SHAPES, ids=name_of)
def test_inner_spheres_lie_in_the_shape(shape: Shape) -> None:
    inner = cover_of(shape).inner
    real = inner[:, inner[3] > 0]
    assert real.shape[1] or isinstance(shape, Points | Mesh)
    if isinstance(shape, Points) or (isinstance(shape, Mesh) and not shape.hull):
        assert not real.shape[1]
        return
    ways = np.random.default_rng(2).normal(size=(500, 3))
    tips = (
        real[:3].T[:, None] + real[3][:, None, None] * ways / np.linalg.norm(ways, axis=1)[:, None]
    ).reshape(-1, 3)
    if isinstance(shape, Cylinder):
        assert np.hypot(tips[:, 0], tips[:, 1]).max() <= shape.radius + 1e-12
        assert np.abs(tips[:, 2]).max() <= shape.length / 2 + 1e-12
    elif isinstance(shape, Sphere | Capsule):
        half = shape.length / 2 if isinstance(shape, Capsule) else 0.0
        foot = np.clip(tips[:, 2], -half, half)
        assert np.linalg.norm(tips - foot[:, None] * [0, 0, 1], axis=1).max() <= shape.radius + 1e-12
    else:
        planes = spatial.ConvexHull(shape.corners).equations
        assert (tips @ planes[:, :3].T + planes[:, 3]).max() <= 1e-12
        assert real[3].max() > 0.1 * np.ptp(shape.corners, axis=0).min()


@pytest.mark.slow
def test_the_pieces_of_hulls_make_up_the_hulls() -> None:
    shapes = [SHAPES[0], SHAPES[1], SHAPES[4], SHAPES[6], SHAPES[7]]
    bodies = [Boxed.of(shape.corners, 0.0, exact=False) for shape in shapes]
    for count, (corners, centre) in zip((2, 4, 8, 16, 32), halved(bodies, COUNT), strict=True):
        assert len(centre) == count * len(bodies)
        volumes = [
            spatial.ConvexHull(corners.points[corners.piece == i], qhull_options="QJ").volume
            for i in range(len(centre))
        ]
        for body, volume in zip(bodies, np.reshape(volumes, (-1, count)).sum(axis=1), strict=True):
            assert volume == pytest.approx(body.hull.volume, rel=1e-6)


@pytest.mark.parametrize(
    ("shape", "most"), [(Cylinder(0.5, 0.02), 0.2), (Cylinder(0.1, 0.7), 0.14), (Box((1, 1, 0.01)), 0.16)]
)
def test_spheres_around_plates_and_rods_are_small(shape: Shape, most: float) -> None:
    assert cover_of(shape).outer[3].max() < most


def test_shapes_together_and_again_have_the_same_covers() -> None:
    shapes = [Mesh(size * SHAPES[7].corners, np.array([[0, 1, 2]])) for size in np.linspace(1, 2, 40)]
    for shape, cover in zip(shapes, covers_of(shapes), strict=True):
        again = Mesh(shape.vertices, shape.faces, name="another name")
        assert again == shape
        assert cover_of(again) is cover
    assert len({id(cover) for cover in covers_of([*shapes, *shapes])}) == len(shapes)
    assert Box((0.1, 0.2, 0.3)) == Box([0.1, 0.2, 0.3])
    assert Cylinder(0.1, 0.2) != Capsule(0.1, 0.2) != Capsule(0.2, 0.1)
    assert Mesh(TETRAHEDRON, FACES) != Mesh(TETRAHEDRON, FACES, hull=False)


def test_what_holds_two_shapes_holds_both() -> None:
    points = np.concatenate([SHAPES[0].corners, SHAPES[7].corners + 1.0])
    cover = cover_of_many(points, 0.05)
    assert not cover.solid
    assert (cover.inner[3] < 0).all()
    for shape, off in ((SHAPES[0], 0.0), (SHAPES[7], 1.0)):
        away = np.linalg.norm(inside(shape)[:, None] + off - cover.rough[:3].T, axis=2) - cover.rough[3]
        assert away.min(axis=1).max() <= -0.05 + 1e-12


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_arm(tmp_path_factory.mktemp("arm"))


def crowded(file: Path) -> tuple[kinseek.Arm, Scene]:
    """A scene with all kinds of shapes in it."""
    arm = kinseek.load(file, tip="tip")
    scene = Scene.of(arm, meshes=[file.parents[1] / "packages"], joints={"grip": 0.04}, padding=0.002)
    rng = np.random.default_rng(4)
    for number, shape in enumerate(SHAPES):
        way = rng.normal(size=3)
        place = rng.uniform(0.7, 1.3) * way / np.linalg.norm(way)
        scene.add(f"thing{number}", shape, kinseek.pose(place, rpy=rng.uniform(-3, 3, 3)))
    scene.attach("load", Cylinder(0.02, 0.1), to="tip", pose=kinseek.pose([0, 0, 0.1]))
    return arm, scene


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [0.0, 0.03])
def test_nothing_is_wrongly_called_free_or_touching(file: Path, clearance: float) -> None:
    arm, scene = crowded(file)
    q = arm.sample(1500, seed=7)
    engine = scene._engine
    verdicts, doubts = engine.broad.sort_out(q, clearance, 1e-6)
    exact = engine.exactly_free(q, clearance)
    assert exact[verdicts == FREE].all()
    assert not exact[verdicts == TOUCH].any()
    assert (verdicts == FREE).sum() > 0.5 * exact.sum()  # Most are told,
    assert (verdicts == TOUCH).sum() > 0.3 * (~exact).sum()
    assert (doubts.any(axis=1) | (verdicts != DOUBT)).all()  # and of the others which pairs to look at.
    free = scene.free(q, clearance)
    assert (free == exact).all()
    assert [scene.free(one, clearance) for one in q[:50]] == free[:50].tolist()
    assert (scene.free(q, clearance, threads=2) == free).all()


@pytest.mark.slow
def test_bounds_are_bounds_and_the_nearest_is_the_nearest(file: Path) -> None:
    arm, scene = crowded(file)
    engine, q = scene._engine, arm.sample(40, seed=8)
    distances = np.array([[near.distance for near in engine.near(one)] for one in q])
    for steps in (0, 24):
        bounds = engine.broad.bounds(q, steps)
        assert (bounds[bounds > 0] <= distances[bounds > 0] + 2e-6).all()
        assert (bounds > 0).mean() > 0.5
    np.testing.assert_allclose(scene.distance(q), distances.min(axis=1), atol=1e-12)


@pytest.mark.slow
def test_a_cloud_is_looked_at_handful_by_handful() -> None:
    arm = kinseek.load("ur5e")
    scene = Scene.of(arm, capsules=0.05)
    rng = np.random.default_rng(9)
    cloud = rng.uniform(-1.2, 1.2, (700, 3))
    cloud[:, 2] = np.abs(cloud[:, 2]) - 1.2 * (rng.uniform(size=700) < 0.5)
    scene.add_points("cloud", cloud[np.linalg.norm(cloud, axis=1) > 0.7], 0.01)
    engine, q = scene._engine, arm.sample(300, seed=3)
    for clearance in (0.0, 0.02):
        verdicts, doubts = engine.broad.sort_out(q, clearance, 1e-6)
        exact = engine.exactly_free(q, clearance)
        assert exact[verdicts == FREE].all()
        assert not exact[verdicts == TOUCH].any()
        assert doubts.shape == (300, len(engine.pairs))
        assert (verdicts == FREE).sum() > 0.5 * exact.sum()
        assert (scene.free(q, clearance) == exact).all()
    distances = np.array([[near.distance for near in engine.near(one)] for one in q[:30]])
    bounds = engine.bounds(q[:30])
    assert bounds.shape == distances.shape
    assert (bounds[bounds > 0] <= distances[bounds > 0] + 1e-5).all()
    np.testing.assert_allclose(scene.distance(q[:30]), distances.min(axis=1), atol=1e-12)


def test_joint_values_far_outside_are_left_to_coal() -> None:
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-1e6, -1e6], [1e6, 1e6])
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("wall", (0.1, 2.0, 2.0), kinseek.pose([1.0, 0, 0]))
    turns = 2 * np.pi * 100_000
    q = np.array([[0.0, 0.0], [turns, 0.0], [2.0, 0.0], [2.0 - turns, 0.0]])
    verdicts, _ = scene._engine.broad.sort_out(q, 0.0, 1e-6)
    assert verdicts.tolist() == [TOUCH, DOUBT, FREE, DOUBT]
    assert scene.free(q).tolist() == [False, False, True, True]


@pytest.mark.slow
@pytest.mark.skipif(
    find_spec("example_robot_data") is None and find_spec("cmeel") is None, reason="needs meshes"
)
def test_a_panda_among_boxes_agrees_with_coal() -> None:
    cmeel = find_spec("cmeel")
    assert cmeel is not None
    assert cmeel.origin is not None
    robots = Path(cmeel.origin).parents[1] / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
    if not robots.is_dir():
        pytest.skip("needs the meshes of example-robot-data")
    arm = kinseek.load(robots / "panda_description" / "urdf" / "panda.urdf", tip="panda_hand")
    scene = Scene.of(arm, meshes=[robots.parent, robots])
    rng = np.random.default_rng(0)
    for number in range(20):
        size, place = rng.uniform(0.05, 0.2, 3), rng.uniform(-1, 1, 3)
        scene.add_box(f"box{number}", size, kinseek.pose(place, rpy=rng.uniform(-3, 3, 3)))
    q = arm.sample(10_000, seed=1)
    verdicts, _ = scene._engine.broad.sort_out(q, 0.0, 1e-6)
    exact = scene._engine.exactly_free(q, 0.0)
    assert exact[verdicts == FREE].all()
    assert not exact[verdicts == TOUCH].any()
    assert (verdicts == DOUBT).mean() < 0.1
