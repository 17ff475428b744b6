"""Pink: steps of a quadratic programme with a frame task and the limits of the joints, until the frame is there.

https://github.com/stephane-caron/pink, examples/arm_ur5.py: costs of 1, damping of 1, a posture task of 1e-3, 200
steps a second; the example goes on for ever, here 500 steps. In the sweep whole steps, less damping, no posture task,
and random restarts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.adapters.pinocchio import configuration, values_of
from benchmarks.field.protocol import Arm, Array, Stepping

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


class Pink:
    """A frame task and limits as a quadratic programme of pinocchio."""

    def __init__(
        self,
        arm: Arm,
        dt: float,
        damping: float,
        *,
        posture: float = 0.0,
        velocity: float | bool = False,
        acceleration: float | None = None,
        free: bool = False,
    ) -> None:
        """Of an arm.

        Args:
            arm: The arm.
            dt: Period [s].
            damping: Of the frame task.
            posture: Cost of leaving the middle of the ranges.
            velocity: Of all joints at most [rad/s], or True for those of the file; False: a step may be of any length.
            acceleration: Of all joints at most [rad/s²], with a velocity that is a number; None: it is not limited.
            free: Whether the turn about the tool is left open.
        """
        import pink
        import pinocchio as pin
        from pink.limits import AccelerationLimit, ConfigurationLimit, VelocityLimit
        from pink.tasks import FrameTask, PostureTask

        self._pin, self._solve_ik, self._dt = pin, pink.solve_ik, dt
        self._model = model = pin.buildModelFromUrdf(arm.urdf)
        self._state = pink.Configuration(model, model.createData(), pin.neutral(model))
        self._root = self._state.get_transform_frame_to_world(arm.base).copy()
        self._state.get_transform_frame_to_world(arm.tip)  # raises where a joint has the tip's name, too
        self._task = FrameTask(arm.tip, 1.0, [1.0, 1.0, 0.0] if free else 1.0, lm_damping=damping)
        self._tasks: list[Any] = [self._task]
        if posture:
            self._tasks.append(PostureTask(cost=posture))
            self._tasks[-1].set_target(configuration(pin, model, arm.middle))
        self._limits = None
        if velocity is not True:
            self._limits = [ConfigurationLimit(model, config_limit_gain=1.0)]
        if not isinstance(velocity, bool):
            model.velocityLimit = np.full(model.nv, velocity)
            self._limits = [ConfigurationLimit(model, config_limit_gain=1.0), VelocityLimit(model)]
        self._accelerations = None
        if acceleration is not None and self._limits is not None:
            self._accelerations = AccelerationLimit(model, np.full(model.nv, acceleration))
            self._limits.append(self._accelerations)

    def stand(self, q: Any) -> None:
        """Begin there, at rest."""
        self._state.update(configuration(self._pin, self._model, q))
        if self._accelerations is not None:
            self._accelerations.set_last_integration(np.zeros(self._model.nv), self._dt)

    def aim(self, T: Any) -> Any:
        """Take a pose for the target; how far it is, (6,)."""
        self._task.set_target(self._root * self._pin.SE3(T))
        return self.missing()

    def missing(self) -> Any:
        """How far the target is from here, (6,)."""
        return self._task.compute_error(self._state)

    def step(self) -> None:
        """One period on."""
        v = self._solve_ik(
            self._state, self._tasks, self._dt, solver="daqp", limits=self._limits, safety_break=False
        )
        if self._accelerations is not None:
            self._accelerations.set_last_integration(v, self._dt)
        moved = self._pin.integrate(self._model, self._state.q, v * self._dt)
        self._state.update(np.clip(moved, self._model.lowerPositionLimit, self._model.upperPositionLimit))

    @property
    def q(self) -> Array:
        """Where it stands."""
        return values_of(self._model, self._state.q)


def load(arm: Arm, settings: dict[str, Any]) -> Stepping:
    """The file itself."""
    more = {name: settings[name] for name in ("posture", "velocity")}
    return Stepping(arm, Pink(arm, settings["dt"], settings["lm_damping"], **more), settings)
