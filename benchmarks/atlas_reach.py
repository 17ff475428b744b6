"""Out of reach: does one call find a pose as near as the best of many random restarts?

    python -m benchmarks.atlas_reach [TARGETS] [RESTARTS]

Targets are at 1 to 2 times the arm's length, in three weightings. A restart is `CoordinateDescent`, which shares no search
with the atlas, from joint values uniform inside the limits; the best weighted error of all restarts is compared. The target
is that the error of the atlas is no larger, to 1e-6, in at least 99 % of the cases.
"""

from __future__ import annotations

import time

import numpy as np

import kinseek

from .command import at_least_one, command
from .targets import load, machine, plain_fk, random_joints

WEIGHTS = ((1.0, 1.0), (10.0, 0.1), (0.1, 10.0))


def main() -> None:
    """Print a row an arm and weighting."""
    parser = command(__file__, __doc__)
    parser.add_argument("targets", nargs="?", type=at_least_one, default=30, help="an arm, 30 by default")
    parser.add_argument(
        "restarts", nargs="?", type=at_least_one, default=100, help="a target, 100 by default"
    )
    options = parser.parse_args()
    count, restarts = options.targets, options.restarts
    print(f"{machine()}; load {load()}; {count} targets, {restarts} restarts")
    for name in ("panda", "ur5e", "irb120"):
        arm, rng = kinseek.load(name), np.random.default_rng(1)
        length = np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum()
        targets = plain_fk(arm.chain, random_joints(arm.chain, count, 1))
        out = rng.normal(size=(count, 3))
        targets[:, :3, 3] = (
            rng.uniform(1, 2, (count, 1)) * length * out / np.linalg.norm(out, axis=1)[:, None]
        )
        for weights in WEIGHTS:
            good, gaps, times = 0, [], []
            for target in targets:
                goal = kinseek.Goal.pose(target, position_weight=weights[0], orientation_weight=weights[1])
                began = time.perf_counter()
                ours = arm.ik(goal).weighted_error
                times.append(time.perf_counter() - began)
                many = kinseek.Goal.pose(
                    np.repeat(target[None], restarts, axis=0),
                    position_weight=weights[0],
                    orientation_weight=weights[1],
                )
                starts = rng.uniform(arm.lower, arm.upper, (restarts, arm.dof))
                best = arm.ik(many, near=starts, solver=kinseek.CoordinateDescent()).weighted_error.min()
                good += bool(ours <= best * (1 + 1e-6) + 1e-9)
                gaps.append(ours / best - 1)
            print(
                f"{name:8s} weights {weights}: no worse {100 * good / count:5.1f} %, worst {100 * max(gaps):.2f} % above, "
                f"median time {1e6 * np.median(times):.0f} µs",
                flush=True,
            )


if __name__ == "__main__":
    main()
