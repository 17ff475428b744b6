"""``kinseek solve --jsonl``: an answer a line, at once; bad lines are told and passed."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest

import kinseek
from command_line import CommandLine, Ended
from kinseek.cli.files import MOST_LINE

GOOD: dict[str, Any] = {"position": [0.4, 0.2, 0.3], "rpy": [3.0, 0.1, -0.2]}
POSE = kinseek.pose(GOOD["position"], rpy=GOOD["rpy"])


class Asked(Protocol):
    """Gives lines to ``kinseek solve ur5e --jsonl``."""

    def __call__(self, lines: list[Any], words: str = "", code: int = 0) -> Ended: ...


@pytest.fixture
def ask(monkeypatch: pytest.MonkeyPatch, cli: CommandLine) -> Asked:
    def asked(lines: list[Any], words: str = "", code: int = 0) -> Ended:
        text = "\n".join(line if isinstance(line, str) else json.dumps(line) for line in lines)
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
        return cli("solve ur5e --jsonl", words, code=code)

    return asked


def test_an_answer_a_line(ask: Asked) -> None:
    arm = kinseek.load("ur5e")
    near = [0.3, -1.0, 1.5, 0.1, 1.2, 0.4]
    lines = [
        GOOD,
        {"matrix": POSE.tolist(), "id": "seven"},
        "",
        {**GOOD, "near": near},
        {**GOOD, "near": dict(zip(arm.joint_names[::-1], near[::-1], strict=True))},
        {**GOOD, "position": [4, 0, 0]},
    ]
    ended = ask(lines, code=1)
    assert ended.err == ""
    said = ended.rows
    assert [facts["line"] for facts in said] == [1, 2, 4, 5, 6]
    assert [facts["success"] for facts in said] == [True] * 4 + [False]
    assert said[0]["q"] == arm.ik(POSE).q.tolist()
    assert said[1]["id"] == "seven"
    assert said[2]["q"] == said[3]["q"] == arm.ik(POSE, near=near).q.tolist()
    ask([GOOD], code=0)


def test_degrees_and_positions_alone(ask: Asked) -> None:
    turned = {**GOOD, "rpy": np.rad2deg(GOOD["rpy"]).tolist()}
    arm = kinseek.load("ur5e")
    facts = ask([turned], "--deg").facts
    assert np.allclose(arm.fk(facts["q"]), POSE, atol=5e-6)
    facts = ask([{"position": [0.4, 0.2, 0.3]}], "--position-only").facts
    assert facts["orientation_error"] is None
    assert np.allclose(arm.fk(facts["q"])[:3, 3], [0.4, 0.2, 0.3], atol=2e-6)


def test_every_answer(ask: Asked) -> None:
    facts, expected = ask([GOOD], "--all").facts, kinseek.load("ur5e").branches(POSE)
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
    "flags": ({**GOOD, "position": [True, False, 0.3]}, "position must be numbers, got [true, false, 0.3]"),
    "null": ({"position": [0.4, 0.2, 0.3], "rpy": None}, "rpy must be numbers, got null"),
    "null axis": ({"position": [0, 0, 0], "z_axis": None, "x_axis": [1, 0, 0]}, "z_axis must be numbers"),
    "flag near": ({**GOOD, "near": [0, 0, 0, 0, 0, True]}, "near must be a list of numbers"),
    "a key twice": (
        '{"position": [0.9, 0.2, 0.3], "position": [0.4, 0.2, 0.3], "rpy": [0, 0, 0]}',
        "the key 'position' is there twice",
    ),
    "a key twice among many": (  # Comparing each with each took 37 s.
        "{" + ",".join(f'"k{i}":1' for i in range(40_000)) + ',"k39999":2}',
        "the key 'k39999' is there twice",
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
def test_a_bad_line_is_told_and_the_next_is_read(case: str, ask: Asked) -> None:
    line, wrong = BAD[case]
    ended = ask([GOOD, line, GOOD], code=2)
    assert ended.err == ""
    said = ended.rows
    assert [facts["line"] for facts in said] == [1, 2, 3]
    assert wrong in said[1]["error"]
    assert said[0]["q"] == said[2]["q"]


MAIN = [sys.executable, "-m", "kinseek", "solve", "planar2", "--jsonl", "--position-only"]
LINE = '{"position": [0.3, 0.4, 0]}\n'


@pytest.mark.slow
@pytest.mark.parametrize("letter", [" ", "\0", "1"])
def test_a_long_line_is_an_error_and_the_next_is_read(letter: str, ask: Asked) -> None:
    said = ask([GOOD, letter * (3 * MOST_LINE) + "{}", GOOD], code=2).rows
    assert [facts["line"] for facts in said] == [1, 2, 3]
    assert "at most 1,048,576 bytes" in said[1]["error"]
    assert [facts.get("success") for facts in said] == [True, None, True]


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs a stream without an end")
def test_a_stream_without_an_end_of_line_takes_no_memory() -> None:
    with Path("/dev/zero").open("rb") as zeros:
        code = "import resource as r; r.setrlimit(r.RLIMIT_DATA, (2**30, 2**30)); from kinseek.cli import main; main()"
        words = [sys.executable, "-c", code, "solve", "ur5e", "--jsonl"]
        with subprocess.Popen(words, stdin=zeros, stderr=subprocess.PIPE) as program:
            try:
                with pytest.raises(subprocess.TimeoutExpired):
                    program.wait(6)
            finally:
                program.kill()


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


def test_degrees_are_suspected_in_the_words_of_a_command_line(ask: Asked) -> None:
    (said,) = ask([GOOD, {**GOOD, "rpy": [180, 0, 0]}]).err.splitlines()
    assert said.startswith("kinseek: warning: line 2: rpy has an angle of 180 rad")
    assert said.endswith("add --deg")
