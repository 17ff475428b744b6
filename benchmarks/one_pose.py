"""Where the time of one `arm.ik(T)` is spent: Python, the entry into compiled code, the look-up, the steps, the final check.

    python -m benchmarks.one_pose
    python -m benchmarks.one_pose panda --targets 5000

Targets come from joint values uniform inside the limits. Each target is solved several times and the least time counts; the
median over the targets is printed, in microseconds, without the time of the clock. The time of the steps is a straight line
through time against evaluations. An arm with a closed form is measured with it and without it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import kinseek
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.one_goal import search_within, solve_plain
from kinseek.kernels.atlas.task import ROUTINE
from kinseek.solvers.atlas.index import PLAIN, AtlasIndex

from .command import command
from .page import Page, Row
from .targets import Array, plain_fk, random_joints
from .timing import timed

ARMS = ("ur5e", "puma560", "ur10e_calibrated", "jaco2_6", "panda", "iiwa14")
REPEATS = 7


def times(ask: Callable[[Array], object], targets: list[Array]) -> Array:
    """The least time of each target [µs], (k,)."""
    return np.asarray(np.min([timed(ask, targets)[1] for _ in range(REPEATS)], axis=0))


def parts(arm: kinseek.Arm, targets: list[Array], closed: bool) -> dict[str, float]:
    """Whole call, Python's share, entry, look-up, one step, evaluations, and the rest; medians [µs]."""
    index, q = arm.atlas, np.empty(arm.dof)
    assert isinstance(index, AtlasIndex)
    clock = float(np.median(times(lambda target: None, targets)))
    nothing, upper = np.zeros((4, 4)), [np.ascontiguousarray(target[:3]) for target in targets]
    memory = np.zeros(LAYOUT.count.of(dof=arm.dof, joints=len(arm.chain.leader)))
    whole = times(arm.ik, targets) - clock
    kernel = times(lambda target: solve_plain(index.address, target, q), targets) - clock
    door = float(np.median(times(lambda target: solve_plain(index.address, nothing, q), targets))) - clock
    look = times(lambda target: search_within(index.handle, PLAIN, memory, target, 0.0, q, LANES), upper)
    counts = np.array([arm.ik(target).evaluations for target in targets]) / LANES
    few = counts <= 11
    step = np.polyfit(counts[few], kernel[few], 1)[0] if np.ptp(counts[few]) >= 1.0 else 0.0
    look_up = 0.0 if closed else float(np.median(look)) - clock - door
    median = float(np.median(kernel))
    return {
        "whole": float(np.median(whole)),
        "Python": float(np.median(whole - kernel)),
        "entry": door,
        "look-up": look_up,
        "a step": step,
        "steps": float(np.median(counts)),
        "rest": median - door - look_up - step * float(np.median(counts)),
    }


def rows(name: str, count: int) -> Iterator[Row]:
    """A row for each way in which an arm can be solved."""
    arm = kinseek.load(name)
    targets = [np.ascontiguousarray(T) for T in plain_fk(arm.chain, random_joints(arm.chain, count, 1))]
    arm.ik(targets[0])
    index, place = arm.atlas, ROUTINE.first["closed"]
    assert isinstance(index, AtlasIndex)
    kept = int(index._task.routines[place])
    for way in ("closed form", "atlas") if arm.structure.word != "none" else ("atlas",):
        index._task.routines[place] = kept if way == "closed form" else 0
        found = parts(arm, targets, way == "closed form")
        index._task.routines[place] = kept
        row: Row = {"arm": f"{name}, {way}"}
        yield row | {f">{part}": f"{value:.2f}" for part, value in found.items()}


def main() -> None:
    """Ask and print."""
    options = command(__file__, __doc__, arms=ARMS, targets=(2000, 2000, "targets an arm")).options()
    page = Page("One pose", "benchmarks.one_pose")
    page.rows(row for name in options.arms for row in rows(name, options.targets))
    print(page.text)


if __name__ == "__main__":
    main()
