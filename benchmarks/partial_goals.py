"""Partial goals: share of reachable goals solved, and time of a goal.

Arms of three to five joints get positions, and directions of the tool (its z and its x axis): 10,000 targets each from
joint values uniform inside the limits, and 2,000 near singularities and limits. Some arms get goals with free axes and
ranges: the goal differs from a pose of the arm by a deviation drawn from the ranges. Others get a direction of the tool
within a cone, and any turn about it: the goal is a pose of the arm, tilted by an angle inside the cone. The searches get no
starting guess. A goal is solved if plain NumPy forward kinematics confirms the result within 1e-6 m and 1e-6 rad, and every
joint is inside its limits. *One goal* is the median wall time of 300 calls of `arm.ik(goal)`. *Batch* is processor time on
one thread, the median of 3.

    python -m benchmarks.partial_goals                 # writes benchmarks/partial_goals.md
    python -m benchmarks.partial_goals so101 --targets 1000
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal
from kinseek.support.transforms import angles_between

from .command import command
from .page import Flags, Page, Row, list_misses, missed
from .targets import STRICT, Array, plain_fk, random_joints, singular_joints
from .timing import batch_cost, timed

AXES = ("x", "y", "z", "rx", "ry", "rz")

RANGED = ("so101", "m430ia2f", "scara4", "ur5e", "panda", "ur10e_rail")
"""Arms that are measured on goals with ranges."""

CONED = ("ur5e", "panda", "iiwa14", "xarm7", "kr6r900", "irb120", "gen3", "puma560", "ur10e", "so101")
"""Arms that are measured on goals with a cone."""

CONES = (0.01, 0.17, 1.0)
"""Largest angles between the tool's axis and its direction [rad]."""

CASES: dict[str, tuple[tuple[str, ...], dict[str, tuple[float, float]]]] = {
    "free z, rx, ry": (("z", "rx", "ry"), {}),
    "free x, y; rx in -0.1 … 0.3": (("x", "y"), {"rx": (-0.1, 0.3)}),
    "x in ±0.01, rz in ±0.5": ((), {"x": (-0.01, 0.01), "rz": (-0.5, 0.5)}),
    "every axis in ±0.01": ((), dict.fromkeys(AXES, (-0.01, 0.01))),
    "z in ±0.2, rx in ±2, rz in -3 … 1": ((), {"z": (-0.2, 0.2), "rx": (-2.0, 2.0), "rz": (-3.0, 1.0)}),
}


def measure(
    arm: kinseek.Arm,
    label: str,
    goal: Goal,
    judge: Callable[[Array], Flags],
    made_from: Array,
    misses: list[str],
) -> Row:
    """Solve the goals, count those that are not reached by plain poses, (k, 4, 4), and take the time."""
    answer = arm.ik(goal)
    inside = ((answer.q >= arm.lower) & (answer.q <= arm.upper)).all(axis=1)
    good = np.asarray(inside & judge(plain_fk(arm.chain, answer.q)))
    misses += missed(f"{arm.name}, {label}", answer, good, made_from)
    batch = batch_cost(lambda: arm.ik(goal, threads=1), len(good))
    _, singles = timed(arm.ik, [goal.at(target) for target in goal.target[:300]])
    return {
        "arm": arm.name,
        ">joints": arm.dof,
        "goal": label,
        ">solved": f"{good.sum():,}",
        ">of": f"{len(good):,}",
        ">one goal µs": f"{np.median(singles):.0f}",
        ">batch µs a goal": f"{batch:.1f}",
    }


def at_place(T: Array, axis: str = "", cone: float = 0.0) -> Callable[[Array], Flags]:
    """Judge poses by their place, and by the direction of an axis of the tool, which may lie within a cone [rad]."""

    def judge(reached: Array) -> Flags:
        good = np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1) <= STRICT
        if axis:
            a, b = (poses[:, :3, "xyz".index(axis)] for poses in (reached, T))
            good &= angles_between(a, b) <= cone + STRICT
        return np.asarray(good)

    return judge


def small_arm(name: str, targets: int, singular: int, seed: int, misses: list[str]) -> Iterator[Row]:
    """Positions and directions of one arm."""
    arm = kinseek.load(name)
    for kind, q in (
        ("", random_joints(arm.chain, targets, seed)),
        (", near singular", singular_joints(arm.chain, singular, seed)),
    ):
        T = plain_fk(arm.chain, q)
        yield measure(arm, f"position{kind}", Goal.position(T[:, :3, 3]), at_place(T), q, misses)
        for axis in "zx":
            goal = Goal.pose(T, free=f"r{axis}")
            yield measure(arm, f"pointing {axis}{kind}", goal, at_place(T, axis), q, misses)


