"""The first seconds and megabytes of a new user: a wheel in an environment of its own, without Numba.

python -m benchmarks.first_answer [ROUNDS] [--wheel FILE]

Builds a wheel, or takes the given one, and installs it in a new environment. Prints the megabytes on disk without those of
NumPy, the seconds from the start of a process to its first answer, measured alternately with `import numpy`, and the most
memory that such a process held. A missed target is a failure. Linux and macOS; pip needs PyPI.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from .command import ROOT, at_least_one, command

MOST_MEGABYTES, MOST_MEBIBYTES = 60.0, 80.0
FACTOR, MORE = 2.0, 0.3
"""A first answer may take so many times what `import numpy` takes, and so many seconds."""
LOAD = "import kinseek; arm = kinseek.load('panda'); pose = arm.fk(arm.lower + 0.3)"
SOLVE = "solve panda --at 0.4 0.1 0.5 --rpy 180 0 0 --deg"
PROCESSES = {
    "import numpy": "import numpy",
    "one pose": f"{LOAD}; assert arm.ik(pose).success",
    "branches": f"{LOAD}; assert len(arm.branches(pose))",
    f"kinseek {SOLVE}": f"import sys; from kinseek.cli import main; sys.argv = {['kinseek', *SOLVE.split()]}; main()",
}
HELD = """
import atexit, resource, sys
most = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
atexit.register(lambda: print(most(), file=sys.stderr))
"""


def environment() -> dict[str, str]:
    """A user's: byte code is kept, and nothing chooses how kernels run."""
    ours = ("PYTHON", "KINSEEK_", "NUMBA_")
    return {name: value for name, value in os.environ.items() if not name.startswith(ours)}


def installed(wheel: Path, folder: Path) -> Path:
    """Make an environment with a wheel and its command line in it; return its Python.

    Raises:
        SystemExit: Numba came with it.
    """
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    subprocess.run(
        [str(python), "-m", "pip", "install", "-q", f"{wheel}[cli]"], check=True, env=environment()
    )
    if subprocess.run([str(python), "-c", "import numba"], capture_output=True, check=False).returncode == 0:
        raise SystemExit("Numba is there, so this shows nothing")
    return python


def megabytes(folder: Path) -> dict[str, float]:
    """What each thing in a folder of packages takes [MB], but for pip's and setuptools' own."""
    sizes = {}
    for entry in folder.iterdir():
        if not entry.name.startswith(("pip", "setuptools", "_distutils", "distutils")):
            files = [entry] if entry.is_file() else [path for path in entry.rglob("*") if path.is_file()]
            sizes[entry.name] = sum(path.stat().st_size for path in files) / 1e6
    return sizes


def once(python: Path, code: str, environment: dict[str, str]) -> tuple[float, float]:
    """Start a process: its seconds, and the most memory that it held [MiB]."""
    began = time.perf_counter()
    done = subprocess.run(
        [str(python), "-c", HELD + code], env=environment, capture_output=True, text=True, check=True
    )
    return time.perf_counter() - began, float(done.stderr.splitlines()[-1])


def main() -> None:
    """Print a table, and fail where a target is missed."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "rounds", nargs="?", type=at_least_one, default=15, help="of each process, 15 by default"
    )
    parser.add_argument("--wheel", type=Path, help="one that is there already")
    options: argparse.Namespace = parser.parse_args()
    missed = []
    with tempfile.TemporaryDirectory() as place:
        wheel = options.wheel
        if wheel is None:
            subprocess.run(
                [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", place, str(ROOT)],
                env=os.environ | {"KINSEEK_BUILD": "always"},
                check=True,
            )
            wheel = next(Path(place).glob("*.whl"))
        python = installed(wheel, Path(place) / "environment")
        home = environment() | {"XDG_CACHE_HOME": str(Path(place) / "cache")}
        where = [
            str(python),
            "-c",
            "import json, sysconfig; print(json.dumps(sysconfig.get_path('purelib')))",
        ]
        packages = Path(json.loads(subprocess.run(where, capture_output=True, check=True).stdout))
        sizes = megabytes(packages)
        beyond = {name: size for name, size in sizes.items() if not name.startswith("numpy")}
        total = sum(beyond.values())
        largest = sorted(beyond, key=lambda name: -beyond[name])[:6]
        print(f"on disk beyond NumPy: {total:.1f} MB (target {MOST_MEGABYTES:.0f}), most of it")
        print("  " + ", ".join(f"{name} {beyond[name]:.1f}" for name in largest))
        if total > MOST_MEGABYTES:
            missed.append("on disk")
        for code in PROCESSES.values():
            once(python, code, home)
        seen: dict[str, list[tuple[float, float]]] = {name: [] for name in PROCESSES}
        for _ in range(options.rounds):
            for name, code in PROCESSES.items():
                seen[name].append(once(python, code, home))
        base = statistics.median(seconds for seconds, _ in seen["import numpy"])
        most = FACTOR * base + MORE
        print(
            f"{'process':58} median  least [s]  memory [MiB]; targets {most:.2f} s, {MOST_MEBIBYTES:.0f} MiB"
        )
        for name, figures in seen.items():
            seconds, held = [first for first, _ in figures], max(second for _, second in figures)
            median = statistics.median(seconds)
            print(f"{name:58} {median:6.3f} {min(seconds):6.3f}      {held:6.1f}")
            if name != "import numpy":
                missed += [f"seconds of {name!r}"] * (median > most)
                missed += [f"memory of {name!r}"] * (held > MOST_MEBIBYTES)
    if missed:
        raise SystemExit(f"missed: {', '.join(missed)}")


if __name__ == "__main__":
    main()
