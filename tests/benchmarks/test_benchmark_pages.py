"""The writer of every page of the benchmarks, and the processes that every peer runs in."""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from benchmarks import pages
from benchmarks.command import ROOT
from benchmarks.page import Page, Part, in_parts
from benchmarks.since import MANY, measure, side
from benchmarks.workers import process
from benchmarks.workers.process import Gone, Raised, Worker
from kinseek.kernels.sources import PACKAGE


def test_every_page_is_listed_with_kernels_that_exist() -> None:
    here = ROOT / "benchmarks"
    found = {str(path.relative_to(here)) for path in here.rglob("*.md")} - {"README.md"}
    assert found == set(pages.PAGES)
    rooms = {path.name for path in (PACKAGE / "kernels").iterdir() if path.is_dir()}
    assert {room for made in pages.PAGES.values() for room in made.rooms} <= rooms


def test_a_page_is_older_when_a_kernel_has_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "HERE", tmp_path)
    assert pages.state("planning.md") == "missing"
    Page("Planning", "benchmarks.planning", None).write(tmp_path / "planning.md")
    assert pages.state("planning.md") == "current"
    Page("Planning", "benchmarks.since 1a2b3c4", None).write(tmp_path / "planning.md")
    assert pages.state("planning.md") == "older than its kernels"
    Page("Planning", "benchmarks.planning", None).write(tmp_path / "planning.md")
    monkeypatch.setattr(pages, "module_digest", lambda module: "changed" + module)
    assert pages.state("planning.md") == "older than its kernels"
    (tmp_path / "planning.md").write_text("# Planning\n", encoding="utf-8")
    assert pages.state("planning.md").startswith("unknown")


def test_a_page_reads_as_it_was_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = Page("Title", "benchmarks.some", "What is measured.\n\n    python -m benchmarks.some\n")
    page.note = "Peers: none."
    page.say("One line,", "and another.")
    page.head("Part")
    page.table("arm | >µs |", [("panda", 5.5, "met"), ("ur5e", 6, "")])
    page.items(["first", "second"])
    page.items([])
    page.items([], "Nothing.")
    page.write(tmp_path / "page.md")
    title, machine, *rest = (tmp_path / "page.md").read_text(encoding="utf-8").split("\n\n")
    assert title == "# Title"
    assert machine.startswith("Made by `python -m benchmarks.some`. ")
    assert machine.splitlines()[1] == "Peers: none."
    assert machine.splitlines()[2].startswith("Load of the machine")
    assert rest == [
        "What is measured.",
        "One line,\nand another.",
        "## Part",
        "| arm | µs |  |\n|---|--:|---|\n| panda | 5.5 | met |\n| ur5e | 6 |  |",
        "- first\n- second",
        "None.",
        "Nothing.\n",
    ]
    assert str(tmp_path / "page.md") in capsys.readouterr().out


def test_a_worker_answers_raises_and_says_how_it_ended(tmp_path: Path) -> None:
    module = tmp_path / "some_worker.py"
    module.write_text(WORKER, encoding="utf-8")
    worker = Worker(Path(sys.executable), "some_worker", tmp_path / "log.txt", source=tmp_path)
    q = np.array([[0.1, np.nan], [np.pi, -1e-300]])
    np.testing.assert_array_equal(worker.ask("same", 60, q=q), q)
    with pytest.raises(Raised, match=r"^no such arm$"):
        worker.ask("refuse", 60)
    with pytest.raises(Raised, match=r"^ZeroDivisionError: "):
        worker.ask("fail", 60)
    assert worker.ask("same", 60, q=[1.0]) == [1.0], "it goes on, and what it prints is no reply"
    with pytest.raises(Gone, match=r"^ends with 3: the reason$"):
        worker.ask("end", 60)
    worker.close()
    worker = Worker(Path(sys.executable), "some_worker", tmp_path / "log.txt", source=tmp_path)
    worker.ask("same", 60, q=[])
    with pytest.raises(Gone, match=r"^hangs: nothing for 1 s$"):
        worker.ask("hang", 1)
    worker.close()


WORKER = """
import os, sys, time
from benchmarks.workers.serve import Refused

def same(q):
    print("something about nothing")
    return q

def refuse():
    raise Refused("no such arm")

def fail():
    return 1 / 0

def end():
    print("the reason", file=sys.stderr, flush=True)
    os._exit(3)

def hang():
    time.sleep(600)
"""


@pytest.mark.slow
def test_a_peer_that_fails_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("eaik")
    monkeypatch.setattr(process, "environment", lambda requirements: Path(sys.executable))
    nothing = np.zeros((1, 50, 4, 4))
    asked: dict[str, Any] = {
        "arm": "panda",
        "paths": nothing,
        "starts": np.zeros((1, 1, 7)),
        "free": False,
        "seconds": 1.0,
    }
    motion = "eaik", "benchmarks.workers.motion", "follow", 60
    seven = "seven joints only with one of them locked"
    assert process.called(*motion, **asked, peer="EAIK, ladder") == seven
    assert process.called(*motion, **asked, peer="Descartes").startswith("ModuleNotFound")
    monkeypatch.setattr(process, "environment", lambda requirements: "could not be installed")
    assert process.called(*motion, **asked, peer="Descartes") == "could not be installed"


@pytest.mark.slow
def test_both_sides_of_a_comparison_answer_all() -> None:
    times, solved = measure("elbow6", (ROOT / "src", ROOT / "src"), 2, 3)
    assert solved == (2 * MANY, 2 * MANY)
    assert times.min() > 0.0


@pytest.mark.slow
def test_a_side_that_is_not_what_was_asked_for_is_refused(tmp_path: Path) -> None:
    targets = kinseek.load("planar2").fk(np.zeros((1, 2)))
    with pytest.raises(SystemExit, match="asked for the kinseek of"):
        side(tmp_path, "planar2", targets, tmp_path / "log.txt")
    (tmp_path / "kinseek.py").write_text("raise ImportError('too old')", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"the kinseek of .*: ends with 1: ImportError: too old"):
        side(tmp_path, "planar2", targets, tmp_path / "log.txt")


def test_a_part_is_measured_while_others_are_missing_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("benchmarks.page.KEPT", tmp_path)
    measured: list[str] = []

    def part(name: str) -> Part:
        def measure(page: Page, options: Namespace) -> None:
            measured.append(name)
            page.say(f"The part {name}.")

        return measure

    def make(*only: str) -> None:
        options = Namespace(only=only, quick=False, output=tmp_path / "page.md")
        in_parts("Title", "benchmarks.some", None, {name: part(name) for name in ("one", "two")}, options)

    make("two")
    assert measured == ["two"]
    assert "no page yet: one missing" in capsys.readouterr().out
    make()
    assert measured == ["two", "one"], "what is there is kept"
    assert (tmp_path / "page.md").read_text(encoding="utf-8").endswith("The part one.\n\nThe part two.\n")
    make("one")
    assert measured == ["two", "one", "one"]
