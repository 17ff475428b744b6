"""A user's first seconds: import, the first solution of a process, and a first run that compiles.

Each figure is that of new processes with a cache folder of their own. Kernels run from the library that was built with the
package, if there is one, and are compiled by Numba.
Run: pytest benchmarks/test_start.py --benchmark-only
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from kinseek.kernels.backend import LIBRARY, describe_backend

LOAD = "import kinseek; arm = kinseek.load('elbow6'); T = arm.fk(arm.lower + 0.3); "
FIRST = {
    "atlas": LOAD + "arm.ik(T)",
    "branches": LOAD + "arm.branches(T)",
    "polished": LOAD + "arm.ik(T, solver=kinseek.Polished())",
}


def fresh(benchmark: Any, call: Callable[[], None], rounds: int, warmup: int = 1) -> None:
    """Time a call that starts a process."""
    benchmark.pedantic(call, rounds=rounds, warmup_rounds=warmup)


def python(code: str, cache: Path, jit: str = "1") -> None:
    # A user's Python keeps its byte code.
    other = ("NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE")
    environment = {name: value for name, value in os.environ.items() if name not in other}
    environment["XDG_CACHE_HOME"] = str(cache)
    environment["KINSEEK_JIT"] = jit
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, capture_output=True)


@pytest.mark.parametrize("code", ["pass", "import numpy, numba", "import numpy, numba, kinseek"])
def test_import(benchmark: BenchmarkFixture, code: str, tmp_path: Path) -> None:
    fresh(benchmark, lambda: python(code, tmp_path), 9)


@pytest.mark.parametrize("code", ["import numpy", "import kinseek", *FIRST])
@pytest.mark.skipif(LIBRARY is None, reason=describe_backend())
def test_from_the_library(benchmark: BenchmarkFixture, tmp_path: Path, code: str) -> None:
    fresh(benchmark, lambda: python(FIRST.get(code, code), tmp_path, jit="0"), 9)


@pytest.mark.parametrize("what", FIRST)
def test_first_answer_of_a_second_process(benchmark: BenchmarkFixture, tmp_path: Path, what: str) -> None:
    fresh(benchmark, lambda: python(FIRST[what], tmp_path), 9)


@pytest.mark.parametrize("what", FIRST)
def test_first_run_compiles(benchmark: BenchmarkFixture, tmp_path: Path, what: str) -> None:
    folders = iter(range(100))
    fresh(benchmark, lambda: python(FIRST[what], tmp_path / str(next(folders))), 2, warmup=0)


if __name__ == "__main__":
    from benchmarks.command import under_pytest

    under_pytest(__file__, __doc__)
