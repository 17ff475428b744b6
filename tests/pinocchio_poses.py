"""Forward kinematics by pinocchio, an outside judge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek

Array = NDArray[np.float64]


def configuration(pin: Any, model: Any, names: Sequence[str], q: Array) -> Array:
    """The configuration of a model with these joint values; pinocchio has two numbers for an endless joint."""
    full = pin.neutral(model)
    for name, value in zip(names, q, strict=True):
        joint = model.joints[model.getJointId(name)]
        full[joint.idx_q : joint.idx_q + joint.nq] = (
            [np.cos(value), np.sin(value)] if joint.nq == 2 else value
        )
    return np.asarray(full)


def pinocchio_poses(pin: Any, model: Any, arm: kinseek.Arm, q: Array) -> Array:
    """Poses of the tip in the base by pinocchio, (k, n) -> (k, 4, 4)."""
    data, poses = model.createData(), []
    base, tip = (model.getFrameId(link, pin.FrameType.BODY) for link in (arm.base, arm.tip))
    for row in q:
        pin.framesForwardKinematics(model, data, configuration(pin, model, arm.joint_names, row))
        poses.append((data.oMf[base].inverse() * data.oMf[tip]).homogeneous)
    return np.array(poses)
