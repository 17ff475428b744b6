"""Nothing is imported before it is asked for that the first answer does not need."""

from __future__ import annotations

import subprocess
import sys

import pytest

import kinseek
from kinseek import solvers


def test_rooms_are_there_without_a_second_import() -> None:
    asked = "import kinseek; print(kinseek.collision.Sphere.__name__, kinseek.branches.__name__, kinseek.paths.__name__)"
    told = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["Sphere", "kinseek.branches", "kinseek.paths"]


@pytest.mark.parametrize("package", [kinseek, solvers])
def test_every_name_of_the_door_is_there(package: object) -> None:
    names = package.__all__  # type: ignore[attr-defined]
    assert set(names) <= set(dir(package))
    assert all(getattr(package, name).__name__ == name for name in names if name != "ALL_SOLVERS")


@pytest.mark.parametrize("package", [kinseek, solvers])
def test_a_name_that_is_not_there_is_refused_by_name(package: object) -> None:
    with pytest.raises(AttributeError, match=r"'kinseek.*' has no attribute 'Sceen'"):
        package.Sceen  # type: ignore[attr-defined]  # noqa: B018


def test_every_search_is_in_the_list_of_all() -> None:
    names = {name for name in solvers.__all__ if isinstance(getattr(solvers, name), type)}
    assert {search.__name__ for search in solvers.ALL_SOLVERS} == names - {"Solver"}
