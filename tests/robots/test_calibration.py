"""Measured origins of joints: files of ur_calibration, and mappings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import InvalidRobot
from kinseek.robots import catalog_path

Array = NDArray[np.float64]

JOINTS = {
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
"""The joint whose origin each entry of a file is."""
NUMBERS = ("x", "y", "z", "roll", "pitch", "yaw")


def origins(name: str) -> dict[str, list[float]]:
    """x, y, z, roll, pitch, yaw of the six joints of a bundled arm."""
    text = catalog_path(name).read_text(encoding="utf-8")
    found = {}
    for entry, joint in JOINTS.items():
        origin = re.search(f'<joint name="{joint}".*?<origin xyz="(.*?)" rpy="(.*?)"', text, re.DOTALL)
        assert origin is not None
        found[entry] = [float(word) for word in f"{origin[1]} {origin[2]}".split()]
    return found


def written(entries: dict[str, list[float]], path: Path) -> Path:
    """A file such as ur_calibration writes."""
    content = {name: dict(zip(NUMBERS, numbers, strict=True)) for name, numbers in entries.items()}
    path.write_text(yaml.safe_dump({"kinematics": {**content, "hash": "calib_1"}}), encoding="utf-8")
    return path


def measured(name: str, seed: int) -> dict[str, list[float]]:
    """Origins as a factory measures them: tenths of a millimetre and milliradians away from the nominal ones."""
    noise = np.random.default_rng(seed).normal(0.0, [3e-4] * 3 + [1.5e-3] * 3, (6, 6))
    return {entry: (numbers + noise[i]).tolist() for i, (entry, numbers) in enumerate(origins(name).items())}


def test_a_file_gives_the_arm_that_has_these_origins(tmp_path: Path) -> None:
    arm = kinseek.load("ur10e", calibration=written(origins("ur10e_calibrated"), tmp_path / "c.yaml"))
    expected = kinseek.load("ur10e_calibrated")
    q = expected.sample(50)
    assert np.array_equal(arm.fk(q), expected.fk(q))
    assert (arm.base, arm.tip, arm.joint_names) == (expected.base, expected.tip, expected.joint_names)
    assert np.array_equal(
        [arm.lower, arm.upper, arm.velocity], [expected.lower, expected.upper, expected.velocity]
    )
    assert not np.array_equal(arm.fk(q), kinseek.load("ur10e").fk(q))


def test_a_file_may_leave_joints_out(tmp_path: Path) -> None:
    all_six = origins("ur10e_calibrated")
    some = written({"forearm": all_six["forearm"]}, tmp_path / "c.yaml")
    arm, nominal = kinseek.load("ur10e", calibration=str(some)), kinseek.load("ur10e")
    assert np.array_equal(arm.chain.fixed[[0, 1, 3, 4, 5, 6]], nominal.chain.fixed[[0, 1, 3, 4, 5, 6]])
    assert not np.array_equal(arm.chain.fixed[2], nominal.chain.fixed[2])


@pytest.mark.parametrize("named", ["joints", "links", "short"])
def test_a_mapping_gives_the_same_as_a_file(named: str) -> None:
    names = {"joints": JOINTS, "links": {entry: f"{entry}_link" for entry in JOINTS}}.get(named, {})
    given = {
        names.get(entry, entry): kinseek.pose(numbers[:3], rpy=numbers[3:])
        for entry, numbers in origins("ur10e_calibrated").items()
    }
    arm, expected = kinseek.load("ur10e", calibration=given), kinseek.load("ur10e_calibrated")
    q = expected.sample(50)
    np.testing.assert_allclose(arm.fk(q), expected.fk(q), rtol=0, atol=1e-15)


@pytest.mark.parametrize("pitch", [0.0, 1.0, np.pi / 2, np.pi / 2 - 1e-9, -np.pi / 2, np.pi])
def test_any_rotation_survives(pitch: float) -> None:
    for yaw, roll in np.random.default_rng(0).uniform(-np.pi, np.pi, (20, 2)):
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
        T[:3, 3] = [0.1, -0.2, 0.3]
        arm = kinseek.load("planar2", calibration={"joint1": T})
        np.testing.assert_allclose(arm.fk([0.0, 0.0], "joint1"), T, rtol=0, atol=1e-15)


def cell(*prefixes: str) -> str:
    """The text of a file with several UR5e."""
    text = catalog_path("ur5e").read_text(encoding="utf-8")
    body = re.sub(r"<!--.*?-->|<\?xml.*?\?>|</?robot.*?>", "", text, flags=re.DOTALL)
    parts = [
        re.sub(r'(?<=[ "])(name|link)="', rf'\1="{prefix}', body)
        + f'<joint name="{prefix}stand" type="fixed"><parent link="world"/><child link="{prefix}base_link"/></joint>'
        for prefix in prefixes
    ]
    return f'<robot name="cell"><link name="world"/>{"".join(parts)}</robot>'


def test_names_with_a_prefix(tmp_path: Path) -> None:
    entries = measured("ur5e", 1)
    file = written(entries, tmp_path / "c.yaml")
    plain = kinseek.load("ur5e", calibration=file)
    arm = kinseek.load(cell("left_"), "left_base_link", "left_tool0", calibration=file)
    q = plain.sample(10)
    assert np.array_equal(arm.fk(q), plain.fk(q))
    with pytest.raises(
        InvalidRobot, match=r"several links .* end in 'forearm': left_forearm_link, right_forearm_link"
    ):
        kinseek.load(cell("left_", "right_"), "left_base_link", "left_tool0", calibration=file)
    given = {f"left_{name}": kinseek.pose(n[:3], rpy=n[3:]) for name, n in entries.items()}
    arm = kinseek.load(cell("left_", "right_"), "left_base_link", "left_tool0", calibration=given)
    np.testing.assert_allclose(arm.fk(q), plain.fk(q), rtol=0, atol=1e-15)


def newton(arm: kinseek.Arm, target: Array, q: Array) -> Array | None:
    """The solution that Newton's method finds from q; None if it does not converge."""
    for _ in range(30):
        T = arm.fk(q)
        turn = Rotation.from_matrix(target[:3, :3] @ T[:3, :3].T).as_rotvec()
        error = np.concatenate([target[:3, 3] - T[:3, 3], turn])
        if np.abs(error).max() < 1e-12:
            return q
        q = q + np.linalg.lstsq(arm.jacobian(q), error, rcond=1e-12)[0]
    return None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "seed"), [("ur5e", 1), ("ur5e", 2), ("ur10e", 3)])
