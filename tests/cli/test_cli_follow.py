"""``kinseek follow``: poses in, joint values out, what stands in the way in words."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from command_line import CommandLine

ARM = kinseek.load("ur5e")
FOLLOW = "follow ur5e line.npy joints.npy"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.fixture(name="line")
def _line() -> Any:
    """Poses along a line, which are in the file line.npy."""
    poses = np.array([kinseek.pose([0.4, y, 0.3], rpy=[np.pi, 0, 0]) for y in np.linspace(-0.2, 0.2, 40)])
    np.save("line.npy", poses)
    return poses


@pytest.fixture(name="gap")
def _gap(line: Any) -> Any:
    """The same, two of them out of reach."""
    line[7:9, 0, 3] = 3.0
    np.save("line.npy", line)
    return line


def joints(name: str = "joints.npy") -> Any:
    """Joint values that were written."""
    return np.load(name)["q"]


def test_a_line(line: Any, cli: CommandLine) -> None:
    told = cli(FOLLOW).words
    assert "40 poses" in told
    assert str(kinseek.PathStatus.CONTINUOUS) in told
    rows = np.load("joints.npy")
    np.testing.assert_allclose(ARM.fk(rows["q"]), line, atol=1e-6)
    assert rows["reached"].all()
    assert not rows["break_after"].any()


def test_poses_out_of_reach_are_named(gap: Any, cli: CommandLine) -> None:
    told = cli("follow ur5e line.npy joints.csv --json", code=1).facts
    assert told["status"] == "UNREACHABLE"
    # One way of counting: what programs read, what people read, and what Python says.
    path = ARM.follow(gap)
    assert told["missed"] == [7, 8] == np.flatnonzero(~path.reached).tolist()
    assert told["why"] == list(path.why)
    assert any("poses 7 to 8 are" in each for each in told["why"])
    with pytest.raises(kinseek.NotReached, match="counted from 0: poses 7 to 8 are out of reach"):
        path.require()
    words = cli("follow ur5e line.npy joints.csv", code=1).words
    assert "poses are counted from 0: - poses 7 to 8 are" in words
    assert len(Path("joints.csv").read_text(encoding="utf-8").splitlines()) == 41


@pytest.mark.usefixtures("line")
def test_a_break_is_told_where_no_step_is_small_enough(cli: CommandLine) -> None:
    assert str(kinseek.PathStatus.BROKEN) in cli(FOLLOW, "--max-step 0.001", code=1).words
    assert np.load("joints.npy")["break_after"].sum() == 39
    told = cli(FOLLOW, "--max-step 0.001 --json", code=1).facts
    assert told["break_after"] == list(range(39))
    assert told["why"][0].startswith("between poses 0 and 1:")


def test_both_ends_and_a_period(line: Any, cli: CommandLine) -> None:
    path = ARM.follow(line, start=ARM.branches(line[0]).q[2])
    start, end = (" ".join(map(str, q)) for q in path.q[[0, -1]])
    for line_of_ends in (f"--start '{start}' --end '{end}'", f"--start {start} --end {end}"):
        cli(FOLLOW, line_of_ends, "--period 0.1")
        np.testing.assert_array_equal(joints()[[0, -1]], path.q[[0, -1]])
    faster_than_its_joints = cli(FOLLOW, "--period 0.001", code=1).out
    assert "0.00314 rad is allowed" in faster_than_its_joints
    assert "no speed above 0" in cli.refused("follow puma560 line.npy joints.npy --period 0.1")


@pytest.mark.usefixtures("line")
def test_ctrl_c_leaves_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    def stopped(*words: Any, **options: Any) -> None:
        raise KeyboardInterrupt

    out = Path("joints.npy")
    out.write_text("what was there", encoding="utf-8")
    monkeypatch.setattr("kinseek.paths.follow.isolated_layers", stopped)
    cli(FOLLOW, code=130)
    assert out.read_text(encoding="utf-8") == "what was there"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["joints.npy", "line.npy"]


@pytest.mark.usefixtures("line")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("line.npy line.npy", "OUT 'line.npy' is the file that POSES reads"),
        ("line.npy joints.txt", "OUT takes a file that ends in .csv, .npy, .parquet, got 'joints.txt'"),
        ("nothing.csv joints.csv", "cannot read 'nothing.csv'"),
        ("line.npy joints.csv --max-step 0", "max_step"),
        ("line.npy joints.csv --start '0 0 0 0 0 0'", "start"),
        ("line.npy joints.csv --end '0 0 0 0 0 0'", "end does not reach the last pose"),
        ("line.npy joints.csv --step 0.1", "--step and --turn are needed together"),
        ("line.npy joints.csv --blend 0.1", "--step and --turn are needed together, and with --blend"),
        ("line.npy joints.csv --step 0 --turn 1", "step must be a number above 0"),
        ("line.npy joints.csv --step 1 --turn 1 --blend 1", "blend must be at most half"),
        ("line.npy joints.csv --period 0", "--period must be above 0"),
        ("line.npy", "follow needs an output file: OUT for joint values, or --out for a trajectory"),
        ("line.npy joints.csv --jerk 5", "limits of a motion in time are for --out"),
        ("line.npy --out seam.txt", "ends in .csv, .npy, .parquet, .script, .src, .mod, got 'seam.txt'"),
        ("line.npy --out line.npy --acceleration 5", "--out 'line.npy' is the file of POSES too"),
        ("line.npy a.csv --out a.csv --acceleration 5", "is the file of OUT too"),
        ("line.npy --out 'a b.src' --acceleration 5", "a program cannot be called 'a b'"),
        ("line.npy --out a.mod --acceleration 5 6", "--acceleration needs 1 or 6 numbers, got 2"),
        ("line.npy --out seam.script --acceleration 5", "needs a period"),
        ("line.npy --out seam.mod", "has no acceleration limit"),
        ("line.npy --out seam.mod --acceleration 0", "acceleration must be above 0"),
    ],
)
def test_misuse_is_one_line(words: str, said: str, cli: CommandLine) -> None:
    assert said in cli.refused("follow ur5e", words)
    assert not Path("joints.csv").exists()


def test_the_options_of_a_goal_are_those_of_solve(line: Any, cli: CommandLine) -> None:
    cli(FOLLOW, "--free x,rz --frame base --position-tolerance 0.001")
    goal = kinseek.Goal.pose(line, free=("x", "rz"), frame="base", position_tolerance=0.001)
    np.testing.assert_array_equal(joints(), ARM.follow(goal, max_step=0.3).q)


def test_poses_are_inserted_between_key_poses(cli: CommandLine) -> None:
    keys = [
        [0.4, -0.2, 0.3, 0, 0, -1, 1, 0, 0],
        [0.4, 0.2, 0.3, 0, 0, -2, 1, 0.1, 0.1],
        [0.5, 0.2, 0.3, 0, 0, -1, 2, 0, 0],
    ]
    rows = ["x,y,z,nx,ny,nz,tx,ty,tz", *(",".join(map(str, row)) for row in keys)]
    Path("keys.csv").write_text("\n".join(rows), encoding="utf-8")
    cli("follow ur5e keys.csv joints.npy --step 0.01 --turn 0.05 --blend 0.02")
    numbers = np.array(keys, dtype=float)
    poses = kinseek.pose(numbers[:, :3], z_axis=numbers[:, 3:6], x_axis=numbers[:, 6:])
    dense = kinseek.interpolate(poses, step=0.01, turn=0.05, blend=0.02)
    np.testing.assert_allclose(ARM.fk(joints()), dense, atol=1e-6)


@pytest.mark.usefixtures("line")
def test_a_time_limit_leaves_poses_out(cli: CommandLine) -> None:
    told = cli(FOLLOW, "--time-limit 1e-9 --json", code=1).facts
    assert told["status"] == "OUT_OF_TIME"
    assert told["not_planned"] == told["missed"] == list(range(40))
    assert told["break_after"] == []
    cli(FOLLOW, "--time-limit 1e6")
    heard = cli.refused(FOLLOW, "--time-limit 0")
    assert "time_limit must be a number of seconds above 0" in heard


@pytest.mark.usefixtures("line")
def test_what_is_proved_is_told(cli: CommandLine) -> None:
    told = cli(FOLLOW, "--prove").words
    assert "proved to be unbroken, inside the limits: the whole path" in told
    assert np.load("joints.npy")["proved_after"].tolist() == [True] * 39 + [False]


@pytest.mark.usefixtures("gap")
def test_what_is_proved_of_a_path_with_a_gap_is_told(cli: CommandLine) -> None:
    told = cli(FOLLOW, "--prove --json", code=1).facts
    assert told["certified"] is False
    assert told["proved_steps"] == 36
    assert told["impossible"] == []
    assert any("poses 7 to 8 are proved out of reach" in each for each in told["why"])


def test_a_trajectory_is_written(line: Any, tmp_path: Path, cli: CommandLine) -> None:
    words = "follow ur5e line.npy --acceleration 5 --tool-speed 0.1"
    told = cli(words, "--period 0.01 --out seam.npy").words
    assert "fastest motion within the limits: " in told
    assert "tool speed" in told
    assert "trajectory: seam.npy" in told
    trajectory = ARM.follow(line).timed(acceleration=5.0, tool_speed=0.1)
    rows, samples = np.load("seam.npy"), trajectory.sample(0.01)
    np.testing.assert_array_equal(rows["t"], samples.times)
    np.testing.assert_array_equal(rows["q"], samples.q)
    np.testing.assert_array_equal(rows["acceleration"], samples.acceleration)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["line.npy", "seam.npy"]
    facts = cli(words, "q.csv --out seam.mod --json").facts
    assert facts["out"] == "q.csv"
    assert facts["trajectory"]["out"] == "seam.mod"
    assert facts["trajectory"]["duration"] == trajectory.duration
    assert facts["trajectory"]["bottleneck"][0]["limit"] == trajectory.bottleneck[0].limit
    assert max(facts["trajectory"]["limits_kept"]["acceleration"]) <= 1.0
    assert Path("seam.mod").read_text().count("MoveAbsJ") == 40  # One for each pose.
    assert Path("q.csv").exists()


@pytest.mark.usefixtures("line")
def test_a_period_that_would_fill_the_memory_is_refused(cli: CommandLine) -> None:
    heard = cli.refused("follow ur5e line.npy --acceleration 5 --out t.npy --period 1e-7")
    assert "period must be a number from" in heard
    assert not Path("t.npy").exists()


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links")
def test_poses_in_a_link_to_itself_are_refused(cli: CommandLine, line: Any) -> None:
    Path("loop.npy").symlink_to("loop.npy")
    heard = cli.refused("follow ur5e loop.npy --velocity 1 --acceleration 5 --period 0.1 --out t.csv")
    assert "loop.npy" in heard
    assert Path("line.npy").exists()


def test_what_does_not_fit_into_the_memory_is_one_line(
    line: Any, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    """Some systems give no thread then."""
    errors: list[Exception] = [MemoryError(), RuntimeError("can't start new thread")]

    def full(*_: object, **options: object) -> None:
        raise errors.pop(0)

    monkeypatch.setattr(kinseek.Arm, "follow", full)
    assert cli.refused("follow ur5e line.npy q.csv") == "kinseek: not enough memory\n"
    assert cli.refused("follow ur5e line.npy q.csv").startswith(
        "kinseek: not enough memory, or too many threads"
    )


def test_the_trajectory_of_a_closed_path(line: Any, cli: CommandLine) -> None:
    np.save("there_and_back.npy", np.concatenate([line, line[-2:0:-1]]))
    told = cli("follow ur5e there_and_back.npy --closed --acceleration 5 --out t.csv").words
    assert "from the straight line, which is proved" in " ".join(told.split())


@pytest.mark.usefixtures("line")
def test_if_no_trajectory_can_be_written_no_path_is(cli: CommandLine) -> None:
    for name in ("q.csv", "t.csv"):
        Path(name).write_text("old")
    heard = cli.refused("follow ur5e line.npy q.csv --out t.csv --acceleration 5 --period 1e-9")
    assert "period must be a number from" in heard
    assert [Path(name).read_text() for name in ("q.csv", "t.csv")] == ["old", "old"]


@pytest.mark.usefixtures("line")
def test_a_period_longer_than_the_motion_is_reported(cli: CommandLine) -> None:
    """8 for 8 ms: the program had two points, and the path between them was another."""
    words = "follow ur5e line.npy --acceleration 5 --out seam.script --period"
    assert "only the two ends of it are written" in cli(words, "800").err
    assert cli(words, "0.008").err == ""


def test_the_fastest_motion_is_chosen(cli: CommandLine) -> None:
    arm = kinseek.load("panda")
    t = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = np.stack([0.45 + 0.1 * np.cos(t), 0.15 * np.sin(t), np.full(60, 0.4)], axis=1)
    poses = kinseek.pose(circle, rpy=[np.pi, 0.0, 0.0])
    np.save("circle.npy", poses)
    first, fastest = (
        cli("follow panda circle.npy --acceleration 8 --json --out seam.csv", more).facts["trajectory"]
        for more in ("", "--fastest")
    )
    expected = arm.follow(poses, cost="time", acceleration=8.0).timed(acceleration=8.0).duration
    assert fastest["duration"] == expected < first["duration"]
    heard = cli.refused("follow panda circle.npy q.csv --fastest")
    assert "--out, which is not given" in heard


def test_limits_may_differ_from_joint_to_joint(line: Any, cli: CommandLine) -> None:
    each = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    expected = ARM.follow(line).timed(acceleration=each, velocity=0.5).sample(0.1)
    named = [f"{name}={value}" for name, value in zip(ARM.joint_names, each, strict=True)]
    for accelerations in (each, named):
        limits = ["--acceleration", *accelerations, "--velocity 0.5"]
        cli("follow ur5e line.npy --out seam.npy --period 0.1", *limits)
        np.testing.assert_array_equal(joints("seam.npy"), expected.q)


def test_all_limits_reach_the_time_law(line: Any, monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> None:
    def timed(self: kinseek.Path, **limits: Any) -> None:
        assert len(self) == len(line)
        assert limits == {"velocity": 1.0, "acceleration": 2.0, "jerk": 3.0, "tool_speed": 4.0}
        raise kinseek.InvalidProblem("seen")

    monkeypatch.setattr(kinseek.Path, "timed", timed)
    limits = "--velocity 1 --acceleration 2 --jerk 3 --tool-speed 4"
    assert cli.refused("follow ur5e line.npy --out seam.mod", limits) == "kinseek: seen\n"


@pytest.mark.usefixtures("gap")
def test_without_all_poses_there_is_no_trajectory(cli: CommandLine) -> None:
    words = "follow ur5e line.npy --acceleration 5 --out a.mod"
    assert "no trajectory, since some poses are missed" in cli(words, code=1).words
    assert cli(words, "--json", code=1).facts["trajectory"] is None
    assert not Path("a.mod").exists()
