"""Scenes, against pinocchio's own reading of the same file, and against geometry that can be worked out by hand."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from cells import FACES, TETRAHEDRON, box_mesh, scene_of, write_arm, write_obj, write_stl
from kinseek import InvalidScene, Scene
from kinseek.collision import Box, Capsule, Cylinder, Mesh, Points, Sphere
from kinseek.collision.shapes import LEAST_LENGTH, MOST_LENGTH, Shape

pin = pytest.importorskip("pinocchio")
coal = pytest.importorskip("coal")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_arm(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def arm(file: Path) -> kinseek.Arm:
    return kinseek.load(file, tip="tip")


@pytest.fixture
def scene(arm: kinseek.Arm) -> Scene:
    return scene_of(arm)


def witness(arm: kinseek.Arm, file: Path, q: np.ndarray, grip: float) -> dict[frozenset[str], float]:
    """Distances of all pairs of links by pinocchio's own kinematics and reader; hulls instead of triangles."""
    model = pin.buildModelFromUrdf(str(file))
    packages = [str(file.parents[1] / "packages"), str(file.parent)]
    absolute = file.with_name("absolute.urdf")  # pinocchio reads no paths relative to the file.
    absolute.write_text(file.read_text().replace('"meshes/wedge', '"package://meshes/wedge'))
    geometry = pin.buildGeomFromUrdf(model, str(absolute), pin.GeometryType.COLLISION, package_dirs=packages)
    for thing in geometry.geometryObjects:
        if isinstance(thing.geometry, coal.BVHModelBase):
            thing.geometry.buildConvexHull(True, "Qt")
            thing.geometry = thing.geometry.convex
    full = pin.neutral(model)
    for name, value in [*zip(arm.joint_names, q, strict=True), ("grip", grip)]:
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = (
            [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
        )
    geometry.addAllCollisionPairs()
    data, placed = model.createData(), pin.GeometryData(geometry)
    pin.updateGeometryPlacements(model, data, geometry, placed, full)
    found: dict[frozenset[str], float] = {}
    for k, pair in enumerate(geometry.collisionPairs):
        names = [
            model.frames[geometry.geometryObjects[i].parentFrame].name for i in (pair.first, pair.second)
        ]
        distance = pin.computeDistance(geometry, placed, k).min_distance
        found[frozenset(names)] = min(found.get(frozenset(names), np.inf), distance)
    return found


@pytest.mark.slow
def test_distances_are_those_of_pinocchio_on_the_same_file(
    arm: kinseek.Arm, file: Path, scene: Scene
) -> None:
    counted = [frozenset((pair.a, pair.b)) for pair in scene.pairs if pair.counts]
    assert len(counted) > 10
    touching = 0
    for q in arm.sample(60, seed=1):
        theirs = witness(arm, file, q, 0.04)
        least = min(theirs[pair] for pair in counted)
        near = scene.nearest(q)
        assert near.distance == scene.distance(q)
        if least > 0:
            assert near.distance == pytest.approx(least, abs=2e-6)
            assert theirs[frozenset((near.a, near.b))] == pytest.approx(least, abs=2e-6)
            assert np.linalg.norm(near.point_a - near.point_b) == pytest.approx(least, abs=1e-5)
        else:
            touching += 1
            assert near.distance <= 1e-6
        assert scene.free(q) == (least > 1e-6)
        hits = {frozenset((contact.a, contact.b)) for contact in scene.hits(q)}
        assert hits == {pair for pair in counted if theirs[pair] <= 1e-6}
    assert 3 < touching < 57


def test_a_sphere_and_a_box_are_as_far_apart_as_on_paper() -> None:
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    scene = Scene.of(arm, capsules=0.05)
    assert "replace shapes" in scene.notes[0]
    scene.add_box("wall", (0.1, 2.0, 2.0), kinseek.pose([1.25, 0, 0]))
    assert scene.distance([0.0, 0.0]) == pytest.approx(0.15, abs=1e-6)
    assert scene.nearest([0.0, 0.0])[:2] == ("link2", "wall")
    assert scene.free([0.0, 0.0], 0.149)
    assert not scene.free([0.0, 0.0], 0.151)
    scene.attach("load", Sphere(0.1), to=arm.tip, pose=kinseek.pose([0.0, 0.0, 0.2]))
    assert scene.distance([0.0, 0.0]) == pytest.approx(0.10, abs=1e-6)
    scene.attach(
        "probe", Capsule(0.02, 0.3), to=arm.tip, pose=kinseek.pose([0.1, 0, 0], rpy=[0, np.pi / 2, 0])
    )
    (contact,) = scene.hits([0.0, 0.0])
    assert {contact.a, contact.b} == {"wall", "probe"}
    assert contact.depth == pytest.approx(0.07, abs=1e-5)
    scene.remove("probe")
    assert scene.hits([0.0, 0.0]) == ()
    assert scene.free([0.0, 0.0])
    (close,) = scene.hits([0.0, 0.0], clearance=0.12)
    assert close.depth == pytest.approx(-0.10, abs=1e-6)


def test_an_object_is_taken_and_put_down() -> None:
    arm = kinseek.Arm.from_dh([[0.5, 0, 0, 0], [0.5, 0, 0, 0]], [-3, -3], [3, 3])
    scene, box, q = Scene.of(arm, capsules=0.05), Box((0.1, 0.1, 0.1)), [0.0, 0.0]
    scene.attach("gripper", Sphere(0.04), to=arm.tip, pose=kinseek.pose([0.05, 0.0, 0.0]))
    scene.add_box("table", (0.4, 0.4, 0.1), kinseek.pose([1.3, 0.0, -0.1]))
    scene.add("part", box, kinseek.pose([1.12, 0.0, 0.0]))
    scene.allow("gripper", "table")
    scene.allow("gripper", "part")
    assert scene.free(q)  # The part stands on the table, and neither moves.
    held = kinseek.pose([0.12, 0.0, 0.0])
    scene.attach("part", box, to=arm.tip, pose=held, touches=["table"], replace=True)
    assert scene.free(q)
    scene.attach("part", box, to=arm.tip, pose=held, replace=True)
    (contact,) = scene.hits(q)
    assert (contact.a, contact.b) == ("table", "part")
    with pytest.raises(InvalidScene, match="did you mean 'table'"):
        scene.attach("part", box, to=arm.tip, touches=["tabel"], replace=True)
    with pytest.raises(InvalidScene, match="padding"):
        scene.attach("part", box, to=arm.tip, padding=-1, replace=True)
    assert scene.hits(q) == (contact,)
    with pytest.raises(InvalidScene, match="'part' is a body of the scene already"):
        scene.attach("part", box, to=arm.tip)
    with pytest.raises(InvalidScene, match="'link1' is a link of the arm already"):
        scene.attach("link1", box, to=arm.tip, replace=True)
    scene.add("part", box, kinseek.pose([0.75, 0.0, 0.0]), replace=True)
    # The arm that carried it is an obstacle for it again, but what was allowed still is.
    assert {(hit.a, hit.b) for hit in scene.hits(q)} == {("link2", "part")}
    assert scene.bodies == ("link1", "link2", "gripper", "table", "part")


@pytest.mark.slow
def test_clouds_and_padding_and_batches(arm: kinseek.Arm, file: Path) -> None:
    folders = {"thick_meshes": file.parents[1] / "packages" / "thick_meshes"}
    plain, thick = (Scene.of(arm, folders, padding=padding) for padding in (0.0, 0.01))
    cloud = np.random.default_rng(3).uniform(-0.8, 0.8, (200, 3))
    for scene in (plain, thick):
        scene.add_points("cloud", cloud, 0.02)
    q = arm.sample(24, seed=5).reshape(2, 12, arm.dof)
    free = plain.free(q)
    assert free.shape == (2, 12)
    assert free.dtype == bool
    assert plain.distance(q).shape == (2, 12)
    balls = Scene.of(arm, folders)
    for i, point in enumerate(cloud):
        balls.add_sphere(f"ball{i}", 0.02, kinseek.pose(point))
    near = np.abs(balls.distance(q)) < 1e-4  # A point of a cloud is a grain of a hundredth of a millimetre.
    assert (free == balls.free(q))[~near].all()
    assert (thick.free(q) <= free).all()
    apart = plain.distance(q[free]) > 0.05
    gap = plain.distance(q[free]) - thick.distance(q[free])
    assert apart.any()
    assert ((gap > 0.01 - 1e-5) & (gap < 0.02 + 1e-5)).all()


@pytest.mark.slow
def test_flat_sides_may_have_many_corners() -> None:
    ring = np.stack(
        [np.cos(np.linspace(0, 2 * np.pi, 400, False)), np.sin(np.linspace(0, 2 * np.pi, 400, False))], 1
    )
    vertices = np.concatenate([np.column_stack([ring, np.full(400, z)]) for z in (-0.5, 0.5)])
    disc = Mesh(vertices, [[0, i, i + 1] for i in range(1, 799)])  # type: ignore[arg-type]
    scene = Scene.of(kinseek.Arm.from_dh([[1, 0, 0, 0]], [-3], [3]), capsules=0.1)
    scene.add("disc", disc, kinseek.pose([2.5, 0, 0]))
    for q in (0.0, 0.3, 1.0):
        assert scene.distance([q]) == pytest.approx(
            np.hypot(2.5 - np.cos(q), np.sin(q)) - 1.1,
            abs=1e-4,  # The sides of the ring are not round.
        )


@pytest.mark.slow
def test_a_closed_mesh_is_solid_and_an_open_one_is_not(tmp_path: Path, scene: Scene) -> None:
    vertices, faces = box_mesh((4.0, 4.0, 4.0))
    scene.add_mesh("around", write_stl(tmp_path / "closed.stl", vertices, faces))
    assert not scene.free(np.zeros(6))
    assert scene.distance(np.zeros(6)) < 0
    scene.remove("around")
    scene.add_mesh("shell", write_obj(tmp_path / "open.obj", vertices, faces[:-1]))
    assert scene.free(np.zeros(6))
    assert any("open mesh" in note for note in scene.notes)
    scene.remove("shell")
    assert not any("open mesh" in note for note in scene.notes)
    scene.add_mesh("hull", tmp_path / "open.obj", hull=True)
    assert not scene.free(np.zeros(6))


def test_pairs_that_do_not_count_say_why(arm: kinseek.Arm, file: Path, scene: Scene) -> None:
    reasons = {frozenset((pair.a, pair.b)): pair.reason for pair in scene.pairs}
    assert reasons[frozenset(("base", "turret"))].startswith("neighbours")
    assert "neither moves" in reasons[frozenset(("hand", "finger"))]
    assert "neither moves" in reasons[frozenset(("fore", "camera"))]
    assert reasons[frozenset(("camera", "upper"))] == ""
    srdf = '<robot name="thick"><disable_collisions link1="camera" link2="upper" reason="User"/></robot>'
    with_srdf = Scene.of(arm, [file.parents[1] / "packages"], srdf=srdf)
    assert "upper - camera: SRDF: User" in [str(pair) for pair in with_srdf.pairs]
    less = Scene.of(arm, [file.parents[1] / "packages"], never="skip", samples=200)
    assert any(pair.reason.startswith("never") for pair in less.pairs)
    scene.add_box("table", (1, 1, 0.1))
    scene.allow("table", "turret")
    assert [str(p) for p in scene.pairs if p.reason.startswith("allowed")] == [
        "turret - table: allowed: they may touch"
    ]


def test_joints_that_are_not_the_arms_stand_where_they_are_told(arm: kinseek.Arm, file: Path) -> None:
    scene = Scene.of(arm, [file.parents[1] / "packages"])
    assert scene.notes == ("joint 'grip' is not the arm's and stands at 0.01",)
    with pytest.raises(InvalidScene, match="did you mean 'grip'"):
        Scene.of(arm, [file.parents[1] / "packages"], joints={"gripp": 0.02})


FINGER = """<robot name="r"><link name="a"/><link name="b"/>
<link name="c"><collision><origin xyz="1 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="0" velocity="0"/></joint>
<joint name="k" type="revolute"><parent link="b"/><child link="c"/><axis xyz="{}"/>
<limit lower="0.5" upper="1" effort="0" velocity="0"/></joint></robot>"""


@pytest.mark.parametrize("size", ["2", "1e200", "1e-200", "1e-320"])
def test_joints_that_are_not_the_arms_turn_about_axes_of_any_length(size: str, tmp_path: Path) -> None:
    """With squares that overflowed the joint did not turn, and the link was elsewhere."""
    (tmp_path / "r.urdf").write_text(FINGER.format(f"0 0 {size}"))
    scene = Scene.of(kinseek.load(tmp_path / "r.urdf", tip="b"))
    scene.add_sphere("ball", 0.1, kinseek.pose([np.cos(0.5), np.sin(0.5), 0.0]))
    assert not scene.free(np.zeros(1))
    assert scene.free(np.ones(1))
    (tmp_path / "r.urdf").write_text(FINGER.format("0 0 0"))
    with pytest.raises(InvalidScene, match="the axis of joint 'k' is 0 0 0, expected a direction"):
        Scene.of(kinseek.load(tmp_path / "r.urdf", tip="b"))


@pytest.mark.slow
def test_a_locked_arm_and_one_with_a_tool_are_where_they_were(
    arm: kinseek.Arm, file: Path, scene: Scene
) -> None:
    q = arm.sample(20, seed=8)
    q[:, 2] = 0.5
    folders = [file.parents[1] / "packages"]
    locked = Scene.of(arm.with_locked({"j3": 0.5}), folders, joints={"grip": 0.04})
    counted = {(p.a, p.b) for p in locked.pairs if p.counts}
    assert ("upper", "camera") not in counted  # One joint less: these do not move against each other.
    tool = Scene.of(arm.with_tool(kinseek.pose([0, 0, 0.1])), folders, joints={"grip": 0.04})
    assert (tool.free(q) == scene.free(q)).all()
    both = [p for p in scene.pairs if p.counts and (p.a, p.b) not in counted]
    for pair in both:
        scene.allow(pair.a, pair.b)
    assert (locked.free(np.delete(q, 2, axis=1)) == scene.free(q)).all()


def test_a_tool_makes_no_capsule_longer() -> None:
    arm = kinseek.load("panda")
    scene, tooled = (
        Scene.of(one, capsules=0.05) for one in (arm, arm.with_tool(kinseek.pose([0.1, 0, 0.3])))
    )
    assert tooled.bodies == scene.bodies
    q = arm.sample(40, seed=2)
    assert np.array_equal(tooled.distance(q), scene.distance(q))


def test_notes_say_what_has_no_capsule() -> None:
    notes = {
        name: Scene.of(kinseek.load(name), capsules=0.05).notes[0]
        for name in ("ur5e", "scara4", "cylindrical3")
    }
    assert "slides" not in notes["ur5e"]
    assert notes["scara4"].endswith("; what slides has no capsule along the slide")
    assert notes["cylindrical3"].endswith(
        "; no link has a length, so only bodies that are added or attached are checked"
    )


LARGE = MOST_LENGTH * np.array([[-0.5, -0.5, -0.5], [0.5, -0.5, -0.5], [0.0, 0.5, -0.5], [0.0, 0.0, 0.5]])
LARGEST_SHAPES = {
    "box": Box([MOST_LENGTH] * 3),
    "sphere": Sphere(MOST_LENGTH),
    "cylinder": Cylinder(MOST_LENGTH, MOST_LENGTH),
    "capsule": Capsule(MOST_LENGTH, MOST_LENGTH),
    "hull": Mesh(LARGE, FACES),
    "triangles": Mesh(LARGE, FACES, hull=False),
    "points": Points([[0.0, 0.0, 0.0]], MOST_LENGTH),
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", LARGEST_SHAPES.values(), ids=LARGEST_SHAPES)
def test_nothing_is_free_inside_of_the_largest_shapes(shape: Shape) -> None:
    arm = kinseek.load("ur5e")
    around = Scene.of(arm, capsules=0.05, samples=10)
    around.add("around", shape)
    q = arm.sample(20, seed=0)
    assert not around.free(q).any()
    assert (around.distance(q[:3]) < -0.1 * MOST_LENGTH).all()


@pytest.mark.slow
def test_the_largest_and_the_least_shapes_are_as_far_away_as_smaller_ones() -> None:
    arm = kinseek.load("ur5e")
    q = arm.sample(5, seed=0)
    distances = []
    for size in (10.0, MOST_LENGTH):
        beside = Scene.of(arm, capsules=0.05, samples=10)
        beside.add_box("wall", [size] * 3, kinseek.pose([size / 2 + 1.5, 0, 0]))
        distances.append(beside.distance(q))
    assert distances[0] == pytest.approx(distances[1], abs=1e-8)
    short = kinseek.load("scara4")
    for shape in (
        Box([LEAST_LENGTH] * 3),
        Cylinder(LEAST_LENGTH, LEAST_LENGTH),
        Mesh(LARGE * 1e-15, FACES, hull=False),
    ):
        speck = Scene.of(short, capsules=0.01, samples=10)
        speck.add("inside", shape)
        q = short.sample(5, seed=0)
        assert not speck.free(q).any()
        assert (
            np.abs(speck.distance(q)) <= 0.1
        ).all()  # The library says -1.8e308 where it cannot tell how deep.


def test_names_and_flags_of_another_type_are_refused(scene: Scene, arm: kinseek.Arm) -> None:
    q = np.zeros(arm.dof)
    names: list[Any] = [["a"], {}, 5, ""]
    for name in names:
        with pytest.raises(kinseek.InvalidScene, match="a body needs a name"):
            scene.add(name, Sphere(0.1))
    with pytest.raises(kinseek.InvalidScene, match="replace must be True or False, got 'no'"):
        scene.add("x", Sphere(0.1), replace="no")  # type: ignore[arg-type]
    with pytest.raises(kinseek.InvalidProblem, match="thorough must be True or False, got 'no'"):
        scene.free_motion(q, q, thorough="no")  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [1e-10, 1.1e6, 1e78, 1e160, 1e308])
def test_sizes_beyond_all_measure_are_refused(size: float, scene: Scene) -> None:
    """Some killed the process, and of others a scene said that an arm inside of them is free."""
    told = r"from 1e-09 m to 1e\+06 m, got "
    for make in (
        lambda: Box([1, size, 1]),
        lambda: Sphere(size),
        lambda: Cylinder(size, 1),
        lambda: Cylinder(1, size),
        lambda: Capsule(size, 1),
        lambda: Capsule(1, size),
        lambda: Points([[0, 0, 0]], size),
    ):
        with pytest.raises(InvalidScene, match=told):
            make()
    tetrahedron = size * np.eye(4)[:, :3]
    for hull in (True, False):
        with pytest.raises(InvalidScene, match=r"within 1e\+06 m of its origin|at least 1e-09 m long"):
            Mesh(tetrahedron, FACES, hull)
    if size > 1:
        with pytest.raises(InvalidScene, match=r"within 1e\+06 m of its origin along each axis, got "):
            Points([[0.0, 0.0, 0.0], [0.0, -size, 0.0]], 0.1)
        with pytest.raises(InvalidScene, match=r"padding must be a length .*at most 1e\+06 m"):
            scene.attach("load", Box((1, 1, 1)), "hand", padding=size)


@pytest.mark.parametrize("place", ["-1.1e7 0 0", "0 1e300 0"])
def test_origins_beyond_all_measure_are_refused(tmp_path: Path, scene: Scene, place: str) -> None:
    box = '<geometry><box size="1 1 1"/></geometry>'
    path = tmp_path / "far.urdf"
    path.write_text(
        f'<robot name="r"><link name="far"><collision><origin xyz="{place}"/>{box}</collision></link></robot>'
    )
    with pytest.raises(InvalidScene, match=r"within 1e\+07 m along each axis, got "):
        scene.add_file(path)
    links = (
        "".join(f'<link name="f{i}"/>' for i in range(3))
        + f'<link name="f3"><collision>{box}</collision></link>'
    )
    joints = "".join(
        f'<joint name="g{i}" type="fixed"><parent link="f{i}"/><child link="f{i + 1}"/><origin xyz="9e6 0 0"/></joint>'
        for i in range(3)
    )
    path.write_text(f'<robot name="r">{links}{joints}</robot>')
    with pytest.raises(InvalidScene, match=r"1e\+07 m"):
        scene.add_file(path)


@pytest.mark.slow
def test_copies_and_pickles_stand_for_themselves(scene: Scene) -> None:
    before = scene.distance(np.zeros(6))
    bounds = scene.margins.distances(np.zeros(6))  # Trackers and plans compute these.
    for other in (copy.copy(scene), copy.deepcopy(scene), pickle.loads(pickle.dumps(scene))):
        assert other.distance(np.zeros(6)) == before
        assert np.array_equal(other.margins.distances(np.zeros(6)), bounds)
        other.add_box("block", (2, 2, 2))
        assert not other.free(np.zeros(6))
        assert "block" not in scene.bodies
        assert scene.distance(np.zeros(6)) == before


@pytest.mark.slow
def test_threads_may_share_a_scene(arm: kinseek.Arm, scene: Scene) -> None:
    q = arm.sample(40, seed=11)
    alone = scene.distance(q)
    with ThreadPoolExecutor(4) as pool:
        shared = list(pool.map(scene.distance, q))
    assert np.array_equal(shared, alone)


def test_bad_input_is_told(arm: kinseek.Arm, file: Path, scene: Scene, tmp_path: Path) -> None:
    folders = [file.parents[1] / "packages"]
    with pytest.raises(
        InvalidScene, match=r"link 'upper', collision element 1: 'package://thick_meshes/meshes/bar.stl'"
    ):
        Scene.of(arm)
    skipped = Scene.of(arm, meshes="skip")
    assert "upper" not in skipped.bodies
    assert any("left out: link 'upper'" in note for note in skipped.notes)
    with pytest.raises(InvalidScene, match="no folder"):
        Scene.of(arm, ["nowhere"])
    with pytest.raises(InvalidScene, match=r"the shape of arm .* is not known.*capsules=0.05"):
        Scene.of(kinseek.load("ur5e"))
    with pytest.raises(InvalidScene, match="SRDF of robot 'panda'"):
        Scene.of(arm, folders, srdf='<robot name="panda"><disable_collisions link1="a" link2="b"/></robot>')
    with pytest.raises(InvalidScene, match="does not describe the arm"):
        Scene.of(kinseek.load("ur5e"), urdf=file)
    with pytest.raises(InvalidScene, match="'hand' is a link of the arm already"):
        scene.add_box("hand", (1, 1, 1))
    scene.add_box("table", (1, 1, 1), kinseek.pose([5, 0, 0]))
    with pytest.raises(InvalidScene, match="'table' is a body of the scene already"):
        scene.add_sphere("table", 0.1)
    with pytest.raises(InvalidScene, match="did you mean 'table'"):
        scene.remove("tabel")
    with pytest.raises(InvalidScene, match="is a link of the arm"):
        scene.remove("hand")
    with pytest.raises(InvalidScene, match="unknown link 'hnd'; did you mean 'hand'"):
        scene.attach("load", Box((1, 1, 1)), to="hnd")
    with pytest.raises(InvalidScene, match="1 of 3 points hold NaN or infinity, the first is point 1"):
        scene.add_points("cloud", [[0.0, 0.0, 0.0], [0.0, np.nan, 0.0], [1.0, 1.0, 1.0]], 0.01)
    for size in ((1, 1), (1, 1, 0), (1, 1, -1), (1, 1, np.nan), "big"):
        with pytest.raises(InvalidScene, match="size must be 3 lengths"):
            scene.add_box("box", size)
    with pytest.raises(InvalidScene, match="no file"):
        scene.add_mesh("mesh", tmp_path / "none.stl")
    (tmp_path / "empty.obj").write_text("# nothing\n")
    with pytest.raises(InvalidScene, match=r"empty\.obj"):
        scene.add_mesh("mesh", tmp_path / "empty.obj")
    with pytest.raises(InvalidScene, match="1,000,001 triangles"):
        Mesh(np.zeros((3, 3)), np.zeros((1_000_001, 3), dtype=np.int64), hull=False)
    with pytest.raises(InvalidScene, match="is flat"):
        scene.add("flat", Mesh(np.eye(3), np.array([[0, 1, 2]])))
    assert "flat" not in scene.bodies
    with pytest.raises(
        InvalidScene, match=r"padding must be a length of at least 0 m, and at most 1e\+06 m, got -1"
    ):
        Scene.of(arm, folders, padding=-1)
    for meshes in (5, np.array(5)):
        with pytest.raises(InvalidScene, match="meshes must be folders"):
            Scene.of(arm, meshes)  # type: ignore[arg-type]
    with pytest.raises(InvalidScene, match="joints must be a mapping"):
        Scene.of(arm, folders, joints=5)  # type: ignore[arg-type]
    with pytest.raises(InvalidScene, match="clearance"):
        scene.free(np.zeros(6), -0.1)
    with pytest.raises(InvalidScene, match="expected a Box"):
        scene.add("thing", (1, 1, 1))  # type: ignore[arg-type]
    with pytest.raises(InvalidScene, match="must be convex"):
        scene.attach("load", Points([[0, 0, 0]], 0.1), to="hand")
    with pytest.raises(kinseek.InvalidProblem, match=r"shape \(6,\)"):
        scene.free(np.zeros(5))
    with pytest.raises(kinseek.InvalidProblem):
        Scene.of(kinseek.Arm.from_fk(lambda q: np.eye(4), [-1], [1], vectorized=False), capsules=0.1)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda scene: scene.add_mesh("mesh", None), "expected the path of a file, got None"),
        (lambda scene: scene.add_file(None), "expected the path of a file, got None"),
        (lambda scene: Mesh.read(None), "expected the path of a file, got None"),  # type: ignore[arg-type]
        (
            lambda scene: scene.attach("load", Sphere(0.1), "hand", touches=None),
            "touches must be names of bodies",
        ),
        (
            lambda scene: scene.attach("load", Sphere(0.1), "hand", touches="hand"),
            "touches must be names of bodies, got 'hand'",
        ),
        (lambda scene: scene.attach("load", Sphere(0.1), []), r"unknown link '\[\]'"),
        (lambda scene: scene.move([], np.zeros(6)), r"unknown arm of the scene '\[\]'"),
        (lambda scene: scene.allow([], "hand"), r"unknown body '\[\]'"),
        (lambda scene: scene.allow("hand", {}), r"unknown body '\{\}'"),
        (lambda scene: scene.remove([]), r"unknown body '\[\]'"),
        (lambda scene: scene.hits_around(np.zeros(6), "far"), "reach must be 6 numbers, got 'far'"),
        (lambda scene: scene.hits_around(np.zeros(6), [[0.1, 0.2]]), "reach must be 6 numbers"),
        (lambda scene: scene.free(np.zeros(6), clearance="0.1"), "clearance must be a length .*got '0.1'"),
        (lambda scene: scene.free(np.zeros(6), clearance=True), "clearance must be a length .*got True"),
        (lambda scene: Box((1, "2", 3)), "size must be 3 lengths above 0 m"),
        (
            lambda scene: Mesh(np.eye(3), np.arange(3)[None], hull="no"),  # type: ignore[arg-type]
            "hull must be True or False, got 'no'",
        ),
    ],
)
def test_other_types_are_told(scene: Scene, call: Callable[[Any], Any], words: str) -> None:
    with pytest.raises(kinseek.KinseekError, match=words):
        call(scene)


