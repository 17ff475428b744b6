"""KDL of the Orocos project through Tesseract's wheel: Newton-Raphson that keeps limits, or Levenberg-Marquardt.

https://github.com/tesseract-robotics/tesseract; a wheel of KDL by itself is on no index. First settings: the plugin's own,
one call from the middle of the ranges. In the sweep smaller errors and random starts after that, and the other solver.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Refused

NAME = "KDL"
PACKAGE = "tesseract-robotics"
RECOMMENDED: dict[str, Any] = {"solver": "KDLInvKinChainNR_JL", "told": {}, "starts": 1}
SWEEP: tuple[dict[str, Any], ...] = (
    {"solver": "KDLInvKinChainNR_JL", "told": {"position_eps": 1e-8}, "starts": 100},
    {
        "solver": "KDLInvKinChainNR_JL",
        "told": {"position_eps": 1e-8, "position_iterations": 500},
        "starts": 100,
    },
    {"solver": "KDLInvKinChainLMA", "told": {"eps": 1e-9}, "starts": 100},
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        from tesseract_robotics import tesseract_common, tesseract_environment, tesseract_kinematics

        self._common, self._kinematics = tesseract_common, tesseract_kinematics
        self._arm, self._starts, self._rng = arm, settings["starts"], np.random.default_rng(0)
        solver, base, tip = settings["solver"], arm.base, arm.tip
        with tempfile.TemporaryDirectory() as folder:
            plugins = Path(folder) / "kinematics.yaml"
            told = "".join(f"            {key}: {value}\n" for key, value in settings["told"].items())
            plugins.write_text(
                "kinematic_plugins:\n  inv_kin_plugins:\n    manipulator:\n"
                f"      default: {solver}\n      plugins:\n        {solver}:\n          class: {solver}Factory\n"
                f"          config:\n            base_link: {base}\n            tip_link: {tip}\n{told}",
                encoding="utf-8",
            )
            text = Path(arm.urdf).read_text(encoding="utf-8")
            name = text.split('<robot name="')[1].split('"')[0]
            semantics = (
                f'<robot name="{name}" version="1.0.0">'
                f'<group name="manipulator"><chain base_link="{base}" tip_link="{tip}"/></group>'
                f'<kinematics_plugin_config filename="file://{plugins}"/></robot>'
            )
            self._environment = tesseract_environment.Environment()
            if not self._environment.init(text, semantics, tesseract_common.GeneralResourceLocator()):
                raise Refused("Tesseract does not read the arm")
            self._group = self._environment.getKinematicGroup("manipulator", solver)
        if tuple(self._group.getJointNames()) != arm.joints:
            raise Refused("other joints than the arm's")

    def solve(self, T: Any, start: Any) -> Answer:
        pose = self._common.Isometry3d(np.ascontiguousarray(T))
        asked = self._kinematics.KinGroupIKInput(pose, self._arm.base, self._arm.tip)
        q = self._arm.middle if start is None else np.asarray(start, dtype=float)
        for _ in range(self._starts):
            found = self._group.calcInvKin(asked, q)
            if len(found):
                return Answer(np.asarray(found[0]).ravel(), True)
            q = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(None, False)


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The file itself."""
    if arm.follows:
        raise Refused("joints that follow others are not read")
    return _Solver(arm, settings)
