"""Limits of acceleration and jerk: given or read, and kept by every arm that is made of another one."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidRobot, UnitWarning
from kinseek.robots.soundness import check

NAN = np.nan
LIMITED = 'lower="-2" upper="2" velocity="2.5" '
TWO = """<robot name="two"><link name="base"/><link name="upper"/><link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="1" velocity="1.5"/></joint>
<joint name="b" type="revolute"><parent link="upper"/><child link="tip"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
  <limit {limit}/>{mimic}</joint></robot>"""


def two(limit: str, mimic: str = "") -> kinseek.Arm:
    return kinseek.load(TWO.format(limit=limit, mimic=mimic))


def panda() -> kinseek.Arm:
    return kinseek.load("panda").with_limits(
        acceleration=[3, 2, 2.5, 3, 4, 5, 6], jerk={"panda_joint2": 400, "panda_joint7": 500.0}
    )


def test_what_no_one_gave_is_unknown() -> None:
    function = kinseek.Arm.from_fk(lambda q: kinseek.pose([q[0], 0, 0]), [-1], [1], vectorized=False)
    for arm in (kinseek.load("ur5e"), kinseek.Arm.from_dh([(0.3, 0, 0, 0)], [-1], [1]), function):
        assert arm.acceleration.shape == arm.jerk.shape == (arm.dof,)
        assert np.isnan([arm.acceleration, arm.jerk]).all()


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ('acceleration="6" jerk="40"', [6, 40]),
        ('acceleration="6" deceleration="4"', [4, NAN]),  # URDF 1.2; one limit holds in both directions.
        ('deceleration="4"', [4, NAN]),
        ('acceleration="0" jerk="-1"', [NAN, NAN]),
        ('acceleration="inf" jerk="fast"', [NAN, NAN]),
        ('acceleration="6 6" jerk=""', [NAN, NAN]),
    ],
)
def test_a_urdf_may_have_them(given: str, expected: list[float]) -> None:
    arm = two(LIMITED + given)
    np.testing.assert_array_equal(
        [arm.velocity, arm.acceleration, arm.jerk], [[1.5, 2.5], *([NAN, x] for x in expected)]
    )


def test_a_check_reports_those_below_zero_and_broken_ones(tmp_path: Path) -> None:
    path = tmp_path / "two.urdf"
    path.write_text(TWO.format(limit=LIMITED + 'acceleration="-6" jerk="fast"', mimic=""), encoding="utf-8")
    found = {finding.what for finding in check(path).findings if finding.part == "joint 'b'"}
    assert any("acceleration limit -6 is below 0" in what for what in found)
    assert any("jerk" in what and "'fast' is not a number" in what for what in found)


def test_mimic_joints_bound_their_leader() -> None:
    mimic = '<mimic joint="a" multiplier="-2"/>'
    arm = two('lower="-9" upper="9" velocity="9" acceleration="6" jerk="40"', mimic=mimic)
    np.testing.assert_array_equal(arm.mechanism.rates, [[1.5], [3], [20]])
    still = two(
        'lower="-9" upper="9" velocity="9" acceleration="6"', mimic='<mimic joint="a" multiplier="0"/>'
    )
    assert np.isnan(still.acceleration).all()


def test_numbers_for_all_joints_for_each_or_for_some() -> None:
    arm = panda().with_limits(velocity=2)
    np.testing.assert_array_equal(arm.velocity, [2] * 7)
    np.testing.assert_array_equal(arm.acceleration, [3, 2, 2.5, 3, 4, 5, 6])
    np.testing.assert_array_equal(arm.jerk, [NAN, 400, NAN, NAN, NAN, NAN, 500])
    np.testing.assert_array_equal(kinseek.load("panda").acceleration, [NAN] * 7)
    both = arm.with_limits({"panda_joint1": (-1, 1)}, acceleration={"panda_joint1": 1})
    assert both.lower[0] == -1
    assert both.acceleration[0] == 1


@pytest.mark.parametrize(
    "changed",
    [
        lambda arm: arm.with_tool(kinseek.pose([0, 0, 0.1])),
        lambda arm: arm.with_limits({"panda_joint2": (0, 1)}),
        lambda arm: arm.with_limits(),
        lambda arm: pickle.loads(pickle.dumps(arm)),
    ],
)
def test_other_arms_have_them(changed: Callable[[kinseek.Arm], kinseek.Arm]) -> None:
    arm = panda()
    np.testing.assert_array_equal(changed(arm).mechanism.rates, arm.mechanism.rates)


def test_locked_joints_have_none() -> None:
    arm = panda().with_locked({"panda_joint2": 0.1, "panda_joint5": 0.0})
    np.testing.assert_array_equal(arm.acceleration, [3, 2.5, 3, 5, 6])
    np.testing.assert_array_equal(arm.jerk, [NAN, NAN, NAN, NAN, 500])


def test_two_links_have_those_of_the_joints_between_them() -> None:
    urdf = """<robot name="r"><link name="torso"/><link name="l"/><link name="r"/>
    <joint name="jl" type="revolute"><parent link="torso"/><child link="l"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" velocity="1" acceleration="2" jerk="3"/></joint>
    <joint name="jr" type="prismatic"><parent link="torso"/><child link="r"/><axis xyz="1 0 0"/>
      <limit lower="-1" upper="1" velocity="4" acceleration="5" jerk="6"/></joint></robot>"""
    arm = kinseek.load(urdf, "l", "r")
    np.testing.assert_array_equal(arm.mechanism.rates, [[1, 4], [2, 5], [3, 6]])


def test_black_box_kinematics_can_have_them() -> None:
    arm = kinseek.Arm.from_fk(_slide, [-1, -1], [1, 1], names=["a", "b"]).with_limits(
        velocity=1, acceleration={"b": 2}
    )
    for each in (arm, arm.with_limits({"a": (0, 1)}), pickle.loads(pickle.dumps(arm))):
        np.testing.assert_array_equal(
            [each.velocity, each.acceleration, each.jerk], [[1, 1], [NAN, 2], [NAN, NAN]]
        )
    np.testing.assert_array_equal(arm.mechanism.part((1,), np.zeros(2), None).acceleration, [2])


def _slide(q: Any) -> Any:
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, :2, 3] = q
    return T


def test_what_is_given_is_a_copy() -> None:
    arm = panda()
    arm.acceleration[:] = arm.jerk[:] = 0.0
    np.testing.assert_array_equal(arm.mechanism.rates, panda().mechanism.rates)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"acceleration": 0}, "joint 'panda_joint1': the acceleration limit .*above 0, got 0"),
        ({"acceleration": {"panda_joint3": -1}}, "'panda_joint3'.*above 0, got -1"),
        ({"jerk": math.nan}, "jerk limit .*finite number, got nan"),
        ({"jerk": {"panda_joint3": "fast"}}, "finite number, got 'fast'"),
        (
            {"jerk": "fast"},
            r"jerk must be one number, 7 of them, or a mapping .*rad/s³ or m/s³\], got 'fast'",
        ),
        ({"acceleration": [1, 2]}, r"7 of them.*rad/s² or m/s².*got \[1, 2\]"),
        ({"acceleration": 1j}, "got 1j"),
        ({"acceleration": {"panda_joint9": 1}}, "unknown joint 'panda_joint9'.*did you mean"),
        ({"velocity": 2.5}, "joint 'panda_joint1': velocity limit 2.5 is wider than that of the arm, 2.175"),
        ({"acceleration": 3}, "joint 'panda_joint2': acceleration limit 3 is wider than that of the arm, 2"),
    ],
)
def test_other_limits_are_refused(given: dict[str, Any], told: str) -> None:
    with pytest.raises(InvalidRobot, match=told):
        panda().with_limits(**given)


def test_degrees_are_noticed() -> None:
    puma = kinseek.load("puma560")
    with pytest.warns(
        UnitWarning, match=r"velocity limits in radians that hardly any joint has: 'j2' 180; .*π/180"
    ) as warned:
        puma.with_limits(velocity={"j1": 3, "j2": 180})
    assert warned[0].filename == __file__
    with pytest.warns(UnitWarning, match="acceleration limits"):
        puma.with_limits(acceleration=800)


def test_slides_may_be_fast() -> None:
    arm = kinseek.Arm.from_dh([(0.3, 0, 0, 0)], [-1], [1], kinds="P")
    assert arm.with_limits(acceleration=800, jerk=1e6).acceleration == [800]
