"""The first seconds and megabytes of a new user: processes from their start to the first solution.

Builds a wheel and installs it in an environment without Numba. Prints the megabytes on disk without those of NumPy, the
seconds of new processes, measured alternately with `import numpy`, and the most memory that such a process held. A missed
target is a failure. With `--jit` the sources are measured instead: with the library of kernels, with kernels that Numba has
compiled before, and in a first run, which compiles. Linux and macOS; uv needs PyPI.

    python -m benchmarks.first_answer
    python -m benchmarks.first_answer --rounds 5
    python -m benchmarks.first_answer --jit
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .command import ROOT, command
from .field.adapters import path_of
from .workers.environments import environment, megabytes

MOST_MEGABYTES, MOST_MEBIBYTES = 60.0, 80.0
FACTOR, MORE = 2.0, 0.3
"""A first solution may take so many times what `import numpy` takes, and so many seconds."""

BASE = "import numpy"
LOAD = "import kinseek; arm = kinseek.load('{}'); pose = arm.fk(arm.lower + 0.3)"
SOLVE = "solve panda --at 0.4 0.1 0.5 --rpy 180 0 0 --deg"
PROCESSES = {
    BASE: BASE,
    "one pose": f"{LOAD.format('panda')}; assert arm.ik(pose).success",
    "branches": f"{LOAD.format('panda')}; assert len(arm.branches(pose))",
    f"kinseek {SOLVE}": f"import sys; from kinseek.cli import main; sys.argv = {['kinseek', *SOLVE.split()]}; main()",
}
SOURCES = {
    BASE: BASE,
    "import numpy, numba": "import numpy, numba",
    "import kinseek": "import kinseek",
    "one pose": f"{LOAD.format('elbow6')}; arm.ik(pose)",
    "branches": f"{LOAD.format('elbow6')}; arm.branches(pose)",
    "polished": f"{LOAD.format('elbow6')}; arm.ik(pose, solver=kinseek.Polished())",
}
"""What is measured of the sources, with each kind of kernels."""

HELD = """
import atexit, resource, sys
most = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
atexit.register(lambda: print(most(), file=sys.stderr))
"""

Seen = dict[str, list[tuple[float, float]]]
"""Of each process the seconds and the memory [MiB] of every run."""


def user_of(cache: Path, **more: str) -> dict[str, str]:
    """A user's: byte code is kept, and nothing else chooses how kernels run."""
    ours = ("PYTHON", "KINSEEK_", "NUMBA_")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    return kept | {"XDG_CACHE_HOME": str(cache)} | more


def once(python: Path, code: str, user: dict[str, str]) -> tuple[float, float]:
    """Start a process: its seconds, and the most memory that it held [MiB]."""
    began = time.perf_counter()
    asked = [str(python), "-c", HELD + code]
    done = subprocess.run(asked, env=user, capture_output=True, text=True, check=True)
    return time.perf_counter() - began, float(done.stderr.splitlines()[-1])


def alternately(python: Path, processes: dict[str, str], user: dict[str, str], rounds: int) -> Seen:
    """Start all processes once, and then in turn so many times; print what they take."""
    seen: Seen = {name: [] for name in processes}
    for number in range(rounds + 1):
        for name, code in processes.items():
            taken = once(python, code, user)
            seen[name] += [taken] * bool(number)
    print(f"{'process':58} median  least [s]  memory [MiB]")
    for name, figures in seen.items():
        seconds, held = zip(*figures, strict=True)
        print(f"{name:58} {statistics.median(seconds):6.3f} {min(seconds):6.3f}      {max(held):6.1f}")
    return seen


def of_a_wheel(place: Path, rounds: int) -> list[str]:
    """Measure a wheel; what misses its target."""
    python, missed = environment(path_of("kinseek_cli")), list[str]()
    if isinstance(python, str):
        raise SystemExit(python)
    size = megabytes(python, without=("numpy",))
    print(f"on disk beyond NumPy: {size:.1f} MB (target {MOST_MEGABYTES:.0f})")
    missed += ["on disk"] * (size > MOST_MEGABYTES)
    seen = alternately(python, PROCESSES, user_of(place / "cache"), rounds)
    most = FACTOR * statistics.median(seconds for seconds, _ in seen.pop(BASE)) + MORE
    print(f"targets {most:.2f} s, {MOST_MEBIBYTES:.0f} MiB")
    for name, figures in seen.items():
        seconds, held = zip(*figures, strict=True)
        missed += [f"seconds of {name!r}"] * (statistics.median(seconds) > most)
        missed += [f"memory of {name!r}"] * (max(held) > MOST_MEBIBYTES)
    return missed


def of_sources(place: Path, rounds: int) -> None:
    """Measure the sources, with each kind of kernels."""
    python, sources = Path(sys.executable), {"PYTHONPATH": str(ROOT / "src")}
    print("from the library")
    alternately(python, SOURCES, user_of(place / "library", **sources), rounds)
    print("a first run, which compiles")
    for name, code in SOURCES.items():
        user = user_of(place / name.replace(" ", "-"), KINSEEK_JIT="1", **sources)
        print(f"{name:58} {once(python, code, user)[0]:6.1f} s", flush=True)
    print("with kernels that Numba compiled before")
    alternately(python, SOURCES, user_of(place / "numba", KINSEEK_JIT="1", **sources), rounds)


def main() -> None:
    """Print tables, and fail where a target is missed."""
    parser = command(__file__, __doc__, rounds=(15, 15, "of each process"))
    parser.add_argument("--jit", action="store_true", help="the sources, and what Numba compiles of them")
    options = parser.options()
    with tempfile.TemporaryDirectory() as folder:
        if options.jit:
            of_sources(Path(folder), options.rounds)
            return
        missed = of_a_wheel(Path(folder), options.rounds)
    if missed:
        raise SystemExit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
