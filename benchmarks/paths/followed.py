"""Curves and tasks that are followed: in one call, of many poses, and as a stream."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

import kinseek
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from benchmarks.timing import cpu, peak

from .curves import (
    KINDS,
    LARGEST,
    POSES,
    TASK_ARMS,
    WITHIN,
    curve,
    holds,
    placements,
)
from .peers import by_kinseek

LONG_ARMS = ("irb120", "ur5e", "panda")
BATCH = 1000
"""Poses that a stream makes at a time."""


def made(page: Page, options: argparse.Namespace) -> None:
    """Write the section of made paths, and those that are missed."""
    page.head("Made paths")
    page.say(
        "*Largest ratio* is the largest step of a path divided by that of its curve. *Travel* is the length of the joint",
        "motion divided by that of the curve, median. *Bytes a pose* is what a pose of 4,000 adds to the memory, beyond",
        "1,000 poses.",
    )
    misses: list[str] = []
    page.rows(_made(kinseek.load(name), options.paths, misses) for name in options.arms)
    page.say("Missed:")
    page.items(misses)


def _made(arm: kinseek.Arm, paths: int, misses: list[str]) -> Row:
    arm.follow(arm.fk(curve(arm, 40, 10**6)), threads=1)  # What the arm needs once.
    ratios, travels, times, before = [], [], [], len(misses)
    for seed in range(paths):
        q = curve(arm, POSES, seed)
        T, steps = arm.fk(q), np.diff(q, axis=0)
        largest = float(np.abs(steps).max())
        took, path = cpu(lambda T=T, step=WITHIN * largest: arm.follow(T, max_step=step, threads=1))
        times.append(took / POSES * 1e6)
        ratios.append(float(path.largest_step.max()) / largest)
        travels.append(path.length / float(np.linalg.norm(steps, axis=1).sum()))
        if not (path.success and holds(arm, path, T)):
            why = f"{path.status.name}, breaks: {len(path.breaks)}; {'; '.join(path.why[:2])}"
            misses.append(f"{arm.name} {seed}: {why}")
    return {
        "arm": arm.name,
        ">joints": arm.dof,
        ">paths": paths,
        ">followed": paths - len(misses) + before,
        ">largest ratio": f"{max(ratios):.2f}",
        ">travel": f"{np.median(travels):.2f}",
        ">µs a waypoint": f"{np.median(times):.0f}",
        ">bytes a pose": f"{_added(arm, 1000, 4000, WITHIN):.0f}",
    }


def _added(arm: kinseek.Arm, few: int, many: int, within: float | None) -> float:
    """What a pose adds to the memory of a path [bytes]."""
    peaks = []
    for count in (few, many):
        q = curve(arm, count, 0)
        T, largest = arm.fk(q), float(np.abs(np.diff(q, axis=0)).max())
        step: dict[str, Any] = {} if within is None else {"max_step": within * largest}
        peaks.append(peak(partial(arm.follow, T, threads=1, **step)))
    return (peaks[1] - peaks[0]) / (many - few)


def tasks(page: Page, options: argparse.Namespace) -> None:
    """Write the section of tasks, and those that are missed."""
    page.head("Tasks")
    page.say(
        "Lines of 0.4 m and circles of 0.15 m with 500 poses, and rasters of 11 rows and 2,000 poses with a free turn about",
        "the tool axis, at random places where all poses are reachable. They are followed without a start, with steps below",
        f"{LARGEST} rad.",
    )
    misses: list[str] = []
    names = [name for name in TASK_ARMS if name in options.arms]
    page.rows(_tasks(name, kind, options.placements, misses) for name in names for kind in KINDS)
    page.say("Missed:")
    page.items(misses)


def _tasks(name: str, kind: str, count: int, misses: list[str]) -> Row:
    arm = kinseek.load(name)
    found, reasons = by_kinseek(arm, kind, placements(arm, [kind] * count, 7)[0])
    misses += [f"{name} {kind} {i}: {reason}" for i, reason in reasons.items()]
    travels = found.lengths[found.lengths > 0.0]
    return {
        "arm": name,
        "task": kind,
        ">placements": count,
        ">followed": len(travels),
        ">joint travel, median rad": f"{np.median(travels) if len(travels) else np.nan:.2f}",
        ">µs a waypoint": f"{np.median(found.costs):.1f}",
    }


def long(page: Page, options: argparse.Namespace) -> None:
    """Write the section of long paths and of streams: wall time of one thread, and memory."""
    page.head("Long paths")
    page.say(
        "`arm.follow` of all poses at once, and `arm.follow_stream` of poses that an iterator makes. Of a stream, memory is",
        "what it takes in all; of `follow`, what a pose adds.",
    )
    page.rows(_long(options.poses))


def _long(poses: int) -> Iterator[Row]:
    for name in LONG_ARMS:
        arm = kinseek.load(name)
        arm.follow(arm.fk(curve(arm, 40, 1)), threads=1)  # What the arm needs once.
        count = poses // 5 if arm.dof > 6 else poses
        T = arm.fk(curve(arm, count, 0))
        began = time.perf_counter()
        breaks = len(arm.follow(T, threads=1).breaks)
        took = time.perf_counter() - began
        memory = f"{_added(arm, count // 2, count, None):.0f} bytes a pose"
        yield _row(arm, "at once", count, breaks, took, memory)
        began, count = time.perf_counter(), 10 * count
        breaks = _stream(arm, count)
        took = time.perf_counter() - began
        held = peak(partial(_stream, arm, min(count, 20_000)))
        yield _row(arm, "a stream", count, breaks, took, f"{held / 1e6:.0f} MB in all")


def _stream(arm: kinseek.Arm, count: int) -> int:
    """Follow poses that come one after the other; how often the motion is interrupted."""
    return sum(len(piece.breaks) for piece in arm.follow_stream(_poses(arm, count), threads=1))


def _row(arm: kinseek.Arm, how: str, poses: int, breaks: int, took: float, memory: str) -> Row:
    cells: Row = {"arm": arm.name, "how": how, ">poses": f"{poses:,}", ">breaks": breaks}
    return cells | {">µs a pose": f"{took / poses * 1e6:.0f}", ">memory": memory}


def _poses(arm: kinseek.Arm, count: int) -> Iterator[Array]:
    """A curve of so many poses, made as they are taken."""
    coarse, at = curve(arm, POSES, 0), np.linspace(0, POSES - 1, count)
    for first in range(0, count, BATCH):
        some = at[first : first + BATCH]
        q = np.stack([np.interp(some, np.arange(POSES), column) for column in coarse.T], axis=1)
        yield from arm.fk(q)
