"""The fleet of arms: share of reachable targets solved, and time of a target.

Every arm gets 100,000 targets from joint values uniform inside its limits, and 5,000 near singularities and limits (each
joint one of {0, lower, upper, ±π/2, random}), in batches, without a starting guess. A target is solved if plain NumPy
forward kinematics confirms the result within 1e-6 m and 1e-6 rad, and every joint is inside its limits. Times are medians
of several runs. Every miss is listed by name.

    python -m benchmarks.fleet                 # writes benchmarks/fleet.md and fleet_misses.csv
    python -m benchmarks.fleet panda ur5e --random 10000
    python -m benchmarks.fleet --seeds 5       # near-singular targets alone, with five seeds; printed and not written
"""

from __future__ import annotations

import csv
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.kinds import POSE
from kinseek.solvers.atlas.index import SAMPLES, AtlasIndex

from .command import arm_name, at_least_one, command, writes
from .page import Page, percent
from .targets import fleet_arm, fleet_names, plain_fk, random_joints, singular_joints, strict
from .timing import batch_cost, timed

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

REPEATS = 5

BAND = {
    "solved": 100.0,
    "one_median": 10.0,
    "one_p99": 60.0,
    "batch": 1.5,
    "two_cores": 1.7,
    "build": 50.0,
    "memory": 10.0,
}
"""What is aimed at: percent, [µs], [µs], [µs], times, [ms], [MB]."""


@dataclass(frozen=True)
class Miss:
    """A reachable target that was not reached."""

    arm: str
    kind: str
    seed: int
    index: int
    position_error: float
    orientation_error: float
    q: Array
    """Joint values that the target was made from."""


@dataclass(frozen=True)
class Row:
    """One arm of the table."""

    arm: str
    dof: int
    random: int
    random_solved: int
    singular: int
    singular_solved: int
    one_median: float
    """[µs]"""
    one_p99: float
    """[µs]"""
    batch: float
    """[µs] a pose, one thread"""
    singular_batch: float
    """[µs] a pose, one thread"""
    two_cores: float
    """One thread's time over two threads' time."""
    build: float
    """[ms]"""
    memory: float
    """[MB]"""


def speedup(arm: kinseek.Arm, targets: Array, repeats: int = REPEATS) -> float:
    """Wall time on one thread over wall time on two, median of pairs taken one after the other."""

    def wall(threads: int) -> float:
        began = time.perf_counter()
        arm.ik(targets, threads=threads)
        return time.perf_counter() - began

    return statistics.median(wall(1) / wall(2) for _ in range(repeats))


def misses_of(name: str, arm: kinseek.Arm, kind: str, seed: int, q: Array) -> list[Miss]:
    """Solve the targets of joint values, (k, n), and list those that are not reached."""
    targets = plain_fk(arm.chain, q)
    solution = arm.ik(targets)
    good = strict(arm.chain, solution.q, targets)
    if not np.array_equal(good, solution.success):
        false = int((solution.success & ~good).sum())
        print(
            f"  {name}: {false} answers claim what outside FK denies, {int((good & ~solution.success).sum())} deny it"
        )
    return [
        Miss(name, kind, seed, int(i), solution.position_error[i], solution.orientation_error[i], q[i])
        for i in np.flatnonzero(~good)
    ]


