"""The bundled arms: complete, honest about where they come from, and right."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek.errors import InvalidRobot
from kinseek.kernels.arm.forward import forward_many
from kinseek.robots import catalog_entry, catalog_names, catalog_path, read
from kinseek.robots.catalog import limits_table
from pinocchio_poses import pinocchio_poses
from places import ROOT, SHARED

FLEET = json.loads((SHARED / "robots.json").read_text()) if SHARED.is_dir() else {}
PAPER = ("planar2", "cylindrical3", "scara4", "elbow6")


@pytest.mark.parametrize("name", catalog_names())
def test_every_arm_says_what_it_is(name: str) -> None:
    entry, chain = catalog_entry(name), read(name)
    assert (chain.name, chain.base, chain.tip, chain.dof) == (name, entry.base, entry.tip, entry.dof)
    assert all((entry.description, entry.source, entry.licence, entry.limits))
    assert "kinematic data only" in catalog_path(name).read_text().lower()


@pytest.mark.skipif(not FLEET, reason="the shared robots are not here")
@pytest.mark.parametrize("name", FLEET)
def test_fleet_agrees_with_stored_poses(name: str) -> None:
    stored = np.load(SHARED / "fk" / f"{name}.npz")
    chain = read(name)
    assert chain.joint_names == tuple(stored["joint_names"])
    assert (chain.base, chain.tip) == (FLEET[name]["base"], FLEET[name]["tip"])
    poses = forward_many(chain.arrays, np.ascontiguousarray(stored["q"]))
    assert np.abs(poses - stored["T"]).max() < 1e-12


@pytest.mark.parametrize("name", catalog_names())
def test_pinocchio_agrees(name: str) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    arm, model = kinseek.load(name), pinocchio.buildModelFromXML(catalog_path(name).read_text(), mimic=True)
    q = arm.sample(10, seed=1)
    expected = pinocchio_poses(pinocchio, model, arm, q)
    np.testing.assert_allclose(forward_many(arm.chain.arrays, q), expected, rtol=0, atol=1e-12)


def test_the_papers_arms() -> None:
    assert [catalog_entry(name).dof for name in PAPER] == [2, 3, 4, 6]
    tips = [forward_many(read(name).arrays, np.zeros((1, read(name).dof)))[0, :3, 3] for name in PAPER]
    expected = np.array([(0.75, 0.0, 0.0), (0.0, 0.0, 0.0), (0.75, 0.0, 0.0), (0.75, 0.0, 0.25)])
    np.testing.assert_allclose(np.array(tips), expected, rtol=0, atol=1e-15)
    for name in PAPER:
        chain = read(name)
        turning = np.array([kind == "revolute" for kind in chain.kinds])
        assert chain.wraps[turning].all()
        np.testing.assert_array_equal(chain.lower[turning], 0.0)


def test_the_page_says_where_limits_come_from() -> None:
    page = ROOT / "docs" / "arms.md"
    if not page.is_file():
        pytest.skip("the documentation is not part of what is tested here")
    assert limits_table() in page.read_text(encoding="utf-8")


def test_the_panda_has_the_limits_of_its_maker() -> None:
    """As in `joint_limits.yaml` of frankaemika/franka_ros, and in the maker's data sheet."""
    chain = read("panda")
    np.testing.assert_array_equal(
        chain.lower, [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
    )
    np.testing.assert_array_equal(chain.upper, [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])
    np.testing.assert_array_equal(chain.velocity, [2.1750] * 4 + [2.6100] * 3)


def test_other_limits_of_makers() -> None:
    np.testing.assert_array_equal(read("piper").velocity, [3.0] * 6)
    pr2 = read("pr2_left")
    soft = {"l_shoulder_lift_joint": (-0.3535999999999999, 1.2963), "l_wrist_flex_joint": (-2.0, -0.1)}
    for name, limits in soft.items():
        i = pr2.joint_names.index(name)
        assert (pr2.lower[i], pr2.upper[i]) == limits


def test_base_and_tip_can_be_chosen() -> None:
    assert read("panda", tip="panda_link4").dof == 4
    assert read("panda", base="panda_link2").dof == 5


def test_unknown_names_get_near_matches() -> None:
    with pytest.raises(InvalidRobot, match=r"unknown robot 'pnada'; did you mean 'panda'"):
        catalog_path("pnada")
    with pytest.raises(InvalidRobot, match=r"did you mean 'panda'.*A path must end in .urdf, .xacro or .xml"):
        read("pandas")
    with pytest.raises(InvalidRobot, match=r"A path must end in"):
        read(Path("arm.sdf"))
