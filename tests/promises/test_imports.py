"""`import kinseek`, a bundled arm and its first answer load NumPy and little else: who starts a script waits for it.

The viewer's package loads no server either.
"""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from kinseek.kernels.backend import LIBRARY

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
    *("xml.sax", "urllib.request", "http.client", "ssl", "tempfile", "numpy.f2py", "numpy.random"),
    *("pinocchio", "coal", "trimesh", "viser"),
    *("kinseek.collision", "kinseek.paths", "kinseek.branches", "kinseek.maps"),
    *("kinseek.kernels.grid", "kinseek.kernels.branches", "kinseek.kernels.collision"),
)

PROGRAM = """
import json, sys
import numpy
before = set(sys.modules)
import kinseek
arm = kinseek.load("ur5e")
pose = numpy.diag([1.0, -1.0, -1.0, 1.0])
pose[:3, 3] = 0.4, 0.2, 0.3
assert arm.ik(pose).success
loaded = set(sys.modules) - before
import kinseek.viewer
print(json.dumps(sorted(loaded | ({"trimesh", "viser"} & set(sys.modules)))))
"""


@pytest.fixture(scope="module")
def loaded() -> set[str]:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


@pytest.mark.slow
@pytest.mark.parametrize("module", HEAVY)
def test_the_first_answer_does_not_load(loaded: set[str], module: str) -> None:
    if LIBRARY is None and not module.startswith("kinseek."):
        pytest.skip("Numba compiles the kernels, and loads what it needs for that")
    assert "kinseek.arm" in loaded
    assert module not in loaded
