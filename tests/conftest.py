"""How hypothesis runs here, and which tests need kernels that are compiled here.

Where kernels run from the library that was built with the package, tests marked `jit` are left out: they call kernels that
the library has as parts of others only, or are about compiling. `KINSEEK_JIT=1 python -m pytest -m jit` runs them.

Nothing is timed: the first example of a test may compile a kernel, and a busy machine is no failure. With CI set the
examples are the same in every run; elsewhere they are new ones each time, and a failure prints how to get it again.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "kinseek",
    deadline=None,
    print_blob=True,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("kinseek")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Leave out what the library cannot run."""
    from kinseek.kernels.route import LIBRARY

    if LIBRARY is None:
        return
    for item in items:
        if item.get_closest_marker("jit"):
            item.add_marker(
                pytest.mark.skip(reason="kernels run from the library: KINSEEK_JIT=1 compiles them")
            )


@pytest.fixture(autouse=True)
def _no_picture_stays_open() -> Iterator[None]:
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")
