"""Arms that are groups of an SRDF, their states, and the pairs that it disables."""

from __future__ import annotations

import pickle
import time
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot, InvalidScene
from kinseek.robots.srdf import read_srdf
from robot_files import XACRO, joint, link, robot, write

PLACED = '<origin xyz="0.05 0 0.3"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
"""Inside a joint: the child link is 0.3 m above the parent."""
JOINTS = [
    ("lift", "base torso", "prismatic"),
    ("a1", "torso left1", "revolute"),
    ("a2", "left1 left2", "revolute"),
    ("wrist", "left2 hand", "fixed"),
    ("finger", "hand finger1", "prismatic"),
    ("b1", "torso right1", "revolute"),
    ("b2", "right1 right2", "revolute"),
]
BALL = '<collision><geometry><sphere radius="0.02"/></geometry></collision>'
LINKS = ["base", "torso", "left1", "left2", "hand", "finger1", "finger2", "right1", "right2"]
URDF = robot(
    *(link(name, BALL) for name in LINKS),
    *(joint(*each, PLACED) for each in JOINTS),
    joint("finger_b", "hand finger2", "prismatic", f'{PLACED}<mimic joint="finger"/>'),
    links="",
    name="torso",
)
GROUPS = {
    "left": '<chain base_link="torso" tip_link="hand"/>',
    "left_joints": '<joint name="stand"/><joint name="a1"/><joint name="a2"/><joint name="wrist"/>',
    "left_short": '<joint name="a2"/><joint name="a1"/>',
    "left_links": '<link name="left1"/><link name="left2"/><link name="hand"/>',
    "whole_left": '<joint name="lift"/><group name="left"/>',
    "nested": '<group name="whole_left"/>',
    "only": '<group name="left"/>',
    "right": '<chain base_link="torso" tip_link="right2"/>',
    "both": '<group name="left"/><group name="right"/>',
    "across": '<chain base_link="left2" tip_link="right2"/><joint name="lift"/>',
    "gap": '<joint name="lift"/><joint name="a2"/>',
    "gripper": '<joint name="finger"/><joint name="finger_b"/>',
    "moving": '<joint name="floor"/><group name="left"/>',
    "empty": "",
    "still": '<joint name="wrist"/>',
    "ring": '<group name="ring"/><group name="left"/>',
    "ring1": '<group name="ring2"/>',
    "ring2": '<group name="ring1"/>',
    "lost": '<joint name="a3"/>',
    "lost_link": '<link name="left3"/>',
    "lost_chain": '<chain base_link="torso" tip_link="left3"/>',
    "lost_group": '<group name="lefty"/>',
}
SERIAL = ["left", "left_joints", "left_short", "left_links", "whole_left", "nested", "only", "right", "ring"]


def srdf(groups: dict[str, str], more: str = "", name: str = "torso") -> str:
    """The text of an SRDF."""
    return (
        f'<?xml version="1.0"?><robot name="{name}">'
        + "".join(f'<group name="{name}">{members}</group>' for name, members in groups.items())
        + '<virtual_joint name="stand" type="fixed" parent_frame="world" child_link="base"/>'
        + '<virtual_joint name="floor" type="Planar" parent_frame="world" child_link="base"/>'
        + f"{more}</robot>"
    )


def state(name: str, group: str, **values: object) -> str:
    """A named state."""
    joints = "".join(f'<joint name="{name}" value="{value}"/>' for name, value in values.items())
    return f'<group_state name="{name}" group="{group}">{joints}</group_state>'


STATES = (
    state("home", "left", a1=0.5, a2=" -1.25 ")
    + state("home", "right", b1=1, b2=0)
    + state("half", "left", a1="1e-1", finger=0.02)
    + state("open", "gripper", finger=0.03, finger_b=0.03)
    + state("up", "whole_left", lift=0.5, a1=0, a2=0)
)
TEXT = srdf(GROUPS, STATES)


@pytest.mark.parametrize(
    ("group", "base", "tip"),
    [
        ("left", "torso", "hand"),
        ("left_joints", "torso", "hand"),
        ("left_short", "torso", "left2"),
        ("left_links", "torso", "hand"),
        ("whole_left", "base", "hand"),
        ("nested", "base", "hand"),
        ("only", "torso", "hand"),
        ("ring", "torso", "hand"),
        ("right", "torso", "right2"),
    ],
)
def test_a_group_is_the_arm_between_its_links(group: str, base: str, tip: str, tmp_path: Path) -> None:
    file = write(tmp_path, "torso.srdf", TEXT)
    arm, expected = kinseek.load(URDF, srdf=file, group=group), kinseek.load(URDF, base, tip)
    assert (arm.base, arm.tip, arm.joint_names) == (base, tip, expected.joint_names)
    q = expected.sample(10)
    assert np.array_equal(arm.fk(q), expected.fk(q))


