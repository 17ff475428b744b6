"""How hypothesis runs here, and which tests need kernels that are compiled here.

Where kernels run from the library that was built with the package, tests marked `jit` are left out: they call kernels that
the library has as parts of others only, or are about compiling. `KINSEEK_JIT=1 python -m pytest -m jit` runs them.
Those marked `thorough` are left out too: `KINSEEK_THOROUGH=1` runs them, and so does `.ci/all`.

Nothing is timed: the first example of a test may compile a kernel, and a busy machine is no failure. With CI set the
examples are the same in every run; elsewhere they are new ones each time, and a failure prints how to get it again.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Generator, Iterator
from importlib import metadata

import pytest
from hypothesis import HealthCheck, settings
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from command_line import CommandLine

settings.register_profile(
    "kinseek",
    deadline=None,
    print_blob=True,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("kinseek")

collect_ignore = (
    []
    if importlib.util.find_spec("pandas")
    else ["benchmarks/test_field.py", "benchmarks/test_field_page.py"]
)
"""Files of tests that are nothing without what they import."""

LONGEST = "test_javascript.py"
"""Begun first: where two processes test, neither waits for the other at the end, nor for the kernels of the page, which
test_page.py needs too."""


def pytest_configure(config: pytest.Config) -> None:
    """Have all kernels compiled before the processes that test begin: an editable install has some of them only."""
    from kinseek.kernels.backend import LIBRARY

    if LIBRARY is not None and not hasattr(config, "workerinput"):
        LIBRARY.complete()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order tests, and leave out what the library cannot run."""
    from kinseek.kernels.backend import LIBRARY

    items.sort(key=lambda item: item.path.name != LONGEST)
    for item in items:
        if item.get_closest_marker("thorough") and not os.environ.get("KINSEEK_THOROUGH"):
            item.add_marker(pytest.mark.skip(reason="takes long: KINSEEK_THOROUGH=1 runs it"))
        if item.get_closest_marker("jit") and LIBRARY is not None:
            item.add_marker(
                pytest.mark.skip(reason="kernels run from the library: KINSEEK_JIT=1 compiles them")
            )


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call() -> Generator[None, bool | None, bool | None]:
    """Leave out what asks for an extra that is not installed: a test fails for that only where it is."""
    from kinseek.errors import MissingExtra

    try:
        return (yield)
    except MissingExtra as error:
        if not lacking(error.extra):
            raise
        pytest.skip(str(error))


def lacking(extra: str) -> list[str]:
    """Packages of an extra that are not installed."""
    asked = [Requirement(each) for each in metadata.requires("kinseek") or ()]
    names = {each.name for each in asked if each.marker and each.marker.evaluate({"extra": extra})}
    installed = {canonicalize_name(each.name) for each in metadata.distributions()}
    return sorted(name for name in names if canonicalize_name(name) not in installed)


@pytest.fixture
def cli(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> CommandLine:
    """The command line, in this process."""
    monkeypatch.setenv("COLUMNS", "100")
    return CommandLine(capfd)


_settings: dict[str, object] = {}
"""Matplotlib's, as they were restored: restoring them after each of thousands of tests takes seconds."""


@pytest.fixture(autouse=True)
def _no_picture_and_no_style_is_left() -> Iterator[None]:
    """Close figures and restore Matplotlib's settings: experiments draw larger letters than examples."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")
        if dict.__ne__(pyplot.rcParams, _settings):
            pyplot.rcdefaults()
            _settings.update(pyplot.rcParams)
