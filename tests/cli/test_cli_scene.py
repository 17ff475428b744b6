"""``--scene``: what the arm may hit, from the command line, and what stands in the way in words and as JSON."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.cli.program import run

pytest.importorskip("pinocchio")

CELL = """<robot name="cell">
  <link name="table"><collision><geometry><box size="1 1.6 0.04"/></geometry></collision></link>
  <link name="world"/>
  <joint name="feet" type="fixed"><parent link="world"/><child link="table"/><origin xyz="0.55 0 -0.06"/></joint>
</robot>"""

PART = """<robot name="part">
  <link name="part"><collision><geometry><mesh filename="none.stl"/></geometry></collision></link>
</robot>"""

ABOVE = ["--at", "0.52", "-0.2", "0.3", "--rpy", "0", "90", "0", "--deg"]
INSIDE = ["--at", "0.52", "-0.2", "-0.06", "--rpy", "0", "90", "0", "--deg"]
IN_CELL = ["--scene", "cell.urdf", "--capsules", "0.05"]


@pytest.fixture(autouse=True)
def _cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cell.urdf").write_text(CELL, encoding="utf-8")
    Path("part.urdf").write_text(PART, encoding="utf-8")


def scene() -> kinseek.Scene:
    found = kinseek.Scene.of(kinseek.load("ur5e"), capsules=0.05)
    found.add_file("cell.urdf")
    return found


@pytest.mark.slow
def test_an_answer_is_free_in_the_scene(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "ur5e", *ABOVE, *IN_CELL, "--clearance", "0.01", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == "SOLVED"
    assert told["contacts"] == []
    assert scene().free(told["q"], 0.01)


@pytest.mark.slow
def test_a_group_of_an_srdf(capsys: pytest.CaptureFixture[str]) -> None:
    group = '<group name="arm"><chain base_link="base_link" tip_link="wrist_3_link"/></group>'
    pairs = '<disable_collisions link1="shoulder_link" link2="forearm_link"/>'
    Path("arm.srdf").write_text(f'<robot name="ur5e">{group}{pairs}</robot>', encoding="utf-8")
    options = ["--srdf", "arm.srdf", "--group", "arm"]
    assert run(["solve", "ur5e", *ABOVE, "--scene", "self", "--capsules", "0.05", *options, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    arm = kinseek.load("ur5e", srdf="arm.srdf", group="arm")
    assert kinseek.Scene.of(arm, capsules=0.05).free(told["q"])
    assert run(["fk", "ur5e", "0", "0", "0", "0", "0", "0", *options, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["base"], told["tip"]) == ("base_link", "wrist_3_link")
    np.testing.assert_allclose(told["matrix"], arm.fk(np.zeros(6)), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_what_is_in_the_way_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "ur5e", *INSIDE, *IN_CELL]) == 1
    told = " ".join(capsys.readouterr().out.split())
    assert str(kinseek.Status.BLOCKED) in told
    assert "with collisions; contacts of the one that collides least: - " in told
    assert run(["solve", "ur5e", *INSIDE, *IN_CELL, "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert facts["status"] == "BLOCKED"
    assert facts["blocked"] > 0
    contacts = scene().hits(facts["q"])
    assert [(each["a"], each["b"]) for each in facts["contacts"]] == [(each.a, each.b) for each in contacts]
    assert facts["contacts"][0]["depth"] == pytest.approx(contacts[0].depth)
    assert run(["solve", "ur5e", *INSIDE, *IN_CELL, "--prove", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "PROVED_BLOCKED"


@pytest.mark.slow
def test_all_answers_are_free(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "ur5e", *ABOVE, "--all", "--json"]) == 0
    every = json.loads(capsys.readouterr().out)
    assert "blocked" not in every
    assert run(["solve", "ur5e", *ABOVE, *IN_CELL, "--all", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert len(facts["branches"]) + facts["blocked"] == len(every["branches"])
    assert facts["blocked"] > 0
    assert all(scene().free(each["q"]) for each in facts["branches"])
    assert run(["solve", "ur5e", *ABOVE, *IN_CELL, "--all"]) == 0
    assert "with collisions left out" in capsys.readouterr().out
    assert run(["solve", "ur5e", *INSIDE, *IN_CELL, "--all", "--prove"]) == 1
    assert "proved: the arm collides in every solution" in capsys.readouterr().out


@pytest.mark.slow
def test_a_file_of_poses(capsys: pytest.CaptureFixture[str]) -> None:
    Path("poses.csv").write_text(
        "x,y,z,roll,pitch,yaw\n0.52,-0.2,0.3,0,1.5708,0\n0.52,-0.2,-0.06,0,1.5708,0\n", encoding="utf-8"
    )
    assert run(["solve", "ur5e", "--batch", "poses.csv", "--out", "q.csv", *IN_CELL]) == 1
    rows = list(csv.DictReader(Path("q.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["status"] for row in rows] == ["SOLVED", "BLOCKED"]
    assert rows[0]["contacts"] == ""
    assert "and table, " in rows[1]["contacts"]
    assert run(["solve", "ur5e", "--batch", "poses.csv", "--out", "q.npy", *IN_CELL]) == 1
    assert "and table, " in str(np.load("q.npy")["contacts"][1])


def test_poses_line_by_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [json.dumps({"position": [0.52, -0.2, z], "rpy": [0, np.pi / 2, 0]}) for z in (0.3, -0.06)]
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(lines)))
    assert run(["solve", "ur5e", "--jsonl", *IN_CELL]) == 1
    free, blocked = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (free["status"], free["contacts"]) == ("SOLVED", [])
    assert (blocked["status"], blocked["contacts"][0]["b"]) == ("BLOCKED", "table")


@pytest.mark.slow
def test_a_path_says_what_is_in_the_way(capsys: pytest.CaptureFixture[str]) -> None:
    down = [kinseek.pose([0.52, -0.2, z], rpy=[0, np.pi / 2, 0]) for z in np.linspace(0.3, -0.06, 30)]
    np.save("down.npy", np.array(down))
    assert run(["follow", "ur5e", "down.npy", "q.npy", *IN_CELL, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["missed"]
    assert told["status"] == "BLOCKED"
    assert any("are blocked" in why and "table" in why for why in told["why"])
    np.save("down.npy", np.array(down[:20]))
    assert run(["follow", "ur5e", "down.npy", "q.npy", *IN_CELL, "--clearance", "0.005"]) == 0
    q = np.load("q.npy")["q"]
    assert scene().free_motion(q[:-1], q[1:], 0.005).all()


def test_the_arm_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "ur5e", *INSIDE, "--scene", "self", "--capsules", "0.05", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "SOLVED"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--clearance", "0.01"], "add --scene FILE, or --scene self"),
        (["--capsules", "0.05"], "--capsules needs a scene"),
        (["--group", "arm"], "group='arm' names a group of an SRDF; give the SRDF too"),
        (["--scene", "cell.urdf"], "capsules=0.05; on a command line --capsules 0.05"),
        ([*IN_CELL, "--clearance", "-1"], "clearance must be a length of at least 0 m, and at most"),
        (["--scene", "shelf.urdf", "--capsules", "0.05"], "no file 'shelf.urdf'"),
        ([*IN_CELL, "--scene", "cell.urdf"], "cell.urdf: 'table' is a body of the scene already"),
        ([*IN_CELL, "--scene", "part.urdf"], "skips such meshes); on a command line --meshes skip"),
        (
            [*IN_CELL, "--scene", "part.urdf", "--meshes", "skip", "--meshes", "."],
            "no obstacles: left out: link 'part'",
        ),
        ([*IN_CELL, "--meshes", "nowhere"], "meshes: no folder 'nowhere'"),
        ([*IN_CELL, "--srdf", "nothing.srdf"], "no file 'nothing.srdf'"),
        ([*IN_CELL, "--solver", "atlas"], "solver= cannot be combined"),
    ],
)
def test_mistakes_are_one_line(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "ur5e", *ABOVE, *words]) == 2
    said: Any = capsys.readouterr()
    assert told in said.err
    assert said.err.count("\n") == 1
    assert not said.out