def test_branches_are_as_complete_as_those_of_the_nominal_arm(name: str, seed: int, tmp_path: Path) -> None:
    """Every solution to which Newton's method leads from a nominal solution is among the branches."""
    nominal = kinseek.load(name)
    arm = kinseek.load(name, calibration=written(measured(name, seed), tmp_path / "c.yaml"))
    assert arm.structure.word == nominal.structure.word
    found = 0
    for target in arm.fk(arm.sample(100, seed)):
        branches = arm.branches(target).q
        for start in nominal.branches(target).q:
            q = newton(arm, target, start)
            if q is None or (q < arm.lower).any() or (q > arm.upper).any():
                continue
            away = np.abs(np.angle(np.exp(1j * (branches - q)))).max(axis=1)
            assert away.min() < 1e-6, (target, q)
            found += 1
    assert found > 600


def entry(**numbers: Any) -> bytes:
    """A file with one entry."""
    values = dict.fromkeys(NUMBERS, 0) | {"z": 0.1625} | numbers
    return b"kinematics: {shoulder: {%s}}" % ", ".join(f"{k}: {v}" for k, v in values.items()).encode()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a calibration: expected the entry 'kinematics'"),
        (b"- 1", "not a calibration"),
        (b"kinematics: {hash: calib_1}", "not a calibration"),
        (b"kinematics: {shoulder: 3}", "shoulder: expected x, y, z, roll, pitch, yaw, got 3"),
        (b"kinematics: {shoulder: {x: 0}}", "shoulder: expected x, y, z, roll, pitch, yaw, got x"),
        (entry(x="a"), "shoulder: 'a' is not a number"),
        (entry(roll=".nan"), "shoulder: 'nan' is not finite"),
        (entry(z=0.2), "0.0375 m away .* expected at most 0.03 m: this is the calibration of another model"),
        (entry(x=1e300), "another model"),
        (entry().replace(b"shoulder", b"elbow"), "unknown joint 'elbow'; did you mean 'elbow_joint'"),
        (entry().replace(b"shoulder", b"1"), "expected the name of a joint or a link, got 1"),
        (
            b"kinematics: !!python/object/apply:os.system ['true']",
            "broken YAML: could not determine a constructor",
        ),
        (b"a: 2001-99-99", "broken YAML: month"),
        (b"a: 1" + b":1" * 190 + b".5", "broken YAML: int too large"),
        (b"a: !!bool x", "broken YAML: 'x'"),
        (b"a: !!int ''", "broken YAML"),
        (b"a: !!timestamp x", "broken YAML"),
        (b"- " * 20_000, "nested too deeply"),
        (b"a: " + b"[" * 100, "100 brackets|33 brackets"),
        (b"#" * 70_000, "expected at most 65,536"),
    ],
)
def test_a_file_that_is_no_calibration_is_rejected(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(content)
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load("ur5e", calibration=path)


def test_numbers_without_a_dot_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_bytes(entry(x="1e-05"))
    assert kinseek.load("ur5e", calibration=path).fk(np.zeros(6), "shoulder_link")[0, 3] == -1e-05


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        (3, "must be the path of a .yaml file, or a mapping from joints to poses, got 3"),
        ({"elbow": np.eye(4)}, "unknown joint 'elbow'"),
        ({3: np.eye(4)}, "expected the name of a joint or a link, got 3"),
        ({"elbow_joint": [1.0, 2.0]}, "the origin of joint 'elbow_joint': a pose must have shape"),
        ({"elbow_joint": kinseek.pose([1e30, 0, 0])}, "the origin of joint 'elbow_joint'"),
        ("nothing.yaml", "no file 'nothing.yaml'"),
    ],
)
def test_a_wrong_calibration_is_rejected(calibration: Any, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.load("ur5e", calibration=calibration)


def test_two_names_of_one_joint_are_rejected(tmp_path: Path) -> None:
    """The last one counted."""
    entries = origins("ur5e")
    path = written(entries | {"shoulder_pan_joint": entries["shoulder"]}, tmp_path / "c.yaml")
    told = "'shoulder' and 'shoulder_pan_joint' are both joint 'shoulder_pan_joint'"
    with pytest.raises(InvalidRobot, match=told):
        kinseek.load("ur5e", calibration=path)
    poses = {"shoulder_link": np.eye(4), "shoulder_pan_joint": np.eye(4)}
    with pytest.raises(InvalidRobot, match="are both joint 'shoulder_pan_joint'"):
        kinseek.load("ur5e", calibration=poses)


def test_a_source_without_a_urdf_is_rejected() -> None:
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromUrdf(str(catalog_path("ur5e")))
    with pytest.raises(InvalidRobot, match="calibration is for a URDF, and this source is none"):
        kinseek.load(model, tip="tool0", calibration={})


def test_bodies_of_a_scene_move_along(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    text = cell("").replace(
        '<link name="forearm_link"/>',
        """<link name="forearm_link"><collision><geometry>
        <sphere radius="0.05"/></geometry></collision></link>""",
    )
    assert "sphere" in text
    shifted = kinseek.pose([-0.425, 0.0, 0.02])
    arm = kinseek.load(text, "base_link", "tool0", calibration={"elbow_joint": shifted})
    scene = kinseek.Scene.of(arm)
    beside = arm.fk(np.zeros(6), "forearm_link")[:3, 3] + [0.0, 0.0, 0.2]
    scene.add_sphere("ball", 0.05, kinseek.pose(beside))
    assert scene.distance(np.zeros(6)) == pytest.approx(0.1, abs=1e-6)
