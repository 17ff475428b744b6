"""`import kinseek`, an arm and its first answer load NumPy and little else: who starts a script waits for it.

The viewer's package loads no server either.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from kinseek.kernels.backend import LIBRARY
from kinseek.robots.catalog import catalog_path

HEAVY = (
    *(
        "typer",
        "rich",
        "scipy",
        "mujoco",
        "lxml",
        "urdf_parser_py",
        "matplotlib",
        "xacrodoc",
        "numba",
        "pandas",
    ),
    *("xml.sax", "urllib.parse", "urllib.request", "http.client", "ssl", "tempfile", "hashlib", "html"),
    *("numpy.f2py", "numpy.ma", "numpy.random"),
    *("pinocchio", "coal", "trimesh", "viser"),
    *("kinseek.collision", "kinseek.paths", "kinseek.branches", "kinseek.maps"),
    *("kinseek.kernels.grid", "kinseek.kernels.branches", "kinseek.kernels.collision"),
    *("kinseek.kernels.ranges", "kinseek.robots.mjcf", "kinseek.robots.xacro"),
)

PROGRAM = """
import json, sys
import numpy
before = set(sys.modules)
import kinseek
arm = kinseek.load(sys.argv[1])
pose = numpy.diag([1.0, -1.0, -1.0, 1.0])
pose[:3, 3] = 0.4, 0.2, 0.3
assert arm.ik(pose).success and arm.fk(arm.lower).any()
loaded = set(sys.modules) - before
import kinseek.viewer
print(json.dumps(sorted(loaded | ({"trimesh", "viser"} & set(sys.modules)))))
"""


@pytest.fixture(scope="module", params=["ur5e", str(catalog_path("ur5e"))], ids=["bundled", "file"])
def loaded(request: pytest.FixtureRequest) -> set[str]:
    program = [sys.executable, "-c", PROGRAM, request.param]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    found = set(json.loads(done.stdout))
    # A file is read by lxml, and is not that of a bundled arm.
    return found - {"lxml"} if request.param.endswith(".urdf") else found


@pytest.mark.slow
@pytest.mark.parametrize("module", HEAVY)
def test_the_first_answer_does_not_load(loaded: set[str], module: str) -> None:
    if LIBRARY is None and not module.startswith("kinseek."):
        pytest.skip("Numba compiles the kernels, and loads what it needs for that")
    assert "kinseek.arm" in loaded
    assert module not in loaded
