"""``kinseek solve --trace`` prints what the search did before what it found."""

from __future__ import annotations

import kinseek
from command_line import CommandLine

WORDS = "solve planar2 --at -0.55 0.4 0 --position-only"
SEARCH = f"{WORDS} --solver divide-and-conquer --breadth 2"


def test_the_trace_is_printed_before_the_answer(cli: CommandLine) -> None:
    plain, traced = cli(SEARCH, code=1).out, cli(SEARCH, "--trace", code=1).out
    goal = kinseek.Goal.position([-0.55, 0.4, 0.0])
    search = kinseek.DivideAndConquer(breadth=2)
    trace = kinseek.load("planar2").ik(goal, solver=search, trace=True).trace
    assert traced.startswith(f"{trace}\n")
    # What follows is what is printed without it, but for the time.
    assert traced.removeprefix(f"{trace}\n").rpartition(",")[0] == plain.rpartition(",")[0]


def test_json_has_the_trace_if_it_was_asked_for(cli: CommandLine) -> None:
    assert "trace" not in cli(SEARCH, "--json", code=1).facts
    facts = cli(SEARCH, "--json --trace", code=1).facts
    passes = facts["trace"]["passes"]
    assert sum(each["evaluations"] for each in passes) == facts["evaluations"]
    assert passes[-1]["q"] == [joint["value"] for joint in facts["joints"]]


def test_the_default_search_has_one_too(cli: CommandLine) -> None:
    out = cli(WORDS, "--trace").out
    assert out.startswith("Atlas\n")
    assert "look-up" in out
