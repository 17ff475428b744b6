"""`import kinseek` loads nothing heavy beyond NumPy and Numba."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ["typer", "rich", "scipy", "mujoco", "lxml", "urdf_parser_py", "matplotlib", "xacrodoc"]

PROGRAM = """
import sys
import numpy, numba
before = set(sys.modules)  # Numba loads the top of SciPy by itself.
import kinseek
print(*sorted({name.partition(".")[0] for name in set(sys.modules) - before}))
"""


@pytest.fixture(scope="module")
def loaded() -> set[str]:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize("package", HEAVY)
def test_import_does_not_load(loaded: set[str], package: str) -> None:
    assert "kinseek" in loaded
    assert package not in loaded
