"""Degrees where radians are read, and millimetres where metres are: a warning names the value."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Scene, UnitWarning
from kinseek.cli import main
from kinseek.collision import Box
from kinseek.robots import catalog_names
from places import SHARED

ROBOT = (
    '<robot name="r"><link name="a"/><link name="b"/><joint name="elbow" type="{}"><parent link="a"/><child link="b"/>'
    '<origin xyz="0 0 0.5"/><limit lower="{}" upper="{}"/></joint></robot>'
)
CELL = (
    '<robot name="c"><link name="table"><collision><origin xyz="550 0 -60"/><geometry><box size="1000 1600 40"/></geometry>'
    "</collision></link></robot>"
)
"""A table in millimetres."""


@pytest.mark.parametrize("name", ["rpy", "rotvec"])
def test_degrees_in_a_pose_are_asked_about(name: str) -> None:
    degrees: dict[str, Any] = {name: [180, 0, 0]}
    with pytest.warns(UnitWarning, match=f"{name} has an angle of 180 rad.*say degrees=True"):
        kinseek.pose([0, 0, 0], **degrees)
    turn: dict[str, Any] = {name: [2 * np.pi, 0, 0]}
    kinseek.pose([0, 0, 0], **turn)


def test_the_warning_blames_the_caller() -> None:
    with pytest.warns(UnitWarning) as caught:
        kinseek.pose([0, 0, 0], rpy=[[0, 0, 0], [0, 0, -90]])
    assert caught[0].filename == __file__


@pytest.mark.parametrize("name", ["rpy", "rotvec"])
def test_a_pose_in_degrees(name: str) -> None:
    degrees = np.array([[30.0, -20.0, 170.0], [0.0, 0.0, 360.0]])
    turned: dict[str, Any] = {name: degrees}
    given = kinseek.pose([1, 2, 3], degrees=True, **turned)
    turned = {name: np.deg2rad(degrees)}
    wanted = kinseek.pose([1, 2, 3], **turned)
    np.testing.assert_array_equal(given, wanted)
    np.testing.assert_array_equal(kinseek.pose([1, 2, 3], degrees=True), kinseek.pose([1, 2, 3]))


def test_a_quaternion_has_no_degrees() -> None:
    with pytest.raises(
        kinseek.InvalidGoal, match="degrees=True is for rpy and rotvec: quat_wxyz has no unit"
    ):
        kinseek.pose([0, 0, 0], quat_wxyz=[1, 0, 0, 0], degrees=True)


def test_bodies_in_millimetres_are_asked_about(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    pytest.importorskip("coal")
    cell = tmp_path / "cell.urdf"
    cell.write_text(CELL)
    arm = kinseek.load("ur5e")
    scene = Scene.of(arm, capsules=0.05)
    table, place = Box([1000, 1600, 40]), kinseek.pose([550, 0, -60])
    calls: dict[str, Callable[[], object]] = {
        "'a' is 64.0312 m from the base": lambda: scene.add_box("a", table.size, place),
        "'b' is 64.0312 m from the base": lambda: scene.add("b", table, place),
        "'c' is 519.605 m from the base": lambda: scene.add_points("c", [[300, 300, 300]], 0.01),
        "'d' extends 943.61 m from the joint that carries it": lambda: scene.attach("d", table, "tool0"),
        "table' is 64.0312 m from the base": lambda: scene.add_file(cell, prefix="e "),
        "'upper_arm_link' extends 50.425 m from": lambda: Scene.of(arm, capsules=50),
    }
    for told, call in calls.items():
        with pytest.warns(
            UnitWarning, match=f"{told}.*arm reaches 1.2 m .*millimetres, divide by 1000$"
        ) as caught:
            call()
        assert [each.filename for each in caught] == [__file__]
    # Nothing is said of bodies within reach, of large ones, and of those that are replaced time and again.
    scene.add_box("hall", [100, 100, 0.1], kinseek.pose([0, 0, -0.06]))
    scene.add_box("door", [1, 0.1, 2], kinseek.pose([9, 0, 0]))
    scene.add("a", table, kinseek.pose([560, 0, -60]), replace=True)


def test_the_terminal_asks_about_bodies_in_millimetres(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pinocchio")
    pytest.importorskip("coal")
    cell = tmp_path / "cell.urdf"
    cell.write_text(CELL)
    goal = ["--at", "0.4", "0.2", "0.3", "--position-only"]
    with pytest.raises(SystemExit) as ended:
        main(["solve", "ur5e", *goal, "--capsules", "0.05", "--scene", str(cell)])
    assert ended.value.code == 0
    told = capsys.readouterr().err
    assert "'table' is 64.0312 m from the base" in told
    assert told.count("\n") == 1


def test_goals_in_millimetres_are_asked_about() -> None:
    arm = kinseek.load("planar2")
    T = kinseek.pose([400, 200, 0])
    said = r"447.214 m from the base.*reaches 0.75 m at most.*millimetres, divide by 1000"
    for goal, near in (
        (T, None),
        (T, np.zeros(2)),
        (np.stack([np.eye(4), T]), None),
        (kinseek.Goal.pose(T), None),
    ):
        for _ in range(2):  # The first call compiles, the next takes another way.
            with pytest.warns(UnitWarning, match=said) as caught:
                assert not np.all(arm.ik(goal, near=near).success)
            assert caught[0].filename == __file__
    with pytest.warns(UnitWarning, match=said):
        arm.ik(kinseek.Goal.position([400, 200, 0]), solver=kinseek.CoordinateDescent())


def test_goals_out_of_reach_by_little_are_not() -> None:
    arm = kinseek.load("planar2")
    for far in (0.8, 7.4):
        assert not arm.ik(kinseek.pose([far, 0, 0])).success
    assert not arm.ik(kinseek.Goal.pose(kinseek.pose([100, 0, 0.1]), free="x")).success
    tool = np.eye(4)
    tool[0, 3] = 40.0
    assert not arm.ik(kinseek.Goal.position([45, 0, 1], tool=tool)).success


def test_limits_in_degrees_are_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT.format("revolute", -180, 180))
    with pytest.warns(
        UnitWarning, match=r"r.urdf: joints with limits of many turns in rad: 'elbow' \[-180, 180\]"
    ):
        kinseek.load(path)
    for kind, limit in (("revolute", 12.57), ("prismatic", 180), ("continuous", 180)):
        path.write_text(ROBOT.format(kind, -limit, limit))
        kinseek.load(path)


def test_limits_of_mjcf_in_degrees_are_asked_about(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    path = tmp_path / "m.xml"
    model = (
        "<mujoco><compiler angle='{}'/><worldbody><body><joint name='j' range='-180 180' limited='true'/></body>"
        "</worldbody></mujoco>"
    )
    path.write_text(model.format("radian"))
    with pytest.warns(UnitWarning, match=r"'j' \[-180, 180\]; if these are degrees, leave out"):
        kinseek.load(path)
    path.write_text(model.format("degree"))
    kinseek.load(path)


def test_real_arms_are_not_asked_about() -> None:
    for name in catalog_names():
        kinseek.load(name)  # Warnings are errors in these tests.
    for path in SHARED.rglob("*.urdf") if SHARED.is_dir() else ():
        # It branches; the limits of all joints are in its parts.
        with contextlib.suppress(kinseek.InvalidRobot):
            kinseek.load(path)


COMMANDS = {
    "rpy": (
        ("solve", "planar2", "--at", "0.3", "0.2", "0", "--rpy", "0", "0", "90"),
        "--rpy 0 0 90 has an angle of 90 rad, more than a full turn: if it is in degrees, add --deg",
    ),
    "near": (
        ("solve", "planar2", "--at", "0.3", "0.2", "0", "--position-only", "--near", "90", "0"),
        "--near has an angle of 90 rad",
    ),
    "arm angle": (
        ("solve", "panda", "--at", "0.4", "0.2", "0.3", "--rpy", "0", "0", "0", "--prefer", "arm_angle=90"),
        "--prefer arm_angle has an angle of 90 rad",
    ),
    "fk": (("fk", "planar2", "90", "0"), "fk has an angle of 90 rad"),
    "millimetres": (
        ("solve", "planar2", "--at", "300", "200", "0", "--position-only"),
        "the goal is 360.555 m from the base",
    ),
}


@pytest.mark.parametrize("case", COMMANDS)
def test_the_command_line_asks_in_one_line(case: str, capfd: pytest.CaptureFixture[str]) -> None:
    words, said = COMMANDS[case]
    with pytest.raises(SystemExit) as ended:
        main(words)
    lines = [line for line in capfd.readouterr().err.splitlines() if "compiling kernels" not in line]
    assert len(lines) == 1
    assert lines[0].startswith(f"kinseek: warning: {said}")
    assert ended.value.code in (0, 1)


def test_other_warnings_go_their_own_way() -> None:
    from kinseek.cli.output import warnings_in_one_line

    with pytest.warns(UserWarning, match="else"), warnings_in_one_line():
        warnings.warn("something else", UserWarning, stacklevel=1)
