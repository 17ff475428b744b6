"""A chain in the form that needs the fewest products: a twist, two offsets, and a joint that rotates and slides.

Any fixed transform is ``Rz(a) Tz(c) Tr(u, v, 0) Rx(α) Rz(b)``. Rotations and translations about the z axis of the
previous joint are merged into that joint, and rotations about a joint's own z axis into the joint itself.
``Tr(u, v, 0) Rx(α)`` remains: 33 products per joint, where the whole transform takes 51. It is the idea of Denavit and
Hartenberg (1955) without a common normal, so nearly parallel axes cause no problems.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays

TWIST_SINE, TWIST_COSINE, U, V, TURN_RATE, TURN_OFFSET, SLIDE_RATE, SLIDE_OFFSET, ADDS = range(9)
"""Indices into the row of a joint. Its angle is ``TURN_RATE · q + TURN_OFFSET`` [rad], and its slide likewise [m]. ADDS
is 1 if the same variable moves an earlier joint."""

PARALLEL = 1e-12
"""Sine of the twist between two axes below which they are parallel up to rounding; rotations about both are then the
same."""


def links_of(chain: ChainArrays) -> Array:
    """Convert a chain into this form.

    Returns:
        (m + 2, 12): one row for each joint, then the transform before the first joint, then the tip, (3, 4) in row-major
        order each.
    """
    joints = len(chain.leader)
    links = np.zeros((joints + 2, 12))
    for k in range(joints):
        R, t = chain.fixed[k, :, :3], chain.fixed[k, :, 3]
        twist = math.atan2(math.hypot(R[0, 2], R[1, 2]), R[2, 2])
        before = math.atan2(R[0, 2], -R[1, 2]) if math.sin(twist) > PARALLEL else 0.0
        left = _about_z(before) @ _about_x(twist)
        rest = left.T @ R
        moved = _about_z(before).T @ t
        row = links[k]
        row[TWIST_SINE], row[TWIST_COSINE], row[U], row[V] = math.sin(twist), math.cos(twist), *moved[:2]
        row[SLIDE_RATE if chain.prismatic[k] else TURN_RATE] = chain.multiplier[k]
        row[SLIDE_OFFSET if chain.prismatic[k] else TURN_OFFSET] = chain.offset[k]
        row[TURN_OFFSET] += math.atan2(rest[1, 0], rest[0, 0])
        row[ADDS] = float(chain.leader[k] in chain.leader[:k])
        if k > 0:
            links[k - 1, TURN_OFFSET] += before
            links[k - 1, SLIDE_OFFSET] += moved[2]
        else:
            links[joints] = np.column_stack([left, t]).ravel()
            row[TWIST_SINE], row[TWIST_COSINE], row[U], row[V] = 0.0, 1.0, 0.0, 0.0
    links[joints + 1] = chain.fixed[joints].ravel()
    return links


def _about_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
