"""How fast joints may go by the robot's file: read, carried along, and never made up."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek import InvalidProblem
from kinseek.robots import catalog_names, catalog_path

TWO = """<robot name="two">
<link name="base"/><link name="upper"/><link name="fore"/><link name="tip"/>
<joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="1" velocity="1.5"/></joint>
<joint name="b" type="{kind}"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
  <limit {limit}/>{mimic}</joint>
<joint name="end" type="fixed"><parent link="fore"/><child link="tip"/><origin xyz="0.2 0 0"/></joint>
</robot>"""


def two(
    limit: str = 'lower="-2" upper="2" velocity="2.5"', kind: str = "revolute", mimic: str = ""
) -> kinseek.Arm:
    return kinseek.load(TWO.format(kind=kind, limit=limit, mimic=mimic))


def test_speeds_are_those_of_the_file() -> None:
    np.testing.assert_array_equal(two().velocity, [1.5, 2.5])
    np.testing.assert_array_equal(two('velocity="2.5"', "continuous").velocity, [1.5, 2.5])
    np.testing.assert_array_equal(kinseek.load("panda").velocity, [2.175] * 4 + [2.61] * 3)


@pytest.mark.parametrize("said", ["", 'velocity="0"', 'velocity="-1"', 'velocity="inf"', 'velocity="fast"'])
def test_no_speed_above_zero_is_none(said: str) -> None:
    np.testing.assert_array_equal(two(f'lower="-2" upper="2" {said}').velocity, [1.5, np.nan])


def test_a_follower_slows_its_leader() -> None:
    mimic = '<mimic joint="a" multiplier="-2"/>'
    assert two(mimic=mimic).velocity == [1.25]
    assert two('lower="-9" upper="9"', mimic=mimic).velocity == [1.5]


def test_other_arms_have_those_of_their_joints(tmp_path: Path) -> None:
    arm = kinseek.load("panda")
    assert (arm.with_locked({"panda_joint2": 0.1}).velocity == [2.175] * 3 + [2.61] * 3).all()
    assert (arm.with_limits({"panda_joint2": (0, 1)}).velocity == arm.velocity).all()
    assert (arm.with_tool(kinseek.pose([0, 0, 0.1])).velocity == arm.velocity).all()
    assert (pickle.loads(pickle.dumps(arm)).velocity == arm.velocity).all()
    xacro = tmp_path / "two.xacro"
    xacro.write_text(TWO.format(kind="revolute", limit='lower="-2" upper="2" velocity="${2 * 3}"', mimic=""))
    np.testing.assert_array_equal(kinseek.load(xacro).velocity, [1.5, 6.0])


def test_where_nothing_can_be_said_there_is_none() -> None:
    assert np.isnan(kinseek.Arm.from_dh([(0.3, 0, 0, 0)], [-1], [1]).velocity).all()
    function = kinseek.Arm.from_fk(lambda q: kinseek.pose([q[0], 0, 0]), [-1], [1], vectorized=False)
    assert np.isnan(function.velocity).all()
    assert np.isnan(kinseek.load("planar2").velocity).all()


def test_pinocchio_says_the_same() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    for name in catalog_names():
        arm = kinseek.load(name)
        if "continuous" in arm.kinds or len(arm.chain.leader) > arm.dof or np.isnan(arm.velocity).any():
            continue
        model = pinocchio.buildModelFromXML(catalog_path(name).read_text())
        held = kinseek.load(model, base=arm.base, tip=arm.tip)
        np.testing.assert_array_equal(held.velocity, arm.velocity)


def test_what_is_given_is_a_copy() -> None:
    arm = kinseek.load("ur5e")
    arm.velocity[:] = 0.0
    assert (arm.velocity > 3).all()


def test_times_are_kept_with_the_speeds_of_the_file() -> None:
    arm = kinseek.load("ur5e")
    T = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.3, 0.3, 40)])
    times = np.linspace(0.0, 1.0, 40)
    path = arm.follow(T, times=times)
    assert path.success
    assert (
        path.q == arm.follow(T).q
    ).all()  # Far from the speeds nothing changes, and the cost is the distance.
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
