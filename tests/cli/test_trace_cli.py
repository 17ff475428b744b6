"""``kinseek solve --trace`` prints what the search did before what it found."""

from __future__ import annotations

import json

import pytest

import kinseek
from kinseek.cli.program import run

WORDS = ["solve", "planar2", "--at", "-0.55", "0.4", "0", "--position-only"]
SEARCH = ["--solver", "divide-and-conquer", "--breadth", "2"]


def test_the_trace_is_printed_before_the_answer(capsys: pytest.CaptureFixture[str]) -> None:
    run([*WORDS, *SEARCH])
    plain = capsys.readouterr().out
    run([*WORDS, *SEARCH, "--trace"])
    traced = capsys.readouterr().out
    arm = kinseek.load("planar2")
    goal = kinseek.Goal.position([-0.55, 0.4, 0.0])
    trace = arm.ik(goal, solver=kinseek.DivideAndConquer(breadth=2), trace=True).trace
    assert traced.startswith(f"{trace}\n")
    # What follows is what is printed without it, but for the time.
    assert traced.removeprefix(f"{trace}\n").rpartition(",")[0] == plain.rpartition(",")[0]


def test_json_has_the_trace_if_it_was_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    run([*WORDS, *SEARCH, "--json"])
    assert "trace" not in json.loads(capsys.readouterr().out)
    run([*WORDS, *SEARCH, "--json", "--trace"])
    facts = json.loads(capsys.readouterr().out)
    passes = facts["trace"]["passes"]
    assert sum(each["evaluations"] for each in passes) == facts["evaluations"]
    assert passes[-1]["q"] == [joint["value"] for joint in facts["joints"]]


def test_the_default_search_has_one_too(capsys: pytest.CaptureFixture[str]) -> None:
    run([*WORDS, "--trace"])
    out = capsys.readouterr().out
    assert out.startswith("Atlas\n")
    assert "look-up" in out
