"""Motions in time: kinseek beside toppra, on the same paths.

Each arm follows arcs, half of them with a sharp corner in place of the arc, with the speed limits of its file and
10 rad/s². A motion is *violated* if at one of 10,000 samples a joint exceeds a limit by more than a millionth of it. toppra
gets a cubic spline through the same joint values, with the same parameter, and chooses its grid itself. *toppra that keeps
its limits* gets lower limits, in proportion to its violations, until there is none. Durations are compared path by path.

    python -m benchmarks.trajectories                  # writes benchmarks/trajectories.md
    python -m benchmarks.trajectories ur5e --paths 10
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

import kinseek

from .command import command
from .page import Page, Row
from .targets import Array
from .timing import timed

ARMS = ("ur5e", "panda", "iiwa14", "xarm7", "gen3", "kr6r900", "irb120", "puma560", "ur10e", "so101")

ACCELERATION = 10.0
"""Limit of every joint [rad/s²]."""

JERKS = (1000.0, 200.0)
"""Limits of every joint [rad/s³]."""

DENSE = 10_000
"""Samples of a motion."""

SLACK = 1e-6
"""Share of a limit by which it counts as exceeded."""

TRIALS = 200
"""Random paths that are tried until one is continuous."""


def arc(arm: kinseek.Arm, rng: np.random.Generator, count: int = 150) -> kinseek.Path:
    """A continuous path along a random arc."""

    def poses(q: Array) -> Array:
        T = np.repeat(arm.fk(q)[None], count, axis=0)
        angle = np.linspace(0.0, rng.uniform(0.5, 2.0), count)
        a, b = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        T[:, :3, 3] += 0.15 * ((np.cos(angle) - 1.0)[:, None] * a + np.sin(angle)[:, None] * b)
        return T

    return _followed(arm, rng, poses)


def corner(arm: kinseek.Arm, rng: np.random.Generator) -> kinseek.Path:
    """A continuous path along two lines with a sharp corner."""

    def poses(q: Array) -> Array:
        first, last = (arm.fk(q + 0.3 * rng.normal(size=arm.dof)) for _ in range(2))
        return kinseek.interpolate([first, arm.fk(q), last], step=0.005, turn=0.03)

    return _followed(arm, rng, poses)


def _followed(arm: kinseek.Arm, rng: np.random.Generator, poses: Callable[[Array], Array]) -> kinseek.Path:
    """The first path that is continuous, of poses made from random joint values."""
    for _ in range(TRIALS):
        T = poses(rng.uniform(np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0)))
        # An arm with too few joints follows the positions.
        path = arm.follow(T if arm.dof >= 6 else kinseek.Goal.position(T[:, :3, 3]))
        if path.success:
            return path
    raise AssertionError(f"no continuous path of {arm.name}")


def speeds_of(arm: kinseek.Arm) -> Array:
    """Speed limits of an arm's file, 2 rad/s where there is none, (n,)."""
    return np.where(np.isnan(arm.velocity), 2.0, arm.velocity)


def worst(trajectory: kinseek.Trajectory) -> float:
    """Largest share of a limit that a motion uses at dense samples."""
    t, limits = np.linspace(0.0, trajectory.duration, DENSE), trajectory.limits
    shares = [np.abs(trajectory.velocity(t)) / limits.velocity]
    shares.append(np.abs(trajectory.acceleration(t)) / limits.acceleration)
    if limits.jerk is not None:
        shares.append(np.abs(trajectory.jerk(t)) / limits.jerk)
    return float(max(share.max() for share in shares))


def by_toppra(path: kinseek.Path, velocity: Array, acceleration: Array) -> tuple[float, float, float]:
    """Duration of toppra's motion [s], its largest share of a limit at dense samples, and the time it took [ms]."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.q, axis=0) / velocity, axis=1))])
    began = time.perf_counter()
    limits = [
        toppra.constraint.JointVelocityConstraint(np.stack([-velocity, velocity], axis=1)),
        toppra.constraint.JointAccelerationConstraint(np.stack([-acceleration, acceleration], axis=1)),
    ]
    spline = toppra.SplineInterpolator(s, path.q)
    motion = toppra.algorithm.TOPPRA(
        limits, spline, parametrizer="ParametrizeConstAccel"
    ).compute_trajectory()
    took = (time.perf_counter() - began) * 1e3
    if motion is None:
        return np.nan, np.nan, took
    t = np.linspace(0.0, motion.duration, DENSE)
    share = max(np.abs(motion(t, order) / limit).max() for order, limit in ((1, velocity), (2, acceleration)))
    return float(motion.duration), float(share), took


def kept_by_toppra(path: kinseek.Path, velocity: Array, acceleration: Array) -> float:
    """Duration of toppra's motion with limits lowered until no sample exceeds the given ones [s]."""
    scale = 1.0
    for _ in range(30):
        duration, share, _ = by_toppra(path, velocity * np.sqrt(scale), acceleration * scale)
        if not share * scale > 1.0 + SLACK:
            return duration
        # A little more than in proportion, as the grid changes with the speed.
        scale *= 0.999 / (share * scale)
    return np.nan