def measure(name: str, random: int, singular: int, seed: int) -> tuple[Row, list[Miss]]:
    """Measure one arm."""
    arm = fleet_arm(name)
    loose, tight = random_joints(arm.chain, random, seed), singular_joints(arm.chain, singular, seed)
    arm.ik(plain_fk(arm.chain, loose[:100]))  # Whatever compiles or loads does so before the clock runs.
    built = [AtlasIndex(arm.chain, POSE, arm.chain.arrays, SAMPLES) for _ in range(3)]
    random_misses = misses_of(name, arm, "random", seed, loose)
    singular_misses = misses_of(name, arm, "singular", seed, tight)
    targets = plain_fk(arm.chain, loose)
    near = plain_fk(arm.chain, tight)
    timed(arm.ik, targets[:200])
    _, one = timed(arm.ik, targets[:5000])
    row = Row(
        arm=name,
        dof=arm.dof,
        random=random,
        random_solved=random - len(random_misses),
        singular=singular,
        singular_solved=singular - len(singular_misses),
        one_median=float(np.median(one)),
        one_p99=float(np.percentile(one, 99)),
        batch=batch_cost(lambda: arm.ik(targets, threads=1), random, REPEATS),
        singular_batch=batch_cost(lambda: arm.ik(near, threads=1), singular, REPEATS),
        two_cores=speedup(arm, targets),
        build=statistics.median(index.build_time for index in built) * 1e3,
        memory=built[0].memory / 1e6,
    )
    return row, random_misses + singular_misses


def near_singular(names: Sequence[str], count: int, seeds: int) -> list[Miss]:
    """Solve near-singular targets of several seeds, and list those that are not reached."""
    misses = []
    for name in names:
        arm, began = fleet_arm(name), time.perf_counter()
        for seed in range(seeds):
            misses += misses_of(name, arm, "singular", seed, singular_joints(arm.chain, count, seed))
        missed = [miss for miss in misses if miss.arm == name]
        print(
            f"{name:18s} missed {len(missed)} of {seeds * count:,}  {time.perf_counter() - began:.1f} s",
            flush=True,
        )
    return misses


def told(miss: Miss) -> str:
    """A miss in one line."""
    return (
        f"{miss.arm}, {miss.kind}, seed {miss.seed}, number {miss.index}: {miss.position_error:.1e} m, "
        f"{miss.orientation_error:.1e} rad; made from q = {np.array2string(miss.q, precision=6, max_line_width=200)}"
    )


def page(rows: list[Row], misses: list[Miss]) -> Page:
    """The page."""
    first, page = rows[0], Page("The fleet", "benchmarks.fleet")
    page.say(
        f"For each arm, {first.random:,} targets are poses of joint values uniform inside the limits, and",
        f"{first.singular:,} of joint values near singularities and limits. The searches get no starting guess. A target",
        "is solved if the result is within 1e-6 m and 1e-6 rad by plain NumPy forward kinematics, and inside the limits.",
        "*One pose* is the wall time of a call `arm.ik(T)` from Python, the median of 5,000 calls. *Batch* is processor",
        "time on one thread. *Two cores* is the wall time on one thread divided by that on two.",
    )
    page.table(
        "arm | >joints | >solved, random % | >solved, near singular % | >one pose µs | >p99 µs | >batch µs a pose | "
        ">near singular µs a pose | >two cores | >build ms | >memory MB",
        [
            (
                row.arm,
                row.dof,
                percent(row.random_solved, row.random),
                percent(row.singular_solved, row.singular),
                f"{row.one_median:.1f}",
                f"{row.one_p99:.1f}",
                f"{row.batch:.2f}",
                f"{row.singular_batch:.2f}",
                f"{row.two_cores:.2f} ×",
                f"{row.build:.0f}",
                f"{row.memory:.1f}",
            )
            for row in rows
        ],
    )
    page.head("Goals and results")
    page.table("what | goal | worst arm | arms that meet it", verdicts(rows))
    page.head(f"Misses: {len(misses)}")
    page.items(map(told, misses))
    return page


