"""Cost against the number of joints, 3 to 20, and against the tolerance, 1e-3 to 1e-10; two pictures.

    python -m benchmarks.atlas_cost            # writes docs/pictures/atlas_joints.png and atlas_tolerance.png

The arms have n revolute joints about random axes, 1 m long, with limits of ±2 rad; there are three arms for each n. One
pose: 500 calls of `arm.ik`. Batch: 20,000 poses on one thread, processor time. Times are medians of nine rounds.
"""

from __future__ import annotations

import statistics
from functools import partial
from pathlib import Path

import numpy as np

import kinseek
from kinseek import plots
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import rotation, transform

from .command import PICTURES, command, writes
from .targets import Array, machine, plain_fk, pose_errors, random_joints
from .timing import batch_cost, timed

ROUNDS = 9
"""Every case is measured this often, in turn with the others, so that the moods of the machine spread over all."""

TOLERANCES = tuple(10.0**-k for k in range(3, 11))


def random_arm(joints: int, seed: int) -> kinseek.Arm:
    """Build an arm of turning joints about random axes, 1 m long."""
    rng = np.random.default_rng((joints, seed))

    def unit() -> Array:
        vector = rng.normal(size=3)
        return np.asarray(vector / np.linalg.norm(vector))

    chain = [
        Joint(
            f"j{i}",
            "revolute",
            transform(rotation(unit(), rng.uniform(0, 3)), unit() / joints),
            unit(),
            -2.0,
            2.0,
        )
        for i in range(joints)
    ]
    return kinseek.Arm(serial_chain(chain, np.eye(4), name=f"random{joints}", base="base", tip="tip"))


def by_joints() -> list[tuple[int, float, float, float]]:
    """Joints, one pose [µs], batch [µs a pose], solved [%]: medians of three arms and all rounds, least of the last."""
    arms = [(joints, random_arm(joints, seed)) for joints in range(3, 21) for seed in range(3)]
    targets = [plain_fk(arm.chain, random_joints(arm.chain, 20_000, 0)) for _, arm in arms]
    one: dict[int, list[float]] = {}
    batch: dict[int, list[float]] = {}
    solved: dict[int, list[float]] = {}
    for (joints, arm), goals in zip(arms, targets, strict=True):
        away, angle = pose_errors(plain_fk(arm.chain, arm.ik(goals).q), goals)
        solved.setdefault(joints, []).append(100 * float(np.mean((away <= 1e-6) & (angle <= 1e-6))))
    for _ in range(ROUNDS):
        for (joints, arm), goals in zip(arms, targets, strict=True):
            one.setdefault(joints, []).append(float(np.median(timed(arm.ik, goals[:500])[1])))
            batch.setdefault(joints, []).append(batch_cost(partial(arm.ik, goals, threads=1), len(goals), 1))
    rows = [(n, statistics.median(one[n]), statistics.median(batch[n]), min(solved[n])) for n in one]
    for row in rows:
        print(f"{row[0]:3d} joints  one {row[1]:6.1f} µs  batch {row[2]:6.2f} µs  solved {row[3]:.3f} %")
    return rows


def by_tolerance(
    names: tuple[str, ...] = ("panda", "ur5e", "iiwa14"),
) -> dict[str, list[tuple[float, float, float]]]:
    """Tolerance [m and rad], batch [µs a pose], solved [%], an arm."""
    cases, costs, solved = [], {}, {}
    for name in names:
        arm = kinseek.load(name)
        targets = plain_fk(arm.chain, random_joints(arm.chain, 20_000, 0))
        for tolerance in TOLERANCES:
            goal = kinseek.Goal.pose(targets, position_tolerance=tolerance, orientation_tolerance=tolerance)
            cases.append((name, tolerance, arm, goal))
            costs[name, tolerance] = list[float]()
            solved[name, tolerance] = 100 * float(arm.ik(goal).success.mean())
    for _ in range(ROUNDS):
        for name, tolerance, arm, goal in cases:
            costs[name, tolerance].append(batch_cost(partial(arm.ik, goal, threads=1), goal.shape[0], 1))
    result: dict[str, list[tuple[float, float, float]]] = {}
    for name, tolerance, _, _ in cases:
        row = tolerance, statistics.median(costs[name, tolerance]), solved[name, tolerance]
        result.setdefault(name, []).append(row)
        print(f"{name:8s} {row[0]:.0e}  batch {row[1]:6.2f} µs  solved {row[2]:.3f} %")
    return result


def draw_joints(rows: list[tuple[int, float, float, float]], folder: Path) -> None:
    """Time of a pose against the number of joints."""
    joints, one, batch, _ = zip(*rows, strict=True)
    figure, axes = plots.plane(size=(6.4, 3.9))
    axes.plot(joints, one, "o-", color=plots.COLOURS[0], label="one pose, arm.ik(T)")
    axes.plot(joints, batch, "s--", color=plots.COLOURS[1], label="batch, one core")
    axes.set(xlabel="joints", ylabel="time of a pose [µs]", ylim=(0, 1.08 * max(one)), xticks=joints)
    axes.set_title("Random arms, 1e-6 m and 1e-6 rad", fontsize=10)
    figure.legend(loc="outside lower center", ncols=2)
    plots.save(figure, folder / "atlas_joints.png", dpi=150)


def draw_tolerances(rows: dict[str, list[tuple[float, float, float]]], folder: Path) -> None:
    """Time of a pose against the tolerance."""
    figure, axes = plots.plane(size=(6.4, 3.9))
    for (name, found), colour, look in zip(rows.items(), plots.COLOURS, ("o-", "s--", "^-."), strict=False):
        axes.plot([row[0] for row in found], [row[1] for row in found], look, color=colour, label=name)
    most = max(row[1] for found in rows.values() for row in found)
    axes.set(xlabel="tolerance [m and rad]", ylabel="time of a pose in a batch [µs]", xscale="log")
    axes.set_ylim(0, 1.08 * most)
    axes.invert_xaxis()
    figure.legend(loc="outside lower center", ncols=len(rows))
    plots.save(figure, folder / "atlas_tolerance.png", dpi=150)


def main() -> None:
    """Measure and draw."""
    parser = command(__file__, __doc__)
    writes(parser, "--folder", PICTURES, "folder for the pictures")
    folder = parser.parse_args().folder
    print(machine())
    draw_joints(by_joints(), folder)
    draw_tolerances(by_tolerance(), folder)
    print(f"wrote {folder / 'atlas_joints.png'} and atlas_tolerance.png")


if __name__ == "__main__":
    main()
