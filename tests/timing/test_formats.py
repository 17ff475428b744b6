"""Trajectories as tables and ROS messages, and what happens to files that cannot be written."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.timing.formats import save, to_frame, to_ros
from ros_messages import Duration, JointTrajectory, JointTrajectoryPoint
from stand_in import HOSTILE, arm_with, smooth

GOLDEN = Path(__file__).parent / "golden"
MESSAGES = SimpleNamespace(JointTrajectory=JointTrajectory, JointTrajectoryPoint=JointTrajectoryPoint)
NAMES = [
    *kinseek.load("ur5e").joint_names,
    "t",
    *(f"{name} {what}" for what in ("velocity", "acceleration") for name in kinseek.load("ur5e").joint_names),
]


def test_a_table_has_positions_times_and_derivatives(tmp_path: Path) -> None:
    trajectory = smooth()
    expected = trajectory.sample(0.013)
    columns = np.column_stack([expected.q, expected.times, expected.velocity, expected.acceleration])
    save(trajectory, tmp_path / "seam.CSV", 0.013)
    with (tmp_path / "seam.CSV").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == NAMES
    np.testing.assert_array_equal(np.array(rows, dtype=float), columns)  # Every digit.
    save(trajectory, tmp_path / "seam.npy", 0.013)
    records = np.load(tmp_path / "seam.npy")
    assert records.dtype.names == ("q", "t", "velocity", "acceleration")
    for field, values in zip(("t", "q", "velocity", "acceleration"), expected, strict=True):
        np.testing.assert_array_equal(records[field], values)


def test_parquet(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    trajectory = smooth()
    save(trajectory, tmp_path / "seam.parquet", 0.013)
    read = parquet.read_table(tmp_path / "seam.parquet")
    assert read.column_names == NAMES
    found = np.column_stack([read.column(name).to_numpy() for name in NAMES])
    expected = trajectory.sample(0.013)
    np.testing.assert_array_equal(found[:, :6], expected.q)
    np.testing.assert_array_equal(found[:, 6], expected.times)


def test_a_data_frame() -> None:
    pytest.importorskip("pandas")
    frame = to_frame(smooth(), 0.5)
    assert list(frame.columns) == NAMES
    assert frame.index.name == "point"
    np.testing.assert_array_equal(frame["elbow_joint velocity"], smooth().sample(0.5).velocity[:, 2])


def test_without_a_period_there_is_a_point_at_each_pose() -> None:
    trajectory = smooth(pose_times=(1e-12, 0.4, 0.4, 0.4 + 1e-12, 1.5, 2.0 - 1e-12))
    seconds = [point["time_from_start"] for point in to_ros(trajectory)["points"]]
    assert [each["sec"] + each["nanosec"] / 1e9 for each in seconds] == [0.0, 0.4, 1.5, 2.0]
    still = smooth(duration=0.0, pose_times=(0.0,))
    assert len(to_ros(still)["points"]) == 1


@pytest.mark.parametrize("name", ["seam.csv", "seam.json"])
def test_golden_tables(name: str, tmp_path: Path) -> None:
    if name == "seam.csv":
        save(smooth(), tmp_path / name, 0.5)
        text = (tmp_path / name).read_text()
    else:
        text = json.dumps(to_ros(smooth(), 0.5), indent=1) + "\n"
    assert text == (GOLDEN / name).read_text()


def test_stamps_of_a_ros_message_increase() -> None:
    """The last two were equal if the period is a little less than a part of the duration."""
    trajectory = kinseek.load("ur5e").move(np.zeros(6), np.full(6, 0.31), acceleration=5.0)
    for k in range(2, 60):
        period = trajectory.duration / k - 3e-10 / k
        stamps = [each["time_from_start"] for each in to_ros(trajectory, period)["points"]]
        assert (np.diff([each["sec"] * 10**9 + each["nanosec"] for each in stamps]) > 0).all()


def test_a_ros_message() -> None:
    trajectory = smooth(duration=2.000000000499, pose_times=(0.0, 2.0))
    points = trajectory.sample(0.3)
    message = to_ros(trajectory, 0.3, MESSAGES)
    assert type(message) is JointTrajectory
    assert message.joint_names == list(trajectory.mechanism.joint_names)
    for field, values in (
        ("positions", points.q),
        ("velocities", points.velocity),
        ("accelerations", points.acceleration),
    ):
        np.testing.assert_array_equal([getattr(point, field) for point in message.points], values)
    stamps = [point.time_from_start for point in message.points]
    assert all(type(each) is Duration and 0 <= each.nanosec < 10**9 for each in stamps)
    times = [each.sec + each.nanosec / 1e9 for each in stamps]
    np.testing.assert_allclose(times, points.times, atol=1e-9)
    assert (stamps[-1].sec, stamps[-1].nanosec) == (2, 0)
    plain = to_ros(trajectory, 0.3)
    assert json.loads(json.dumps(plain)) == plain
    assert list(plain) == ["joint_names", "points"]
    assert list(plain["points"][0]) == ["positions", "velocities", "accelerations", "time_from_start"]
    for shown, point in zip(plain["points"], message.points, strict=True):
        assert shown["positions"] == point.positions
        assert shown["time_from_start"] == {
            "sec": point.time_from_start.sec,
            "nanosec": point.time_from_start.nanosec,
        }


def test_a_time_just_below_a_second_is_carried() -> None:
    point = to_ros(smooth(duration=0.9999999999, pose_times=(0.0,)), 0.5)["points"][-1]
    assert point["time_from_start"] == {"sec": 1, "nanosec": 0}


def test_hostile_names_stay_in_their_cell(tmp_path: Path) -> None:
    trajectory = smooth(arm_with(HOSTILE))
    save(trajectory, tmp_path / "seam.csv", 0.5)
    with (tmp_path / "seam.csv").open(encoding="utf-8", newline="") as file:
        names, *rows = csv.reader(file)
    assert tuple(names[:6]) == HOSTILE
    assert {len(row) for row in rows} == {19}


@pytest.mark.parametrize(
    ("file", "options", "error", "said"),
    [
        ("seam.txt", {}, kinseek.InvalidProblem, "ends in .csv, .npy, .parquet, .script, .src, .mod, got"),
        ("seam", {}, kinseek.InvalidProblem, "another ending needs language="),
        ("seam.csv", {"language": "kral"}, kinseek.InvalidProblem, "unknown language 'kral'.*Valid: krl"),
        ("seam.csv", {"name": "a"}, kinseek.InvalidUse, "name and axes are for programs"),
        ("seam.src", {"name": 5}, kinseek.InvalidProblem, "a program cannot be called 5"),
        ("seam.src", {"axes": ["A1"]}, kinseek.InvalidProblem, "axes must be a dict"),
        ("seam.src", {"axes": {0: "A1"}}, kinseek.InvalidProblem, "axes: unknown joint '0'"),
        ("seam.csv", {"language": {}}, kinseek.InvalidProblem, "unknown language '{}'"),
        ("seam.script", {"period": None}, kinseek.InvalidProblem, "needs a period.*0.008"),
        ("seam.mod", {"blend": -1.0}, kinseek.InvalidProblem, "blend must be a number from 0"),
        ("no/seam.mod", {}, kinseek.InvalidProblem, "folder .* does not exist"),
        ("folder.src", {"name": "a1"}, kinseek.InvalidProblem, "is not a regular file"),
    ],
)
def test_misuse(file: str, options: dict[str, Any], error: Any, said: str, tmp_path: Path) -> None:
    (tmp_path / "folder.src").mkdir()
    with pytest.raises(error, match=said):
        save(smooth(), tmp_path / file, **{"period": 0.5, **options})
    assert [each.name for each in tmp_path.iterdir()] == ["folder.src"]


@pytest.mark.parametrize("file", ["seam.csv", "seam.script"])
def test_a_failure_leaves_what_was_there(file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, target: Path) -> None:
        raise OSError(28, os.strerror(28))

    (tmp_path / file).write_text("before")
    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(kinseek.InvalidProblem, match=r"No space left.*it was not written"):
        save(smooth(), tmp_path / file, 0.5)
    assert [each.name for each in tmp_path.iterdir()] == [file]
    assert (tmp_path / file).read_text() == "before"


def test_the_methods_of_a_trajectory(tmp_path: Path) -> None:
    arm = kinseek.load("ur5e")
    q = arm.sample(1, seed=1)[0]
    trajectory = arm.follow(arm.fk([q, q + 0.05, q + 0.1]), start=q).timed(acceleration=5.0)
    options: dict[str, Any] = {
        "language": "movej",
        "name": "weld",
        "blend": 0.002,
        "axes": dict(zip(arm.joint_names, ("J6", "J5", "J4", "J3", "J2", "J1"), strict=True)),
    }
    trajectory.save(tmp_path / "a.txt", 0.01, **options)
    save(trajectory, tmp_path / "b.txt", 0.01, **options)
    assert (tmp_path / "a.txt").read_text() == (tmp_path / "b.txt").read_text()
    assert trajectory.to_ros(0.01) == to_ros(trajectory, 0.01)
    assert type(trajectory.to_ros(messages=MESSAGES)) is JointTrajectory
    points = trajectory.to_ros()["points"]  # The poses of the path.
    np.testing.assert_array_equal(
        [point["positions"] for point in points], trajectory.q(trajectory.pose_times)
    )
    for point, t in zip(points, trajectory.pose_times, strict=True):
        stamp = point["time_from_start"]
        assert stamp["sec"] + stamp["nanosec"] / 1e9 == pytest.approx(t, abs=1e-9)
    np.testing.assert_allclose([points[i]["velocities"] for i in (0, -1)], 0.0, atol=1e-12)
    pytest.importorskip("pandas")
    assert trajectory.to_frame(0.01).equals(to_frame(trajectory, 0.01))


def test_the_default_language_can_be_replaced(tmp_path: Path) -> None:
    save(smooth(), tmp_path / "seam.csv", language="krl")
    assert (tmp_path / "seam.csv").read_text().startswith("&ACCESS RVP\nDEF seam()")
