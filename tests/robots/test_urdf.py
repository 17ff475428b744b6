"""URDF and xacro: real files against stored poses, random chains against plain NumPy, and every bad input."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike

from bad_urdf import BAD_FILES
from kinseek.errors import InvalidRobot
from kinseek.kernels.arm.forward import forward_many
from kinseek.robots import SerialChain, read, read_urdf
from kinseek.robots.chain import Array
from kinseek.robots.joints import Mimics
from kinseek.support.transforms import rotation, transform
from places import SHARED
from robot_files import LIMIT, SECOND, joint, link, robot, write

NEEDS_SHARED = pytest.mark.skipif(not SHARED.is_dir(), reason="the shared robots are not here")
FLEET = json.loads((SHARED / "robots.json").read_text()) if SHARED.is_dir() else {}
MESSY_TIPS = [
    ("xacro_wx250s", "wx250s/ee_gripper_link"),
    ("xacro_wx250s", "wx250s/left_finger_link"),
    ("urdf_meshes_panda", "panda_link8"),
    ("urdf_meshes_panda", "panda_leftfinger"),
    ("urdf_tree_yumi", "yumi_link_7_l"),
    ("urdf_tree_yumi", "gripper_l_finger_r"),
    ("urdf_tree_yumi", "gripper_r_finger_r"),
]


def fk(chain: SerialChain, q: ArrayLike) -> Array:
    return forward_many(chain.arrays, np.array(q, dtype=float))


# Real files


@NEEDS_SHARED
@pytest.mark.parametrize("name", FLEET)
def test_fleet_agrees_with_stored_poses(name: str) -> None:
    stored = np.load(SHARED / "fk" / f"{name}.npz")
    chain = read_urdf(SHARED / f"{name}.urdf", FLEET[name]["base"], FLEET[name]["tip"])
    assert chain.joint_names == tuple(stored["joint_names"])
    assert np.abs(fk(chain, stored["q"]) - stored["T"]).max() < 1e-12
    limited = np.array([kind != "continuous" for kind in chain.kinds])
    np.testing.assert_array_equal(chain.lower[limited], stored["lower"][limited])
    np.testing.assert_array_equal(chain.upper[limited], stored["upper"][limited])


@NEEDS_SHARED
@pytest.mark.parametrize(("name", "tip"), MESSY_TIPS)
def test_messy_files_agree_with_stored_poses(name: str, tip: str, capfd: pytest.CaptureFixture[str]) -> None:
    messy = json.loads((SHARED / "messy" / "messy.json").read_text())[name]
    stored = np.load(SHARED / "messy" / name / "expected_fk.npz")
    capfd.readouterr()
    chain = read(SHARED / "messy" / messy["file"], messy["base"], tip)
    assert capfd.readouterr() == ("", "")
    columns = [list(stored["joint_names"]).index(joint) for joint in chain.joint_names]
    expected = stored["T_" + tip.replace("/", "__")]
    assert np.abs(fk(chain, stored["q"][:, columns]) - expected).max() < 1e-12


@NEEDS_SHARED
def test_follower_whose_leader_is_beside_the_path_is_refused() -> None:
    path = SHARED / "messy" / "urdf_meshes_panda" / "panda.urdf"
    with pytest.raises(InvalidRobot, match=r"panda_finger_joint1.*does not move between base and tip"):
        read_urdf(path, tip="panda_rightfinger")


@NEEDS_SHARED
def test_several_leaves_are_listed() -> None:
    path = SHARED / "messy" / "urdf_meshes_panda" / "panda.urdf"
    with pytest.raises(InvalidRobot, match=r"branches.*panda_leftfinger, panda_rightfinger"):
        read_urdf(path)


# Random chains


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


LINKS = st.fixed_dictionaries(
    {
        "kind": st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]),
        "xyz": st.tuples(*[number(-1, 1)] * 3),
        "rpy": st.tuples(*[number(-4, 4)] * 3),
        "axis": st.tuples(*[number(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
        "mimic": st.none() | st.tuples(st.integers(0, 9), number(-2, 2), number(-1, 1)),
    }
)


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(st.lists(LINKS, min_size=1, max_size=9), st.randoms(use_true_random=False))
def test_random_chain_is_the_product_of_its_transforms(
    tmp_path: Path, links: list[dict[str, Any]], random: Random
) -> None:
    q = [random.uniform(-3, 3) for _ in links]
    value: list[float] = []
    expected = np.eye(4)
    joints = []
    variables = []
    for i, drawn in enumerate(links):
        x, y, z = np.eye(3)
        axis = np.array(drawn["axis"]) / np.linalg.norm(drawn["axis"])
        roll, pitch, yaw = drawn["rpy"]
        turn = rotation(z, yaw) @ rotation(y, pitch) @ rotation(x, roll)
        moves = drawn["kind"] != "fixed"
        leaders = [k for k in range(i) if links[k]["kind"] != "fixed"]
        inside = (
            f'<origin xyz="{" ".join(map(repr, drawn["xyz"]))}" rpy="{" ".join(map(repr, drawn["rpy"]))}"/>'
            f'<axis xyz="{" ".join(repr(float(v)) for v in axis)}"/>'
        )
        if moves and drawn["mimic"] and leaders:
            pick, multiplier, offset = drawn["mimic"]
            leader = leaders[pick % len(leaders)]
            inside += f'<mimic joint="j{leader}" multiplier="{multiplier}" offset="{offset}"/>'
            value.append(multiplier * value[leader] + offset)
        else:
            inside += '<limit lower="-9" upper="9"/>'
            value.append(q[i])
            if moves:
                variables.append(q[i])
        joints.append(joint(f"j{i}", f"l{i} l{i + 1}", drawn["kind"], inside))
        expected = expected @ transform(turn, drawn["xyz"])
        if drawn["kind"] == "prismatic":
            expected = expected @ transform(np.eye(3), value[i] * axis)
        elif moves:
            expected = expected @ transform(rotation(axis, value[i]), (0, 0, 0))
    text = robot(*joints, links=" ".join(f"l{i}" for i in range(len(links) + 1)))
    path = write(tmp_path, "r.urdf", text)
    if not variables:
        with pytest.raises(InvalidRobot, match=r"no movable joint"):
            read_urdf(path)
        return
    chain = read_urdf(path)
    np.testing.assert_allclose(fk(chain, [variables])[0], expected, rtol=0, atol=1e-11)


# Small matters


def test_defaults_are_those_of_urdf(tmp_path: Path) -> None:
    chain = read_urdf(write(tmp_path, "r.urdf", robot(joint(), links="a b")))
    assert (chain.base, chain.tip, chain.name) == ("a", "b", "r")
    np.testing.assert_allclose(
        fk(chain, [[0.3]])[0, :3, :3], rotation(np.array([1.0, 0, 0]), 0.3), atol=1e-15
    )


def test_meshes_sensors_and_strange_tags_are_never_looked_at(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    noise = (
        '<!-- x --><gazebo><joint name="j"/></gazebo><transmission name="t"/><material name="m"/><odd/>',
        link("b", '<visual><geometry><mesh filename="package://none/x.stl"/></geometry></visual>'),
    )
    text = robot(joint(inside=f'{LIMIT}<dynamics damping="x"/><odd/>'), *noise, links="a")
    assert read_urdf(write(tmp_path, "r.urdf", text)).dof == 1
    assert capfd.readouterr() == ("", "")


def test_chained_mimics_lead_through_a_joint_beside_the_path(tmp_path: Path) -> None:
    text = robot(
        joint("j", "a b", inside='<limit lower="-9" upper="9"/>'),
        joint("side", "b s", inside='<mimic joint="j" multiplier="2" offset="1"/>'),
        joint("k", "b c", inside='<mimic joint="side" multiplier="3" offset="-1"/>'),
        links="a b c s",
    )
    chain = read_urdf(write(tmp_path, "r.urdf", text), tip="c")
    assert chain.joint_names == ("j",)
    np.testing.assert_array_equal(chain.multiplier, [1, 6])
    np.testing.assert_array_equal(chain.offset, [0, 2])


def test_a_long_chain_of_mimics_is_walked_once() -> None:
    visits = 0

    class Counted(dict[str, tuple[str, float, float]]):
        def __getitem__(self, name: str) -> tuple[str, float, float]:
            nonlocal visits
            visits += 1
            return super().__getitem__(name)

    count = 2000
    for names in (range(count), range(count - 1, -1, -1)):
        mimics = Mimics(Counted({f"j{i}": (f"j{i + 1}", -1.0, 1.0) for i in range(count)}))
        visits = 0
        drivers = {i: mimics.driver(f"j{i}") for i in names}
        assert drivers[0] == (f"j{count}", 1.0, 0.0)
        assert drivers[1] == (f"j{count}", -1.0, 1.0)
        assert visits <= 2 * count
    assert mimics.driver("k") == ("k", 1.0, 0.0)
    with pytest.raises(InvalidRobot, match=r"mimic joints form a loop: a -> b -> b$"):
        Mimics({"a": ("b", 1.0, 0.0), "b": ("b", 1.0, 0.0)}).driver("a")


@pytest.mark.parametrize(
    ("leader", "follower", "expected"),
    [
        ("-9 9", "-1 2", (-2.5, -1.0)),
        ("-2 9", "-1 2", (-2.0, -1.0)),
        ("-9 9", "0 0", (-9.0, 9.0)),
        (None, "-1 2", (-2.5, -1.0)),
        ("-0.5 9", "-1 2", None),
    ],
)
def test_a_followers_limits_narrow_its_leader(
    tmp_path: Path, leader: str | None, follower: str, expected: tuple[float, float] | None
) -> None:
    def limit(text: str) -> str:
        return '<limit lower="{}" upper="{}"/>'.format(*text.split())

    text = robot(
        joint(inside=limit(leader)) if leader else joint(kind="continuous", inside=""),
        joint("k", "b c", inside=limit(follower) + '<mimic joint="j" multiplier="-2" offset="-3"/>'),
    )
    path = write(tmp_path, "r.urdf", text)
    if expected is None:
        with pytest.raises(
            InvalidRobot, match=r"'k' with limits \[-1.0, 2.0\] leaves no value for joint 'j'"
        ):
            read_urdf(path)
        return
    chain = read_urdf(path)
    assert (chain.lower[0], chain.upper[0]) == expected
    assert chain.kinds == ("revolute",)


@pytest.mark.parametrize(("offset", "sound"), [("2", True), ("2.1", False), ("-1.1", False)])
def test_a_follower_that_never_moves_stands_inside_its_limits(
    tmp_path: Path, offset: str, sound: bool
) -> None:
    inside = f'<limit lower="-1" upper="2"/><mimic joint="j" multiplier="0" offset="{offset}"/>'
    path = write(tmp_path, "r.urdf", robot(joint(), joint("k", "b c", inside=inside)))
    if sound:
        assert read_urdf(path).offset[1] == float(offset)
        return
    with pytest.raises(
        InvalidRobot, match=rf"'k' with limits \[-1.0, 2.0\] always stands at {offset}, outside"
    ):
        read_urdf(path)


def test_joints_beside_the_path_may_be_anything(tmp_path: Path) -> None:
    text = robot(
        joint("float", "w a", "floating", ""),
        joint(),
        joint("side", "b s", "planar", ""),
        joint("loose", "b t", "revolute", ""),
        links="w a b s t",
    )
    assert read_urdf(write(tmp_path, "r.urdf", text), base="a", tip="b").joint_names == ("j",)
    with pytest.raises(InvalidRobot, match=r"'float' is floating.*Choose base='a'"):
        read_urdf(tmp_path / "r.urdf", tip="b")
    with pytest.raises(InvalidRobot, match=r"'side' is planar"):
        read_urdf(tmp_path / "r.urdf", base="a", tip="s")


# Bad input


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_file_is_refused_with_a_reason(
    case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text, message = BAD_FILES[case]
    with pytest.raises(InvalidRobot, match=message):
        read_urdf(write(tmp_path, "r.urdf", text))
    assert capfd.readouterr() == ("", "")


def test_missing_file_names_its_neighbours(tmp_path: Path) -> None:
    path = write(tmp_path, "panda.urdf", robot(joint(), SECOND))
    with pytest.raises(InvalidRobot, match=r"no file .*pandas.urdf.*did you mean 'panda.urdf'"):
        read_urdf(path.with_name("pandas.urdf"))
    with pytest.raises(InvalidRobot, match=r"no file .*'$"):
        read_urdf(tmp_path / "empty" / "x.urdf")
    (tmp_path / "folder.urdf").mkdir()
    with pytest.raises(InvalidRobot, match=r"cannot read"):
        read_urdf(tmp_path / "folder.urdf")


def test_base_and_tip_must_exist_and_differ(tmp_path: Path) -> None:
    path = write(tmp_path, "r.urdf", robot(joint(), SECOND))
    with pytest.raises(InvalidRobot, match=r"unknown link 'aa'; did you mean 'a'.*Valid: a, b, c"):
        read_urdf(path, base="aa")
    with pytest.raises(InvalidRobot, match=r"unknown link 'z'. Valid"):
        read_urdf(path, tip="z")
    with pytest.raises(InvalidRobot, match=r"no movable joint between base 'b' and tip 'b'"):
        read_urdf(path, base="b", tip="b")


@pytest.mark.parametrize("root", ["", ' xmlns="http://www.ros.org"', ' xmlns:x="http://www.ros.org"'])
def test_a_namespace_of_its_own_hides_no_element(root: str, tmp_path: Path) -> None:
    """The origin was left out; readers of ROS know no namespaces."""
    text = joint(inside='<origin xmlns="u" xyz="0 0 0.5"/><limit lower="-1" upper="1"/>')
    path = write(tmp_path, "r.urdf", robot(text, links="a b").replace("<robot", f"<robot{root}"))
    assert read_urdf(path).fixed[0, 2, 3] == 0.5


def test_a_prefix_for_the_namespace_of_the_root_is_rejected(tmp_path: Path) -> None:
    """Readers of ROS ignored the origin, which was read here."""
    text = joint(inside='<p:origin xyz="0 0 0.5"/><limit lower="-1" upper="1"/>')
    spaces = '<robot xmlns="u" xmlns:p="u"'
    path = write(tmp_path, "r.urdf", robot(text, links="a b").replace("<robot", spaces))
    with pytest.raises(InvalidRobot, match="<p:origin> in line 1 is of the namespace of the root"):
        read_urdf(path)


@pytest.mark.parametrize(("encoding", "end"), [("UTF-7", "--+AD4-"), ("JAVA", "--\\u003e")])
def test_an_encoding_that_hides_markup_is_rejected(encoding: str, end: str, tmp_path: Path) -> None:
    """Readers of ROS, and editors, see the origin in a comment."""
    text = joint(inside=f'<!-- {end}<origin xyz="0 0 0.5"/><!-- --><limit lower="-1" upper="1"/>')
    head = f'<?xml version="1.0" encoding="{encoding}"?>'
    path = write(tmp_path, "r.urdf", head + robot(text, links="a b"))
    with pytest.raises(InvalidRobot, match=f"the encoding '{encoding}' is not read|Unsupported encoding"):
        read_urdf(path)


@pytest.mark.parametrize(
    "declared",
    ["<!-- ><robot name='other'/> -->", "<!ATTLIST axis xyz CDATA '1 0 0'>", "<!ENTITY e '<axis/>'>", ""],
)
def test_a_document_type_is_rejected(declared: str, tmp_path: Path) -> None:
    """For readers of ROS it ends at the first >: the comment is another robot for them."""
    path = write(tmp_path, "r.urdf", f"<!DOCTYPE robot [{declared}]>{robot(joint(), SECOND)}")
    with pytest.raises(
        InvalidRobot, match=r"it has a document type \(<!DOCTYPE …>\), which MuJoCo and readers of ROS"
    ):
        read_urdf(path)


@pytest.mark.parametrize("encoding", ["UTF-8", "UTF-16", "US-ASCII", "iso-8859-1", "Windows-1252", "GB2312"])
def test_usual_encodings_are_read(encoding: str, tmp_path: Path) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?>{robot(joint(), SECOND)}'
    path = write(tmp_path, "r.urdf", text.encode(encoding))
    assert read_urdf(path).tip == "c"
