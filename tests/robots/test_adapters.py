"""Arms from what people hold: forward kinematics against the library that the model is of."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import InvalidRobot
from kinseek.robots import catalog_path
from pinocchio_poses import pinocchio_poses

Array = NDArray[np.float64]
ARMS = ("ur5e", "panda", "jaco2_6", "ur10e_rail", "scara4")

EVERYTHING = """
<robot name="everything">
  <link name="a"/><link name="b"/><link name="c"/><link name="d"/><link name="e"/><link name="f"/>
  <joint name="turn" type="continuous"><parent link="a"/><child link="b"/>
    <origin xyz="0.1 0.2 0.3" rpy="0.3 -0.2 0.1"/><axis xyz="0.6 0 0.8"/></joint>
  <joint name="slide" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0 0.2 0" rpy="0 0.4 0"/>
    <axis xyz="0 -0.8 0.6"/><limit lower="-0.3" upper="0.4" effort="1" velocity="1"/></joint>
  <joint name="follower" type="prismatic"><parent link="c"/><child link="d"/><origin xyz="0.1 0 0" rpy="0 0 1"/>
    <axis xyz="0 -1 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/>
    <mimic joint="slide" multiplier="-2" offset="0.1"/></joint>
  <joint name="stay" type="fixed"><parent link="d"/><child link="e"/><origin xyz="0 0 0.1" rpy="1 0 0"/></joint>
  <joint name="bend" type="revolute"><parent link="e"/><child link="f"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
