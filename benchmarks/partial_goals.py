"""Partial goals: share of reachable goals solved, and time of a goal.

Arms of three to five joints get positions, and directions of the tool (its z and its x axis): 10,000 targets each from
joint values uniform inside the limits, and 2,000 near singularities and limits. Some arms get goals with free axes and
ranges: the goal differs from a pose of the arm by a deviation drawn from the ranges. A goal is solved if plain NumPy
forward kinematics confirms the result within 1e-6 m and 1e-6 rad, and every joint is inside its limits. Every miss is
listed by name. The time to make a `Goal` of a position or a direction, and to solve it at once, is measured for all arms.

    python -m benchmarks.partial_goals                 # writes benchmarks/partial_goals.md
    python -m benchmarks.partial_goals so101 --targets 1000
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal
from kinseek.robots import catalog_names

from .command import arm_name, at_least_one, command, writes
from .page import Page
from .targets import STRICT, plain_fk, random_joints, singular_joints
from .timing import batch_cost, timed

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HERE = Path(__file__).resolve().parent
AXES = ("x", "y", "z", "rx", "ry", "rz")
REPEATS = 3

RANGED = ("so101", "m430ia2f", "scara4", "ur5e", "panda", "ur10e_rail")
"""Arms that are measured on goals with ranges."""

CASES: dict[str, tuple[tuple[str, ...], dict[str, tuple[float, float]]]] = {
    "free z, rx, ry": (("z", "rx", "ry"), {}),
    "free x, y; rx in -0.1 … 0.3": (("x", "y"), {"rx": (-0.1, 0.3)}),
    "x in ±0.01, rz in ±0.5": ((), {"x": (-0.01, 0.01), "rz": (-0.5, 0.5)}),
    "every axis in ±0.01": ((), dict.fromkeys(AXES, (-0.01, 0.01))),
    "z in ±0.2, rx in ±2, rz in -3 … 1": ((), {"z": (-0.2, 0.2), "rx": (-2.0, 2.0), "rz": (-3.0, 1.0)}),
}


Row = tuple[dict[str, object], list[str]]
"""Cells of a line of a table, and what was missed."""


def measure(
    arm: kinseek.Arm, label: str, goal: Goal, good: Flags, made_from: Array, answer: kinseek.Solution
) -> Row:
    """Count what is not reached, and take the time."""
    false = int((np.asarray(answer.success) & ~good).sum())
    if false:
        print(f"  {arm.name}, {label}: {false} answers claim what outside FK denies")
    missed = [
        f"{arm.name}, {label}, number {i}: {answer.position_error[i]:.1e} m, {answer.orientation_error[i]:.1e} rad; "
        f"made from q = {np.array2string(made_from[i], precision=6, max_line_width=200)}"
        for i in np.flatnonzero(~good)
    ]
    batch = batch_cost(lambda: arm.ik(goal, threads=1), len(good), REPEATS)
    _, singles = timed(arm.ik, [goal.at(target) for target in goal.target[:300]])
    row: dict[str, object] = {
        "arm": arm.name,
        ">joints": arm.dof,
        "goal": label,
        ">solved": f"{good.sum():,}",
        ">of": f"{len(good):,}",
        ">one goal µs": f"{np.median(singles):.0f}",
        ">batch µs a goal": f"{batch:.1f}",
    }
    print(*row.values(), flush=True)
    return row, missed


def inside(arm: kinseek.Arm, q: Array) -> Flags:
    """Which joint vectors, (k, n), are inside the limits."""
    return np.asarray(((q >= arm.lower) & (q <= arm.upper)).all(axis=1))


def small_arm(name: str, targets: int, singular: int, seed: int) -> list[Row]:
    """Positions and directions of one arm."""
    arm = kinseek.load(name)
    rows = []
    for kind, q in (
        ("", random_joints(arm.chain, targets, seed)),
        (", near singular", singular_joints(arm.chain, singular, seed)),
    ):
        T = plain_fk(arm.chain, q)
        goals: dict[str, tuple[Goal, int | None]] = {"position": (Goal.position(T[:, :3, 3]), None)}
        goals |= {f"pointing {axis}": (Goal.pose(T, free=f"r{axis}"), "xyz".index(axis)) for axis in "zx"}
        for label, (goal, column) in goals.items():
            answer = arm.ik(goal)
            reached = plain_fk(arm.chain, answer.q)
            good = inside(arm, answer.q) & (np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1) <= STRICT)
            if column is not None:
                a, b = reached[:, :3, column], T[:, :3, column]
                angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))
                good &= angle <= STRICT
            rows.append(measure(arm, label + kind, goal, good, q, answer))
    return rows


def ranged_arm(name: str, targets: int, seed: int) -> list[Row]:
    """Goals with ranges of one arm, in the tool frame and in the base frame."""
    arm, rows = kinseek.load(name), []
    q = random_joints(arm.chain, targets, seed)
    T = plain_fk(arm.chain, q)
    for label, (free, box) in CASES.items():
        for frame in ("tool", "base"):
            away = np.zeros((targets, 6))
            rng = np.random.default_rng(seed)
            for i, axis in enumerate(AXES):
                low, high = box.get(axis, (-0.5, 0.5) if axis in free else (0.0, 0.0))
                away[:, i] = rng.uniform(low, high, targets)
            lengths = np.linalg.norm(away[:, 3:], axis=1, keepdims=True)
            # A rotation vector is at most π long.
            away[:, 3:] *= np.minimum(1.0, 3.1 / np.maximum(lengths, 1e-9))
            wanted = wanted_from(T, away, frame)
            goal = Goal.pose(wanted, free=free, box=box, frame=frame)
            answer = arm.ik(goal)
            off = deviation(plain_fk(arm.chain, answer.q), wanted, frame)
            good = inside(arm, answer.q) & within(off, free, box)
            rows.append(measure(arm, f"{label}, {frame}", goal, good, q, answer))
    return rows


def wanted_from(T: Array, away: Array, frame: str) -> Array:
    """Wanted poses from which poses T, (k, 4, 4), deviate by `away`, (k, 6)."""
    back = np.swapaxes(Rotation.from_rotvec(away[:, 3:]).as_matrix(), 1, 2)
    wanted = T.copy()
    wanted[:, :3, :3] = T[:, :3, :3] @ back if frame == "tool" else back @ T[:, :3, :3]
    moved = np.einsum("kij,kj->ki", wanted[:, :3, :3], away[:, :3]) if frame == "tool" else away[:, :3]
    wanted[:, :3, 3] -= moved
    return wanted


def deviation(T: Array, wanted: Array, frame: str) -> Array:
    """Deviation of poses along six axes, (k, 6)."""
    back, moved = np.swapaxes(wanted[:, :3, :3], 1, 2), T[:, :3, 3] - wanted[:, :3, 3]
    if frame == "tool":
        moved = np.einsum("kij,kj->ki", back, moved)
    turned = back @ T[:, :3, :3] if frame == "tool" else T[:, :3, :3] @ back
    return np.hstack([moved, Rotation.from_matrix(turned).as_rotvec()])


def within(off: Array, free: tuple[str, ...], box: dict[str, tuple[float, float]]) -> Flags:
    """Which deviations, (k, 6), are inside the ranges to 1e-6 m and 1e-6 rad."""
    gaps = np.zeros_like(off)
    for i, axis in enumerate(AXES):
        low, high = (-math.inf, math.inf) if axis in free else box.get(axis, (0.0, 0.0))
        gaps[:, i] = np.maximum(0.0, np.maximum(low - off[:, i], off[:, i] - high))
    return np.asarray(
        (np.linalg.norm(gaps[:, :3], axis=1) <= STRICT) & (np.linalg.norm(gaps[:, 3:], axis=1) <= STRICT)
    )


def whole_calls(name: str, targets: int, seed: int) -> tuple[str, ...]:
    """Median times [µs] to make a goal, and to make it and solve it at once."""
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, random_joints(arm.chain, targets, seed))
    ways: tuple[Callable[[Array], object], ...] = (
        lambda T: Goal.position(T[:3, 3]),
        lambda T: arm.ik(Goal.position(T[:3, 3])),
        lambda T: Goal.pointing(T[:3, 3], T[:3, 2]),
        lambda T: arm.ik(Goal.pointing(T[:3, 3], T[:3, 2])),
    )
    row = [name, str(arm.dof)]
    for ask in ways:
        ask(T[0])
        row.append(f"{np.median(timed(ask, T)[1]):.1f}")
    print("  ".join(row), flush=True)
    return tuple(row)


def page(whole: list[tuple[str, ...]], small: list[Row], ranged: list[Row]) -> Page:
    """The page."""
    page = Page("Partial goals", "benchmarks.partial_goals")
    page.say(
        "Reachable goals that fix less than a whole pose. The searches get no starting guess. A goal is solved if the",
        "result is within 1e-6 m and 1e-6 rad by plain NumPy forward kinematics, and inside the limits. *One goal* is the",
        "median wall time of 300 calls of `arm.ik(goal)`. *Batch* is processor time on one thread, the median of",
        f"{REPEATS}.",
    )
    page.head("Making a goal and solving it")
    page.say(
        "Median times on one thread: `Goal.position` alone, the same with `arm.ik` of the goal, and the same two times for "
        "`Goal.pointing`."
    )
    page.table(
        "arm | >joints | >position µs | >with ik µs | >pointing µs | >with ik µs",
        whole,
    )
    for title, rows in (("Arms of three to five joints", small), ("Free axes and ranges", ranged)):
        page.head(title)
        page.rows([row for row, _ in rows])
    misses = [miss for _, missed in [*small, *ranged] for miss in missed]
    page.head(f"Misses: {len(misses)}")
    page.items(misses)
    return page


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "arms", nargs="*", type=arm_name, help="names; all that the tables are about by default"
    )
    parser.add_argument("--targets", type=at_least_one, default=10_000, help="random targets an arm and goal")
    parser.add_argument(
        "--singular", type=at_least_one, default=2_000, help="near-singular targets an arm and goal"
    )
    parser.add_argument(
        "--ranged", type=at_least_one, default=1_000, help="targets with ranges an arm and goal"
    )
    parser.add_argument(
        "--whole",
        type=at_least_one,
        default=500,
        help="targets an arm whose goals are made and solved at once",
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    writes(parser, "--output", HERE / "partial_goals.md", "page to write")
    options = parser.parse_args()
    few = [name for name in catalog_names() if 3 <= kinseek.load(name).dof <= 5]
    whole = [whole_calls(name, options.whole, options.seed) for name in options.arms or catalog_names()]
    small, ranged = [], []
    for name in options.arms or few:
        if name in few:
            small += small_arm(name, options.targets, options.singular, options.seed)
    for name in options.arms or RANGED:
        ranged += ranged_arm(name, options.ranged, options.seed)
    page(whole, small, ranged).write(options.output)
    print(f"{sum(len(missed) for _, missed in [*small, *ranged])} misses")


if __name__ == "__main__":
    main()
