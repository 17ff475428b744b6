"""Planar and floating joints as joints with one variable each.

A planar joint ``base`` becomes the slides ``base/x`` and ``base/y`` in its plane and ``base/yaw``, a turn about the normal.
A floating joint becomes ``base/x``, ``base/y`` and ``base/z``, followed by ``base/yaw``, ``base/pitch`` and ``base/roll``,
turns about z, y and x, each carried by the one before: the rotation is Rz(yaw) Ry(pitch) Rx(roll), as by rpy of an origin.
"""

from __future__ import annotations

import numpy as np

from kinseek.errors import InvalidRobot

from .chain import Array, Limits, limits_pair
from .joints import Joint, z_to
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE

_X, _Y, _Z = np.eye(3)

SEVERAL_AXES = {
    "planar": (("x", _X), ("y", _Y), ("yaw", _Z)),
    "floating": (("x", _X), ("y", _Y), ("z", _Z), ("yaw", _Z), ("pitch", _Y), ("roll", _X)),
}
"""Name and axis of the joints that make the motion of each of these types, in order."""


def joints_of(name: str, kind: str, origin: Array, normal: Array, limits: Limits, child: str) -> list[Joint]:
    """Return the joints that make the motion of a planar or floating joint, in order.

    Args:
        name: Name of the joint.
        kind: A key of `SEVERAL_AXES`.
        origin: Pose of the joint frame in the preceding frame, (4, 4), lengths in [m].
        normal: Normal of the plane of a planar joint, a unit vector, (3,).
        limits: Lower and upper limit of each slide, by its name, [m]. The turns need none: a pitch in [-π/2, π/2] with
            endless roll and yaw covers every rotation.
        child: Name of the frame below the joint, for messages.

    Raises:
        InvalidRobot: Limits are missing or invalid.
    """
    axes = SEVERAL_AXES[kind]
    slides = [f"{name}/{letter}" for letter, _ in axes if len(letter) == 1]
    if missing := [slide for slide in slides if slide not in limits]:
        example = ", ".join(f"{slide!r}: (-1, 1)" for slide in missing)
        raise InvalidRobot(
            f"joint {name!r} is {kind}: it has no limits, but a search needs them. Give them in metres, "
            f"limits={{{example}}}. Choose base={child!r} to leave it out"
        )
    turn, joints = z_to(normal) if kind == "planar" else np.eye(3), list[Joint]()
    for letter, unit in axes:
        called, axis = f"{name}/{letter}", turn @ unit
        if called in slides:
            lower, upper = limits_pair(called, limits[called])
            joints.append(Joint(called, PRISMATIC, origin, axis, lower, upper))
        elif letter == "pitch":
            joints.append(Joint(called, REVOLUTE, origin, axis, -np.pi / 2, np.pi / 2))
        else:
            joints.append(Joint(called, CONTINUOUS, origin, axis, -np.pi, np.pi))
        origin = np.eye(4)
    return joints