def ranged_arm(name: str, targets: int, seed: int, misses: list[str]) -> Iterator[Row]:
    """Goals with ranges of one arm, in the tool frame and in the base frame."""
    arm = kinseek.load(name)
    q = random_joints(arm.chain, targets, seed)
    T = plain_fk(arm.chain, q)
    for label, (free, box) in CASES.items():
        ends = np.array([box.get(axis, (-0.5, 0.5) if axis in free else (0.0, 0.0)) for axis in AXES])
        kept = np.array([(-math.inf, math.inf) if a in free else box.get(a, (0.0, 0.0)) for a in AXES])
        for frame in ("tool", "base"):
            rng = np.random.default_rng(seed)
            away = np.stack([rng.uniform(low, high, targets) for low, high in ends], axis=1)
            lengths = np.linalg.norm(away[:, 3:], axis=1, keepdims=True)
            # A rotation vector is at most π long.
            away[:, 3:] *= np.minimum(1.0, 3.1 / np.maximum(lengths, 1e-9))
            wanted = wanted_from(T, away, frame)

            def judge(
                reached: Array, wanted: Array = wanted, frame: str = frame, kept: Array = kept
            ) -> Flags:
                return within(deviation(reached, wanted, frame), kept)

            goal = Goal.pose(wanted, free=free, box=box, frame=frame)
            yield measure(arm, f"{label}, {frame}", goal, judge, q, misses)


def coned_arm(name: str, targets: int, seed: int, misses: list[str]) -> Iterator[Row]:
    """Goals with a cone of one arm."""
    arm = kinseek.load(name)
    q = random_joints(arm.chain, targets, seed)
    T = plain_fk(arm.chain, q)
    for cone in CONES:
        rng = np.random.default_rng(seed)
        # Even over the cone: the squares of small angles are evenly distributed.
        angle, about, spin = cone * np.sqrt(rng.random(targets)), *rng.uniform(-np.pi, np.pi, (2, targets))
        tilt = np.stack([angle * np.cos(about), angle * np.sin(about), np.zeros(targets)], axis=1)
        turn = Rotation.from_rotvec(tilt) * Rotation.from_rotvec(spin[:, None] * np.eye(3)[2])
        wanted = T.copy()
        wanted[:, :3, :3] = T[:, :3, :3] @ turn.as_matrix()
        goal = Goal.pose(wanted, free="rz", cone=cone)
        yield measure(arm, f"z within {cone:g} rad", goal, at_place(wanted, "z", cone), q, misses)


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


def within(off: Array, ends: Array) -> Flags:
    """Which deviations, (k, 6), are inside ranges, (6, 2), to 1e-6 m and 1e-6 rad."""
    gaps = np.maximum(0.0, np.maximum(ends[:, 0] - off, off - ends[:, 1]))
    return np.asarray(
        (np.linalg.norm(gaps[:, :3], axis=1) <= STRICT) & (np.linalg.norm(gaps[:, 3:], axis=1) <= STRICT)
    )


def whole_calls(name: str, targets: int, seed: int) -> Row:
    """Median times [µs] to make a goal, and to make it and solve it at once."""
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, random_joints(arm.chain, targets, seed))
    ways: dict[str, Callable[[Array], object]] = {
        ">position µs": lambda T: Goal.position(T[:3, 3]),
        ">position with ik µs": lambda T: arm.ik(Goal.position(T[:3, 3])),
        ">pointing µs": lambda T: Goal.pointing(T[:3, 3], T[:3, 2]),
        ">pointing with ik µs": lambda T: arm.ik(Goal.pointing(T[:3, 3], T[:3, 2])),
    }
    row: Row = {"arm": name, ">joints": arm.dof}
    for column, ask in ways.items():
        ask(T[0])
        row[column] = f"{np.median(timed(ask, T)[1]):.1f}"
    return row


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=(),
        page="partial_goals.md",
        targets=(10_000, 500, "random targets an arm and goal"),
        singular=(2_000, 100, "near-singular targets an arm and goal"),
        ranged=(1_000, 100, "targets with ranges an arm and goal"),
        coned=(10_000, 100, "targets with a cone an arm and angle"),
        whole=(500, 50, "targets an arm whose goals are made and solved at once"),
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    options = parser.options()
    few = [name for name in options.arms if 3 <= kinseek.load(name).dof <= 5]
    ranged = [name for name in options.arms if name in RANGED]
    page, misses, seed = Page("Partial goals", "benchmarks.partial_goals", __doc__), list[str](), options.seed
    page.head("Making a goal and solving it")
    page.say("Median times on one thread: to make a goal, and to make it and solve it with `arm.ik`.")
    page.rows(whole_calls(name, options.whole, seed) for name in options.arms)
    page.head("Arms of three to five joints")
    sizes = options.targets, options.singular, seed
    page.rows(row for name in few for row in small_arm(name, *sizes, misses))
    page.head("Free axes and ranges")
    page.rows(row for name in ranged for row in ranged_arm(name, options.ranged, seed, misses))
    page.head("Cones")
    page.rows(
        row for name in options.arms if name in CONED for row in coned_arm(name, options.coned, seed, misses)
    )
    list_misses(page, misses)
    page.end(options)


if __name__ == "__main__":
    main()
