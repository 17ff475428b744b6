"""A chain in the form that needs the fewest products: a twist, two offsets, and a joint that rotates and slides.

Any fixed transform is ``Rz(a) Tz(c) Tr(u, v, 0) Rx(α) Rz(b)``. Rotations and translations about the z axis of the
previous joint are merged into that joint, and rotations about a joint's own z axis into the joint itself.
``Tr(u, v, 0) Rx(α)`` remains: 33 products per joint, where the whole transform takes 51. It is the idea of Denavit and
Hartenberg (1955) without a common normal, so nearly parallel axes cause no problems.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays

from .record import Record


class Link(NamedTuple):
    """A joint, and the fixed part ``Tr(u, v, 0) Rx(α)`` before it."""

    sine: float
    """sin α"""
    cosine: float
    """cos α"""
    u: float
    """[m]"""
    v: float
    """[m]"""
    turn_rate: float
    """Its angle is ``turn_rate · q + turn_offset`` [rad]."""
    turn_offset: float
    slide_rate: float
    """Its slide is ``slide_rate · q + slide_offset`` [m]."""
    slide_offset: float
    adds: float
    """1 if the same variable moves an earlier joint, else 0."""


LINK = Record(Link)
"""The row of a joint, see `links_of`."""

read_link = LINK.read

PARALLEL = 1e-12
"""Sine of the twist between two axes below which they are parallel up to rounding; rotations about both are then the
same."""


def links_of(chain: ChainArrays) -> Array:
    """Convert a chain into this form.

    Returns:
        (m + 2, 12): one row for each joint, see `LINK`, then the transform before the first joint, then the tip, (3, 4) in
        row-major order each.
    """
    joints, links = len(chain.leader), list[Link]()
    rows = np.zeros((joints + 2, 12))
    for k in range(joints):
        R, t = chain.fixed[k, :, :3], chain.fixed[k, :, 3]
        twist = math.atan2(math.hypot(R[0, 2], R[1, 2]), R[2, 2])
        # The third column of Rz(a) Rx(α) Rz(b) is (sin a sin α, -cos a sin α, cos α).
        before = math.atan2(R[0, 2], -R[1, 2]) if math.sin(twist) > PARALLEL else 0.0
        left = _about_z(before) @ _about_x(twist)
        rest, moved = left.T @ R, _about_z(before).T @ t
        sine, cosine, u, v = math.sin(twist), math.cos(twist), moved[0], moved[1]
        if k == 0:
            # No joint before the first one can take over a part of its fixed transform.
            rows[joints] = np.column_stack([left, t]).ravel()
            sine, cosine, u, v = 0.0, 1.0, 0.0, 0.0
        else:
            # Rz(a) and Tz(c) act along the axis of the previous joint, which takes them over.
            turn, slide = links[-1].turn_offset + before, links[-1].slide_offset + moved[2]
            links[-1] = links[-1]._replace(turn_offset=turn, slide_offset=slide)
        moves, stays = (chain.multiplier[k], chain.offset[k]), (0.0, 0.0)
        (turning, turn), (sliding, slide) = (stays, moves) if chain.prismatic[k] else (moves, stays)
        turn += math.atan2(rest[1, 0], rest[0, 0])
        adds = float(chain.leader[k] in chain.leader[:k])
        links.append(Link(sine, cosine, u, v, turning, turn, sliding, slide, adds))
    for k in range(joints):
        rows[k, : LINK.size] = LINK.numbers(links[k])
    rows[joints + 1] = chain.fixed[joints].ravel()
    return rows


def _about_x(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _about_z(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
