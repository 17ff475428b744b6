"""One side of `benchmarks.since`: answers questions with the kinseek that it imports, line by line."""

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
    options = parser.parse_args()
    arm, T = kinseek.load(options.file, base=options.base, tip=options.tip), np.load(options.targets)
    q = np.full((len(T), arm.dof), np.nan)
    for one in T[:100]:
        arm.ik(one)
    arm.ik(T[:100], threads=1)
    for question in OTHERS:
        ask(arm, question, T[:2])
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
            if question == "batch":
                q[int(first) : int(last)] = arm.ik(part, threads=1).q
            else:
                ask(arm, question, part)
            cost = (time.process_time_ns() - began) / 1e3 / len(part)
        print(cost, flush=True)
    np.save(options.answers, q)


OTHERS = ("branches", "proof", "path")


def ask(arm: kinseek.Arm, question: str, T: np.ndarray) -> None:
    """Find all branches of poses, (k, 4, 4); or prove the poses a quarter farther away; or follow a motion near them."""
    if question == "path":
        middle, reach = arm.ik(T[0]).q, np.linspace(0.0, 0.2, len(T))[:, None]
        arm.follow(arm.fk(np.clip(middle + reach, arm.lower, arm.upper)), threads=1)
        return
    for one in T:
        if question == "branches":
            arm.branches(one, threads=1)
        else:
            far = one.copy()
            far[:3, 3] *= 1.25
            arm.prove(far, budget=PROOF)


PROOF = 2_000
"""Boxes of a proof, so that arms of seven joints take milliseconds as well."""


if __name__ == "__main__":
    main()
