"""The arm angle of an arm with seven revolute joints: how its elbow turns about the line from the shoulder to the wrist.

It is the stereographic shoulder-elbow-wrist angle of Elias & Wen 2024 ("Redundancy parameterization and inverse kinematics
of 7-DOF revolute manipulators", Mechanism and Machine Theory). Their reference direction is the image of one fixed direction
under the reflection that takes a second, fixed direction to the direction of the wrist. It is undefined only where the wrist
is in this second direction from the shoulder: on a half-line. The reference of the conventional angle is undefined on both
halves of a line.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arm.jacobian import jacobian_many
from kinseek.kernels.arrays import Array, ChainArrays, chain_arrays

from .axes import axes_of, foot

JOINTS = 7

ELBOW = 3
"""Number of joints that move the elbow."""

BEHIND = np.array([0.0, 0.0, -1.0])
"""Direction from the shoulder in which the angle is undefined: the base is usually there."""

REFERENCE = np.array([-1.0, 0.0, 0.0])
"""Direction that is reflected, normal to `BEHIND`. So the angle is 0 if the arm reaches along the x axis of the base, with
its elbow up."""

UNDEFINED = 1e-6
"""Distance of the elbow from the line, and of the wrist from the half-line, up to which the angle is undefined; relative to
the distance of shoulder and wrist."""


class ArmAngle(NamedTuple):
    """An arm with seven revolute joints."""

    shoulder: Array
    """The point on axis 1 nearest to axis 2, (3,), [m]. It does not move."""
    to_elbow: ChainArrays
    """The arm up to the point on axis 4 nearest to axis 3."""
    to_wrist: ChainArrays
    """The arm up to the point on axis 7 nearest to axis 6. It moves with the hand."""

    def angles(self, q: Array) -> Array:
        """Return the arm angle, (k, 7) -> (k,), in [-π, π] [rad]; NaN where it is undefined."""
        return self.with_gradients(q)[0]

    def with_gradients(self, q: Array) -> tuple[Array, Array]:
        """Return the arm angle, (k,), and its derivatives by the joints, (k, 7); NaN where it is undefined."""
        q = np.ascontiguousarray(q)
        E, W = (forward_many(arm, q)[:, :3, 3] - self.shoulder for arm in (self.to_elbow, self.to_wrist))
        dE, dW = (jacobian_many(arm, q)[:, :3] for arm in (self.to_elbow, self.to_wrist))
        by_elbow, by_wrist, angle = _derivatives(E, W)
        return angle, np.einsum("kr,krn->kn", by_elbow, dE) + np.einsum("kr,krn->kn", by_wrist, dW)


def _derivatives(e: Array, w: Array) -> tuple[Array, Array, Array]:
    """Return the derivatives of the arm angle by the elbow and the wrist, (k, 3) each, and the angle, (k,).

    Elias & Wen 2024, section 3; e and w are seen from the shoulder, (k, 3).
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.linalg.norm(w, axis=1)
        w = w / length[:, None]
        off = 1.0 - w @ BEHIND
        x = REFERENCE - (w @ REFERENCE / off)[:, None] * (w - BEHIND)
        y = np.cross(w, x)
        along = np.einsum("kr,kr->k", w, e)
        across = e - along[:, None] * w
        radius = np.linalg.norm(across, axis=1)
        angle = np.arctan2((y * e).sum(axis=1), (x * e).sum(axis=1))
        around = np.cross(w, across) / radius[:, None] ** 2
        # How the reference turns about w, and how w itself turns.
        turning = (w @ REFERENCE)[:, None] * y + (w @ np.cross(BEHIND, REFERENCE))[:, None] * x
        by_wrist = turning / (length * off)[:, None] - (along / length)[:, None] * around
        # |w - BEHIND|² = 2 off.
        undefined = ~((radius > UNDEFINED * length) & (np.sqrt(2.0 * np.maximum(off, 0.0)) > UNDEFINED))
    angle[undefined], around[undefined], by_wrist[undefined] = np.nan, np.nan, np.nan
    return around, by_wrist, angle


def arm_angle_of(arrays: ChainArrays) -> ArmAngle | None:
    """Return the arm angle of an arm; None for an arm that has no shoulder, elbow and wrist in this sense."""
    axes = axes_of(arrays)
    if axes is None or len(axes.direction) != JOINTS or axes.slides.any():
        return None
    shoulder, elbow, wrist = (foot(axes, on, near) for on, near in ((0, 1), (3, 2), (6, 5)))
    if shoulder is None or elbow is None or wrist is None:
        return None
    return ArmAngle(shoulder, _ending_at(elbow, arrays, ELBOW), _ending_at(wrist, arrays, JOINTS))


def _ending_at(point: Array, arrays: ChainArrays, joints: int) -> ChainArrays:
    """Return an arm of the first joints whose tip is a point, given where it is at q = 0, (3,) [m]."""

    def part(tip: Array) -> ChainArrays:
        return chain_arrays(
            np.concatenate([arrays.fixed[:joints], tip[None]]),
            arrays.prismatic[:joints],
            arrays.leader[:joints],
            arrays.multiplier[:joints],
            arrays.offset[:joints],
            (arrays.lower, arrays.upper),
        )

    tip = np.eye(4)[:3]
    last = forward_many(part(tip), np.zeros((1, JOINTS)))[0]
    tip[:, 3] = last[:3, :3].T @ (point - last[:3, 3])
    return part(tip)
