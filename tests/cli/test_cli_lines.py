"""``kinseek solve --jsonl``: an answer a line, at once; bad lines are told and passed."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.cli.program import run

GOOD: dict[str, Any] = {"position": [0.4, 0.2, 0.3], "rpy": [3.0, 0.1, -0.2]}


def ask(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], lines: list[Any], *words: str
) -> tuple[int, list[dict[str, Any]]]:
    text = "\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    code = run(["solve", "ur5e", "--jsonl", *words])
    heard = capsys.readouterr()
    assert heard.err == ""
    return code, [json.loads(line) for line in heard.out.splitlines()]


def test_an_answer_a_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    arm = kinseek.load("ur5e")
    pose = kinseek.pose(GOOD["position"], rpy=GOOD["rpy"])
    near = [0.3, -1.0, 1.5, 0.1, 1.2, 0.4]
    lines = [
        GOOD,
        {"matrix": pose.tolist(), "id": "seven"},
        "",
        {**GOOD, "near": near},
        {**GOOD, "near": dict(zip(arm.joint_names[::-1], near[::-1], strict=True))},
        {**GOOD, "position": [4, 0, 0]},
    ]
    code, said = ask(monkeypatch, capsys, lines)
    assert code == 1
    assert [facts["line"] for facts in said] == [1, 2, 4, 5, 6]
    assert [facts["success"] for facts in said] == [True] * 4 + [False]
    assert said[0]["q"] == arm.ik(pose).q.tolist()
    assert said[1]["id"] == "seven"
    assert said[2]["q"] == said[3]["q"] == arm.ik(pose, near=near).q.tolist()
    assert ask(monkeypatch, capsys, [GOOD])[0] == 0


def test_degrees_and_positions_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    turned = {**GOOD, "rpy": np.rad2deg(GOOD["rpy"]).tolist()}
    arm = kinseek.load("ur5e")
    _, (facts,) = ask(monkeypatch, capsys, [turned], "--deg")
    assert np.allclose(arm.fk(facts["q"]), kinseek.pose(GOOD["position"], rpy=GOOD["rpy"]), atol=5e-6)
    _, (facts,) = ask(monkeypatch, capsys, [{"position": [0.4, 0.2, 0.3]}], "--position-only")
    assert facts["orientation_error"] is None
    assert np.allclose(arm.fk(facts["q"])[:3, 3], [0.4, 0.2, 0.3], atol=2e-6)


def test_every_answer(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    _, (facts,) = ask(monkeypatch, capsys, [GOOD], "--all")
    expected = kinseek.load("ur5e").branches(kinseek.pose(GOOD["position"], rpy=GOOD["rpy"]))
    assert np.array_equal([each["q"] for each in facts["branches"]], expected.q)


BAD = {
    "no JSON": ('{"position": [0.4, 0.2', "not JSON: Expecting"),
    "a list": ("[1, 2, 3]", "a line must be an object"),
    "rows of different lengths": (
        '{"position": [[1, [2, 3]], 0.4, 0.3], "rpy": [0, 0, 0]}',
        "a pose must be a (..., 4, 4) array",
    ),
    "nested deeply": (
        '{"position": [' + "[" * 70 + "1" + "]" * 70 + ', 0.4, 0.3], "rpy": [0, 0, 0]}',
        "a pose must be a (..., 4, 4) array",
    ),
    "nested": ("[" * 100_000, "not JSON"),
    "unknown key": ({**GOOD, "quat": [1, 0, 0, 0]}, "unknown key 'quat'; did you mean 'quat_"),
    "no position": ({"rpy": [0, 0, 0]}, "needs the key position"),
    "no rotation": ({"position": [0, 0, 0]}, "exactly one of rpy"),
    "two rotations": ({**GOOD, "rotvec": [0, 0, 0]}, "got rpy and rotvec"),
    "matrix too": ({**GOOD, "matrix": np.eye(4).tolist()}, "cannot be combined with rpy or position"),
    "NaN": ('{"position": [NaN, 0, 0], "rpy": [0, 0, 0]}', "NaN"),
    "two numbers": ({**GOOD, "position": [0.4, 0.2]}, "shape (3,)"),
    "many": ({**GOOD, "position": [[0.4, 0.2, 0.3]] * 2}, "must be one pose"),
    "products": (
        {"position": [[[0.4, 0.2, 0.3]]] * 6000, "quat_wxyz": [[[1, 0, 0, 0]] * 6000]},
        "position must be one pose, got several rows for it and for quat_wxyz",
    ),
    "NaN as id": (
        '{"position": [0.4, 0.2, 0.3], "rpy": [0, 0, 0], "id": NaN}',
        "numbers must be finite, got NaN",
    ),
    "infinity within id": (
        '{"position": [0.4, 0.2, 0.3], "rpy": [0, 0, 0], "id": [{"a": -Infinity}]}',
        "must be finite, got -Infinity",
    ),
    "too large as id": (
        '{"position": [0.4, 0.2, 0.3], "rpy": [0, 0, 0], "id": 1e999}',
        "must be finite, got 1e999",
    ),
    "words": ({**GOOD, "position": ["a", "b", "c"]}, "must be numbers"),
    "long number": ({**GOOD, "rpy": [0, 0, 10**400]}, "too large"),
    "no turn": ({"position": [0, 0, 0], "quat_wxyz": [0, 0, 0, 0]}, "zero quaternion"),
    "near": ({**GOOD, "near": [1, 2]}, "near needs 6 numbers, got 2"),
    "near words": ({**GOOD, "near": "here"}, "near must be a list of numbers"),
    "near nothing": ({**GOOD, "near": None}, "near must be a list of numbers"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", BAD)
def test_a_bad_line_is_told_and_the_next_is_read(
    case: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line, wrong = BAD[case]
    code, said = ask(monkeypatch, capsys, [GOOD, line, GOOD])
    assert code == 2
    assert [facts["line"] for facts in said] == [1, 2, 3]
    assert wrong in said[1]["error"]
    assert said[0]["q"] == said[2]["q"]


MAIN = [sys.executable, "-m", "kinseek", "solve", "planar2", "--jsonl", "--position-only"]
LINE = '{"position": [0.3, 0.4, 0]}\n'


@pytest.mark.slow
def test_an_answer_comes_before_the_next_question() -> None:
    with subprocess.Popen(
        MAIN, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for number in (1, 2, 3):
            process.stdin.write(LINE)
            process.stdin.flush()
            assert json.loads(process.stdout.readline())["line"] == number
        process.stdin.close()
        assert process.wait() == 0


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="other pipes")
def test_a_reader_that_goes_ends_it_quietly() -> None:
    with subprocess.Popen(
        MAIN, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(LINE)
        process.stdin.flush()
        process.stdout.readline()
        process.stdout.close()
        process.stdin.write(LINE * 3)
        process.stdin.flush()
        assert process.wait() == 141
        assert [line for line in process.stderr if "compiling kernels" not in line] == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no such device here")
def test_a_full_disk_is_one_line() -> None:
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            MAIN, input=LINE * 3, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=os.environ
        )
    said = [line for line in done.stderr.splitlines() if "compiling kernels" not in line]
    assert (done.returncode, len(said)) == (2, 1)
    assert said[0].startswith("kinseek: cannot write the output: ")


def test_degrees_are_suspected_in_the_words_of_a_command_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [GOOD, {**GOOD, "rpy": [180, 0, 0]}]
    monkeypatch.setattr(
        sys, "stdin", io.TextIOWrapper(io.BytesIO("\n".join(map(json.dumps, lines)).encode()))
    )
    assert run(["solve", "ur5e", "--jsonl"]) == 0
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith("kinseek: warning: line 2: rpy has an angle of 180 rad")
    assert said.endswith("add --deg")
