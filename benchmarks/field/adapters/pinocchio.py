"""The loop of pinocchio's manual: damped steps of a tenth, with neither limits nor restarts.

https://docs.ros.org/en/rolling/p/pinocchio, closed-loop inverse kinematics: eps 1e-4, 1000 steps of 0.1, damping 1e-12.
In the sweep whole steps, the limits kept by clamping, and random restarts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused

NAME = "pinocchio loop"
PACKAGE = "pin"
RECOMMENDED: dict[str, Any] = {
    "tolerance": 1e-4,
    "steps": 1000,
    "part": 0.1,
    "damping": 1e-12,
    "restarts": 0,
    "clamp": False,
}
SWEEP: tuple[dict[str, Any], ...] = tuple(
    {"tolerance": 5e-7, "steps": steps, "part": 1.0, "damping": damping, "restarts": 100, "clamp": True}
    for steps, damping in ((100, 1e-6), (30, 1e-6), (100, 1e-4), (30, 1e-8))
)


class _Solver:
    def __init__(self, pin: Any, arm: Arm, settings: dict[str, Any]) -> None:
        self._pin, self._arm, self._set = pin, arm, settings
        self._model = pin.buildModelFromUrdf(arm.urdf)
        self._data = self._model.createData()
        body = pin.FrameType.BODY
        self._tip = self._model.getFrameId(arm.tip, body)
        pin.framesForwardKinematics(self._model, self._data, pin.neutral(self._model))
        self._root = self._data.oMf[self._model.getFrameId(arm.base, body)].copy()
        self._rng = np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        q = self._arm.middle if start is None else np.asarray(start, dtype=float)
        target = self._root * self._pin.SE3(T)
        for _ in range(self._set["restarts"] + 1):
            values, met = self._descend(target, configuration(self._pin, self._model, q))
            if met:
                break
            q = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(values, met)

    def _descend(self, target: Any, q: Any) -> tuple[Array, bool]:
        pin, model, data = self._pin, self._model, self._data
        for _ in range(self._set["steps"]):
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[self._tip].actInv(target)
            twist = pin.log6(error).vector
            if np.linalg.norm(twist) < self._set["tolerance"]:
                return values_of(self._model, q), True
            J = -pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, self._tip)
            v = -J.T @ np.linalg.solve(J @ J.T + self._set["damping"] * np.eye(6), twist)
            q = pin.integrate(model, q, v * self._set["part"])
            if self._set["clamp"]:
                q = self._clamped(q)
        return values_of(self._model, q), False

    def _clamped(self, q: Any) -> Any:
        return np.clip(q, self._model.lowerPositionLimit, self._model.upperPositionLimit)


def configuration(pin: Any, model: Any, values: Array) -> Any:
    """Joint values as pinocchio has them: of a continuous joint the cosine and the sine."""
    q = pin.neutral(model)
    for joint, value in zip(model.joints[1:], values, strict=True):
        q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
    return q


def values_of(model: Any, q: Any) -> Array:
    """The way back."""
    joints = model.joints[1:]
    return np.array([q[j.idx_q] if j.nq == 1 else np.arctan2(q[j.idx_q + 1], q[j.idx_q]) for j in joints])


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The model of the file."""
    if arm.follows:
        raise Refused("joints that follow others are not in the manual's loop")
    import pinocchio as pin

    return _Solver(pin, arm, settings)