def verdicts(rows: list[Row]) -> list[tuple[str, str, str, str]]:
    """One row a target: what is aimed at, the worst arm, and how many arms meet it."""

    def line(
        what: str, aim: str, values: list[float], good: list[bool], unit: str, largest: bool = True
    ) -> tuple[str, str, str, str]:
        worst = max(range(len(rows)), key=lambda i: values[i] if largest else -values[i])
        return what, aim, f"{values[worst]:.5g}{unit}, {rows[worst].arm}", f"{sum(good)} of {len(rows)}"

    best: dict[int, float] = {}
    for row in rows:
        best[row.dof] = min(best.get(row.dof, np.inf), row.one_median)
    solved = [100 * row.random_solved / row.random for row in rows]
    tight = [100 * row.singular_solved / row.singular for row in rows]
    six = [row for row in rows if row.dof in (6, 7)]
    spread = [row.one_median / best[row.dof] for row in rows]
    lines = [
        line("random solved", "100.000 %", solved, [value == 100 for value in solved], " %", False),
        line("near singular solved", "100 %", tight, [value == 100 for value in tight], " %", False),
    ]
    for what, aim, field, limit, unit, largest in (
        ("one pose, median", "≤ 10 µs", "one_median", BAND["one_median"], " µs", True),
        ("one pose, p99", "≤ 60 µs", "one_p99", BAND["one_p99"], " µs", True),
        ("batch, one core", "≤ 1.5 µs", "batch", BAND["batch"], " µs", True),
        ("batch, two cores", "≥ 1.7 ×", "two_cores", -BAND["two_cores"], " ×", False),
        ("build", "≤ 50 ms", "build", BAND["build"], " ms", True),
        ("memory", "≤ 10 MB", "memory", BAND["memory"], " MB", True),
    ):
        values = [float(getattr(row, field)) for row in rows]
        good = [value <= limit if largest else value >= -limit for value in values]
        lines.append(line(what, aim, values, good, unit, largest))
    lines.append(
        line(
            "one pose, relative to the best arm with as many joints",
            "≤ 5 ×",
            spread,
            [value <= 5 for value in spread],
            " ×",
        )
    )
    if six:
        fast = sum(row.one_median <= BAND["one_median"] for row in six)
        lines.append(("one pose, median, 6 and 7 joints", "≤ 10 µs", "", f"{fast} of {len(six)}"))
    return lines


def write_misses(path: Path, misses: list[Miss]) -> None:
    """Write every miss with all digits of its joint values."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["arm", "kind", "seed", "index", "position_error_m", "orientation_error_rad", "q"])
        for miss in misses:
            numbers = " ".join(repr(float(value)) for value in miss.q)
            errors = [f"{miss.position_error:.3e}", f"{miss.orientation_error:.3e}"]
            writer.writerow([miss.arm, miss.kind, miss.seed, miss.index, *errors, numbers])


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, help="names; all of them by default")
    parser.add_argument("--random", type=at_least_one, default=100_000, help="random targets an arm")
    parser.add_argument("--singular", type=at_least_one, default=5_000, help="near-singular targets an arm")
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    parser.add_argument(
        "--seeds", type=at_least_one, help="near-singular targets of so many seeds, and nothing else"
    )
    writes(parser, "--output", HERE / "fleet.md", "page to write, and beside it the CSV of the misses")
    options = parser.parse_args()
    names = options.arms or fleet_names()
    if options.seeds:
        missing = near_singular(names, options.singular, options.seeds)
        print("\n".join([*map(told, missing), f"{len(missing)} misses"]))
        return
    rows, misses = [], []
    for name in names:
        row, missed = measure(name, options.random, options.singular, options.seed)
        rows.append(row)
        misses += missed
        print(
            f"{name:18s} {row.dof:2d} joints  missed {row.random - row.random_solved} + "
            f"{row.singular - row.singular_solved}  one {row.one_median:.1f} / {row.one_p99:.1f} µs  "
            f"batch {row.batch:.2f} / {row.singular_batch:.2f} µs  two cores {row.two_cores:.2f}  "
            f"build {row.build:.0f} ms  {row.memory:.1f} MB",
            flush=True,
        )
    page(rows, misses).write(options.output)
    write_misses(options.output.with_name(options.output.stem + "_misses.csv"), misses)
    print(f"{len(misses)} misses")


if __name__ == "__main__":
    main()
