"""Options of the command line for the goal: tools, ranges, poses by two directions, and times in a table of a path."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import kinseek
from command_line import CommandLine
from kinseek import Goal

ARM = kinseek.load("ur5e")
AT = "solve ur5e --at 0.4 -0.2 0.3"
DOWN = kinseek.pose([0.4, -0.2, 0.3], rpy=[np.pi, 0, 0])


@pytest.mark.parametrize(
    "words",
    [
        "--z-axis 0 0 -1 --x-axis 2 0 0",
        "--z-axis 0,0,-3 --y-axis 0,-1,0",
        "--x-axis 1 0 0.001 --z-axis 0 0 -1",
    ],
)
def test_two_directions_are_a_rotation(words: str, cli: CommandLine) -> None:
    assert np.abs(ARM.fk(cli(AT, words, "--json").facts["q"]) - DOWN).max() < 1e-5


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--z-axis 0 0 -1", "two of --z-axis, --x-axis, --y-axis, got --z-axis; for any turn"),
        ("--z-axis 0 0 -1 --x-axis 0 0 1", "parallel"),
        ("--z-axis 0 0 -1 --x-axis 1 0 0 --rpy 0 0 0", "exactly one of"),
        ("--z-axis 0 0", "--z-axis needs 3 numbers"),
        ("--rpy 3 0 0 --tool 0 0", "--tool needs 3 numbers, X Y Z, or 6"),
        ("--rpy 3 0 0 --box z", "--box takes AXIS=LOW:HIGH"),
        ("--rpy 3 0 0 --box z=-0.1", "--box takes AXIS=LOW:HIGH"),
        ("--rpy 3 0 0 --box z=-0.1:a", "'a' is not a number"),
        ("--rpy 3 0 0 --box z=-0.1:0 --box z=0:0.1", "the axis 'z' twice"),
        ("--rpy 3 0 0 --box w=-0.1:0", "'w'"),
    ],
)
def test_misuse_of_the_options_is_an_error(words: str, said: str, cli: CommandLine) -> None:
    assert said in cli.refused(AT, words)


def test_a_tool_is_a_position_or_a_whole_pose(cli: CommandLine) -> None:
    turned = kinseek.pose([0, 0, 0.1], rpy=[0, -30, 0], degrees=True)
    for words, tool in (("0 -0.05 0.1", kinseek.pose([0, -0.05, 0.1])), ("0 0 0.1 0 -30 0", turned)):
        q = cli(AT, "--rpy 180 0 0 --deg --json --tool", words).facts["q"]
        assert np.abs(ARM.fk(q) @ tool - DOWN).max() < 1e-5


def test_ranges_are_those_of_a_goal(cli: CommandLine) -> None:
    far = "solve ur5e --at 1.0 0 0.3 --rpy 0 90 0 --deg"
    cli(far, code=1)
    q = cli(far, "--box z=-0.3:0.0,rx=-20:20 --box y=-0.1:0.1 --json").facts["q"]
    target = kinseek.pose([1.0, 0, 0.3], rpy=[0, 90, 0], degrees=True)
    turn = np.deg2rad(20.0)
    goal = Goal.pose(target, box={"z": (-0.3, 0.0), "y": (-0.1, 0.1), "rx": (-turn, turn)})
    assert q == ARM.ik(goal).q.tolist()
    off = target[:3, :3].T @ (ARM.fk(q)[:3, 3] - target[:3, 3])
    assert (np.abs(off) <= [1e-6, 0.1 + 1e-6, 0.3 + 1e-6]).all()
    assert off[2] < -0.01


def test_every_row_of_a_file_and_every_line_has_the_tool(
    tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    poses, out = tmp_path / "poses.csv", tmp_path / "q.npy"
    poses.write_text("x,y,z,roll,pitch,yaw\n0.4,-0.2,0.3,180,0,0\n")
    tool = "--tool 0 0 0.1 10 0 0 --deg"
    cli("solve ur5e --batch", poses, "--out", out, tool)
    tip = DOWN @ np.linalg.inv(kinseek.pose([0, 0, 0.1], rpy=[10, 0, 0], degrees=True))
    assert np.abs(ARM.fk(np.load(out)["q"][0]) - tip).max() < 1e-5
    line = {"position": [0.4, -0.2, 0.3], "z_axis": [0, 0, -1], "x_axis": [1, 0, 0]}
    wrong = line | {"rpy": [0, 0, 0]}
    monkeypatch.setattr(sys, "stdin", io.StringIO(f"{json.dumps(line)}\n{json.dumps(wrong)}\n"))
    first, second = cli("solve ur5e --jsonl", tool, code=2).rows
    assert np.abs(ARM.fk(first["q"]) - tip).max() < 1e-5
    assert "z_axis with x_axis" in second["error"]


ROWS = "t,x,y,z,roll,pitch,yaw\n0,0.4,-0.2,0.3,180,0,0\n0.5,0.4,-0.15,0.3,180,0,0\n{},0.4,-0.1,0.3,180,0,0\n"


def test_a_table_may_have_the_time_of_each_pose(tmp_path: Path, cli: CommandLine) -> None:
    poses, out = tmp_path / "poses.csv", tmp_path / "q.npy"
    poses.write_text(ROWS.format(2.0))
    cli("follow ur5e", poses, out, "--deg --tool 0 0 0.1")
    rows = np.load(out)
    assert rows["t"].tolist() == [0.0, 0.5, 2.0]
    tip = DOWN @ kinseek.pose([0, 0, -0.1])
    assert np.abs(ARM.fk(rows["q"][0]) - tip).max() < 1e-5
    # In a hundredth of a second no joint gets there.
    poses.write_text(ROWS.format(0.501))
    cli("follow ur5e", poses, out, "--deg --tool 0 0 0.1", code=1)


def test_a_period_gives_the_times_of_the_output(tmp_path: Path, cli: CommandLine) -> None:
    poses, out = tmp_path / "poses.csv", tmp_path / "q.csv"
    poses.write_text("\n".join(line.partition(",")[2] for line in ROWS.format(2.0).splitlines()))
    cli("follow ur5e", poses, out, "--deg --period 0.5")
    head, *rows = out.read_text().splitlines()
    column = head.split(",").index("t")
    assert [row.split(",")[column] for row in rows] == ["0.0", "0.5", "1.0"]
    cli("follow ur5e", poses, out, "--deg")
    assert "t" not in out.read_text().splitlines()[0].split(",")


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_times_are_rejected_where_they_have_no_meaning(ending: str, tmp_path: Path, cli: CommandLine) -> None:
    poses = tmp_path / f"poses.{ending}"
    if ending == "csv":
        poses.write_text(ROWS.format(2.0))
    else:
        pyarrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        names, *rows = (line.split(",") for line in ROWS.format(2.0).splitlines())
        columns = {name: [float(row[i]) for row in rows] for i, name in enumerate(names)}
        parquet.write_table(pyarrow.table(columns), poses)
    out = tmp_path / "q.npy"
    cli("follow ur5e", poses, out, "--deg")
    assert np.load(out)["t"].tolist() == [0.0, 0.5, 2.0]
    for more in ("--period 0.1", "--step 0.01 --turn 0.1"):
        heard = cli.refused("follow ur5e", poses, out, "--deg", more)
        assert "cannot be combined with --period or --step" in heard
    assert "unknown column 't'" in cli.refused("solve ur5e --deg --batch", poses, "--out", out)
