"""KDL of the Orocos project through Tesseract's wheel: Newton-Raphson that keeps limits, or Levenberg-Marquardt.

https://github.com/tesseract-robotics/tesseract; a wheel of KDL by itself is on no index. First settings: the plugin's own,
one call from the middle of the ranges. In the sweep smaller errors and random starts after that, and the other solver.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused, Restarting

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


class _Solver(Restarting):
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        from tesseract_robotics import tesseract_common, tesseract_kinematics

        super().__init__(arm, settings["starts"])
        self._common, self._kinematics = tesseract_common, tesseract_kinematics
        self._environment = environment_of(arm, settings["solver"], settings["told"])
        self._group = self._environment.getKinematicGroup("manipulator", settings["solver"])
        if tuple(self._group.getJointNames()) != arm.joints:
            raise Refused("other joints than the arm's")

    def descend(self, goal: Any, q: Array) -> Answer:
        pose = self._common.Isometry3d(np.ascontiguousarray(goal))
        asked = self._kinematics.KinGroupIKInput(pose, self.arm.base, self.arm.tip)
        found = self._group.calcInvKin(asked, q)
        return Answer(np.asarray(found[0]).ravel(), True) if len(found) else Answer(None, False)


def environment_of(arm: Arm, solver: str, told: dict[str, Any]) -> Any:
    """Tesseract's environment of an arm, with one of its solvers and what that is told."""
    from tesseract_robotics import tesseract_common, tesseract_environment

    # Tesseract reads the file of plugins when it is asked for a group, too.
    plugins = Path(tempfile.mkdtemp()) / "kinematics.yaml"
    more = "".join(f"            {key}: {value}\n" for key, value in told.items())
    plugins.write_text(
        "kinematic_plugins:\n  inv_kin_plugins:\n    manipulator:\n"
        f"      default: {solver}\n      plugins:\n        {solver}:\n          class: {solver}Factory\n"
        f"          config:\n            base_link: {arm.base}\n            tip_link: {arm.tip}\n{more}",
        encoding="utf-8",
    )
    text = Path(arm.urdf).read_text(encoding="utf-8")
    name = text.split('<robot name="')[1].split('"')[0]
    semantics = (
        f'<robot name="{name}" version="1.0.0">'
        f'<group name="manipulator"><chain base_link="{arm.base}" tip_link="{arm.tip}"/></group>'
        f'<kinematics_plugin_config filename="file://{plugins}"/></robot>'
    )
    environment = tesseract_environment.Environment()
    if not environment.init(text, semantics, tesseract_common.GeneralResourceLocator()):
        raise Refused("Tesseract does not read the arm")
    return environment


load = _Solver
