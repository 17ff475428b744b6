"""How much shorter is the fastest motion through poses than the motion along the shortest path?

The arms are redundant for all tasks: whole poses for seven joints; a torch with a free turn, the same with a cone of 0.25
rad, and positions for six and seven joints. Half of the tasks are straight lines through two to four key poses, the others
smooth curves of 150 poses. The accelerations reach the full speed of each joint in 0.2 s. A task counts if the shortest path
is continuous.

    python -m benchmarks.paths.fastest
    python -m benchmarks.paths.fastest --tasks 20
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import kinseek
from benchmarks.command import command
from benchmarks.targets import Array

SIX, SEVEN = ("ur5e", "irb120", "kr6r900", "lite6"), ("panda", "iiwa14", "gen3", "rizon4")
KINDS = {"pose": SEVEN, "free turn": SIX + SEVEN, "position": SIX + SEVEN, "cone": SIX + SEVEN}

TORCH = kinseek.pose([0.1, 0.0, 0.2], rpy=[0.0, np.pi / 4, 0.0])
"""Pose of the torch at the tip."""

FULL_SPEED_IN = 0.2
"""Time in which a joint reaches its full speed [s]."""


class Task(NamedTuple):
    """Poses to pass as fast as possible."""

    kind: str
    arm: kinseek.Arm
    goal: kinseek.Goal
    acceleration: Array
    """(n,)"""
    shortest: kinseek.Path
    """The shortest path, continuous."""


def tasks(count: int, seed: int = 0) -> Iterator[Task]:
    """Tasks of each kind in turn; the same for the same seed."""
    rng, made = np.random.default_rng(seed), 0
    while made < count:
        kind = list(KINDS)[made % len(KINDS)]
        arm = kinseek.load(str(rng.choice(KINDS[kind])))
        low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
        first = arm.fk((low + high) / 2 + 0.3 * (high - low) * rng.uniform(-1, 1, arm.dof))
        torch = TORCH if kind in ("free turn", "cone") else np.eye(4)
        poses = (_lines, _curve)[made // len(KINDS) % 2](first @ torch, arm.chain.length, rng)
        if not 20 <= len(poses) <= 400:
            continue
        goal = _goal(kind, poses, torch)
        shortest = arm.follow(goal)
        if shortest.success:
            made += 1
            yield Task(kind, arm, goal, arm.velocity / FULL_SPEED_IN, shortest)


def _goal(kind: str, poses: Array, torch: Array) -> kinseek.Goal:
    if kind == "position":
        return kinseek.Goal.position(poses[:, :3, 3])
    if kind == "pose":
        return kinseek.Goal.pose(poses)
    return kinseek.Goal.pose(poses, free="rz", cone=0.25 if kind == "cone" else 0.0, tool=torch)


def _lines(first: Array, length: float, rng: np.random.Generator) -> Array:
    """Straight lines from a pose, through up to three others."""
    keys = [first]
    for _ in range(int(rng.integers(1, 4))):
        place = first[:3, 3] + 0.25 * length * rng.uniform(-1, 1, 3)
        turn = kinseek.pose([0, 0, 0], rotvec=rng.uniform(-0.5, 0.5, 3))[:3, :3]
        keys.append(kinseek.pose(place, rotation=first[:3, :3] @ turn))
    return kinseek.interpolate(np.array(keys), step=0.01, turn=0.04)


def _curve(first: Array, length: float, rng: np.random.Generator) -> Array:
    """A smooth curve from a pose."""
    s = np.linspace(0.0, np.pi, 150)[:, None]

    def waves(size: float) -> Array:
        sums = sum(rng.normal(size=3) * np.sin(h * s + rng.uniform(0, 2 * np.pi, 3)) / h for h in (1, 2, 3))
        return np.asarray(size * (sums - np.asarray(sums)[0]))

    places = first[:3, 3] + waves(0.15 * length)
    turns = [kinseek.pose([0, 0, 0], rotvec=row)[:3, :3] for row in waves(0.3)]
    rows = zip(places, turns, strict=True)
    return np.array([kinseek.pose(place, rotation=first[:3, :3] @ turn) for place, turn in rows])


class Outcome(NamedTuple):
    """The fastest motion of a task."""

    share: float
    """Its duration, relative to that of the shortest path."""
    effort: float
    """Processor time of the path, relative to that of the shortest path."""


def outcome(task: Task) -> Outcome:
    """Find the fastest motion of a task."""
    began = time.process_time()
    task.arm.follow(task.goal)
    middle = time.process_time()
    path = task.arm.follow(task.goal, cost="time", acceleration=task.acceleration).require()
    effort = (time.process_time() - middle) / (middle - began)
    before, after = (one.timed(acceleration=task.acceleration).duration for one in (task.shortest, path))
    return Outcome(after / before, effort)


def main() -> None:
    """Print the durations of each kind of task."""
    options = command(__file__, __doc__, tasks=(200, 20, "tasks")).options()
    found: dict[str, list[Outcome]] = {}
    for task in tasks(options.tasks):
        found.setdefault(task.kind, []).append(outcome(task))
    found["all"] = [one for some in found.values() for one in some]
    print("kind        tasks  longer  median   10 %   90 %  effort  largest")
    for kind, some in found.items():
        share, effort = np.array(some).T
        low, middle, high = np.quantile(share, [0.1, 0.5, 0.9])
        print(
            f"{kind:10} {len(some):6} {(share > 1.0).sum():7} {middle:7.3f} {low:6.3f} {high:6.3f}"
            f" {np.median(effort):7.1f} {effort.max():8.1f}"
        )


if __name__ == "__main__":
    main()
