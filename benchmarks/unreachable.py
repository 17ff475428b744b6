"""What other solvers return for goals that are proved out of reach, in one table.

The goals are those of `benchmarks.proof`: reachable poses with another orientation, pushed out or shifted. They count if it
is proved that no pose of the arm comes within 1 cm and 1°. kinseek proves this (`ik(prove=True)`), and bounds the error of
the nearest pose (`prove(gap=0.05)`). Solvers of `benchmarks.field` get the same goals, each in its own environment, with
the settings named in `SETTINGS`: restarts, and tolerances below 1e-6. The loop of pinocchio's manual does not consider
limits.

- **nothing %**: the solver returns no joint values. **“solved” %**, **“not solved” %**: it returns joint values and reports
  a success or a failure.
- **inside limits %**: of the returned joint values, those inside the limits, after whole turns are removed.
- **error over nearest**, **90 %**: weighted error of these joint values divided by that of the nearest pose, median and 90th
  percentile. A proof encloses the error of the nearest pose to 5 % if its budget allows.
- **ms**, **99 %**: time of a call, median and 99th percentile. The time of kinseek is that of `ik(prove=True)`, proof
  included.

    python -m benchmarks.unreachable                     # writes benchmarks/unreachable.md
    python -m benchmarks.unreachable ur5e --goals 60
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.kernels.arm.pose_error import judge
from kinseek.problem import Problem
from kinseek.proof.branch_and_bound import prove
from kinseek.solution import Status

from .command import command
from .field.adapters import SOLVERS, adapter, path_of
from .field.tasks import settings_of
from .page import Page, Row
from .proof import unreachable
from .targets import Array
from .timing import timed
from .workers.process import called_solver, releases

ARMS = ("puma560", "ur5e", "kr6r900")

CENTIMETRE, DEGREE = 0.01, np.radians(1.0)
SETTINGS = {
    "eaik": "recommended",
    "ssik": "sweep 2",
    "optik": "sweep 3",
    "trac_ik": "sweep 3",
    "robotics_toolbox": "sweep 2",
    "pinocchio": "recommended",
}
"""Of each solver, which settings of its adapter."""

SECONDS = 200.0
"""For all goals of an arm."""

NEAREST = 0.05
"""Relative gap to which the nearest pose is enclosed."""

Far = list[tuple[Problem, float]]
"""Goals, each with the weighted error of the nearest pose."""


class Returned(NamedTuple):
    """What a solver returns for k goals."""

    q: Array
    """(k, n), NaN where there is nothing."""
    claimed: NDArray[np.bool_]
    """Whether the solver reports a success, (k,)."""
    times: Array
    """[ms], (k,)"""
    note: str = ""


def far_goals(arm: kinseek.Arm, count: int, seed: int) -> Far:
    """Goals that no pose meets within 1 cm and 1°, by proof."""
    found = []
    for problem, answer in unreachable(arm, count, seed):
        loose = replace(problem.goal, position_tolerance=CENTIMETRE, orientation_tolerance=DEGREE)
        if prove(replace(problem, goal=loose)).verdict.name == "UNREACHABLE":
            nearest = prove(problem, solution=answer, gap=NEAREST, budget=400_000).upper_bound
            found.append((problem, nearest))
    return found


def by_kinseek(arm: kinseek.Arm, far: Far) -> Returned:
    """Prove each."""
    targets = [problem.goal.target for problem, _ in far]
    arm.ik(targets[0], prove=True)
    found, times = timed(lambda target: arm.ik(target, prove=True), targets)
    proved = np.mean([solution.status is Status.PROVED_UNREACHABLE for solution in found])
    q = np.array([solution.q for solution in found])
    return Returned(q, np.zeros(len(q), bool), times / 1e3, f"proved for {100 * proved:.0f} %")


def by_solver(arm: str, solver: str, far: Far, versions: dict[str, str]) -> Returned | str:
    """Ask a solver of the field, or say why it returns nothing at all; adds its version."""
    poses = np.array([problem.goal.target for problem, _ in far])
    module = adapter(path_of(solver))
    settings = settings_of(module)[SETTINGS.get(solver, "recommended")]
    found = called_solver(arm, solver, settings, "solve", poses, SECONDS)
    if isinstance(found, str):
        return found
    versions[module.NAME] = found["version"]
    q, left = np.array(found["q"], dtype=float), len(poses) - len(found["q"])
    claimed = np.array(found["claimed"]) != 0
    return Returned(
        np.pad(q, ((0, left), (0, 0)), constant_values=np.nan),
        np.pad(claimed, (0, left)),
        np.pad(np.array(found["times"]) / 1e3, (0, left), constant_values=np.nan),
    )


def weighted(problem: Problem, q: Array) -> float:
    """Weighted error of joint values, (n,)."""
    return float(judge(problem.arrays, q[None], problem.goal.targets, problem.goal.arrays)[0, 2])


def row(name: str, who: str, far: Far, found: Returned | str) -> Row:
    """What came back, what was said of it, and how far it is from the nearest pose; or why there is nothing."""
    cells: Row = {"arm": name, "who": who}
    columns = (
        *(">nothing %", ">“solved” %", ">“not solved” %", ">inside limits %"),
        *(">error over nearest", ">90 %", ">ms", ">99 %"),
    )
    if isinstance(found, str):
        return cells | dict.fromkeys(columns, "–") | {"": found[:60]}
    chain, some = far[0][0].chain, np.isfinite(found.q).all(axis=1)
    middle, outside = (chain.lower + chain.upper) / 2, (found.q < chain.lower) | (found.q > chain.upper)
    q = np.where(outside, middle + (found.q - middle + np.pi) % (2 * np.pi) - np.pi, found.q)
    inside = np.asarray(some & ((q >= chain.lower - 1e-9) & (q <= chain.upper + 1e-9)).all(axis=1))
    ratios = [
        weighted(problem, each) / nearest
        for (problem, nearest), each, there in zip(far, q, inside, strict=True)
        if there
    ]
    shares = (~some, some & found.claimed, some & ~found.claimed, inside)
    figures = (
        *(f"{100 * each.mean():.0f}" for each in shares),
        *(f"{np.quantile(ratios, level):.2f}" if ratios else "–" for level in (0.5, 0.9)),
        *(f"{np.nanmedian(found.times):.2f}", f"{np.nanquantile(found.times, 0.99):.1f}"),
    )
    return cells | dict(zip(columns, figures, strict=True)) | {"": found.note}


def asked(name: str, far: Far, solvers: list[str], versions: dict[str, str]) -> Iterator[Row]:
    """A row of kinseek, and one of each solver."""
    yield row(name, "**kinseek**", far, by_kinseek(kinseek.load(name), far))
    for solver in solvers:
        yield row(name, adapter(path_of(solver)).NAME, far, by_solver(name, solver, far, versions))


def main() -> None:
    """Ask everyone and write the table."""
    parser = command(
        __file__,
        __doc__,
        arms=ARMS,
        page="unreachable.md",
        goals=(200, 20, "goals an arm to choose from"),
    )
    parser.add_argument("--solvers", nargs="*", choices=SOLVERS, default=list(SETTINGS), help="of the field")
    parser.add_argument("--seed", type=int, default=7, help="seed of the goals")
    options = parser.options()
    page, versions = Page("Goals out of reach", "benchmarks.unreachable", __doc__), dict[str, str]()
    far = {name: far_goals(kinseek.load(name), options.goals, options.seed) for name in options.arms}
    page.say("Goals: " + ", ".join(f"{len(each)} for {name}" for name, each in far.items()) + ".")
    page.rows(line for name, each in far.items() for line in asked(name, each, options.solvers, versions))
    page.note = releases(versions)
    page.end(options)


if __name__ == "__main__":
    main()
