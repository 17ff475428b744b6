"""``kinseek follow``: poses in, joint values out, what stands in the way in words."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.cli.program import run


@pytest.fixture(name="line")
def _line(tmp_path: Path) -> Any:
    poses = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.2, 0.2, 40)])
    np.save(tmp_path / "line.npy", poses)
    return poses


def test_a_line(line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "joints.npy"
    assert run(["follow", "ur5e", str(tmp_path / "line.npy"), str(out)]) == 0
    told = capsys.readouterr().out
    assert "40 poses" in told
    assert str(kinseek.PathStatus.CONTINUOUS) in " ".join(told.split())
    rows = np.load(out)
    np.testing.assert_allclose(kinseek.load("ur5e").fk(rows["q"]), line, atol=1e-6)
    assert rows["reached"].all()
    assert not rows["break_after"].any()


def test_poses_out_of_reach_are_named(line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line[7:9, 0, 3] = 3.0
    np.save(tmp_path / "line.npy", line)
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), str(tmp_path / "joints.csv")]
    assert run([*words, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "UNREACHABLE"
    # One way of counting: what programs read, what people read, and what Python says.
    path = kinseek.load("ur5e").follow(line)
    assert told["missed"] == [7, 8] == np.flatnonzero(~path.reached).tolist()
    assert told["why"] == list(path.why)
    assert any("poses 7 to 8 are" in each for each in told["why"])
    with pytest.raises(kinseek.NotReached, match="counted from 0: poses 7 to 8 are out of reach"):
        path.require()
    assert run(words) == 1
    assert "poses are counted from 0: - poses 7 to 8 are" in " ".join(capsys.readouterr().out.split())
    reached = (tmp_path / "joints.csv").read_text(encoding="utf-8").splitlines()
    assert len(reached) == 41


def test_a_break_is_told_where_no_step_is_small_enough(
    line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "follow",
        "ur5e",
        str(tmp_path / "line.npy"),
        str(tmp_path / "joints.npy"),
        "--max-step",
        "0.001",
    ]
    assert run(words) == 1
    assert str(kinseek.PathStatus.BROKEN) in " ".join(capsys.readouterr().out.split())
    assert np.load(tmp_path / "joints.npy")["break_after"].sum() == 39
    assert run([*words, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["break_after"] == list(range(39))
    assert told["why"][0].startswith("between poses 0 and 1:")


def test_both_ends_and_a_period(line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm, out = kinseek.load("ur5e"), tmp_path / "joints.npy"
    path = arm.follow(line, start=arm.branches(line[0]).q[2])
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), str(out)]
    ends = [
        word
        for name, q in (("--start", path.q[0]), ("--end", path.q[-1]))
        for word in (name, str(q.tolist()))
    ]
    ends = [word.strip("[]").replace(",", " ") for word in ends]
    assert run([*words, *ends, "--period", "0.1"]) == 0
    np.testing.assert_array_equal(np.load(out)["q"][[0, -1]], path.q[[0, -1]])
    assert run([*words, "--period", "0.001"]) == 1  # Faster than its joints.
    assert "0.00314 rad is allowed" in capsys.readouterr().out
    assert run(["follow", "puma560", *words[2:], "--period", "0.1"]) == 2
    assert "no speed above 0" in capsys.readouterr().err


@pytest.mark.usefixtures("line")
def test_ctrl_c_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*words: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    out = tmp_path / "joints.csv"
    out.write_text("what was there", encoding="utf-8")
    monkeypatch.setattr("kinseek.paths.follow.isolated_layers", stopped)
    assert run(["follow", "ur5e", str(tmp_path / "line.npy"), str(out)]) == 130
    assert out.read_text(encoding="utf-8") == "what was there"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["joints.csv", "line.npy"]


@pytest.mark.usefixtures("line")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["line.npy", "line.npy"], "OUT 'line.npy' is the file that POSES reads"),
        (["line.npy", "joints.txt"], "OUT takes a file that ends in .csv, .npy, .parquet, got 'joints.txt'"),
        (["nothing.csv", "joints.csv"], "cannot read 'nothing.csv'"),
        (["line.npy", "joints.csv", "--max-step", "0"], "max_step"),
        (["line.npy", "joints.csv", "--start", "0 0 0 0 0 0"], "start"),
        (["line.npy", "joints.csv", "--end", "0 0 0 0 0 0"], "end does not reach the last pose"),
        (["line.npy", "joints.csv", "--step", "0.1"], "--step and --turn are needed together"),
        (
            ["line.npy", "joints.csv", "--blend", "0.1"],
            "--step and --turn are needed together, and with --blend",
        ),
        (["line.npy", "joints.csv", "--step", "0", "--turn", "1"], "step must be a number above 0"),
        (
            ["line.npy", "joints.csv", "--step", "1", "--turn", "1", "--blend", "1"],
            "blend must be at most half",
        ),
        (["line.npy", "joints.csv", "--period", "0"], "--period must be above 0"),
        (["line.npy"], "follow needs an output file: OUT for joint values, or --out for a trajectory"),
        (["line.npy", "joints.csv", "--jerk", "5"], "limits of a motion in time are for --out"),
        (
            ["line.npy", "--out", "seam.txt"],
            "ends in .csv, .npy, .parquet, .script, .src, .mod, got 'seam.txt'",
        ),
        (
            ["line.npy", "--out", "line.npy", "--acceleration", "5"],
            "--out 'line.npy' is the file of POSES too",
        ),
        (["line.npy", "a.csv", "--out", "a.csv", "--acceleration", "5"], "is the file of OUT too"),
        (["line.npy", "--out", "a b.src", "--acceleration", "5"], "a program cannot be called 'a b'"),
        (
            ["line.npy", "--out", "a.mod", "--acceleration", "5", "6"],
            "--acceleration needs 1 or 6 numbers, got 2",
        ),
        (["line.npy", "--out", "seam.script", "--acceleration", "5"], "needs a period"),
        (["line.npy", "--out", "seam.mod"], "has no acceleration limit"),
        (["line.npy", "--out", "seam.mod", "--acceleration", "0"], "acceleration must be above 0"),
    ],
)
def test_misuse_is_one_line(
    words: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(["follow", "ur5e", *words]) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1
    assert not (tmp_path / "joints.csv").exists()


@pytest.mark.usefixtures("line")
def test_the_options_of_a_goal_are_those_of_solve(tmp_path: Path) -> None:
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), str(tmp_path / "joints.npy")]
    assert run([*words, "--free", "x,rz", "--frame", "base", "--position-tolerance", "0.001"]) == 0
    poses = np.load(tmp_path / "line.npy")
    goal = kinseek.Goal.pose(poses, free=("x", "rz"), frame="base", position_tolerance=0.001)
    np.testing.assert_array_equal(
        np.load(tmp_path / "joints.npy")["q"], kinseek.load("ur5e").follow(goal, max_step=0.3).q
    )


def test_poses_are_inserted_between_key_poses(tmp_path: Path) -> None:
    keys = [
        [0.4, -0.2, 0.3, 0, 0, -1, 1, 0, 0],
        [0.4, 0.2, 0.3, 0, 0, -2, 1, 0.1, 0.1],
        [0.5, 0.2, 0.3, 0, 0, -1, 2, 0, 0],
    ]
    rows = ["x,y,z,nx,ny,nz,tx,ty,tz", *(",".join(map(str, row)) for row in keys)]
    (tmp_path / "keys.csv").write_text("\n".join(rows), encoding="utf-8")
    words = ["follow", "ur5e", str(tmp_path / "keys.csv"), str(tmp_path / "joints.npy")]
    assert run([*words, "--step", "0.01", "--turn", "0.05", "--blend", "0.02"]) == 0
    numbers = np.array(keys, dtype=float)
    poses = kinseek.pose(numbers[:, :3], z_axis=numbers[:, 3:6], x_axis=numbers[:, 6:])
    dense = kinseek.interpolate(poses, step=0.01, turn=0.05, blend=0.02)
    np.testing.assert_allclose(
        kinseek.load("ur5e").fk(np.load(tmp_path / "joints.npy")["q"]), dense, atol=1e-6
    )


@pytest.mark.usefixtures("line")
def test_a_time_limit_leaves_poses_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), str(tmp_path / "joints.npy"), "--time-limit"]
    assert run([*words, "1e-9", "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "OUT_OF_TIME"
    assert told["not_planned"] == told["missed"] == list(range(40))
    assert told["break_after"] == []
    assert run([*words, "1e6"]) == 0
    capsys.readouterr()
    assert run([*words, "0"]) == 2
    assert "time_limit must be a number of seconds above 0" in capsys.readouterr().err


def test_what_is_proved_is_told(line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), str(tmp_path / "joints.npy"), "--prove"]
    assert run(words) == 0
    assert "proved to be unbroken, inside the limits: the whole path" in " ".join(
        capsys.readouterr().out.split()
    )
    assert np.load(tmp_path / "joints.npy")["proved_after"].tolist() == [True] * 39 + [False]
    line[7:9, 0, 3] = 3.0
    np.save(tmp_path / "line.npy", line)
    assert run([*words, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["certified"] is False
    assert told["proved_steps"] == 36
    assert told["impossible"] == []
    assert any("poses 7 to 8 are proved out of reach" in each for each in told["why"])


@pytest.mark.usefixtures("line")
def test_a_trajectory_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["follow", "ur5e", str(tmp_path / "line.npy"), "--acceleration", "5", "--tool-speed", "0.1"]
    assert run([*words, "--period", "0.01", "--out", str(tmp_path / "seam.npy")]) == 0
    told = capsys.readouterr().out
    assert "fastest motion within the limits: " in told
    assert "tool speed" in told
    assert f"trajectory: {tmp_path / 'seam.npy'}" in told.replace("\n", " ")
    arm = kinseek.load("ur5e")
    trajectory = arm.follow(np.load(tmp_path / "line.npy")).timed(acceleration=5.0, tool_speed=0.1)
    rows, samples = np.load(tmp_path / "seam.npy"), trajectory.sample(0.01)
    np.testing.assert_array_equal(rows["t"], samples.times)
    np.testing.assert_array_equal(rows["q"], samples.q)
    np.testing.assert_array_equal(rows["acceleration"], samples.acceleration)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["line.npy", "seam.npy"]
    assert run([*words, str(tmp_path / "q.csv"), "--out", str(tmp_path / "seam.mod"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["out"] == str(tmp_path / "q.csv")
    assert facts["trajectory"]["out"] == str(tmp_path / "seam.mod")
    assert facts["trajectory"]["duration"] == trajectory.duration
    assert facts["trajectory"]["bottleneck"][0]["limit"] == trajectory.bottleneck[0].limit
    assert max(facts["trajectory"]["limits_kept"]["acceleration"]) <= 1.0
    assert (tmp_path / "seam.mod").read_text().count("MoveAbsJ") == 40  # One for each pose.
    assert (tmp_path / "q.csv").exists()


def test_the_fastest_motion_is_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm = kinseek.load("panda")
    t = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([0.45 + 0.1 * np.cos(t), 0.15 * np.sin(t), np.full(60, 0.4)], axis=1)
    poses = kinseek.pose(circle, rpy=[np.pi, 0.0, 0.0])
    np.save(tmp_path / "circle.npy", poses)
    words = ["follow", "panda", str(tmp_path / "circle.npy"), "--acceleration", "8", "--json"]
    words += ["--out", str(tmp_path / "seam.csv")]
    durations = []
    for more in ([], ["--fastest"]):
        assert run([*words, *more]) == 0
        durations.append(json.loads(capsys.readouterr().out)["trajectory"]["duration"])
    expected = arm.follow(poses, cost="time", acceleration=8.0).timed(acceleration=8.0).duration
    assert durations[1] == expected < durations[0]
    assert run(["follow", "panda", str(tmp_path / "circle.npy"), str(tmp_path / "q.csv"), "--fastest"]) == 2
    assert "--out, which is not given" in capsys.readouterr().err


@pytest.mark.usefixtures("line")
def test_limits_may_differ_from_joint_to_joint(tmp_path: Path) -> None:
    words = [
        "follow",
        "ur5e",
        str(tmp_path / "line.npy"),
        "--out",
        str(tmp_path / "seam.npy"),
        "--period",
        "0.1",
    ]
    arm = kinseek.load("ur5e")
    path = arm.follow(np.load(tmp_path / "line.npy"))
    each = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    expected = path.timed(acceleration=each, velocity=0.5).sample(0.1)
    named = [f"{name}={value}" for name, value in zip(arm.joint_names, each, strict=True)]
    for accelerations in (map(str, each), named):
        assert run([*words, "--acceleration", *accelerations, "--velocity", "0.5"]) == 0
        np.testing.assert_array_equal(np.load(tmp_path / "seam.npy")["q"], expected.q)


def test_all_limits_reach_the_time_law(
    line: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def timed(self: kinseek.Path, **limits: Any) -> None:
        assert len(self) == len(line)
        assert limits == {"velocity": 1.0, "acceleration": 2.0, "jerk": 3.0, "tool_speed": 4.0}
        raise kinseek.InvalidProblem("seen")

    monkeypatch.setattr(kinseek.Path, "timed", timed)
    words = ["--velocity", "1", "--acceleration", "2", "--jerk", "3", "--tool-speed", "4"]
    assert (
        run(["follow", "ur5e", str(tmp_path / "line.npy"), "--out", str(tmp_path / "seam.mod"), *words]) == 2
    )
    assert capsys.readouterr().err == "kinseek: seen\n"


def test_without_all_poses_there_is_no_trajectory(
    line: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line[7, 0, 3] = 3.0
    np.save(tmp_path / "line.npy", line)
    words = [
        "follow",
        "ur5e",
        str(tmp_path / "line.npy"),
        "--acceleration",
        "5",
        "--out",
        str(tmp_path / "a.mod"),
    ]
    assert run(words) == 1
    assert "no trajectory, since some poses are missed" in " ".join(capsys.readouterr().out.split())
    assert run([*words, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["trajectory"] is None
    assert not (tmp_path / "a.mod").exists()
