"""Limits of velocity, acceleration and jerk: given or read, never made up, and kept by arms that are made of others."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidProblem, InvalidRobot, UnitWarning
from kinseek.robots import catalog_names, catalog_path
from kinseek.robots.soundness import check
from robot_files import joint, robot, write

NAN = np.nan
Z = '<axis xyz="0 0 1"/>'
WIDE = 'lower="-9" upper="9"'


def two(limit: str, kind: str = "revolute", mimic: str = "") -> str:
    """URDF of two joints, a with a velocity of 1.5, and b with this limit, both about parallel axes."""
    return robot(
        joint("a", "base upper", inside=f'{Z}<limit lower="-2" upper="2" velocity="1.5"/>'),
        joint("b", "upper tip", kind, f'{Z}<origin xyz="0.3 0 0"/><limit {limit}/>{mimic}'),
        links="base upper tip",
    )


def panda() -> kinseek.Arm:
    return kinseek.load("panda").with_limits(
        acceleration=[3, 2, 2.5, 3, 4, 5, 6], jerk={"panda_joint2": 400, "panda_joint7": 500.0}
    )


def slide(q: Any) -> Any:
    """Poses of a function, as many coordinates as q has."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, : q.shape[1], 3] = q
    return T


def test_what_no_one_gave_is_unknown() -> None:
    row = kinseek.Arm.from_dh([(0.3, 0, 0, 0)], [-1], [1])
    function = kinseek.Arm.from_fk(lambda q: kinseek.pose([q[0], 0, 0]), [-1], [1], vectorized=False)
    for arm in (kinseek.load("planar2"), row, function):
        assert arm.velocity.shape == arm.acceleration.shape == arm.jerk.shape == (arm.dof,)
        assert np.isnan([arm.velocity, arm.acceleration, arm.jerk]).all()
    assert np.isnan([kinseek.load("ur5e").acceleration, kinseek.load("ur5e").jerk]).all()


def test_speeds_are_those_of_the_file(tmp_path: Path) -> None:
    np.testing.assert_array_equal(kinseek.load(two('velocity="2.5"', "continuous")).velocity, [1.5, 2.5])
    np.testing.assert_array_equal(kinseek.load("panda").velocity, [2.175] * 4 + [2.61] * 3)
    xacro = write(tmp_path, "two.xacro", two(f'{WIDE} velocity="${{2 * 3}}"'))
    xacro.write_text(
        xacro.read_text().replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"')
    )
    np.testing.assert_array_equal(kinseek.load(xacro).velocity, [1.5, 6.0])


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ('velocity="2.5"', [2.5, NAN, NAN]),
        ('velocity="2.5" acceleration="6" jerk="40"', [2.5, 6, 40]),
        ('acceleration="6" deceleration="4"', [NAN, 4, NAN]),  # URDF 1.2; one limit holds in both directions.
        ('deceleration="4"', [NAN, 4, NAN]),
        ("", [NAN, NAN, NAN]),
        ('velocity="0" acceleration="0" jerk="-1"', [NAN, NAN, NAN]),
        ('velocity="-1"', [NAN, NAN, NAN]),
        ('velocity="inf" acceleration="inf" jerk="fast"', [NAN, NAN, NAN]),
        ('velocity="fast" acceleration="6 6" jerk=""', [NAN, NAN, NAN]),
    ],
)
def test_a_urdf_may_have_them(given: str, expected: list[float]) -> None:
    arm = kinseek.load(two(f'lower="-2" upper="2" {given}'))
    np.testing.assert_array_equal(arm.mechanism.rates[:, 1], expected)
    np.testing.assert_array_equal(arm.mechanism.rates[:, 0], [1.5, NAN, NAN])
    np.testing.assert_array_equal([arm.velocity, arm.acceleration, arm.jerk], arm.mechanism.rates)


def test_a_check_reports_those_below_zero_and_broken_ones(tmp_path: Path) -> None:
    text = two('lower="-2" upper="2" velocity="2.5" acceleration="-6" jerk="fast"')
    findings = check(write(tmp_path, "two.urdf", text)).findings
    found = {finding.what for finding in findings if finding.part == "joint 'b'"}
    assert any("acceleration limit -6 is below 0" in what for what in found)
    assert any("jerk" in what and "'fast' is not a number" in what for what in found)


