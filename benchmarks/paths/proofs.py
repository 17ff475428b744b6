"""Proofs of paths: how many are certified, how long it takes, and is a path with a jump ever certified?"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.page import Page, Row
from benchmarks.targets import Array
from kinseek import Goal, Problem
from kinseek.derivatives import constraint_jacobian
from kinseek.paths.certify import prove_rows
from kinseek.support.turns import TURN

from .curves import POSES, curve

ARMS = ("ur5e", "puma560", "irb120", "kr6r900", "jaco2_6", "panda", "iiwa14", "gen3", "xarm7", "rizon4")

WIDE, OFF = 0.9, 0.05
"""The share of the ranges that a wide path uses, and how far off singularities a calm one stays."""

FAR = 1.0
"""How far a jump of a redundant arm goes [rad]: nearer solutions may be joined by a motion along the path."""


def proofs(page: Page, options: argparse.Namespace) -> None:
    """Write the section of proofs, and of jumps that are planted."""
    names = [name for name in ARMS if name in options.arms]
    page.head("Proofs of paths")
    page.say(
        f"Made paths that stay {OFF} off singularities (the least singular value of the Jacobian divided by the largest),",
        "followed with and without `prove=True`. Wide: the share of steps that are proved of paths over",
        f"{WIDE:.0%} of the ranges, which come near singularities. Within: how far the exact branch passes by the joint",
        "values of a pose at most. Wall times of one thread.",
    )
    page.rows(_proofs(kinseek.load(name), options.paths) for name in names)
    page.head("Planted jumps")
    page.say(
        "At one pose of such a path the joint values are replaced by those of another branch. On half of the paths this is",
        "the nearest other branch of all poses, which may be nearer than any `max_step`; on the others it is one of any",
        "pose. *Certified* must be 0. *Self-motions*: another solution of a redundant arm may be joined to the first by a",
        f"motion, and a step that makes it is proved; there a jump is a solution more than {FAR:g} rad away in some joint.",
    )
    page.rows(_jumps(kinseek.load(name), options.paths) for name in names)


def off_singular(arm: kinseek.Arm, q: Array) -> Array:
    """Least singular value of the Jacobian divided by the largest, (k,)."""
    problem = Problem(arm.chain, Goal.pose(np.eye(4)))
    values = np.linalg.svd(constraint_jacobian(problem, q), compute_uv=False)
    return np.asarray(values[:, -1] / values[:, 0])


def calm(arm: kinseek.Arm, seed: int) -> Array:
    """A curve that stays off singularities."""
    for k in range(2000):
        q = curve(arm, POSES, 2000 * seed + k, WIDE * 0.97**k, aside=True)
        if off_singular(arm, q).min() > OFF:
            return q
    raise RuntimeError(f"{arm.name}: no curve stays {OFF} off singularities")


def _proved(arm: kinseek.Arm, T: Array, q: Array) -> NDArray[np.bool_]:
    """Which steps of joint values along poses are proved, (POSES - 1,)."""
    problem = Problem(arm.chain, Goal.pose(T))
    return np.asarray(prove_rows(problem, q, np.arange(POSES - 1), keep=True).inside)


def _proofs(arm: kinseek.Arm, paths: int) -> Row:
    arm.follow(arm.fk(calm(arm, 10**6)[:40]), threads=1, prove=True)  # What the arm needs once.
    followed, times, wide, within = [], [], [], 0.0
    for seed in range(paths):
        T = arm.fk(calm(arm, seed))
        began = time.perf_counter()
        arm.follow(T, threads=1)
        middle = time.perf_counter()
        path = arm.follow(T, threads=1, prove=True)
        times.append((middle - began, time.perf_counter() - 2 * middle + began))
        followed.append((path.certified, path.proved.mean()))
        assert path.proof is not None
        within = max(within, float(path.proof.within[np.isfinite(path.proof.within)].max(initial=0.0)))
        q = curve(arm, POSES, seed, WIDE, aside=True)
        wide.append(_proved(arm, arm.fk(q), q).mean())
    following, proving = np.median(times, axis=0) / POSES * 1e6
    certified, steps = np.array(followed).T
    return {
        "arm": arm.name,
        ">joints": arm.dof,
        ">paths": paths,
        ">certified": int(certified.sum()),
        ">steps proved": f"{steps.mean():.2%}",
        ">wide": f"{np.mean(wide):.1%}",
        ">µs a pose to follow": f"{following:.0f}",
        ">to prove": f"{proving:.0f}",
        ">within, rad": f"{within:.1e}",
    }


def others(arm: kinseek.Arm, T: Array, q: Array) -> Array:
    """Steps to the other branches of a pose, (k, n)."""
    found = arm.branches(T, count=60) if arm.dof > 6 else arm.branches(T)
    steps = found.q - q
    turns = (arm.upper - arm.lower >= TURN) | np.array([kind == "continuous" for kind in arm.kinds])
    steps = np.where(turns, steps - TURN * np.round(steps / TURN), steps)
    least = FAR if arm.dof > 6 else 1e-6
    return np.asarray(steps[np.abs(steps).max(axis=1) > least])


def _jumps(arm: kinseek.Arm, jumps: int) -> Row:
    """Plant jumps, and try to prove that there are none."""
    sizes, both, seed = list[float](), 0, 0
    while len(sizes) < jumps:
        seed += 1
        rng = np.random.default_rng(seed)
        q = curve(arm, POSES, seed, WIDE, aside=True) if seed % 2 else calm(arm, seed)
        T = arm.fk(q)
        near = np.argsort(off_singular(arm, q))
        poses = rng.choice(near[:20], 2) if seed % 4 < 2 else rng.integers(1, POSES - 1, 2)
        choice = [(int(i), step) for i in poses if 0 < i < POSES - 1 for step in others(arm, T[i], q[i])]
        if not choice:
            continue
        i, step = min(choice, key=lambda each: float(np.abs(each[1]).max()))
        q[i] += step
        sizes.append(float(np.abs(step).max()))
        both += bool(_proved(arm, T, q)[i - 1 : i + 1].all())
    return {
        "arm": arm.name,
        ">paths": jumps,
        ">jumps below 0.3 rad": int((np.array(sizes) < 0.3).sum()),
        ">smallest, rad": f"{min(sizes):.1e}",
        ">certified": both if arm.dof <= 6 else 0,
        ">self-motions": both if arm.dof > 6 else 0,
    }
