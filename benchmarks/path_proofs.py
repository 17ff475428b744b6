"""Proofs of paths: how many are certified, how long it takes, and is a path with a jump ever certified?

Made paths: random smooth curves of joint values, four harmonics, 1,000 poses, drawn until the least singular value of the
Jacobian stays above 0.05 of the largest. They are followed from their poses, and every step is proved. Planted jumps: at
one pose of such a path the joint values are replaced by those of another branch. On half of the paths this is the nearest
other branch of all poses, which may be nearer than any `max_step`; on the others it is one of any pose. Further paths for
jumps use 90 % of the ranges and come near singularities and limits. For redundant arms a jump is another solution more than
1 rad away in some joint. Times are wall times of one thread.

    python -m benchmarks.path_proofs                      # writes benchmarks/path_proofs.md
    python -m benchmarks.path_proofs ur5e panda --paths 10 --jumps 20
    python -m benchmarks.path_proofs --quick              # a few of each, printed and not written
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Goal, Problem
from kinseek.branches.index import constraint_jacobian
from kinseek.paths.certify import prove_rows
from kinseek.support.turns import TURN

from .command import at_least_one, command, writes
from .page import Page

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

ARMS = ("ur5e", "puma560", "irb120", "kr6r900", "jaco2_6", "panda", "iiwa14", "gen3", "xarm7", "rizon4")

POSES, HARMONICS, WIDE, OFF = 1000, 4, 0.9, 0.05
"""Poses and harmonics of a made path, the share of the ranges that a wide one uses, and how far off singularities a calm one
stays."""

FAR = 1.0
"""With joints to spare, how far a jump goes [rad]: nearer answers may be joined by a motion along the path."""


@dataclass(frozen=True)
class Proofs:
    """Made paths of one arm."""

    arm: str
    joints: int
    paths: int
    certified: int
    steps: float
    """Share of all steps that are proved."""
    following: float
    """[µs] a pose, median"""
    proving: float
    """[µs] a pose, median: what prove=True adds"""
    wide: float
    """Share of the steps proved of paths that come near singularities and limits."""
    within: float
    """How far a branch passes by the joint values of a pose, largest [rad]."""


@dataclass(frozen=True)
class Jumps:
    """Paths of one arm with a jump planted in each."""

    arm: str
    planted: int
    small: int
    """Of less than 0.3 rad in every joint."""
    smallest: float
    """[rad]"""
    certified: int
    """Steps into the jump and out of it both proved, where answers are isolated: there must be none."""
    moves: int
    """The same with joints to spare: it is no jump then, the arm goes there along its self-motion between two poses."""


def curve(arm: kinseek.Arm, seed: int, share: float) -> Array:
    """A random smooth curve of joint values, (POSES, n)."""
    rng, s, q = np.random.default_rng(seed), np.linspace(0.0, 1.0, POSES), np.zeros((POSES, arm.dof))
    for h in range(1, HARMONICS + 1):
        a, b = rng.normal(size=(2, arm.dof))
        q += (np.cos(TURN * h * s)[:, None] * a + np.sin(TURN * h * s)[:, None] * b) / h
    low, high = q.min(axis=0), q.max(axis=0)
    half = (arm.upper - arm.lower) / 2
    middle = (arm.lower + arm.upper) / 2 + (1 - share) * half * rng.uniform(-1, 1, arm.dof)
    return np.asarray(middle + share * half * (2 * (q - low) / (high - low) - 1))


def off_singular(arm: kinseek.Arm, q: Array) -> Array:
    """Least singular value of the Jacobian beside the largest, (k,)."""
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    return np.asarray(values[:, -1] / values[:, 0])


def calm(arm: kinseek.Arm, seed: int) -> Array:
    """A curve that stays off singularities."""
    for k in range(2000):
        q = curve(arm, 2000 * seed + k, WIDE * 0.97**k)
        if off_singular(arm, q).min() > OFF:
            return q
    raise RuntimeError(f"{arm.name}: no curve stays {OFF} off singularities")


def measure_proofs(name: str, paths: int) -> Proofs:
    """Follow and prove made paths of one arm."""
    arm = kinseek.load(name)
    arm.follow(arm.fk(calm(arm, 10**6)[:40]), threads=1, prove=True)  # What the arm needs once.
    certified, shares, wide, following, proving, within = 0, [], [], [], [], 0.0
    for seed in range(paths):
        T = arm.fk(calm(arm, seed))
        began = time.perf_counter()
        arm.follow(T, threads=1)
        middle = time.perf_counter()
        path = arm.follow(T, threads=1, prove=True)
        ended = time.perf_counter()
        following.append((middle - began) / POSES * 1e6)
        proving.append((ended - middle) / POSES * 1e6 - following[-1])
        certified += path.certified
        shares.append(path.proved.mean())
        assert path.proof is not None
        within = max(within, float(path.proof.within[np.isfinite(path.proof.within)].max(initial=0.0)))
        q = curve(arm, seed, WIDE)
        problem = Problem(arm.chain, Goal.pose(arm.fk(q)))
        wide.append(prove_rows(problem, q, np.arange(POSES - 1), keep=True).inside.mean())
    return Proofs(
        name,
        arm.dof,
        paths,
        certified,
        float(np.mean(shares)),
        float(np.median(following)),
        float(np.median(proving)),
        float(np.mean(wide)),
        within,
    )


def others(arm: kinseek.Arm, T: Array, q: Array) -> Array:
    """Steps to the other branches of a pose, (k, n)."""
    found = arm.branches(T, count=60) if arm.dof > 6 else arm.branches(T)
    steps = found.q - q
    turns = (arm.upper - arm.lower >= TURN) | np.array([kind == "continuous" for kind in arm.kinds])
    steps = np.where(turns, steps - TURN * np.round(steps / TURN), steps)
    least = FAR if arm.dof > 6 else 1e-6
    return np.asarray(steps[np.abs(steps).max(axis=1) > least])


def measure_jumps(name: str, jumps: int) -> Jumps:
    """Plant jumps, and try to prove that there are none."""
    arm = kinseek.load(name)
    planted = small = certified = moves = 0
    smallest, seed = np.inf, 0
    while planted < jumps:
        seed += 1
        rng = np.random.default_rng(seed)
        q = curve(arm, seed, WIDE) if seed % 2 else calm(arm, seed)
        T = arm.fk(q)
        near = np.argsort(off_singular(arm, q))
        poses = rng.choice(near[:20], 2) if seed % 4 < 2 else rng.integers(1, POSES - 1, 2)
        choice = [(int(i), step) for i in poses if 0 < i < POSES - 1 for step in others(arm, T[i], q[i])]
        if not choice:
            continue
        i, step = min(choice, key=lambda each: float(np.abs(each[1]).max()))
        jumped = q.copy()
        jumped[i] += step
        state = prove_rows(Problem(arm.chain, Goal.pose(T)), jumped, np.arange(POSES - 1), keep=True)
        planted += 1
        small += bool(np.abs(step).max() < 0.3)
        smallest = min(smallest, float(np.abs(step).max()))
        both = bool(state.inside[i - 1] and state.inside[i])
        certified += both and arm.dof <= 6
        moves += both and arm.dof > 6
    return Jumps(name, planted, small, smallest, certified, moves)


def page(proofs: list[Proofs], jumps: list[Jumps]) -> Page:
    """The page."""
    page = Page("Proofs of paths", "benchmarks.path_proofs")
    page.say(
        f"Made paths of {POSES:,} poses and {HARMONICS} harmonics that stay {OFF} off singularities, followed with and",
        f"without `prove=True`. Wide: the share of steps that are proved of paths of {WIDE:.0%} of the ranges, which come",
        "near singularities. Within: how far the exact branch passes by the joint values of a pose at most.",
    )
    page.table(
        "arm | >joints | >paths | >certified | >steps proved | >wide | >µs a pose to follow | >to prove | >within, rad",
        [
            (
                p.arm,
                p.joints,
                p.paths,
                p.certified,
                f"{p.steps:.2%}",
                f"{p.wide:.1%}",
                f"{p.following:.0f}",
                f"{p.proving:.0f}",
                f"{p.within:.1e}",
            )
            for p in proofs
        ],
    )
    page.head("Planted jumps")
    page.say(
        "Self-motions: with joints to spare another answer to a pose may be joined to the first by a motion, and a step",
        "that makes it is proved; a path with such a step is not certified, since it is longer than `max_step`.",
    )
    page.table(
        "arm | >paths | >jumps below 0.3 rad | >smallest, rad | >certified | >self-motions",
        [(j.arm, j.planted, j.small, f"{j.smallest:.1e}", j.certified, j.moves) for j in jumps],
    )
    return page


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", help=f"names or files; {', '.join(ARMS)} by default")
    parser.add_argument("--paths", type=at_least_one, default=100, help="made paths an arm")
    parser.add_argument("--jumps", type=at_least_one, default=100, help="paths with a jump an arm")
    parser.add_argument("--quick", action="store_true", help="a few of each; nothing is written")
    writes(parser, "--output", HERE / "path_proofs.md", "page to write")
    options = parser.parse_args()
    paths, jumps = (2, 10) if options.quick else (options.paths, options.jumps)
    proofs, planted = [], []
    for name in options.arms or ARMS:
        proofs.append(measure_proofs(name, paths))
        print(proofs[-1], flush=True)
        planted.append(measure_jumps(name, jumps))
        print(planted[-1], flush=True)
    if not options.quick:
        page(proofs, planted).write(options.output)


if __name__ == "__main__":
    main()
