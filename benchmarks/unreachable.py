"""What other solvers return for goals that are proved out of reach, in one table.

The goals are those of `benchmarks.proof`: reachable poses with another orientation, pushed out or shifted. They count if it
is proved that no pose of the arm comes within 1 cm and 1°. kinseek proves this (`ik(prove=True)`), and bounds the error of
the nearest pose (`prove(gap=0.05)`). Solvers of `benchmarks.field` get the same goals, each in its own environment, with
the settings named in `SETTINGS`.

    python -m benchmarks.unreachable                     # writes benchmarks/unreachable.md
    python -m benchmarks.unreachable --arms ur5e --goals 60
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.command import ROOT, arm_name, at_least_one, command, writes
from benchmarks.field.adapters import SOLVERS
from benchmarks.field.judge import Judge, bundled
from benchmarks.field.run import Solver, solver_of
from benchmarks.field.tasks import settings_of
from benchmarks.page import Page, row_of
from benchmarks.proof import unreachable
from benchmarks.workers.process import Gone, Raised, releases
from kinseek.kernels.arm.pose_error import judge
from kinseek.problem import Problem
from kinseek.proof.branch_and_bound import prove
from kinseek.solution import Status

Array = NDArray[np.float64]

CENTIMETRE, DEGREE = 0.01, np.radians(1.0)
SETTINGS = {
    "eaik": "recommended",
    "ssik": "sweep 2",
    "optik": "sweep 3",
    "trac_ik": "sweep 3",
    "robotics_toolbox": "sweep 2",
    "pinocchio": "recommended",
}
"""Of each solver, which settings of its adapter: restarts, tolerances below 1e-6; pinocchio's loop as its manual has it."""

SECONDS = 200.0
"""For all goals of an arm."""

NEAREST = 0.05
"""Relative gap to which the nearest pose is enclosed."""


def far_goals(arm: kinseek.Arm, count: int, seed: int) -> tuple[list[Problem], list[float]]:
    """Goals that no pose meets within 1 cm and 1°, by proof, and the weighted error of the nearest pose."""
    problems, nearest = [], []
    for problem, answer in unreachable(arm, count, seed):
        loose = replace(problem.goal, position_tolerance=CENTIMETRE, orientation_tolerance=DEGREE)
        if prove(replace(problem, goal=loose)).verdict.name != "UNREACHABLE":
            continue
        problems.append(problem)
        nearest.append(prove(problem, solution=answer, gap=NEAREST, budget=400_000).upper_bound)
    return problems, nearest


def ours(arm: kinseek.Arm, problems: list[Problem]) -> tuple[Array, Array, Array]:
    """Answers, times [ms], and whether each was proved unreachable."""
    arm.ik(problems[0].goal, prove=True)
    q, times, said = [], [], []
    for problem in problems:
        began = time.perf_counter()
        solution = arm.ik(problem.goal.target, prove=True)
        times.append(1e3 * (time.perf_counter() - began))
        q.append(solution.q)
        said.append(solution.status is Status.PROVED_UNREACHABLE)
    return np.array(q), np.array(times), np.array(said)


def answers(solver: Solver, judge: Judge, poses: Array) -> tuple[Array, Array, Array]:
    """What a solver returns, (k, n), whether it calls that a success (2 or 1), and times [ms]."""
    slice = {"poses": np.concatenate([poses, poses[:5]]), "starts": [], "count": len(poses), "limit": SECONDS}
    label = SETTINGS.get(solver.adapter.stem, "recommended")
    found = solver.ask(judge, label, settings_of(solver.module)[label], "solve", SECONDS, **slice)
    q = np.array(found["q"])
    times, said = np.full(len(poses), np.nan), np.ones(len(poses))
    times[: len(q)], said[: len(q)] = np.array(found["times"]) / 1e3, np.where(found["claimed"], 2, 1)
    return np.concatenate([q, np.full((len(poses) - len(q), q.shape[1]), np.nan)]), said, times


def weighted(problem: Problem, q: Array) -> float:
    """Weighted error of joint values, (n,)."""
    return float(judge(problem.arrays, q[None], problem.goal.targets, problem.goal.arrays)[0, 2])


