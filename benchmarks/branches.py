"""Branches: is the list complete, and how long does it take?

Arms with a closed form are compared with EAIK, filtered by the limits, at 20,000 targets from joint values uniform inside
the limits. Other arms are compared with 1,000 random restarts of a Levenberg-Marquardt search at each of the first 1,000
targets. Solutions count only if plain NumPy forward kinematics confirms them within 1e-6 m and 1e-6 rad and inside the
limits. Two solutions are the same if no joint differs by 1e-3 rad modulo 2π. Times are wall times of single calls from
Python, and processor time of batches. The targets are divided into parts. All solvers are timed on the same part, one
directly after the other, and then on the next part, so that a change of the machine's speed affects all of them. Ratios are
those of the parts.

ssik is timed in an environment of its own, see `benchmarks.field`, which is made at the first run.

    python -m benchmarks.branches                 # writes benchmarks/branches.md; uses EAIK if it is installed
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
from .timing import batch_cost, timed
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
"""Evaluations of FK above which a target was searched. A closed form needs fewer: eight candidates, up to 4 steps each."""


PASSES = 7
"""Passes over a batch that is timed."""


CALLS = 3
"""Calls for each target. The least time is that of the call itself; the first is what a user waits for."""


PARTS = 5
"""Parts of the targets: kinseek and its peers are timed alternately."""


SWEPT = 120
"""The same for a search of one joint: at most twelve solutions with up to four steps each, and twins of them."""


AROUND = 400
"""The same for arms that nearly have a closed form, which is solved for poses around the target."""


@dataclass(frozen=True)
class Row:
    """One arm of the table."""

    arm: str
    cells: dict[str, object]
    missing: list[int]
    """Targets at which the witness has a solution that kinseek misses."""
    extra: list[str]
    """Targets at which the witness misses a solution, with the least singular value of the Jacobian at their solutions."""


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


def median(some: Array) -> float:
    """Median of those that are numbers; NaN if none is."""
    some = some[~np.isnan(some)]
    return float(np.median(some)) if len(some) else np.nan


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
    numbers = np.empty(count, dtype=int)
    found: list[Array] = []
    endless = np.zeros(count, dtype=bool)
    missing: list[int] = []
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
                missing.append(int(i))
            if len(found[i]) and (not len(other) or gap.min(axis=0).max() > SAME):
                values = np.linalg.svd(arm.jacobian(found[i]), compute_uv=False)
                extra.append(f"{i} ({values.min():.1g})")
        if isinstance(other_solver, Solver):
            try:
                said, beside[part] = ssik(other_solver, judge, targets[part])
                if (said < numbers[part]).any():
                    print(f"  {name}, ssik: fewer answers to {(said < numbers[part]).sum()} targets")
            except (Raised, Gone) as why:
                print(f"  {name}, ssik: {why}")
    if isinstance(other_solver, Solver):
        other_solver.close()
    batch = batch_cost(lambda: arm.branches(targets, threads=1), len(targets), PASSES)
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
    figures = {
        ">median µs": f"{np.median(times):.1f}",
        ">best fifth µs": f"{medians.min():.1f}",
        ">p99 µs": f"{np.percentile(times, 99):.1f}",
        ">p99 / median": f"{np.percentile(least, 99) / np.median(least):.1f} ×",
    }
    index = {">index ms": f"{np.median(builds):.1f}"}
    if name in REDUNDANT:
        cells = (
            {"arm": name, ">targets": f"{count:,}", ">fewest solutions": int(numbers.min())} | figures | index
        )
        return Row(name, cells, missing, extra)
    if witness is not None and witnessed < count:
        label = f"{label}, first {witnessed:,}"
    cells = {
        "arm": name,
        "structure": arm.structure.word,
        "witness": label,
        ">targets": f"{count:,}",
        ">complete %": percent(witnessed - len(missing), witnessed) if witness else "–",
        ">extra": len(extra),
        ">false": false,
        ">solutions, mean": f"{numbers.mean():.2f}",
        ">searched %": f"{100 * searched / count:.2f}",
    }
    beside_ours = {
        ">EAIK µs": beside_of(theirs, medians, parts),
        ">ssik µs": beside_of(beside, medians, parts),
    }
    return Row(name, cells | figures | beside_ours | {">batch µs": f"{batch:.1f}"} | index, missing, extra)


def beside_of(peer: Array, medians: Array, parts: list[NDArray[np.int64]]) -> str:
    """Median of a peer's times [µs], and kinseek's median over it, of the parts the middle one."""
    if np.isnan(peer).all():
        return "–"
    ratios = [m / median(peer[part]) for m, part in zip(medians, parts, strict=True)]
    return f"{median(peer):.1f} ({np.median(ratios):.2f})"


def page(rows: list[Row], singular: bool = False) -> Page:
    """The page."""
    where = "near singularities and limits" if singular else "uniform inside the limits"
    page = Page("Every branch", "benchmarks.branches")
    page.say(
        f"Targets are poses of joint values {where}. The column *witness* names a second method that finds solutions,",
        "against which completeness is measured. Plain NumPy forward kinematics judges all solutions, to 1e-6 m and 1e-6",
        "rad.",
        "",
        "- **complete %**: targets at which `arm.branches` has every solution of the witness inside the limits.",
        "  *First 1,000* in the column *witness* means that only these targets are compared.",
        "- **extra**: number of targets at which the witness misses a solution. **false**: number of wrong solutions.",
        "- **searched %**: targets for which the closed form, or the search of one joint, did not suffice.",
        "- **median µs**, **p99 µs**: wall time of one call `arm.branches(T)` from Python, the first call for each",
        "  target. **best fifth µs**: the targets are divided into fifths, on which the solvers are measured alternately;",
        "  this is the least of the five medians.",
        "- **p99 / median**: 99th percentile divided by median, both of the least time of three calls for each target, so",
        "  that other work on the machine counts less.",
        "- **EAIK µs**, **ssik µs**: medians of the other solvers. The time of EAIK includes the filter by limits. ssik",
        "  runs the module that it builds for an arm, and returns all solutions inside the limits without copies by full",
        "  turns. In brackets: the median of kinseek divided by theirs, for the middle one of the five fifths.",
        "- **batch µs**: processor time for a pose in a batch of all targets, on one thread.",
        "- **index ms**: time to compute the data that are computed once for an arm.",
    )
    page.rows([row.cells for row in rows if row.arm not in REDUNDANT])
    if spare := [row.cells for row in rows if row.arm in REDUNDANT]:
        page.say("Redundant arms: a sample of 50 solutions that are spread over the self-motion.")
        page.rows(spare)
    page.head("Missing solutions")
    page.items((f"{row.arm}: numbers {row.missing}" for row in rows if row.missing), "Nothing.")
    page.head("Extra solutions")
    page.say(
        "Numbers of the targets at which the witness misses a solution. In brackets: the least singular value of the "
        "Jacobian at the solutions."
    )
    page.items((f"{row.arm}: {', '.join(row.extra)}" for row in rows if row.extra), "Nothing.")
    return page


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
        print(*(f"{column.lstrip('>')} {cell};" for column, cell in row.cells.items()), flush=True)
    page(rows, options.singular).write(options.output)


if __name__ == "__main__":
    main()
