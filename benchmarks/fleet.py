"""The fleet of arms: share of reachable targets solved, time of a target, and memory.

For each arm, 100,000 targets are poses of joint values uniform inside the limits, and 5,000 of joint values near
singularities and limits (each joint one of {0, lower, upper, ±π/2, random}). The searches get no starting guess. A target is
solved if the result is within 1e-6 m and 1e-6 rad by plain NumPy forward kinematics, and inside the limits. *One pose* is
the wall time of a call `arm.ik(T)` from Python, the median of 5,000 calls; *near* is that of a call with a start 0.02 rad
away, and *out of reach* that of poses one and a half times as far away as the arm is long. *Batch* is processor time on one
thread. *Two cores* is the wall time on one thread divided by that on two.

    python -m benchmarks.fleet                 # writes benchmarks/fleet.md
    python -m benchmarks.fleet panda ur5e --random 10000
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator

import numpy as np

import kinseek
from kinseek.kinds import POSE
from kinseek.solvers.atlas.index import SAMPLES, AtlasIndex

from .command import command
from .page import Page, Row, list_misses, missed, share
from .targets import Array, plain_fk, random_joints, singular_joints, strict
from .timing import batch_cost, least, timed

Figures = dict[str, float]
"""What is measured of an arm, by the keys of `FORMATS`."""

REPEATS = 5

FORMATS = {
    "random": ">solved, random %",
    "singular": ">solved, near singular %",
    "one": ">one pose µs",
    "p99": ">p99 µs",
    "near": ">near µs",
    "out": ">out of reach µs",
    "batch": ">batch µs a pose",
    "singular_batch": ">near singular µs a pose",
    "cores": ">two cores",
    "build": ">build ms",
    "memory": ">memory MB",
}
"""Columns of the table."""

GOALS = (
    ("random solved", "random", 100.0, "≥", " %"),
    ("near singular solved", "singular", 100.0, "≥", " %"),
    ("one pose, median", "one", 10.0, "≤", " µs"),
    ("one pose, p99", "p99", 60.0, "≤", " µs"),
    ("out of reach", "out", 300.0, "≤", " µs"),
    ("batch, one core", "batch", 1.5, "≤", " µs"),
    ("batch, two cores", "cores", 1.7, "≥", " ×"),
    ("build", "build", 50.0, "≤", " ms"),
    ("memory", "memory", 10.0, "≤", " MB"),
    ("one pose, relative to the best arm with as many joints", "spread", 5.0, "≤", " ×"),
)
"""What is aimed at: what, its key, and the limit with its unit."""


def solved(arm: kinseek.Arm, label: str, q: Array, misses: list[str]) -> float:
    """Percent of the targets of joint values, (k, n), that are solved; the others are added to the misses."""
    targets = plain_fk(arm.chain, q)
    solution = arm.ik(targets)
    good = strict(arm.chain, solution.q, targets)
    misses += missed(f"{arm.name}, {label}", solution, good, q)
    return 100.0 * float(good.mean())


def median_of(arm: kinseek.Arm, targets: Array, starts: Array | None = None) -> Array:
    """Times of single calls [µs], after as many that are not timed, (k,)."""
    if starts is None:
        timed(arm.ik, targets[:200])
        return timed(arm.ik, targets)[1]
    return timed(lambda each: arm.ik(each[0], near=each[1]), list(zip(targets, starts, strict=True)))[1]


def measure(name: str, random: int, singular: int, seed: int, misses: list[str]) -> Figures:
    """Measure one arm."""
    arm = kinseek.load(name)
    loose, tight = random_joints(arm.chain, random, seed), singular_joints(arm.chain, singular, seed)
    targets, near = plain_fk(arm.chain, loose), plain_fk(arm.chain, tight)
    arm.ik(targets[:100])  # Whatever compiles or loads does so before the clock runs.
    built = [AtlasIndex(arm.chain, POSE, arm.chain.arrays, SAMPLES) for _ in range(3)]
    one, out = median_of(arm, targets[:5000]), targets[:200].copy()
    length = np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum()
    out[:, :3, 3] *= (1.5 * length / np.linalg.norm(out[:, :3, 3], axis=1))[:, None]
    single, double = (
        [least(lambda n=n: arm.ik(targets, threads=n), 1) for _ in range(REPEATS)]  # type: ignore[misc]
        for n in (1, 2)
    )
    return {
        "random": solved(arm, f"random, seed {seed}", loose, misses),
        "singular": solved(arm, f"singular, seed {seed}", tight, misses),
        "one": float(np.median(one)),
        "p99": float(np.percentile(one, 99)),
        "near": float(np.median(median_of(arm, targets[:1000], loose[:1000] + 0.02))),
        "out": float(np.median(median_of(arm, out))),
        "batch": batch_cost(lambda: arm.ik(targets, threads=1), random, REPEATS),
        "singular_batch": batch_cost(lambda: arm.ik(near, threads=1), singular, REPEATS),
        "cores": statistics.median(np.divide(single, double)),
        "build": statistics.median(index.build_time for index in built) * 1e3,
        "memory": built[0].memory / 1e6,
    }


def row_of(name: str, dof: int, figures: Figures) -> Row:
    """A line of the table."""
    cells: Row = {"arm": name, ">joints": dof}
    for key, column in FORMATS.items():
        value = figures[key]
        digits = 0 if key in ("build", "out") else 2 if "batch" in key or key == "cores" else 1
        cells[column] = share(value / 100.0) if "solved" in column else f"{value:.{digits}f}"
    return cells


def verdicts(found: dict[str, Figures], joints: dict[str, int]) -> Iterator[Row]:
    """One row a goal: what is aimed at, the worst arm, and how many arms meet it."""
    for name, figures in found.items():
        best = min(other["one"] for arm, other in found.items() if joints[arm] == joints[name])
        figures["spread"] = figures["one"] / best
    for what, key, limit, sign, unit in GOALS:
        values = {name: figures[key] for name, figures in found.items()}
        worst = (max if sign == "≤" else min)(values, key=lambda name: values[name])
        good = sum(value <= limit if sign == "≤" else value >= limit for value in values.values())
        yield {
            "what": what,
            "goal": f"{sign} {limit:g}{unit}",
            "worst arm": f"{values[worst]:.5g}{unit}, {worst}",
            "arms that meet it": f"{good} of {len(values)}",
        }


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=(),
        page="fleet.md",
        random=(100_000, 5_000, "random targets an arm"),
        singular=(5_000, 500, "near-singular targets an arm"),
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    options = parser.options()
    page, misses, found = Page("The fleet", "benchmarks.fleet", __doc__), list[str](), dict[str, Figures]()
    joints = {name: kinseek.load(name).dof for name in options.arms}

    def rows() -> Iterator[Row]:
        for name, dof in joints.items():
            found[name] = measure(name, options.random, options.singular, options.seed, misses)
            yield row_of(name, dof, found[name])

    page.rows(rows())
    page.head("Goals and results")
    page.rows(verdicts(found, joints))
    list_misses(page, misses)
    page.end(options)


if __name__ == "__main__":
    main()
