"""Branches: is the list complete, and how long does it take?

The column *witness* names a second method that finds solutions, against which completeness is measured. Arms with a closed
form are compared with EAIK, filtered by the limits, at 20,000 targets. Other arms are compared with 1,000 random restarts of
a Levenberg-Marquardt search at each of the first 1,000 targets. Solutions count only if plain NumPy forward kinematics
confirms them within 1e-6 m and 1e-6 rad and inside the limits. Two solutions are the same if no joint differs by 1e-3 rad
modulo 2π. The targets are divided into fifths. All solvers are timed on the same fifth, one directly after the other, and
then on the next, so that a change of the machine's speed affects all of them.

- **complete %**: targets at which `arm.branches` has every solution of the witness inside the limits. *First 1,000* in the
  column *witness* means that only these targets are compared.
- **extra**: number of targets at which the witness misses a solution. **false**: number of wrong solutions.
- **searched %**: targets for which the closed form, or the search of one joint, did not suffice.
- **median µs**, **p99 µs**: wall time of one call `arm.branches(T)` from Python, the first call for each target. **best
  fifth µs**: the least of the medians of the fifths.
- **p99 / median**: 99th percentile divided by median, both of the least time of three calls for each target, so that other
  work on the machine counts less.
- **EAIK µs**, **ssik µs**: medians of the other solvers. The time of EAIK includes the filter by limits. ssik runs the
  module that it builds for an arm, in an environment of its own that is made at the first run, and returns all solutions
  inside the limits without copies by full turns. In brackets: the median of kinseek divided by theirs, for the middle one of
  the fifths.
- **batch µs**: processor time for a pose in a batch of all targets, on one thread.
- **index ms**: time to compute the data that are computed once for an arm.

    python -m benchmarks.branches                 # writes benchmarks/branches.md; uses EAIK if it is installed
    python -m benchmarks.branches ur5e jaco2_6 --targets 1000
    python -m benchmarks.branches jaco2_6 irb5400 mpx3500 --targets 2500 --output random.md
    python -m benchmarks.branches jaco2_6 irb5400 mpx3500 --targets 1300 --singular --output singular.md
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.branches.index import BranchIndex
from kinseek.goal import Goal
from kinseek.kinds import POSE
from kinseek.problem import Problem
from kinseek.solvers.atlas.index import SAMPLES, AtlasIndex
from kinseek.support.transforms import square

from .command import at_least_one, command
from .field.adapters import adapter, path_of
from .field.protocol import Arm as ArmOfField
from .page import Page, Row, share
from .targets import Array, plain_fk, random_joints, singular_joints, strict
from .timing import batch_cost, timed
from .workers.process import called_solver

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


@dataclass
class Found:
    """What is found for the targets of one arm."""

    misses: list[int]
    """Targets at which the witness has a solution that kinseek misses."""
    extra: list[str]
    """Targets at which the witness misses a solution, with the least singular value of the Jacobian at their solutions."""
    numbers: Array
    """Of solutions, (k,)."""
    calls: Array
    """Times of calls [µs], (CALLS, k)."""
    theirs: Array
    """Times of the witness [µs], (k,); NaN where it was not asked."""
    beside: Array
    """Times of ssik [µs], (k,)."""
    searched: int = 0
    """Targets for which the closed form, or the search of one joint, did not suffice."""
    false: int = 0
    """Wrong solutions."""


def apart(a: Array, b: Array) -> Array:
    """Largest joint differences modulo 2π of all pairs, (k, n) and (l, n) -> (k, l)."""
    gap = a[:, None] - b[None]
    return np.asarray(np.abs((gap + np.pi) % (2 * np.pi) - np.pi).max(axis=-1, initial=0.0))


def eaik(arm: kinseek.Arm) -> Callable[[Array], Array]:
    """All of EAIK's exact answers inside the limits, (k, n), as a function of the target.

    It gets the axes of the arm as it is given: maps, for example, turn the base of an arm.

    Raises:
        ImportError: EAIK is not installed.
    """
    chain = arm.chain
    at_zero = np.array(list(accumulate(map(square, chain.fixed), np.matmul)))
    axes, points = at_zero[:-1, :3, 2] * chain.multiplier[:, None], at_zero[:-1, :3, 3]
    names = arm.name, "", arm.base, arm.tip, tuple(arm.joint_names), tuple(arm.kinds)
    asked = ArmOfField(*names, arm.lower, arm.upper, axes, points, home=at_zero[-1], follows=False)
    solve: Any = adapter(path_of("eaik")).load(asked, {})
    return lambda target: np.array(solve.branches(target)).reshape(-1, arm.dof).clip(arm.lower, arm.upper)


def ssik(arm: kinseek.Arm, targets: Array) -> tuple[Any, Array] | str:
    """How many answers ssik has to each target, and its times [µs]; or why it has none."""
    found = called_solver(arm.name, "ssik", SSIK, "branches", targets, 300.0)
    if isinstance(found, str):
        return found
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


def witness_of(name: str, arm: kinseek.Arm, seed: int) -> tuple[Callable[[Array], Array] | None, str]:
    """Another method that finds solutions of an arm, if there is one, and its name."""
    if name in OPEN:
        return restarts(arm, seed), "1,000 restarts"
    if name not in CLOSED:
        return None, "none"
    try:
        return eaik(arm), "EAIK"
    except ImportError:
        return None, "EAIK is not installed"


def compared(found: Found, arm: kinseek.Arm, i: int, target: Array, ours: Array, theirs: Array) -> None:
    """Compare the solutions of one target, (k, n), with those of the witness, (l, n), that are right."""
    other = theirs[strict(arm.chain, theirs, np.broadcast_to(target, (len(theirs), 4, 4)))]
    gap = apart(other, ours)
    if len(other) and (not len(ours) or gap.min(axis=1).max() > SAME):
        found.misses.append(i)
    if len(ours) and (not len(other) or gap.min(axis=0).max() > SAME):
        found.extra.append(f"{i} ({np.linalg.svd(arm.jacobian(ours), compute_uv=False).min():.1g})")


def find(
    name: str,
    targets: Array,
    parts: list[NDArray[np.int64]],
    witness: Callable[[Array], Array] | None,
    witnessed: int,
) -> Found:
    """Find all solutions of the targets, part by part, by turns with the witness and with ssik."""
    arm, count = kinseek.load(name), len(targets)
    for target in targets[:50]:
        arm.branches(target)  # Whatever compiles or loads does so before the clock runs.
    empty = np.full(count, np.nan)
    found = Found([], [], np.empty(count, dtype=int), np.empty((CALLS, count)), empty, empty.copy())
    enough = SWEPT if name in ONE_JOINT else SEARCHED if name in CLOSED else AROUND
    for part in parts:
        for k in range(CALLS):
            mine, found.calls[k, part] = timed(arm.branches, targets[part])
        right = {}
        for i, branches in zip(part.tolist(), mine, strict=True):
            good = strict(arm.chain, branches.q, np.broadcast_to(targets[i], (len(branches), 4, 4)))
            found.false += int((~good).sum())
            found.numbers[i], right[i] = good.sum(), branches.q[good]
            found.searched += int(branches.evaluations > enough)
        # Of a continuum there are samples, here and there.
        asked = [i for i, each in zip(part.tolist(), mine, strict=True) if i < witnessed and not each.sampled]
        if witness is not None:
            others, found.theirs[asked] = timed(witness, targets[asked])
            for i, theirs in zip(asked, others, strict=True):
                compared(found, arm, i, targets[i], right[i], theirs)
        if name not in CLOSED:
            continue
        beside = ssik(arm, targets[part])
        if isinstance(beside, str):
            print(f"  {name}, ssik: {beside}")
        else:
            said, found.beside[part] = beside
            print(f"  {name}, ssik: fewer answers to {(said < found.numbers[part]).sum()} targets")
    return found


def build_time(arm: kinseek.Arm) -> float:
    """Time to compute what is computed once for an arm [ms], median of three."""
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    AtlasIndex(arm.chain, POSE, problem.arrays, SAMPLES)
    return float(np.median(timed(lambda _: BranchIndex(problem), range(3))[1])) / 1e3


def measure(name: str, options: argparse.Namespace, missing: list[str], extra: list[str]) -> Row:
    """Measure one arm, against its witness at the first targets, which are anywhere or near singularities and limits."""
    arm, spare = kinseek.load(name), name in REDUNDANT
    count = options.targets or (1000 if spare else 20_000)
    witnessed = options.targets or (20_000 if name in CLOSED else 1000)
    joints = singular_joints if options.singular else random_joints
    targets = plain_fk(arm.chain, joints(arm.chain, count, options.seed))
    witness, label = witness_of(name, arm, options.seed + 1)
    parts = np.array_split(np.arange(count), min(PARTS, count))
    found = find(name, targets, parts, witness, witnessed)
    missing += [f"{name}: numbers {found.misses}"] * bool(found.misses)
    extra += [f"{name}: {', '.join(found.extra)}"] * bool(found.extra)
    times, least = found.calls[0], found.calls.min(axis=0)
    medians = np.array([np.median(times[part]) for part in parts])
    figures: Row = {
        ">median µs": f"{np.median(times):.1f}",
        ">best fifth µs": f"{medians.min():.1f}",
        ">p99 µs": f"{np.percentile(times, 99):.1f}",
        ">p99 / median": f"{np.percentile(least, 99) / np.median(least):.1f} ×",
    }
    index = {">index ms": f"{build_time(arm):.1f}"}
    if spare:
        fewest = {">fewest solutions": int(found.numbers.min())}
        return {"arm": name, ">targets": f"{count:,}"} | fewest | figures | index
    if label != "EAIK":
        found.theirs[:] = np.nan  # A thousand restarts are a witness, and no peer.
    batch = batch_cost(lambda: arm.branches(targets, threads=1), len(targets), PASSES)
    first = f", first {witnessed:,}" if witness is not None and witnessed < count else ""
    return {
        "arm": name,
        "structure": arm.structure.word,
        "witness": f"{label}{first}",
        ">targets": f"{count:,}",
        ">complete %": share((witnessed - len(found.misses)) / witnessed) if witness else "–",
        ">extra": len(found.extra),
        ">false": found.false,
        ">solutions, mean": f"{found.numbers.mean():.2f}",
        ">searched %": f"{100 * found.searched / count:.2f}",
        **figures,
        ">EAIK µs": beside_of(found.theirs, medians, parts),
        ">ssik µs": beside_of(found.beside, medians, parts),
        ">batch µs": f"{batch:.1f}",
        **index,
    }


def beside_of(peer: Array, medians: Array, parts: list[NDArray[np.int64]]) -> str:
    """Median of a peer's times [µs], and kinseek's median over it, of the parts the middle one."""
    if np.isnan(peer).all():
        return "–"
    ratios = [m / np.nanmedian(peer[part]) for m, part in zip(medians, parts, strict=True)]
    return f"{np.nanmedian(peer):.1f} ({np.median(ratios):.2f})"


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__, arms=(*CLOSED, *OPEN, *REDUNDANT), page="branches.md")
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
    options = parser.options()
    if options.quick:
        options.targets = options.targets or 20
    page, missing, extra = Page("Every branch", "benchmarks.branches", __doc__), list[str](), list[str]()
    where = "near singularities and limits" if options.singular else "uniform inside the limits"
    page.say(f"Targets are poses of joint values {where}.")
    plain = [name for name in options.arms if name not in REDUNDANT]
    page.rows(measure(name, options, missing, extra) for name in plain)
    page.say("Redundant arms: a sample of 50 solutions that are spread over the self-motion.")
    spare = [name for name in options.arms if name in REDUNDANT]
    page.rows(measure(name, options, missing, extra) for name in spare)
    page.head("Missing solutions")
    page.items(missing, "None.")
    page.head("Extra solutions")
    page.say(
        "Numbers of the targets at which the witness misses a solution. In brackets: the least singular value of the "
        "Jacobian at the solutions."
    )
    page.items(extra, "None.")
    page.end(options)


if __name__ == "__main__":
    main()