@pytest.mark.parametrize(
    ("given", "multiplier", "expected"),
    [
        ('velocity="2.5"', -2, [1.25, NAN, NAN]),
        ("", -2, [1.5, NAN, NAN]),
        ('velocity="9" acceleration="6" jerk="40"', -2, [1.5, 3, 20]),
        ('velocity="9" acceleration="6"', 0, [1.5, NAN, NAN]),
    ],
)
def test_mimic_joints_bound_their_leader(given: str, multiplier: int, expected: list[float]) -> None:
    arm = kinseek.load(two(f"{WIDE} {given}", mimic=f'<mimic joint="a" multiplier="{multiplier}"/>'))
    np.testing.assert_array_equal(arm.mechanism.rates[:, 0], expected)


def test_pinocchio_says_the_same() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    for name in catalog_names():
        arm = kinseek.load(name)
        if "continuous" in arm.kinds or len(arm.chain.leader) > arm.dof or np.isnan(arm.velocity).any():
            continue
        model = pinocchio.buildModelFromXML(catalog_path(name).read_text())
        held = kinseek.load(model, base=arm.base, tip=arm.tip)
        np.testing.assert_array_equal(held.velocity, arm.velocity)


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
    np.testing.assert_array_equal(arm.velocity, [2.175] * 3 + [2.61] * 2)
    np.testing.assert_array_equal(arm.acceleration, [3, 2.5, 3, 5, 6])
    np.testing.assert_array_equal(arm.jerk, [NAN, NAN, NAN, NAN, 500])


def test_two_links_have_those_of_the_joints_between_them() -> None:
    limit = '<limit lower="-1" upper="1" velocity="{}" acceleration="{}" jerk="{}"/>'
    text = robot(
        joint("jl", "torso l", "revolute", Z + limit.format(1, 2, 3)),
        joint("jr", "torso r", "prismatic", '<axis xyz="1 0 0"/>' + limit.format(4, 5, 6)),
        links="torso l r",
    )
    np.testing.assert_array_equal(kinseek.load(text, "l", "r").mechanism.rates, [[1, 4], [2, 5], [3, 6]])


def test_black_box_kinematics_can_have_them() -> None:
    arm = kinseek.Arm.from_fk(slide, [-1, -1], [1, 1], names=["a", "b"])
    arm = arm.with_limits(velocity=1, acceleration={"b": 2})
    for each in (arm, arm.with_limits({"a": (0, 1)}), pickle.loads(pickle.dumps(arm))):
        np.testing.assert_array_equal(
            [each.velocity, each.acceleration, each.jerk], [[1, 1], [NAN, 2], [NAN, NAN]]
        )
    np.testing.assert_array_equal(arm.mechanism.part((1,), np.zeros(2), None).acceleration, [2])


def test_what_is_given_is_a_copy() -> None:
    arm = panda()
    arm.velocity[:] = arm.acceleration[:] = arm.jerk[:] = 0.0
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


def test_times_are_kept_with_the_speeds_of_the_file() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 40)])
    times = np.linspace(0.0, 1.0, 40)
    path = arm.follow(T, times=times)
    assert path.success
    # Far from the speeds nothing changes, and the cost is the distance.
    assert (path.q == arm.follow(T).q).all()
    hurried = arm.follow(T, times=times * 0.05)
    assert len(hurried.breaks)
    kept = np.delete(np.abs(hurried.steps), hurried.breaks, axis=0)
    assert (kept <= arm.velocity * 0.05 / 39 * (1 + 1e-9)).all()


def test_times_without_speeds_are_refused() -> None:
    puma = kinseek.load("puma560")
    T = np.repeat(puma.fk(np.zeros(6))[None], 3, axis=0)
    with pytest.raises(InvalidProblem, match=r"no speed above 0 for .*: give velocity="):
        puma.follow(T, times=[0, 1, 2])
    assert puma.follow(T, times=[0, 1, 2], velocity=1.0).success
