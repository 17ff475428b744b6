"""Random ways of random arms: `follow` and `track` end soon, inside the limits, with errors that plain kinematics confirms.

    python -m tests.fuzz.motions --count 5000 --seed 0

Arms are those of `tests.fuzz.calls`, and what counts as a finding is the same.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

import kinseek
from kinseek import Goal

from .calls import CALLS, Array, Rng, check_joints, check_reached, joints_of, main, placed, require

MOTIONS = ("follow", "track")


def way_of(rng: Rng, arm: kinseek.Arm, scale: float) -> tuple[Array, Array]:
    """Poses of joints that go from one place to another, and these joints; some poses are moved away, or repeated."""
    ends = joints_of(rng, arm, 2)
    count = int(rng.integers(1, 12))
    q = np.clip(
        ends[0] + np.linspace(0.0, rng.random(), count)[:, None] * (ends[1] - ends[0]), arm.lower, arm.upper
    )
    poses = arm.fk(q)
    if rng.random() < 0.3:
        poses[rng.integers(count)] = poses[0] @ placed(rng, scale * 10.0 ** rng.uniform(-6, 1))
    return poses, q


def call_follow(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """One motion through some poses."""
    poses, q = way_of(rng, arm, scale)
    options: dict[str, Any] = {
        "max_step": float(rng.choice([1e-9, 0.3, 10.0])),
        "closed": bool(rng.random() < 0.2),
    }
    if rng.random() < 0.2:
        options["start"] = q[0]
    if rng.random() < 0.2:
        options |= {
            "times": np.arange(len(q)) * 10.0 ** rng.uniform(-6, 2),
            "velocity": 10.0 ** rng.uniform(-6, 6),
        }
    goal = Goal.pose(poses)
    if rng.random() < 0.2:
        goal = Goal.pose(poses, free=[str(rng.choice(["rx", "rz", "x"]))])
    proved = bool(rng.random() < 0.1)
    if rng.random() < 0.2:
        options["time_limit"] = 10.0 ** rng.uniform(-5, 0)
    path: Any = arm.follow(goal, prove=proved, **options)
    require(path.q.shape == q.shape, f"q has shape {path.q.shape}, asked for {q.shape}")
    check_joints(arm, path.q, None if "continuous" not in arm.kinds else path.q)
    require(np.isfinite(path.position_error) & np.isfinite(path.orientation_error), "an error is not finite")
    for each, reached, pose in zip(path.q, path.reached, poses, strict=True):
        if reached:
            check_reached(arm, each, goal, pose, scale)
    require((path.breaks >= 0) & (path.breaks < len(q)), f"breaks {path.breaks} of {len(q)} poses")
    beside = path.reached[path.breaks] & path.reached[(path.breaks + 1) % len(q)]
    require(beside, f"breaks {path.breaks} beside missed poses {path.missed}")
    require(path.planned | ~path.reached, "a pose is reached that was not planned")
    require(
        path.success == (path.reached.all() and not len(path.breaks)),
        "a status that is not that of its parts",
    )


def call_track(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """A tracker that is led along, and sometimes away."""
    poses, q = way_of(rng, arm, scale)
    period, velocity = 10.0 ** rng.uniform(-6, 0), 10.0 ** rng.uniform(-6, 6)
    tracker = arm.track(q[0], period=period, velocity=velocity)
    last = q[0]
    for pose in poses:
        step = tracker.step(pose)
        require(
            np.isfinite(step.q) & np.isfinite([step.position_error, step.orientation_error]).all(),
            "not finite",
        )
        require(
            np.abs(step.q - last) <= period * velocity * (1 + 1e-9) + 1e-12 * np.abs(last),
            "a joint went too fast",
        )
        check_joints(arm, step.q, None if "continuous" not in arm.kinds else step.q)
        last = step.q


CALLS |= {"follow": (call_follow, 0.5), "track": (call_track, 0.5)}

if __name__ == "__main__":
    sys.exit(main(__doc__, MOTIONS))
