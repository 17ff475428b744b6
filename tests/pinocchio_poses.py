"""Forward kinematics by pinocchio, an outside judge."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek

Array = NDArray[np.float64]


def pinocchio_poses(pin: Any, model: Any, arm: kinseek.Arm, q: Array) -> Array:
    """Poses of the tip in the base by pinocchio, (k, n) -> (k, 4, 4)."""
    data, poses = model.createData(), []
    base, tip = model.getFrameId(arm.base), model.getFrameId(arm.tip)
    for row in q:
        full = pin.neutral(model)
        for name, value in zip(arm.joint_names, row, strict=True):
            joint = model.joints[model.getJointId(name)]
            full[joint.idx_q : joint.idx_q + joint.nq] = (
                [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
            )
        pin.framesForwardKinematics(model, data, full)
        poses.append((data.oMf[base].inverse() * data.oMf[tip]).homogeneous)
    return np.array(poses)
