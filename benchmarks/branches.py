"""Every branch: is the set complete, and what does it cost?

Arms with a closed form are held against EAIK, filtered by the limits: 20,000 targets from joint values uniform inside the
limits. Arms without one are held against 1,000 random restarts of a Levenberg-Marquardt walk for each of the first 1,000.
Answers count only if plain NumPy forward kinematics finds them within 1e-6 m and 1e-6 rad and inside the limits. Two
are the same if no joint differs by 1e-3 rad modulo 2π. Times are wall times of single calls from Python, and processor time
of batches. All who are timed get a part of the targets after each other, with nothing between the calls, and then the next
part: so a machine that changes its speed is fair to all. Ratios are those of the parts.

ssik is timed in an environment of its own, see `benchmarks.field`, which is made at the first run.

    python -m benchmarks.branches                 # writes branches.md beside this file; EAIK where installed
    python -m benchmarks.branches ur5e jaco2_6 --targets 1000
    python -m benchmarks.branches jaco2_6 irb5400 mpx3500 --targets 2500 --output random.md
    python -m benchmarks.branches jaco2_6 irb5400 mpx3500 --targets 1300 --singular --output singular.md
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.branches.index import BranchIndex
from kinseek.goal import Goal
from kinseek.kinds import POSE
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import SAMPLES, AtlasIndex

from .command import arm_name, at_least_one, command, writes
from .field.adapters import adapter, path_of
from .field.judge import Judge, bundled
from .field.run import Solver, solver_of
from .page import Page, percent
from .targets import plain_fk, random_joints, singular_joints, strict
from .workers.process import Gone, Raised

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

CLOSED = ("ur5e", "ur10e", "puma560", "irb120", "kr6r900")
OPEN = ("jaco2_6", "irb5400", "mpx3500", "ur10e_calibrated")
ONE_JOINT = ("jaco2_6", "irb5400", "mpx3500")
REDUNDANT = ("panda", "iiwa14", "gen3")

SSIK: dict[str, Any] = {"built": True, "max_solutions": None, "enumerate_windings": False}
"""The module that ssik builds for an arm, without copies by full turns."""

SAME = 1e-3
"""[rad]"""

SEARCHED = 40
"""FK evaluations that no closed form needs: eight candidates, a step or four each."""


PASSES = 7
"""Passes over a batch that is timed."""


CALLS = 3
"""Calls of each target, of which the least tells what it takes by itself, and the first what one waits for."""


PARTS = 5
"""Parts of the targets: kinseek and its peers are timed by turns."""


SWEPT = 120
"""Those that no search of one joint needs: twelve answers at most, a step or four each, and twins of them."""


AROUND = 400
"""Those that no arm needs which is near to a closed form and is asked for poses around the target."""


@dataclass(frozen=True)
class Row:
    """One arm of the table."""

    arm: str
    witness: str
    targets: int
    witnessed: int
    """Targets at which the witness was asked, the first ones."""
    lacking: list[int]
    """Targets where the witness has an answer that is lacking."""
    extra: list[str]
    """Targets with an answer that the witness lacks, and the least singular value of the Jacobian at all their answers."""
    false: int
    """Answers that outside FK denies."""
    answers: float
    """Mean number."""
    fewest: int
    median: float
    """[µs]"""
    p99: float
    """[µs]"""
    fastest: float
    """Least of the medians of the parts [µs]: what the machine does when nobody disturbs it."""
    tail: float
    """99th percentile of the least of `CALLS` calls, in parts of their median."""
    of_eaik: float
    """Median over the parts of the ratio of the medians, kinseek over EAIK; NaN where there is none."""
    of_ssik: float
    """The same of ssik."""
    witness_median: float
    """[µs], of EAIK from Python with its answers filtered by the limits; NaN where there is none."""
    ssik_median: float
    """[µs], of ssik from Python asked for all answers inside the limits; NaN where there is none."""
    ssik_fewer: int
    """Targets to which ssik has fewer answers."""
    index: float
    """Time to build what only branches need [ms]."""
    structure: str
    """What the geometry of the arm gives, see `Arm.structure`."""
    searched: int
    """Targets whose answers were searched, with a closed form or without one."""
    batch: float
    """Processor time of a pose in a batch of all targets, on one thread, median of `PASSES` [µs]."""


def apart(a: Array, b: Array) -> Array:
    """Largest joint differences modulo 2π of all pairs, (k, n) and (l, n) -> (k, l)."""
    gap = a[:, None] - b[None]
    return np.asarray(np.abs((gap + np.pi) % (2 * np.pi) - np.pi).max(axis=-1, initial=0.0))


def eaik(arm: kinseek.Arm) -> Callable[[Array], Array]:
    """All of EAIK's exact answers inside the limits, (k, n), as a function of the target.

    Raises:
        ImportError: EAIK is not installed.
    """
    solve: Any = adapter(path_of("eaik")).load(bundled(arm.name).arm, {})
    return lambda target: np.array(solve.branches(target)).reshape(-1, arm.dof).clip(arm.lower, arm.upper)


def ssik(solver: Solver, judge: Judge, targets: Array) -> tuple[Any, Array]:
    """How many answers ssik has to each target, and its times [µs].

    Raises:
        Raised, Gone: It has none.
    """
    slice = {"poses": np.concatenate([targets, targets[:50]]), "starts": [], "count": len(targets)}
    found = solver.ask(judge, "built", SSIK, "branches", 300.0, **slice, limit=300.0)
    number = np.array(found["target"])
    there = ~np.isnan(np.array(found["q"], dtype=float)).any(axis=1)
    times = np.array(found["times"], dtype=float)
    return np.bincount(number[there], minlength=len(targets)), times[~np.isnan(times)]


def restarts(arm: kinseek.Arm, seed: int, count: int = 1000) -> Callable[[Array], Array]:
    """What walks from random starts end at, (k, n), as a function of the target."""
    rng = np.random.default_rng(seed)

    def solve(target: Array) -> Array:
        starts = rng.uniform(arm.lower, arm.upper, (count, arm.dof))
        # Tight tolerances: beside a singularity 1e-6 in the pose is more than the distance of two answers.
        goal = Goal.pose(
            np.broadcast_to(target, (count, 4, 4)), position_tolerance=1e-10, orientation_tolerance=1e-10
        )
        found = arm.ik(goal, near=starts, threads=1)
        distinct: list[Array] = []
        # A joint without limits ends within half a turn of its start, which may be outside what is called its limits.
        turned = np.where(arm.chain.endless, (found.q + np.pi) % (2 * np.pi) - np.pi, found.q)
        for q in turned[found.success]:
            if not distinct or apart(q[None], np.array(distinct)).min() > SAME:
                distinct.append(q)
        return np.array(distinct).reshape(-1, arm.dof)

    return solve


def timed(ask: Callable[[Array], Any], targets: Array) -> tuple[list[Any], Array]:
    """What is answered to each target, and the wall time of each call [µs], one call right after the other."""
    answers, times = [], np.empty(len(targets))
    for i, target in enumerate(targets):
        began = time.perf_counter_ns()
        answer = ask(target)
        times[i] = (time.perf_counter_ns() - began) / 1e3
        answers.append(answer)
    return answers, times


def median(some: Array) -> float:
    """Median of those that are numbers; NaN if none is."""
    some = some[~np.isnan(some)]
    return float(np.median(some)) if len(some) else np.nan


def batch_time(arm: kinseek.Arm, targets: Array) -> float:
    """Processor time of a pose in a batch on one thread, median of `PASSES` [µs]."""
    passes = []
    for _ in range(PASSES):
        began = time.thread_time_ns()
        arm.branches(targets, threads=1)
        passes.append((time.thread_time_ns() - began) / 1e3 / len(targets))
    return float(np.median(passes))


def measure(name: str, count: int, witnessed: int, seed: int, singular: bool = False) -> Row:
    """Measure one arm, against its witness at the first targets, which are anywhere or near singularities and limits."""
    arm = kinseek.load(name)
    joints = singular_joints if singular else random_joints
    targets = plain_fk(arm.chain, joints(arm.chain, count, seed))
    for target in targets[:50]:
        arm.branches(target)  # Whatever compiles or loads does so before the clock runs.
    witness: Callable[[Array], Array] | None = None
    label = "none"
    if name in CLOSED:
        try:
            witness, label = eaik(arm), "EAIK"
        except ImportError:
            label = "EAIK is not installed"
    elif name in OPEN:
        witness, label = restarts(arm, seed + 1), "1,000 restarts"
    other_solver = solver_of("ssik") if name in CLOSED else None
    judge = bundled(name)
    calls, theirs, beside = np.empty((CALLS, count)), np.full(count, np.nan), np.full(count, np.nan)
    numbers, said = np.empty(count, dtype=int), np.zeros(count, dtype=int)
    found: list[Array] = []
    endless = np.zeros(count, dtype=bool)
    lacking: list[int] = []
    extra: list[str] = []
    searched = false = 0
    enough = SWEPT if name in ONE_JOINT else SEARCHED if name in CLOSED else AROUND
    parts = np.array_split(np.arange(count), min(PARTS, count))
    for part in parts:
        for k in range(CALLS):
            mine, calls[k, part] = timed(arm.branches, targets[part])
        for i, branches in zip(part, mine, strict=True):
            good = strict(arm.chain, branches.q, np.broadcast_to(targets[i], (len(branches), 4, 4)))
            if not good.all():
                print(f"  {name}, {i}: {int((~good).sum())} answers that outside FK denies")
                false += int((~good).sum())
            found.append(branches.q[good])
            numbers[i] = len(found[-1])
            endless[i] = branches.sampled
            searched += int(branches.evaluations > enough)
        # Of a continuum there are samples, here and there.
        asked = part[(part < witnessed) & ~endless[part]]
        others, theirs[asked] = timed(witness, targets[asked]) if witness else ([], np.nan)
        for i, told in zip(asked, others, strict=bool(witness)):
            other = told[strict(arm.chain, told, np.broadcast_to(targets[i], (len(told), 4, 4)))]
            gap = apart(other, found[i])
            if len(other) and (not len(found[i]) or gap.min(axis=1).max() > SAME):
                lacking.append(int(i))
            if len(found[i]) and (not len(other) or gap.min(axis=0).max() > SAME):
                values = np.linalg.svd(arm.jacobian(found[i]), compute_uv=False)
                extra.append(f"{i} ({values.min():.1g})")
        if isinstance(other_solver, Solver):
            try:
                said[part], beside[part] = ssik(other_solver, judge, targets[part])
            except (Raised, Gone) as why:
                print(f"  {name}, ssik: {why}")
    if isinstance(other_solver, Solver):
        other_solver.close()
    batch = batch_time(arm, targets)
    if label != "EAIK":
        theirs[:] = np.nan  # A thousand restarts are a witness, and no peer.
    times, least = calls[0], calls.min(axis=0)
    medians = np.array([np.median(times[part]) for part in parts])
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    AtlasIndex(arm.chain, POSE, problem.arrays, SAMPLES)
    builds = []
    for _ in range(3):
        begun = time.perf_counter()
        BranchIndex(problem)
        builds.append((time.perf_counter() - begun) * 1e3)
    return Row(
        arm=name,
        witness=label,
        targets=count,
        witnessed=witnessed,
        lacking=lacking,
        extra=extra,
        false=false,
        answers=float(numbers.mean()),
        fewest=int(numbers.min()),
        median=float(np.median(times)),
        p99=float(np.percentile(times, 99)),
        fastest=float(medians.min()),
        tail=float(np.percentile(least, 99) / np.median(least)),
        of_eaik=float(np.median([m / median(theirs[part]) for m, part in zip(medians, parts, strict=True)])),
        of_ssik=float(np.median([m / median(beside[part]) for m, part in zip(medians, parts, strict=True)])),
        witness_median=median(theirs),
        ssik_median=median(beside),
        ssik_fewer=0 if np.isnan(beside).any() else int((said < numbers).sum()),
        index=float(np.median(builds)),
        structure=arm.structure.word,
        searched=searched,
        batch=batch,
    )


def page(rows: list[Row], singular: bool = False) -> Page:
    """The page."""
    where = "near singularities and limits" if singular else "uniform inside the limits"
    page = Page("Every branch", "benchmarks.branches")
    page.say(
        f"Targets from joint values {where}. Complete: targets at which the witness has no answer inside",
        "the limits that is lacking; extra: targets at which the witness lacks one. Judged by plain NumPy FK to 1e-6 m and",
        "1e-6 rad. Times: `arm.branches(T)` from Python, wall time. All are timed by turns, on a fifth of the targets each;",
        "best fifth: the least of the five medians. p99 and median are of a first call each; of three calls for each target",
        "the least counts in the ratio of both, which is what the target takes, and not what else the machine does.",
        "Batch: processor time of a pose in a batch of all, on one thread. Searched: targets for which a closed form, or",
        "the search of one joint, was not enough.",
        "EAIK's time includes the filter by limits; ssik's is that of the module it builds for an arm, asked for all",
        "answers inside the limits without copies by full turns. In brackets kinseek's median over theirs, of the fifths",
        "the middle one.",
    )
    cells = []
    for row in (row for row in rows if row.arm not in REDUNDANT):
        known = row.witness in ("EAIK", "1,000 restarts")
        complete = percent(row.witnessed - len(row.lacking), row.witnessed) if known else "–"
        other = "–" if np.isnan(row.witness_median) else f"{row.witness_median:.1f} ({row.of_eaik:.2f})"
        ssik = "–" if np.isnan(row.ssik_median) else f"{row.ssik_median:.1f} ({row.of_ssik:.2f})"
        witness = row.witness if row.witnessed == row.targets else f"{row.witness}, first {row.witnessed:,}"
        found = row.arm, row.structure, witness, f"{row.targets:,}", complete, len(row.extra), row.false
        share = f"{100 * row.searched / row.targets:.2f}"
        cells.append(
            (
                *found,
                f"{row.answers:.2f}",
                share,
                *times(row),
                other,
                ssik,
                f"{row.batch:.1f}",
                f"{row.index:.1f}",
            )
        )
    page.table(
        "arm | structure | witness | >targets | >complete % | >extra | >false | >answers, mean | >searched % | >median µs | "
        ">best fifth µs | >p99 µs | >p99 / median | >EAIK µs | >ssik µs | >batch µs | >index ms",
        cells,
    )
    if spare := [row for row in rows if row.arm in REDUNDANT]:
        page.say("Arms with a joint to spare: a spread sample of 50.")
        page.table(
            "arm | >targets | >fewest answers | >median µs | >best fifth µs | >p99 µs | >p99 / median | >index ms",
            [(row.arm, f"{row.targets:,}", row.fewest, *times(row), f"{row.index:.1f}") for row in spare],
        )
    page.head("Lacking")
    page.items((f"{row.arm}: numbers {row.lacking}" for row in rows if row.lacking), "Nothing.")
    page.head("Extra")
    page.say(
        "Targets with an answer that the witness lacks, and the least singular value of the Jacobian at their answers."
    )
    page.items((f"{row.arm}: {', '.join(row.extra)}" for row in rows if row.extra), "Nothing.")
    return page


def times(row: Row) -> tuple[str, str, str, str]:
    """Median, best fifth and p99 [µs], and p99 in parts of the median."""
    return f"{row.median:.1f}", f"{row.fastest:.1f}", f"{row.p99:.1f}", f"{row.tail:.1f} ×"


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, help="names; all of them by default")
    parser.add_argument(
        "--targets",
        type=at_least_one,
        help="targets an arm, each with its witness; by default 20,000, with restarts at the first 1,000",
    )
    parser.add_argument(
        "--singular",
        action="store_true",
        help="targets near singularities and limits; write another page of them",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    writes(parser, "--output", HERE / "branches.md", "page to write")
    options = parser.parse_args()
    rows = []
    for name in options.arms or (*CLOSED, *OPEN, *REDUNDANT):
        count = options.targets or (1000 if name in REDUNDANT else 20_000)
        witnessed = options.targets or (20_000 if name in CLOSED else 1000)
        row = measure(name, count, witnessed, options.seed, options.singular)
        rows.append(row)
        print(
            f"{name:18s} {row.witness}: lacking {len(row.lacking)}, extra {len(row.extra)} of {row.targets}, "
            f"{row.false} false, {row.searched} searched; "
            f"{row.answers:.2f} answers, {row.fewest} at least; {row.median:.1f} µs, best fifth {row.fastest:.1f}, "
            f"p99 {row.p99:.1f}, {row.tail:.1f} times the median; EAIK {row.witness_median:.1f}; "
            f"ssik {row.ssik_median:.1f}, fewer at {row.ssik_fewer}; batch {row.batch:.1f}; "
            f"index {row.index:.1f} ms",
            flush=True,
        )
    page(rows, options.singular).write(options.output)


if __name__ == "__main__":
    main()
