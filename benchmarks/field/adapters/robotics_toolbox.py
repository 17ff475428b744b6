"""Robotics Toolbox for Python: `ik_LM`, its fast Levenberg-Marquardt in C++ with restarts, as its manual calls it.

https://petercorke.github.io/robotics-toolbox-python: all defaults, a random start. Its tolerance is one of the
squared error. In the sweep tighter tolerances, other damping, and the middle of the ranges as a first start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, without_followers

NAME = "Robotics Toolbox"
PACKAGE = "roboticstoolbox-python"
RECOMMENDED: dict[str, Any] = {"method": "chan", "k": 1.0, "tol": 1e-6, "middle": False}
SWEEP: tuple[dict[str, Any], ...] = (
    {"method": "chan", "k": 1.0, "tol": 1e-13, "middle": True},
    {"method": "chan", "k": 0.1, "tol": 1e-13, "middle": True},
    {"method": "sugihara", "k": 1e-4, "tol": 1e-13, "middle": True},
    {"method": "wampler", "k": 1e-4, "tol": 1e-13, "middle": True},
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import roboticstoolbox

        without_followers(arm)
        self._ets = _elementary(roboticstoolbox, arm)
        self._start = arm.middle if settings["middle"] else None
        self._set = {name: value for name, value in settings.items() if name != "middle"}

    def solve(self, T: Any, start: Any) -> Answer:
        return self._asked(T, start)

    def position(self, place: Array, start: Array | None) -> Answer:
        T = np.eye(4)
        T[:3, 3] = place
        return self._asked(T, start, mask=np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))

    def _asked(self, T: Any, start: Any, **mask: Array) -> Answer:
        found = self._ets.ik_LM(T, q0=self._start if start is None else start, **mask, **self._set)
        return Answer(found.q, bool(found.success))


def _elementary(module: Any, arm: Arm) -> Any:
    """An arm as elementary transforms: frames whose z is the axis of a joint, and what lies between them."""
    chain, last = [], np.eye(4)
    for i, kind in enumerate(arm.kinds):
        frame = np.eye(4)
        frame[:3, :3] = _turn_to(arm.axes[i])
        frame[:3, 3] = arm.points[i]
        chain.append(module.ET.SE3(np.linalg.inv(last) @ frame))
        limits = np.array([arm.lower[i], arm.upper[i]])
        chain.append((module.ET.tz if kind == "prismatic" else module.ET.Rz)(qlim=limits))
        last = frame
    return module.ETS([*chain, module.ET.SE3(np.linalg.inv(last) @ arm.home)])


def _turn_to(axis: Array) -> Array:
    """A rotation whose third column is an axis."""
    one = np.eye(3)[np.abs(axis).argmin()]
    x = np.cross(one, axis) / np.linalg.norm(np.cross(one, axis))
    return np.column_stack([x, np.cross(axis, x), axis])


load = _Solver
