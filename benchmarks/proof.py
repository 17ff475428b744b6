"""Proofs: how often do they succeed, how fast are they, and are they ever wrong?

Unreachable goals come from reachable poses by one of three changes, applied alternately: a random orientation, a position
pushed out by 30 %, and a shift of about 0.15 m with a turn of about 0.5 rad. A goal counts if the nearest pose that the
atlas finds misses it by at least 1 cm or 1°. Times are CPU times of `prove` on one thread, after a first call; the result
of the atlas is given to it. "gate %" is the share of goals that lengths and angles decide before any box; the columns after
it are about the others. With ``--sound N`` every arm instead gets N reachable goals, random, singular and at limits, at
tolerances from 1e-6 to 1e-2. The search of boxes, without help from the atlas, must not call one unreachable.

With ``--branches N`` every arm gets N reachable goals, and `isolate` must prove that the list of their solutions is
complete. The time is that of the proof with all solutions given. A goal is "regular" if the Jacobian has no singular value
below 0.02 (lengths in units of the arm's), neither at a solution found nor at the joint values that made the goal.

    python -m benchmarks.proof                       # every arm of the catalog
    python -m benchmarks.proof ur5e panda --goals 300 --gap 0.01
    python -m benchmarks.proof panda iiwa14 gen3 xarm7 --goals 160 --gap 0.01 --seconds 2
    python -m benchmarks.proof --sound 3000
    python -m benchmarks.proof ur5e puma560 --branches 1000
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.proof.progress import ENDED, FOUND
from kinseek.proof.boxes import excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.root_isolation import isolate
from kinseek.solution import Solution
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline

from .command import at_least_one, command
from .page import Page, Row
from .targets import Array
from .timing import cpu


def changed_poses(arm: kinseek.Arm, count: int, seed: int = 0) -> Iterator[Array]:
    """Poses of which many are out of reach, (4, 4) each."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        T = arm.fk(rng.uniform(arm.lower, arm.upper))
        if i % 3 == 0:
            T[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
        elif i % 3 == 1:
            T[:3, 3] *= 1.3
        else:
            T[:3, 3] += rng.normal(size=3) * 0.1
            T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(rng.normal(size=3) * 0.3).as_matrix()
        yield T


def unreachable(arm: kinseek.Arm, count: int, seed: int = 0) -> list[tuple[Problem, Solution]]:
    """Problems that the atlas misses by 1 cm or 1°, with its best effort."""
    found = []
    for T in changed_poses(arm, count, seed):
        problem = Problem(arm.chain, Goal.pose(T))
        answer = Atlas().solve(problem)
        if answer.position_error >= 0.01 or answer.orientation_error >= np.radians(1):
            found.append((problem, answer))
    return found


def measure(arm: kinseek.Arm, options: argparse.Namespace) -> Row:
    """One row of the table."""
    problems, gap = unreachable(arm, options.goals, options.seed), options.gap
    done, seconds = "proved %" if gap is None else "closed %", options.seconds
    row: Row = {"arm": arm.name, ">dof": arm.dof, ">goals": len(problems)}
    columns = f">{done}", ">median ms", ">p99 ms", ">gate %", ">others ms", ">boxes", ">most"
    if not problems:
        return row | dict.fromkeys(columns, "–")
    prove(problems[0][0], gap=gap, solution=problems[0][1], budget=100)
    spent, seen, proved = [], [], 0
    for problem, answer in problems:
        limits = {"budget": options.budget, "threads": 1, "deadline": Deadline(seconds)}
        took, certificate = cpu(partial(prove, problem, gap=gap, solution=answer, **limits))
        spent.append(1e3 * took)
        seen.append(certificate.boxes)
        done = certificate.verdict.name == "UNREACHABLE" if gap is None else certificate.gap <= gap * 1.001
        proved += bool(done)
    times, boxes = np.array(spent), np.array(seen)
    searched = boxes > 0
    if not searched.any():
        searched[:] = True
    figures = (
        *(
            f"{100 * proved / len(problems):.2f}",
            f"{np.median(times):.3f}",
            f"{np.quantile(times, 0.99):.2f}",
        ),
        *(f"{100 * np.mean(boxes == 0):.0f}", f"{np.median(times[searched]):.3f}"),
        *(f"{np.median(boxes[searched]):.0f}", f"{np.max(boxes):.0f}"),
    )
    return row | dict(zip(columns, figures, strict=True))


def sound(arm: kinseek.Arm, options: argparse.Namespace) -> Row:
    """Goals in reach: how many were called unreachable, and how many got a witness."""
    count, budget, seed = options.sound, min(options.budget, 20_000), options.seed
    rng, wrong, found = np.random.default_rng(seed), 0, 0
    for trial in range(count):
        q = rng.uniform(arm.lower, arm.upper)
        choice = rng.random(arm.dof)
        q = np.where(choice < 0.1, arm.lower, np.where(choice < 0.2, arm.upper, q))
        if trial % 3 == 0:
            quarter = np.clip(np.round(q / (np.pi / 2)) * np.pi / 2, arm.lower, arm.upper)
            q = np.where(rng.random(arm.dof) < 0.7, quarter, q)
        place, angle = 10.0 ** rng.uniform(-6, -2, 2)
        goal = Goal.pose(arm.fk(q), position_tolerance=place, orientation_tolerance=angle)
        outcome = excluded(Problem(arm.chain, goal), budget).outcome
        wrong += outcome == ENDED
        found += outcome == FOUND
    return {"arm": arm.name, ">goals": count, ">called unreachable": wrong, ">witness": found}


def least_singular(arm: kinseek.Arm, q: Array) -> float:
    """The least singular value of the Jacobian at q, (n,), lengths in units of the arm's reach."""
    J = arm.jacobian(q) / np.repeat([arm.chain.length, 1.0], 3)[:, None]
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def branches(arm: kinseek.Arm, options: argparse.Namespace) -> Row:
    """One row of the table of complete lists."""
    rng = np.random.default_rng(options.seed)
    rows = []
    for trial in range(options.branches + 1):
        q = rng.uniform(arm.lower, arm.upper)
        problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
        every = isolate(problem)
        spent, again = cpu(isolate, problem, every.q)
        if trial:
            regular = min(least_singular(arm, each) for each in [q, *every.q])
            rows.append((again.complete, regular > 0.02, 1e3 * spent, again.boxes, len(again.q)))
    complete, regular, times, boxes, found = np.array(rows, dtype=float).T
    kept = regular > 0
    return {
        "arm": arm.name,
        ">all %": f"{100 * complete.mean():.1f}",
        ">regular %": f"{100 * kept.mean():.1f}",
        ">of these %": f"{100 * complete[kept].mean():.2f}",
        ">median ms": f"{np.median(times[kept]):.2f}",
        ">p99 ms": f"{np.quantile(times[kept], 0.99):.1f}",
        ">boxes": f"{np.median(boxes[kept]):.0f}",
        ">answers": f"{found.mean():.2f}",
    }


def main() -> None:
    """Print a table with a row for each arm."""
    parser = command(
        __file__,
        __doc__,
        arms=(),
        goals=(300, 300, "goals an arm to choose from"),
        budget=(5_000_000, 5_000_000, "boxes a goal"),
    )
    parser.add_argument("--gap", type=float, help="enclose the nearest pose to this share of its error")
    parser.add_argument("--seconds", type=float, help="time a goal; none by default")
    parser.add_argument(
        "--sound", type=at_least_one, metavar="N", help="goals in reach an arm, none to be called unreachable"
    )
    parser.add_argument(
        "--branches",
        type=at_least_one,
        metavar="N",
        help="goals in reach an arm, their answers proved complete",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the goals")
    options = parser.options()
    ask = sound if options.sound else branches if options.branches else measure
    page = Page("Proofs", "benchmarks.proof")
    rows = page.rows(ask(kinseek.load(name), options) for name in options.arms)
    print(page.body)
    if options.sound:
        wrong, found = (sum(int(str(row[column])) for row in rows) for column in list(rows[0])[2:])
        print(f"all: {wrong} of {options.sound * len(rows)} called unreachable, witness for {found}")


if __name__ == "__main__":
    main()
