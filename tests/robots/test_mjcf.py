"""MJCF: a real file against stored poses, small models against MuJoCo itself, and bad input."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinseek.errors import InvalidRobot, MissingExtra
from kinseek.kernels.arm.forward import forward_many
from kinseek.robots import read, read_mjcf
from kinseek.robots.chain import Array
from places import SHARED
from robot_files import TURNING, robot, write

mujoco = pytest.importorskip("mujoco")

MESSY = SHARED / "messy"

TREE = """
<mujoco model="small">
  <compiler angle="{angle}"/>
  <default><default class="tight"><joint range="-0.5 0.75" limited="true"/></default></default>
  <worldbody>
    <body name="one" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3">
      <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="a" axis="1 2 3" pos="0.1 -0.2 0.05" range="-1 1"/>
      <joint name="b" type="slide" axis="0 1 1" range="-0.3 0.4" ref="0.2"/>
      <joint name="c" class="tight" axis="0 0 -1" pos="0 0.1 0" ref="0.3"/>
      <site name="on one" pos="0.1 0 0" quat="1 1 0 0"/>
      <frame pos="0 0 0.5" axisangle="0 1 0 0.2">
        <body name="two" pos="0.3 0 0" zaxis="1 0 1">
          <joint name="d"/>
          <geom type="mesh" mesh="lost"/>
          <site name="hand" pos="0 0 0.2" euler="0 0 1"/>
          <body name="three" pos="0 0 0.1"/>
        </body>
      </frame>
    </body>
  </worldbody>
  <asset><mesh name="lost" file="lost.stl"/><texture name="t" type="2d" file="lost.png"/></asset>
  <equality><joint joint1="a" joint2="d"/></equality>
  <actuator><motor joint="a"/></actuator>
  <sensor><jointpos joint="a"/></sensor>
  <contact><exclude body1="one" body2="two"/></contact>
  <keyframe><key qpos="0 0 0 0"/></keyframe>
