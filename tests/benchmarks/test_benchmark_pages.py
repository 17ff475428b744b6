"""The writer that every page of the benchmarks comes from, and the loop that every peer is asked in."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.command import ROOT
from benchmarks.page import Page
from benchmarks.peers import worker
from benchmarks.peers.environments import ask
from benchmarks.since import MANY, Side, measure
from benchmarks.speed_table import table
from kinseek.robots.catalog import catalog_path


def test_a_page_reads_as_it_was_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = Page("Title", "benchmarks.some", 2.4, "Peers: none.")
    page.say("One line,", "and another.")
    page.head("Part")
    page.table("arm | >µs |", [("panda", 5.5, "met"), ("ur5e", 6, "")])
    page.items(["first", "second"])
    page.items([])
    page.items([], "Nothing.")
    page.write(tmp_path / "page.md")
    title, machine, *rest = (tmp_path / "page.md").read_text(encoding="utf-8").split("\n\n")
    assert title == "# Title"
    assert machine.startswith("Made by `python -m benchmarks.some` in 2 minutes. ")
    assert machine.splitlines()[1] == "Peers: none."
    assert machine.splitlines()[2].startswith("Load of the machine")
    assert rest == [
        "One line,\nand another.",
        "## Part",
        "| arm | µs |  |\n|---|--:|---|\n| panda | 5.5 | met |\n| ur5e | 6 |  |",
        "- first\n- second",
        "None.",
        "Nothing.\n",
    ]
    assert str(tmp_path / "page.md") in capsys.readouterr().out


def test_the_table_of_peers_is_what_the_speed_table_reads() -> None:
    page = Page("Against peers", "benchmarks.peers")
    columns = "arm | who | >median µs | >mean µs | >p99 µs | >strict % random | >strict % near singular | >faster by"
    ours = ("panda", "**kinseek**", "6.5", "7.3", "14.3", "100.0", "99.0", "")
    page.table(columns, [ours, ("panda", "EAIK", *"–" * 5, "six joints only")])
    assert "| kinseek | 6.5 | 99.0 – 99.0 % |" in table(page.text)


def test_answers_are_written_in_order_and_only_the_peer_is_timed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    targets = np.tile(np.eye(4), (5, 1, 1))
    targets[:, 0, 3] = np.arange(5)
    np.savez(tmp_path / "arm.npz", targets=targets, lower=np.zeros(2), upper=np.ones(2))
    asked = []

    def make(arm: Any) -> Any:
        def solve(T: Any) -> Any:
            asked.append(T[0, 3])
            return None if T[0, 3] == 3 else np.array([T[0, 3], -1.0])

        return solve

    monkeypatch.setattr(worker, "limit_memory", lambda gigabytes: None)
    monkeypatch.setattr(worker, "version", lambda name: "1.0")
    monkeypatch.setattr(
        sys, "argv", ["worker.py", "EAIK", str(tmp_path / "arm.npz"), str(tmp_path / "answers.npz")]
    )
    worker.work("help", {"EAIK": make}, 2, lambda q: (q, 0 if q is None else 2))
    assert asked == [0, 1, 0, 1, 2, 3, 4]
    with np.load(tmp_path / "answers.npz") as found:
        np.testing.assert_array_equal(found["q"][:, 0], [0, 1, 2, np.nan, 4])
        np.testing.assert_array_equal(found["said"], [2, 2, 2, 0, 2])
        assert (found["times"] > 0).all()
        assert str(found["version"]) == "1.0"


@pytest.mark.slow
def test_a_peer_that_fails_says_why(tmp_path: Path) -> None:
    pytest.importorskip("eaik")
    np.savez(tmp_path / "arm.npz", lower=np.zeros(7))
    assert ask("worker.py", "EAIK", Path(sys.executable), tmp_path / "arm.npz", 60) == "six joints only"
    assert str(ask("worker.py", "OptIK", Path(sys.executable), tmp_path / "arm.npz", 60)).startswith(
        "ModuleNotFound"
    )


@pytest.mark.slow
def test_both_sides_of_a_comparison_answer_all() -> None:
    row = measure("elbow6", (ROOT / "src", ROOT / "src"), 2, 3)
    assert row.solved == (2 * MANY, 2 * MANY)
    assert min(value for each in row.times.values() for value in each) > 0.0


@pytest.mark.slow
def test_a_side_that_is_not_what_was_asked_for_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "targets.npy", np.eye(4)[None])
    words = [str(catalog_path("planar2")), "base", "tip", str(tmp_path / "targets.npy")]
    with pytest.raises(SystemExit, match="asked for the kinseek of"):
        Side(tmp_path, words, tmp_path / "q.npy")
    with pytest.raises(SystemExit, match="a process has ended"):
        Side(ROOT / "src", ["nowhere.urdf", "a", "b", "none.npy"], tmp_path / "q.npy")
