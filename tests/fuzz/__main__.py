"""All fuzzing, one target after the other, for a night: files, meshes, maps, calls, motions, proofs, processes, interrupts.

    python -m tests.fuzz                        # 100,000 cases, others every day
    python -m tests.fuzz --count 2000 --seed 7

Each target is a process of its own, and says what it found. Ends with 1 if any found something; the seed is printed, and
with it every case comes again: `python -m tests.fuzz.files --seed S --show I`.
"""

from __future__ import annotations

import argparse
import datetime
import subprocess
import sys
import time

SHARES = {"files": 0.38, "meshes": 0.1, "maps": 0.02, "calls": 0.2, "motions": 0.05, "proofs": 0.25}
"""Of all cases."""

MOST_CASES = 200
"""For each so many cases one fork, pickle or copy beside threads, which takes as long."""

MOMENTS = 5
"""At which each call is interrupted."""


def commands(count: int, seed: int) -> list[list[str]]:
    """What is run, in turns."""
    told = [
        [name, "--count", str(round(share * count)), "--seed", str(seed)] for name, share in SHARES.items()
    ]
    told.append(["processes", "--count", str(max(count // MOST_CASES, 20)), "--seed", str(seed)])
    return [*told, ["interrupts", "--moments", str(MOMENTS), "--seed", str(seed)]]


def main() -> int:
    """Run all, also after a finding."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=100_000, help="cases of all targets together")
    parser.add_argument(
        "--seed", type=int, default=datetime.date.today().toordinal(), help="the day, if it is left out"
    )
    given = parser.parse_args()
    failed, began = [], time.perf_counter()
    for name, *options in commands(given.count, given.seed):
        print(f"+ python -m tests.fuzz.{name} {' '.join(options)}", flush=True)
        done = subprocess.run([sys.executable, "-m", f"tests.fuzz.{name}", *options], check=False)
        if done.returncode:
            failed.append(name)
    minutes = (time.perf_counter() - began) / 60
    print(f"seed {given.seed}, {minutes:.0f} minutes: {', '.join(failed) or 'nothing'} found wrong")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