</mujoco>
"""


def frame_pose(data: Any, name: str) -> Array:
    pose = np.eye(4)
    frame = data.site(name) if name in ("on one", "hand") else data.body(name)
    pose[:3, :3], pose[:3, 3] = frame.xmat.reshape(3, 3), frame.xpos
    return pose


@pytest.mark.skipif(not MESSY.is_dir(), reason="the shared robots are not here")
@pytest.mark.parametrize("tip", ["link7", "left_finger", "right_finger", "link_tcp"])
def test_real_file_agrees_with_stored_poses(tip: str, capfd: pytest.CaptureFixture[str]) -> None:
    file = json.loads((MESSY / "messy.json").read_text())["mjcf_xarm7"]["file"]
    stored = np.load(MESSY / "mjcf_xarm7" / "expected_fk.npz")
    for base in (None, "link_base"):
        capfd.readouterr()
        chain = read(MESSY / file, base, tip)
        assert capfd.readouterr() == ("", "")
        columns = [list(stored["joint_names"]).index(joint) for joint in chain.joint_names]
        expected = stored[f"T_site_{tip}" if tip == "link_tcp" else f"T_{tip}"]
        if base:
            expected = np.linalg.inv(stored["T_link_base"]) @ expected
        poses = forward_many(chain.arrays, np.ascontiguousarray(stored["q"][:, columns]))
        assert np.abs(poses - expected).max() < 1e-12
        np.testing.assert_array_equal(chain.lower, stored["lower"][columns])
        np.testing.assert_array_equal(chain.upper, stored["upper"][columns])


@pytest.mark.parametrize("angle", ["radian", "degree"])
@pytest.mark.parametrize(
    ("base", "tip"),
    [
        (None, "three"),
        ("world", "hand"),
        ("one", "two"),
        ("on one", "hand"),
        (None, "on one"),
        ("on one", None),
    ],
)
def test_poses_are_mujocos_own(tmp_path: Path, angle: str, base: str | None, tip: str | None) -> None:
    text = TREE.format(angle=angle)
    chain = read_mjcf(write(tmp_path, "m.xml", text), base, tip)
    assert chain.tip == (tip or "three")
    bare = text.replace('<geom type="mesh" mesh="lost"/>', '<geom size="0.1"/>')
    model = mujoco.MjModel.from_xml_string(bare[: bare.index("<asset>")] + "</mujoco>")
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = rng.uniform(-1, 1, 4)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        variables = np.array([[q["abcd".index(name)] for name in chain.joint_names]])
        expected = np.linalg.inv(frame_pose(data, base or "world")) @ frame_pose(data, tip or "three")
        np.testing.assert_allclose(forward_many(chain.arrays, variables)[0], expected, rtol=0, atol=1e-13)
    for i, name in enumerate(chain.joint_names):
        if name != "d":
            np.testing.assert_array_equal([chain.lower[i], chain.upper[i]], model.joint(name).range)


@pytest.mark.parametrize(
    ("default", "own"), [("", 'material="red"'), ('<default><site material="red"/></default>', "")]
)
def test_a_site_may_have_a_material(default: str, own: str, tmp_path: Path) -> None:
    """MuJoCo looked for it among the assets, which had been left out."""
    body = f'<body name="b"><joint name="j"/><site name="s" pos="0 0 1" {own}/></body>'
    asset = '<asset><material name="red" rgba="1 0 0 1"/></asset>'
    text = f"<mujoco>{asset}{default}<worldbody>{body}</worldbody></mujoco>"
    assert read(write(tmp_path, "m.xml", text), tip="s").frames["s"].pose[2, 3] == 1.0


def test_kinds_and_name(tmp_path: Path) -> None:
    chain = read_mjcf(write(tmp_path, "m.xml", TREE.format(angle="radian")))
    assert chain.name == "small"
    assert (chain.base, chain.tip) == ("world", "three")
    assert chain.kinds == ("revolute", "prismatic", "revolute", "continuous")


def test_xml_that_is_a_urdf_is_read_as_one(tmp_path: Path) -> None:
    assert read(write(tmp_path, "m.xml", robot(TURNING, links="a b"))).base == "a"


BAD = {
    "broken XML": ("<mujoco>", "broken XML: .*line 1"),
    "URDF in capitals": ('<ROBOT name="r"/>', "the root of a model is 'ROBOT', expected 'mujoco'"),
    "unknown tag": ("<mujoco><wordbody/></mujoco>", "MuJoCo says: .*wordbody"),
    "not MJCF": ("<sdf/>", "the root of a model is 'sdf', expected 'mujoco'"),
    "endless slide": ('<joint name="s" type="slide"/>', "slide joint 's' has no range"),
    "ball": ('<joint name="s" type="ball"/>', "'s' is a ball joint.*Choose base='b'"),
    "free": ('<freejoint name="s"/>', "'s' is a free joint.*Choose base='b'"),
    "inverted range": ('<joint name="s" range="1 -1" limited="true"/>', "MuJoCo says: .*range"),
    "no joint": ("", "no movable joint"),
    "two leaves": (
        '<joint/></body><body name="c">',
        "the arm branches below base 'world'. Choose tip= from: b;",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_file_is_refused_with_a_reason(case: str, tmp_path: Path) -> None:
    text, message = BAD[case]
    if not text.startswith(("<mujoco", "<sdf", "<ROBOT")):
        text = f'<mujoco><worldbody><body name="b">{text}</body></worldbody></mujoco>'
    with pytest.raises(InvalidRobot, match=f"(?s){message}"):
        read_mjcf(write(tmp_path, "m.xml", text))


def test_an_attached_model_is_no_urdf(tmp_path: Path) -> None:
    """MuJoCo would read it, and open the meshes that it names."""
    (tmp_path / "inner.xml").write_text('<robot name="r"><link name="a"/></robot>', encoding="utf-8")
    asset = '<asset><model name="m" file="inner.xml"/></asset>'
    text = f'<mujoco>{asset}<worldbody><attach model="m" body="a"/></worldbody></mujoco>'
    with pytest.raises(InvalidRobot, match=r"inner\.xml: the root of a model is 'robot', expected 'mujoco'"):
        read_mjcf(write(tmp_path, "m.xml", text))


def test_base_and_tip_must_exist(tmp_path: Path) -> None:
    path = write(tmp_path, "m.xml", TREE.format(angle="radian"))
    with pytest.raises(InvalidRobot, match="unknown body or site 'hands'; did you mean 'hand'"):
        read_mjcf(path, tip="hands")
    assert read_mjcf(path, "two", "one").base == "two"
    with pytest.raises(InvalidRobot, match="no file"):
        read_mjcf(tmp_path / "none.xml")


def test_missing_mujoco_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtra, match=r"kinseek\[mjcf\]"):
        read_mjcf(write(tmp_path, "m.xml", TREE.format(angle="radian")))
