"""Paths: are they followed without a break, with which steps, and how fast?

Made paths: random smooth curves of joint values, four harmonics over 98 % of every range, 1,000 poses; so a motion without
a break exists, and its largest step is known. Tasks: lines of 0.4 m and circles of 0.15 m with 500 poses, and rasters of 11
rows and 2,000 poses with a free turn about the tool axis. They have random placements whose poses are all reachable, and
are followed without a start, with steps below 0.2 rad. Times are processor times of one thread. Memory is what a path of
4,000 poses adds to the process beyond one of 1,000, for each pose.

    python -m benchmarks.paths                      # writes benchmarks/paths.md
    python -m benchmarks.paths ur5e panda --paths 10 --placements 5
    python -m benchmarks.paths --quick              # a few of each, printed and not written
"""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.robots import catalog_names

from .command import at_least_one, command, writes
from .page import Page

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

POSES, HARMONICS, SHARE, WITHIN = 1000, 4, 0.98, 1.5
"""Poses and harmonics of a made path, the share of the ranges that it uses, and how much larger a step may be than its."""

TASK_ARMS, LARGEST = ("ur5e", "panda"), 0.2
"""Arms of the field's tasks, and the largest step there [rad]."""


Row = tuple[dict[str, object], list[str]]
"""Cells of a line of a table, and what was missed."""


def curve(arm: kinseek.Arm, count: int, seed: int) -> Array:
    """A random smooth curve of joint values, (count, n)."""
    rng, s, q = np.random.default_rng(seed), np.linspace(0.0, 1.0, count), np.zeros((count, arm.dof))
    for h in range(1, HARMONICS + 1):
        a, b = rng.normal(size=(2, arm.dof))
        q += (np.cos(2 * np.pi * h * s)[:, None] * a + np.sin(2 * np.pi * h * s)[:, None] * b) / h
    low, high = q.min(axis=0), q.max(axis=0)
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    return np.asarray(middle + SHARE * half * (2 * (q - low) / (high - low) - 1))


