"""Limits of joints from the joint_limits.yaml of MoveIt."""

from __future__ import annotations

import pickle
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]

import kinseek
from command_line import CommandLine
from kinseek import InvalidRobot, LimitWarning, UnitWarning
from kinseek.robots import catalog_path

NAN = np.nan

ACCELERATION = [3.75, 1.875, 2.5, 3.125, 3.75, 5.0, 5.0]
"""Of moveit_resources/panda_moveit_config/config/joint_limits.yaml at 232a9204, where the jerk is 500 for each joint."""

URDF = """<robot name="three"><link name="base"/><link name="one"/><link name="two"/><link name="three"/><link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" velocity="1.5" acceleration="4"/>
  <safety_controller soft_lower_limit="-1.5" soft_upper_limit="1.5" k_velocity="1"/></joint>
<joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/></joint>
<joint name="c" type="prismatic"><parent link="two"/><child link="three"/><axis xyz="1 0 0"/>
  <limit lower="0" upper="0.4" velocity="0.2"/></joint>
<joint name="d" type="revolute"><parent link="three"/><child link="tip"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" velocity="9"/><mimic joint="a" multiplier="-2"/></joint></robot>"""


def written(joints: Any, path: Path, *around: str, **beside: Any) -> Path:
    """A file with these joints, below keys from the outside inwards."""
    content: Any = {"joint_limits": joints, **beside}
    for key in reversed(around):
        content = {key: content}
    path = path / "joint_limits.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def entry(
    velocity: Any = None, acceleration: Any = None, jerk: Any = None, position: Any = None
) -> dict[str, Any]:
    """An entry as MoveIt has them; False turns a limit off."""
    found: dict[str, Any] = {}
    for word, value in (("velocity", velocity), ("acceleration", acceleration), ("jerk", jerk)):
        if value is not None:
            found |= {f"has_{word}_limits": value is not False, f"max_{word}": value or 0.0}
    if position is not None:
        found |= {"has_position_limits": True, "min_position": position[0], "max_position": position[1]}
    return found


def three(joints: Any, path: Path) -> kinseek.Arm:
    return kinseek.load(URDF, limits=written(joints, path))


def panda(path: Path) -> Path:
    joints = {
        f"panda_joint{i}": entry(2.175 if i < 5 else 2.61, acceleration, 500.0)
        for i, acceleration in enumerate(ACCELERATION, 1)
    }
    joints |= {f"panda_finger_joint{i}": entry(0.1, False) for i in (1, 2)}
    return written(joints, path, "robot_description_planning", default_velocity_scaling_factor=0.1)


@pytest.mark.filterwarnings("error")
def test_the_file_of_moveit_for_the_panda(tmp_path: Path) -> None:
    plain, arm = kinseek.load("panda"), kinseek.load("panda", limits=panda(tmp_path))
    np.testing.assert_array_equal(
        arm.velocity, plain.velocity
    )  # The scaling factor of MoveIt's requests is no limit.
    np.testing.assert_array_equal(arm.acceleration, ACCELERATION)
    np.testing.assert_array_equal(arm.jerk, [500] * 7)
    np.testing.assert_array_equal([arm.lower, arm.upper], [plain.lower, plain.upper])
    q = plain.sample(20)
    np.testing.assert_array_equal(arm.fk(q), plain.fk(q))
    for other in (arm.with_tool(np.eye(4)), arm.with_limits(), pickle.loads(pickle.dumps(arm))):
        np.testing.assert_array_equal(other.mechanism.rates, arm.mechanism.rates)
    hand = kinseek.load(str(catalog_path("panda")), "panda_link4", "panda_link0", limits=str(panda(tmp_path)))
    np.testing.assert_array_equal(hand.acceleration, ACCELERATION[3::-1])


@pytest.mark.parametrize(
    "around",
    [(), ("/**", "ros__parameters"), ("move_group", "ros__parameters", "robot_description_planning")],
)
def test_it_may_be_a_file_of_parameters(around: tuple[str, ...], tmp_path: Path) -> None:
    arm = kinseek.load(URDF, limits=written({"a": entry(1.0, 2, 3.0)}, tmp_path, *around))
    np.testing.assert_array_equal(arm.mechanism.rates, [[1, NAN, 0.2], [2, NAN, NAN], [3, NAN, NAN]])


def test_numbers_may_be_in_degrees_or_read_as_text(tmp_path: Path) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text(
        "joint_limits: {a: {max_velocity: !degrees 45, max_acceleration: !radians 2.5, max_jerk: 1e2}}",
        encoding="utf-8",
    )
    np.testing.assert_array_equal(
        kinseek.load(URDF, limits=path).mechanism.rates[:, 0], [np.pi / 4, 2.5, 100]
    )


