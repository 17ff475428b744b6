"""Paths for the tests of trajectories, and judges that use finite differences and plain samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import Trajectory

Array = NDArray[np.float64]

DENSE = 10_000
"""Samples of a trajectory."""


TRIALS = 200
"""Random paths that are tried until one is continuous."""


def _goal(arm: kinseek.Arm, T: Array) -> Any:
    """All of the poses, or their positions for an arm with too few joints."""
    return T if arm.dof >= 6 else kinseek.Goal.position(T[:, :3, 3])


def arc(arm: kinseek.Arm, rng: np.random.Generator, count: int = 150) -> kinseek.Path:
    """A continuous path along a random arc."""
    for _ in range(TRIALS):
        q = rng.uniform(np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0))
        T = np.repeat(arm.fk(q)[None], count, axis=0)
        angle = np.linspace(0.0, rng.uniform(0.5, 2.0), count)
        a, b = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        T[:, :3, 3] += 0.15 * ((np.cos(angle) - 1.0)[:, None] * a + np.sin(angle)[:, None] * b)
        path = arm.follow(_goal(arm, T))
        if path.success:
            return path
    raise AssertionError(f"no continuous arc of {arm.name}")


def corner(arm: kinseek.Arm, rng: np.random.Generator) -> kinseek.Path:
    """A continuous path along two lines with a sharp corner."""
    for _ in range(TRIALS):
        q = rng.uniform(np.maximum(arm.lower, -2.0), np.minimum(arm.upper, 2.0))
        ends = [arm.fk(q + 0.3 * rng.normal(size=arm.dof)) for _ in range(2)]
        path = arm.follow(
            _goal(arm, kinseek.interpolate([ends[0], arm.fk(q), ends[1]], step=0.005, turn=0.03))
        )
        if path.success:
            return path
    raise AssertionError(f"no continuous path of {arm.name}")


def worst(trajectory: Trajectory) -> dict[str, float]:
    """The largest share of each limit at dense samples, and how far velocities and accelerations are from differences."""
    t = np.linspace(0.0, trajectory.duration, DENSE)
    q, v, a = trajectory.q(t), trajectory.velocity(t), trajectory.acceleration(t)
    limits, chain = trajectory.limits, trajectory.mechanism
    found: dict[str, Any] = {
        "velocity": (np.abs(v) / limits.velocity).max(),
        "acceleration": (np.abs(a) / limits.acceleration).max(),
        "outside": np.where(chain.endless, 0.0, np.maximum(q - chain.upper, chain.lower - q)).max(),
    }
    if limits.tool_speed is not None:
        found["tool_speed"] = trajectory.tip_speed(t).max() / limits.tool_speed
    if limits.jerk is not None:
        found["jerk"] = (np.abs(trajectory.jerk(t)) / limits.jerk).max()
    # The integral of what is reported is what was before it: trapezoids, whose error is of second order where it is smooth.
    step = np.diff(t)[:, None]
    found["integral of velocity"] = np.abs(
        np.cumsum(step * (v[1:] + v[:-1]) / 2.0, axis=0) - (q[1:] - q[0])
    ).max()
    found["integral of acceleration"] = np.abs(
        np.cumsum(step * (a[1:] + a[:-1]) / 2.0, axis=0) - (v[1:] - v[0])
    ).max()
    return {name: float(value) for name, value in found.items()}