@pytest.mark.parametrize(
    ("group", "message"),
    [
        ("lefty", r"unknown group 'lefty'; did you mean 'left'"),
        (
            "both",
            r"group 'both' branches: 'right2' and 'hand' are not|group 'both' branches: 'hand' and 'right2' are not",
        ),
        ("across", r"more than a chain from 'left2' to 'right2', and its base is not above its tip"),
        (
            "gap",
            r"leaves out joint 'a1', which moves between its links 'base' and 'left2'; give these as base= and tip=",
        ),
        (
            "gripper",
            r"branches: 'finger1' and 'finger2' are not on one way|'finger2' and 'finger1' are not on one way",
        ),
        ("moving", r"leaves out joint 'lift', which moves between its links 'world' and 'hand'"),
        ("empty", r"has no joints that move"),
        ("still", r"has no joints that move"),
        ("ring1", r"has no joints"),
        ("lost", r"has unknown joint 'a3'; did you mean 'a2' or 'a1'"),
        ("lost_link", r"has unknown link 'left3'; did you mean 'left"),
        ("lost_chain", r"has unknown link 'left3'"),
        ("lost_group", r"has unknown subgroup 'lefty'; did you mean 'left'"),
    ],
)
def test_a_group_that_is_not_a_chain_is_rejected(group: str, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message) as error:
        kinseek.load(URDF, srdf=TEXT, group=group)
    if group != "lefty":
        said = str(error.value).split("Groups that are one serial chain: ")[1]
        assert set(said.split(", ")) == set(SERIAL)


def test_the_srdf_of_another_robot_is_named() -> None:
    text = srdf({"arm": '<joint name="panda_joint1"/>'}, name="panda")
    with pytest.raises(
        InvalidRobot,
        match=r"unknown joint 'panda_joint1'.*; the SRDF is of robot 'panda', the URDF of 'torso'",
    ):
        kinseek.load(URDF, srdf=text, group="arm")


def test_base_and_tip_may_be_given_too() -> None:
    arm = kinseek.load(URDF, srdf=TEXT, group="left", tip="left2")
    assert (arm.base, arm.tip, list(arm.states)) == ("torso", "left2", ["home", "half"])
    arm = kinseek.load(URDF, tip="right2", srdf=TEXT)
    assert (arm.base, arm.tip, arm.joint_names) == ("base", "right2", ("lift", "b1", "b2"))
    with pytest.raises(
        InvalidRobot, match=r"several leaves, so choose group= from .*one serial chain: left, left_joints"
    ):
        kinseek.load(URDF, srdf=TEXT)


def test_states_are_joint_values() -> None:
    arm = kinseek.load(URDF, srdf=TEXT, group="left")
    assert arm.states == {"home": {"a1": 0.5, "a2": -1.25}, "half": {"a1": 0.1}}
    assert np.array_equal(arm.fk(arm.states["home"]), arm.fk([0.5, -1.25]))
    with pytest.raises(kinseek.InvalidProblem, match="no value for joint 'a2'; given: a1"):
        arm.fk(arm.states["half"])
    assert kinseek.load(URDF, tip="right2", srdf=TEXT).states == {
        "home": {"b1": 1.0, "b2": 0.0},
        "up": {"lift": 0.5},
    }
    assert kinseek.load(URDF, srdf=TEXT, group="whole_left").states == {
        "up": {"lift": 0.5, "a1": 0.0, "a2": 0.0}
    }
    assert arm.with_locked({"a1": 0.2}).states == {"home": {"a2": -1.25}, "half": {}}
    assert (
        arm.with_tool(kinseek.pose([0, 0, 0.1])).states
        == pickle.loads(pickle.dumps(arm)).states
        == arm.states
    )
    arm.states["home"]["a1"] = 9.0
    assert arm.states["home"]["a1"] == 0.5
    assert kinseek.load(URDF, tip="right2").states == kinseek.load("panda").states == {}
    assert kinseek.Arm.from_fk(lambda q: np.tile(np.eye(4), (len(q), 1, 1)), [0.0], [1.0]).states == {}


def test_states_agree_with_pinocchio(tmp_path: Path) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    file = write(tmp_path, "a.srdf", TEXT)
    model = pinocchio.buildModelFromXML(URDF)
    pinocchio.loadReferenceConfigurations(model, str(file))
    q = model.referenceConfigurations["up"]
    for name, value in kinseek.load(URDF, srdf=TEXT, group="whole_left").states["up"].items():
        assert q[model.joints[model.getJointId(name)].idx_q] == value


