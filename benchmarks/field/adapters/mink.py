"""mink, on MuJoCo: steps of a quadratic programme with a frame task and the limits of the joints, until the frame is there.

https://github.com/kevinzakka/mink, examples/arm_ur5e.py: costs of 1, damping of 1, joints no faster than π rad/s, 500
steps a second; the example goes on for ever, here 500 steps. In the sweep whole steps, less damping, no limit of
speed, and random restarts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.field.protocol import Arm, Array, Refused, Stepping

NAME = "mink"
PACKAGE = "mink"
RECOMMENDED: dict[str, Any] = {
    "dt": 0.002,
    "lm_damping": 1.0,
    "speed": np.pi,
    "steps": 500,
    "tolerance": 1e-4,
    "restarts": 0,
}
SWEEP: tuple[dict[str, Any], ...] = tuple(
    {"dt": 1.0, "lm_damping": damping, "speed": None, "steps": steps, "tolerance": 5e-7, "restarts": 20}
    for damping, steps in ((1e-9, 50), (1e-3, 50), (1e-6, 100))
)

OPTIONS = (
    '<mujoco><compiler boundmass="0.1" boundinertia="0.01" fusestatic="false" discardvisual="true"/></mujoco>'
)
"""The arms' files know no masses, and MuJoCo wants some."""


class Mink:
    """A frame task and limits as a quadratic programme of MuJoCo."""

    def __init__(
        self,
        arm: Arm,
        dt: float,
        damping: float,
        speed: float | None,
        *,
        gain: float | None = 1.0,
        free: bool = False,
    ) -> None:
        """Of an arm.

        Args:
            arm: The arm.
            dt: Period [s].
            damping: Of the frame task.
            speed: Of all joints at most [rad/s]; None: a step may be of any length.
            gain: How much of the way to a limit a step may go; None: as mink has it.
            free: Whether the turn about the tool is left open.
        """
        import mink
        import mujoco

        text = Path(arm.urdf).read_text(encoding="utf-8")
        end = text.rindex("</robot>")
        model = mujoco.MjModel.from_xml_string(text[:end] + OPTIONS + text[end:])
        if model.nq != len(arm.joints):
            raise Refused(f"reads {model.nq} joints of {len(arm.joints)}")
        self._mink, self._dt, self._state = mink, dt, mink.Configuration(model)
        self._root = self._state.get_transform_frame_to_world(arm.base, "body")
        turn = [1.0, 1.0, 0.0] if free else 1.0
        self._task = mink.FrameTask(arm.tip, "body", 1.0, turn, lm_damping=damping)
        self._limits: list[Any] = [mink.ConfigurationLimit(model, **({} if gain is None else {"gain": gain}))]
        if speed:
            self._limits.append(mink.VelocityLimit(model, dict.fromkeys(arm.joints, speed)))
        bounded = np.array([kind != "continuous" for kind in arm.kinds])
        self._ends = np.where(bounded, arm.lower, -np.inf), np.where(bounded, arm.upper, np.inf)

    def stand(self, q: Any) -> None:
        """Begin there."""
        self._state.update(np.asarray(q, dtype=float))

    def aim(self, T: Any) -> Any:
        """Take a pose for the target; how far it is, (6,)."""
        self._task.set_target(self._root.multiply(self._mink.SE3.from_matrix(T)))
        return self.missing()

    def missing(self) -> Any:
        """How far the target is from here, (6,)."""
        return self._task.compute_error(self._state)

    def step(self) -> None:
        """One period on."""
        v = self._mink.solve_ik(self._state, [self._task], self._dt, "daqp", limits=self._limits)
        self._state.update(np.clip(self._state.q + v * self._dt, *self._ends))

    @property
    def q(self) -> Array:
        """Where it stands."""
        return np.array(self._state.q)


def load(arm: Arm, settings: dict[str, Any]) -> Stepping:
    """The file itself, with some mass to every link; a joint that follows another is a constraint that steps do not keep."""
    gain = None if settings["speed"] else 1.0
    method = Mink(arm, settings["dt"], settings["lm_damping"], settings["speed"], gain=gain)
    return Stepping(arm, method, settings)
