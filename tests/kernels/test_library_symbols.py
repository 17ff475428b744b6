"""What the library of kernels leaves to others: the stable ABI of Python, libm and libc, and nothing of Numba's runtime."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys

import pytest

from places import ROOT

LIBRARIES = sorted((ROOT / "src" / "kinseek" / "kernels").glob("_prebuilt.*"))
OUTSIDE = runpy.run_path(str(ROOT / "native" / "outside.py"))
BUILD = runpy.run_path(str(ROOT / "native" / "build.py"))

pytestmark = [
    pytest.mark.skipif(not LIBRARIES, reason="no library of kernels is built"),
    pytest.mark.skipif(shutil.which("nm") is None, reason="there is no nm"),
    pytest.mark.skipif(sys.platform == "win32", reason="a DLL has imports, and nm shows none of them"),
]


def symbols(*options: str) -> set[str]:
    """Names that nm shows, without versions, and without the underscore that macOS puts before each."""
    undefined = subprocess.run(
        ["nm", *options, str(LIBRARIES[0])], capture_output=True, text=True, check=True
    )
    names = {line.split()[-1].partition("@")[0] for line in undefined.stdout.splitlines() if line.strip()}
    return {name.removeprefix("_") for name in names} if sys.platform == "darwin" else names


def undefined() -> set[str]:
    """What the dynamic linker has to find elsewhere."""
    return symbols("-u") if sys.platform == "darwin" else symbols("-u", "-D")


def test_nothing_is_left_undefined_but_what_is_listed() -> None:
    assert undefined() - OUTSIDE["ALLOWED"] == set()


def test_nothing_of_the_runtime_of_numba_is_left_undefined() -> None:
    assert {name for name in undefined() if re.match(r"NRT_|numba", name)} == set()


def test_only_the_module_and_kernels_are_visible() -> None:
    visible = symbols("-U") if sys.platform == "darwin" else symbols("--defined-only", "-D")
    assert {name for name in visible if not name.startswith("ks_")} == {"PyInit__prebuilt"}


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="symbols have versions in glibc alone")
def test_every_glibc_since_2_17_has_what_it_asks_for() -> None:
    tag = BUILD["platform_tag"](LIBRARIES[0])
    assert tag == "linux" or re.fullmatch(r"manylinux_2_17_\w+", tag)