def row(
    name: str,
    who: str,
    problems: list[Problem],
    nearest: list[float],
    q: Array,
    said: Array,
    times: Array,
    note: str = "",
) -> tuple[str, ...]:
    """One row: what came back, what was said of it, and how far it is from the nearest pose."""
    some, chain = np.isfinite(q).all(axis=1), problems[0].chain
    middle = (chain.lower + chain.upper) / 2
    q = np.where(
        (q < chain.lower) | (q > chain.upper), middle + (q - middle + np.pi) % (2 * np.pi) - np.pi, q
    )
    inside: Any = some & ((q >= chain.lower - 1e-9) & (q <= chain.upper + 1e-9)).all(axis=1)
    ratios = [
        weighted(problem, each) / near
        for problem, near, each, there in zip(problems, nearest, q, inside, strict=True)
        if there
    ]
    share = 100 / len(problems)
    solved, approximate = share * (some & (said == 2)).sum(), share * (some & (said == 1)).sum()
    ratio = (f"{np.median(ratios):.2f}", f"{np.quantile(ratios, 0.9):.2f}") if ratios else ("–", "–")
    shares = (f"{each:.0f}" for each in (share * (~some).sum(), solved, approximate, share * inside.sum()))
    return (name, who, *shares, *ratio, f"{np.median(times):.2f}", f"{np.quantile(times, 0.99):.1f}", note)


def main() -> None:
    """Ask everyone and write the table."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "--arms", nargs="+", type=arm_name, default=("puma560", "ur5e", "kr6r900"), help="names"
    )
    parser.add_argument("--solvers", nargs="+", choices=SOLVERS, default=list(SETTINGS), help="of the field")
    parser.add_argument("--goals", type=at_least_one, default=200, help="goals an arm to choose from")
    parser.add_argument("--seed", type=int, default=7, help="seed of the goals")
    writes(parser, "--output", ROOT / "benchmarks" / "unreachable.md", "page to write")
    options = parser.parse_args()
    began, rows, versions, counts = (
        time.perf_counter(),
        list[tuple[str, ...]](),
        dict[str, str](),
        list[str](),
    )
    solvers = {name: solver_of(name) for name in options.solvers}
    for name in options.arms:
        arm, judge = kinseek.load(name), bundled(name)
        problems, nearest = far_goals(arm, options.goals, options.seed)
        counts.append(f"{len(problems)} for {name}")
        q, times, proved = ours(arm, problems)
        note = f"proved for {100 * proved.mean():.0f} %"
        rows.append(row(name, "**kinseek**", problems, nearest, q, np.ones(len(proved)), times, note))
        poses = np.array([problem.goal.target for problem in problems])
        for who, solver in solvers.items():
            if isinstance(solver, str):
                rows.append((name, who, *"–" * 8, solver[:60]))
                continue
            title = solver.module.NAME
            try:
                found = answers(solver, judge, poses)
            except (Raised, Gone) as why:
                rows.append((name, title, *"–" * 8, str(why)[:60]))
                continue
            versions[title] = solver.version
            rows.append(row(name, title, problems, nearest, *found))
        print("\n".join(map(row_of, rows)), flush=True)
    for solver in solvers.values():
        if isinstance(solver, Solver):
            solver.close()
    minutes = (time.perf_counter() - began) / 60
    page = Page(
        "Goals out of reach",
        "benchmarks.unreachable",
        minutes,
        releases(versions),
    )
    page.say(
        f"For these goals it is proved that no pose comes within 1 cm and 1°: {', '.join(counts)}.",
        "",
        "- **nothing %**: the solver returns no joint values. **“solved” %**, **“not solved” %**: it returns joint values",
        "  and reports a success or a failure.",
        "- **inside limits %**: of the returned joint values, those inside the limits, after whole turns are removed.",
        "- **error over nearest**, **90 %**: weighted error of these joint values divided by that of the nearest pose,",
        f"  median and 90th percentile. A proof encloses the error of the nearest pose to {100 * NEAREST:.0f} % if its",
        "  budget allows.",
        "- **ms**, **99 %**: time of a call, median and 99th percentile. The time of kinseek is that of `ik(prove=True)`,",
        "  proof included.",
        "",
        "Settings: restarts, tolerances below 1e-6 (`SETTINGS` of `benchmarks/unreachable.py`). The loop of pinocchio's",
        "manual does not consider limits.",
    )
    page.table(
        "arm | who | >nothing % | >“solved” % | >“not solved” % | >inside limits % | >error over nearest | >90 % | >ms | "
        ">99 % |",
        rows,
    )
    page.write(options.output)


if __name__ == "__main__":
    main()
