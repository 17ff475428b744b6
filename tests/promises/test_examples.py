"""Every example runs; the README has its two commands."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

from kinseek.cli.words import is_number
from legible import faults_of_saved
from places import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("[0-9]*.py"))


def blocks(page: Path, language: str) -> list[str]:
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)\n```$", text, re.MULTILINE | re.DOTALL)


@pytest.fixture(name="illegible")
def _illegible(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    return faults_of_saved(monkeypatch, write=True)


@pytest.mark.slow
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(
    example: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    illegible: list[str],
) -> None:
    monkeypatch.setattr(sys, "argv", [str(example)])
    monkeypatch.chdir(tmp_path)  # Where its picture goes, if it draws one.
    runpy.run_path(str(example), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) > 5
    drawn = [path.name for path in tmp_path.iterdir()]
    assert drawn == ([f"{example.stem}.png"] if "[PICTURE" in example.read_text(encoding="utf-8") else [])
    assert illegible == []


@pytest.mark.parametrize("example", EXAMPLES[2:], ids=lambda path: path.stem)
def test_an_example_has_its_picture_in_the_documentation(example: Path) -> None:
    picture = ROOT / "docs" / "pictures" / f"{example.stem}.png"
    assert "[PICTURE]" not in example.read_text(encoding="utf-8") or picture.stat().st_size < 150_000


def test_examples_are_found() -> None:
    assert [path.name[:2] for path in EXAMPLES[:2]] == ["01", "02"]


def test_ten_lines_of_python() -> None:
    assert len(blocks(ROOT / "README.md", "python")[0].splitlines()) <= 10


def test_the_two_commands() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text.split("\n## Two commands\n")[1].split("\n## ")[0]
    commands = re.findall(r"^```sh\n(.*?)\n```$", section, re.MULTILINE | re.DOTALL)
    assert len(commands) == 2 == section.count("```") / 2
    assert all("\n" not in command and "python3 -m venv .venv" in command for command in commands)


def test_the_pose_of_the_first_command_is_reached(capsys: pytest.CaptureFixture[str]) -> None:
    from kinseek.cli import main

    words = blocks(ROOT / "README.md", "sh")[0].partition("bin/kinseek ")[2].split()
    assert words[:2] == ["solve", "panda"]
    assert any(is_number(word) for word in words)
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
