"""One side of `benchmarks.since`: answers questions with the kinseek that it imports; see `serve`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import kinseek

OTHERS = ("branches", "proof", "path")

PROOF = 2_000
"""Boxes of a proof, so that arms of seven joints take milliseconds as well."""

ARM: list[kinseek.Arm] = []
TARGETS: list[Any] = []


def begin(file: str, base: str, tip: str, targets: Any) -> str:
    """Load an arm, take targets, (k, 4, 4), and warm up; return where the package stands."""
    arm, T = kinseek.load(file, base=base, tip=tip), np.array(targets)
    ARM[:], TARGETS[:] = [arm], [T]
    for one in T[:100]:
        arm.ik(one)
    arm.ik(T[:100], threads=1)
    for question in OTHERS:
        _answer(arm, question, T[:2])
    return kinseek.__file__


def ask(question: str, first: int, last: int) -> dict[str, Any]:
    """Time of a pose [µs], and the joint values of a batch."""
    arm, part = ARM[0], TARGETS[0][first:last]
    q: Any = []
    if question == "one":
        times = np.empty(len(part))
        for i, one in enumerate(part):
            began = time.perf_counter_ns()
            arm.ik(one)
            times[i] = time.perf_counter_ns() - began
        return {"cost": float(np.median(times)) / 1e3, "q": q}
    began = time.process_time_ns()
    if question == "batch":
        q = arm.ik(part, threads=1).q
    else:
        _answer(arm, question, part)
    return {"cost": (time.process_time_ns() - began) / 1e3 / len(part), "q": q}


def _answer(arm: kinseek.Arm, question: str, T: Any) -> None:
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
