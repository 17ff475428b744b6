"""mink, on MuJoCo: steps of a quadratic programme with a frame task and the limits of the joints, until the frame is there.

https://github.com/kevinzakka/mink, examples/arm_ur5e.py: costs of 1, damping of 1, joints no faster than π rad/s, 500
steps a second; the example goes on for ever, here 500 steps. In the sweep whole steps, less damping, no limit of
speed, and random restarts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Refused

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


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import mink
        import mujoco

        text = Path(arm.urdf).read_text(encoding="utf-8")
        end = text.rindex("</robot>")
        model = mujoco.MjModel.from_xml_string(text[:end] + OPTIONS + text[end:])
        if model.nq != len(arm.joints):
            raise Refused(f"reads {model.nq} joints of {len(arm.joints)}")
        self._mink, self._arm, self._set = mink, arm, settings
        self._state = mink.Configuration(model)
        self._root = self._state.get_transform_frame_to_world(arm.base, "body")
        self._task = mink.FrameTask(arm.tip, "body", 1.0, 1.0, lm_damping=settings["lm_damping"])
        self._limits: list[Any] = [
            mink.ConfigurationLimit(model, **({} if settings["speed"] else {"gain": 1.0}))
        ]
        if settings["speed"]:
            self._limits.append(mink.VelocityLimit(model, dict.fromkeys(arm.joints, settings["speed"])))
        self._rng = np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        q = self._arm.middle if start is None else np.asarray(start, dtype=float)
        self._task.set_target(self._root.multiply(self._mink.SE3.from_matrix(T)))
        met = False
        for _ in range(self._set["restarts"] + 1):
            self._state.update(q)
            met = self._descend()
            if met:
                break
            q = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(self._state.q.copy(), met)

    def _descend(self) -> bool:
        dt = self._set["dt"]
        bounded = np.array([kind != "continuous" for kind in self._arm.kinds])
        lower = np.where(bounded, self._arm.lower, -np.inf)
        upper = np.where(bounded, self._arm.upper, np.inf)
        for _ in range(self._set["steps"]):
            error = self._task.compute_error(self._state)
            if max(np.linalg.norm(error[:3]), np.linalg.norm(error[3:])) < self._set["tolerance"]:
                return True
            v = self._mink.solve_ik(self._state, [self._task], dt, "daqp", limits=self._limits)
            self._state.update(np.clip(self._state.q + v * dt, lower, upper))
        return False


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The file itself, with some mass to every link."""
    if arm.follows:
        raise Refused("a joint that follows another is a constraint of MuJoCo's, which steps do not keep")
    return _Solver(arm, settings)
