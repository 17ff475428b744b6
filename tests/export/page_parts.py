"""What tests of the page share: the build script, and what has to be installed for it."""

from __future__ import annotations

import runpy
import shutil
from importlib.util import find_spec
from typing import Any

import pytest

from places import ROOT

WEB = ROOT / "web"


def build_script() -> dict[str, Any]:
    """The names of web/build.py; the test is skipped where something it needs is missing."""
    if not (WEB / "build.py").is_file():
        pytest.skip("the page's sources are not here")
    if missing := [name for name in ("numba", "ziglang") if find_spec(name) is None]:
        pytest.skip(f"{' and '.join(missing)} not installed")
    if shutil.which("node") is None:
        pytest.skip("no Node here")
    return runpy.run_path(str(WEB / "build.py"))