@pytest.mark.filterwarnings("error")
def test_positions_replace_limits_and_soft_limits(tmp_path: Path) -> None:
    # The mimic joint d, from -3 to 3, would allow -1.5 to 1.5 of a.
    arm = three({"a": entry(position=(-1, 1.25)), "c": {"max_position": 0.3}}, tmp_path)
    np.testing.assert_array_equal([arm.lower, arm.upper], [[-1, -np.pi, 0], [1.25, np.pi, 0.3]])
    off = three({"a": {"has_position_limits": False, "min_position": -1, "max_position": 1}}, tmp_path)
    assert (off.lower[0], off.upper[0]) == (-1.5, 1.5)
    one = three({"a": {"min_position": -1}}, tmp_path)
    assert (one.lower[0], one.upper[0]) == (-1, 1.5)
    turning = three({"b": entry(position=(-4, 5))}, tmp_path)
    assert turning.kinds[1] == "revolute"
    assert (turning.lower[1], turning.upper[1]) == (-4, 5)


def test_mimic_joints_bound_their_leader(tmp_path: Path) -> None:
    arm = three({"a": entry(1.5, 4, 50), "d": entry(1.0, 6, 200, (-1, 2))}, tmp_path)
    np.testing.assert_array_equal(arm.mechanism.rates[:, 0], [0.5, 3, 50])
    assert (arm.lower[0], arm.upper[0]) == (-1, 0.5)


def test_both_directions_have_one_limit(tmp_path: Path) -> None:
    joints = {
        "a": {"max_acceleration": 3, "has_deceleration_limits": True, "max_deceleration": -2},
        "b": {"max_acceleration": 3, "has_deceleration_limits": False, "max_deceleration": 1},
    }
    np.testing.assert_array_equal(three(joints, tmp_path).acceleration, [2, 3, NAN])
    both = URDF.replace('acceleration="4"', 'acceleration="4" deceleration="1"')
    with pytest.warns(LimitWarning, match="acceleration 2 instead of 1$"):
        arm = kinseek.load(both, limits=written(joints, tmp_path))
    assert arm.acceleration[0] == 2


@pytest.mark.parametrize(
    ("joints", "rates", "told"),
    [
        ({"a": entry(velocity=2)}, [2, 4, NAN], r"joint 'a' velocity 2 instead of 1.5$"),
        (
            {"a": entry(velocity=False, acceleration=5)},
            [4.5, 5, NAN],
            "velocity removed instead of 1.5, .*acceleration 5",
        ),
        ({"a": entry(position=(-1.6, 1))}, [1.5, 4, NAN], "joint 'a' lower limit -1.6 instead of -1.5$"),
        ({"a": entry(position=(-1, 1.6))}, [1.5, 4, NAN], "upper limit 1.6 instead of 1.5$"),
    ],
)
def test_wider_limits_count_and_are_named(joints: Any, rates: list[float], told: str, tmp_path: Path) -> None:
    with pytest.warns(LimitWarning, match=f"allows more than .*, as in MoveIt: .*{told}") as warned:
        arm = kinseek.load(URDF, limits=written(joints, tmp_path))
    assert warned[0].filename == __file__
    np.testing.assert_array_equal(arm.mechanism.rates[:, 0], rates)


@pytest.mark.filterwarnings("error")
def test_a_rounded_limit_is_the_same(tmp_path: Path) -> None:
    text = re.sub(r'lower="-3" upper="3"', f'lower="{-np.pi}" upper="{np.pi}"', URDF)
    joints = {"d": entry(9.0001, position=(-3.1416, 3.1416))}
    assert kinseek.load(text, limits=written(joints, tmp_path)).upper[0] == 1.5


def test_degrees_are_noticed(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LimitWarning)
        with pytest.warns(
            UnitWarning, match="joint_limits.yaml: velocity limits .*'b' 180; .*π/180"
        ) as warned:
            kinseek.load(URDF, limits=written({"b": entry(180), "c": entry(0.2, 900)}, tmp_path))
        assert warned[0].filename == __file__
        with pytest.warns(UnitWarning, match="many turns"):
            three({"b": entry(position=(-90, 90))}, tmp_path)


def test_planar_joints_have_them_by_variable(tmp_path: Path) -> None:
    mobile = URDF.replace('name="a" type="revolute"', 'name="a" type="planar"').replace(
        '<mimic joint="a" multiplier="-2"/>', ""
    )
    joints = {
        "a/x": entry(1, 2, 3, (-4, 4)),
        "a/y": entry(1.5, False, position=(-5, 5)),
        "a/theta": entry(2, position=(-1, 1)),
        "d": entry(8),
    }
    arm = kinseek.load(mobile, limits=written(joints, tmp_path))
    assert arm.joint_names == ("a/x", "a/y", "a/yaw", "b", "c", "d")
    np.testing.assert_array_equal(arm.upper, [4, 5, 1, np.pi, 0.4, 3])
    np.testing.assert_array_equal(arm.velocity, [1, 1.5, 2, NAN, 0.2, 8])
    np.testing.assert_array_equal(arm.acceleration[:3], [2, NAN, NAN])
    assert kinseek.load(mobile, base="one", limits=written(joints, tmp_path)).velocity[-1] == 8
    joints["a/x"].pop("min_position")
    joints["a/x"].pop("has_position_limits")
    with pytest.raises(InvalidRobot, match="joint 'a/x' has no limits in the URDF: expected both"):
        kinseek.load(mobile, limits=written(joints, tmp_path))