</robot>
"""


def urdf(name: str) -> str:
    return catalog_path(name).read_text(encoding="utf-8")


def same(arm: kinseek.Arm, expected: kinseek.Arm, atol: float = 1e-14) -> None:
    """Two arms are one, names and limits and the poses of all links."""
    assert arm.joint_names == expected.joint_names
    assert arm.kinds == expected.kinds
    assert (arm.base, arm.tip, arm.name) == (expected.base, expected.tip, expected.name)
    np.testing.assert_array_equal([arm.lower, arm.upper], [expected.lower, expected.upper])
    q = expected.sample(50)
    np.testing.assert_allclose(arm.fk(q), expected.fk(q), rtol=0, atol=atol)
    for link in expected.chain.frames:
        if link in arm.chain.frames:
            np.testing.assert_allclose(arm.fk(q, link=link), expected.fk(q, link=link), rtol=0, atol=atol)


SOFT = """<robot name="soft"><link name="a"/><link name="b"/><link name="c"/>
  <joint name="one" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
    <safety_controller k_velocity="9" soft_lower_limit="-0.5" soft_upper_limit="1.5"/></joint>
  <joint name="two" type="revolute"><parent link="b"/><child link="c"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/><safety_controller k_velocity="9"/></joint></robot>"""


@pytest.mark.parametrize("package", ["kinseek", "yourdfpy", "urdf_parser_py"])
def test_soft_limits_come_along(package: str) -> None:
    source: Any = SOFT
    if package == "yourdfpy":
        yourdfpy = pytest.importorskip("yourdfpy")
        source = yourdfpy.URDF.load(io.BytesIO(SOFT.encode()), load_meshes=False)
    elif package == "urdf_parser_py":
        source = pytest.importorskip("urdf_parser_py.urdf").URDF.from_xml_string(SOFT)
    arm = kinseek.load(source)
    assert (arm.lower.tolist(), arm.upper.tolist()) == ([-0.5, -1.0], [1.5, 2.0])


# --- text -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ARMS)
def test_the_text_of_a_urdf(name: str) -> None:
    bundled = kinseek.load(name)
    for text in (
        urdf(name),
        urdf(name).encode(),
        "\ufeff\n  <?xml version='1.0' encoding='latin-1'?>\n" + urdf(name),
    ):
        same(kinseek.load(text, base=bundled.base, tip=bundled.tip), bundled)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot name='r'><link", "the URDF text: broken XML: "),
        ("<robot name='r'><link name='a'/></robot>", "no movable joint between base 'a' and tip 'a'"),
        ("<sdf version='1.6'/>", "the URDF text: not a robot: the root tag is <sdf>"),
        ("<mujoco><worldbody/></mujoco>", r"text of an MJCF file: .*mujoco.MjModel.from_xml_string\(text\)"),
    ],
)
def test_text_that_is_no_robot(text: str, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load(text)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (Path(EVERYTHING), "this is the text of a robot in a path: give the text itself"),
        (
            "robot: ur5e\njoints: 6\n",
            "this is text of 22 letters and no path; the text of a robot begins with <robot",
        ),
        ("file:///home/ur5e.urdf", "give the path of the file, without file://"),
        ("arm.sdf", ".sdf files are not read: export the arm as URDF or MJCF"),
        ("UR5e", "unknown robot 'UR5e'; did you mean 'ur5e'\\? Names of bundled arms are lower-case"),
        ("KR6-R900", "did you mean 'kr6r900'"),
        ("Panda.urdf", "no file 'Panda.urdf'"),
    ],
)
def test_what_is_neither_gets_a_hint(source: Any, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load(source)


# --- models of other libraries --------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ARMS, "everything"])
def test_a_model_of_yourdfpy(name: str, tmp_path: Path) -> None:
    yourdfpy = pytest.importorskip("yourdfpy")
    path = tmp_path / "r.urdf"
    path.write_text(EVERYTHING if name == "everything" else urdf(name))
    model = yourdfpy.URDF.load(str(path), load_meshes=False)
    expected = kinseek.load(str(path), tip=None if name == "everything" else kinseek.load(name).tip)
    arm = kinseek.load(model, tip=expected.tip)
    same(arm, expected)
    q = arm.sample(1)[0]
    model.update_cfg(dict(zip(arm.joint_names, q, strict=True)))
    np.testing.assert_allclose(model.get_transform(arm.tip, arm.base), arm.fk(q), rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_a_model_of_pinocchio(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    bundled, model = kinseek.load(name), pin.buildModelFromUrdf(str(catalog_path(name)))
    arm = kinseek.load(model, base=bundled.base, tip=bundled.tip)
    same(arm, bundled, 1e-12)
    assert kinseek.load(model, tip=bundled.tip).base == kinseek.load(catalog_path(name), tip=bundled.tip).base
    q = arm.sample(20)
    np.testing.assert_allclose(arm.fk(q), pinocchio_poses(pin, model, arm, q), rtol=0, atol=1e-12)


def test_a_model_of_pinocchio_with_every_kind_of_joint() -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromXML(EVERYTHING, mimic=True)
    arm = kinseek.load(model)
    assert arm.kinds == ("continuous", "prismatic", "revolute")
    expected = kinseek.load(EVERYTHING)
    q = arm.sample(20)
    np.testing.assert_allclose(arm.fk(q), expected.fk(q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(arm.fk(q), pinocchio_poses(pin, model, arm, q), rtol=0, atol=1e-12)
    part = kinseek.load(model, base="b", tip="e")
    np.testing.assert_allclose(
        part.fk(q[:, 1:2]), kinseek.load(EVERYTHING, base="b", tip="e").fk(q[:, 1:2]), rtol=0, atol=1e-12
    )
    same(kinseek.load(pin.RobotWrapper(model)), arm)


def test_a_model_of_pinocchio_put_together_by_hand() -> None:
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Random(), "first")
    second = model.addJoint(first, pin.JointModelRX(), pin.SE3.Random(), "second")
    arm = kinseek.load(model)
    assert arm.kinds == ("continuous", "continuous")
    assert (arm.base, arm.tip) == ("universe", "second")
    data = model.createData()
    pin.forwardKinematics(model, data, np.array([0.3, -0.4]))
    np.testing.assert_allclose(arm.fk([0.3, -0.4]), data.oMi[second].homogeneous, rtol=0, atol=1e-14)
    tool = pin.SE3.Random()
    model.addFrame(pin.Frame("tool", second, 0, tool, pin.FrameType.OP_FRAME))
    carried = kinseek.load(model, tip="tool")
    np.testing.assert_allclose(
        carried.fk([0.3, -0.4]), (data.oMi[second] * tool).homogeneous, rtol=0, atol=1e-14
    )
    ball = model.addJoint(second, pin.JointModelSpherical(), pin.SE3.Random(), "ball")
    model.addFrame(pin.Frame("hand", ball, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    with pytest.raises(
        InvalidRobot, match=r"joint 'ball' is a JointModelSpherical: .*turn about an axis or slide"
    ):
        kinseek.load(model, tip="hand")
    with pytest.raises(InvalidRobot, match="unknown frame 'hnad'; did you mean 'hand'"):
        kinseek.load(model, tip="hnad")


def test_a_model_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string("""
<mujoco model="three"><compiler angle="radian"/><worldbody><body name="one" pos="0.1 0 0.2" euler="0.1 0.2 0.3">
  <geom size="0.1"/><joint name="a" axis="1 2 3" range="-1 2" limited="true"/>
  <body name="two" pos="0 0 0.5"><geom size="0.1"/>
    <joint name="b" type="slide" axis="0 1 0" range="-0.2 0.3" limited="true" ref="0.1"/>
    <body name="three" pos="0.3 0 0"><geom size="0.1"/><joint name="c" pos="0 0.1 0"/><site name="hand" pos="0 0 0.1"/>
    </body></body></body></worldbody></mujoco>""")
    arm = kinseek.load(model, tip="hand")
    assert (arm.name, arm.base, arm.joint_names) == ("three", "world", ("a", "b", "c"))
    assert arm.kinds == ("revolute", "prismatic", "continuous")
    data = mujoco.MjData(model)
    for q in arm.sample(10):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(arm.fk(q)[:3, 3], data.site("hand").xpos, rtol=0, atol=1e-14)
        np.testing.assert_allclose(arm.fk(q)[:3, :3].ravel(), data.site("hand").xmat, rtol=0, atol=1e-14)


# --- robot_descriptions ---------------------------------------------------------------------------------------------


def test_a_name_of_robot_descriptions(monkeypatch: pytest.MonkeyPatch) -> None:
    package, described = ModuleType("robot_descriptions"), ModuleType("robot_descriptions.ur5e_description")
    package.__dict__["DESCRIPTIONS"] = {"ur5e_description": None, "broken_description": None}
    described.__dict__["URDF_PATH"] = str(catalog_path("ur5e"))
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    monkeypatch.setitem(sys.modules, "robot_descriptions.ur5e_description", described)
    same(kinseek.load("ur5e_description", tip="tool0"), kinseek.load("ur5e"))
    with pytest.raises(
        InvalidRobot, match="robot_descriptions has no 'ur6_description'; did you mean 'ur5e_desc"
    ):
        kinseek.load("ur6_description")
    with pytest.raises(InvalidRobot, match="robot_descriptions cannot fetch 'broken_description': "):
        kinseek.load("broken_description")


def test_a_file_of_robot_descriptions_need_not_be_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python evaluated it whatever `trusted` was."""
    package, described = ModuleType("robot_descriptions"), ModuleType("robot_descriptions.one_description")
    package.__dict__["DESCRIPTIONS"] = {"one_description": None}
    path = tmp_path / "one.xacro"
    path.write_text(
        EVERYTHING.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"').replace(
            'upper="2"', 'upper="${list(2 for _ in [1])[0]}"'
        )
    )
    described.__dict__["XACRO_PATH"] = str(path)
    monkeypatch.setitem(sys.modules, "robot_descriptions", package)
    monkeypatch.setitem(sys.modules, "robot_descriptions.one_description", described)
    assert kinseek.load("one_description").upper[-1] == 2.0
    with pytest.raises(InvalidRobot, match="not trusted"):
        kinseek.load("one_description", trusted=False)


