"""Forward kinematics: T = A_1 J_1 A_2 J_2 … A_m J_m A_tip."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

from .trigonometry import sine_cosine

FAR = 1e4
"""Angle [rad] beyond which the library's sine is used; the fast one has errors of an ulp up to ten times this."""


@inlined
def advance(A: Array, prismatic: bool, value: float, T: Array) -> None:
    """Multiply T, (3, 4), in place by the fixed transform A and a joint at `value` [rad] or [m]."""
    cosine, sine, slide = 1.0, 0.0, 0.0
    if prismatic:
        slide = value
    elif abs(value) < FAR:
        sine, cosine = sine_cosine(value)
    else:
        cosine, sine = math.cos(value), math.sin(value)
    for r in range(3):
        t0, t1, t2 = T[r, 0], T[r, 1], T[r, 2]
        x = t0 * A[0, 0] + t1 * A[1, 0] + t2 * A[2, 0]
        y = t0 * A[0, 1] + t1 * A[1, 1] + t2 * A[2, 1]
        z = t0 * A[0, 2] + t1 * A[1, 2] + t2 * A[2, 2]
        p = t0 * A[0, 3] + t1 * A[1, 3] + t2 * A[2, 3] + T[r, 3]
        T[r, 0] = x * cosine + y * sine
        T[r, 1] = y * cosine - x * sine
        T[r, 2] = z
        T[r, 3] = p + z * slide


@inlined
def identity(T: Array) -> None:
    """Set T, (3, 4), to the identity."""
    for r in range(3):
        for c in range(4):
            T[r, c] = 1.0 if r == c else 0.0


@inlined
def copy_pose(source: Array, T: Array) -> None:
    """Copy a pose, (3, 4) or (4, 4), into T, (3, 4)."""
    for r in range(3):
        for c in range(4):
            T[r, c] = source[r, c]


@inlined
def advance_segment(chain: ChainArrays, first: int, last: int, q: Array, T: Array) -> None:
    """Multiply T in place by physical joints first … last-1 at the variables q, (n,)."""
    for k in range(first, last):
        value = chain.multiplier[k] * q[chain.leader[k]] + chain.offset[k]
        advance(chain.fixed[k], chain.prismatic[k], value, T)


@inlined
def forward(chain: ChainArrays, q: Array, T: Array) -> None:
    """Write the pose of the tip in the base at joint values q, (n,), into T, (3, 4), lengths in [m]."""
    joints = len(chain.prismatic)
    identity(T)
    advance_segment(chain, 0, joints, q, T)
    # A prismatic joint at 0 does not move, so this multiplies by A_tip alone.
    advance(chain.fixed[joints], True, 0.0, T)


@entry
def write_poses(
    chain: ChainArrays, q: Annotated[Array, "k", "n"], poses: Annotated[Array, "k", 4, 4, OUT]
) -> None:
    """Write poses of the tip at many joint vectors, (k, n), into `poses`, (k, 4, 4), lengths in [m]."""
    T = np.empty((3, 4))
    for k in range(len(q)):
        forward(chain, q[k], T)
        copy_pose(T, poses[k])
        for c in range(4):
            poses[k, 3, c] = 1.0 if c == 3 else 0.0


def forward_many(chain: ChainArrays, q: Array) -> Array:
    """Poses of the tip at many joint vectors, (k, n) -> (k, 4, 4), lengths in [m]."""
    poses = np.empty((len(q), 4, 4))
    write_poses(chain, np.ascontiguousarray(q), poses)
    return poses
