"""``--scene``: what the arm may hit, from the command line, and what stands in the way in words and as JSON."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import kinseek
from command_line import CommandLine

pytest.importorskip("pinocchio")

CELL = """<robot name="cell">
  <link name="table"><collision><geometry><box size="1 1.6 0.04"/></geometry></collision></link>
  <link name="world"/>
  <joint name="feet" type="fixed"><parent link="world"/><child link="table"/><origin xyz="0.55 0 -0.06"/></joint>
</robot>"""

PART = """<robot name="part">
  <link name="part"><collision><geometry><mesh filename="none.stl"/></geometry></collision></link>
</robot>"""

ABOVE = "solve ur5e --at 0.52 -0.2 0.3 --rpy 0 90 0 --deg"
INSIDE = "solve ur5e --at 0.52 -0.2 -0.06 --rpy 0 90 0 --deg"
IN_CELL = "--scene cell.urdf --capsules 0.05"


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
def test_an_answer_is_free_in_the_scene(cli: CommandLine) -> None:
    told = cli(ABOVE, IN_CELL, "--clearance 0.01 --json").facts
    assert told["status"] == "SOLVED"
    assert told["contacts"] == []
    assert scene().free(told["q"], 0.01)


@pytest.mark.slow
def test_a_group_of_an_srdf(cli: CommandLine) -> None:
    group = '<group name="arm"><chain base_link="base_link" tip_link="wrist_3_link"/></group>'
    pairs = '<disable_collisions link1="shoulder_link" link2="forearm_link"/>'
    Path("arm.srdf").write_text(f'<robot name="ur5e">{group}{pairs}</robot>', encoding="utf-8")
    options = "--srdf arm.srdf --group arm --json"
    told = cli(ABOVE, "--scene self --capsules 0.05", options).facts
    arm = kinseek.load("ur5e", srdf="arm.srdf", group="arm")
    assert kinseek.Scene.of(arm, capsules=0.05).free(told["q"])
    told = cli("fk ur5e 0 0 0 0 0 0", options).facts
    assert (told["base"], told["tip"]) == ("base_link", "wrist_3_link")
    np.testing.assert_allclose(told["matrix"], arm.fk(np.zeros(6)), rtol=0, atol=1e-15)


@pytest.mark.slow
def test_what_is_in_the_way_is_told(cli: CommandLine) -> None:
    told = cli(INSIDE, IN_CELL, code=1).words
    assert str(kinseek.Status.BLOCKED) in told
    assert "with collisions; contacts of the one that collides least: - " in told
    facts = cli(INSIDE, IN_CELL, "--json", code=1).facts
    assert facts["status"] == "BLOCKED"
    assert facts["blocked"] > 0
    contacts = scene().hits(facts["q"])
    assert [(each["a"], each["b"]) for each in facts["contacts"]] == [(each.a, each.b) for each in contacts]
    assert facts["contacts"][0]["depth"] == pytest.approx(contacts[0].depth)
    assert cli(INSIDE, IN_CELL, "--prove --json", code=1).facts["status"] == "PROVED_BLOCKED"


@pytest.mark.slow
def test_all_answers_are_free(cli: CommandLine) -> None:
    every = cli(ABOVE, "--all --json").facts
    assert "blocked" not in every
    facts = cli(ABOVE, IN_CELL, "--all --json").facts
    assert len(facts["branches"]) + facts["blocked"] == len(every["branches"])
    assert facts["blocked"] > 0
    assert all(scene().free(each["q"]) for each in facts["branches"])
    assert "with collisions left out" in cli(ABOVE, IN_CELL, "--all").out
    proved = cli(INSIDE, IN_CELL, "--all --prove", code=1).out
    assert "proved: the arm collides in every solution" in proved


@pytest.mark.slow
def test_a_file_of_poses(cli: CommandLine) -> None:
    Path("poses.csv").write_text(
        "x,y,z,roll,pitch,yaw\n0.52,-0.2,0.3,0,1.5708,0\n0.52,-0.2,-0.06,0,1.5708,0\n", encoding="utf-8"
    )
    cli("solve ur5e --batch poses.csv --out q.csv", IN_CELL, code=1)
    rows = list(csv.DictReader(Path("q.csv").read_text(encoding="utf-8").splitlines()))
    assert [row["status"] for row in rows] == ["SOLVED", "BLOCKED"]
    assert rows[0]["contacts"] == ""
    assert "and table, " in rows[1]["contacts"]
    cli("solve ur5e --batch poses.csv --out q.npy", IN_CELL, code=1)
    assert "and table, " in str(np.load("q.npy")["contacts"][1])


def test_poses_line_by_line(monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> None:
    lines = [json.dumps({"position": [0.52, -0.2, z], "rpy": [0, np.pi / 2, 0]}) for z in (0.3, -0.06)]
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n".join(lines)))
    free, blocked = cli("solve ur5e --jsonl", IN_CELL, code=1).rows
    assert (free["status"], free["contacts"]) == ("SOLVED", [])
    assert (blocked["status"], blocked["contacts"][0]["b"]) == ("BLOCKED", "table")


@pytest.mark.slow
def test_a_path_says_what_is_in_the_way(cli: CommandLine) -> None:
    down = [kinseek.pose([0.52, -0.2, z], rpy=[0, np.pi / 2, 0]) for z in np.linspace(0.3, -0.06, 30)]
    np.save("down.npy", np.array(down))
    told = cli("follow ur5e down.npy q.npy", IN_CELL, "--json", code=1).facts
    assert told["missed"]
    assert told["status"] == "BLOCKED"
    assert any("are blocked" in why and "table" in why for why in told["why"])
    np.save("down.npy", np.array(down[:20]))
    cli("follow ur5e down.npy q.npy", IN_CELL, "--clearance 0.005")
    q = np.load("q.npy")["q"]
    assert scene().free_motion(q[:-1], q[1:], 0.005).all()


def test_the_arm_alone(cli: CommandLine) -> None:
    assert cli(INSIDE, "--scene self --capsules 0.05 --json").facts["status"] == "SOLVED"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("--clearance 0.01", "add --scene FILE, or --scene self"),
        ("--capsules 0.05", "--capsules needs a scene"),
        ("--group arm", "group='arm' names a group of an SRDF; give the SRDF too"),
        ("--scene cell.urdf", "capsules=0.05; on a command line --capsules 0.05"),
        (f"{IN_CELL} --clearance -1", "clearance must be a length of at least 0 m, and at most"),
        ("--scene shelf.urdf --capsules 0.05", "no file 'shelf.urdf'"),
        (f"{IN_CELL} --scene cell.urdf", "cell.urdf: 'table' is a body of the scene already"),
        (f"{IN_CELL} --scene part.urdf", "skips such meshes); on a command line --meshes skip"),
        (f"{IN_CELL} --scene part.urdf --meshes skip --meshes .", "no obstacles: left out: link 'part'"),
        (f"{IN_CELL} --meshes nowhere", "meshes: no folder 'nowhere'"),
        (f"{IN_CELL} --srdf nothing.srdf", "no file 'nothing.srdf'"),
        (f"{IN_CELL} --solver atlas", "solver= cannot be combined"),
    ],
)
def test_mistakes_are_one_line(words: str, told: str, cli: CommandLine) -> None:
    assert told in cli.refused(ABOVE, words)


def test_notes_on_a_scene_are_printed(cli: CommandLine) -> None:
    """A box that lacks a triangle let the arm stand in it, and an obstacle was left out, without a word."""
    box = '<link name="box"><collision><origin xyz="2 2 2"/><geometry><box size="1 1 1"/></geometry></collision></link>'
    joint = '<joint name="j" type="fixed"><parent link="box"/><child link="part"/></joint></robot>'
    Path("part.urdf").write_text(PART.replace("</robot>", box + joint))
    said = cli(ABOVE, IN_CELL, "--scene part.urdf --meshes skip").err
    assert said.startswith("kinseek: note: left out: ")
    assert "none.stl" in said
    assert said.count("\n") == 1
    corners = ["0 0 0", "1 0 0", "0 1 0"]
    Path("none.stl").write_text(
        "solid x\nfacet normal 0 0 1\nouter loop\n"
        + "".join(f"vertex {corner}\n" for corner in corners)
        + "endloop\nendfacet\nendsolid x\n"
    )
    many = "".join(
        f'<link name="l{i}"><collision><origin xyz="2 {i} 2"/><geometry><mesh filename="none.stl"/></geometry></collision>'
        f'</link><joint name="j{i}" type="fixed"><parent link="l0"/><child link="l{i}"/></joint>'
        for i in range(8)
    ).replace('<joint name="j0" type="fixed"><parent link="l0"/><child link="l0"/></joint>', "")
    Path("part.urdf").write_text(f'<robot name="part">{many}</robot>')
    said = cli(ABOVE, IN_CELL, "--scene part.urdf").err
    assert said.count("is an open mesh, a surface") == 5
    assert "kinseek: note: 3 more are in scene.notes of Python\n" in said


def test_a_scene_that_checks_nothing_is_reported(cli: CommandLine) -> None:
    """With capsules of 50 m all links always touch: every pose was solved, free and without a word."""
    goal = "solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg --scene self --capsules"
    assert "no two bodies are checked, and so everything is free" in cli(goal, "50").err
    assert cli(goal, "0.05").err == ""
    with pytest.warns(kinseek.UnitWarning, match="'upper_arm_link' extends 50.425 m"):
        scene = kinseek.Scene.of(kinseek.load("ur5e"), capsules=50.0)
    assert not scene.checks
    assert "no two bodies are checked" in scene.notes[-1]
    scene.add_box("box", (0.1, 0.1, 0.1), kinseek.pose([3.0, 0.0, 0.0]))
    assert scene.checks