@pytest.mark.slow
def test_without_the_extra_it_is_told_which() -> None:
    code = (
        "import sys; sys.modules['pinocchio'] = None\n"
        "import kinseek\n"
        "try: kinseek.Scene.of(kinseek.load('ur5e'), capsules=0.05)\n"
        "except kinseek.MissingExtra as error: print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "kinseek[collision]" in said


@pytest.mark.slow
def test_distances_from_boxes_do_not_depend_on_the_first_check_in_the_process() -> None:
    # The static variable of coal that geometry._settle_boxes sets.
    first = (
        "import coal, numpy as np\n"
        "place, there = coal.Transform3s(), coal.Transform3s(np.eye(3), np.array([3.0, 0.0, 0.0]))\n"
        "check = lambda: coal.distance(coal.Box(1.0, 1.0, 1.0), place, coal.Capsule(0.1, 0.3), there,\n"
        "    coal.DistanceRequest(), coal.DistanceResult())\n"
    )
    ask = (
        "import kinseek\n"
        "arm = kinseek.load('ur5e')\n"
        "scene = kinseek.Scene.of(arm, capsules=0.05)\n"
        "scene.add_box('crate', size=(0.1, 0.1, 0.3), pose=kinseek.pose([0.5, 0.1, 0.3]))\n"
    )
    digest = "print(scene.distance(arm.sample(200, seed=1)).tobytes().hex())\n"
    said = {
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
        for code in (first + ask + digest, first + ask + "check()\n" + digest)
    }
    assert len(said) == 1


def mujoco_geom(shape: kinseek.collision.Shape, T: np.ndarray) -> str:
    """The same shape in MuJoCo's words: sizes are halves."""
    x, y, z, w = pin.Quaternion(T[:3, :3]).coeffs().tolist()
    place = f'pos="{" ".join(map(repr, T[:3, 3].tolist()))}" quat="{w!r} {x!r} {y!r} {z!r}"'
    if isinstance(shape, Box):
        return f'<geom type="box" size="{" ".join(str(s / 2) for s in np.asarray(shape.size).tolist())}" {place}/>'
    if isinstance(shape, Sphere):
        return f'<geom type="sphere" size="{shape.radius}" {place}/>'
    if isinstance(shape, Mesh):
        return f'<geom type="mesh" mesh="wedge" {place}/>'
    assert isinstance(shape, Capsule | Cylinder)
    kind = "capsule" if isinstance(shape, Capsule) else "cylinder"
    return f'<geom type="{kind}" size="{shape.radius} {shape.length / 2}" {place}/>'


@pytest.mark.slow
def test_distances_are_those_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    shapes = [
        Box((0.1, 0.5, 0.2)),
        Sphere(0.2),
        Cylinder(0.1, 0.7),
        Capsule(0.1, 0.7),
        Mesh(TETRAHEDRON, FACES),
    ]
    arm, rng = kinseek.load("ur5e"), np.random.default_rng(0)
    vertices = " ".join(map(str, TETRAHEDRON.ravel().tolist()))
    asset = f'<asset><mesh name="wedge" vertex="{vertices}"/></asset>'
    touching = 0
    for carried in shapes:
        for obstacle in shapes:
            for q in arm.sample(3, seed=int(rng.integers(1000))):
                pose = kinseek.pose(arm.fk(q)[:3, 3] + rng.uniform(-0.4, 0.4, 3), rpy=rng.uniform(-3, 3, 3))
                scene = Scene.of(arm, capsules=1e-3, samples=1)
                scene.attach("load", carried, to="tool0")
                scene.add("thing", obstacle, pose)
                for link in scene.bodies[:-2]:
                    scene.allow(link, "load")
                    scene.allow(link, "thing")
                    for other in scene.bodies[:-2]:
                        scene.allow(link, other)
                text = mujoco_geom(carried, arm.fk(q)) + mujoco_geom(obstacle, pose)
                model = mujoco.MjModel.from_xml_string(
                    f"<mujoco>{asset}<worldbody>{text}</worldbody></mujoco>"
                )
                data = mujoco.MjData(model)
                mujoco.mj_forward(model, data)
                theirs = mujoco.mj_geomDistance(model, data, 0, 1, 10.0, None)
                ours = scene.distance(q)
                if theirs > 1e-5:
                    assert ours == pytest.approx(theirs, abs=2e-5), (carried, obstacle)
                else:
                    touching += 1
                    assert ours <= 1e-5, (carried, obstacle)
                assert scene.free(q) == (ours > 1e-6)
    assert 10 < touching < 65


@pytest.mark.parametrize(
    ("arm", "links"),
    [
        (
            kinseek.load("panda"),
            [f"panda_link{i}" for i in range(9)],
        ),
        (kinseek.load("planar2"), ["base", "fore_link", "tip", "upper_link"]),
        (
            kinseek.load("planar2").with_tool(kinseek.pose([0.1, 0, 0])),
            ["base", "fore_link", "tip", "upper_link"],
        ),
        (
            kinseek.Arm.from_dh([[0.4, 0, 0, 0], [0.3, 0, 0, 0]], [-2, -2], [2, 2]),
            ["base", "link1", "link2", "tool"],
        ),
    ],
)
def test_what_can_be_attached_to_are_links_and_no_joints(arm: kinseek.Arm, links: list[str]) -> None:
    scene = kinseek.Scene.of(arm, capsules=0.01)
    with pytest.raises(InvalidScene, match=f"unknown link 'nope'. Valid: {', '.join(links)}$"):
        scene.attach("load", Box((1, 1, 1)), to="nope")
    for link in links:
        scene.attach(f"load at {link}", Box((0.01, 0.01, 0.01)), to=link)
    for joint in arm.joint_names:
        with pytest.raises(InvalidScene, match=f"unknown link '{joint}'"):
            scene.attach("load", Box((1, 1, 1)), to=joint)


def test_one_sample_without_contact_excludes_no_pair() -> None:
    """With `samples=1` every pair counted as one that always touches, and everything was free."""
    arm = kinseek.load("ur5e")
    one, many = (Scene.of(arm, capsules=0.02, samples=samples) for samples in (1, 1000))
    checked = [{(pair.a, pair.b) for pair in scene.pairs if pair.counts} for scene in (one, many)]
    assert checked[0]
    assert checked[0] <= checked[1]  # More samples separate more pairs.