def holds(arm: kinseek.Arm, path: kinseek.Path, T: Array) -> bool:
    """Does the path keep what it says: the poses to 1e-6, by FK alone, and the limits?"""
    poses = arm.fk(path.q)
    place = np.linalg.norm(poses[:, :3, 3] - T[:, :3, 3], axis=1)
    turn = np.linalg.norm(poses[:, :3, :3] - T[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    endless = np.array([kind == "continuous" for kind in arm.chain.kinds])
    inside = ((path.q >= arm.lower) & (path.q <= arm.upper) | endless).all()
    return bool(inside and (place <= 1e-6).all() and (turn <= 1e-6).all())


def measure_made(name: str, paths: int, poses: int) -> Row:
    """Follow made paths of one arm."""
    arm = kinseek.load(name)
    arm.follow(arm.fk(curve(arm, 40, 10**6)), threads=1)  # What the arm needs once.
    ratios, travels, times, misses = [], [], [], []
    for seed in range(paths):
        q = curve(arm, poses, seed)
        T, steps = arm.fk(q), np.diff(q, axis=0)
        largest = float(np.abs(steps).max())
        began = time.process_time()
        path = arm.follow(T, max_step=WITHIN * largest, threads=1)
        times.append((time.process_time() - began) / poses * 1e6)
        ratios.append(float(path.largest_step.max()) / largest)
        travels.append(path.length / float(np.linalg.norm(steps, axis=1).sum()))
        if not (path.success and holds(arm, path, T)):
            misses.append(
                f"{name} {seed}: {path.status.name}, breaks: {len(path.breaks)}; {'; '.join(path.why[:2])}"
            )
    return {
        "arm": name,
        ">joints": arm.dof,
        ">paths": paths,
        ">followed": paths - len(misses),
        ">largest ratio": f"{max(ratios):.2f}",
        ">travel": f"{np.median(travels):.2f}",
        ">µs a waypoint": f"{np.median(times):.0f}",
        ">bytes a pose": f"{memory_of(arm):.0f}",
    }, misses


def memory_of(arm: kinseek.Arm) -> float:
    """What a pose adds to the most memory that Python and NumPy hold [bytes]."""
    peaks = []
    for count in (1000, 4000):
        q = curve(arm, count, 0)
        T, largest = arm.fk(q), float(np.abs(np.diff(q, axis=0)).max())
        tracemalloc.start()
        arm.follow(T, max_step=WITHIN * largest, threads=1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    return float(peaks[1] - peaks[0]) / 3000


def placement(arm: kinseek.Arm, kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses of one task somewhere in the arm's reach, all reachable, and the joint values that made the first, (n,)."""
    while True:
        q0 = rng.uniform(arm.lower, arm.upper)
        T0 = arm.fk(q0)
        if kind == "line":
            way = rng.normal(size=3)
            offsets = np.linspace(0, 0.4, 500)[:, None] * way / np.linalg.norm(way)
        elif kind == "circle":
            angle = np.linspace(0, 2 * np.pi, 500)
            offsets = 0.15 * np.stack([np.cos(angle) - 1, np.sin(angle), 0 * angle], axis=1) @ T0[:3, :3].T
        else:
            rows = []
            for k, y in enumerate(np.linspace(0, 0.15, 11)):
                x = np.linspace(0, 0.25, 182 if k < 9 else 181)
                rows += [(each, y, 0.0) for each in (x if k % 2 == 0 else x[::-1])]
            offsets = np.array(rows) @ T0[:3, :3].T
        T = np.repeat(T0[None], len(offsets), axis=0)
        T[:, :3, 3] += offsets
        goal = asked(kind, T)
        if arm.ik(goal.at(T[::25])).success.all() and arm.ik(goal).success.all():
            return T, q0


def asked(kind: str, T: Array) -> kinseek.Goal:
    """What a task asks for: on a raster the turn about the tool is free."""
    return kinseek.Goal.pose(T, free="rz" if kind == "raster" else ())


def measure_tasks(name: str, kind: str, placements: int) -> Row:
    """Follow tasks of one kind."""
    arm, rng = kinseek.load(name), np.random.default_rng(7)
    followed, travels, times, misses = 0, [], [], []
    for i in range(placements):
        T, _ = placement(arm, kind, rng)
        began = time.process_time()
        path = arm.follow(asked(kind, T), max_step=LARGEST, threads=1)
        times.append((time.process_time() - began) / len(T) * 1e6)
        followed += path.success
        if path.success:
            travels.append(path.length)
        else:
            misses.append(f"{name} {kind} {i}: {'; '.join(path.why[:2])}")
    travel = float(np.median(travels)) if travels else np.nan
    return {
        "arm": name,
        "task": kind,
        ">placements": placements,
        ">followed": followed,
        ">joint travel, median rad": f"{travel:.2f}",
        ">µs a waypoint": f"{np.median(times):.1f}",
    }, misses


def page(made: list[Row], tasks: list[Row]) -> Page:
    """The page."""
    page = Page("Paths", "benchmarks.paths")
    page.say(
        f"Each path is made from a smooth curve of joint values: {HARMONICS} harmonics over {SHARE:.0%} of the joint",
        f"ranges. `arm.follow` gets only the poses, and a `max_step` of {WITHIN} times the largest step of that curve. A",
        "path is followed if it has no break and if every pose is reached to 1e-6 by plain forward kinematics, inside the",
        "limits. *Largest ratio* is the largest step of a path divided by that of its curve. *Travel* is the length of",
        "the joint motion divided by that of the curve, median. *Bytes a pose* is the memory that one more pose needs.",
    )
    page.rows([cells for cells, _ in made])
    page.head("Tasks")
    page.say(
        "Lines, circles and rasters at random places in reach; on a raster the turn about the tool axis is free."
    )
    page.rows([cells for cells, _ in tasks])
    page.head("Missed")
    page.items(text for _, misses in [*made, *tasks] for text in misses)
    return page


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", help="names or files; all bundled arms by default")
    parser.add_argument("--paths", type=at_least_one, default=100, help="made paths an arm")
    parser.add_argument("--placements", type=at_least_one, default=50, help="placements of each task")
    parser.add_argument("--quick", action="store_true", help="a few of each; nothing is written")
    writes(parser, "--output", HERE / "paths.md", "page to write")
    options = parser.parse_args()
    paths, placements, poses = (2, 2, POSES) if options.quick else (options.paths, options.placements, POSES)
    names = options.arms or (TASK_ARMS if options.quick else catalog_names())
    made, tasks = [], []
    for name in names:
        made.append(measure_made(name, paths, poses))
        print(made[-1], flush=True)
    for name in TASK_ARMS:
        if name not in names:
            continue
        for kind in ("line", "circle", "raster"):
            tasks.append(measure_tasks(name, kind, placements))
            print(tasks[-1], flush=True)
    if not options.quick:
        page(made, tasks).write(options.output)


if __name__ == "__main__":
    main()
