"""Obstacles from files: a URDF whose joints are fixed, and the text that MoveIt writes of a planning scene."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import kinseek
from cells import TETRAHEDRON, box_mesh, write_obj, write_stl
from kinseek import InvalidScene, Scene
from kinseek.collision import Box, bodies
from kinseek.collision.assembly import MOST_PAIRS
from kinseek.collision.bodies import MOST_SHAPES
from kinseek.collision.engine import MOST_JOINTS
from kinseek.collision.links import neighbours_of
from kinseek.collision.obstacles import MOST_OBJECTS, obstacles
from kinseek.robots.urdf_file import Robot, read_robot

pytest.importorskip("pinocchio")

CELL = """<robot name="cell">
  <link name="world"/>
  <link name="table"><collision><geometry><box size="1 1.6 0.04"/></geometry></collision></link>
  <link name="pole">
    <collision><origin xyz="0 0 0.4"/><geometry><cylinder radius="0.03" length="0.8"/></geometry></collision>
    <collision><origin xyz="0 0 0.9"/><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <joint name="feet" type="fixed"><parent link="world"/><child link="table"/>
    <origin xyz="0.55 0 -0.06" rpy="0 0 1.5707963267948966"/></joint>
  <joint name="screw" type="fixed"><parent link="table"/><child link="pole"/><origin xyz="0.35 0.2 0.06"/></joint>
