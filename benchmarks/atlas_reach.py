"""Out of reach: does one call find a pose as near as the best of many random restarts?

    python -m benchmarks.atlas_reach [TARGETS] [RESTARTS]

Targets are at 1 to 2 times the arm's length, in three weightings. A restart is `CoordinateDescent`, which shares no search
with the atlas, from joint values uniform inside the limits; the best weighted error of all restarts is compared. The target
is that the error of the atlas is no larger, to 1e-6, in at least 99 % of the cases.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import kinseek

from .command import at_least_one, command
from .page import Page, Row
from .targets import Array, plain_fk, random_joints
from .timing import timed

WEIGHTS = ((1.0, 1.0), (10.0, 0.1), (0.1, 10.0))


def compared(name: str, targets: Array, weights: tuple[float, float], restarts: int) -> Row:
    """A row: how often the nearest pose of one call is no worse, and its time."""
    arm, rng, gaps = kinseek.load(name), np.random.default_rng(1), []
    words: dict[str, Any] = {"position_weight": weights[0], "orientation_weight": weights[1]}
    found, times = timed(lambda target: arm.ik(kinseek.Goal.pose(target, **words)).weighted_error, targets)
    for target, ours in zip(targets, found, strict=True):
        many = kinseek.Goal.pose(np.repeat(target[None], restarts, axis=0), **words)
        starts = rng.uniform(arm.lower, arm.upper, (restarts, arm.dof))
        best = arm.ik(many, near=starts, solver=kinseek.CoordinateDescent()).weighted_error.min()
        gaps.append(ours / best - 1 if ours > best + 1e-9 else 0.0)
    return {
        "arm": name,
        "weights": weights,
        ">no worse %": f"{100 * np.mean(np.array(gaps) <= 1e-6):.1f}",
        ">worst, % above": f"{100 * max(gaps):.2f}",
        ">µs": f"{np.median(times):.0f}",
    }


def far_targets(name: str, count: int) -> Array:
    """Poses at 1 to 2 times the arm's length, (count, 4, 4)."""
    chain, rng = kinseek.load(name).chain, np.random.default_rng(1)
    length = np.linalg.norm(chain.fixed[:, :, 3], axis=1).sum()
    targets, out = plain_fk(chain, random_joints(chain, count, 1)), rng.normal(size=(count, 3))
    away = rng.uniform(1, 2, (count, 1)) * length
    targets[:, :3, 3] = away * out / np.linalg.norm(out, axis=1)[:, None]
    return targets


def main() -> None:
    """Print a row an arm and weighting."""
    parser = command(__file__, __doc__)
    parser.add_argument("targets", nargs="?", type=at_least_one, default=30, help="an arm, 30 by default")
    parser.add_argument(
        "restarts", nargs="?", type=at_least_one, default=100, help="a target, 100 by default"
    )
    options = parser.parse_args()
    page = Page("Out of reach", "benchmarks.atlas_reach")
    page.rows(
        compared(name, far_targets(name, options.targets), weights, options.restarts)
        for name in ("panda", "ur5e", "irb120")
        for weights in WEIGHTS
    )
    print(page.text)


if __name__ == "__main__":
    main()
