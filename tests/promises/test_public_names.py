"""`__all__` says what is public, and everything public explains itself."""

from __future__ import annotations

import inspect
from importlib.metadata import version
from types import ModuleType

import pytest

import kinseek
from places import ROOT

ROUTINES = [getattr(kinseek, name) for name in kinseek.__all__ if callable(getattr(kinseek, name))]


def test_all_is_the_sorted_public_names() -> None:
    names = vars(kinseek).items()
    public = [name for name, thing in names if not name.startswith("_") and not isinstance(thing, ModuleType)]
    assert kinseek.__all__ == sorted(public)


def test_the_version_is_the_same_wherever_it_is_written() -> None:
    assert version("kinseek") == kinseek.__version__
    cited = ROOT / "CITATION.cff"
    if cited.is_file():  # Not beside an installed wheel.
        assert f"\nversion: {kinseek.__version__}\n" in cited.read_text(encoding="utf-8")


@pytest.mark.parametrize("thing", ROUTINES, ids=lambda thing: thing.__name__)
def test_every_public_class_and_function_has_a_docstring(thing: object) -> None:
    undocumented = [] if inspect.getdoc(thing) else [thing]
    if inspect.isclass(thing) and thing.__module__.startswith("kinseek."):
        undocumented += [
            name
            for name, member in vars(thing).items()
            if not name.startswith("_") and (inspect.isroutine(member) or isinstance(member, property))
            if not inspect.getdoc(member)
        ]
    assert undocumented == []
