"""Proofs: how often do they succeed, how fast are they, and are they ever wrong?

Unreachable goals come from reachable poses by one of three changes, applied alternately: a random orientation, a position
pushed out by 30 %, and a shift of about 0.15 m with a turn of about 0.5 rad. A goal counts if the nearest pose that the
atlas finds misses it by at least 1 cm or 1°. Times are CPU times of `prove` on one thread, after a first call; the result
of the atlas is given to it. "gate %" is the share of goals that lengths and angles decide before any box; the columns after
it are about the others. With ``--sound N`` every arm instead gets N reachable goals, random, singular and at limits, at
tolerances from 1e-6 to 1e-2. The search of boxes, without help from the atlas, must not call one unreachable.

    python -m benchmarks.proof                       # every arm of the catalog
    python -m benchmarks.proof ur5e panda --goals 300 --gap 0.01
    python -m benchmarks.proof panda iiwa14 gen3 xarm7 --goals 160 --gap 0.01 --seconds 2
    python -m benchmarks.proof --sound 3000
    python -m benchmarks.proof ur5e puma560 --branches 1000

With ``--branches N`` every arm gets N reachable goals, and `isolate` must prove that the list of their solutions is
complete. The time is that of the proof with all solutions given. A goal is "regular" if the Jacobian has no singular value
below 0.02 (lengths in units of the arm's), neither at a solution found nor at the joint values that made the goal.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.proof.progress import ENDED, FOUND
from kinseek.proof.boxes import excluded
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.root_isolation import isolate
from kinseek.robots.catalog import catalog_names
from kinseek.solution import Solution
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline

from .command import arm_name, at_least_one, command

Array = NDArray[np.float64]


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


def measure(
    arm: kinseek.Arm, count: int, gap: float | None, budget: int, seed: int, seconds: float | None = None
) -> str:
    """One row of the table."""
    problems = unreachable(arm, count, seed)
    if not problems:
        return f"{arm.name:24}{arm.dof:4}   no goal out of reach"
    prove(problems[0][0], gap=gap, solution=problems[0][1], budget=100)
    spent, seen, proved = [], [], 0
    for problem, answer in problems:
        start = time.process_time()
        certificate = prove(
            problem, gap=gap, solution=answer, budget=budget, threads=1, deadline=Deadline(seconds)
        )
        spent.append(1e3 * (time.process_time() - start))
        seen.append(certificate.boxes)
        done = certificate.verdict.name == "UNREACHABLE" if gap is None else certificate.gap <= gap * 1.001
        proved += done
    times, boxes = np.array(spent), np.array(seen)
    searched = boxes > 0
    if not searched.any():
        searched[:] = True
    return (
        f"{arm.name:24}{arm.dof:4}{len(problems):7}{100 * proved / len(problems):9.2f}"
        f"{np.median(times):11.3f}{np.quantile(times, 0.99):11.2f}{100 * np.mean(boxes == 0):9.0f}"
        f"{np.median(times[searched]):11.3f}{np.median(boxes[searched]):11.0f}{np.max(boxes):11.0f}"
    )


def sound(arm: kinseek.Arm, count: int, budget: int, seed: int = 0) -> tuple[int, int]:
    """Goals in reach: how many were called unreachable, and how many got a witness."""
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
    return wrong, found


def least_singular(arm: kinseek.Arm, q: Array) -> float:
    """The least singular value of the Jacobian at q, (n,), lengths in units of the arm's reach."""
    step, length = 1e-6, arm.chain.length
    T, ahead, behind = arm.fk(q), arm.fk(q + step * np.eye(arm.dof)), arm.fk(q - step * np.eye(arm.dof))
    slope = (ahead - behind) / (2 * step)
    turn = slope[:, :3, :3] @ T[:3, :3].T
    J = np.column_stack([slope[:, :3, 3] / length, turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]])
    return float(np.linalg.svd(J, compute_uv=False)[-1])


def branches(arm: kinseek.Arm, count: int, seed: int) -> str:
    """One row of the table of complete lists."""
    rng = np.random.default_rng(seed)
    rows = []
    for trial in range(count + 1):
        q = rng.uniform(arm.lower, arm.upper)
        problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
        every = isolate(problem)
        start = time.process_time()
        again = isolate(problem, every.q)
        spent = 1e3 * (time.process_time() - start)
        if trial:
            regular = min(least_singular(arm, each) for each in [q, *every.q])
            rows.append((again.complete, regular > 0.02, spent, again.boxes, len(again.q)))
    complete, regular, times, boxes, found = np.array(rows, dtype=float).T
    kept = regular > 0
    return (
        f"{arm.name:24}{100 * complete.mean():10.1f}{100 * kept.mean():10.1f}{100 * complete[kept].mean():12.2f}"
        f"{np.median(times[kept]):11.2f}{np.quantile(times[kept], 0.99):10.1f}{np.median(boxes[kept]):10.0f}"
        f"{found.mean():9.2f}"
    )


def main() -> None:
    """Print a row an arm."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, help="names; the whole catalog by default")
    parser.add_argument("--goals", type=at_least_one, default=300, help="goals an arm to choose from")
    parser.add_argument("--gap", type=float, help="enclose the nearest pose to this share of its error")
    parser.add_argument("--budget", type=at_least_one, default=5_000_000, help="boxes a goal")
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
    options = parser.parse_args()
    names = options.arms or catalog_names()
    if options.sound:
        wrong = found = 0
        for name in names:
            result = sound(kinseek.load(name), options.sound, min(options.budget, 20_000), options.seed)
            print(
                f"{name:24} called unreachable {result[0]}, witness {result[1]} of {options.sound}",
                flush=True,
            )
            wrong, found = wrong + result[0], found + result[1]
        print(f"all: {wrong} of {options.sound * len(names)} called unreachable, witness for {found}")
        return
    if options.branches:
        print(
            f"{'arm':24}{'all %':>10}{'regular %':>10}{'of these %':>12}"
            f"{'median ms':>11}{'p99 ms':>10}{'boxes':>10}{'answers':>9}"
        )
        for name in names:
            print(branches(kinseek.load(name), options.branches, options.seed), flush=True)
        return
    done = "proved %" if options.gap is None else "closed %"
    print(
        f"{'arm':24}{'dof':>4}{'goals':>7}{done:>9}{'median ms':>11}{'p99 ms':>11}{'gate %':>9}"
        f"{'others ms':>11}{'boxes':>11}{'most':>11}"
    )
    for name in names:
        print(
            measure(
                kinseek.load(name), options.goals, options.gap, options.budget, options.seed, options.seconds
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
