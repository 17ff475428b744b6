"""Poses to follow: those of smooth curves of joint values, and lines, circles and rasters somewhere in reach."""

from __future__ import annotations

import numpy as np

import kinseek
from benchmarks.targets import Array, plain_fk, pose_errors

POSES, HARMONICS, SHARE, WITHIN = 1000, 4, 0.98, 1.5
"""Poses and harmonics of a curve, the share of the ranges that it uses, and how much larger a step may be than its."""

TASK_ARMS, KINDS, LARGEST = ("ur5e", "panda"), ("line", "circle", "raster"), 0.2
"""Arms of the tasks, the tasks, and the largest step there [rad]."""


def curve(
    arm: kinseek.Arm,
    count: int,
    seed: int,
    share: float = SHARE,
    aside: bool = False,
    harmonics: int = HARMONICS,
) -> Array:
    """A random smooth curve of joint values, (count, n).

    Args:
        arm: The arm.
        count: Poses.
        seed: Of the harmonics.
        share: Of the ranges of the joints.
        aside: Whether it lies anywhere in the ranges, and not around their middle.
        harmonics: How many the curve has.
    """
    rng, s, q = np.random.default_rng(seed), np.linspace(0.0, 1.0, count), np.zeros((count, arm.dof))
    for h in range(1, harmonics + 1):
        a, b = rng.normal(size=(2, arm.dof))
        q += (np.cos(2 * np.pi * h * s)[:, None] * a + np.sin(2 * np.pi * h * s)[:, None] * b) / h
    low, high = q.min(axis=0), q.max(axis=0)
    middle, half = (arm.lower + arm.upper) / 2, (arm.upper - arm.lower) / 2
    if aside:
        middle = middle + (1 - share) * half * rng.uniform(-1, 1, arm.dof)
    return np.asarray(middle + share * half * (2 * (q - low) / (high - low) - 1))


def holds(arm: kinseek.Arm, path: kinseek.Path, T: Array) -> bool:
    """Does the path keep what it says: the poses to 1e-6, by plain FK, and the limits?"""
    place, turn = pose_errors(plain_fk(arm.chain, path.q), T)
    endless = np.array([kind == "continuous" for kind in arm.chain.kinds])
    inside = ((path.q >= arm.lower) & (path.q <= arm.upper) | endless).all()
    return bool(inside and (place <= 1e-6).all() and (turn <= 1e-6).all())


def placement(arm: kinseek.Arm, kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Poses of one task somewhere in the arm's reach, all reachable, and the joint values that made the first, (n,)."""
    while True:
        q0 = rng.uniform(arm.lower, arm.upper)
        T0 = arm.fk(q0)
        if kind == "line":
            way = rng.normal(size=3)
            offsets = np.linspace(0, 0.4, 500)[:, None] * way / np.linalg.norm(way)
        elif kind == "circle":
            angle = np.linspace(0, 2 * np.pi, 500)
            offsets = 0.15 * np.stack([np.cos(angle) - 1, np.sin(angle), 0 * angle], axis=1) @ T0[:3, :3].T
        else:
            rows = []
            for k, y in enumerate(np.linspace(0, 0.15, 11)):
                x = np.linspace(0, 0.25, 182 if k < 9 else 181)
                rows += [(each, y, 0.0) for each in (x if k % 2 == 0 else x[::-1])]
            offsets = np.array(rows) @ T0[:3, :3].T
        T = np.repeat(T0[None], len(offsets), axis=0)
        T[:, :3, 3] += offsets
        goal = goal_of(kind, T)
        if arm.ik(goal.at(T[::25])).success.all() and arm.ik(goal).success.all():
            return T, q0


def placements(arm: kinseek.Arm, kinds: list[str], seed: int) -> tuple[Array, Array]:
    """Poses of tasks of as many poses each, (P, N, 4, 4), and the joint values that made each, (P, n)."""
    rng = np.random.default_rng(seed)
    paths, starts = zip(*(placement(arm, kind, rng) for kind in kinds), strict=True)
    return np.array(paths), np.array(starts)


def goal_of(kind: str, T: Array) -> kinseek.Goal:
    """What a task asks for: on a raster the turn about the tool is free."""
    return kinseek.Goal.pose(T, free="rz" if kind == "raster" else ())
