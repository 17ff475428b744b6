"""A trajectory whose values are known in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.timing.trajectory import Samples

Array = NDArray[np.float64]

HOSTILE = (
    'a"\n  stopj(1)\nend',
    "b\r\nHALT",
    "c\u2028d\x85e\u202e",
    "}{name}%s",
    "!;#\\n\x00",
    "é" + "x" * 200,
)
"""Names of joints that would be code, if they ended the comment in which they stand."""


@dataclass
class Smooth:
    """All joints move straight from `start` to `end`, from rest to rest, by a polynomial of degree five; N poses."""

    mechanism: Any
    start: Array
    end: Array
    duration: float = 2.0
    pose_times: Any = (0.0, 1.0, 2.0)
    tool: Any = None

    def __post_init__(self) -> None:
        self.pose_times = np.array(self.pose_times)
        n = len(self.start)
        self.limits = SimpleNamespace(
            velocity=np.full(n, 3.0), acceleration=np.full(n, 4.0), jerk=None, tool_speed=None
        )

    def _along(self, shape: Array) -> Array:
        return np.multiply.outer(shape, self.end - self.start)

    def q(self, t: Any) -> Array:
        x = np.asarray(t) / (self.duration or 1.0)
        return self.start + self._along(x**3 * (10 - 15 * x + 6 * x**2))

    def velocity(self, t: Any) -> Array:
        x = np.asarray(t) / (self.duration or 1.0)
        return self._along(30 * x**2 * (1 - x) ** 2 / (self.duration or 1.0))

    def acceleration(self, t: Any) -> Array:
        x = np.asarray(t) / (self.duration or 1.0)
        return self._along(60 * x * (1 - x) * (1 - 2 * x) / (self.duration or 1.0) ** 2)

    def sample(self, period: float) -> Samples:
        steps = int(np.ceil(self.duration / period - 1e-9))
        times = np.append(np.arange(steps) * period, self.duration)
        return Samples(times, self.q(times), self.velocity(times), self.acceleration(times))


def smooth(arm: str | kinseek.Arm = "ur5e", **changes: Any) -> Any:
    loaded = kinseek.load(arm) if isinstance(arm, str) else arm
    start = np.asarray(0.1 * np.arange(1, loaded.dof + 1) - 0.5)
    end = start + 0.25 * (-1.0) ** np.arange(loaded.dof)
    return Smooth(loaded.mechanism, start, end, **changes)


def arm_with(names: Sequence[str]) -> kinseek.Arm:
    rows = [(0.1, 0.2, 1.0, 0.0)] * len(names)
    return kinseek.Arm.from_dh(rows, [-3.0] * len(names), [3.0] * len(names), names=list(names))
