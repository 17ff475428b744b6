"""The loop of pinocchio's manual: damped steps of a tenth, with neither limits nor restarts.

https://docs.ros.org/en/rolling/p/pinocchio, closed-loop inverse kinematics: eps 1e-4, 1000 steps of 0.1, damping 1e-12.
In the sweep whole steps, the limits kept by clamping, and random restarts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.protocol import Arm, Array, Stepping

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


class Loop:
    """Damped steps on the logarithm of the pose that is missing; a free turn is a row left out."""

    def __init__(
        self,
        arm: Arm,
        damping: float,
        part: float = 1.0,
        *,
        clamp: bool = True,
        longest: float = np.inf,
        free: bool = False,
    ) -> None:
        """Of an arm.

        Args:
            arm: The arm.
            damping: Added to the diagonal.
            part: Of every step.
            clamp: Whether the limits are kept.
            longest: What a joint may move in a step [rad].
            free: Whether the turn about the tool is left open.
        """
        import pinocchio as pin

        self._pin, self._model = pin, pin.buildModelFromUrdf(arm.urdf)
        self._data = self._model.createData()
        self._tip = self._model.getFrameId(arm.tip, pin.FrameType.BODY)
        pin.framesForwardKinematics(self._model, self._data, pin.neutral(self._model))
        self._root = self._data.oMf[self._model.getFrameId(arm.base, pin.FrameType.BODY)].copy()
        self._rows = slice(5 if free else 6)
        self._damping, self._part = damping * np.eye(self._rows.stop), part
        self._clamp, self._longest = clamp, longest

    def stand(self, q: Any) -> None:
        """Begin there."""
        self._q = configuration(self._pin, self._model, q)

    def aim(self, T: Any) -> Any:
        """Take a pose for the target; how far it is, (6,)."""
        self._target = self._root * self._pin.SE3(T)
        return self.missing()

    def missing(self) -> Any:
        """How far the target is from here, (6,)."""
        self._pin.framesForwardKinematics(self._model, self._data, self._q)
        self._error = self._data.oMf[self._tip].actInv(self._target)
        self._twist = self._pin.log6(self._error).vector
        return self._twist

    def step(self) -> None:
        """One step."""
        pin, rows = self._pin, self._rows
        J = pin.computeFrameJacobian(self._model, self._data, self._q, self._tip)
        J = (pin.Jlog6(self._error.inverse()) @ J)[rows]
        move = J.T @ np.linalg.solve(J @ J.T + self._damping, self._twist[rows])
        if self._longest < np.inf:
            move *= min(1.0, self._longest / max(float(np.abs(move).max()), 1e-12))
        self._q = pin.integrate(self._model, self._q, move * self._part)
        if self._clamp:
            self._q = np.clip(self._q, self._model.lowerPositionLimit, self._model.upperPositionLimit)

    @property
    def q(self) -> Array:
        """Where it stands."""
        return values_of(self._model, self._q)


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


class _Solver(Stepping):
    def far(self, error: Any) -> float:
        return float(np.linalg.norm(error))


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The model of the file."""
    method = Loop(arm, settings["damping"], settings["part"], clamp=settings["clamp"])
    return _Solver(arm, method, settings)