def test_groups_have_them(tmp_path: Path) -> None:
    srdf = '<robot name="three"><group name="g"><chain base_link="one" tip_link="three"/></group></robot>'
    arm = kinseek.load(URDF, srdf=srdf, group="g", limits=written({"b": entry(1, 2, 3)}, tmp_path))
    np.testing.assert_array_equal(arm.mechanism.rates, [[1, 0.2], [2, NAN], [3, NAN]])


@pytest.mark.parametrize(
    ("joints", "told"),
    [
        (
            {"aa": entry(1)},
            r"joint_limits.yaml: .*unknown joint 'aa'.* Valid: a, b, c, d\. .*; without: a, b, c$",
        ),
        ({"a": entry(1), "c": entry(0.1), "bb": entry(1)}, "unknown joint 'bb'.*without: b$"),
        (
            {"a": entry(-1)},
            "joint 'a': max_velocity must be above 0, got -1; has_velocity_limits: false says",
        ),
        ({"a": {"has_jerk_limits": True, "max_jerk": 0}}, "max_jerk must be above 0, got 0"),
        ({"a": entry(NAN)}, "max_velocity must be a finite number, got nan"),
        ({"a": entry(acceleration=np.inf)}, "max_acceleration must be a finite number, got inf"),
        ({"a": entry(jerk="fast")}, "max_jerk must be a finite number, got 'fast'"),
        ({"a": {"max_jerk": True}}, "max_jerk must be a finite number, got True"),
        ({"a": {"max_jerk": [1.0]}}, r"max_jerk must be a finite number, got \[1.0\]"),
        (
            {"a": {"has_acceleration_limits": True}},
            "has has_acceleration_limits: true, but no max_acceleration",
        ),
        (
            {"a": {"has_position_limits": True, "max_position": 1}},
            "has has_position_limits: true, but no min_position",
        ),
        (
            {"a": {"has_jerk_limits": "yes", "max_jerk": 1}},
            "has_jerk_limits must be true or false, got 'yes'",
        ),
        ({"a": entry(position=(1, -1))}, "joint 'a': min_position 1 is above max_position -1"),
        ({"a": {"min_position": 1.75}}, "joint 'a': lower limit 1.75 is above upper limit 1.5"),
        ({"b": {"min_position": 1}}, "joint 'b' has no limits in the URDF: expected both"),
        ({"a": 3.0}, "joint 'a': expected has_velocity_limits, max_velocity and so on, got 3.0"),
        ({7: entry(1)}, "expected the name of a joint, got 7"),
        ({}, r"expected one entry 'joint_limits' with joints.*got {}"),
        ([], r"expected one entry 'joint_limits' with joints.*got \[\]"),
    ],
)
def test_other_files_are_refused(joints: Any, told: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidRobot, match=told):
        three(joints, tmp_path)


def test_other_content_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "limits.yaml"
    for text, told in (
        ("", "expected one entry 'joint_limits'.*got 0"),
        (
            "one: {joint_limits: {a: {}}}\ntwo: {joint_limits: {a: {}}}",
            "expected one entry 'joint_limits'.*got 2",
        ),
        ("joint_limits:\n  a: {max_velocity: 1}\n  a: {}", "lines 2 and 3 both give the key 'a'"),
        ("joint_limits: {a: {max_velocity: 1, max_velocity: 2}}", "both give the key 'max_velocity'"),
        ("joint_limits: [", "broken YAML"),
        ("joint_limits: {a: {max_velocity: !degrees fast}}", "broken YAML"),
        ("joint_limits: {a: !!python/object:os.system {}}", "broken YAML"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(InvalidRobot, match=told):
            kinseek.load(URDF, limits=path)
    with pytest.raises(InvalidRobot, match=r"lost\.yaml"):
        kinseek.load(URDF, limits="lost.yaml")
    given: Any = 3
    with pytest.raises(
        InvalidRobot, match=r"limits must be a mapping .*, or the path of a joint_limits\.yaml .*got 3"
    ):
        kinseek.load(URDF, limits=given)


def test_it_is_for_a_urdf(tmp_path: Path) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(catalog_path("ur5e").read_text())
    with pytest.raises(InvalidRobot, match="limits of a file is for a URDF, and this source is none"):
        kinseek.load(model, limits=written({"a": entry(1)}, tmp_path))


def test_in_a_shell(tmp_path: Path, cli: CommandLine) -> None:
    shown = cli("show panda --limits", panda(tmp_path)).out
    assert re.search(r"panda_joint2 .* 2\.175 +1\.875 +500\n", shown)
    wide = written({"elbow_joint": entry(9.5)}, tmp_path)
    heard = cli("show ur5e --limits", wide).err
    assert re.fullmatch("kinseek: warning: .*'elbow_joint' velocity 9.5 instead of 3.14159\n", heard)
    assert "--limits FILE is not checked" in cli.refused("check panda --limits", panda(tmp_path))
    both = cli.refused("show panda --limits panda_joint1=-1,1 --limits", panda(tmp_path))
    assert "--limits takes NAME=LOWER,UPPER|FILE" in both
