"""Pink: steps of a quadratic programme with a frame task and the limits of the joints, until the frame is there.

https://github.com/stephane-caron/pink, examples/arm_ur5.py: costs of 1, damping of 1, a posture task of 1e-3, 200
steps a second; the example goes on for ever, here 500 steps. In the sweep whole steps, less damping, no posture task,
and random restarts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.adapters.pinocchio import configuration, values_of
from benchmarks.field.protocol import Answer, Arm, Refused

NAME = "Pink"
PACKAGE = "pin-pink"
RECOMMENDED: dict[str, Any] = {
    "dt": 0.005,
    "lm_damping": 1.0,
    "posture": 1e-3,
    "steps": 500,
    "tolerance": 1e-4,
    "restarts": 0,
    "velocity": True,
}
SWEEP: tuple[dict[str, Any], ...] = tuple(
    {
        "dt": 1.0,
        "lm_damping": damping,
        "posture": 0.0,
        "steps": steps,
        "tolerance": 5e-7,
        "restarts": 20,
        "velocity": False,
    }
    for damping, steps in ((1e-9, 50), (1e-3, 50), (1e-6, 100))
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import pink
        import pinocchio as pin
        from pink.limits import ConfigurationLimit
        from pink.tasks import FrameTask, PostureTask

        self._pin, self._solve_ik, self._arm, self._set = pin, pink.solve_ik, arm, settings
        self._model = pin.buildModelFromUrdf(arm.urdf)
        self._state = pink.Configuration(self._model, self._model.createData(), pin.neutral(self._model))
        self._root = self._state.get_transform_frame_to_world(arm.base).copy()
        self._state.get_transform_frame_to_world(arm.tip)  # raises where a joint has the tip's name, too
        self._task = FrameTask(
            arm.tip, position_cost=1.0, orientation_cost=1.0, lm_damping=settings["lm_damping"]
        )
        self._tasks: list[Any] = [self._task]
        if settings["posture"]:
            posture = PostureTask(cost=settings["posture"])
            posture.set_target(configuration(pin, self._model, arm.middle))
            self._tasks.append(posture)
        self._limits = (
            None if settings["velocity"] else [ConfigurationLimit(self._model, config_limit_gain=1.0)]
        )
        self._rng = np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        q = self._arm.middle if start is None else np.asarray(start, dtype=float)
        self._task.set_target(self._root * self._pin.SE3(T))
        met = False
        for _ in range(self._set["restarts"] + 1):
            self._state.update(configuration(self._pin, self._model, q))
            met = self._descend()
            if met:
                break
            q = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(values_of(self._model, self._state.q), met)

    def _descend(self) -> bool:
        dt = self._set["dt"]
        for _ in range(self._set["steps"]):
            error = self._task.compute_error(self._state)
            if max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < self._set["tolerance"]:
                return True
            v = self._solve_ik(
                self._state, self._tasks, dt, solver="daqp", limits=self._limits, safety_break=False
            )
            moved = self._pin.integrate(self._model, self._state.q, v * dt)
            self._state.update(np.clip(moved, self._model.lowerPositionLimit, self._model.upperPositionLimit))
        return False


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The file itself."""
    if arm.follows:
        raise Refused("joints that follow others are not read")
    return _Solver(arm, settings)