@pytest.mark.parametrize("value", ["a", "nan", "1 2", ""])
def test_a_state_without_a_number_is_rejected(value: str) -> None:
    text = srdf(GROUPS, state("home", "left", a1=value))
    with pytest.raises(InvalidRobot, match="state 'home', joint 'a1': "):
        kinseek.load(URDF, srdf=text, group="left")


def test_a_scene_uses_the_pairs_of_the_arm() -> None:
    pytest.importorskip("pinocchio")
    pair = '<disable_collisions link1="left1" link2="hand" reason="Never"/>'
    text = srdf(GROUPS, pair)
    arm = kinseek.load(URDF, srdf=text, group="left")
    expected = kinseek.Scene.of(kinseek.load(URDF, "torso", "hand"), srdf=text)
    scene = kinseek.Scene.of(arm)
    assert [str(each) for each in scene.pairs] == [str(each) for each in expected.pairs]
    assert "left1 - hand: SRDF: Never" in [str(each) for each in scene.pairs]
    other = kinseek.Scene.of(arm, srdf=srdf({}))
    assert "left1 - hand: checked" in [str(each) for each in other.pairs]
    with pytest.raises(InvalidScene, match="broken XML"):
        kinseek.Scene.of(arm, srdf="<robot>")


def test_pairs_that_are_disabled_by_default() -> None:
    pytest.importorskip("pinocchio")
    more = (
        '<disable_default_collisions link="hand"/><disable_default_collisions link="left1"/>'
        '<enable_collisions link1="left1" link2="hand"/><enable_collisions link1="base" link2="hand"/>'
        '<disable_collisions link1="base" link2="hand" reason="User"/>'
    )
    scene = kinseek.Scene.of(kinseek.load(URDF, srdf=srdf(GROUPS, more), group="whole_left"))
    reasons = {frozenset((pair.a, pair.b)): pair.reason for pair in scene.pairs}
    assert reasons[frozenset(("base", "hand"))] == "SRDF: User"
    assert reasons[frozenset(("left1", "hand"))] == ""
    assert (
        reasons[frozenset(("left1", "base"))]
        == reasons[frozenset(("torso", "hand"))]
        == "SRDF: disabled by default"
    )
    assert reasons[frozenset(("base", "left2"))] == ""
    scene.add_box("table", (1, 1, 1), kinseek.pose([5, 0, 0]))
    assert {pair.a for pair in scene.pairs if pair.b == "table" and pair.counts} >= {"hand", "left1"}


