"""Arms between any two links: joints taken upward, planar and floating joints."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from command_line import CommandLine
from kinseek.errors import InvalidRobot
from kinseek.proof.certificate import Verdict
from kinseek.robots import catalog_path
from pinocchio_poses import configuration, pinocchio_poses
from robot_files import joint, link, robot, write

Array = NDArray[np.float64]

YUMI = Path(__file__).parents[3] / "shared" / "robots" / "messy" / "urdf_tree_yumi" / "yumi.urdf"


def placed(name: str, ends: str, kind: str, more: str = "", at: int = 0) -> str:
    """A joint whose origin and axis depend on `at`."""
    rng = np.random.default_rng(at)
    xyz, rpy = " ".join(map(str, rng.uniform(-0.3, 0.3, 3))), " ".join(map(str, rng.uniform(-3, 3, 3)))
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    direction = "" if kind in ("fixed", "planar", "floating") else f'<axis xyz="{" ".join(map(str, axis))}"/>'
    return joint(name, ends, kind, f'<origin xyz="{xyz}" rpy="{rpy}"/>{direction}{more}')


LIMIT = '<limit lower="-1.5" upper="2" effort="1" velocity="2"/>'
SLIDE = '<limit lower="-0.1" upper="0.4" effort="1" velocity="2"/>'


def two_arms(dof: int = 6, mobile: str = "") -> str:
    """A torso that turns, with two arms of some joints, a fixed hand each, one slide and one endless joint among them."""
    links, joints = ["root", "torso"], [placed("waist", "root torso", "revolute", LIMIT, 1)]
    if mobile:
        links, joints = ["map", *links], [placed("drive", "map root", mobile, "", 9), *joints]
    for number, side in enumerate(("left", "right")):
        above = "torso"
        for i in range(dof):
            kind, more = ("prismatic", SLIDE) if i == 2 else ("revolute", LIMIT)
            kind, more = ("continuous", "") if i == 3 else (kind, more)
            links.append(f"{side}_{i}")
            joints.append(placed(f"{side}_j{i}", f"{above} {links[-1]}", kind, more, 10 * number + i + 20))
            above = links[-1]
        links.append(f"{side}_hand")
        joints.append(placed(f"{side}_wrist", f"{above} {links[-1]}", "fixed", "", 77 + number))
    shape = '<collision><geometry><sphere radius="0.01"/></geometry></collision>'
    return robot(*(link(name, shape) for name in links), *joints, links="")


def hands() -> str:
    """Two short arms, seen from hand to hand an arm of six joints whose last three axes meet."""
    rows = [
        ("left_0", "torso left0", "0.3 0 0", "0 0 1"),
        ("left_1", "left0 left1", "0.3 0 0", "0 1 0"),
        ("left_2", "left1 left2", "0.3 0 0", "0 1 0"),
        ("right_0", "torso right0", "-0.3 0.1 0", "1 0 0"),
        ("right_1", "right0 right1", "0 0 0", "0 1 0"),
        ("right_2", "right1 right2", "0 0 0", "0 0 1"),
    ]
    joints = [
        joint(name, ends, inside=f'<origin xyz="{at}"/><axis xyz="{axis}"/>{LIMIT}')
        for name, ends, at, axis in rows
    ]
    return robot(*joints, links="torso left0 left1 left2 right0 right1 right2")


TREES = ("two", "two long", "yumi", "panda", "ur10e_rail", "pr2_left")


def tree(name: str) -> str:
    if name == "yumi":
        if not YUMI.exists():
            pytest.skip("no file of the two-armed YuMi here")
        return YUMI.read_text()
    return two_arms(6 if name == "two" else 9) if name.startswith("two") else catalog_path(name).read_text()


@pytest.mark.parametrize("name", TREES)
def test_forward_kinematics_between_any_two_links_is_pinocchios(name: str) -> None:
    pin = pytest.importorskip("pinocchio")
    text = tree(name)
    model = pin.buildModelFromXML(text, mimic=True)
    links = [str(frame.name) for frame in model.frames if str(frame.type) == "BODY"]
    pairs = list(itertools.permutations(links, 2))
    rng, tried = np.random.default_rng(0), 0
    for i in rng.permutation(len(pairs)):
        base, tip = pairs[i]
        try:
            arm = kinseek.load(text, base, tip)
        except InvalidRobot:  # Links that are fixed to each other.
            continue
        tried += 1
        q = arm.sample(3)
        expected = pinocchio_poses(pin, model, arm, q)
        np.testing.assert_allclose(arm.fk(q), expected, rtol=0, atol=1e-12)
        # The other way round it is the inverse, with the same joint values by name; and so is pinocchio's model itself.
        back = kinseek.load(text, tip, base)
        assert set(back.joint_names) == set(arm.joint_names)
        for row, T in zip(q, expected, strict=True):
            named = dict(zip(arm.joint_names, row, strict=True))
            np.testing.assert_allclose(back.fk(named) @ T, np.eye(4), rtol=0, atol=1e-12)
        whole = kinseek.load(model, base, tip)
        assert whole.joint_names == arm.joint_names
        np.testing.assert_allclose(whole.fk(q), expected, rtol=0, atol=1e-12)
        if tried == 40:
            break
    assert tried >= 20


def test_links_and_joints_on_the_way_have_their_poses() -> None:
    pin = pytest.importorskip("pinocchio")
    text = two_arms()
    arm, model = kinseek.load(text, "left_hand", "right_hand"), pin.buildModelFromXML(text)
    q = arm.sample(1)
    for name in ("left_4", "left_0", "torso", "right_3"):
        part = kinseek.load(text, "left_hand", name)
        some = [arm.joint_names.index(each) for each in part.joint_names]
        expected = pinocchio_poses(pin, model, part, q[:, some])[0]
        np.testing.assert_allclose(arm.fk(q[0], link=name), expected, rtol=0, atol=1e-12)
    # A joint's frame is that of its child link, whichever way the chain goes.
    np.testing.assert_allclose(arm.fk(q[0], link="left_j2"), arm.fk(q[0], link="left_2"), rtol=0, atol=1e-15)
    assert "waist" not in arm.joint_names


def test_limits_speeds_and_kinds_stay() -> None:
    text = two_arms()
    arm = kinseek.load(text, "left_hand", "right_hand")
    assert arm.joint_names[:6] == tuple(f"left_j{i}" for i in range(5, -1, -1))
    one = kinseek.load(text, tip="left_hand")
    for i, name in enumerate(arm.joint_names[:6]):
        k = one.joint_names.index(name)
        assert (arm.lower[i], arm.upper[i]) == (one.lower[k], one.upper[k])
        assert arm.kinds[i] == one.kinds[k]
        np.testing.assert_equal(arm.velocity[i], one.velocity[k])


def test_a_mimic_joint_may_be_on_the_other_side() -> None:
    mimic = LIMIT + '<mimic joint="a" multiplier="-0.5" offset="0.2"/>'
    joints = placed("a", "t l", "revolute", LIMIT, 3), placed("b", "t r", "revolute", mimic, 4)
    text = robot(*joints, links="t l r")
    arm = kinseek.load(text, "l", "r")
    assert arm.joint_names == ("a",)
    left = kinseek.load(text, tip="l")
    free = kinseek.load(text.replace('<mimic joint="a" multiplier="-0.5" offset="0.2"/>', ""), tip="r")
    q = 0.7
    expected = np.linalg.inv(left.fk([q])) @ free.fk([-0.5 * q + 0.2])
    np.testing.assert_allclose(arm.fk([q]), expected, rtol=0, atol=1e-14)


def test_hand_to_hand_is_solved_and_proved_like_any_arm() -> None:
    arm = kinseek.load(hands(), "left2", "right2")
    assert arm.dof == 6
    for q in arm.sample(20):
        T = arm.fk(q)
        solution = arm.ik(T)
        assert solution.success
        np.testing.assert_allclose(arm.fk(solution.q), T, rtol=0, atol=2e-6)
        assert np.abs(np.asarray(arm.branches(T).q) - q).max(axis=1).min() < 1e-4
    assert arm.prove(kinseek.pose([2.0, 0, 0])).verdict is Verdict.UNREACHABLE


@pytest.mark.parametrize("name", ["ur5e", "irb120"])
def test_an_arm_from_tip_to_base_has_the_same_branches(name: str) -> None:
    there = kinseek.load(name)
    back = kinseek.load(catalog_path(name), there.tip, there.base)
    assert back.joint_names == there.joint_names[::-1]
    for q in there.sample(20):
        T = there.fk(q)
        found = there.branches(T)
        other = back.branches(np.linalg.inv(T))
        assert isinstance(found, kinseek.Branches)
        assert isinstance(other, kinseek.Branches)
        if found.complete:
            assert len(other) == len(found)
            gaps = np.abs(np.asarray(other.q)[:, None, ::-1] - np.asarray(found.q)[None]).max(axis=2)
            assert gaps.min(axis=0).max() < 1e-5


def test_a_hand_as_base_needs_a_tip() -> None:
    with pytest.raises(
        InvalidRobot, match=r"no link is below base 'left_hand', so tip= is needed.*right_hand"
    ):
        kinseek.load(two_arms(), "left_hand")


def test_a_redundant_chain_of_two_arms_is_solved() -> None:
    arm = kinseek.load(two_arms(), "left_hand", "right_hand")
    T = arm.fk(arm.sample(50))
    assert arm.ik(T).success.all()


def test_a_scene_has_the_links_where_they_are() -> None:
    pytest.importorskip("coal")
    text = two_arms()
    arm = kinseek.load(text, "left_hand", "right_hand")
    scene = kinseek.Scene.of(arm)
    assert {"root", "torso", "left_0", "right_5", "left_hand"} <= set(scene.bodies)
    q = arm.sample(5)
    for row in q:
        near = scene.nearest(row)
        places = [arm.fk(row, link=name)[:3, 3] for name in (near.a, near.b)]
        assert abs(np.linalg.norm(places[0] - places[1]) - 0.02 - near.distance) < 1e-9


# Planar and floating joints


@pytest.mark.parametrize("kind", ["planar", "floating"])
def test_the_motion_of_joints_with_several_axes_is_pinocchios(kind: str) -> None:
    pin = pytest.importorskip("pinocchio")
    text = two_arms(mobile=kind)
    model = pin.buildModelFromXML(text)
    limits = {f"drive/{axis}": (-2.0, 3.0) for axis in ("xy" if kind == "planar" else "xyz")}
    arm = kinseek.load(text, "map", "right_hand", limits=limits)
    count = 3 if kind == "planar" else 6
    axes = ("x", "y", "yaw") if kind == "planar" else ("x", "y", "z", "yaw", "pitch", "roll")
    assert arm.joint_names[:count] == tuple(f"drive/{axis}" for axis in axes)
    assert (arm.lower[0], arm.upper[0]) == (-2.0, 3.0)
    data, drive = model.createData(), model.joints[model.getJointId("drive")]
    up = kinseek.load(text, "right_hand", "map", limits=limits)
    for row in arm.sample(20):
        values = dict(zip(arm.joint_names, row, strict=True))
        full = configuration(pin, model, arm.joint_names[count:], row[count:])
        if kind == "planar":
            yaw = values["drive/yaw"]
            full[drive.idx_q : drive.idx_q + 4] = [*row[:2], np.cos(yaw), np.sin(yaw)]
        else:
            turn = pin.rpy.rpyToMatrix(*(values[f"drive/{axis}"] for axis in ("roll", "pitch", "yaw")))
            full[drive.idx_q : drive.idx_q + 7] = [*row[:3], *pin.Quaternion(turn).coeffs()]
        pin.framesForwardKinematics(model, data, full)
        frames = [data.oMf[model.getFrameId(name)] for name in ("map", "right_hand")]
        expected = (frames[0].inverse() * frames[1]).homogeneous
        np.testing.assert_allclose(arm.fk(row), expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(up.fk(values) @ expected, np.eye(4), rtol=0, atol=1e-12)
    assert arm.ik(arm.fk(arm.sample(30))).success.all()


def test_a_planar_joint_moves_in_the_plane_of_its_axis() -> None:
    text = robot(joint(kind="planar", inside='<axis xyz="0 1 0"/>'), links="a b")
    arm = kinseek.load(text, limits={"j/x": (-1, 1), "j/y": (-1, 1), "j/yaw": (-0.5, 0.5)})
    assert arm.kinds == ("prismatic", "prismatic", "revolute")
    T = arm.fk([0.3, -0.7, 0.4])
    assert abs(T[1, 3]) < 1e-15
    assert abs(np.linalg.norm(T[:3, 3]) - np.hypot(0.3, 0.7)) < 1e-15
    np.testing.assert_allclose(T[:3, 1], [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (None, r"'drive' is planar: it has no limits.*limits=\{'drive/x': \(-1, 1\), 'drive/y'.*base='root'"),
        ({"drive/x": (0, 1)}, r"limits=\{'drive/y': \(-1, 1\)\}"),
        ({"drive/x": (0, 1), "drive/y": (1, 0)}, "lower limit 1 is above upper limit 0"),
        ({"drive/x": (0, 1), "drive/y": 3}, r"must be a pair \(lower, upper\), got 3"),
        ({"drive/x": (0, 1), "drive/y": (0, 1), "drive/z": (0, 1)}, "unknown joint 'drive/z'"),
        ([1], "limits must be a mapping"),
        ({"drive/x": (0, 1e9), "drive/y": (0, 1)}, "at most 1e"),
        ({"drive/x": (0, 1), "drive/y": (0, 1), "waist": (-9, 9)}, "'waist': limits .* are wider"),
    ],
)
def test_limits_of_a_planar_joint_are_needed_and_checked(limits: Any, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load(two_arms(mobile="planar"), tip="left_hand", limits=limits)


def test_a_scene_of_a_mobile_base() -> None:
    pytest.importorskip("coal")
    limits = {"drive/x": (-2.0, 2.0), "drive/y": (-2.0, 2.0)}
    arm = kinseek.load(two_arms(mobile="planar"), tip="left_hand", limits=limits)
    for some in (arm, arm.with_locked({"drive/x": 0.5}), arm.with_limits({"drive/yaw": (-1, 1)})):
        scene = kinseek.Scene.of(some)
        assert "root" in scene.bodies
        scene.free(some.sample(3))


def test_the_command_line_takes_two_links_and_limits(tmp_path: Path, cli: CommandLine) -> None:
    path = write(tmp_path, "r.urdf", two_arms(mobile="planar"))
    hands = "--base left_hand --tip right_hand"
    assert "base left_hand, tip right_hand" in cli("show", path, hands).out
    wide = "--limits drive/x=-2,2 --limits drive/y=-1,1"
    assert "drive/yaw" in cli("show", path, "--tip right_hand", wide).out
    heard = cli.refused("show", path, "--tip right_hand --limits drive/x=2")
    assert "--limits takes NAME=LOWER,UPPER|FILE, got drive/x=2" in heard
    assert "needs the limits= of kinseek.load" in cli("check", path, hands, code=1).out


def test_mjcf_goes_up_and_down() -> None:
    mujoco = pytest.importorskip("mujoco")
    text = """
