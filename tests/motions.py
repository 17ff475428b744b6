"""Judges of trajectories that use finite differences and plain samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek import Trajectory

Array = NDArray[np.float64]

DENSE = 10_000
"""Samples of a trajectory."""
FEW = 2_000
"""Samples of one of many trajectories with few poses."""


def worst(trajectory: Trajectory, samples: int = DENSE) -> dict[str, float]:
    """The largest share of each limit at dense samples, and how far velocities and accelerations are from differences."""
    t = np.linspace(0.0, trajectory.duration, samples)
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