def test_a_xacro_file(tmp_path: Path) -> None:
    group = '<group name="arm"><chain base_link="torso" tip_link="$(arg side)2"/></group>'
    text = XACRO.format('<xacro:arg name="side" default="left"/>' + group)
    file = write(tmp_path, "torso.srdf.xacro", text)
    for trusted in (True, False):
        assert kinseek.load(URDF, srdf=file, group="arm", trusted=trusted).tip == "left2"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"group": "left"}, r"group='left' names a group of an SRDF; give the SRDF too, srdf="),
        ({"srdf": TEXT, "group": 3}, r"group must be the name of a group of the SRDF, got 3"),
        ({"srdf": 3}, r"srdf must be the path of an SRDF file, or its text, got 3"),
        ({"srdf": "nothing.srdf"}, r"no file 'nothing.srdf'"),
        ({"srdf": "<mujoco/>"}, r"not an SRDF: the root tag is <mujoco>, expected <robot>"),
        ({"srdf": "<robot>"}, r"broken XML"),
        (
            {"srdf": "<robot><group name='a'><joint name='x'/></group><group name='a'/></robot>"},
            "two groups are called 'a'",
        ),
        (
            {"srdf": '<!DOCTYPE r [<!ENTITY a SYSTEM "/etc/passwd">]><robot>&a;</robot>'},
            r"Entity 'a' not defined",
        ),
    ],
)
def test_a_wrong_srdf_is_rejected(options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load(URDF, **options)  # type: ignore[arg-type]


def test_a_source_without_a_urdf_is_rejected() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    with pytest.raises(InvalidRobot, match="srdf is for a URDF, and this source is none"):
        kinseek.load(pinocchio.buildModelFromXML(URDF), srdf=TEXT, group="left")


@pytest.mark.slow
def test_large_files_take_no_long_time() -> None:
    """Links in a row, joints, subgroups and chains: each part of the work is linear in the file.

    Twelve times the file takes 144 times as long where the work is quadratic.
    """
    few, many = time_of_files(250), time_of_files(3000)
    assert many < 24 * few


def time_of_files(count: int) -> float:
    """Read files with so many links; the processor time [s]."""
    kinds = ["revolute" if i < 9 else "fixed" for i in range(count)]
    joints = (joint(f"j{i}", f"l{i} l{i + 1}", kind, PLACED) for i, kind in enumerate(kinds))
    urdf = robot(*joints, links=" ".join(f"l{i}" for i in range(count + 1)), name="torso")
    groups = {
        "arm": "".join(f'<joint name="j{i}"/><link name="l{i}"/>' for i in range(count)),
        "top": "".join(f'<group name="g{i}"/>' for i in range(count)) + '<group name="arm"/>',
    } | {f"g{i}": f'<joint name="j{i}"/>' for i in range(count)}
    chains = "".join(f'<chain base_link="l0" tip_link="l{i}"/>' for i in range(1, count))
    start = time.process_time()
    for group in ("arm", "top"):
        assert kinseek.load(urdf, srdf=srdf(groups), group=group).dof == 9
    with pytest.raises(InvalidRobot, match=f"{count - 1:,} chains, expected at most 100"):
        kinseek.load(urdf, srdf=srdf({"arm": chains}), group="arm")
    with pytest.raises(InvalidRobot, match="unknown subgroup 'none'"):
        kinseek.load(urdf, srdf=srdf(groups | {"bad": '<group name="none"/>'}), group="bad")
    return time.process_time() - start


def test_the_name_of_the_text_is_not_a_path() -> None:
    assert read_srdf(TEXT.encode()).groups == read_srdf(TEXT).groups


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_a_virtual_joint_moves_the_base(kind: str) -> None:
    pytest.importorskip("coal")
    values = {"planar": "1 -2 0.5", "floating": "1 -2 0.5 0 0 0.6 0.8"}[kind]
    text = (
        '<robot name="torso"><group name="mobile"><joint name="drive"/><group name="arm"/></group>'
        '<group name="arm"><chain base_link="base" tip_link="hand"/></group>'
        f'<virtual_joint name="drive" type="{kind}" parent_frame="odom" child_link="base"/>'
        + state("away", "mobile", drive=values, lift=0.1, a1=0.2, a2=0.3)
        + "</robot>"
    )
    limits = {f"drive/{axis}": (-3.0, 3.0) for axis in "xyz"[: 2 if kind == "planar" else 3]}
    arm = kinseek.load(URDF, srdf=text, group="mobile", limits=limits)
    plain = kinseek.load(URDF, srdf=text, group="arm")
    assert (arm.base, arm.tip, plain.base) == ("odom", "hand", "base")
    assert arm.joint_names[-plain.dof :] == plain.joint_names
    yaw = 0.5 if kind == "planar" else 2 * np.arctan2(0.6, 0.8)
    moved = kinseek.pose([1, -2, 0 if kind == "planar" else 0.5], rpy=[0, 0, yaw])
    expected = moved @ plain.fk({"lift": 0.1, "a1": 0.2, "a2": 0.3})
    np.testing.assert_allclose(arm.fk(arm.states["away"]), expected, rtol=0, atol=1e-15)
    assert arm.ik(arm.fk(arm.sample(20))).success.all()
    with pytest.raises(InvalidRobot, match=r"'drive' is .*limits=\{'drive/x': \(-1, 1\).*Choose base='base'"):
        kinseek.load(URDF, srdf=text, group="mobile")
    # The joint counts only if it is used: the default base is the root of the URDF.
    assert kinseek.load(URDF, tip="hand", srdf=text).base == "base"
    assert (
        kinseek.load(URDF, base="odom", tip="hand", srdf=text, limits=limits).joint_names == arm.joint_names
    )
    for some in (arm, plain):
        kinseek.Scene.of(some).free(some.sample(2))


def test_a_chain_may_go_up_and_down() -> None:
    text = srdf(
        {"hands": '<chain base_link="hand" tip_link="right2"/>'},
        state("in", "hands", a1=0.1, a2=0, b1=0, b2=0),
    )
    arm = kinseek.load(URDF, srdf=text, group="hands")
    assert arm.joint_names == ("a2", "a1", "b1", "b2")
    expected = kinseek.load(URDF, "hand", "right2").fk({"a1": 0.1, "a2": 0, "b1": 0, "b2": 0})
    assert np.array_equal(arm.fk(arm.states["in"]), expected)