<mujoco><compiler angle="radian"/><worldbody><body name="torso"><geom size="0.1"/>
  <body name="l" pos="0.1 0.2 0.3" euler="0.1 0.2 0.3"><geom size="0.1"/>
    <joint name="la" axis="1 2 3" pos="0.1 0 0.2" range="-1 1"/>
    <joint name="lb" type="slide" axis="0 1 1" range="-1 1" ref="0.3"/>
    <body name="ll" pos="0.2 0 0"><geom size="0.1"/><joint name="lc" axis="0 1 0" ref="0.4" range="-1 1"/>
      <site name="left" pos="0 0.1 0" euler="0.4 0 0"/></body></body>
  <body name="r" pos="-0.1 0.2 0.3"><geom size="0.1"/><joint name="ra" axis="0 1 0"/>
    <site name="right" pos="0 0.1 0.3"/></body></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    arm = kinseek.load(model, "left", "right")
    assert arm.joint_names == ("lc", "lb", "la", "ra")
    data = mujoco.MjData(model)
    for q in arm.sample(10):
        for name, value in zip(arm.joint_names, q, strict=True):
            data.joint(name).qpos = value
        mujoco.mj_kinematics(model, data)
        poses = []
        for side in ("left", "right"):
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = data.site(side).xmat.reshape(3, 3), data.site(side).xpos
            poses.append(pose)
        np.testing.assert_allclose(arm.fk(q), np.linalg.inv(poses[0]) @ poses[1], rtol=0, atol=1e-12)