</robot>"""

POLE = slice(CELL.index('<link name="pole"'), CELL.index("<joint"))

MOVEIT = """the cell
* table
0.55 0 -0.06
0 0 0.70710678118654752 0.70710678118654752
1
box
1 1.6 0.04
0 0 0
0 0 0 1
0 0 0 0
0
* the pole
0.35 0.35 0
0 0 0.70710678118654752 0.70710678118654752
2
cylinder
0.03 0.8
0 0 0.4
0 0 0 1
0.5 0.5 0.5 1
sphere
0.05
0 0 0.9
0 0 0 1
0 0 0 0
1
top
0 0 0.9
0 0 0 1
.
"""

OLD = """(noname)+
* table
1
box
1 1.6 0.04
0.55 0 -0.06
0 0 0.70710678118654752 0.70710678118654752
0 0 0 0
* the pole
2
cylinder
0.03 0.8
0.35 0.35 0.4
0 0 0 1
0 0 0 0
sphere
0.05
0.35 0.35 0.9
0 0 0 1
0 0 0 0
.
"""


@pytest.fixture(scope="module")
def arm() -> kinseek.Arm:
    return kinseek.load("ur5e")


@pytest.fixture
def scene(arm: kinseek.Arm) -> Scene:
    return Scene.of(arm, capsules=0.05)


@pytest.fixture
def by_hand(arm: kinseek.Arm) -> Scene:
    """The same cell, shape by shape."""
    scene = Scene.of(arm, capsules=0.05)
    scene.add_box("table", (1.6, 1.0, 0.04), kinseek.pose([0.55, 0, -0.06]))
    scene.add_cylinder("pole", 0.03, 0.8, kinseek.pose([0.35, 0.35, 0.4]))
    scene.add_sphere("ball", 0.05, kinseek.pose([0.35, 0.35, 0.9]))
    return scene


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text", "pole"),
    [("cell.urdf", CELL, "pole"), ("new.scene", MOVEIT, "the pole"), ("old.scene", OLD, "the pole")],
)
def test_a_file_holds_what_is_added_by_hand(
    name: str, text: str, pole: str, tmp_path: Path, arm: kinseek.Arm, scene: Scene, by_hand: Scene
) -> None:
    assert scene.add_file(written(tmp_path, name, text)) == ("table", pole)
    q = arm.sample(200, seed=1)
    free = scene.free(q)
    assert 0 < free.sum() < len(q)
    np.testing.assert_array_equal(free, by_hand.free(q))
    np.testing.assert_allclose(scene.distance(q[free]), by_hand.distance(q[free]), atol=1e-6)


@pytest.mark.slow
def test_a_pose_brings_all_of_it_along_and_a_prefix_lets_it_stand_twice(
    tmp_path: Path, arm: kinseek.Arm, scene: Scene
) -> None:
    path, T = written(tmp_path, "cell.urdf", CELL), kinseek.pose([0.1, -0.2, 0.05], rpy=[0, 0, 0.7])
    assert scene.add_file(path, T, prefix="left ") == ("left table", "left pole")
    moved, q = Scene.of(arm, capsules=0.05), arm.sample(20, seed=3)
    moved.add_box("table", (1.6, 1.0, 0.04), T @ kinseek.pose([0.55, 0, -0.06]))
    moved.add_cylinder("pole", 0.03, 0.8, T @ kinseek.pose([0.35, 0.35, 0.4]))
    moved.add_sphere("ball", 0.05, T @ kinseek.pose([0.35, 0.35, 0.9]))
    near = moved.distance(q)
    assert (near > 0).any()
    np.testing.assert_allclose(scene.distance(q)[near > 0], near[near > 0], atol=1e-6)
    assert scene.add_file(path) == ("table", "pole")


@pytest.mark.slow
def test_meshes_of_a_file_count_as_they_are(tmp_path: Path, scene: Scene) -> None:
    write_obj(tmp_path / "part.obj", TETRAHEDRON, np.array([[0, 1, 2]]))
    mesh = '<collision><geometry><mesh filename="part.obj"/></geometry></collision>'
    text = f'<robot name="part"><link name="part">{mesh}</link></robot>'
    scene.add_file(written(tmp_path, "part.urdf", text), kinseek.pose([2, 0, 0]))
    assert any(note.startswith("'part' is an open mesh") for note in scene.notes)
    scene.remove("part")
    assert not any(note.startswith("'part'") for note in scene.notes)


def test_meshes_of_a_scene_are_solid(tmp_path: Path, arm: kinseek.Arm, scene: Scene) -> None:
    corners, faces = box_mesh((1.6, 1.0, 0.04))
    numbers = [f"{len(corners)} {len(faces)}", *(" ".join(map(str, row)) for row in [*corners, *faces])]
    lines = [
        "cell",
        "* table",
        "0.55 0 -0.06",
        "0 0 0 1",
        "1",
        "mesh",
        *numbers,
        "0 0 0",
        "0 0 0 1",
        "0 0 0 0",
        "0",
        ".",
    ]
    scene.add_file(written(tmp_path, "mesh.scene", "\n".join(lines)))
    solid = Scene.of(arm, capsules=0.05)
    solid.add_box("table", (1.6, 1.0, 0.04), kinseek.pose([0.55, 0, -0.06]))
    q = arm.sample(100, seed=2)
    np.testing.assert_array_equal(scene.free(q), solid.free(q))


SHAPE = "0 0 0\n0 0 0 1\n1\nbox\n{0} {0} {0}\n0 0 0\n0 0 0 1\n0 0 0 0\n0\n.\n"


@pytest.mark.parametrize("text", [MOVEIT, OLD])
def test_the_name_of_a_scene_may_begin_with_a_star(text: str, tmp_path: Path, scene: Scene) -> None:
    """The line below decided on the version of the file."""
    text = f"* my cell{text[text.index(chr(10)) :]}"
    assert scene.add_file(written(tmp_path, "cell.scene", text)) == ("table", "the pole")


def test_a_line_of_a_scene_ends_where_that_of_moveit_does(tmp_path: Path, scene: Scene) -> None:
    """A name could have another object in it, and the end of the file, which hid its own shape."""
    hidden = SHAPE.format(0.01).replace("\n", " ")
    for end in ("\v", "\f", "\x1c", "\x85", "\u2028", "\r"):
        (tmp_path / "a.scene").write_bytes(f"a\n* b{end}{hidden}\n{SHAPE.format(0.5)}".encode())
        (name,) = scene.add_file(tmp_path / "a.scene")
        assert name == f"b{end}{hidden}".strip()
        np.testing.assert_array_equal(scene._bodies[name].parts[0].shape.corners.max(axis=0), 0.25)
        scene.remove(name)
    (tmp_path / "a.scene").write_text(f"a\n* b\n{SHAPE.format('1_0')}")
    with pytest.raises(InvalidScene, match="expected a number of the size of 'b', got '1_0'"):
        scene.add_file(tmp_path / "a.scene")


def test_a_mesh_that_is_missing_is_named_or_left_out(tmp_path: Path, scene: Scene) -> None:
    text = CELL.replace('<sphere radius="0.05"/>', '<mesh filename="package://nowhere/ball.stl"/>')
    path = written(tmp_path, "cell.urdf", text)
    with pytest.raises(InvalidScene, match=r"link 'pole', collision element 2: .*nowhere"):
        scene.add_file(path)
    assert "table" not in scene.bodies
    scene.add_file(path, meshes="skip")
    assert any("nowhere" in note for note in scene.notes)


def test_only_of_a_mesh_it_is_said_that_it_may_be_left_out(tmp_path: Path, scene: Scene) -> None:
    ball = '<sphere radius="0.05"/>'
    broken = written(tmp_path, "cell.urdf", CELL.replace(ball, '<mesh filename="none.stl"/>'))
    with pytest.raises(InvalidScene, match=r'missing="skip" skips such meshes'):
        scene.add_file(broken)
    with pytest.raises(InvalidScene, match="value of missing"):
        scene.add_file(broken, missing="leave")  # type: ignore[arg-type]
    for wrong in ('<sphere radius="nan"/>', '<mesh filename="none.stl" scale="1 nan 1"/>'):
        path = written(tmp_path, "wrong.urdf", CELL.replace(ball, wrong))
        for missing in ("error", "skip"):
            with pytest.raises(InvalidScene, match=r"expected \d finite numbers?, got '[^']*nan[^']*'$"):
                scene.add_file(path, missing=missing)
    geometry = '<geometry><mesh filename="none.stl"/></geometry>'
    alone = f'<robot name="a"><link name="a"><collision>{geometry}</collision></link></robot>'
    with pytest.raises(InvalidScene, match=r"no obstacles: left out: link 'a'"):
        scene.add_file(written(tmp_path, "alone.urdf", alone), missing="skip")


def test_meshes_that_are_missing_count_as_shapes(
    tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    geometry = '<collision><geometry><mesh filename="none.stl"/></geometry></collision>'
    path = written(tmp_path, "a.urdf", CELL.replace("</link>", f"{geometry * 20}</link>", 1))
    monkeypatch.setattr(bodies, "MOST_SHAPES", 20)
    with pytest.raises(InvalidScene, match="21 shapes of bodies, expected at most 20"):
        scene.add_file(path, missing="skip")


def test_a_xacro_file_is_expanded(tmp_path: Path, scene: Scene) -> None:
    text = CELL.replace('name="cell">', 'name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro">')
    path = written(tmp_path, "cell.urdf.xacro", text.replace('radius="0.03"', 'radius="${0.01 * 3}"'))
    assert scene.add_file(path, trusted=False) == ("table", "pole")


def test_a_file_that_is_not_trusted_does_not_run(tmp_path: Path) -> None:
    """`Scene.of` had no `trusted=`, so it let Python evaluate a xacro file."""
    text = (
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        '<link name="a"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
        '<link name="b"><collision><geometry><sphere radius="${list(0.1 for _ in [1])[0]}"/></geometry></collision></link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="-1" upper="1"/></joint></robot>'
    )
    path = written(tmp_path, "arm.xacro", text)
    arm = kinseek.load(path)
    for scene in (Scene.of(path), Scene.of(arm, urdf=path), Scene.of(arm, trusted=False)):
        assert scene.bodies == ("a", "b")
    for call in (partial(Scene.of, path), partial(Scene.of, arm, urdf=path)):
        with pytest.raises(kinseek.InvalidRobot, match="not trusted"):
            call(trusted=False)


def test_no_body_is_left_out(tmp_path: Path, scene: Scene) -> None:
    """A namespace hid all bodies."""
    text = CELL.replace("<robot", '<robot xmlns="http://www.ros.org"')
    assert scene.add_file(written(tmp_path, "cell.urdf", text)) == ("table", "pole")


BAD: list[tuple[str, str, str]] = [
    (
        "cell.urdf",
        f"<!DOCTYPE robot [<!ENTITY pole '{CELL[POLE]}'>]>{CELL.replace(CELL[POLE], '&pole;')}",
        "it has a document type",
    ),
    (
        "cell.urdf",
        CELL.replace('name="screw" type="fixed"', 'name="screw" type="revolute"'),
        r"joint 'screw' is revolute",
    ),
    (
        "cell.urdf",
        CELL.replace('<child link="pole"/>', '<child link="stick"/>'),
        "'stick', which does not exist",
    ),
    ("cell.urdf", CELL.replace("<box", "<cone"), r"geometry 'cone' is not known"),
    (
        "cell.urdf",
        CELL.replace('size="1 1.6 0.04"', 'size="1_0 1 1"'),
        r"expected 3 finite numbers, got '1_0 1 1'",
    ),
    (
        "cell.urdf",
        CELL.replace('size="1 1.6 0.04"', 'size="1 1.6"'),
        r"collision element 1: expected 3 finite numbers",
    ),
    (
        "cell.urdf",
        '<robot name="no"><link name="a"/></robot>',
        "no obstacles: it has no collision elements",
    ),
    ("cell.urdf", "<robot", "broken XML"),
    ("cell.stl", "solid", r"not a file of obstacles; expected \.urdf, \.xacro, or \.scene"),
    (
        "cell.scene",
        MOVEIT.replace("box", "cone"),
        r"line 6: expected box, .* as a shape of 'table', got 'cone'",
    ),
    (
        "cell.scene",
        MOVEIT.replace("1 1.6 0.04", "1 1.6 NaN"),
        "line 7: expected a finite number .* 'table', got 'NaN'",
    ),
    (
        "cell.scene",
        MOVEIT.replace("1 1.6 0.04", "1 1.6 -1"),
        r"cell\.scene: 'table': size must be 3 lengths above 0 m",
    ),
    (
        "cell.scene",
        MOVEIT.replace("the pole", "table"),
        r"line 12: expected a name that no other object has, got 'table'",
    ),
    ("cell.scene", MOVEIT.replace("\n.", ""), r"the file ends where \* or a point at the end was expected"),
    (
        "cell.scene",
        MOVEIT.replace("0 0 0 0\n0\n*", "0 0 0\n0\n*"),
        "line 12: expected the number of subframes of 'table', got '\\*'",
    ),
    (
        "cell.scene",
        MOVEIT.replace("0 0 0.9\n0 0 0 1", "0 0 0.9\n0 0 0 0"),
        r"the pose of a shape of 'the pole'",
    ),
    ("cell.scene", MOVEIT.replace("table", "t" * 1001), "1,001 letters in a name, expected at most 1,000"),
    ("cell.scene", "empty\n.\n", "no obstacles: it has no objects"),
    ("cell.scene", "", "the file ends where"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "text", "told"), BAD, ids=range(len(BAD)))
def test_what_cannot_be_read_is_said_and_nothing_is_added(
    name: str, text: str, told: str, tmp_path: Path, scene: Scene
) -> None:
    path, before = written(tmp_path, name, text), scene.bodies
    with pytest.raises(InvalidScene, match=told) as error:
        scene.add_file(path)
    assert name in str(error.value)
    assert scene.bodies == before


def test_a_file_that_is_not_there_and_a_name_that_is_taken(tmp_path: Path, scene: Scene) -> None:
    with pytest.raises(InvalidScene, match="no file"):
        scene.add_file(tmp_path / "cell.urdf")
    path = written(tmp_path, "cell.urdf", CELL)
    scene.add_sphere("pole", 0.1, kinseek.pose([2, 0, 0]))
    with pytest.raises(InvalidScene, match=r"cell\.urdf: 'pole' is a body of the scene already.*prefix="):
        scene.add_file(path)
    assert "table" not in scene.bodies
    with pytest.raises(kinseek.InvalidGoal):
        scene.add_file(path, np.zeros(3), prefix="x")


@pytest.mark.parametrize(
    ("count", "what"),
    [
        (1, "shapes"),
        pytest.param(MOST_OBJECTS + 1, "objects", marks=pytest.mark.slow),
        (MOST_OBJECTS + 1, "subframes"),
    ],
)
def test_a_scene_is_refused_before_all_of_it_is_read(
    tmp_path: Path, scene: Scene, count: int, what: str
) -> None:
    """9 MB of subframes took 40 seconds, and 10 MB of shapes that a scene does not take as long."""
    start = "* o{}\n0 0 0\n0 0 0 1\n"
    box = "1\nbox\n1 1 1\n5 0 0\n0 0 0 1\n0 0 0 0\n"
    text = {
        "shapes": start + f"{10**8}\nand no more",
        "objects": "".join(start.format(i) + "0\n0\n" for i in range(count)),
        "subframes": start + box + f"{count}\nand no more",
    }[what]
    before = scene.bodies
    with pytest.raises(InvalidScene, match=rf"(100,000,000|10,001) {what}.* at most (2,000|10,000)"):
        scene.add_file(written(tmp_path, "large.scene", f"world\n{text}\n.\n"))
    assert scene.bodies == before


BALL = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'


def with_a_tool_of(balls: int) -> kinseek.Arm:
    """A UR5e with so many shapes at its last link."""
    urdf = kinseek.load("ur5e").chain.urdf.decode()
    return kinseek.load(urdf.replace('<link name="tool0"/>', f'<link name="tool0">{balls * BALL}</link>'))


MANY: dict[str, Callable[[int], str]] = {
    "bodies.scene": lambda count: (
        "world\n"
        + "".join(f"* o{i}\n1\nbox\n1 1 1\n{i} 0 0\n0 0 0 1\n0 0 0 0\n" for i in range(count))
        + ".\n"
    ),
    "body.scene": lambda count: (
        f"world\n* many\n{count}" + count * "\nsphere\n1\n5 0 0\n0 0 0 1\n0 0 0 0" + "\n.\n"
    ),
    "body.urdf": lambda count: f'<robot name="many"><link name="many">{count * BALL}</link></robot>',
}


@pytest.mark.filterwarnings("ignore::kinseek.UnitWarning")  # Some stand kilometres away.
@pytest.mark.slow
@pytest.mark.parametrize("name", MANY)
def test_too_many_shapes_are_refused_in_one_body_or_many(name: str, tmp_path: Path, scene: Scene) -> None:
    """Each two are a pair: 1 MB of text with 30,000 boxes filled the memory, and of 10,000 spheres the first question took
    minutes."""
    told = f"{MOST_SHAPES + 1:,} shapes of bodies, expected at most {MOST_SHAPES:,}"
    before = scene.bodies
    room = MOST_SHAPES - len(before)  # Each has one.
    with pytest.raises(InvalidScene, match=told):
        scene.add_file(written(tmp_path, name, MANY[name](room + 1)))
    assert scene.bodies == before
    added = scene.add_file(written(tmp_path, name, MANY[name](room)))
    assert scene.bodies == (*before, *added)
    with pytest.raises(InvalidScene, match=told):
        scene.add_box("one more", (1, 1, 1))
    with pytest.raises(InvalidScene, match=told):
        scene.attach("one more", Box((1, 1, 1)), "tool0")


def test_too_many_pairs_of_shapes_are_refused(tmp_path: Path) -> None:
    """A link and an obstacle of 990 shapes each took 6 GB."""
    scene = Scene.of(with_a_tool_of(500))
    scene.add_file(written(tmp_path, "cell.urdf", MANY["body.urdf"](500)))
    with pytest.raises(
        InvalidScene, match=f"250,000 pairs of shapes have to be checked, expected at most {MOST_PAIRS:,}"
    ):
        scene.free(np.zeros(6))


@pytest.mark.slow
def test_arms_of_very_many_joints_are_refused() -> None:
    """1,000 joints took more memory than most machines have."""

    def snake(joints: int) -> kinseek.Arm:
        row = [(0.1, 0.3, 0.0, 0.0)] * joints
        return kinseek.Arm.from_dh(row, np.full(joints, -0.1), np.full(joints, 0.1))

    with pytest.raises(InvalidScene, match=f"151 moving joints, expected at most {MOST_JOINTS} in a scene"):
        Scene.of(snake(MOST_JOINTS + 1), capsules=0.01)
    longest = snake(MOST_JOINTS)
    assert Scene.of(longest, capsules=0.01, samples=1).free(np.zeros(MOST_JOINTS)) in (True, False)


def test_binary_nonsense_is_no_text(tmp_path: Path, scene: Scene) -> None:
    (tmp_path / "cell.scene").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidScene, match="is not text"):
        scene.add_file(tmp_path / "cell.scene")


@pytest.mark.slow
def test_a_scene_that_is_cut_short_or_has_a_wrong_word_is_no_other_scene(tmp_path: Path) -> None:
    """Each word becomes another; what is read then has as many shapes, or is refused in our words."""
    path = tmp_path / "cell.scene"
    whole = [
        len(body.parts) for body in obstacles(written(tmp_path, "cell.scene", MOVEIT), {}, False, True)[0]
    ]
    for end in range(0, len(MOVEIT) - 2, 3):
        path.write_text(MOVEIT[:end], encoding="utf-8")
        with pytest.raises(InvalidScene):
            obstacles(path, {}, False, True)
    read = 0
    for word in re.finditer(r"\S+", MOVEIT[len("the cell") :]):
        begin, end = (place + len("the cell") for place in word.span())
        for other in ("x", "-1", "1e999", "999999999", "*", ".", "nan", ""):
            path.write_text(MOVEIT[:begin] + other + MOVEIT[end:], encoding="utf-8")
            try:
                found, _ = obstacles(path, {}, False, True)
            except InvalidScene:
                continue
            read += 1
            assert other == "." or [len(body.parts) for body in found] == whole
    assert read > 50


def tree(joints: list[tuple[str, str, str]]) -> Robot:
    """Links and joints alone: the kind of each joint, and the links above and below."""
    text = "".join(
        f'<joint type="{kind}">{50 * "<a/>"}<parent link="{above}"/><child link="{below}"/></joint>'
        for kind, above, below in joints
    )
    return read_robot(f"<robot>{text}</robot>".encode(), "")


def climbed(joints: list[tuple[str, str, str]], solid: set[str]) -> list[tuple[str, str]]:
    """Pairs of neighbours, found by climbing from every link."""
    above = {below: (parent, kind) for kind, parent, below in joints}
    pairs = []
    for child in solid:
        link, moving = child, 0
        while link in above:
            link, kind = above[link]
            moving += kind != "fixed"
            if link in solid:
                break
        if link in solid and link != child and moving <= 1:
            pairs.append((link, child))
    return sorted(pairs)


def test_neighbours_are_those_that_climbing_finds() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        joints = [
            (str(rng.choice(["fixed", "revolute"])), f"l{rng.integers(max(0, i - 5), i)}", f"l{i}")
            for i in range(1, 40)
        ]
        rng.shuffle(joints)
        joints = [(str(a), str(b), str(c)) for a, b, c in joints]
        solid = {f"l{i}" for i in np.flatnonzero(rng.random(40) < rng.choice([0.2, 0.5, 0.9]))}
        assert neighbours_of(tree(joints), solid) == climbed(joints, solid)


@pytest.mark.slow
def test_neighbours_of_long_chains_are_found_in_no_time() -> None:
    """For each of the last links the whole chain was climbed: 8 MB took more than a minute."""
    chain = [("fixed", f"l{i}", f"l{i + 1}") for i in range(5000)]
    ends = [("fixed", "l5000", f"end{i}") for i in range(1500)]
    robot = tree(chain + ends)
    begun = time.process_time()
    found = neighbours_of(robot, {"l0", *(below for _, _, below in ends)})
    assert time.process_time() - begun < 1.0
    assert len(found) == len(ends)


def test_the_number_of_shapes_is_counted_as_they_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinseek.collision.bodies.neighbours_of", lambda *_: pytest.fail("it went on"))
    with pytest.raises(InvalidScene, match=f"{MOST_SHAPES + 1:,} shapes of bodies"):
        Scene.of(with_a_tool_of(MOST_SHAPES + 1))


def test_an_arm_of_many_joints_is_sampled_in_time(tmp_path: Path) -> None:
    """The joints were made anew for each pair, which took half a minute."""
    link = '<link name="l{}"><collision><geometry><box size="0.01 0.01 0.01"/></geometry></collision></link>'
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="l{0}"/><child link="l{1}"/><origin xyz="0 0 0.1"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint>'
    )
    parts = [*map(link.format, range(91)), *(joint.format(i, i + 1) for i in range(90))]
    path = written(tmp_path, "long.urdf", f'<robot name="long">{"".join(parts)}</robot>')
    begin = time.process_time()
    assert len(Scene.of(path, samples=20).bodies) == 91
    assert time.process_time() - begin < 5


def test_the_triangles_of_all_scales_have_one_limit(
    tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """33 kB of triangles at 1,980 scales took 9 GB."""
    write_stl(tmp_path / "part.stl", *box_mesh((1.0, 1.0, 1.0)))
    shape = '<collision><geometry><mesh filename="part.stl" scale="1 1 {}"/></geometry></collision>'
    shapes = "".join(shape.format(1 + i % 5) for i in range(50))
    (tmp_path / "cell.urdf").write_text(f'<robot name="c"><link name="part">{shapes}</link></robot>')
    monkeypatch.setattr(bodies, "MOST_TRIANGLES", 60)
    scene.add_file(tmp_path / "cell.urdf", prefix="a ")
    monkeypatch.setattr(bodies, "MOST_TRIANGLES", 59)
    with pytest.raises(
        InvalidScene, match="each scale counted, have 60 triangles together, expected at most 59"
    ):
        scene.add_file(tmp_path / "cell.urdf", prefix="b ")


@pytest.mark.parametrize(("noun", "most"), [("triangles", 24), ("vertices", 24)])
def test_the_meshes_of_a_moveit_scene_have_one_limit(
    noun: str, most: int, tmp_path: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """5 million triangles were accepted, which took a minute and 3.6 GB."""
    vertices, triangles = (
        box_mesh((1.0, 1.0, 1.0)) if noun == "triangles" else (np.eye(3)[[0, 1, 2] * 4], [[0, 1, 2]])
    )
    numbers = "\n".join(
        " ".join(map(str, row)) for row in [*np.asarray(vertices).tolist(), *np.asarray(triangles).tolist()]
    )
    mesh = f"1\nmesh\n{len(vertices)} {len(triangles)}\n{numbers}\n0 0 0\n0 0 0 1\n0 0 0 0\n"
    path = written(tmp_path, "cell.scene", f"cell\n* a\n{mesh}* b\n{mesh}.\n")
    monkeypatch.setattr(bodies, "MOST_TRIANGLES", most)
    scene.add_file(path, prefix="one ")
    monkeypatch.setattr(bodies, "MOST_TRIANGLES", most - 1)
    with pytest.raises(
        InvalidScene, match=f"up to that of 'b' have {most} {noun} together, expected at most {most - 1}"
    ):
        scene.add_file(path, prefix="two ")


def test_a_warning_that_is_made_an_error_leaves_the_scene_as_it_was(scene: Scene, tmp_path: Path) -> None:
    before, far = scene.bodies, kinseek.pose([1000.0, 0.0, 0.0])
    (tmp_path / "cell.urdf").write_text(
        '<robot name="c"><link name="t"><collision><origin xyz="900 0 0"/><geometry><box size="1 1 1"/></geometry>'
        "</collision></link></robot>"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for add in (
            lambda: scene.add_box("t", (1, 1, 1), far),
            lambda: scene.attach("t", Box((1000, 1, 1)), "tool0"),
            lambda: scene.add_file(tmp_path / "cell.urdf"),
        ):
            with pytest.raises(kinseek.UnitWarning):
                add()
    assert scene.bodies == before


def test_deviations_are_at_least_zero(scene: Scene) -> None:
    for reach in (-1.0, np.nan, [0.1, 0.1, 0.1, 0.1, 0.1, -1e-3]):
        with pytest.raises(kinseek.InvalidProblem, match="reach must be at least 0"):
            scene.hits_around(np.zeros(6), reach)
