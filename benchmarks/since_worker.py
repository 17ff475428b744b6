"""One side of `benchmarks.since`: asks the kinseek that it imports for what it is told to, line by line."""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

import kinseek


def main() -> None:
    """Serve until there are no more lines; each names a question and a range of targets."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    for name, what in (
        ("file", "URDF of the arm"),
        ("base", "its first link"),
        ("tip", "its last link"),
        ("targets", "poses, (k, 4, 4), as .npy"),
        ("answers", "where joint values of the batches go, (k, n), as .npy"),
    ):
        parser.add_argument(name, help=what)
    told = parser.parse_args()
    arm, T = kinseek.load(told.file, base=told.base, tip=told.tip), np.load(told.targets)
    q = np.full((len(T), arm.dof), np.nan)
    for one in T[:100]:
        arm.ik(one)
    arm.ik(T[:100], threads=1)
    print(kinseek.__file__, flush=True)
    for line in sys.stdin:
        question, first, last = line.split()
        part = T[int(first) : int(last)]
        if question == "one":
            times = np.empty(len(part))
            for i, one in enumerate(part):
                began = time.perf_counter_ns()
                arm.ik(one)
                times[i] = time.perf_counter_ns() - began
            cost = float(np.median(times)) / 1e3
        else:
            began = time.process_time_ns()
            solution = arm.ik(part, threads=1)
            cost = (time.process_time_ns() - began) / 1e3 / len(part)
            q[int(first) : int(last)] = solution.q
        print(cost, flush=True)
    np.save(told.answers, q)


if __name__ == "__main__":
    main()