def compared(name: str, paths: int, seed: int) -> Row:
    """One arm's motions beside toppra's."""
    arm, rng = kinseek.load(name), np.random.default_rng(seed)
    velocity, acceleration = speeds_of(arm), np.full(arm.dof, ACCELERATION)
    ours, theirs, face, kept, deviation = 0, 0, [], [], []
    for k in range(paths):
        path = (arc, corner)[k % 2](arm, rng)
        motion = path.timed(velocity, acceleration)
        ours += worst(motion) > 1.0 + SLACK
        duration, share, _ = by_toppra(path, velocity, acceleration)
        theirs += share > 1.0 + SLACK
        face.append(motion.duration / duration)
        kept.append(motion.duration / kept_by_toppra(path, velocity, acceleration))
        deviation.append(motion.deviation / true_deviation(motion, path))
    return {
        "arm": name,
        ">paths": paths,
        ">violated": ours,
        ">by toppra": theirs,
        ">duration / toppra's": f"{np.nanmedian(face):.3f}",
        ">/ toppra that keeps its limits": f"{np.nanmedian(kept):.3f}",
        ">worst": f"{np.nanmax(kept):.3f}",
        ">deviation, bound / true": f"{min(deviation):.2f}–{max(deviation):.2f}",
    }


def true_deviation(motion: kinseek.Trajectory, path: kinseek.Path) -> float:
    """Largest distance of the tip from the lines between the poses, at dense samples [m]."""
    t = np.linspace(0.0, motion.duration, DENSE)
    points, ends = motion.tip(t)[:, :3, 3], motion.tip(motion.pose_times)[:, :3, 3]
    i = np.clip(np.searchsorted(motion.pose_times, t, side="right") - 1, 0, len(path) - 2)
    along = ends[i + 1] - ends[i]
    share = ((points - ends[i]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-300)
    return float(np.linalg.norm(points - ends[i] - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1).max())


def with_jerk(name: str, paths: int, seed: int, jerk: float) -> Row:
    """One arm's motions with limits of jerk."""
    arm, rng = kinseek.load(name), np.random.default_rng(seed)
    velocity, violated, ratios, times = speeds_of(arm), 0, [], []
    for k in range(paths):
        path = (arc, corner)[k % 2](arm, rng)
        free = path.timed(velocity, ACCELERATION)
        began = time.perf_counter()
        motion = path.timed(velocity, ACCELERATION, jerk)
        times.append((time.perf_counter() - began) * 1e3)
        violated += worst(motion) > 1.0 + SLACK
        ratios.append(motion.duration / free.duration)
    return {
        "arm": name,
        ">jerk rad/s³": f"{jerk:g}",
        ">paths": paths,
        ">violated": violated,
        ">duration / without": f"{np.median(ratios):.3f}",
        ">worst": f"{max(ratios):.3f}",
        ">ms": f"{np.median(times):.1f}",
    }


def median(work: Callable[[], object], repeats: int = 5) -> float:
    """Median wall time of some calls [ms]."""
    return float(np.median(timed(lambda _: work(), range(repeats))[1])) / 1e3


def long_path(name: str, count: int, seed: int) -> Row:
    """Time for a path of many poses."""
    arm = kinseek.load(name)
    path = arc(arm, np.random.default_rng(seed), count)
    velocity, acceleration = speeds_of(arm), np.full(arm.dof, ACCELERATION)
    return {
        "arm": name,
        ">joints": arm.dof,
        ">poses": count,
        ">ms": f"{median(partial(path.timed, velocity, acceleration)):.2f}",
        ">with jerk, ms": f"{median(partial(path.timed, velocity, acceleration, 1000.0)):.1f}",
        ">toppra, ms": f"{np.median([by_toppra(path, velocity, acceleration)[2] for _ in range(5)]):.1f}",
    }


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=ARMS,
        page="trajectories.md",
        paths=(100, 4, "paths an arm"),
        poses=(500, 100, "poses of a long path"),
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the paths")
    options = parser.options()
    toppra.setup_logging("ERROR")
    page, seed = Page("Trajectories", "benchmarks.trajectories", __doc__), options.seed
    page.head("Beside toppra")
    page.rows(compared(name, options.paths, seed) for name in options.arms)
    page.head("With limits of jerk")
    few = max(options.paths // 5, 2)
    page.rows(with_jerk(name, few, seed, jerk) for jerk in JERKS for name in options.arms)
    page.head("Time for a path of many poses")
    page.say("Median wall times of five calls.")
    page.rows(long_path(name, options.poses, seed) for name in options.arms)
    page.end(options)


if __name__ == "__main__":
    main()