def test_where_robot_descriptions_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "robot_descriptions", None)
    with pytest.raises(InvalidRobot, match="not installed: pip install robot_descriptions"):
        kinseek.load("panda_description")


# --- xacro ----------------------------------------------------------------------------------------------------------

XACRO = """
<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length" default="0.5"/><xacro:arg name="flip" default="false"/>
  <xacro:include filename="$(find my_parts)/part.xacro"/>
  <link name="a"/><link name="b"/><link name="c"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="${up}" effort="1" velocity="1"/></joint>
  <joint name="k" type="fixed"><parent link="b"/><child link="c"/><origin xyz="$(arg length) 0 0"/></joint>
  <xacro:if value="$(arg flip)"><link name="d"/><joint name="l" type="fixed"><parent link="c"/><child link="d"/>
    </joint></xacro:if>
</robot>
"""


@pytest.fixture
def xacro(tmp_path: Path) -> tuple[Path, Path]:
    """A file, and the folder of a package that it needs."""
    package, path = tmp_path / "elsewhere", tmp_path / "here" / "r.urdf.xacro"
    package.mkdir()
    path.parent.mkdir()
    (package / "part.xacro").write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="up" value="2"/></robot>'
    )
    path.write_text(XACRO)
    return path, package


def test_arguments_and_packages_of_a_xacro_file(xacro: tuple[Path, Path]) -> None:
    path, package = xacro
    packages = {"my_parts": package}
    arm = kinseek.load(path, packages=packages)
    assert arm.upper[0] == 2.0
    assert (arm.tip, arm.fk([0.0])[0, 3]) == ("c", 0.5)
    arm = kinseek.load(path, packages={"my_parts": str(package)}, args={"length": 0.75, "flip": True})
    assert (arm.tip, arm.fk([0.0])[0, 3]) == ("d", 0.75)
    # What was said for one file does not hold for the next.
    assert kinseek.load(path, packages=packages).fk([0.0])[0, 3] == 0.5
    with pytest.raises(
        InvalidRobot, match=r"my_parts.* is not found; say where it is with packages=\{name: folder\}"
    ):
        kinseek.load(path)


def test_wrong_arguments_and_packages_are_told(xacro: tuple[Path, Path]) -> None:
    path, package = xacro
    packages = {"my_parts": package}
    with pytest.raises(
        InvalidRobot, match=r"unknown argument 'lenght'; did you mean 'length'. Valid: flip, length"
    ):
        kinseek.load(path, packages=packages, args={"lenght": 1.0})
    with pytest.raises(InvalidRobot, match="package 'my_parts': no folder '/no/such'"):
        kinseek.load(path, packages={"my_parts": "/no/such"})
    for options, message in (
        ({"args": "length:=1"}, "args must be a mapping from names to values, got 'length:=1'"),
        ({"packages": ["here"]}, r"packages must be a mapping from names to folders, got \['here'\]"),
        (
            {"packages": {"my_parts": None}},
            "packages must be a mapping from names to folders, got {'my_parts': None}",
        ),
    ):
        with pytest.raises(InvalidRobot, match=message):
            kinseek.load(path, **options)
    for source in ("panda", catalog_path("panda"), EVERYTHING):
        with pytest.raises(InvalidRobot, match=r"args and packages are for .xacro files"):
            kinseek.load(source, args={"length": 1.0})
