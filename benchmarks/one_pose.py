"""Where the time of one `arm.ik(T)` is spent: Python, the entry into compiled code, the look-up, the steps, the final check.

    python -m benchmarks.one_pose
    python -m benchmarks.one_pose panda --targets 5000

Targets come from joint values uniform inside the limits. Each target is solved several times and the least time counts; the
median over the targets is printed, in microseconds, without the time of the clock. The time of the steps is a straight line
through time against evaluations. An arm with a closed form is measured with it and without it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.one_goal import search_within, solve_plain
from kinseek.kernels.atlas.task import ROUTINE
from kinseek.solvers.atlas.index import PLAIN, AtlasIndex

from .command import arm_name, at_least_one, command
from .targets import load, machine, plain_fk, random_joints
from .timing import timed

Array = NDArray[np.float64]

ARMS = ("ur5e", "puma560", "ur10e_calibrated", "jaco2_6", "panda", "iiwa14")
REPEATS = 7


def times(ask: Callable[[Array], object], targets: list[Array]) -> Array:
    """The least time of each target [µs], (k,)."""
    return np.asarray(np.min([timed(ask, targets)[1] for _ in range(REPEATS)], axis=0))


def parts(arm: kinseek.Arm, targets: list[Array], closed: bool) -> list[float]:
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
    rest = median - door - look_up - step * float(np.median(counts))
    shell = float(np.median(whole - kernel))
    return [float(np.median(whole)), shell, door, look_up, step, float(np.median(counts)), rest]


def main() -> None:
    """Ask and print."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, default=ARMS)
    parser.add_argument("--targets", type=at_least_one, default=2000)
    given = parser.parse_args()
    print(f"{machine()}; load {load()}")
    print(
        f"{'arm':<28}{'whole':>8}{'Python':>8}{'entry':>8}{'look-up':>8}{'a step':>8}{'steps':>8}{'rest':>8}"
    )
    for name in given.arms or ARMS:
        arm = kinseek.load(name)
        targets = [
            np.ascontiguousarray(T) for T in plain_fk(arm.chain, random_joints(arm.chain, given.targets, 1))
        ]
        arm.ik(targets[0])
        ways = (
            [("closed form", True), ("atlas", False)] if arm.structure.word != "none" else [("atlas", False)]
        )
        for way, closed in ways:
            index = arm.atlas
            assert isinstance(index, AtlasIndex)
            routines, place = index._routines, ROUTINE.first["closed"]
            kept = int(routines[place])
            routines[place] = kept if closed else 0
            row = parts(arm, targets, closed)
            routines[place] = kept
            print(f"{name + ', ' + way:<28}" + "".join(f"{value:8.2f}" for value in row), flush=True)


if __name__ == "__main__":
    main()
