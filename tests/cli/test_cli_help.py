"""``--help``: as wide as the terminal, with examples that run."""

from __future__ import annotations

import io
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import click
import pytest

import kinseek
from command_line import CommandLine
from kinseek.cli import program
from kinseek.cli.help import Command
from robot_files import link, robot

CONTEXT = click.Context(program.PROGRAM, info_name="kinseek")


def command(name: str) -> Command:
    found = program.PROGRAM.get_command(CONTEXT, name)
    assert isinstance(found, Command)
    return found


def help_of(name: str) -> str:
    return command(name).get_help(click.Context(command(name), parent=CONTEXT, info_name=name))


def examples() -> list[str]:
    return [example for name in program.COMMANDS for example in command(name).examples]


@pytest.mark.parametrize("name", program.COMMANDS)
def test_every_command_has_an_example_of_itself(name: str) -> None:
    assert command(name).examples
    assert all(example.startswith(f"kinseek {name}") for example in command(name).examples)


@pytest.mark.slow
@pytest.mark.parametrize("example", examples())
def test_examples_run(
    example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("poses.csv").write_text(
        "x,y,z,roll,pitch,yaw\n0.4,0.2,0.3,3.1,0,0\n0.4,0.21,0.3,3.1,0,0\n", encoding="utf-8"
    )
    if "--scene" in example:
        pytest.importorskip("pinocchio")
        box = '<collision><origin xyz="0.9 0 0"/><geometry><box size="0.1 1 1"/></geometry></collision>'
        Path("cell.urdf").write_text(robot(link("wall", box), links=""), encoding="utf-8")
    if example.startswith("kinseek map"):
        pytest.importorskip("xarray")
    lines = '{"position": [0.4, 0.2, 0.3], "rpy": [3.1, 0, 0]}\n'
    if example.endswith(" < poses.jsonl"):
        monkeypatch.setattr(sys, "stdin", io.StringIO(lines))
        example = example.removesuffix(" < poses.jsonl")
    if example.startswith("kinseek view"):
        monkeypatch.setitem(sys.modules, "kinseek.viewer", types.SimpleNamespace(show=lambda *_, **__: None))
    words = example.removeprefix("kinseek ")
    if words.startswith("export"):  # Compiling takes half a minute; tests/export/test_export.py does it.

        def reached(*_: Any, **__: Any) -> None:
            raise kinseek.InvalidExport("as far as this")

        monkeypatch.setattr("kinseek.cli.commands.export.prepare", reached)
        assert cli.refused(words) == "kinseek: as far as this\n"
        return
    cli(words)


@pytest.mark.parametrize("columns", [40, 60, 80, 200])
def test_help_fits_and_loses_no_word(columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    words = {}
    for width in (10_000, columns):
        monkeypatch.setenv("COLUMNS", str(width))
        said = {name: help_of(name) for name in program.COMMANDS}
        said["all"] = program.PROGRAM.get_help(CONTEXT)
        words[width] = {name: [word for word in text.split() if word != "\\"] for name, text in said.items()}
        if width == columns:
            assert max(len(line) for text in said.values() for line in text.splitlines()) <= columns
    assert words[columns] == words[10_000]


def test_options_stand_in_groups() -> None:
    said = help_of("solve")
    titles = [line for line in said.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert titles[:3] == ["Arguments:", "The goal:", "The arm:"]
    assert "Options of --solver blind-search:" in titles


LIGHT = """
import sys
import types
from kinseek.cli.program import run
assert run(sys.argv[1:]) == 0
print(*sorted({name.partition(".")[0] for name in sys.modules}), *(n for n in sys.modules if n.startswith("kinseek.cli")))
"""


@pytest.mark.slow
def test_a_command_loads_no_more_than_it_needs() -> None:
    words = ("solve", "ur5e", "--at", "0.4 0.2 0.3", "--rpy", "3.14 0 0")
    done = subprocess.run([sys.executable, "-c", LIGHT, *words], capture_output=True, text=True, check=True)
    loaded = done.stdout.splitlines()[-1].split()
    assert {"click", "numpy", "kinseek.cli.commands.solve"} <= set(loaded)
    heavy = {"rich", "scipy", "numba", "lxml", "urdf_parser_py", "pydantic", "typer", "pandas", "pyarrow"}
    assert heavy & set(loaded) == set()
    assert [name for name in loaded if name.startswith("kinseek.cli.commands.")] == [
        "kinseek.cli.commands.solve"
    ]
