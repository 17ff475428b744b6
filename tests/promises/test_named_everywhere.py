"""Each name that a caller may give stands in every place that lists these names: docstrings, pages, help."""

from __future__ import annotations

from collections.abc import Iterable

import click
import numpy as np
import pytest

import kinseek
from kinseek.branches.order import ORDERS
from kinseek.cli.commands import follow, solve
from kinseek.cli.commands import map as map_command
from kinseek.maps.measures import MEASURES
from kinseek.robots.files import ENDINGS as ENDINGS_OF_ROBOTS
from kinseek.tables import branches_table, path_table, solution_table
from kinseek.timing.formats import ENDINGS, LANGUAGES
from kinseek.timing.trajectory import Trajectory
from places import ROOT


def help_of(command: click.Command, option: str) -> str:
    """The help of one option of a command."""
    (found,) = (each for each in command.params if option in each.opts)
    assert isinstance(found, click.Option)
    return str(found.help)


def page(name: str) -> str:
    path = ROOT / "docs" / name
    if not path.is_file():
        pytest.skip("the documentation is not part of what is tested here")
    return path.read_text(encoding="utf-8")


def quoted(names: Iterable[str]) -> list[str]:
    return [f'"{name}"' for name in names]


def missing(names: Iterable[str], text: str | None) -> list[str]:
    return [name for name in names if name not in str(text)]


@pytest.mark.parametrize("call", ["ik", "branches", "track"])
def test_docstrings_name_every_order(call: str) -> None:
    assert missing(quoted(ORDERS), getattr(kinseek.Arm, call).__doc__) == []


@pytest.mark.parametrize("name", ["branches.md", "servoing.md"])
def test_pages_name_every_order(name: str) -> None:
    assert missing((f"| `{each}` |" for each in quoted(ORDERS)), page(name)) == []


def test_the_command_line_names_every_order() -> None:
    assert missing(ORDERS, help_of(solve.command, "--prefer")) == []
    assert missing((f"`{each}`" for each in ORDERS), page("command_line.md")) == []


def test_the_command_line_names_every_column() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk(np.ones(6))
    tables = [
        solution_table(arm.ik(T), in_scene=True),
        branches_table(arm.branches(T)),
        path_table(arm.follow(T[None], prove=True)),
    ]
    for table in tables:
        assert missing((f"`{name}`" for name in table.columns), page("command_line.md")) == []


def test_measures_of_maps_are_named() -> None:
    assert missing(MEASURES, help_of(map_command.command, "--what")) == []
    assert missing((f"| `{each}` |" for each in quoted(MEASURES)), page("maps.md")) == []


def test_files_of_robots_are_named() -> None:
    assert missing(ENDINGS_OF_ROBOTS, solve.command.get_help(click.Context(solve.command))) == []
    assert missing(ENDINGS_OF_ROBOTS, kinseek.load.__doc__) == []
    assert missing(ENDINGS_OF_ROBOTS, page("arms.md")) == []


def test_programs_of_controllers_are_named() -> None:
    assert missing(quoted(LANGUAGES), Trajectory.save.__doc__) == []
    assert missing((f"`{each}`" for each in quoted(LANGUAGES)), page("trajectories.md")) == []


def test_files_of_trajectories_are_named() -> None:
    assert missing(ENDINGS, Trajectory.save.__doc__) == []
    assert missing(ENDINGS, help_of(follow.command, "--out")) == []
    for name in ("trajectories.md", "command_line.md"):
        assert missing((f"`{each}`" for each in ENDINGS), page(name)) == []
